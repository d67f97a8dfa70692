//! Recordings that wait for a name: they are stored, but not tracked, until a person says whose they are.
//!
//! A recording becomes a session with the same id: the erasure of that session also removes the recording from an older
//! backup, where it still waits. All staff see recordings without a name, since they have to recognise the person. One
//! that the list of a watched folder gives to a trainee is seen only by those who see the trainee.

use sqlx::sqlite::SqliteConnection;

use super::audit::note;
use super::edits::time_of;
use super::error::{StoreError, StoreResult, missing, not_found};
use super::page::{Page, PageRequest};
use super::pending_erasures::INSERT_ERASURE;
use super::sender_limits::check_day;
use super::sessions::supervision::UPDATE_SUPERVISION;
use super::sessions::{SessionArrival, insert_arrived};
use super::visibility::{BindScope, require_staff};
use super::{Scope, Store, blobs};
use crate::domain::blob::{Blob, BlobHash};
use crate::domain::clock::TimeCorrection;
use crate::domain::erasure::ErasedKind;
use crate::domain::session::{NewSession, Supervision};
use crate::domain::text::{Code, FileName, Key, Name};
use crate::domain::waiting_recording::RecordingSource;
use crate::ids::{BoxId, SessionId, TaskId, TraineeId, WaitingRecordingId};

/// Access to the recordings that wait for a name.
pub struct WaitingRecordingStore<'s>(pub(super) &'s Store);

/// A recording that waits for a name.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct WaitingRecordingRecord {
    /// Its id.
    pub id: WaitingRecordingId,
    /// Its file in the vault.
    pub video: BlobHash,
    /// Length of the file, bytes.
    #[sqlx(try_from = "i64")]
    pub bytes: u64,
    /// Its media type.
    pub media_type: String,
    /// The file's name as it was sent.
    pub filename: FileName,
    /// Its folder below the watched folder, with slashes.
    pub folder: Option<String>,
    /// How it came.
    pub source: RecordingSource,
    /// The box, if known.
    pub box_id: Option<BoxId>,
    /// What it is called.
    pub box_name: Option<Name>,
    /// Its code.
    pub box_code: Option<Code>,
    /// The task, if known.
    pub task_id: Option<TaskId>,
    /// What it is called.
    pub task_name: Option<Name>,
    /// Its code.
    pub task_code: Option<Code>,
    /// Whose it is by the list of the watched folder.
    pub trainee_id: Option<TraineeId>,
    /// The trainee's name.
    pub trainee_name: Option<Name>,
    /// The trainee's code.
    pub trainee_code: Option<Code>,
    /// Why it was not assigned as that list says.
    pub remark: Option<String>,
    /// When it was recorded, epoch ms, if its sender said so.
    pub recorded_at_ms: Option<i64>,
    true_frame_rate_hz: Option<f64>,
    true_duration_s: Option<f64>,
    /// Name of the person who sent it.
    pub sender: Option<Name>,
    /// When it arrived, epoch ms.
    pub arrived_at_ms: i64,
    /// A JPEG of one frame.
    pub preview: Option<BlobHash>,
    /// Why it has no picture.
    pub unreadable: Option<String>,
}

impl WaitingRecordingRecord {
    /// When it was recorded, or when it arrived if that is not known, epoch ms: the key of lists.
    fn made_at_ms(&self) -> i64 {
        self.recorded_at_ms.unwrap_or(self.arrived_at_ms)
    }
}

/// A recording without a name that has arrived. Its file is in the vault already.
#[derive(Clone, Debug, PartialEq)]
pub struct NewWaitingRecording {
    /// The recording.
    pub video: Blob,
    /// Its media type.
    pub media_type: String,
    /// The file's name as it was sent.
    pub filename: FileName,
    /// Its folder below the watched folder.
    pub folder: Option<String>,
    /// How it came.
    pub source: RecordingSource,
    /// The box, if known.
    pub in_box: Option<BoxId>,
    /// The task, if known.
    pub task: Option<TaskId>,
    /// Whose it is by the list of the watched folder.
    pub trainee: Option<TraineeId>,
    /// Why it was not assigned as that list says.
    pub remark: Option<String>,
    /// When it was recorded, epoch ms, if stated.
    pub recorded_at_ms: Option<i64>,
    /// The true time of the recording, if the sender gave it.
    pub time: Option<TimeCorrection>,
    /// A JPEG of one frame, if one was made already.
    pub preview: Option<Blob>,
}

/// What a recording that arrived without a name is now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArrivedRecording {
    /// It waits for a name from now on.
    New(WaitingRecordingId),
    /// The same recording has been waiting for a name.
    Waiting(WaitingRecordingId),
    /// The same recording is a session already.
    Session(SessionId),
}

/// Selects recordings that wait for a name.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct WaitingRecordingFilter {
    /// Only of this box, by id or code.
    pub in_box: Option<Key>,
    /// Only those that came like this.
    pub source: Option<RecordingSource>,
    /// Only those made then or later, epoch ms.
    pub from_ms: Option<i64>,
    /// Only those made before this moment, epoch ms.
    pub before_ms: Option<i64>,
}

/// What a recording is assigned to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AssignmentTarget {
    /// The trainee.
    pub trainee: TraineeId,
    /// The task.
    pub task: TaskId,
    /// The box.
    pub in_box: BoxId,
    /// When it was recorded, epoch ms; `None`: not known.
    pub recorded_at_ms: Option<i64>,
    /// True if the caller saw the attempt.
    pub supervised: bool,
}

/// A trainee, a task or a box that a caller may give to a recording.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct ProposableThing {
    /// Its id.
    pub id: String,
    /// What people call it.
    pub name: String,
    /// Its short unique name.
    pub code: String,
}

/// What a caller may give to recordings.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ProposableThings {
    /// The trainees.
    pub trainees: Vec<ProposableThing>,
    /// The tasks.
    pub tasks: Vec<ProposableThing>,
    /// The boxes.
    pub boxes: Vec<ProposableThing>,
}

/// Most things of one kind that are compared with the names of files; those after them, by code, are never proposed.
const MAX_PROPOSABLE: i64 = 5_000;

/// A recording that was assigned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AssignedRecording {
    /// Its session.
    pub session: SessionId,
    /// True if the session waits until its box has a camera and colours.
    pub waits_for_box: bool,
}

const SELECT_WAITING: &str = "
    SELECT waiting.id, waiting.video, blob.bytes, waiting.media_type, waiting.filename, waiting.folder, waiting.source,
           waiting.box_id, training_box.name AS box_name, training_box.code AS box_code,
           waiting.task_id, task.name AS task_name, task.code AS task_code,
           waiting.trainee_id, trainee.name AS trainee_name, trainee.code AS trainee_code, waiting.remark,
           waiting.recorded_at_ms, waiting.true_frame_rate_hz, waiting.true_duration_s, person.name AS sender,
           waiting.arrived_at_ms, waiting.preview, waiting.unreadable
    FROM waiting_recording AS waiting JOIN blob ON blob.hash = waiting.video
    LEFT JOIN training_box ON training_box.id = waiting.box_id
    LEFT JOIN task ON task.id = waiting.task_id
    LEFT JOIN trainee ON trainee.id = waiting.trainee_id
    LEFT JOIN person ON person.id = waiting.person_id
    WHERE $1 IN ('administrator', 'instructor')
      AND (waiting.trainee_id IS NULL OR $1 = 'administrator'
           OR waiting.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND (waiting.trainee_id IS NULL OR $2 IS 'service'
           OR waiting.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($3 IS NULL OR waiting.id = $3)
      AND ($4 IS NULL OR $4 IN (training_box.id, training_box.code))
      AND ($5 IS NULL OR waiting.source = $5)
      AND ($6 IS NULL OR coalesce(waiting.recorded_at_ms, waiting.arrived_at_ms) >= $6)
      AND ($7 IS NULL OR coalesce(waiting.recorded_at_ms, waiting.arrived_at_ms) < $7)
      AND ($8 IS NULL OR (coalesce(waiting.recorded_at_ms, waiting.arrived_at_ms), waiting.id) < ($8, $9))
    ORDER BY coalesce(waiting.recorded_at_ms, waiting.arrived_at_ms) DESC, waiting.id DESC LIMIT $10";

const COUNT_WAITING: &str = "
    SELECT count(*) FROM waiting_recording AS waiting
    WHERE $1 IN ('administrator', 'instructor')
      AND (waiting.trainee_id IS NULL OR $1 = 'administrator'
           OR waiting.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND (waiting.trainee_id IS NULL OR $2 IS 'service'
           OR waiting.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))";

const SELECT_OF_TRAINEE: &str = "
    SELECT waiting.id, waiting.video, blob.bytes, waiting.media_type, waiting.filename, waiting.folder, waiting.source,
           waiting.box_id, training_box.name AS box_name, training_box.code AS box_code,
           waiting.task_id, task.name AS task_name, task.code AS task_code,
           waiting.trainee_id, trainee.name AS trainee_name, trainee.code AS trainee_code, waiting.remark,
           waiting.recorded_at_ms, waiting.true_frame_rate_hz, waiting.true_duration_s, person.name AS sender,
           waiting.arrived_at_ms, waiting.preview, waiting.unreadable
    FROM waiting_recording AS waiting JOIN blob ON blob.hash = waiting.video
    JOIN trainee ON trainee.id = waiting.trainee_id
    LEFT JOIN training_box ON training_box.id = waiting.box_id
    LEFT JOIN task ON task.id = waiting.task_id
    LEFT JOIN person ON person.id = waiting.person_id
    WHERE waiting.trainee_id = $3
      AND ($1 = 'administrator'
           OR waiting.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR waiting.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
    ORDER BY waiting.id";

/// The names of all trainees (also for the service without those who wait for their erasure), tasks and boxes that a
/// caller may give to a recording; at most `$3` of each kind, by code. The code of a merged record leads to the kept one.
const SELECT_PROPOSABLE_TRAINEES: &str = "
    SELECT id, name, code FROM trainee
    WHERE ($1 = 'administrator'
           OR id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND id NOT IN (SELECT trainee_id FROM hidden_trainee)
    UNION ALL
    SELECT merged.kept_id, trainee.code, trainee.code
    FROM merged_trainee AS merged JOIN trainee ON trainee.id = merged.trainee_id
    WHERE ($1 = 'administrator'
           OR merged.kept_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND merged.kept_id NOT IN (SELECT trainee_id FROM hidden_trainee)
    ORDER BY code LIMIT $3";

const SELECT_PROPOSABLE_TASKS: &str = "SELECT id, name, code FROM task WHERE $1 <> 'agent' ORDER BY code LIMIT $3";

const SELECT_PROPOSABLE_BOXES: &str = "
    SELECT id, name, code FROM training_box
    WHERE $1 <> 'agent' AND id NOT IN (SELECT box_id FROM merged_box)
    UNION ALL
    SELECT merged.kept_id, training_box.code, training_box.code
    FROM merged_box AS merged JOIN training_box ON training_box.id = merged.box_id WHERE $1 <> 'agent'
    ORDER BY code LIMIT $3";

const COUNT_ALL: &str = "SELECT count(*) FROM waiting_recording";

const SELECT_WAITING_WITH: &str = "SELECT id FROM waiting_recording WHERE video = $1";

const SELECT_SESSION_WITH: &str = "SELECT id FROM session WHERE video = $1 ORDER BY created_at_ms, id LIMIT 1";

const INSERT_WAITING: &str = "
    INSERT INTO waiting_recording (id, video, media_type, filename, folder, source, box_id, task_id, trainee_id, remark,
                                   recorded_at_ms, true_frame_rate_hz, true_duration_s, person_id, arrived_at_ms,
                                   preview)
    VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14, $15, $16)";

const UPDATE_PREVIEW: &str = "UPDATE waiting_recording SET preview = $2, unreadable = $3 WHERE id = $1";

const DELETE_WAITING: &str = "DELETE FROM waiting_recording WHERE id = $1";

const SELECT_EXPIRED: &str =
    "SELECT id FROM waiting_recording WHERE arrived_at_ms < $1 ORDER BY arrived_at_ms LIMIT $2";

const SELECT_HAS_JOB: &str = "SELECT EXISTS (SELECT 1 FROM tracking_job WHERE session_id = $1)";

impl WaitingRecordingStore<'_> {
    /// Adds a recording without a name, unless the service has it already. Staff, agents of boxes and the service add
    /// them; at most `max_waiting` wait at a time.
    ///
    /// # Errors
    /// [`StoreError::LimitReached`] if there is no place for it.
    pub async fn add(
        &self,
        scope: &Scope,
        new: NewWaitingRecording,
        max_waiting: u64,
    ) -> StoreResult<ArrivedRecording> {
        let (by, now_ms, limits) = (scope.clone(), self.0.now_ms(), self.0.sender_limits());
        self.0
            .write(async move |tx| {
                if let Some(known) = find_known(tx, new.video.hash).await? {
                    return Ok(known);
                }
                check_day(tx, &by, &limits, (0, new.video.bytes), now_ms).await?;
                check_place(tx, max_waiting).await?;
                blobs::record(tx, new.video, now_ms).await?;
                if let Some(preview) = new.preview {
                    blobs::record(tx, preview, now_ms).await?;
                }
                let id = WaitingRecordingId::at(now_ms);
                let insert = sqlx::query(INSERT_WAITING).bind(id).bind(new.video.hash).bind(new.media_type);
                let insert = insert.bind(new.filename).bind(new.folder).bind(new.source).bind(new.in_box);
                let insert = insert.bind(new.task).bind(new.trainee).bind(new.remark).bind(new.recorded_at_ms);
                let insert = insert.bind(new.time.and_then(TimeCorrection::frame_rate_hz));
                let insert = insert.bind(new.time.and_then(TimeCorrection::duration_s)).bind(by.person()).bind(now_ms);
                let insert = insert.bind(new.preview.map(|preview| preview.hash));
                insert.execute(&mut *tx).await.map_err(missing("task, box or trainee"))?;
                note(tx, &by, now_ms, ("create", "waiting_recording"), id).await?;
                Ok(ArrivedRecording::New(id))
            })
            .await
    }

    /// What the recording with this content is, if the service has it.
    pub async fn known(&self, video: BlobHash) -> StoreResult<Option<ArrivedRecording>> {
        find_known(&mut *self.0.readers().acquire().await?, video).await
    }

    /// The recordings that wait for a name, the last made first.
    pub async fn list(
        &self,
        scope: &Scope,
        which: &WaitingRecordingFilter,
        page: &PageRequest,
    ) -> StoreResult<Page<WaitingRecordingRecord>> {
        let (made_at_ms, id) = page.after().map(list_key).transpose()?.unzip();
        let rows = sqlx::query_as(SELECT_WAITING).bind_scope(scope).bind(None::<WaitingRecordingId>);
        let rows = rows.bind(&which.in_box).bind(which.source).bind(which.from_ms).bind(which.before_ms);
        let rows = rows.bind(made_at_ms).bind(id).bind(page.row_limit()).fetch_all(self.0.readers()).await?;
        Ok(Page::from_rows(rows, page, |one: &WaitingRecordingRecord| format!("{} {}", one.made_at_ms(), one.id)))
    }

    /// One recording that waits for a name.
    pub async fn get(&self, scope: &Scope, id: WaitingRecordingId) -> StoreResult<WaitingRecordingRecord> {
        let none = None::<i64>;
        let row = sqlx::query_as(SELECT_WAITING).bind_scope(scope).bind(id).bind(None::<Key>);
        let row = row.bind(None::<RecordingSource>).bind(none).bind(none).bind(none).bind(None::<String>).bind(1);
        row.fetch_optional(self.0.readers()).await?.ok_or(not_found("waiting recording"))
    }

    /// The recordings that the list of a watched folder gives to this trainee, the first to arrive first.
    pub async fn of_trainee(&self, scope: &Scope, trainee: TraineeId) -> StoreResult<Vec<WaitingRecordingRecord>> {
        let rows = sqlx::query_as(SELECT_OF_TRAINEE).bind_scope(scope).bind(trainee);
        Ok(rows.fetch_all(self.0.readers()).await?)
    }

    /// How many recordings wait for a name.
    pub async fn count(&self, scope: &Scope) -> StoreResult<i64> {
        Ok(sqlx::query_scalar(COUNT_WAITING).bind_scope(scope).fetch_one(self.0.readers()).await?)
    }

    /// The trainees, tasks and boxes that this caller may give to recordings.
    pub async fn proposable(&self, scope: &Scope) -> StoreResult<ProposableThings> {
        let trainees = sqlx::query_as(SELECT_PROPOSABLE_TRAINEES).bind_scope(scope).bind(MAX_PROPOSABLE);
        let tasks = sqlx::query_as(SELECT_PROPOSABLE_TASKS).bind_scope(scope).bind(MAX_PROPOSABLE);
        let boxes = sqlx::query_as(SELECT_PROPOSABLE_BOXES).bind_scope(scope).bind(MAX_PROPOSABLE);
        Ok(ProposableThings {
            trainees: trainees.fetch_all(self.0.readers()).await?,
            tasks: tasks.fetch_all(self.0.readers()).await?,
            boxes: boxes.fetch_all(self.0.readers()).await?,
        })
    }

    /// Makes a recording a session of this trainee, and queues its tracking.
    ///
    /// # Errors
    /// [`StoreError::ConsentMissing`]; [`StoreError::Taken`] with the session that the trainee, task and box have of
    /// it.
    pub async fn assign(
        &self,
        scope: &Scope,
        id: WaitingRecordingId,
        to: AssignmentTarget,
    ) -> StoreResult<AssignedRecording> {
        require_staff(scope, "giving recordings a name")?;
        let found = self.get(scope, id).await?;
        let time = time_of(found.true_frame_rate_hz, found.true_duration_s);
        let WaitingRecordingRecord { video, bytes, media_type, filename, arrived_at_ms, .. } = found;
        let (by, now_ms, attempts) = (scope.clone(), self.0.now_ms(), self.0.max_attempts());
        let new = NewSession {
            trainee: to.trainee,
            task: to.task,
            in_box: to.in_box,
            filename,
            recorded_at_ms: to.recorded_at_ms,
            video: Blob { hash: video, bytes },
            media_type,
            time,
        };
        self.0
            .write(async move |tx| {
                let removed = sqlx::query(DELETE_WAITING).bind(id).execute(&mut *tx).await?;
                if removed.rows_affected() == 0 {
                    return Err(not_found("waiting recording")); // assigned or discarded meanwhile
                }
                let arrival = SessionArrival { id: id.into(), at_ms: arrived_at_ms, supervisor: None };
                let session = insert_arrived(tx, &by, new, arrival, (now_ms, attempts)).await?;
                if to.supervised {
                    let marked = sqlx::query(UPDATE_SUPERVISION).bind(session).bind(Supervision::Marked);
                    marked.bind(by.person()).bind(now_ms).execute(&mut *tx).await?;
                    note(tx, &by, now_ms, ("supervise", "session"), session).await?;
                }
                note(tx, &by, now_ms, ("assign", "waiting_recording"), id).await?;
                let has_job: bool = sqlx::query_scalar(SELECT_HAS_JOB).bind(session).fetch_one(tx).await?;
                Ok(AssignedRecording { session, waits_for_box: !has_job })
            })
            .await
    }

    /// Discards a recording. Its file is deleted with the next collection of unreferenced blobs.
    pub async fn discard(&self, scope: &Scope, id: WaitingRecordingId) -> StoreResult<()> {
        require_staff(scope, "discarding recordings without a name")?;
        self.get(scope, id).await?;
        self.delete(scope, id, "discard").await
    }

    /// Deletes at most `most` recordings that arrived before this time; true if there may be more.
    pub async fn forget(&self, before_ms: i64, most: u32) -> StoreResult<bool> {
        // Read first, since every write costs a commit.
        let expired = sqlx::query_scalar(SELECT_EXPIRED).bind(before_ms).bind(most).fetch_all(self.0.readers()).await?;
        let count = expired.len();
        for id in expired {
            match self.delete(&Scope::service(), id, "expire").await {
                Err(StoreError::NotFound { .. }) => {} // assigned or discarded meanwhile
                deleted => deleted?,
            }
        }
        Ok(count == most as usize)
    }

    async fn delete(&self, scope: &Scope, id: WaitingRecordingId, action: &'static str) -> StoreResult<()> {
        let now_ms = self.0.now_ms();
        self.0
            .write_with_delete_reserve(|| {
                let scope = scope.clone();
                async move |tx| {
                    if sqlx::query(DELETE_WAITING).bind(id).execute(&mut *tx).await?.rows_affected() == 0 {
                        return Err(not_found("waiting recording"));
                    }
                    // A backup that still has it must not bring it back.
                    let erased = sqlx::query(INSERT_ERASURE).bind(ErasedKind::Session).bind(id).bind(now_ms);
                    erased.execute(&mut *tx).await?;
                    note(tx, &scope, now_ms, (action, "waiting_recording"), id).await
                }
            })
            .await
    }

    /// Keeps the picture of a recording, or why there is none. Does nothing if the recording waits no longer.
    pub async fn set_preview(&self, id: WaitingRecordingId, preview: Result<Blob, String>) -> StoreResult<()> {
        let now_ms = self.0.now_ms();
        self.0
            .write(async move |tx| {
                let (preview, unreadable) = match preview {
                    Ok(preview) => {
                        blobs::record(tx, preview, now_ms).await?;
                        (Some(preview.hash), None)
                    }
                    Err(why) => (None, Some(why)),
                };
                sqlx::query(UPDATE_PREVIEW).bind(id).bind(preview).bind(unreadable).execute(tx).await?;
                Ok(())
            })
            .await
    }
}

async fn find_known(tx: &mut SqliteConnection, video: BlobHash) -> StoreResult<Option<ArrivedRecording>> {
    let waiting = sqlx::query_scalar(SELECT_WAITING_WITH).bind(video).fetch_optional(&mut *tx).await?;
    if let Some(id) = waiting {
        return Ok(Some(ArrivedRecording::Waiting(id)));
    }
    let session = sqlx::query_scalar(SELECT_SESSION_WITH).bind(video).fetch_optional(tx).await?;
    Ok(session.map(ArrivedRecording::Session))
}

async fn check_place(tx: &mut SqliteConnection, max_waiting: u64) -> StoreResult<()> {
    let waiting: i64 = sqlx::query_scalar(COUNT_ALL).fetch_one(tx).await?;
    if waiting.unsigned_abs() < max_waiting {
        return Ok(());
    }
    let why =
        format!("{waiting} recordings wait for a name, the most that are allowed. Assign or discard some of them.");
    Err(StoreError::LimitReached { why, most: max_waiting })
}

/// The sort key of the list: time and id.
fn list_key(key: &str) -> StoreResult<(i64, String)> {
    let parts = key.split_once(' ').and_then(|(at_ms, id)| Some((at_ms.parse().ok()?, id.to_owned())));
    parts.ok_or_else(|| StoreError::refused("this cursor is of another list: begin with the first page"))
}
