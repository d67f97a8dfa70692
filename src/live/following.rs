//! Following: while a recording arrives, a child tracks it, and whoever watches is told at once.
//!
//! ```text
//! record ─▶ log ─▶ its place ─turn─▶ child: decode, track ─▶ news ─▶ watchers
//! ```
//! Frames wait in the log for their [turn](super::turns), so a slow child costs no memory. What is too fast for it is
//! slowed: a connection reads no further while [`Follower::has_room`] says no. A child that dies costs the recording nothing:
//! another goes on from the next frame, three times in all. A slow watcher loses old news, never the feed.

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

/// Records that a child may be behind; then the feed is slowed. Half a second of a camera: the rehearsal at a recording's
/// beginning needs it, nothing else should.
const MOST_BEHIND: usize = 16;

/// A feed that was slowed goes on once its child is only so many behind: several records are read and written at once.
const ROOM_BEHIND: usize = MOST_BEHIND / 2;

/// Records of which a child is told in one turn: where boxes are behind, they catch up with fewer changes between them.
const MOST_IN_A_TURN: usize = 8;

/// Frames between two key frames of which a child can still begin with the first.
const MOST_RECENT: usize = 1024;

/// News that a watcher may be behind before it loses the oldest.
const NEWS_KEPT: usize = 64;

/// Children that may die of one recording.
const MOST_CRASHES: u32 = 3;

/// A child that hears nothing for so long is asked whether it lives.
const BEAT: Duration = Duration::from_secs(10);

/// How long a child may take for what it is behind when the recording ends.
const LAST_WORDS: Duration = Duration::from_secs(10);

/// How long a child may live and compute: a recording of four hours, and as much again while its sender was away.
const LONGEST: Duration = Duration::from_secs(8 * 3600);

/// What a child may say of four hours: positions, and a picture for every one that is asked for.
const OUTPUT_BYTES: u64 = 64 << 30;

/// Is a recording being tracked while it arrives?
#[derive(Clone, Debug, PartialEq)]
pub enum Following {
    /// Its first frame has not come.
    NotYet,
    /// Yes, with these tools.
    Tools(Vec<String>),
    /// No, for this reason; it is tracked once it is whole.
    Not(String),
    /// No, and no frame of its sender is of use any more, for this reason.
    Refused(String),
}

/// Follows one recording. Clones are the same.
#[derive(Clone)]
pub(super) struct Follower(Arc<Parts>);

struct Parts {
    news: broadcast::Sender<Arc<Followed>>,
    following: watch::Sender<Following>,
    /// Watchers that want pictures.
    viewers: Arc<AtomicUsize>,
    /// The line in which its child stands with those of others.
    turns: Arc<Turns>,
    /// Another record may come.
    room: Notify,
    child: Mutex<Child>,
}

/// The child and what it was told of.
#[derive(Default)]
struct Child {
    telling: Telling,
    place: InLine,
    /// Frames that came and that nobody can read in the log yet: where they lie, and whether a child can begin with them.
    unwritten: VecDeque<((u64, u32), bool)>,
    /// Where the frames since the last key frame lie, bytes: what a child needs to begin with.
    recent: Vec<(u64, u32)>,
    /// Records that came in this life of the service, and whether the child was told of all there ever were: else its
    /// features are not the recording's.
    came: usize,
    is_whole: bool,
    has_begun: bool,
    /// The features that it told last.
    last: Option<Vec<RunningRow>>,
    /// What the recording was ended with, after how many records: told again if it has to be ended again.
    ended_with: Option<(usize, Vec<LiveFeature>)>,
    /// The recording is being ended: a child that begins now ends with what it is told first.
    is_ending: bool,
    /// A sender came while the child was being let go: it gets another behind it.
    is_wanted: bool,
    task: Option<JoinHandle<()>>,
}

/// Where a child is in the line.
#[derive(Default)]
enum InLine {
    /// Not in it: nothing waits for a turn.
    #[default]
    Away,
    /// Some way behind its head.
    Waits,
    /// It has this turn.
    Has(Turn),
}

impl Follower {
    /// Of a recording of which nothing has come yet, or some.
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

    /// Begins to follow, unless somebody does already. What keeps it from following is asked anew at each connection.
    pub(super) fn begin(&self, feeds: &Feeds, feed: &Feed) {
        let mut child = self.child();
        if child.is_begun() {
            return;
        }
        if matches!(*self.0.following.borrow(), Following::Refused(_)) {
            child.recent.clear(); // what was refused is among it
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

    /// Shall there be another child? If not, the next sender begins anew, be it at this moment.
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

    /// A frame came that has, or will have, this place in the log.
    pub(super) fn came(&self, offset: u64, bytes: usize, is_key: bool) {
        self.child().unwritten.push_back(((offset, bytes as u32), is_key)); // checked: at most a record's
    }

    /// So many bytes of the log can be read: the frames in them wait for the child's turn.
    pub(super) fn wrote(&self, bytes: u64) {
        let mut child = self.child();
        while let Some((place, is_key)) =
            child.unwritten.pop_front_if(|((offset, length), _)| *offset + u64::from(*length) <= bytes)
        {
            child.take_place(place, is_key);
        }
        self.0.take_turns(child);
    }

    /// Is there a child, or will there be one soon, that waits for frames to be written?
    pub(super) fn waits_for_log(&self) -> bool {
        let child = self.child();
        !child.unwritten.is_empty() && (child.is_running() || child.telling.goes_on())
    }

    /// May another record come?
    pub(super) fn has_room(&self) -> bool {
        self.child().behind() < MOST_BEHIND
    }

    /// Waits until several records may come.
    pub(super) async fn room(&self) {
        loop {
            let changed = self.0.room.notified();
            if self.child().behind() <= ROOM_BEHIND {
                return;
            }
            changed.await;
        }
    }

    /// No more records come: hears what the child is behind, and the features at its end.
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
            tracing::warn!("a child that follows a feed did not come to its end");
            task.abort(); // its stop is pulled as it goes
            let _ = task.await;
        }
        let mut child = self.child();
        if let (Some(rows), Following::Tools(tools)) = (child.last.take(), &*self.0.following.borrow()) {
            child.ended_with = Some((child.came, live_features(&rows, tools)));
        }
        let came = child.came;
        child.ended_with.as_ref().filter(|ended| ended.0 == came).map(|(_, features)| features.clone())
    }

    /// Resolves once no frame is of use any more, with the reason.
    pub(super) async fn refused(&self) -> String {
        let mut following = self.0.following.subscribe();
        loop {
            if let Following::Refused(why) = &*following.borrow_and_update() {
                return why.clone();
            }
            if following.changed().await.is_err() {
                std::future::pending().await // its sender lives as long as this
            }
        }
    }

    /// A watcher's end. Without one that wants pictures none are made.
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

    /// Ends the child of a recording that nobody sends, so that its memory is others'; whoever comes again gets another.
    pub(super) fn let_go_if(&self, is_idle: impl FnOnce() -> bool) {
        let child = self.child(); // whoever comes meanwhile waits to begin
        if is_idle() {
            self.let_go_of(child);
        }
    }

    /// Ends the child once it has heard what it was told.
    pub(super) fn let_go(&self) {
        self.let_go_of(self.child());
    }

    fn let_go_of(&self, mut child: MutexGuard<'_, Child>) {
        child.telling.end();
        child.telling.forget();
        self.0.room.notify_waiters();
        self.0.take_turns(child);
    }

    /// Runs children until one comes to its end, or tells why there is none.
    async fn follow(&self, feeds: &Feeds, row: &store::Feed, time_base: TimeBase) -> Result<(), Following> {
        for _ in 0..MOST_CRASHES {
            match self.run_child(feeds, row, time_base).await {
                Ok(()) | Err(Failure::Stopped) => return Ok(()),
                Err(Failure::Explained(problem)) if problem.slug == Problem::SIZE_CHANGES => {
                    return Err(Following::Refused(problem.detail));
                }
                Err(Failure::Explained(problem)) => return Err(Following::Not(problem.detail)),
                Err(Failure::Crashed(why)) => tracing::warn!(feed = %row.id, why, "a child that follows a feed died"),
            }
            counter!("trocar_feed_followers_died_total").increment(1);
        }
        Err(Following::Not("the process that tracked it died again and again".to_owned()))
    }

    async fn run_child(&self, feeds: &Feeds, row: &store::Feed, time_base: TimeBase) -> Result<(), Failure> {
        let lost = |error: &dyn std::fmt::Display| Failure::Crashed(format!("met {error}"));
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
            attempt(what, |news| {
                if let analysis::News::Followed(followed) = news {
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

    /// A child that is told through this pipe begins.
    fn begin_child(&self, places: PipeWriter) {
        let mut child = self.child();
        child.begin(places);
        self.0.take_turns(child);
    }

    /// The child is done with a record, and this is what it showed.
    fn heard(&self, mut followed: Followed) {
        let mut child = self.child();
        if let Some(came) = child.telling.done() {
            // Only when somebody has something to do: each awakening takes a processor from a child.
            if child.behind() <= ROOM_BEHIND {
                self.0.room.notify_waiters();
            }
            if !followed.frames.is_empty() {
                histogram!("trocar_feed_followed_seconds").record(came.elapsed().as_secs_f64());
            }
        }
        followed.running.take_if(|_| !child.is_whole);
        if let Some(rows) = &followed.running {
            child.last = Some(rows.clone());
        }
        self.0.take_turns(child);
        let _ = self.0.news.send(Arc::new(followed)); // an error means only that nobody watches
    }

    fn child(&self) -> MutexGuard<'_, Child> {
        self.0.child()
    }
}

impl Parts {
    /// Gives back a turn that is over, and stands in line with what waits.
    fn take_turns(self: &Arc<Self>, mut child: MutexGuard<'_, Child>) {
        let over = child.gives_back();
        let stands = child.stands();
        drop(child); // whoever is next may be this child
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
    /// Tells the child of what waits.
    fn begin(&self, turn: Turn) -> bool {
        let is_watched = self.viewers.load(Ordering::Acquire) > 0;
        let mut child = self.child();
        child.place = InLine::Has(turn);
        child.telling.next(MOST_IN_A_TURN, is_watched);
        child.gives_back().is_none()
    }
}

impl Child {
    /// The turn that it has, if it is over.
    fn gives_back(&mut self) -> Option<Turn> {
        let InLine::Has(turn) = self.place else { return None };
        self.is_nearly_done().then(|| {
            self.place = InLine::Away;
            turn
        })
    }

    /// Shall it be put in line?
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

    /// Records that came and that the child is not done with, as far as there is one.
    fn behind(&self) -> usize {
        let unwritten = if self.telling.goes_on() { self.unwritten.len() } else { 0 };
        self.telling.told() + self.telling.untold() + unwritten
    }

    /// May the next child be told? One that is behind is at its last frame then, so that no processor waits for the news.
    fn is_nearly_done(&self) -> bool {
        self.telling.told() <= usize::from(self.telling.untold() > 0)
    }

    /// A frame lies at this place in the log.
    fn take_place(&mut self, place: (u64, u32), is_key: bool) {
        // The first child is told of all that came before it had begun.
        if (is_key && self.has_begun) || self.recent.len() == MOST_RECENT {
            self.recent.clear();
        }
        self.came += 1;
        if is_key || !self.recent.is_empty() {
            self.recent.push(place);
        }
        self.telling.wait_for_turn(place);
    }

    /// Need no other be begun for a sender? One that is being let go is followed by another.
    fn is_begun(&mut self) -> bool {
        self.is_wanted = self.is_running() && self.has_begun && !self.telling.goes_on();
        self.is_running()
    }

    /// Begins with what came since the last key frame.
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

/// Ends a child whose task is dropped.
pub(super) struct PulledWhenGone(pub(super) Stop);

impl Drop for PulledWhenGone {
    fn drop(&mut self) {
        self.0.pull();
    }
}

#[cfg(test)]
mod tests;
