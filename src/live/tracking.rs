//! Tracks a recording in a child process while it arrives, and passes each result to the watchers at once.
//!
//! ```text
//! record ─▶ log ─▶ position ─slot─▶ child: decode, track ─▶ reply ─▶ watchers
//! ```
//! Frames wait in the log for a [slot](super::cpu_slots), so a slow child costs no memory. A sender that is too fast
//! for the child is slowed down: its connection reads nothing while [`TrackingSupervisor::has_capacity`] is false. A
//! crashed child does not affect the recording: another one starts at the next frame, up to three times in all. A slow
//! watcher loses old replies but never the feed.

mod child_feed;
mod watcher;

use std::collections::VecDeque;
use std::fs::File;
use std::io::{PipeWriter, pipe};
use std::os::fd::OwnedFd;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use metrics::{counter, histogram};
use tokio::sync::{Notify, broadcast, watch};
use tokio::task::JoinHandle;
use tokio::time::{MissedTickBehavior, interval, timeout};

use child_feed::ChildFeed;
pub use watcher::{FeedWatcher, Viewer};

use super::cpu_slots::{self, CpuSlots, SlotId, Waiter};
use super::{FeedService, OpenFeed};
use crate::analysis::protocol::{ChildRequest, ChildWork, FollowReply, FollowWork, RunningRow, live_features};
use crate::analysis::{self, AttemptFailure, ChildAttempt, LivePlan, run_attempt};
use crate::domain::feed::TimeBase;
use crate::domain::problem::Problem;
use crate::domain::session::LiveFeature;
use crate::sandbox::{Budget, StopSwitch};
use crate::store;

/// Largest backlog of a child in records; beyond it the sender is slowed down. This is half a second of a camera: the
/// rehearsal at the start of a recording needs it, nothing else should.
const MAX_BACKLOG: usize = 16;

/// Backlog at which a slowed sender continues: several records are then read and written at once.
const RESUME_BACKLOG: usize = MAX_BACKLOG / 2;

/// Records sent to a child per slot: a backlog is then worked off with fewer changes between children.
const MAX_RECORDS_PER_SLOT: usize = 8;

/// Most frames since a key frame for a new child to begin at that key frame.
const MAX_RECENT_FRAMES: usize = 1024;

/// Replies that a watcher may be behind before it loses the oldest.
const REPLY_BUFFER: usize = 64;

/// Crashes of children per recording before live tracking is given up.
const MAX_CRASHES: u32 = 3;

/// A child that receives nothing for this long gets a heartbeat to answer.
const HEARTBEAT_INTERVAL: Duration = Duration::from_secs(10);

/// Time that a child has for its backlog when the recording ends.
const FINISH_TIMEOUT: Duration = Duration::from_secs(10);

/// Longest life and CPU time of a child: a recording of four hours, and as much again for outages of its sender.
const MAX_CHILD_TIME: Duration = Duration::from_secs(8 * 3600);

/// Most output of a child for four hours: positions, and a picture whenever one is requested.
const MAX_OUTPUT_BYTES: u64 = 64 << 30;

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
    replies: broadcast::Sender<Arc<FollowReply>>,
    state: watch::Sender<TrackingState>,
    /// Number of watchers that want pictures.
    viewers: Arc<AtomicUsize>,
    /// The slots that its child shares with the children of other recordings.
    slots: Arc<CpuSlots>,
    /// Notified when the backlog has shrunk.
    capacity: Notify,
    child: Mutex<ChildState>,
}

/// The state of the child and of its input.
#[derive(Default)]
struct ChildState {
    feed: ChildFeed,
    slot: SlotState,
    /// Frames that arrived but cannot be read in the log yet: their positions, and whether a child can begin with them.
    unwritten: VecDeque<((u64, u32), bool)>,
    /// Positions in the log of the frames since the last key frame, bytes: a new child needs them.
    recent: Vec<(u64, u32)>,
    /// Records that arrived since this service started, and whether the child has received every record of the
    /// recording. If not, its features do not describe the whole recording.
    received: usize,
    has_all_records: bool,
    has_begun: bool,
    /// The last features from the child.
    last_features: Option<Vec<RunningRow>>,
    /// The features at the end of the recording, and the number of records then: used again if the recording has to be
    /// ended again.
    ended_with: Option<(usize, Vec<LiveFeature>)>,
    /// The recording is being ended: a child that starts now stops after its first records.
    is_ending: bool,
    /// A sender connected while the child was being stopped: another child starts after it.
    is_requested: bool,
    task: Option<JoinHandle<()>>,
}

/// The child's state in the queue for slots.
#[derive(Default)]
enum SlotState {
    /// Not in the queue: no record waits.
    #[default]
    Idle,
    /// Waiting in the queue.
    Queued,
    /// Holding this slot.
    Held(SlotId),
}

impl TrackingSupervisor {
    /// For a new recording (`is_fresh`), or for one that already has frames.
    pub(super) fn new(is_fresh: bool, turns: Arc<CpuSlots>) -> Self {
        let child = ChildState { has_all_records: is_fresh, ..ChildState::default() };
        Self(Arc::new(SupervisorParts {
            replies: broadcast::Sender::new(REPLY_BUFFER),
            state: watch::Sender::new(TrackingState::NotStarted),
            viewers: Arc::default(),
            slots: turns,
            capacity: Notify::new(),
            child: Mutex::new(child),
        }))
    }

    /// Starts tracking, unless it runs already. Whether tracking is possible is checked again at each connection.
    pub(super) fn start(&self, feeds: &FeedService, feed: &OpenFeed) {
        let mut child = self.child();
        if child.request_child() {
            return;
        }
        if matches!(*self.0.state.borrow(), TrackingState::Refused(_)) {
            child.recent.clear(); // the refused frame is among them
        }
        child.is_ending = false;
        self.0.state.send_replace(TrackingState::NotStarted);
        let (follower, feeds, row, time_base) = (self.clone(), feeds.clone(), feed.row.clone(), feed.time_base);
        child.task = Some(feeds.0.shutdown.clone().spawn(async move {
            loop {
                let followed = follower.run_children(&feeds, &row, time_base).await;
                follower.stop();
                if !follower.finish_run(followed) {
                    return;
                }
            }
        }));
    }

    /// Returns true if another child is to start. Otherwise the next sender starts one, even if it connects at this
    /// moment.
    fn finish_run(&self, followed: Result<(), TrackingState>) -> bool {
        let mut child = self.child();
        let is_wanted = std::mem::take(&mut child.is_requested) && followed.is_ok();
        if !is_wanted {
            child.task = None;
        }
        if let Err(not) = followed {
            self.0.state.send_replace(not);
        }
        is_wanted
    }

    /// A frame has been appended at this position in the log, perhaps not written yet.
    pub(super) fn frame_appended(&self, offset: u64, bytes: usize, is_key: bool) {
        self.child().unwritten.push_back(((offset, bytes as u32), is_key)); // fits: at most the length of a record
    }

    /// This many bytes of the log can be read: the frames in them now wait for a slot.
    pub(super) fn bytes_written(&self, bytes: u64) {
        let mut child = self.child();
        while let Some((place, is_key)) =
            child.unwritten.pop_front_if(|((offset, length), _)| *offset + u64::from(*length) <= bytes)
        {
            child.add_frame(place, is_key);
        }
        self.0.update_slot(child);
    }

    /// True if frames wait to be written for a child that runs or starts soon.
    pub(super) fn waits_for_log(&self) -> bool {
        let child = self.child();
        !child.unwritten.is_empty() && (child.is_running() || child.feed.is_open())
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
            child.feed.close();
            child.is_ending = true;
            child.task.take()
        };
        if let Some(mut task) = task
            && timeout(FINISH_TIMEOUT, &mut task).await.is_err()
        {
            tracing::warn!("live tracking did not finish in time; child stopped");
            task.abort(); // dropping the task stops the child
            let _ = task.await;
        }
        let mut child = self.child();
        if let (Some(rows), TrackingState::Tracking(tools)) = (child.last_features.take(), &*self.0.state.borrow()) {
            child.ended_with = Some((child.received, live_features(&rows, tools)));
        }
        let came = child.received;
        child.ended_with.as_ref().filter(|ended| ended.0 == came).map(|(_, features)| features.clone())
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
            time_base: feed.time_base,
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
        child.feed.close();
        child.feed.clear_in_flight();
        self.0.capacity.notify_waiters();
        self.0.update_slot(child);
    }

    /// Runs children until one finishes normally, or returns why none can run.
    async fn run_children(
        &self,
        feeds: &FeedService,
        row: &store::FeedRow,
        time_base: TimeBase,
    ) -> Result<(), TrackingState> {
        for _ in 0..MAX_CRASHES {
            match self.run_child(feeds, row, time_base).await {
                Ok(()) | Err(AttemptFailure::Stopped) => return Ok(()),
                Err(AttemptFailure::Impossible(problem)) if problem.slug == Problem::SIZE_CHANGES => {
                    return Err(TrackingState::Refused(problem.detail));
                }
                Err(AttemptFailure::Impossible(problem)) => return Err(TrackingState::Unavailable(problem.detail)),
                Err(AttemptFailure::Crashed(why)) => tracing::warn!(feed = %row.id, why, "live tracking child crashed"),
            }
            counter!("trocar_feed_followers_died_total").increment(1);
        }
        Err(TrackingState::Unavailable("the process that tracks it crashed several times".to_owned()))
    }

    async fn run_child(
        &self,
        feeds: &FeedService,
        row: &store::FeedRow,
        time_base: TimeBase,
    ) -> Result<(), AttemptFailure> {
        let lost = |error: &dyn std::fmt::Display| AttemptFailure::Crashed(format!("hit an error: {error}"));
        let track = analysis::live_plan(row.box_id, &feeds.0.store).await.map_err(|why| lost(&why))?;
        let LivePlan { track, ports } = track.map_err(AttemptFailure::Impossible)?;
        let tools = track.tools.iter().map(|tool| tool.name.clone()).collect();
        let work = FollowWork { track, codec: row.codec, size: (row.width, row.height), time_base, ports };
        let request = ChildRequest { threads: 1, work: ChildWork::Follow(work) };
        let (log, _) = feeds.0.vault.read_feed(row.id).await.map_err(|error| lost(&error))?;
        let (theirs, ours) = pipe().map_err(|error| lost(&error))?;
        let inputs = vec![log, File::from(OwnedFd::from(theirs))];
        let budget = Budget {
            cpu: MAX_CHILD_TIME,
            slice: Budget::SHORT_SLICE,
            wall: MAX_CHILD_TIME,
            output_bytes: MAX_OUTPUT_BYTES,
            ..feeds.0.analysis.budget()
        };
        let stop = FeedStopGuard(StopSwitch::new().map_err(|error| lost(&error))?);
        let (program, stopping, follower) = (feeds.0.program.clone(), stop.0.clone(), self.clone());
        self.attach_child(ours);
        self.0.state.send_replace(TrackingState::Tracking(tools));
        let mut child = tokio::task::spawn_blocking(move || {
            let what = ChildAttempt { program: &program, request, inputs, budget: &budget, stop: &stopping };
            run_attempt(what, |event| {
                if let analysis::ChildEvent::Followed(followed) = event {
                    follower.handle_reply(followed);
                }
            })
            .0
        });
        let mut beat = interval(HEARTBEAT_INTERVAL);
        let mut look = interval(cpu_slots::MAX_SLOT_TIME);
        look.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let ended = loop {
            tokio::select! {
                ended = &mut child => break ended,
                () = feeds.0.shutdown.begun() => { stop.0.pull(); break child.await }
                _ = beat.tick() => self.child().feed.send_heartbeat(),
                _ = look.tick() => self.0.slots.start_next(),
            }
        };
        self.stop();
        ended.map_err(|panic| AttemptFailure::Crashed(panic.to_string()))?.map(drop)
    }

    /// Connects a new child to this pipe.
    fn attach_child(&self, places: PipeWriter) {
        let mut child = self.child();
        child.start(places);
        self.0.update_slot(child);
    }

    /// Handles the child's reply to a record.
    fn handle_reply(&self, mut followed: FollowReply) {
        let mut child = self.child();
        if let Some(arrived) = child.feed.complete_next() {
            // Notify only if the sender can continue: each wake-up takes a processor from a child.
            if child.backlog() <= RESUME_BACKLOG {
                self.0.capacity.notify_waiters();
            }
            if !followed.frames.is_empty() {
                histogram!("trocar_feed_followed_seconds").record(arrived.elapsed().as_secs_f64());
            }
        }
        followed.running.take_if(|_| !child.has_all_records);
        if let Some(rows) = &followed.running {
            child.last_features = Some(rows.clone());
        }
        self.0.update_slot(child);
        let _ = self.0.replies.send(Arc::new(followed)); // an error only means that there are no watchers
    }

    fn child(&self) -> MutexGuard<'_, ChildState> {
        self.0.child()
    }
}

impl SupervisorParts {
    /// Releases a slot that is no longer needed, and queues for one if records wait.
    fn update_slot(self: &Arc<Self>, mut child: MutexGuard<'_, ChildState>) {
        let over = child.release_slot();
        let stands = child.enqueue();
        drop(child); // the next waiter may be this child
        if let Some(turn) = over {
            self.slots.release(turn);
        }
        if stands {
            self.slots.enqueue(self.clone());
        }
    }

    fn child(&self) -> MutexGuard<'_, ChildState> {
        self.child.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Waiter for SupervisorParts {
    /// Sends the waiting records to the child.
    fn start(&self, turn: SlotId) -> bool {
        let is_watched = self.viewers.load(Ordering::Acquire) > 0;
        let mut child = self.child();
        child.slot = SlotState::Held(turn);
        child.feed.send_next(MAX_RECORDS_PER_SLOT, is_watched);
        child.release_slot().is_none()
    }
}

impl ChildState {
    /// Releases its slot if it no longer needs it, and returns the slot.
    fn release_slot(&mut self) -> Option<SlotId> {
        let SlotState::Held(turn) = self.slot else { return None };
        self.is_nearly_done().then(|| {
            self.slot = SlotState::Idle;
            turn
        })
    }

    /// Marks the child as queued if it needs a slot; returns true if the caller has to enqueue it.
    fn enqueue(&mut self) -> bool {
        let stands = matches!(self.slot, SlotState::Idle) && self.feed.queued() > 0;
        if stands {
            self.slot = SlotState::Queued;
        }
        stands
    }

    fn is_running(&self) -> bool {
        self.task.as_ref().is_some_and(|task| !task.is_finished())
    }

    /// Number of records that arrived and are not tracked yet; 0 without a child.
    fn backlog(&self) -> usize {
        let unwritten = if self.feed.is_open() { self.unwritten.len() } else { 0 };
        self.feed.in_flight() + self.feed.queued() + unwritten
    }

    /// True if the next child may start. A child with a backlog is then at its last frame, so that no processor idles
    /// until the reply.
    fn is_nearly_done(&self) -> bool {
        self.feed.in_flight() <= usize::from(self.feed.queued() > 0)
    }

    /// Adds a frame at this position in the log.
    fn add_frame(&mut self, place: (u64, u32), is_key: bool) {
        // The first child receives all frames that arrived before it started.
        if (is_key && self.has_begun) || self.recent.len() == MAX_RECENT_FRAMES {
            self.recent.clear();
        }
        self.received += 1;
        if is_key || !self.recent.is_empty() {
            self.recent.push(place);
        }
        self.feed.enqueue(place);
    }

    /// Requests a child for a sender. Returns true if one runs; if that one is being stopped, another will follow it.
    fn request_child(&mut self) -> bool {
        self.is_requested = self.is_running() && self.has_begun && !self.feed.is_open();
        self.is_running()
    }

    /// Starts a child with the frames since the last key frame.
    fn start(&mut self, places: PipeWriter) {
        self.feed.attach(places);
        (self.has_begun, self.is_requested) = (true, false);
        self.has_all_records &= self.received == self.recent.len();
        if !self.has_all_records {
            self.last_features = None;
        }
        for place in self.recent.clone() {
            self.feed.enqueue(place);
        }
        if self.is_ending {
            self.feed.close();
        }
    }
}

/// Stops a child when its task is dropped.
pub(super) struct FeedStopGuard(pub(super) StopSwitch);

impl Drop for FeedStopGuard {
    fn drop(&mut self) {
        self.0.pull();
    }
}

#[cfg(test)]
mod tests;
