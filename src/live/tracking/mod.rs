//! Tracks a recording in a child process while it arrives, and passes each result to the watchers at once.
//!
//! ```text
//! record ─▶ log ─▶ position ─slot─▶ child: decode, track ─▶ reply ─▶ watchers
//! ```
//! Frames wait in the log for a [slot](super::cpu_slots), so a slow child costs no memory. A sender that is too fast
//! for the child is slowed down: its connection reads nothing while [`TrackingSupervisor::has_capacity`] is false.
//! Without a running child there is no backlog, so the sender is not slowed down. A slow watcher loses old replies but
//! never the feed.
//!
//! A crashed child does not affect the recording: the next child begins at the last key frame. After three crashes the
//! recording is no longer tracked while it arrives, until its sender connects again. Each connection that finds no
//! child starts the count at zero.
//!
//! [`child_process`] runs the children. [`child_state`] is their state behind one lock: the [phase](child_phase), the
//! [records](child_input) of the running child, the [frames](arrived_frames) that a new child needs, and whether a
//! child's features describe the [whole recording](coverage).

mod arrived_frames;
mod child_input;
mod child_phase;
mod child_process;
mod child_state;
mod coverage;
mod watcher;

use std::io::PipeWriter;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use metrics::histogram;
use tokio::sync::{Notify, broadcast, watch};
use tokio::time::timeout;

use arrived_frames::FramePosition;
use child_phase::ChildPhase;
pub(super) use child_process::FeedStopGuard;
use child_state::{ChildState, EndFeatures, SlotState};
pub use watcher::{EncodedMessage, FeedWatcher, SharedReply, Viewer};

use super::cpu_slots::{CpuSlots, SlotId, Waiter};
use super::{FeedService, OpenFeed};
use crate::analysis::protocol::{FollowReply, live_features};
use crate::domain::session::LiveFeature;

/// Largest backlog of a child in records; beyond it the sender is slowed down. This is half a second of a camera. Only
/// the warm-up at the start of a recording should need it: the child then tracks the first frames twice.
const MAX_BACKLOG: usize = 16;

/// Backlog at which a slowed sender continues: several records are then read and written at once.
const RESUME_BACKLOG: usize = MAX_BACKLOG / 2;

/// Records sent to a child per slot: a backlog is then worked off with fewer changes between children.
const MAX_RECORDS_PER_SLOT: usize = 8;

/// Replies that a watcher may be behind before it loses the oldest.
const REPLY_BUFFER: usize = 64;

/// Time that a child has for its backlog when the recording ends.
const FINISH_TIMEOUT: Duration = Duration::from_secs(10);

/// Whether a recording is tracked while it arrives.
#[derive(Clone, Debug, PartialEq)]
pub enum TrackingState {
    /// Its first frame has not arrived.
    NotStarted,
    /// It is tracked with these tools.
    Tracking(Vec<String>),
    /// It is not tracked, for this reason; it will be tracked once it is complete.
    Unavailable(String),
    /// It is not tracked, and no further frame of its sender can be used, for this reason.
    Refused(String),
}

/// Supervises the child that tracks one recording. Clones share the same child.
#[derive(Clone)]
pub(super) struct TrackingSupervisor(Arc<SupervisorParts>);

struct SupervisorParts {
    replies: broadcast::Sender<Arc<SharedReply>>,
    state: watch::Sender<TrackingState>,
    /// Number of watchers that want pictures.
    viewers: Arc<AtomicUsize>,
    /// The slots that its child shares with the children of other recordings.
    slots: Arc<CpuSlots>,
    /// Notified when the backlog has shrunk.
    capacity: Notify,
    child: Mutex<ChildState>,
}

impl TrackingSupervisor {
    /// For a new recording (`is_fresh`), or for one that already has frames.
    pub(super) fn new(is_fresh: bool, slots: Arc<CpuSlots>) -> Self {
        Self(Arc::new(SupervisorParts {
            replies: broadcast::Sender::new(REPLY_BUFFER),
            state: watch::Sender::new(TrackingState::NotStarted),
            viewers: Arc::default(),
            slots,
            capacity: Notify::new(),
            child: Mutex::new(ChildState::new(is_fresh)),
        }))
    }

    /// Starts tracking, unless it runs already. Whether tracking is possible is checked again at each connection.
    pub(super) fn start(&self, feeds: &FeedService, feed: &OpenFeed) {
        let mut child = self.child();
        if child.phase.request_child() {
            return;
        }
        if matches!(*self.0.state.borrow(), TrackingState::Refused(_)) {
            child.frames.forget_recent(); // the refused frame is among them
        }
        self.0.state.send_replace(TrackingState::NotStarted);
        let (follower, feeds, row, time_base) = (self.clone(), feeds.clone(), feed.row.clone(), feed.time_base);
        let task = feeds.0.shutdown.clone().spawn(async move {
            loop {
                let followed = follower.run_children(&feeds, &row, time_base).await;
                follower.stop();
                if !follower.finish_run(followed) {
                    return;
                }
            }
        });
        child.phase = ChildPhase::Starting { task };
    }

    /// Returns true if another child is to start. Otherwise the next sender starts one, even if it connects at this
    /// moment.
    fn finish_run(&self, followed: Result<(), TrackingState>) -> bool {
        let mut child = self.child();
        let is_wanted = child.phase.end_run(followed.is_ok());
        if let Err(not) = followed {
            self.0.state.send_replace(not);
        }
        is_wanted
    }

    /// A frame has been appended at this position in the log, perhaps not written yet.
    pub(super) fn frame_appended(&self, offset: u64, bytes: usize, is_key: bool) {
        let position = FramePosition { offset, bytes: bytes as u32 }; // fits: at most the length of a record
        self.child().frames.append(position, is_key);
    }

    /// This many bytes of the log can be read: the frames in them now wait for a slot.
    pub(super) fn bytes_written(&self, bytes: u64) {
        let mut child = self.child();
        child.enqueue_written(bytes);
        self.0.update_slot(child);
    }

    /// True if frames wait to be written for a child that runs or starts soon.
    pub(super) fn waits_for_log(&self) -> bool {
        self.child().waits_for_log()
    }

    /// True if another record may arrive.
    pub(super) fn has_capacity(&self) -> bool {
        self.child().backlog() < MAX_BACKLOG
    }

    /// Waits until several records may arrive.
    pub(super) async fn wait_for_capacity(&self) {
        loop {
            let changed = self.0.capacity.notified();
            if self.child().backlog() <= RESUME_BACKLOG {
                return;
            }
            changed.await;
        }
    }

    /// Ends the input: waits until the child has tracked its backlog, and returns the final features.
    pub(super) async fn finish(&self) -> Option<Vec<LiveFeature>> {
        let task = {
            let mut child = self.child();
            child.close_input();
            child.phase.take_task()
        };
        if let Some(mut task) = task
            && timeout(FINISH_TIMEOUT, &mut task).await.is_err()
        {
            tracing::warn!("live tracking did not finish in time; child stopped");
            task.abort(); // dropping the task stops the child
            let _ = task.await;
        }
        let mut child = self.child();
        let frames = child.frames.readable();
        if let (Some(rows), TrackingState::Tracking(tools)) = (child.coverage.take_last(), &*self.0.state.borrow()) {
            child.ended_with = Some(EndFeatures { frames, features: live_features(&rows, tools) });
        }
        child.ended_with.as_ref().filter(|ended| ended.frames == frames).map(|ended| ended.features.clone())
    }

    /// Waits until no further frame can be used; returns the reason.
    pub(super) async fn wait_until_refused(&self) -> String {
        let mut following = self.0.state.subscribe();
        loop {
            if let TrackingState::Refused(why) = &*following.borrow_and_update() {
                return why.clone();
            }
            if following.changed().await.is_err() {
                std::future::pending().await // not reached: the sender lives as long as this
            }
        }
    }

    /// A watcher of this recording. Pictures are made only while a watcher wants them.
    pub(super) fn watch(&self, feed: &Arc<OpenFeed>, wants_pictures: bool) -> FeedWatcher {
        FeedWatcher {
            row: feed.row.clone(),
            state: self.0.state.subscribe(),
            replies: self.0.replies.subscribe(),
            viewer: wants_pictures.then(|| Viewer::new(&self.0.viewers)),
            feed: Arc::downgrade(feed),
        }
    }

    /// Stops the child of a recording that has no sender, to free its memory; the next sender gets another child.
    pub(super) fn stop_if(&self, is_idle: impl FnOnce() -> bool) {
        let child = self.child(); // a sender that connects now waits here
        if is_idle() {
            self.stop_child(child);
        }
    }

    /// Stops the child after it has processed its input.
    pub(super) fn stop(&self) {
        self.stop_child(self.child());
    }

    fn stop_child(&self, mut child: MutexGuard<'_, ChildState>) {
        child.close_input();
        child.sent.clear_in_flight();
        self.0.capacity.notify_waiters();
        self.0.update_slot(child);
    }

    /// Connects a new child to this pipe.
    fn attach_child(&self, pipe: PipeWriter) {
        let mut child = self.child();
        child.attach(pipe);
        self.0.update_slot(child);
    }

    /// Handles the child's reply to a record.
    fn handle_reply(&self, mut followed: FollowReply) {
        let mut child = self.child();
        if let Some(arrived) = child.sent.complete_next() {
            // Notify only if the sender can continue: each wake-up takes a processor from a child.
            if child.backlog() <= RESUME_BACKLOG {
                self.0.capacity.notify_waiters();
            }
            if !followed.frames.is_empty() {
                histogram!("trocar_feed_followed_seconds").record(arrived.elapsed().as_secs_f64());
            }
        }
        child.coverage.take_features(&mut followed.running);
        self.0.update_slot(child);
        let _ = self.0.replies.send(Arc::new(followed.into())); // an error only means that there are no watchers
    }

    fn child(&self) -> MutexGuard<'_, ChildState> {
        self.0.child()
    }
}

impl SupervisorParts {
    /// Releases a slot that is no longer needed, and queues for one if records wait.
    fn update_slot(self: &Arc<Self>, mut child: MutexGuard<'_, ChildState>) {
        let released = child.release_slot();
        let needs_slot = child.queue_for_slot();
        drop(child); // the next waiter may be this child
        if let Some(slot) = released {
            self.slots.release(slot);
        }
        if needs_slot {
            self.slots.enqueue(self.clone());
        }
    }

    fn child(&self) -> MutexGuard<'_, ChildState> {
        self.child.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Waiter for SupervisorParts {
    /// Sends the waiting records to the child.
    fn start(&self, slot: SlotId) -> bool {
        let is_watched = self.viewers.load(Ordering::Acquire) > 0;
        let mut child = self.child();
        child.slot = SlotState::Held(slot);
        child.send_next(MAX_RECORDS_PER_SLOT, is_watched);
        child.release_slot().is_none()
    }
}

#[cfg(test)]
mod tests;
