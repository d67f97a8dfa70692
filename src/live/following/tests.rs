use std::io::{PipeReader, Read};

use tokio::task::yield_now;

use super::*;
use crate::analysis::protocol::Place;

/// A supervisor with its own slots.
fn follower(is_fresh: bool) -> Follower {
    Follower::new(is_fresh, Arc::default())
}

/// Connects a child; returns how many positions it receives at once.
fn begin(follower: &Follower) -> usize {
    let (mut theirs, ours) = pipe().unwrap();
    follower.begin_child(ours);
    follower.child().telling.end();
    let mut received = Vec::new();
    theirs.read_to_end(&mut received).unwrap();
    received.len() / Place::Beat.to_bytes().len()
}

/// Appends key frames and reports them as written together.
fn key_frames(follower: &Follower, count: u64) {
    (0..count).for_each(|number| follower.came(100 * number, 100, true));
    follower.wrote(100 * count);
}

fn is_whole(follower: &Follower) -> bool {
    follower.child().is_whole
}

#[test]
fn the_first_child_is_told_of_all_that_came_before_it() {
    let follower = follower(true);
    key_frames(&follower, 5);
    assert_eq!(begin(&follower), 5);
    assert!(is_whole(&follower));
}

#[test]
fn features_of_a_child_that_began_later_are_not_the_recordings() {
    let follower = follower(true);
    assert_eq!(begin(&follower), 0);
    key_frames(&follower, 5);
    assert!(is_whole(&follower));
    assert_eq!(begin(&follower), 1, "only the last key frame and the frames after it");
    assert!(!is_whole(&follower));
}

#[test]
fn features_of_a_recording_that_an_earlier_service_began_are_none() {
    let follower = follower(false);
    begin(&follower);
    assert!(!is_whole(&follower));
}

#[test]
fn a_child_that_begins_at_the_end_is_told_what_came_and_no_more() {
    let follower = follower(true);
    key_frames(&follower, 2);
    let (mut theirs, ours) = pipe().unwrap();
    follower.child().is_ending = true;
    follower.begin_child(ours);
    let mut received = Vec::new();
    theirs.read_to_end(&mut received).unwrap(); // would block for ever if the pipe stayed open
    assert_eq!(received.len(), 2 * Place::Beat.to_bytes().len());
}

#[tokio::test]
async fn a_recording_that_has_to_be_ended_again_has_the_same_features() {
    let follower = follower(true);
    begin(&follower);
    key_frames(&follower, 3);
    follower.0.following.send_replace(Following::Tools(Vec::new()));
    follower.child().last = Some(Vec::new());
    let features = follower.end().await;
    assert!(features.is_some());
    begin(&follower); // its sender connected again
    assert_eq!(follower.end().await, features);
    key_frames(&follower, 1);
    assert_eq!(follower.end().await, None, "a record arrived and no child had received them all");
}

/// Sets a task that is not finished, in place of the one that runs children.
fn with_a_task(follower: &Follower) {
    follower.child().task = Some(tokio::spawn(std::future::pending()));
}

#[tokio::test]
async fn a_sender_that_comes_while_its_child_is_let_go_gets_another() {
    let follower = follower(true);
    with_a_task(&follower);
    assert!(follower.child().is_begun(), "the first child is about to start");
    assert!(!follower.goes_on(Ok(())), "one child is enough");
    begin(&follower); // this stops it
    with_a_task(&follower);
    assert!(follower.child().is_begun(), "it has not ended yet");
    assert!(follower.goes_on(Ok(())));
    assert!(!follower.goes_on(Ok(())), "one more is enough");
    assert!(!follower.child().is_begun(), "the next sender starts another child");
}

#[tokio::test]
async fn a_child_is_not_let_go_of_a_sender_that_came_before_it_was() {
    let follower = follower(true);
    let (_theirs, ours) = pipe().unwrap();
    follower.begin_child(ours);
    follower.let_go_if(|| false);
    assert!(follower.child().telling.goes_on());
    follower.let_go_if(|| true);
    assert!(!follower.child().telling.goes_on());
}

/// A supervisor whose child shares these slots, and the child's end of the pipe.
fn in_turn(turns: &Arc<Turns>) -> (Follower, PipeReader) {
    let follower = Follower::new(true, turns.clone());
    let (theirs, ours) = pipe().unwrap();
    follower.begin_child(ours);
    (follower, theirs)
}

/// Numbers of records in flight and queued.
fn told_and_waiting(follower: &Follower) -> (usize, usize) {
    let child = follower.child();
    (child.telling.told(), child.telling.untold())
}

#[test]
fn a_child_waits_until_that_of_another_box_is_done() {
    let turns = Arc::new(Turns::new(1));
    let ((one, _keeps_one), (other, _keeps_other)) = (in_turn(&turns), in_turn(&turns));
    key_frames(&one, 1);
    assert_eq!(told_and_waiting(&one), (1, 0));
    key_frames(&other, 1);
    assert_eq!(told_and_waiting(&other), (0, 1));
    one.heard(Followed::default());
    assert_eq!(told_and_waiting(&other), (1, 0));
}

#[test]
fn a_child_that_is_behind_leaves_others_their_turn() {
    let turns = Arc::new(Turns::new(1));
    let ((one, _keeps_one), (other, _keeps_other)) = (in_turn(&turns), in_turn(&turns));
    key_frames(&one, 2 + MOST_IN_A_TURN as u64);
    assert_eq!(told_and_waiting(&one), (MOST_IN_A_TURN, 2));
    key_frames(&other, 1);
    (0..MOST_IN_A_TURN).for_each(|_| one.heard(Followed::default()));
    assert_eq!(told_and_waiting(&other), (1, 0));
    assert_eq!(told_and_waiting(&one), (0, 2));
}

#[test]
fn a_child_is_told_of_no_frame_before_it_is_written() {
    let turns = Arc::new(Turns::new(1));
    let (follower, _keeps) = in_turn(&turns);
    for number in 0..3 {
        follower.came(100 * number, 100, true);
    }
    assert_eq!(told_and_waiting(&follower), (0, 0));
    assert!(follower.waits_for_log());
    follower.wrote(250);
    assert_eq!(told_and_waiting(&follower), (2, 0), "half a record does not count");
    follower.wrote(300);
    assert!(!follower.waits_for_log());
    follower.heard(Followed::default());
    follower.heard(Followed::default());
    assert_eq!(told_and_waiting(&follower), (1, 0));
}

#[test]
fn a_child_that_is_behind_lets_another_begin_at_its_last_frame() {
    let turns = Arc::new(Turns::new(1));
    let ((one, _keeps_one), (other, _keeps_other)) = (in_turn(&turns), in_turn(&turns));
    key_frames(&one, 1 + MOST_IN_A_TURN as u64);
    assert_eq!(told_and_waiting(&one), (MOST_IN_A_TURN, 1));
    key_frames(&other, 1);
    (2..MOST_IN_A_TURN).for_each(|_| one.heard(Followed::default()));
    assert_eq!(told_and_waiting(&other), (0, 1));
    one.heard(Followed::default());
    assert_eq!(told_and_waiting(&other), (1, 0));
    assert_eq!(told_and_waiting(&one), (1, 1));
}

#[tokio::test]
async fn a_feed_that_was_slowed_goes_on_once_there_is_room_for_several() {
    let turns = Arc::new(Turns::new(1));
    let (follower, _keeps) = in_turn(&turns);
    let frames = MOST_BEHIND as u64;
    (0..frames).for_each(|number| follower.came(100 * number, 100, true));
    assert!(!follower.has_room(), "frames that are not written yet count");
    follower.wrote(100 * frames);
    assert!(!follower.has_room());
    let slowed = follower.clone();
    let slowed = tokio::spawn(async move { slowed.room().await });
    for _ in 1..MOST_BEHIND - ROOM_BEHIND {
        yield_now().await;
        follower.heard(Followed::default());
    }
    yield_now().await;
    assert!(follower.has_room() && !slowed.is_finished());
    follower.heard(Followed::default());
    yield_now().await;
    assert!(slowed.is_finished());
}
