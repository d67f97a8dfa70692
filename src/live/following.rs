//! Tracks a recording in a child process while it arrives, and passes each result to the watchers at once.
//!
//! ```text
//! record ─▶ log ─▶ position ─slot─▶ child: decode, track ─▶ reply ─▶ watchers
//! ```
//! Frames wait in the log for a [slot](super::cpu_slots), so a slow child costs no memory. A sender that is too fast
//! for the child is slowed down: its connection reads nothing while [`TrackingSupervisor::has_capacity`] is false. A
//! crashed child does not affect the recording: another one starts at the next frame, up to three times in all. A slow
//! watcher loses old replies but never the feed.

mod telling;
mod watching;

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

use telling::Telling;
pub use watching::{Viewer, Watch};

use super::turns::{self, Stands, Turn, Turns};
use super::{Feed, Feeds};
use crate::analysis::protocol::{FollowWork, Followed, Request, RunningRow, Work, live_features};
use crate::analysis::{self, Attempt, Failure, LiveOrders, attempt};
use crate::domain::feed::TimeBase;
use crate::domain::problem::Problem;
use crate::domain::session::LiveFeature;
use crate::sandbox::{Budget, Stop};
use crate::store;

/// Largest backlog of a child in records; beyond it the sender is slowed down. This is half a second of a camera: the
/// rehearsal at the start of a recording needs it, nothing else should.
const MOST_BEHIND: usize = 16;

/// Backlog at which a slowed sender continues: several records are then read and written at once.
const ROOM_BEHIND: usize = MOST_BEHIND / 2;

/// Records sent to a child per slot: a backlog is then worked off with fewer changes between children.
const MOST_IN_A_TURN: usize = 8;

/// Most frames since a key frame for a new child to begin at that key frame.
const MOST_RECENT: usize = 1024;

/// Replies that a watcher may be behind before it loses the oldest.
const NEWS_KEPT: usize = 64;

/// Crashes of children per recording before live tracking is given up.
const MOST_CRASHES: u32 = 3;

/// A child that receives nothing for this long gets a heartbeat to answer.
const BEAT: Duration = Duration::from_secs(10);

/// Time that a child has for its backlog when the recording ends.
const LAST_WORDS: Duration = Duration::from_secs(10);

/// Longest life and CPU time of a child: a recording of four hours, and as much again for outages of its sender.
const LONGEST: Duration = Duration::from_secs(8 * 3600);

/// Most output of a child for four hours: positions, and a picture whenever one is requested.
const OUTPUT_BYTES: u64 = 64 << 30;

/// Whether a recording is tracked while it arrives.
#[derive(Clone, Debug, PartialEq)]
pub enum Following {
    /// Its first frame has not arrived.
    NotYet,
    /// It is tracked with these tools.
    Tools(Vec<String>),
    /// It is not tracked, for this reason; it will be tracked once it is complete.
    Not(String),
    /// It is not tracked, and no further frame of its sender can be used, for this reason.
    Refused(String),
}

/// Supervises the child that tracks one recording. Clones share the same child.
#[derive(Clone)]
pub(super) struct Follower(Arc<Parts>);

struct Parts {
    news: broadcast::Sender<Arc<Followed>>,
    following: watch::Sender<Following>,
    /// Number of watchers that want pictures.
    viewers: Arc<AtomicUsize>,
    /// The slots that its child shares with the children of other recordings.
    turns: Arc<Turns>,
    /// Notified when the backlog has shrunk.
    room: Notify,
    child: Mutex<Child>,
}

/// The state of the child and of its input.
#[derive(Default)]
struct Child {
    telling: Telling,
    place: InLine,
    /// Frames that arrived but cannot be read in the log yet: their positions, and whether a child can begin with them.
    unwritten: VecDeque<((u64, u32), bool)>,
    /// Positions in the log of the frames since the last key frame, bytes: a new child needs them.
    recent: Vec<(u64, u32)>,
    /// Records that arrived since this service started, and whether the child has received every record of the
    /// recording. If not, its features do not describe the whole recording.
    came: usize,
    is_whole: bool,
    has_begun: bool,
    /// The last features from the child.
    last: Option<Vec<RunningRow>>,
    /// The features at the end of the recording, and the number of records then: used again if the recording has to be
    /// ended again.
    ended_with: Option<(usize, Vec<LiveFeature>)>,
    /// The recording is being ended: a child that starts now stops after its first records.
    is_ending: bool,
    /// A sender connected while the child was being stopped: another child starts after it.
    is_wanted: bool,
    task: Option<JoinHandle<()>>,
}

/// The child's state in the queue for slots.
#[derive(Default)]
enum InLine {
    /// Not in the queue: no record waits.
    #[default]
    Away,
    /// Waiting in the queue.
    Waits,
    /// Holding this slot.
    Has(Turn),
}

impl Follower {
    /// For a new recording (`is_fresh`), or for one that already has frames.
    pub(super) fn new(is_fresh: bool, turns: Arc<Turns>) -> Self {
        let child = Child { is_whole: is_fresh, ..Child::default() };
        Self(Arc::new(Parts {
            news: broadcast::Sender::new(NEWS_KEPT),
            following: watch::Sender::new(Following::NotYet),
            viewers: Arc::default(),
            turns,
            room: Notify::new(),
            child: Mutex::new(child),
        }))
    }

    /// Starts tracking, unless it runs already. Whether tracking is possible is checked again at each connection.
    pub(super) fn begin(&self, feeds: &Feeds, feed: &Feed) {
        let mut child = self.child();
        if child.is_begun() {
            return;
        }
        if matches!(*self.0.following.borrow(), Following::Refused(_)) {
            child.recent.clear(); // the refused frame is among them
        }
        child.is_ending = false;
        self.0.following.send_replace(Following::NotYet);
        let (follower, feeds, row, time_base) = (self.clone(), feeds.clone(), feed.row.clone(), feed.time_base);
        child.task = Some(feeds.0.shutdown.clone().spawn(async move {
            loop {
                let followed = follower.follow(&feeds, &row, time_base).await;
                follower.let_go();
                if !follower.goes_on(followed) {
                    return;
                }
            }
        }));
    }

    /// Returns true if another child is to start. Otherwise the next sender starts one, even if it connects at this
    /// moment.
    fn goes_on(&self, followed: Result<(), Following>) -> bool {
        let mut child = self.child();
        let is_wanted = std::mem::take(&mut child.is_wanted) && followed.is_ok();
        if !is_wanted {
            child.task = None;
        }
        if let Err(not) = followed {
            self.0.following.send_replace(not);
        }
        is_wanted
    }

    /// A frame has been appended at this position in the log, perhaps not written yet.
    pub(super) fn came(&self, offset: u64, bytes: usize, is_key: bool) {
        self.child().unwritten.push_back(((offset, bytes as u32), is_key)); // fits: at most the length of a record
    }

    /// This many bytes of the log can be read: the frames in them now wait for a slot.
    pub(super) fn wrote(&self, bytes: u64) {
        let mut child = self.child();
        while let Some((place, is_key)) =
            child.unwritten.pop_front_if(|((offset, length), _)| *offset + u64::from(*length) <= bytes)
        {
            child.take_place(place, is_key);
        }
        self.0.take_turns(child);
    }

    /// True if frames wait to be written for a child that runs or starts soon.
    pub(super) fn waits_for_log(&self) -> bool {
        let child = self.child();
        !child.unwritten.is_empty() && (child.is_running() || child.telling.goes_on())
    }

    /// True if another record may arrive.
    pub(super) fn has_room(&self) -> bool {
        self.child().behind() < MOST_BEHIND
    }

    /// Waits until several records may arrive.
    pub(super) async fn room(&self) {
        loop {
            let changed = self.0.room.notified();
            if self.child().behind() <= ROOM_BEHIND {
                return;
            }
            changed.await;
        }
    }

    /// Ends the input: waits until the child has tracked its backlog, and returns the final features.
    pub(super) async fn end(&self) -> Option<Vec<LiveFeature>> {
        let task = {
            let mut child = self.child();
            child.telling.end();
            child.is_ending = true;
            child.task.take()
        };
        if let Some(mut task) = task
            && timeout(LAST_WORDS, &mut task).await.is_err()
        {
            tracing::warn!("live tracking did not finish in time; child stopped");
            task.abort(); // dropping the task stops the child
            let _ = task.await;
        }
        let mut child = self.child();
        if let (Some(rows), Following::Tools(tools)) = (child.last.take(), &*self.0.following.borrow()) {
            child.ended_with = Some((child.came, live_features(&rows, tools)));
        }
        let came = child.came;
        child.ended_with.as_ref().filter(|ended| ended.0 == came).map(|(_, features)| features.clone())
    }

    /// Waits until no further frame can be used; returns the reason.
    pub(super) async fn refused(&self) -> String {
        let mut following = self.0.following.subscribe();
        loop {
            if let Following::Refused(why) = &*following.borrow_and_update() {
                return why.clone();
            }
            if following.changed().await.is_err() {
                std::future::pending().await // not reached: the sender lives as long as this
            }
        }
    }

    /// A watcher of this recording. Pictures are made only while a watcher wants them.
    pub(super) fn watch(&self, feed: &Arc<Feed>, wants_pictures: bool) -> Watch {
        Watch {
            row: feed.row.clone(),
            time_base: feed.time_base,
            following: self.0.following.subscribe(),
            news: self.0.news.subscribe(),
            viewer: wants_pictures.then(|| Viewer::new(&self.0.viewers)),
            feed: Arc::downgrade(feed),
        }
    }

    /// Stops the child of a recording that has no sender, to free its memory; the next sender gets another child.
    pub(super) fn let_go_if(&self, is_idle: impl FnOnce() -> bool) {
        let child = self.child(); // a sender that connects now waits here
        if is_idle() {
            self.let_go_of(child);
        }
    }

    /// Stops the child after it has processed its input.
    pub(super) fn let_go(&self) {
        self.let_go_of(self.child());
    }

    fn let_go_of(&self, mut child: MutexGuard<'_, Child>) {
        child.telling.end();
        child.telling.forget();
        self.0.room.notify_waiters();
        self.0.take_turns(child);
    }

    /// Runs children until one finishes normally, or returns why none can run.
    async fn follow(&self, feeds: &Feeds, row: &store::Feed, time_base: TimeBase) -> Result<(), Following> {
        for _ in 0..MOST_CRASHES {
            match self.run_child(feeds, row, time_base).await {
                Ok(()) | Err(Failure::Stopped) => return Ok(()),
                Err(Failure::Explained(problem)) if problem.slug == Problem::SIZE_CHANGES => {
                    return Err(Following::Refused(problem.detail));
                }
                Err(Failure::Explained(problem)) => return Err(Following::Not(problem.detail)),
                Err(Failure::Crashed(why)) => tracing::warn!(feed = %row.id, why, "live tracking child crashed"),
            }
            counter!("trocar_feed_followers_died_total").increment(1);
        }
        Err(Following::Not("the process that tracks it crashed several times".to_owned()))
    }

    async fn run_child(&self, feeds: &Feeds, row: &store::Feed, time_base: TimeBase) -> Result<(), Failure> {
        let lost = |error: &dyn std::fmt::Display| Failure::Crashed(format!("hit an error: {error}"));
        let track = analysis::track_in(row.box_id, &feeds.0.store).await.map_err(|why| lost(&why))?;
        let LiveOrders { track, ports } = track.map_err(Failure::Explained)?;
        let tools = track.tools.iter().map(|tool| tool.name.clone()).collect();
        let work = FollowWork { track, codec: row.codec, size: (row.width, row.height), time_base, ports };
        let request = Request { threads: 1, work: Work::Follow(work) };
        let (log, _) = feeds.0.vault.read_feed(row.id).await.map_err(|error| lost(&error))?;
        let (theirs, ours) = pipe().map_err(|error| lost(&error))?;
        let inputs = vec![log, File::from(OwnedFd::from(theirs))];
        let budget = Budget {
            cpu: LONGEST,
            slice: Budget::SHORT_SLICE,
            wall: LONGEST,
            output_bytes: OUTPUT_BYTES,
            ..feeds.0.analysis.budget()
        };
        let stop = PulledWhenGone(Stop::new().map_err(|error| lost(&error))?);
        let (program, stopping, follower) = (feeds.0.program.clone(), stop.0.clone(), self.clone());
        self.begin_child(ours);
        self.0.following.send_replace(Following::Tools(tools));
        let mut child = tokio::task::spawn_blocking(move || {
            let what = Attempt { program: &program, request, inputs, budget: &budget, stop: &stopping };
            attempt(what, |event| {
                if let analysis::News::Followed(followed) = event {
                    follower.heard(followed);
                }
            })
            .0
        });
        let mut beat = interval(BEAT);
        let mut look = interval(turns::LONGEST);
        look.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let ended = loop {
            tokio::select! {
                ended = &mut child => break ended,
                () = feeds.0.shutdown.begun() => { stop.0.pull(); break child.await }
                _ = beat.tick() => self.child().telling.beat(),
                _ = look.tick() => self.0.turns.go_on(),
            }
        };
        self.let_go();
        ended.map_err(|panic| Failure::Crashed(panic.to_string()))?.map(drop)
    }

    /// Connects a new child to this pipe.
    fn begin_child(&self, places: PipeWriter) {
        let mut child = self.child();
        child.begin(places);
        self.0.take_turns(child);
    }

    /// Handles the child's reply to a record.
    fn heard(&self, mut followed: Followed) {
        let mut child = self.child();
        if let Some(arrived) = child.telling.done() {
            // Notify only if the sender can continue: each wake-up takes a processor from a child.
            if child.behind() <= ROOM_BEHIND {
                self.0.room.notify_waiters();
            }
            if !followed.frames.is_empty() {
                histogram!("trocar_feed_followed_seconds").record(arrived.elapsed().as_secs_f64());
            }
        }
        followed.running.take_if(|_| !child.is_whole);
        if let Some(rows) = &followed.running {
            child.last = Some(rows.clone());
        }
        self.0.take_turns(child);
        let _ = self.0.news.send(Arc::new(followed)); // an error only means that there are no watchers
    }

    fn child(&self) -> MutexGuard<'_, Child> {
        self.0.child()
    }
}

impl Parts {
    /// Releases a slot that is no longer needed, and queues for one if records wait.
    fn take_turns(self: &Arc<Self>, mut child: MutexGuard<'_, Child>) {
        let over = child.gives_back();
        let stands = child.stands();
        drop(child); // the next waiter may be this child
        if let Some(turn) = over {
            self.turns.over(turn);
        }
        if stands {
            self.turns.stand(self.clone());
        }
    }

    fn child(&self) -> MutexGuard<'_, Child> {
        self.child.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Stands for Parts {
    /// Sends the waiting records to the child.
    fn begin(&self, turn: Turn) -> bool {
        let is_watched = self.viewers.load(Ordering::Acquire) > 0;
        let mut child = self.child();
        child.place = InLine::Has(turn);
        child.telling.next(MOST_IN_A_TURN, is_watched);
        child.gives_back().is_none()
    }
}

impl Child {
    /// Releases its slot if it no longer needs it, and returns the slot.
    fn gives_back(&mut self) -> Option<Turn> {
        let InLine::Has(turn) = self.place else { return None };
        self.is_nearly_done().then(|| {
            self.place = InLine::Away;
            turn
        })
    }

    /// Marks the child as queued if it needs a slot; returns true if the caller has to enqueue it.
    fn stands(&mut self) -> bool {
        let stands = matches!(self.place, InLine::Away) && self.telling.untold() > 0;
        if stands {
            self.place = InLine::Waits;
        }
        stands
    }

    fn is_running(&self) -> bool {
        self.task.as_ref().is_some_and(|task| !task.is_finished())
    }

    /// Number of records that arrived and are not tracked yet; 0 without a child.
    fn behind(&self) -> usize {
        let unwritten = if self.telling.goes_on() { self.unwritten.len() } else { 0 };
        self.telling.told() + self.telling.untold() + unwritten
    }

    /// True if the next child may start. A child with a backlog is then at its last frame, so that no processor idles
    /// until the reply.
    fn is_nearly_done(&self) -> bool {
        self.telling.told() <= usize::from(self.telling.untold() > 0)
    }

    /// Adds a frame at this position in the log.
    fn take_place(&mut self, place: (u64, u32), is_key: bool) {
        // The first child receives all frames that arrived before it started.
        if (is_key && self.has_begun) || self.recent.len() == MOST_RECENT {
            self.recent.clear();
        }
        self.came += 1;
        if is_key || !self.recent.is_empty() {
            self.recent.push(place);
        }
        self.telling.wait_for_turn(place);
    }

    /// Requests a child for a sender. Returns true if one runs; if that one is being stopped, another will follow it.
    fn is_begun(&mut self) -> bool {
        self.is_wanted = self.is_running() && self.has_begun && !self.telling.goes_on();
        self.is_running()
    }

    /// Starts a child with the frames since the last key frame.
    fn begin(&mut self, places: PipeWriter) {
        self.telling.begin(places);
        (self.has_begun, self.is_wanted) = (true, false);
        self.is_whole &= self.came == self.recent.len();
        if !self.is_whole {
            self.last = None;
        }
        for place in self.recent.clone() {
            self.telling.wait_for_turn(place);
        }
        if self.is_ending {
            self.telling.end();
        }
    }
}

/// Stops a child when its task is dropped.
pub(super) struct PulledWhenGone(pub(super) Stop);

impl Drop for PulledWhenGone {
    fn drop(&mut self) {
        self.0.pull();
    }
}

#[cfg(test)]
mod tests;
