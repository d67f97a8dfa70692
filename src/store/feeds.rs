//! Feeds: recordings that arrive frame by frame. The frames are in a log of the vault; the row names the trainee, task
//! and box, and the connection that may send.

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::audit::note;
use super::columns::Insert;
use super::consents::{require_consent, require_no_refusal};
use super::erasures::SELECT_LAST_ERASURE;
use super::error::{StoreError, StoreResult, missing, not_found};
use super::exams::{begin_attempt, bind_session};
use super::jobs::enqueue_track;
use super::sender_limits::check_feed;
use super::sessions::{DELETE_SESSION, NewSessionRow, SELECT_SAME_SESSION, is_trusted_sender, supervising_sender};
use super::visibility::BindScope;
use super::{Scope, Store, blobs};
use crate::domain::blob::Blob;
use crate::domain::feed::arrival::Arrival;
use crate::domain::feed::early_end::{EarlyEnd, EarlyEndCause};
use crate::domain::feed::start::{is_clock_wrong, is_start_seen, start_of_recording};
use crate::domain::feed::{FrameCodec, TimeBase};
use crate::domain::session::{LiveFeature, RecordedAtSource};
use crate::domain::text::Invalid;
use crate::ids::{BoxId, FeedId, SessionId, TaskId, TraineeId};
use crate::time::to_rfc3339;

/// File name of a recording that was streamed.
const FILENAME: &str = "live.mp4";

/// Media type of a recording that was streamed.
const MEDIA_TYPE: &str = "video/mp4";

/// Access to the feeds.
pub struct FeedStore<'s>(pub(super) &'s Store);

/// A recording that arrives frame by frame, or has arrived completely.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct FeedRow {
    /// Its id, and its log's name in the vault.
    pub id: FeedId,
    /// Its session.
    pub session_id: SessionId,
    /// The trainee.
    pub trainee_id: TraineeId,
    /// The task.
    pub task_id: TaskId,
    /// The box.
    pub box_id: BoxId,
    /// The codec of the frames.
    pub codec: FrameCodec,
    /// Picture width, pixels.
    #[sqlx(try_from = "i64")]
    pub width: u32,
    /// Picture height, pixels.
    #[sqlx(try_from = "i64")]
    pub height: u32,
    #[sqlx(try_from = "i64")]
    tick_num: u32,
    #[sqlx(try_from = "i64")]
    tick_den: u32,
    /// Number of connections so far; only the latest may send.
    #[sqlx(try_from = "i64")]
    pub epoch: u32,
    /// When the complete recording was stored, epoch ms.
    pub ended_at_ms: Option<i64>,
    /// True if it is pushed in a single request; it cannot be resumed after that request.
    pub is_push: bool,
    /// Whether its sender keeps frames that it has not sent, to continue later.
    pub resumes: bool,
}

/// A sender's description of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct NewFeed {
    /// Its id, made by the sender.
    pub id: FeedId,
    /// The trainee.
    pub trainee: TraineeId,
    /// The task.
    pub task: TaskId,
    /// The box.
    pub in_box: BoxId,
    /// The codec of the frames.
    pub codec: FrameCodec,
    /// Picture width and height, pixels.
    pub size: (u32, u32),
    /// The time base of its frames.
    pub time_base: TimeBase,
    /// When it began, epoch ms, as its sender stated.
    pub began_at_ms: i64,
    /// Name of the sender's program, for people; at most 120 characters.
    pub sender: String,
    /// True if it is pushed in a single request.
    pub is_push: bool,
    /// Whether its sender keeps frames that it has not sent, to continue later.
    pub resumes: bool,
}

impl FeedRow {
    /// The time base of its frames.
    pub fn time_base(&self) -> Result<TimeBase, Invalid> {
        [self.tick_num, self.tick_den].try_into()
    }

    /// True if the sender's description matches this feed.
    fn matches(&self, new: &NewFeed) -> bool {
        let (num, den) = new.time_base.fraction();
        self.box_id == new.in_box
            && (self.trainee_id, self.task_id) == (new.trainee, new.task)
            && self.codec == new.codec
            && (self.width, self.height) == new.size
            && (self.tick_num, self.tick_den) == (num, den)
            && self.is_push == new.is_push
    }
}

const SELECT_VISIBLE_BOX: &str = "SELECT 1 FROM training_box WHERE id = $3 AND ($1 <> 'agent' OR $2 = id)";

const SELECT_VISIBLE_FEED: &str = "SELECT * FROM feed_record WHERE id = $3 AND ($1 <> 'agent' OR $2 = box_id)";

const SELECT_FEED: &str = "SELECT * FROM feed_record WHERE id = $1";

const SELECT_UNFINISHED_OF_SESSION: &str = "
    SELECT * FROM feed_record WHERE session_id = $1 AND ended_at_ms IS NULL";

const SELECT_UNFINISHED: &str = "SELECT * FROM feed_record WHERE ended_at_ms IS NULL ORDER BY id";

const SELECT_LIVE_FEATURES: &str = "
    SELECT feed.live_features FROM feed JOIN session ON session.id = feed.session_id
    WHERE feed.live_features IS NOT NULL AND session.id = $3
      AND ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($1 <> 'trainee' OR session.id NOT IN (SELECT session_id FROM sealed_session))
    ORDER BY feed.id DESC LIMIT 1";

const SELECT_ARRIVAL: &str = "
    SELECT feed.arrived_s, feed.stamped_s FROM feed JOIN session ON session.id = feed.session_id
    WHERE feed.arrived_s IS NOT NULL AND session.id = $3
      AND ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($1 <> 'trainee' OR session.id NOT IN (SELECT session_id FROM sealed_session))
    ORDER BY feed.id DESC LIMIT 1";

const SELECT_EARLY_END: &str = "
    SELECT feed.early_end, feed.early_end_detail FROM feed JOIN session ON session.id = feed.session_id
    WHERE feed.early_end IS NOT NULL AND session.id = $3
      AND ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($1 <> 'trainee' OR session.id NOT IN (SELECT session_id FROM sealed_session))
    ORDER BY feed.id DESC LIMIT 1";

const UPDATE_ARRIVAL: &str = "UPDATE feed SET arrived_s = $2, stamped_s = $3 WHERE id = $1";

const SELECT_ERASED: &str = "SELECT 1 FROM erased_feed WHERE id = $1";

const UPDATE_EPOCH: &str = "UPDATE feed SET epoch = epoch + 1 WHERE id = $1";

const END_FEED: &str = "
    UPDATE feed SET ended_at_ms = max($2, created_at_ms), session_id = $3, live_features = $4, early_end = $5,
                    early_end_detail = $6
    WHERE id = $1";

const COMPLETE_SESSION: &str = "UPDATE session SET video = $2, created_at_ms = $3 WHERE id = $1";

const DELETE_EMPTY_SESSION: &str = "
    DELETE FROM session WHERE video IS NULL AND id = (SELECT session_id FROM feed WHERE id = $1)";

const DELETE_ERASED: &str = "DELETE FROM erased_feed WHERE id = $1";

const SELECT_UNFINISHED_IDS: &str = "SELECT id FROM feed WHERE ended_at_ms IS NULL";

const DELETE_EMPTY_SESSIONS: &str = "DELETE FROM session WHERE video IS NULL";

const DELETE_ERASURES_AFTER: &str = "DELETE FROM erasure WHERE number > $1";

const INSERT_FEED: &str = "
    INSERT INTO feed (id, session_id, box_id, codec, width, height, tick_num, tick_den, sender, epoch, created_at_ms,
                      is_push, resumes, actor)
    VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, 1, $10, $11, $12, $13)";

impl NewFeed {
    fn insert(self, session: SessionId, scope: &Scope, now_ms: i64) -> Insert {
        let (width, height) = self.size;
        let (num, den) = self.time_base.fraction();
        let insert = sqlx::query(INSERT_FEED).bind(self.id).bind(session).bind(self.in_box).bind(self.codec);
        let insert = insert.bind(width).bind(height).bind(num).bind(den).bind(self.sender);
        insert.bind(now_ms).bind(self.is_push).bind(self.resumes).bind(scope.actor().to_string())
    }
}

impl FeedStore<'_> {
    /// Begins or resumes a recording: from now on only the connection with the returned epoch may send. A recording
    /// that has ended keeps its epoch. A box may have at most `max_of_box` unfinished recordings.
    ///
    /// # Errors
    /// [`StoreError::Refused`] if the recording exists with another description, or was erased;
    /// [`StoreError::LimitReached`] if there is no place for a new one.
    pub async fn open(&self, scope: &Scope, new: NewFeed, max_of_box: u64) -> StoreResult<FeedRow> {
        let (scope, now_ms, limits) = (scope.clone(), self.0.now_ms(), self.0.sender_limits());
        self.0
            .write(async move |tx| {
                let sees = sqlx::query_scalar(SELECT_VISIBLE_BOX).bind_scope(&scope).bind(new.in_box);
                let sees: Option<i64> = sees.fetch_optional(&mut *tx).await?;
                sees.ok_or(not_found("box"))?;
                let erased: Option<i64> =
                    sqlx::query_scalar(SELECT_ERASED).bind(new.id).fetch_optional(&mut *tx).await?;
                if erased.is_some() {
                    return Err(StoreError::refused("this recording was erased: start a new recording with a new id"));
                }
                let Some(known) = find(tx, new.id).await? else {
                    check_feed(tx, &scope, &limits, (new.in_box, new.id, max_of_box), now_ms).await?;
                    return insert(tx, &scope, new, now_ms).await;
                };
                if !known.matches(&new) {
                    return Err(StoreError::refused(
                        "this recording was begun with another box, trainee, task, codec, size or time base: \
                         start a new recording with a new id",
                    ));
                }
                if known.ended_at_ms.is_some() {
                    return Ok(known);
                }
                require_no_refusal(tx, known.trainee_id, now_ms).await?;
                begin_attempt(tx, &scope, &new).await?;
                sqlx::query(UPDATE_EPOCH).bind(new.id).execute(&mut *tx).await?;
                find(tx, new.id).await?.ok_or(not_found("feed"))
            })
            .await
    }

    /// Stores the complete recording of a feed and queues its tracking, in one transaction. Repeating the call changes
    /// nothing. If the same trainee, task and box already have this recording, the feed is linked to the existing
    /// session. `early` is why it ended early; `None` for a normal end.
    pub async fn end(
        &self,
        id: FeedId,
        video: Blob,
        live_features: Option<Vec<LiveFeature>>,
        early: Option<EarlyEnd>,
    ) -> StoreResult<SessionId> {
        let (now_ms, attempts) = (self.0.now_ms(), self.0.max_attempts());
        self.0
            .write(async move |tx| {
                let feed = find(tx, id).await?.ok_or(not_found("feed"))?;
                if feed.ended_at_ms.is_some() {
                    return Ok(feed.session_id);
                }
                blobs::record(tx, video, now_ms).await?;
                let same =
                    sqlx::query_scalar(SELECT_SAME_SESSION).bind(feed.trainee_id).bind(feed.task_id).bind(feed.box_id);
                let same: Option<SessionId> = same.bind(video.hash).fetch_optional(&mut *tx).await?;
                let session = same.unwrap_or(feed.session_id);
                let ended = sqlx::query(END_FEED).bind(id).bind(now_ms).bind(session).bind(live_features.map(Json));
                let (cause, detail) = early.map_or((None, None), |EarlyEnd { cause, detail }| (Some(cause), detail));
                ended.bind(cause).bind(detail).execute(&mut *tx).await?;
                if same.is_some() {
                    sqlx::query(DELETE_SESSION).bind(feed.session_id).execute(&mut *tx).await?;
                    return Ok(session);
                }
                sqlx::query(COMPLETE_SESSION).bind(session).bind(video.hash).bind(now_ms).execute(&mut *tx).await?;
                enqueue_track(tx, session, now_ms, attempts).await?;
                Ok(session)
            })
            .await
    }

    /// The final features of live tracking of a session's recording; `None` if it was not tracked live.
    pub async fn live_features(&self, scope: &Scope, of: SessionId) -> StoreResult<Option<Vec<LiveFeature>>> {
        let row = sqlx::query_scalar(SELECT_LIVE_FEATURES);
        let row: Option<Json<Vec<LiveFeature>>> =
            row.bind_scope(scope).bind(of).fetch_optional(self.0.readers()).await?;
        Ok(row.map(|Json(features)| features))
    }

    /// Notes how fast a pushed stream arrived.
    pub async fn note_arrival(&self, id: FeedId, arrival: Arrival) -> StoreResult<()> {
        let Arrival { arrived_s, stamped_s } = arrival;
        self.0
            .write(async move |tx| {
                sqlx::query(UPDATE_ARRIVAL).bind(id).bind(arrived_s).bind(stamped_s).execute(tx).await?;
                Ok(())
            })
            .await
    }

    /// How fast a session's recording arrived; `None` unless it was pushed and long enough.
    pub async fn arrival(&self, scope: &Scope, of: SessionId) -> StoreResult<Option<Arrival>> {
        let row = sqlx::query_as(SELECT_ARRIVAL);
        let row: Option<(f64, f64)> = row.bind_scope(scope).bind(of).fetch_optional(self.0.readers()).await?;
        Ok(row.map(|(arrived_s, stamped_s)| Arrival { arrived_s, stamped_s }))
    }

    /// Why the recording of a session ended early; `None` if it did not, or was not live.
    pub async fn early_end(&self, scope: &Scope, of: SessionId) -> StoreResult<Option<EarlyEnd>> {
        let row = sqlx::query_as(SELECT_EARLY_END);
        let row: Option<(EarlyEndCause, Option<String>)> =
            row.bind_scope(scope).bind(of).fetch_optional(self.0.readers()).await?;
        Ok(row.map(|(cause, detail)| EarlyEnd { cause, detail }))
    }

    /// Deletes a recording that has no frames, with its session. Its id counts as erased, so its sender is refused,
    /// unless `may_come_again`.
    pub async fn forget(&self, id: FeedId, may_come_again: bool) -> StoreResult<()> {
        self.0
            .write(async move |tx| {
                sqlx::query(DELETE_EMPTY_SESSION).bind(id).execute(&mut *tx).await?;
                if may_come_again {
                    sqlx::query(DELETE_ERASED).bind(id).execute(tx).await?;
                }
                Ok(())
            })
            .await
    }

    /// Deletes all unfinished feeds and their sessions without marking them as erased: for a copy of the database that has
    /// no logs. In the original they go on, so the list of erasures must not name them.
    pub async fn forget_unfinished(&self) -> StoreResult<()> {
        self.0
            .write(async move |tx| {
                let unfinished: Vec<FeedId> = sqlx::query_scalar(SELECT_UNFINISHED_IDS).fetch_all(&mut *tx).await?;
                let last: i64 = sqlx::query_scalar(SELECT_LAST_ERASURE).fetch_one(&mut *tx).await?;
                sqlx::query(DELETE_EMPTY_SESSIONS).execute(&mut *tx).await?;
                sqlx::query(DELETE_ERASURES_AFTER).bind(last).execute(&mut *tx).await?;
                for id in unfinished {
                    sqlx::query(DELETE_ERASED).bind(id).execute(&mut *tx).await?;
                }
                Ok(())
            })
            .await
    }

    /// One feed.
    pub async fn get(&self, scope: &Scope, id: FeedId) -> StoreResult<FeedRow> {
        let row = sqlx::query_as(SELECT_VISIBLE_FEED);
        row.bind_scope(scope).bind(id).fetch_optional(self.0.readers()).await?.ok_or(not_found("feed"))
    }

    /// The feed that a session arrives by; `None` if the session is complete. The caller may see the session.
    pub async fn of_session(&self, session: SessionId) -> StoreResult<Option<FeedRow>> {
        let row = sqlx::query_as(SELECT_UNFINISHED_OF_SESSION).bind(session);
        Ok(row.fetch_optional(self.0.readers()).await?)
    }

    /// The feeds that have not ended.
    pub async fn unfinished(&self) -> StoreResult<Vec<FeedRow>> {
        let rows = sqlx::query_as(SELECT_UNFINISHED);
        Ok(rows.fetch_all(self.0.readers()).await?)
    }
}

async fn find(tx: &mut SqliteConnection, id: FeedId) -> StoreResult<Option<FeedRow>> {
    let row = sqlx::query_as(SELECT_FEED);
    Ok(row.bind(id).fetch_optional(tx).await?)
}

async fn insert(tx: &mut SqliteConnection, scope: &Scope, new: NewFeed, now_ms: i64) -> StoreResult<FeedRow> {
    require_consent(tx, new.trainee, now_ms).await?;
    let attempt = begin_attempt(tx, scope, &new).await?;
    let (id, session) = (new.id, SessionId::at(now_ms));
    let (recorded_at_ms, recorded_at_source) = match (new.is_push, attempt) {
        (true, _) => (new.began_at_ms, RecordedAtSource::Arrival), // the service itself noted the beginning of the push
        (false, Some(_)) => (now_ms, RecordedAtSource::Arrival),   // no sender says when an exam was held
        (false, None) => start_of_recording(new.began_at_ms, now_ms),
    };
    if !new.is_push && is_clock_wrong(new.began_at_ms, now_ms) {
        let stated = to_rfc3339(new.began_at_ms);
        tracing::warn!(feed = %id, stated, "impossible start of a recording; its arrival is used: set the sender's clock");
    }
    let row = NewSessionRow {
        id: session,
        trainee_id: new.trainee,
        task_id: new.task,
        box_id: new.in_box,
        filename: FILENAME.to_owned(),
        media_type: MEDIA_TYPE.to_owned(),
        video: None,
        recorded_at_ms,
        recorded_at_source,
        created_at_ms: now_ms,
        imported: None,
        date_known: recorded_at_source == RecordedAtSource::Arrival
            || is_trusted_sender(scope)
            || is_start_seen(recorded_at_ms, now_ms),
        supervisor: attempt.and_then(|attempt| attempt.examiner).or_else(|| supervising_sender(scope)),
    };
    row.insert().execute(&mut *tx).await.map_err(missing("trainee, task or box"))?;
    new.insert(session, scope, now_ms).execute(&mut *tx).await?;
    note(tx, scope, now_ms, ("create", "session"), session).await?;
    if let Some(attempt) = attempt {
        bind_session(tx, scope, (attempt, id, session), now_ms).await?;
    }
    find(tx, id).await?.ok_or(not_found("feed"))
}
