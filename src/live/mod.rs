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
//! A recording that its sender does not end is ended by [`FeedService::maintain`] with the frames that arrived, or earlier
//! at a person's request ([`FeedService::end_interrupted`]).
//!
//! A stream that is pushed in one request ([`FeedService::push`]) uses such a connection too; its hello and records are
//! made here. It cannot be resumed, so it is ended as soon as its sender is gone.

mod connection;
mod cpu_slots;
mod maintenance;
mod open_feed;
mod push;
mod recording;
mod settings;
mod tracking;

pub use connection::Connection;
pub use cpu_slots::CpuSlots;
pub use open_feed::OpenFeeds;
pub use push::{Push, PushError, PushFailure};
pub use settings::LiveSettings;
pub use tracking::{EncodedMessage, FeedWatcher, SharedReply, TrackingState};

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use open_feed::{FeedPhase, FeedState, OpenFeed, ReceivedRecords};
use settings::LastContact;
use tracking::TrackingSupervisor;

use crate::analysis::AnalysisSettings;
use crate::domain::feed::close_reason::{CloseCode, CloseReason};
use crate::domain::feed::messages::Hello;
use crate::domain::feed::{MAX_FRAMES, PROTOCOL};
use crate::domain::scope::Scope;
use crate::domain::session::SessionStatus;
use crate::domain::text::Key;
use crate::events::{Event, EventBus};
use crate::ids::{BoxId, FeedId, SessionId, TraineeId};
use crate::media::MediaLimits;
use crate::queue::Queue;
use crate::sandbox::Program;
use crate::shutdown::Shutdown;
use crate::store::{self, NewFeed, Store, StoreError};
use crate::time::{SharedClock, from_rfc3339};
use crate::vault::{Vault, VaultError};

/// Longest name of a sender's program, characters.
const MAX_SENDER_CHARS: usize = 120;

/// The service that receives feeds. Clones share the same state.
#[derive(Clone)]
pub struct FeedService(Arc<FeedServiceParts>);

/// The parts of [`FeedService`].
pub struct FeedServiceParts {
    /// Database.
    pub store: Store,
    /// Stored files.
    pub vault: Vault,
    /// Notified of complete sessions.
    pub queue: Queue,
    /// Notified of sessions that start and end.
    pub events: EventBus,
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
    pub cpu_slots: Arc<CpuSlots>,
}

/// A recording whose sender is gone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interruption {
    /// Time of its latest frame, s; `None` if that is not known.
    pub recorded_s: Option<f64>,
    /// Time until it is ended with the frames that arrived, s.
    pub ends_in_s: f64,
}

/// The result of a hello.
pub enum ConnectResult {
    /// Frames may be sent.
    Open(Connection),
    /// The recording has already ended: there is nothing to send.
    Ended(SessionId),
}

impl FeedService {
    /// Creates the service.
    pub fn new(parts: FeedServiceParts) -> Self {
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
    pub async fn connect(&self, scope: &Scope, in_box: &Key, hello: Hello) -> Result<ConnectResult, CloseReason> {
        let new = self.resolve_hello(scope, in_box, hello).await?;
        self.open(scope, new).await
    }

    /// The same for a recording that is pushed in one request.
    async fn connect_push(&self, scope: &Scope, in_box: &Key, hello: Hello) -> Result<ConnectResult, CloseReason> {
        let new = NewFeed { is_push: true, ..self.resolve_hello(scope, in_box, hello).await? };
        self.open(scope, new).await
    }

    /// Fails if the box is sending a recording now.
    ///
    /// # Errors
    /// The reason to refuse.
    pub async fn check_free(&self, in_box: BoxId) -> Result<(), CloseReason> {
        check_free(&*self.0.open.all.lock().await, in_box, None)
    }

    async fn open(&self, scope: &Scope, new: NewFeed) -> Result<ConnectResult, CloseReason> {
        let (id, in_box) = (new.id, new.in_box);
        // Held from issuing the epoch to opening, so that of two hellos the one with the higher epoch is opened last.
        let _lock = self.0.open.lock_feed(id).await;
        let mut open = self.0.open.all.lock().await;
        check_free(&open, in_box, Some(id))?;
        check_not_finishing(&open, id)?;
        let most = self.0.settings.max_unfinished;
        let row = self.0.store.feeds().open(scope, new, most).await.map_err(reason_of_store_error)?;
        if row.ended_at_ms.is_some() {
            return Ok(ConnectResult::Ended(row.session_id));
        }
        let epoch = row.epoch;
        let begin = |feed| Ok(ConnectResult::Open(Connection::take_over(self.clone(), feed, epoch)));
        // Counted while the lock is held, so that the next connection finds the box busy.
        if let Some(feed) = open.get(&id) {
            check_not_finishing(&open, id)?; // it may have been ended meanwhile
            return begin(feed.clone());
        }
        let feed = if epoch == 1 {
            // There is no log to read yet, and no other recording must find the box free.
            let (session, trainee) = (row.session_id, row.trainee_id);
            let feed = self.open_new_feed(row).await?;
            self.publish_status(session, trainee, SessionStatus::Receiving);
            feed
        } else {
            drop(open);
            let feed = self.open_feed(row).await?;
            open = self.0.open.all.lock().await;
            check_free(&open, in_box, Some(id))?; // another recording may have started meanwhile
            feed
        };
        open.insert(id, feed.clone());
        begin(feed)
    }

    /// Watches the recording of a session that is arriving; `None` while it has no sender.
    pub async fn watch(&self, session: SessionId, wants_pictures: bool) -> Option<FeedWatcher> {
        let open = self.0.open.all.lock().await;
        let arrives = |feed: &&Arc<OpenFeed>| feed.row.session_id == session && feed.has_sender();
        open.values().find(arrives).map(|feed| feed.tracking.watch(feed, wants_pictures))
    }

    /// What is known of a recording without a sender; `None` if it has one, or has ended.
    pub async fn interruption(&self, session: SessionId) -> Result<Option<Interruption>, StoreError> {
        let Some(row) = self.0.store.feeds().of_session(session).await? else { return Ok(None) };
        let known = self.0.open.all.lock().await.get(&row.id).cloned();
        let contact = known.as_ref().map_or(LastContact::UNKNOWN, |feed| feed.last_contact());
        let patience = self.0.settings.patience(row.resumes, contact).as_secs_f64();
        Ok(match known {
            Some(feed) if feed.has_sender() => None,
            Some(feed) => {
                let waited_ms = self.0.clock.monotonic_ms() - feed.last_contact_ms.load(Ordering::Acquire);
                let left_s = (patience - waited_ms as f64 / 1e3).max(0.0);
                Some(Interruption { recorded_s: feed.recorded_s(), ends_in_s: left_s })
            }
            None => Some(Interruption { recorded_s: None, ends_in_s: patience }),
        })
    }

    /// Opens a recording's log.
    async fn open_feed(&self, row: store::FeedRow) -> Result<Arc<OpenFeed>, CloseReason> {
        let time_base = row.time_base().map_err(|error| CloseReason::new(CloseCode::Failed, error.to_string()))?;
        let opened = self.0.vault.open_feed(row.id).await.map_err(reason_of_vault_error)?;
        let tracking = TrackingSupervisor::new(opened.1.ranges().is_empty(), self.0.cpu_slots.clone());
        Ok(Arc::new(OpenFeed::new(row, time_base, opened, tracking, self.0.clock.monotonic_ms())))
    }

    /// The same for a new recording: if it cannot be opened, its row and session are deleted again.
    async fn open_new_feed(&self, row: store::FeedRow) -> Result<Arc<OpenFeed>, CloseReason> {
        let id = row.id;
        let entered = self.open_feed(row).await;
        if entered.is_err()
            && let Err(error) = self.0.store.feeds().forget(id, true).await
        {
            tracing::warn!(%error, feed = %id, "row of a recording that could not start was not deleted");
        }
        entered
    }

    /// Closes an open recording: the next connection reads its log through.
    async fn close_feed(&self, feed: &Arc<OpenFeed>) {
        let mut open = self.0.open.all.lock().await;
        if open.get(&feed.row.id).is_some_and(|entered| Arc::ptr_eq(entered, feed)) {
            open.remove(&feed.row.id);
        }
    }

    /// Checks a hello and looks up the box, trainee and task in it.
    async fn resolve_hello(&self, scope: &Scope, in_box: &Key, hello: Hello) -> Result<NewFeed, CloseReason> {
        let wrong = |why: String| Err(CloseReason::new(CloseCode::NotUnderstood, why));
        if hello.protocol != PROTOCOL {
            return wrong(format!("protocol {}; this server uses protocol {PROTOCOL}", hello.protocol));
        }
        let (width, height) = (hello.width, hello.height);
        let most = MediaLimits::default();
        if !(1..=most.width).contains(&width) || !(1..=most.height).contains(&height) {
            return wrong(format!("a picture of {width}×{height} pixels; at most {}×{}", most.width, most.height));
        }
        let Some(began_at_ms) = from_rfc3339(&hello.began_at) else {
            return wrong("began_at: expected an RFC 3339 time such as 2026-11-21T20:14:00Z".to_owned());
        };
        let owner_scope = &scope.upload_scope();
        let store = &self.0.store;
        let unknown = |what: &'static str| move |error| reason_of_lookup_error(what, error);
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
            sender: hello.sender.chars().filter(|c| !c.is_control()).take(MAX_SENDER_CHARS).collect(),
            is_push: false,
            resumes: hello.resumes,
        })
    }

    fn publish_status(&self, id: SessionId, trainee: TraineeId, status: SessionStatus) {
        self.0.events.publish(Event::Session { id, trainee, status, progress: 0.0 });
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
    Closed(CloseReason),
}

impl From<CloseReason> for LiveError {
    fn from(reason: CloseReason) -> Self {
        LiveError::Closed(reason)
    }
}

impl From<LiveError> for CloseReason {
    fn from(error: LiveError) -> Self {
        match error {
            LiveError::Store(error) => reason_of_store_error(error),
            LiveError::Vault(error) => reason_of_vault_error(error),
            LiveError::Closed(reason) => reason,
        }
    }
}

fn reason_of_store_error(error: StoreError) -> CloseReason {
    let code = match &error {
        StoreError::NotFound { .. }
        | StoreError::Refused { .. }
        | StoreError::Forbidden { .. }
        | StoreError::ConsentMissing { .. } => CloseCode::Unknown,
        StoreError::LimitReached { .. } => CloseCode::Busy,
        _ => CloseCode::Failed,
    };
    CloseReason::new(code, error.to_string())
}

fn reason_of_lookup_error(what: &'static str, error: StoreError) -> CloseReason {
    match error {
        StoreError::NotFound { .. } => CloseReason::new(CloseCode::Unknown, format!("there is no such {what}")),
        other => reason_of_store_error(other),
    }
}

fn reason_of_vault_error(error: VaultError) -> CloseReason {
    let why = match &error {
        VaultError::DiskFull => "the server's disk is full: free space, then it works again".to_owned(),
        other => other.to_string(),
    };
    CloseReason::new(CloseCode::Failed, why)
}

/// Fails if the box is sending another recording than `mine`.
fn check_free(open: &HashMap<FeedId, Arc<OpenFeed>>, in_box: BoxId, mine: Option<FeedId>) -> Result<(), CloseReason> {
    let is_other = |feed: &&Arc<OpenFeed>| Some(feed.row.id) != mine && feed.has_sender() && feed.row.box_id == in_box;
    let Some(other) = open.values().find(is_other) else { return Ok(()) };
    let why = format!("the box is sending another recording ({}): end that one, or stop its sender", other.row.id);
    Err(CloseReason::new(CloseCode::Busy, why))
}

/// Fails while the recording is being assembled.
fn check_not_finishing(open: &HashMap<FeedId, Arc<OpenFeed>>, id: FeedId) -> Result<(), CloseReason> {
    match open.get(&id) {
        Some(feed) if feed.phase() == FeedPhase::Finishing => {
            Err(CloseReason::new(CloseCode::Busy, "the recording is being assembled: connect again"))
        }
        _ => Ok(()),
    }
}

/// True if a recording can end with this number of frames.
fn is_valid_end(frames: u64) -> bool {
    frames <= MAX_FRAMES
}
