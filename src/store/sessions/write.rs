//! Creates, retries and erases sessions.

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::super::audit::note;
use super::super::columns::Insert;
use super::super::consents::require_consent;
use super::super::error::{StoreError, StoreResult, missing, not_found};
use super::super::exams::refuse_if_of_exam;
use super::super::jobs::{self, enqueue_track};
use super::super::retention::forget_box_jobs_of_session;
use super::super::sender_limits::check_day;
use super::super::visibility::{require_staff, require_trainee};
use super::super::{Scope, blobs, certificates, edits, skill_models};
use super::{SessionRecord, SessionStore};
use crate::domain::blob::BlobHash;
use crate::domain::certificate::CertificateEventKind;
use crate::domain::job::{ImportInput, JobInput, JobState};
use crate::domain::session::{ForeignPath, NewSession, RecordedAtSource, Supervision};
use crate::ids::{BoxId, JobId, PersonId, ResultId, SessionId, TaskId, TraineeId};

pub(in crate::store) const DELETE_SESSION: &str = "DELETE FROM session WHERE id = $1";

/// The same recording of records that are merged into that of the trainee, or of an earlier trainee of session `$1`: hidden,
/// and erased with the session. They were filed like this session when their record was merged. Of a recording that was cut,
/// they stay (`is_kept`) while another part has them, too, unless that part is one of `$2`, which are erased together.
const SELECT_TWINS: &str = "
    WITH part (id, whole_id) AS
        (SELECT session.id, coalesce(erased.cut_of, erased.id) FROM session AS erased
         JOIN session ON session.id = coalesce(erased.cut_of, erased.id)
              OR session.cut_of = coalesce(erased.cut_of, erased.id)
         WHERE erased.id = $1),
    place (part_id, trainee_id, task_id, box_id) AS
        (SELECT id, trainee_id, task_id, box_id FROM session WHERE id IN (SELECT id FROM part)
         UNION SELECT session_id, from_trainee_id, from_task_id, from_box_id FROM session_move
         WHERE session_id IN (SELECT id FROM part)),
    holder (part_id, trainee_id) AS
        (SELECT part_id, coalesce(merged.kept_id, place.trainee_id) FROM place
         LEFT JOIN merged_trainee AS merged ON merged.trainee_id = place.trainee_id),
    used_box (part_id, box_id) AS
        (SELECT part_id, coalesce(merged.kept_id, place.box_id) FROM place
         LEFT JOIN merged_box AS merged ON merged.box_id = place.box_id
         UNION SELECT part_id, box_id FROM place),
    hidden (part_id, id) AS
        (SELECT part.id, twin.id FROM part JOIN session AS own ON own.id = part.id
         JOIN merged_trainee AS merged
              ON merged.kept_id IN (SELECT trainee_id FROM holder WHERE holder.part_id = part.id)
         JOIN session AS twin ON twin.trainee_id = merged.trainee_id
              AND coalesce(twin.cut_of, twin.id) <> part.whole_id
              AND twin.task_id IN (SELECT task_id FROM place WHERE place.part_id = part.id)
              AND (twin.video = own.video
                       AND twin.box_id IN (SELECT box_id FROM used_box WHERE used_box.part_id = part.id)
                   OR twin.path_hash = own.path_hash))
    SELECT DISTINCT id, EXISTS (SELECT 1 FROM hidden AS other WHERE other.id = twin.id
                                AND other.part_id NOT IN (SELECT value FROM json_each($2))) AS is_kept
    FROM hidden AS twin WHERE part_id = $1";

const DELETE_ARRIVING_SESSION: &str = "DELETE FROM session WHERE id = $1 AND video IS NULL";

const INSERT_SESSION: &str = "
    INSERT INTO session (id, trainee_id, task_id, box_id, filename, media_type, video, recorded_at_ms,
                         recorded_at_source, created_at_ms, tracker, path_hash, date_known, supervision, supervised_by,
                         supervised_at_ms)
    VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14, $15, iif($15 IS NULL, NULL, $10))";

/// A row of the table `session`.
pub(in crate::store) struct NewSessionRow {
    pub id: SessionId,
    pub trainee_id: TraineeId,
    pub task_id: TaskId,
    pub box_id: BoxId,
    pub filename: String,
    pub media_type: String,
    pub video: Option<BlobHash>,
    pub recorded_at_ms: i64,
    pub recorded_at_source: RecordedAtSource,
    pub created_at_ms: i64,
    pub imported: Option<ForeignPath>,
    pub date_known: bool,
    pub supervisor: Option<PersonId>,
}

/// True if the sender is believed when a recording was made: staff, the agents of boxes and the service, but no trainee.
pub(in crate::store) fn is_trusted_sender(by: &Scope) -> bool {
    by.own_trainee().is_none()
}

/// The person who supervised an attempt by recording or sending it; `None` for a trainee and for a program, which watches
/// no attempt.
pub(in crate::store) fn supervising_sender(by: &Scope) -> Option<PersonId> {
    by.person().filter(|_| by.is_staff() && by.token().is_none())
}

impl NewSessionRow {
    pub fn insert(self) -> Insert {
        let insert = sqlx::query(INSERT_SESSION).bind(self.id).bind(self.trainee_id).bind(self.task_id);
        let insert = insert.bind(self.box_id).bind(self.filename).bind(self.media_type).bind(self.video);
        let insert = insert.bind(self.recorded_at_ms).bind(self.recorded_at_source).bind(self.created_at_ms);
        let (tracker, path) = self.imported.map(|path| (path.tracker, path.hash)).unzip();
        let supervision = if self.supervisor.is_some() { Supervision::SentByStaff } else { Supervision::None };
        insert.bind(tracker).bind(path).bind(self.date_known).bind(supervision).bind(self.supervisor)
    }
}

pub(in crate::store) const SELECT_SAME_SESSION: &str = "
    SELECT id FROM session WHERE trainee_id = $1 AND task_id = $2 AND box_id = $3 AND video = $4
    ORDER BY is_part, created_at_ms, id LIMIT 1";

const SELECT_SAME_PATH: &str = "
    SELECT id FROM session
    WHERE trainee_id = $1 AND task_id = $2 AND (path_hash = $3 OR (box_id = $4 AND video = $5))
    ORDER BY created_at_ms, id LIMIT 1";

const SELECT_JOB_STATE: &str = "SELECT state FROM job WHERE id = $1";

impl SessionStore<'_> {
    /// Creates a session from a recording in the vault and queues its tracking, in one transaction. If the same
    /// trainee, task and box already have this recording, the error is [`StoreError::Taken`] with the existing session.
    pub async fn create(&self, scope: &Scope, new: NewSession) -> StoreResult<SessionRecord> {
        let (by, now_ms, attempts) = (scope.clone(), self.0.now_ms(), self.0.max_attempts());
        let limits = self.0.sender_limits();
        let id = self
            .0
            .write(async move |tx| {
                check_day(tx, &by, &limits, (0, new.video.bytes), now_ms).await?;
                insert(tx, &by, new, now_ms, attempts).await
            })
            .await?;
        self.get(scope, id).await
    }

    /// Creates a session from a table that another tracker measured and that is stored in the vault as it was sent, and
    /// queues its scoring, in one transaction. The same path of the same trainee and task is [`StoreError::Taken`], even
    /// if the bytes of the table differ.
    pub async fn import(&self, scope: &Scope, new: NewSession, path: ForeignPath) -> StoreResult<SessionRecord> {
        let (by, now_ms, attempts) = (scope.clone(), self.0.now_ms(), self.0.max_attempts());
        let limits = self.0.sender_limits();
        let id = self
            .0
            .write(async move |tx| {
                check_day(tx, &by, &limits, (0, new.video.bytes), now_ms).await?;
                let (table, tracker) = (new.video, path.tracker.clone());
                let arrival = SessionArrival::now(&by, now_ms);
                let session = insert_session(tx, &by, new, Some(path), (arrival, now_ms)).await?;
                let input = JobInput::Import(ImportInput { session, table, tracker });
                jobs::insert(tx, &input, now_ms, attempts).await?;
                note(tx, &by, now_ms, ("import", "session"), session).await?;
                Ok(session)
            })
            .await?;
        self.get(scope, id).await
    }

    /// Tracks a session again: after a failure, or because the program has a newer version, or because other versions of
    /// camera or colours were valid when it was recorded than those that it was tracked with. Does nothing while the
    /// session is queued or running.
    pub async fn retry(&self, scope: &Scope, id: SessionId) -> StoreResult<SessionRecord> {
        let session = self.get(scope, id).await?;
        if session.tracker.is_some() {
            return Err(StoreError::refused(
                "this session was measured by another program: to score it again, rescore its task",
            ));
        }
        if let Some(dropped) = session.video_deleted() {
            return Err(StoreError::refused(dropped));
        }
        require_staff(scope, "tracking a session again")?;
        let (by, now_ms, attempts) = (scope.clone(), self.0.now_ms(), self.0.max_attempts());
        self.0
            .write(async move |tx| {
                let before = read_outcome(tx, id).await?;
                let Some(job) = enqueue_track(tx, id, now_ms, attempts).await? else { return Ok(()) };
                if read_outcome(tx, id).await? == before {
                    refuse_if_done(tx, job).await?;
                }
                note(tx, &by, now_ms, ("retry", "session"), id).await
            })
            .await?;
        self.get(scope, id).await
    }

    /// Erases a session with its recording and results. The files are deleted with the next collection of unreferenced
    /// blobs ([`crate::upkeep`]). Trainees may erase their own session only while its recording is arriving.
    pub async fn erase(&self, scope: &Scope, id: SessionId) -> StoreResult<()> {
        let is_arriving = self.get(scope, id).await?.video.is_none();
        if !is_arriving {
            require_staff(scope, "erasing sessions")?;
        }
        let now_ms = self.0.now_ms();
        self.0
            .write_with_delete_reserve(|| {
                let scope = scope.clone();
                async move |tx| {
                    if !scope.is_service() {
                        refuse_if_of_exam(tx, id).await?;
                        refuse_twins_of_exam(tx, id).await?;
                    }
                    skill_models::withdraw_of_session(tx, id, now_ms).await?;
                    forget_box_jobs_of_session(tx, id).await?;
                    // A repeated erasure names each twin itself: in the restored backup, records may be merged that were
                    // separated before the erasure.
                    if !scope.is_service() {
                        erase_twins(tx, &scope, &[id], now_ms).await?;
                    }
                    certificates::mark(tx, &scope, &[id], CertificateEventKind::SessionErased, now_ms).await?;
                    let delete = if is_arriving { DELETE_ARRIVING_SESSION } else { DELETE_SESSION };
                    let deleted = sqlx::query(delete).bind(id).execute(&mut *tx).await?;
                    if deleted.rows_affected() == 0 {
                        return Err(not_found("session"));
                    }
                    note(tx, &scope, now_ms, ("erase", "session"), id).await
                }
            })
            .await
    }
}

/// Refuses to erase a session alone if a hidden session with its recording is an attempt of an exam. Erasing the person
/// erases both.
async fn refuse_twins_of_exam(tx: &mut SqliteConnection, id: SessionId) -> StoreResult<()> {
    for twin in twins(tx, id, &[id]).await?.into_iter().filter(|twin| !twin.is_kept) {
        refuse_if_of_exam(tx, twin.id).await?;
    }
    Ok(())
}

/// A hidden session with the recording of another one.
#[derive(Clone, Copy, Debug, PartialEq, sqlx::FromRow)]
pub(in crate::store) struct Twin {
    /// Its id.
    pub id: SessionId,
    /// True if it stays when the other one is erased, since another part of a cut recording has it, too.
    pub is_kept: bool,
}

/// The hidden sessions with the recording of session `id`, which is erased together with all of `erased`.
pub(in crate::store) async fn twins(
    tx: &mut SqliteConnection,
    id: SessionId,
    erased: &[SessionId],
) -> StoreResult<Vec<Twin>> {
    Ok(sqlx::query_as(SELECT_TWINS).bind(id).bind(Json(erased)).fetch_all(tx).await?)
}

/// Erases the hidden sessions with the same recordings as these sessions, which are erased together. Call it before they are
/// erased.
pub(in crate::store) async fn erase_twins(
    tx: &mut SqliteConnection,
    scope: &Scope,
    erased: &[SessionId],
    now_ms: i64,
) -> StoreResult<()> {
    for id in erased {
        let twins = twins(tx, *id, erased).await?;
        let twins: Vec<SessionId> = twins.into_iter().filter(|twin| !twin.is_kept).map(|twin| twin.id).collect();
        certificates::mark(tx, scope, &twins, CertificateEventKind::SessionErased, now_ms).await?;
        for twin in twins {
            sqlx::query(DELETE_SESSION).bind(twin).execute(&mut *tx).await?;
        }
    }
    Ok(())
}

/// Inserts a session and queues its tracking, if its box is ready.
pub(in crate::store) async fn insert(
    tx: &mut SqliteConnection,
    scope: &Scope,
    new: NewSession,
    now_ms: i64,
    max_attempts: u32,
) -> StoreResult<SessionId> {
    insert_arrived(tx, scope, new, SessionArrival::now(scope, now_ms), (now_ms, max_attempts)).await
}

/// Like [`insert`], for a recording that may have arrived before.
pub(in crate::store) async fn insert_arrived(
    tx: &mut SqliteConnection,
    scope: &Scope,
    new: NewSession,
    arrival: SessionArrival,
    (now_ms, max_attempts): (i64, u32),
) -> StoreResult<SessionId> {
    let time = new.time;
    let id = insert_session(tx, scope, new, None, (arrival, now_ms)).await?;
    if let Some(time) = time {
        edits::insert_with_recording(tx, scope, id, time, now_ms).await?;
    }
    enqueue_track(tx, id, now_ms, max_attempts).await?;
    note(tx, scope, now_ms, ("create", "session"), id).await?;
    Ok(id)
}

/// How a new session arrived.
#[derive(Clone, Copy, Debug)]
pub(in crate::store) struct SessionArrival {
    /// Id of the session: it holds the time of arrival.
    pub id: SessionId,
    /// When its recording arrived, epoch ms.
    pub at_ms: i64,
    /// Who saw the attempt, because they recorded or sent it.
    pub supervisor: Option<PersonId>,
}

impl SessionArrival {
    /// A recording that this caller sends now.
    fn now(by: &Scope, now_ms: i64) -> Self {
        Self { id: SessionId::at(now_ms), at_ms: now_ms, supervisor: supervising_sender(by) }
    }
}

/// Inserts a session whose file is in the vault.
async fn insert_session(
    tx: &mut SqliteConnection,
    scope: &Scope,
    new: NewSession,
    imported: Option<ForeignPath>,
    (SessionArrival { id, at_ms, supervisor }, now_ms): (SessionArrival, i64),
) -> StoreResult<SessionId> {
    require_trainee(tx, scope, new.trainee).await?;
    refuse_duplicate(tx, &new, imported.as_ref()).await?;
    require_consent(tx, new.trainee, now_ms).await?;
    blobs::record(tx, new.video, at_ms).await?;
    let (recorded_at_ms, recorded_at_source) = match new.recorded_at_ms {
        Some(stated_ms) => (stated_ms, RecordedAtSource::Claimed),
        None => (at_ms, RecordedAtSource::Arrival),
    };
    let row = NewSessionRow {
        id,
        trainee_id: new.trainee,
        task_id: new.task,
        box_id: new.in_box,
        filename: new.filename.to_string(),
        media_type: new.media_type,
        video: Some(new.video.hash),
        recorded_at_ms,
        recorded_at_source,
        created_at_ms: at_ms,
        imported,
        date_known: recorded_at_source == RecordedAtSource::Arrival || is_trusted_sender(scope),
        supervisor,
    };
    row.insert().execute(&mut *tx).await.map_err(missing("task or box"))?;
    Ok(id)
}

/// Refuses a recording that exists already. The check comes before the insert so that the error can name the session;
/// the schema's UNIQUE constraint remains as a safeguard.
async fn refuse_duplicate(
    tx: &mut SqliteConnection,
    new: &NewSession,
    imported: Option<&ForeignPath>,
) -> StoreResult<()> {
    let found = match imported {
        Some(path) => sqlx::query_scalar(SELECT_SAME_PATH).bind(new.trainee).bind(new.task).bind(path.hash),
        None => sqlx::query_scalar(SELECT_SAME_SESSION).bind(new.trainee).bind(new.task),
    };
    let existing: Option<String> = found.bind(new.in_box).bind(new.video.hash).fetch_optional(tx).await?;
    existing.map_or(Ok(()), |id| Err(StoreError::Taken { what: "recording", existing: Some(id) }))
}

const SELECT_OUTCOME: &str = "
    SELECT (SELECT id FROM tracking_job WHERE session_id = $1), (SELECT id FROM current_result WHERE session_id = $1)";

/// The job that determines the session's status, and its current result.
async fn read_outcome(tx: &mut SqliteConnection, session: SessionId) -> StoreResult<(Option<JobId>, Option<ResultId>)> {
    Ok(sqlx::query_as(SELECT_OUTCOME).bind(session).fetch_one(tx).await?)
}

async fn refuse_if_done(tx: &mut SqliteConnection, job: JobId) -> StoreResult<()> {
    let state: JobState = sqlx::query_scalar(SELECT_JOB_STATE).bind(job).fetch_one(tx).await?;
    if state == JobState::Done {
        return Err(StoreError::refused(
            "the session is already scored with the current version of the program, and with the camera and colours that \
             were valid when it was recorded",
        ));
    }
    Ok(())
}
