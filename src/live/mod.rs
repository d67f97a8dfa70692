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
//! A recording that nobody ends is ended by [`Feeds::keep`], and what never came is noted as a gap.

mod connection;
mod following;
mod recording;
mod settings;

pub use connection::Connection;
pub use following::{Following, Watch};
pub use settings::LiveSettings;

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU32, Ordering};
use std::time::Duration;

use tokio::sync::{Mutex, watch};

use following::Follower;

use crate::analysis::AnalysisSettings;
use crate::domain::feed::farewell::{Code, Farewell};
use crate::domain::feed::numbers::Numbers;
use crate::domain::feed::words::Hello;
use crate::domain::feed::{MOST_FRAMES, PROTOCOL, TimeBase};
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::session::SessionStatus;
use crate::domain::text::Key;
use crate::events::{Event, Events};
use crate::ids::{FeedId, SessionId, TraineeId};
use crate::media::Limits;
use crate::queue::Queue;
use crate::sandbox::Program;
use crate::shutdown::Shutdown;
use crate::store::{self, NewFeed, Store, StoreError};
use crate::time::{SharedClock, from_rfc3339, millis};
use crate::vault::{FeedLog, Vault, VaultError};

/// How often abandoned recordings are looked for.
const LOOK_EVERY: Duration = Duration::from_secs(20);

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
}

/// Recordings that are known to a service and not ended.
#[derive(Default)]
pub struct OpenFeeds(Mutex<HashMap<FeedId, Arc<Feed>>>);

/// A recording that arrives.
struct Feed {
    row: store::Feed,
    time_base: TimeBase,
    /// The epoch that may send.
    epoch: watch::Sender<u32>,
    connections: AtomicU32,
    /// When anything was last heard of it, epoch ms.
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
    /// Has anything been appended since the last sync?
    is_unsynced: bool,
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
        let id = new.id;
        // Held from the epoch to the entry, so that of two hellos the one with the higher epoch is entered last.
        let mut open = self.0.open.0.lock().await;
        let sends = |feed: &&Arc<Feed>| feed.is_sent() && feed.row.box_id == new.in_box;
        if let Some(other) = open.values().find(|feed| feed.row.id != id && sends(feed)) {
            return Err(Farewell::new(
                Code::Busy,
                format!("the box is sending another recording ({}): end that one, or stop its sender", other.row.id),
            ));
        }
        if open.get(&id).is_some_and(|feed| feed.is_finishing.load(Ordering::Acquire)) {
            return Err(Farewell::new(Code::Busy, "the recording is being put together: come again"));
        }
        let of_box = |row: &store::Feed| row.box_id == new.in_box && row.id != id;
        let unfinished = self.0.store.feeds().unfinished().await.map_err(refused)?;
        if unfinished.into_iter().filter(of_box).count() >= self.0.settings.max_unfinished {
            let why = "the box has too many unfinished recordings: end them, or wait until they end by themselves";
            return Err(Farewell::new(Code::Busy, why));
        }
        let row = self.0.store.feeds().open(scope, new).await.map_err(refused)?;
        if row.ended_at_ms.is_some() {
            return Ok(Connected::Ended(row.session_id));
        }
        if row.epoch == 1 {
            self.tell(row.session_id, row.trainee_id, SessionStatus::Receiving);
        }
        let epoch = row.epoch;
        let feed = match open.get(&id) {
            Some(feed) => feed.clone(),
            None => {
                let feed = self.enter(row).await?;
                open.insert(id, feed.clone());
                feed
            }
        };
        // Counted while nobody else can enter, so that the box is busy for whoever comes next.
        Ok(Connected::Open(Connection::begin(self.clone(), feed, epoch)))
    }

    /// Watches the recording of a session that arrives; `None` while nobody sends it.
    pub async fn watch(&self, session: SessionId, wants_pictures: bool) -> Option<Watch> {
        let open = self.0.open.0.lock().await;
        let arrives = |feed: &&Arc<Feed>| feed.row.session_id == session && feed.is_sent();
        open.values().find(arrives).map(|feed| feed.follower.watch(feed, wants_pictures))
    }

    /// Ends what was abandoned and clears up, again and again until the service ends.
    pub async fn keep(&self) {
        let mut unheard = HashMap::new();
        while !self.0.shutdown.is_begun() {
            if let Err(error) = self.look_after(&mut unheard).await {
                tracing::warn!(%error, "looking after feeds");
            }
            tokio::select! {
                () = self.0.shutdown.begun() => {}
                () = self.0.clock.sleep(LOOK_EVERY) => {}
            }
        }
    }

    /// Removes the logs of what was erased, and ends what was abandoned. `unheard` remembers since when a recording that no
    /// connection has named in this life of the service has been waiting, epoch ms.
    async fn look_after(&self, unheard: &mut HashMap<FeedId, i64>) -> Result<(), LiveError> {
        self.remove_erased().await?;
        let unfinished = self.0.store.feeds().unfinished().await?;
        let now_ms = self.0.clock.now_ms();
        let since_ms = now_ms - millis(self.0.settings.abandoned());
        unheard.retain(|id, _| unfinished.iter().any(|row| row.id == *id));
        for row in unfinished {
            if self.0.shutdown.is_begun() {
                break;
            }
            let id = row.id;
            let known = self.0.open.0.lock().await.get(&id).cloned();
            let feed = match known {
                Some(feed) => feed,
                None if *unheard.entry(id).or_insert(now_ms) >= since_ms => continue,
                None => self.enter_unheard(row, since_ms).await?,
            };
            if feed.is_abandoned(since_ms)
                && let Err(error) = self.end_abandoned(&feed, since_ms).await
            {
                tracing::warn!(%error, feed = %id, "ending an abandoned recording");
            }
        }
        Ok(())
    }

    /// Opens the log of a recording that was not heard of since some time before then, epoch ms.
    async fn enter_unheard(&self, row: store::Feed, since_ms: i64) -> Result<Arc<Feed>, LiveError> {
        let mut open = self.0.open.0.lock().await;
        if let Some(feed) = open.get(&row.id) {
            return Ok(feed.clone()); // a connection came meanwhile
        }
        let id = row.id;
        let feed = self.enter(row).await?;
        feed.heard_ms.store(since_ms - 1, Ordering::Release);
        open.insert(id, feed.clone());
        Ok(feed)
    }

    async fn remove_erased(&self) -> Result<(), LiveError> {
        for id in self.0.vault.feed_logs().await? {
            // Asked again while nobody can enter it: a row may have come since.
            let mut open = self.0.open.0.lock().await;
            let is_needed = match self.0.store.feeds().get(&Scope::service(), id).await {
                Ok(row) => row.ended_at_ms.is_none(),
                Err(StoreError::NotFound { .. }) => false,
                Err(error) => return Err(error.into()),
            };
            if !is_needed {
                if let Some(erased) = open.remove(&id) {
                    erased.is_gone.store(true, Ordering::Release);
                    erased.epoch.send_replace(u32::MAX); // whoever still sends it is told
                }
                self.0.vault.delete_feed(id).await?;
            }
        }
        Ok(())
    }

    /// Opens a recording's log.
    async fn enter(&self, row: store::Feed) -> Result<Arc<Feed>, Farewell> {
        let time_base = row.time_base().map_err(|error| Farewell::new(Code::Failed, error.to_string()))?;
        let (log, numbers) = self.0.vault.open_feed(row.id).await.map_err(failed)?;
        Ok(Arc::new(Feed {
            epoch: watch::Sender::new(row.epoch),
            time_base,
            connections: AtomicU32::new(0),
            heard_ms: AtomicI64::new(self.0.clock.now_ms()),
            state: Mutex::new(State { log, numbers, is_unsynced: false, ended: None }),
            failures: AtomicU32::new(0),
            is_finishing: AtomicBool::new(false),
            is_gone: AtomicBool::new(false),
            follower: Follower::new(),
            row,
        }))
    }

    /// Forgets that a recording is open: whoever names it next reads its log through.
    async fn close(&self, feed: &Arc<Feed>) {
        let mut open = self.0.open.0.lock().await;
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
        // A box's agent sends whoever sits in front of it; people send only whom they see.
        let whom = if scope.role() == Role::Agent { &Scope::service() } else { scope };
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
        const LONGEST_S: f64 = 4.0 * 3600.0;
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

/// Is this a number that a recording can end with?
fn is_end(frames: u64) -> bool {
    frames <= MOST_FRAMES
}
