//! Feeds: recordings that arrive frame by frame, are durable as they arrive, and become normal sessions at their end.
//!
//! ```text
//! connection ──hello──▶ FeedService::connect ──▶ Connection: an epoch, and what is durable already
//!     ──record──▶ take_record ──▶ log (vault)   ──▶ sync ──▶ ack
//!                                   └──▶ TrackingSupervisor: a child that tracks ──▶ FeedWatcher
//!     ──end─────▶ end ──▶ child: log → recording ──▶ blob, session, job ──▶ ended
//! ```
//! One connection may send a recording: the last one that sent a hello. It has the highest *epoch*, which the database
//! issues; records with another epoch are refused, no matter where they were delayed. Acknowledged records are in the
//! log and synced. The log is read through whenever it is opened again.
//!
//! A recording that its sender does not end is ended by [`FeedService::maintain`] with the frames that arrived.
//!
//! A stream that is pushed in one request ([`FeedService::push`]) uses such a connection too; its hello and records are
//! made here. It cannot be resumed, so it is ended as soon as its sender is gone.

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

/// The service that receives feeds. Clones share the same state.
#[derive(Clone)]
pub struct Feeds(Arc<Parts>);

/// The parts of [`FeedService`].
pub struct Parts {
    /// Database.
    pub store: Store,
    /// Stored files.
    pub vault: Vault,
    /// Notified of complete sessions.
    pub queue: Queue,
    /// Notified of sessions that start and end.
    pub events: Events,
    /// The clock.
    pub clock: SharedClock,
    /// Shutdown of the service.
    pub shutdown: Shutdown,
    /// Limits of feeds.
    pub settings: LiveSettings,
    /// Limits of the children.
    pub analysis: AnalysisSettings,
    /// The program of the children.
    pub program: Program,
    /// Recordings that are open in this service.
    pub open: OpenFeeds,
    /// Slots for tracking their frames.
    pub turns: Arc<Turns>,
}

/// The recordings that are open in a service and not ended.
#[derive(Default)]
pub struct OpenFeeds {
    all: Mutex<HashMap<FeedId, Arc<Feed>>>,
    /// A lock per recording, held while the recording is opened or removed, so that reading one log does not delay the
    /// others. These locks are taken before `all`.
    doors: std::sync::Mutex<HashMap<FeedId, Weak<Mutex<()>>>>,
}

impl OpenFeeds {
    /// Locks the opening and removal of this recording.
    async fn door(&self, id: FeedId) -> OwnedMutexGuard<()> {
        let lock = {
            let mut locks = self.doors.lock().unwrap_or_else(PoisonError::into_inner);
            locks.retain(|_, lock| lock.strong_count() > 0);
            let lock = locks.get(&id).and_then(Weak::upgrade).unwrap_or_default();
            locks.insert(id, Arc::downgrade(&lock));
            lock
        };
        lock.lock_owned().await
    }
}

/// A recording that is arriving.
struct Feed {
    row: store::Feed,
    time_base: TimeBase,
    /// The epoch that may send now.
    epoch: watch::Sender<u32>,
    connections: AtomicU32,
    /// Last contact with its sender, by [`Clock::passed_ms`](crate::time::Clock::passed_ms).
    heard_ms: AtomicI64,
    state: Mutex<State>,
    /// Failed attempts to assemble it that were not its own fault.
    failures: AtomicU32,
    /// True while it is being assembled.
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
    /// The session, once the recording is complete.
    ended: Option<SessionId>,
}

/// The result of a hello.
pub enum Connected {
    /// Frames may be sent.
    Open(Connection),
    /// The recording has already ended: there is nothing to send.
    Ended(SessionId),
}

impl Feeds {
    /// Creates the service.
    pub fn new(parts: Parts) -> Self {
        Self(Arc::new(parts))
    }

    /// Limits of feeds.
    pub fn settings(&self) -> &LiveSettings {
        &self.0.settings
    }

    /// Starts a recording in a box, or continues it. An earlier connection of the same recording may not send any more.
    ///
    /// # Errors
    /// The reason to close the connection.
    pub async fn connect(&self, scope: &Scope, in_box: &Key, hello: Hello) -> Result<Connected, Farewell> {
        let new = self.recognise(scope, in_box, hello).await?;
        self.open(scope, new).await
    }

    /// The same for a recording that is pushed in one request.
    async fn connect_push(&self, scope: &Scope, in_box: &Key, hello: Hello) -> Result<Connected, Farewell> {
        let new = NewFeed { is_push: true, ..self.recognise(scope, in_box, hello).await? };
        self.open(scope, new).await
    }

    /// Fails if the box is sending a recording now.
    ///
    /// # Errors
    /// The reason to refuse.
    pub async fn check_free(&self, in_box: BoxId) -> Result<(), Farewell> {
        check_free(&*self.0.open.all.lock().await, in_box, None)
    }

    async fn open(&self, scope: &Scope, new: NewFeed) -> Result<Connected, Farewell> {
        let (id, in_box) = (new.id, new.in_box);
        // Held from issuing the epoch to opening, so that of two hellos the one with the higher epoch is opened last.
        let _lock = self.0.open.door(id).await;
        let mut open = self.0.open.all.lock().await;
        check_free(&open, in_box, Some(id))?;
        if open.get(&id).is_some_and(|feed| feed.is_finishing.load(Ordering::Acquire)) {
            return Err(Farewell::new(Code::Busy, "the recording is being assembled: connect again"));
        }
        let of_box = |row: &store::Feed| row.box_id == in_box && row.id != id;
        let unfinished = self.0.store.feeds().unfinished().await.map_err(refused)?;
        if unfinished.into_iter().filter(of_box).count() >= self.0.settings.max_unfinished {
            let why = "the box has too many unfinished recordings: end them, or wait until they end automatically";
            return Err(Farewell::new(Code::Busy, why));
        }
        let row = self.0.store.feeds().open(scope, new).await.map_err(refused)?;
        if row.ended_at_ms.is_some() {
            return Ok(Connected::Ended(row.session_id));
        }
        let epoch = row.epoch;
        let begin = |feed| Ok(Connected::Open(Connection::begin(self.clone(), feed, epoch)));
        // Counted while the lock is held, so that the next connection finds the box busy.
        if let Some(feed) = open.get(&id) {
            return begin(feed.clone());
        }
        let feed = if epoch == 1 {
            // There is no log to read yet, and no other recording must find the box free.
            let (session, trainee) = (row.session_id, row.trainee_id);
            let feed = self.enter_new(row).await?;
            self.tell(session, trainee, SessionStatus::Receiving);
            feed
        } else {
            drop(open);
            let feed = self.enter(row).await?;
            open = self.0.open.all.lock().await;
            check_free(&open, in_box, Some(id))?; // another recording may have started meanwhile
            feed
        };
        open.insert(id, feed.clone());
        begin(feed)
    }

    /// Watches the recording of a session that is arriving; `None` while it has no sender.
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

    /// The same for a new recording: if it cannot be opened, its row and session are deleted again.
    async fn enter_new(&self, row: store::Feed) -> Result<Arc<Feed>, Farewell> {
        let id = row.id;
        let entered = self.enter(row).await;
        if entered.is_err()
            && let Err(error) = self.0.store.feeds().forget(id, true).await
        {
            tracing::warn!(%error, feed = %id, "row of a recording that could not start was not deleted");
        }
        entered
    }

    /// Closes an open recording: the next connection reads its log through.
    async fn close(&self, feed: &Arc<Feed>) {
        let mut open = self.0.open.all.lock().await;
        if open.get(&feed.row.id).is_some_and(|entered| Arc::ptr_eq(entered, feed)) {
            open.remove(&feed.row.id);
        }
    }

    /// Checks a hello and looks up the box, trainee and task in it.
    async fn recognise(&self, scope: &Scope, in_box: &Key, hello: Hello) -> Result<NewFeed, Farewell> {
        let wrong = |why: String| Err(Farewell::new(Code::NotUnderstood, why));
        if hello.protocol != PROTOCOL {
            return wrong(format!("protocol {}; this server uses protocol {PROTOCOL}", hello.protocol));
        }
        let (width, height) = (hello.width, hello.height);
        let most = Limits::default();
        if !(1..=most.width).contains(&width) || !(1..=most.height).contains(&height) {
            return wrong(format!("a picture of {width}×{height} pixels; at most {}×{}", most.width, most.height));
        }
        let Some(began_at_ms) = from_rfc3339(&hello.began_at) else {
            return wrong("began_at: expected an RFC 3339 time such as 2026-11-21T20:14:00Z".to_owned());
        };
        let owner_scope = &scope.of_whom_it_sends();
        let store = &self.0.store;
        let unknown = |what: &'static str| move |error| unknown(what, error);
        let in_box = store.boxes().get(scope, in_box).await.map_err(unknown("box"))?.id;
        let trainee =
            store.trainees().get(owner_scope, &Key::from(&hello.trainee)).await.map_err(unknown("trainee"))?.id;
        let task = store.tasks().get(owner_scope, &Key::from(&hello.task)).await.map_err(unknown("task"))?.id;
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

    /// Length of the longest recording, ticks: no frame has a later time.
    fn most_ticks(&self) -> i64 {
        let (num, den) = self.time_base.fraction();
        (LONGEST_S * f64::from(den) / f64::from(num)) as i64
    }
}

/// Why an operation on a feed failed without a fault of its sender.
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
        VaultError::DiskFull => "the server's disk is full: free space, then it works again".to_owned(),
        other => other.to_string(),
    };
    Farewell::new(Code::Failed, why)
}

/// Fails if the box is sending another recording than `mine`.
fn check_free(open: &HashMap<FeedId, Arc<Feed>>, in_box: BoxId, mine: Option<FeedId>) -> Result<(), Farewell> {
    let is_other = |feed: &&Arc<Feed>| Some(feed.row.id) != mine && feed.is_sent() && feed.row.box_id == in_box;
    let Some(other) = open.values().find(is_other) else { return Ok(()) };
    let why = format!("the box is sending another recording ({}): end that one, or stop its sender", other.row.id);
    Err(Farewell::new(Code::Busy, why))
}

/// True if a recording can end with this number of frames.
fn is_end(frames: u64) -> bool {
    frames <= MOST_FRAMES
}
