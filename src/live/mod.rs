//! Feeds: recordings that arrive frame by frame, durable as they come, and sessions like any other at their end.
//!
//! ```text
//! connection ──hello──▶ Feeds::connect ──▶ Connection: an epoch, what is durable already
//!     ──record──▶ take ──▶ log (vault)          ──▶ sync ──▶ ack
//!                              └──▶ Follower: a child that tracks ──▶ Watch
//!     ──end─────▶ end ──▶ child: log → recording ──▶ blob, session, job ──▶ ended
//! ```
//! A recording has one connection that may send: the last that said hello. It bears the highest *epoch*, which the
//! database gives out; what bears another is refused, wherever it was held up. What is acknowledged is in the log and
//! synced; the log is read through when it is opened again.
//!
//! A recording that nobody ends is ended by [`Feeds::keep`] with what came.
//!
//! A stream that is pushed in one request ([`Feeds::push`]) is such a connection too, whose hello and records are made here.
//! Nobody can go on with it, so that it is ended as soon as nobody sends it.

mod connection;
mod following;
mod keeping;
mod push;
mod recording;
mod settings;
mod turns;

pub use connection::Connection;
pub use following::{Following, Watch};
pub use push::{Broken, Push, PushError};
pub use settings::LiveSettings;
pub use turns::Turns;

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU32, Ordering};
use std::sync::{Arc, PoisonError, Weak};

use tokio::sync::{Mutex, OwnedMutexGuard, watch};

use following::Follower;

use crate::analysis::AnalysisSettings;
use crate::domain::feed::farewell::{Code, Farewell};
use crate::domain::feed::numbers::Numbers;
use crate::domain::feed::words::Hello;
use crate::domain::feed::{LONGEST_S, MOST_FRAMES, PROTOCOL, TimeBase};
use crate::domain::scope::Scope;
use crate::domain::session::SessionStatus;
use crate::domain::text::Key;
use crate::events::{Event, Events};
use crate::ids::{BoxId, FeedId, SessionId, TraineeId};
use crate::media::Limits;
use crate::queue::Queue;
use crate::sandbox::Program;
use crate::shutdown::Shutdown;
use crate::store::{self, NewFeed, Store, StoreError};
use crate::time::{SharedClock, from_rfc3339};
use crate::vault::{FeedLog, Vault, VaultError};

/// Longest name of a sender's program, characters.
const SENDER: usize = 120;

/// Where feeds arrive. Clones are the same place.
#[derive(Clone)]
pub struct Feeds(Arc<Parts>);

/// What [`Feeds`] works with.
pub struct Parts {
    /// Rows.
    pub store: Store,
    /// Files.
    pub vault: Vault,
    /// Told of sessions that are whole.
    pub queue: Queue,
    /// Told of sessions that begin and end.
    pub events: Events,
    /// What time it is.
    pub clock: SharedClock,
    /// The end of the service.
    pub shutdown: Shutdown,
    /// Limits of feeds.
    pub settings: LiveSettings,
    /// Limits of the child that puts a recording together.
    pub analysis: AnalysisSettings,
    /// That child.
    pub program: Program,
    /// Recordings that are known to this service and not ended.
    pub open: OpenFeeds,
    /// In which order their frames are looked at.
    pub turns: Arc<Turns>,
}

/// Recordings that are known to a service and not ended.
#[derive(Default)]
pub struct OpenFeeds {
    all: Mutex<HashMap<FeedId, Arc<Feed>>>,
    /// Whoever enters or removes a recording holds its door meanwhile, so that reading one's log through holds up no other.
    /// Doors are taken before `all`.
    doors: std::sync::Mutex<HashMap<FeedId, Weak<Mutex<()>>>>,
}

impl OpenFeeds {
    /// Waits until nobody else enters or removes this recording.
    async fn door(&self, id: FeedId) -> OwnedMutexGuard<()> {
        let door = {
            let mut doors = self.doors.lock().unwrap_or_else(PoisonError::into_inner);
            doors.retain(|_, door| door.strong_count() > 0);
            let door = doors.get(&id).and_then(Weak::upgrade).unwrap_or_default();
            doors.insert(id, Arc::downgrade(&door));
            door
        };
        door.lock_owned().await
    }
}

/// A recording that arrives.
struct Feed {
    row: store::Feed,
    time_base: TimeBase,
    /// The epoch that may send.
    epoch: watch::Sender<u32>,
    connections: AtomicU32,
    /// When anything was last heard of it, by [`Clock::passed_ms`](crate::time::Clock::passed_ms).
    heard_ms: AtomicI64,
    state: Mutex<State>,
    /// Attempts to put it together that failed by no fault of its own.
    failures: AtomicU32,
    /// Is it being put together at this moment?
    is_finishing: AtomicBool,
    is_gone: AtomicBool,
    follower: Follower,
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.follower.let_go();
    }
}

struct State {
    log: FeedLog,
    /// Frames and gaps in the log.
    numbers: Numbers,
    /// Bytes of the log that are known to be durable.
    synced: u64,
    /// The session, once the recording is whole.
    ended: Option<SessionId>,
}

/// What a hello leads to.
pub enum Connected {
    /// Frames may come.
    Open(Connection),
    /// The recording has ended before: there is nothing to send.
    Ended(SessionId),
}

impl Feeds {
    /// Makes the place.
    pub fn new(parts: Parts) -> Self {
        Self(Arc::new(parts))
    }

    /// Limits of feeds.
    pub fn settings(&self) -> &LiveSettings {
        &self.0.settings
    }

    /// Begins a recording in a box, or goes on with it. An earlier connection of the same recording may not send any more.
    ///
    /// # Errors
    /// A reason that the sender is told.
    pub async fn connect(&self, scope: &Scope, in_box: &Key, hello: Hello) -> Result<Connected, Farewell> {
        let new = self.recognise(scope, in_box, hello).await?;
        self.open(scope, new).await
    }

    /// The same for a recording that is pushed in one request.
    async fn connect_push(&self, scope: &Scope, in_box: &Key, hello: Hello) -> Result<Connected, Farewell> {
        let new = NewFeed { is_push: true, ..self.recognise(scope, in_box, hello).await? };
        self.open(scope, new).await
    }

    /// Refuses a box that sends a recording at this moment.
    ///
    /// # Errors
    /// A reason that the sender is told.
    pub async fn check_free(&self, in_box: BoxId) -> Result<(), Farewell> {
        check_free(&*self.0.open.all.lock().await, in_box, None)
    }

    async fn open(&self, scope: &Scope, new: NewFeed) -> Result<Connected, Farewell> {
        let (id, in_box) = (new.id, new.in_box);
        // Held from the epoch to the entry, so that of two hellos the one with the higher epoch is entered last.
        let _door = self.0.open.door(id).await;
        let mut open = self.0.open.all.lock().await;
        check_free(&open, in_box, Some(id))?;
        if open.get(&id).is_some_and(|feed| feed.is_finishing.load(Ordering::Acquire)) {
            return Err(Farewell::new(Code::Busy, "the recording is being put together: come again"));
        }
        let of_box = |row: &store::Feed| row.box_id == in_box && row.id != id;
        let unfinished = self.0.store.feeds().unfinished().await.map_err(refused)?;
        if unfinished.into_iter().filter(of_box).count() >= self.0.settings.max_unfinished {
            let why = "the box has too many unfinished recordings: end them, or wait until they end by themselves";
            return Err(Farewell::new(Code::Busy, why));
        }
        let row = self.0.store.feeds().open(scope, new).await.map_err(refused)?;
        if row.ended_at_ms.is_some() {
            return Ok(Connected::Ended(row.session_id));
        }
        let epoch = row.epoch;
        let begin = |feed| Ok(Connected::Open(Connection::begin(self.clone(), feed, epoch)));
        // Counted while nobody else can enter, so that the box is busy for whoever comes next.
        if let Some(feed) = open.get(&id) {
            return begin(feed.clone());
        }
        let feed = if epoch == 1 {
            // There is no log to be read yet, and nobody else shall find the box free.
            let (session, trainee) = (row.session_id, row.trainee_id);
            let feed = self.enter_new(row).await?;
            self.tell(session, trainee, SessionStatus::Receiving);
            feed
        } else {
            drop(open);
            let feed = self.enter(row).await?;
            open = self.0.open.all.lock().await;
            check_free(&open, in_box, Some(id))?; // another may have come meanwhile
            feed
        };
        open.insert(id, feed.clone());
        begin(feed)
    }

    /// Watches the recording of a session that arrives; `None` while nobody sends it.
    pub async fn watch(&self, session: SessionId, wants_pictures: bool) -> Option<Watch> {
        let open = self.0.open.all.lock().await;
        let arrives = |feed: &&Arc<Feed>| feed.row.session_id == session && feed.is_sent();
        open.values().find(arrives).map(|feed| feed.follower.watch(feed, wants_pictures))
    }

    /// Opens a recording's log.
    async fn enter(&self, row: store::Feed) -> Result<Arc<Feed>, Farewell> {
        let time_base = row.time_base().map_err(|error| Farewell::new(Code::Failed, error.to_string()))?;
        let (log, numbers) = self.0.vault.open_feed(row.id).await.map_err(failed)?;
        let follower = Follower::new(numbers.ranges().is_empty(), self.0.turns.clone());
        Ok(Arc::new(Feed {
            epoch: watch::Sender::new(row.epoch),
            time_base,
            connections: AtomicU32::new(0),
            heard_ms: AtomicI64::new(self.0.clock.passed_ms()),
            state: Mutex::new(State { synced: log.bytes(), log, numbers, ended: None }),
            failures: AtomicU32::new(0),
            is_finishing: AtomicBool::new(false),
            is_gone: AtomicBool::new(false),
            follower,
            row,
        }))
    }

    /// The same for one that begins: where it has no place, its row and session go, as if it had never been heard of.
    async fn enter_new(&self, row: store::Feed) -> Result<Arc<Feed>, Farewell> {
        let id = row.id;
        let entered = self.enter(row).await;
        if entered.is_err()
            && let Err(error) = self.0.store.feeds().forget(id, true).await
        {
            tracing::warn!(%error, feed = %id, "forgetting a recording that could not begin");
        }
        entered
    }

    /// Forgets that a recording is open: whoever names it next reads its log through.
    async fn close(&self, feed: &Arc<Feed>) {
        let mut open = self.0.open.all.lock().await;
        if open.get(&feed.row.id).is_some_and(|entered| Arc::ptr_eq(entered, feed)) {
            open.remove(&feed.row.id);
        }
    }

    /// Finds what a hello names.
    async fn recognise(&self, scope: &Scope, in_box: &Key, hello: Hello) -> Result<NewFeed, Farewell> {
        let wrong = |why: String| Err(Farewell::new(Code::NotUnderstood, why));
        if hello.protocol != PROTOCOL {
            return wrong(format!("protocol {}; this server speaks {PROTOCOL}", hello.protocol));
        }
        let (width, height) = (hello.width, hello.height);
        let most = Limits::default();
        if !(1..=most.width).contains(&width) || !(1..=most.height).contains(&height) {
            return wrong(format!("a picture of {width}×{height} pixels; at most {}×{}", most.width, most.height));
        }
        let Some(began_at_ms) = from_rfc3339(&hello.began_at) else {
            return wrong("began_at: expected an RFC 3339 time such as 2026-11-21T20:14:00Z".to_owned());
        };
        let whom = &scope.of_whom_it_sends();
        let store = &self.0.store;
        let unknown = |what: &'static str| move |error| unknown(what, error);
        let in_box = store.boxes().get(scope, in_box).await.map_err(unknown("box"))?.id;
        let trainee = store.trainees().get(whom, &Key::from(&hello.trainee)).await.map_err(unknown("trainee"))?.id;
        let task = store.tasks().get(whom, &Key::from(&hello.task)).await.map_err(unknown("task"))?.id;
        Ok(NewFeed {
            id: hello.recording,
            trainee,
            task,
            in_box,
            codec: hello.codec,
            size: (width, height),
            time_base: hello.time_base,
            began_at_ms,
            sender: hello.sender.chars().filter(|c| !c.is_control()).take(SENDER).collect(),
            is_push: false,
        })
    }

    fn tell(&self, id: SessionId, trainee: TraineeId, status: SessionStatus) {
        self.0.events.tell(Event::Session { id, trainee, status, progress: 0.0 });
    }
}

impl Feed {
    fn is_sent(&self) -> bool {
        self.connections.load(Ordering::Acquire) > 0
    }

    fn is_abandoned(&self, long_ago_ms: i64) -> bool {
        !self.is_sent() && self.heard_ms.load(Ordering::Acquire) < long_ago_ms
    }

    /// Ticks of the longest recording: no frame has a later time.
    fn most_ticks(&self) -> i64 {
        let (num, den) = self.time_base.fraction();
        (LONGEST_S * f64::from(den) / f64::from(num)) as i64
    }
}

/// Why something could not be done with a feed, by no fault of its sender.
#[derive(Debug, thiserror::Error)]
enum LiveError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Vault(#[from] VaultError),
    #[error("{}", .0.why)]
    Told(Farewell),
}

impl From<Farewell> for LiveError {
    fn from(farewell: Farewell) -> Self {
        LiveError::Told(farewell)
    }
}

impl From<LiveError> for Farewell {
    fn from(error: LiveError) -> Self {
        match error {
            LiveError::Store(error) => refused(error),
            LiveError::Vault(error) => failed(error),
            LiveError::Told(farewell) => farewell,
        }
    }
}

fn refused(error: StoreError) -> Farewell {
    let code = match &error {
        StoreError::NotFound { .. } | StoreError::Refused { .. } | StoreError::Forbidden { .. } => Code::Unknown,
        _ => Code::Failed,
    };
    Farewell::new(code, error.to_string())
}

fn unknown(what: &'static str, error: StoreError) -> Farewell {
    match error {
        StoreError::NotFound { .. } => Farewell::new(Code::Unknown, format!("there is no such {what}")),
        other => refused(other),
    }
}

fn failed(error: VaultError) -> Farewell {
    let why = match &error {
        VaultError::DiskFull => "the server's disk is full: it works again once there is space".to_owned(),
        other => other.to_string(),
    };
    Farewell::new(Code::Failed, why)
}

/// Refuses a box that sends another recording than this one.
fn check_free(open: &HashMap<FeedId, Arc<Feed>>, in_box: BoxId, mine: Option<FeedId>) -> Result<(), Farewell> {
    let is_other = |feed: &&Arc<Feed>| Some(feed.row.id) != mine && feed.is_sent() && feed.row.box_id == in_box;
    let Some(other) = open.values().find(is_other) else { return Ok(()) };
    let why = format!("the box is sending another recording ({}): end that one, or stop its sender", other.row.id);
    Err(Farewell::new(Code::Busy, why))
}

/// Is this a number that a recording can end with?
fn is_end(frames: u64) -> bool {
    frames <= MOST_FRAMES
}
