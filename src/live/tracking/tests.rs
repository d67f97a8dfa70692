use std::io::{PipeReader, Read};

use tokio::task::yield_now;

use super::*;
use crate::analysis::protocol::LogPosition;

/// A supervisor with its own slots.
fn supervisor(is_fresh: bool) -> TrackingSupervisor {
    TrackingSupervisor::new(is_fresh, Arc::default())
}

/// Connects a child; returns how many positions it receives at once.
fn begin(follower: &TrackingSupervisor) -> usize {
    let (mut theirs, ours) = pipe().unwrap();
    follower.attach_child(ours);
    follower.child().feed.close();
    let mut received = Vec::new();
    theirs.read_to_end(&mut received).unwrap();
    received.len() / LogPosition::Beat.to_bytes().len()
}

/// Appends key frames and reports them as written together.
fn key_frames(follower: &TrackingSupervisor, count: u64) {
    (0..count).for_each(|number| follower.frame_appended(100 * number, 100, true));
    follower.bytes_written(100 * count);
}

fn is_whole(follower: &TrackingSupervisor) -> bool {
    follower.child().has_all_records
}

#[test]
fn the_first_child_receives_all_earlier_records() {
    let follower = supervisor(true);
    key_frames(&follower, 5);
    assert_eq!(begin(&follower), 5);
    assert!(is_whole(&follower));
}

#[test]
fn features_of_a_child_that_began_later_are_not_the_recordings() {
    let follower = supervisor(true);
    assert_eq!(begin(&follower), 0);
    key_frames(&follower, 5);
    assert!(is_whole(&follower));
    assert_eq!(begin(&follower), 1, "only the last key frame and the frames after it");
    assert!(!is_whole(&follower));
}

#[test]
fn features_of_a_recording_that_an_earlier_service_began_are_none() {
    let follower = supervisor(false);
    begin(&follower);
    assert!(!is_whole(&follower));
}

#[test]
fn a_child_that_starts_at_the_end_receives_only_the_earlier_records() {
    let follower = supervisor(true);
    key_frames(&follower, 2);
    let (mut theirs, ours) = pipe().unwrap();
    follower.child().is_ending = true;
    follower.attach_child(ours);
    let mut received = Vec::new();
    theirs.read_to_end(&mut received).unwrap(); // would block for ever if the pipe stayed open
    assert_eq!(received.len(), 2 * LogPosition::Beat.to_bytes().len());
}

#[tokio::test]
async fn a_recording_that_has_to_be_ended_again_has_the_same_features() {
    let follower = supervisor(true);
    begin(&follower);
    key_frames(&follower, 3);
    follower.0.state.send_replace(TrackingState::Tracking(Vec::new()));
    follower.child().last_features = Some(Vec::new());
    let features = follower.finish().await;
    assert!(features.is_some());
    begin(&follower); // its sender connected again
    assert_eq!(follower.finish().await, features);
    key_frames(&follower, 1);
    assert_eq!(follower.finish().await, None, "a record arrived and no child had received them all");
}

/// Sets a task that is not finished, in place of the one that runs children.
fn set_running_task(follower: &TrackingSupervisor) {
    follower.child().task = Some(tokio::spawn(std::future::pending()));
}

#[tokio::test]
async fn a_sender_that_connects_while_its_child_is_stopped_gets_another() {
    let follower = supervisor(true);
    set_running_task(&follower);
    assert!(follower.child().request_child(), "the first child is about to start");
    assert!(!follower.finish_run(Ok(())), "one child is enough");
    begin(&follower); // this stops it
    set_running_task(&follower);
    assert!(follower.child().request_child(), "it has not ended yet");
    assert!(follower.finish_run(Ok(())));
    assert!(!follower.finish_run(Ok(())), "one more is enough");
    assert!(!follower.child().request_child(), "the next sender starts another child");
}

#[tokio::test]
async fn a_child_is_not_stopped_if_a_sender_connected_before() {
    let follower = supervisor(true);
    let (_theirs, ours) = pipe().unwrap();
    follower.attach_child(ours);
    follower.stop_if(|| false);
    assert!(follower.child().feed.is_open());
    follower.stop_if(|| true);
    assert!(!follower.child().feed.is_open());
}

/// A supervisor whose child shares these slots, and the child's end of the pipe.
fn sharing_slots(turns: &Arc<CpuSlots>) -> (TrackingSupervisor, PipeReader) {
    let follower = TrackingSupervisor::new(true, turns.clone());
    let (theirs, ours) = pipe().unwrap();
    follower.attach_child(ours);
    (follower, theirs)
}

/// Numbers of records in flight and queued.
fn in_flight_and_queued(follower: &TrackingSupervisor) -> (usize, usize) {
    let child = follower.child();
    (child.feed.in_flight(), child.feed.queued())
}

#[test]
fn a_child_waits_until_that_of_another_box_is_done() {
    let turns = Arc::new(CpuSlots::new(1));
    let ((one, _keeps_one), (other, _keeps_other)) = (sharing_slots(&turns), sharing_slots(&turns));
    key_frames(&one, 1);
    assert_eq!(in_flight_and_queued(&one), (1, 0));
    key_frames(&other, 1);
    assert_eq!(in_flight_and_queued(&other), (0, 1));
    one.handle_reply(FollowReply::default());
    assert_eq!(in_flight_and_queued(&other), (1, 0));
}

#[test]
fn a_child_with_a_backlog_leaves_others_their_slot() {
    let turns = Arc::new(CpuSlots::new(1));
    let ((one, _keeps_one), (other, _keeps_other)) = (sharing_slots(&turns), sharing_slots(&turns));
    key_frames(&one, 2 + MAX_RECORDS_PER_SLOT as u64);
    assert_eq!(in_flight_and_queued(&one), (MAX_RECORDS_PER_SLOT, 2));
    key_frames(&other, 1);
    (0..MAX_RECORDS_PER_SLOT).for_each(|_| one.handle_reply(FollowReply::default()));
    assert_eq!(in_flight_and_queued(&other), (1, 0));
    assert_eq!(in_flight_and_queued(&one), (0, 2));
}

#[test]
fn a_child_receives_no_frame_before_it_is_written() {
    let turns = Arc::new(CpuSlots::new(1));
    let (follower, _keeps) = sharing_slots(&turns);
    for number in 0..3 {
        follower.frame_appended(100 * number, 100, true);
    }
    assert_eq!(in_flight_and_queued(&follower), (0, 0));
    assert!(follower.waits_for_log());
    follower.bytes_written(250);
    assert_eq!(in_flight_and_queued(&follower), (2, 0), "half a record does not count");
    follower.bytes_written(300);
    assert!(!follower.waits_for_log());
    follower.handle_reply(FollowReply::default());
    follower.handle_reply(FollowReply::default());
    assert_eq!(in_flight_and_queued(&follower), (1, 0));
}

#[test]
fn a_child_with_a_backlog_lets_another_start_at_its_last_frame() {
    let turns = Arc::new(CpuSlots::new(1));
    let ((one, _keeps_one), (other, _keeps_other)) = (sharing_slots(&turns), sharing_slots(&turns));
    key_frames(&one, 1 + MAX_RECORDS_PER_SLOT as u64);
    assert_eq!(in_flight_and_queued(&one), (MAX_RECORDS_PER_SLOT, 1));
    key_frames(&other, 1);
    (2..MAX_RECORDS_PER_SLOT).for_each(|_| one.handle_reply(FollowReply::default()));
    assert_eq!(in_flight_and_queued(&other), (0, 1));
    one.handle_reply(FollowReply::default());
    assert_eq!(in_flight_and_queued(&other), (1, 0));
    assert_eq!(in_flight_and_queued(&one), (1, 1));
}

#[tokio::test]
async fn a_feed_that_was_slowed_goes_on_once_there_is_room_for_several() {
    let turns = Arc::new(CpuSlots::new(1));
    let (follower, _keeps) = sharing_slots(&turns);
    let frames = MAX_BACKLOG as u64;
    (0..frames).for_each(|number| follower.frame_appended(100 * number, 100, true));
    assert!(!follower.has_capacity(), "frames that are not written yet count");
    follower.bytes_written(100 * frames);
    assert!(!follower.has_capacity());
    let slowed = follower.clone();
    let slowed = tokio::spawn(async move { slowed.wait_for_capacity().await });
    for _ in 1..MAX_BACKLOG - RESUME_BACKLOG {
        yield_now().await;
        follower.handle_reply(FollowReply::default());
    }
    yield_now().await;
    assert!(follower.has_capacity() && !slowed.is_finished());
    follower.handle_reply(FollowReply::default());
    yield_now().await;
    assert!(slowed.is_finished());
}
