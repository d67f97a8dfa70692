use std::future::{pending, ready};
use std::io::{PipeReader, Read, pipe};

use tokio::task::yield_now;

use super::coverage::RecordCoverage;
use super::*;
use crate::analysis::protocol::LogPosition;

/// A supervisor with its own slots.
fn supervisor(is_fresh: bool) -> TrackingSupervisor {
    TrackingSupervisor::new(is_fresh, Arc::default())
}

/// Connects a child of a task; returns the child's end of the pipe.
fn attach(follower: &TrackingSupervisor, task: impl Future<Output = ()> + Send + 'static) -> PipeReader {
    follower.child().phase = ChildPhase::Starting { task: tokio::spawn(task) };
    let (theirs, ours) = pipe().unwrap();
    follower.attach_child(ours);
    theirs
}

/// Connects a child and stops it; returns how many positions it receives.
fn attach_and_stop(follower: &TrackingSupervisor, task: impl Future<Output = ()> + Send + 'static) -> usize {
    let theirs = attach(follower, task);
    follower.child().close_input();
    positions(theirs)
}

/// Number of positions in a pipe that is closed.
fn positions(mut theirs: PipeReader) -> usize {
    let mut received = Vec::new();
    theirs.read_to_end(&mut received).unwrap(); // would block for ever if the pipe stayed open
    received.len() / LogPosition::Beat.to_bytes().len()
}

/// Appends key frames and reports them as written together.
fn key_frames(follower: &TrackingSupervisor, count: u64) {
    (0..count).for_each(|number| follower.frame_appended(100 * number, 100, true));
    follower.bytes_written(100 * count);
}

fn is_whole(follower: &TrackingSupervisor) -> bool {
    matches!(follower.child().coverage, RecordCoverage::Whole { .. })
}

#[tokio::test]
async fn the_first_child_receives_all_earlier_records() {
    let follower = supervisor(true);
    key_frames(&follower, 5);
    assert_eq!(attach_and_stop(&follower, ready(())), 5);
    assert!(is_whole(&follower));
}

#[tokio::test]
async fn features_of_a_child_that_began_later_are_not_the_recordings() {
    let follower = supervisor(true);
    assert_eq!(attach_and_stop(&follower, ready(())), 0);
    key_frames(&follower, 5);
    assert!(is_whole(&follower));
    assert_eq!(attach_and_stop(&follower, ready(())), 1, "only the last key frame and the frames after it");
    assert!(!is_whole(&follower));
}

#[tokio::test]
async fn features_of_a_recording_that_an_earlier_service_began_are_none() {
    let follower = supervisor(false);
    attach_and_stop(&follower, ready(()));
    assert!(!is_whole(&follower));
}

#[tokio::test]
async fn a_child_that_starts_at_the_end_receives_only_the_earlier_records() {
    let follower = supervisor(true);
    key_frames(&follower, 2);
    let (theirs, ours) = pipe().unwrap();
    follower.child().phase = ChildPhase::Starting { task: tokio::spawn(ready(())) };
    follower.finish().await;
    follower.attach_child(ours);
    assert_eq!(positions(theirs), 2);
}

#[tokio::test]
async fn a_recording_that_has_to_be_ended_again_has_the_same_features() {
    let follower = supervisor(true);
    attach_and_stop(&follower, ready(()));
    key_frames(&follower, 3);
    follower.0.state.send_replace(TrackingState::Tracking(Vec::new()));
    follower.handle_reply(FollowReply { running: Some(Vec::new()), ..FollowReply::default() });
    let features = follower.finish().await;
    assert!(features.is_some());
    attach_and_stop(&follower, ready(())); // its sender connected again
    assert_eq!(follower.finish().await, features);
    key_frames(&follower, 1);
    assert_eq!(follower.finish().await, None, "a record arrived and no child had received them all");
}

#[tokio::test]
async fn a_sender_that_connects_while_its_child_is_stopped_gets_another() {
    let follower = supervisor(true);
    follower.child().phase = ChildPhase::Starting { task: tokio::spawn(pending()) };
    assert!(follower.child().phase.request_child(), "the first child is about to start");
    assert!(!follower.finish_run(Ok(())), "one child is enough");
    attach_and_stop(&follower, pending());
    assert!(follower.child().phase.request_child(), "it has not ended yet");
    assert!(follower.finish_run(Ok(())));
    assert!(!follower.finish_run(Ok(())), "one more is enough");
    assert!(!follower.child().phase.request_child(), "the next sender starts another child");
}

#[tokio::test]
async fn a_child_is_not_stopped_if_a_sender_connected_before() {
    let follower = supervisor(true);
    let _theirs = attach(&follower, pending());
    follower.stop_if(|| false);
    assert!(follower.child().phase.input().is_some());
    follower.stop_if(|| true);
    assert!(follower.child().phase.input().is_none());
}

/// A supervisor whose child shares these slots, and the child's end of the pipe.
fn sharing_slots(slots: &Arc<CpuSlots>) -> (TrackingSupervisor, PipeReader) {
    let follower = TrackingSupervisor::new(true, slots.clone());
    let theirs = attach(&follower, pending());
    (follower, theirs)
}

/// Numbers of records in flight and queued.
fn in_flight_and_queued(follower: &TrackingSupervisor) -> (usize, usize) {
    let child = follower.child();
    (child.sent.in_flight(), child.queued())
}

#[tokio::test]
async fn a_child_waits_until_that_of_another_box_is_done() {
    let slots = Arc::new(CpuSlots::new(1));
    let ((one, _keeps_one), (other, _keeps_other)) = (sharing_slots(&slots), sharing_slots(&slots));
    key_frames(&one, 1);
    assert_eq!(in_flight_and_queued(&one), (1, 0));
    key_frames(&other, 1);
    assert_eq!(in_flight_and_queued(&other), (0, 1));
    one.handle_reply(FollowReply::default());
    assert_eq!(in_flight_and_queued(&other), (1, 0));
}

#[tokio::test]
async fn a_child_with_a_backlog_leaves_others_their_slot() {
    let slots = Arc::new(CpuSlots::new(1));
    let ((one, _keeps_one), (other, _keeps_other)) = (sharing_slots(&slots), sharing_slots(&slots));
    key_frames(&one, 2 + MAX_RECORDS_PER_SLOT as u64);
    assert_eq!(in_flight_and_queued(&one), (MAX_RECORDS_PER_SLOT, 2));
    key_frames(&other, 1);
    (0..MAX_RECORDS_PER_SLOT).for_each(|_| one.handle_reply(FollowReply::default()));
    assert_eq!(in_flight_and_queued(&other), (1, 0));
    assert_eq!(in_flight_and_queued(&one), (0, 2));
}

#[tokio::test]
async fn a_child_receives_no_frame_before_it_is_written() {
    let slots = Arc::new(CpuSlots::new(1));
    let (follower, _keeps) = sharing_slots(&slots);
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

#[tokio::test]
async fn a_child_with_a_backlog_lets_another_start_at_its_last_frame() {
    let slots = Arc::new(CpuSlots::new(1));
    let ((one, _keeps_one), (other, _keeps_other)) = (sharing_slots(&slots), sharing_slots(&slots));
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
    let slots = Arc::new(CpuSlots::new(1));
    let (follower, _keeps) = sharing_slots(&slots);
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
