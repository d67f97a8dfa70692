//! Uploads: recordings that are arriving. The bytes are in a file of the vault; the row records how many of them are
//! durable.

use super::audit::note;
use super::columns::{Insert, integer};
use super::consents::require_consent;
use super::edits::time_of;
use super::error::{StoreError, StoreResult, missing, not_found};
use super::sender_limits::check_upload;
use super::sessions;
use super::visibility::{BindScope, require_trainee};
use super::{Scope, Store};
use crate::domain::blob::Blob;
use crate::domain::clock::TimeCorrection;
use crate::domain::session::NewSession;
use crate::domain::text::FileName;
use crate::ids::{BoxId, PersonId, SessionId, TaskId, TraineeId, UploadId};

/// Access to the uploads.
pub struct UploadStore<'s>(pub(super) &'s Store);

/// A recording that is arriving, or has just arrived.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct UploadRecord {
    /// Its id, and its file's name in the vault.
    pub id: UploadId,
    /// The sender.
    pub person_id: Option<PersonId>,
    /// The trainee.
    pub trainee_id: TraineeId,
    /// The task.
    pub task_id: TaskId,
    /// The box.
    pub box_id: BoxId,
    /// The recording's file name on the sender's machine.
    pub filename: FileName,
    /// `Upload-Metadata` as it was sent.
    pub metadata: String,
    /// When it was recorded, epoch ms, if known.
    pub recorded_at_ms: Option<i64>,
    /// The true frame rate, Hz, if the sender gave it.
    pub true_frame_rate_hz: Option<f64>,
    /// The true duration, s, if the sender gave it.
    pub true_duration_s: Option<f64>,
    /// Total length, bytes.
    #[sqlx(try_from = "i64")]
    pub length: u64,
    /// Bytes that are durable.
    #[sqlx(try_from = "i64")]
    pub received: u64,
    /// The session that it became.
    pub session_id: Option<SessionId>,
    /// True if that session existed before this upload was finished.
    pub is_duplicate: bool,
    /// When it was begun, epoch ms.
    pub created_at_ms: i64,
    /// When it expires unless more bytes arrive, epoch ms.
    pub expires_at_ms: i64,
}

/// A recording that is about to arrive.
#[derive(Clone, Debug, PartialEq)]
pub struct NewUpload {
    /// Its id and the name of its file, which exists before the row.
    pub id: UploadId,
    /// The trainee.
    pub trainee: TraineeId,
    /// The task.
    pub task: TaskId,
    /// The box.
    pub in_box: BoxId,
    /// The recording's file name on the sender's machine.
    pub filename: FileName,
    /// `Upload-Metadata` as it was sent, at most 8 KiB.
    pub metadata: String,
    /// When it was recorded, epoch ms, if known.
    pub recorded_at_ms: Option<i64>,
    /// The true time of the recording, if the sender gave it.
    pub time: Option<TimeCorrection>,
    /// Total length, bytes.
    pub length: u64,
    /// When it expires unless more bytes arrive, epoch ms.
    pub expires_at_ms: i64,
}

/// The outcome of a complete upload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FinishedUpload {
    /// Its session.
    pub session: SessionId,
    /// True if the session is new. Otherwise the upload was finished before, or the recording exists already.
    pub is_new: bool,
    /// True if the recording was a session already when the upload was finished.
    pub is_duplicate: bool,
}

impl UploadRecord {
    /// The outcome, if the upload was finished before.
    pub fn finished_before(&self) -> Option<FinishedUpload> {
        self.session_id.map(|session| FinishedUpload { session, is_new: false, is_duplicate: self.is_duplicate })
    }
}

/// An upload is within the scope if its trainee is, or if its box is the agent's own.
const SELECT_UPLOAD: &str = "
    SELECT * FROM upload
    WHERE id = $3
      AND (($1 = 'administrator'
            OR trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
           OR ($1 = 'agent' AND $2 = box_id))
      AND ($2 IS 'service' OR trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))";

const SELECT_UNFINISHED: &str = "SELECT * FROM upload WHERE session_id IS NULL";

const UPDATE_RECEIVED: &str = "
    UPDATE upload
    SET received = max(received, $2), expires_at_ms = max(expires_at_ms, $3)
    WHERE id = $1 AND session_id IS NULL";

const LOWER_RECEIVED: &str = "UPDATE upload SET received = min(received, $2) WHERE id = $1 AND session_id IS NULL";

const LINK_SESSION: &str = "UPDATE upload SET session_id = $2, is_duplicate = $3 WHERE id = $1 AND session_id IS NULL";

/// The service completes an upload whose sender went away: a trainee's word for the time stays a trainee's word.
const DOUBT_DATE_OF_TRAINEE: &str = "
    UPDATE session SET date_known = 0
    WHERE id = $1 AND recorded_at_source = 'claimed'
      AND EXISTS (SELECT 1 FROM person WHERE id = $2 AND trainee_id IS NOT NULL)";

const DELETE_UPLOAD: &str = "DELETE FROM upload WHERE id = $1";

const SELECT_EXPIRED: &str = "SELECT id FROM upload WHERE expires_at_ms <= $1 LIMIT $2";

const SELECT_IS_UNFINISHED: &str = "SELECT 1 FROM upload WHERE id = $1 AND session_id IS NULL";

const INSERT_UPLOAD: &str = "
    INSERT INTO upload (id, person_id, trainee_id, task_id, box_id, filename, metadata, recorded_at_ms, length, received,
                        session_id, created_at_ms, expires_at_ms, true_frame_rate_hz, true_duration_s)
    VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14, $15)";

impl UploadRecord {
    fn insert(&self) -> Insert {
        let insert = sqlx::query(INSERT_UPLOAD).bind(self.id).bind(self.person_id).bind(self.trainee_id);
        let insert = insert.bind(self.task_id).bind(self.box_id).bind(&self.filename).bind(&self.metadata);
        let insert = insert.bind(self.recorded_at_ms).bind(integer(self.length)).bind(integer(self.received));
        let insert = insert.bind(self.session_id).bind(self.created_at_ms).bind(self.expires_at_ms);
        insert.bind(self.true_frame_rate_hz).bind(self.true_duration_s)
    }
}

impl UploadStore<'_> {
    /// Begins an upload. At most `max_unfinished` uploads of all senders may be unfinished.
    ///
    /// # Errors
    /// [`StoreError::LimitReached`] if there is no place for it.
    pub async fn create(&self, scope: &Scope, new: NewUpload, max_unfinished: u64) -> StoreResult<UploadRecord> {
        let (scope, limits) = (scope.clone(), self.0.sender_limits());
        let upload = UploadRecord {
            id: new.id,
            person_id: scope.person(),
            trainee_id: new.trainee,
            task_id: new.task,
            box_id: new.in_box,
            filename: new.filename,
            metadata: new.metadata,
            recorded_at_ms: new.recorded_at_ms,
            true_frame_rate_hz: new.time.and_then(TimeCorrection::frame_rate_hz),
            true_duration_s: new.time.and_then(TimeCorrection::duration_s),
            length: new.length,
            received: 0,
            session_id: None,
            is_duplicate: false,
            created_at_ms: self.0.now_ms(),
            expires_at_ms: new.expires_at_ms,
        };
        self.0
            .write(async move |tx| {
                require_trainee(tx, &scope, upload.trainee_id).await?;
                require_consent(tx, upload.trainee_id, upload.created_at_ms).await?;
                let wanted = (max_unfinished, upload.length);
                check_upload(tx, &scope, &limits, wanted, upload.created_at_ms).await?;
                upload.insert().execute(tx).await.map_err(missing("task or box"))?;
                Ok(upload)
            })
            .await
    }

    /// One upload.
    pub async fn get(&self, scope: &Scope, id: UploadId) -> StoreResult<UploadRecord> {
        let row = sqlx::query_as(SELECT_UPLOAD);
        let row = row.bind_scope(scope).bind(id).fetch_optional(self.0.readers()).await?;
        row.ok_or(not_found("upload"))
    }

    /// Records that `received` bytes are durable. Call it after the file is synced and before the sender is answered.
    /// The value never decreases.
    pub async fn advance(&self, id: UploadId, received: u64, expires_at_ms: i64) -> StoreResult<()> {
        self.0
            .write(async move |tx| {
                let done = sqlx::query(UPDATE_RECEIVED)
                    .bind(id)
                    .bind(integer(received))
                    .bind(expires_at_ms)
                    .execute(tx)
                    .await?;
                if done.rows_affected() == 1 { Ok(()) } else { Err(not_found("upload")) }
            })
            .await
    }

    /// At start-up: lowers the number of durable bytes to what the file really holds.
    pub async fn set_back(&self, id: UploadId, received: u64) -> StoreResult<()> {
        self.0
            .write(async move |tx| {
                sqlx::query(LOWER_RECEIVED).bind(id).bind(integer(received)).execute(tx).await?;
                Ok(())
            })
            .await
    }

    /// Makes the session of a complete upload and queues its tracking, in one transaction. Repeating the call returns
    /// the same session, as does another upload of the same recording by the same trainee, task and box.
    pub async fn finish(
        &self,
        scope: &Scope,
        id: UploadId,
        video: Blob,
        media_type: String,
    ) -> StoreResult<FinishedUpload> {
        let upload = self.get(scope, id).await?;
        if let Some(finished) = upload.finished_before() {
            return Ok(finished);
        }
        if upload.received != upload.length || video.bytes != upload.length {
            let (received, length) = (upload.received, upload.length);
            return Err(StoreError::refused(format!("{received} of {length} bytes have arrived: send the rest first")));
        }
        let (scope, now_ms, attempts) = (scope.clone(), self.0.now_ms(), self.0.max_attempts());
        let sender = upload.person_id;
        let new = NewSession {
            trainee: upload.trainee_id,
            task: upload.task_id,
            in_box: upload.box_id,
            filename: upload.filename,
            recorded_at_ms: upload.recorded_at_ms,
            time: time_of(upload.true_frame_rate_hz, upload.true_duration_s),
            video,
            media_type,
        };
        self.0
            .write(async move |tx| {
                let finished = made_or_found(sessions::insert(tx, &scope, new, now_ms, attempts).await)?;
                if scope.is_service() && finished.is_new {
                    let doubt = sqlx::query(DOUBT_DATE_OF_TRAINEE).bind(finished.session).bind(sender);
                    doubt.execute(&mut *tx).await?;
                }
                let link = sqlx::query(LINK_SESSION).bind(id).bind(finished.session).bind(finished.is_duplicate);
                let linked = link.execute(&mut *tx).await?;
                if linked.rows_affected() == 1 { Ok(finished) } else { Err(not_found("upload")) }
            })
            .await
    }

    /// Deletes an upload's row; the caller deletes the file afterwards. The session that it became stays.
    pub async fn delete(&self, scope: &Scope, id: UploadId) -> StoreResult<()> {
        self.get(scope, id).await?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write_with_delete_reserve(|| {
                let scope = scope.clone();
                async move |tx| {
                    sqlx::query(DELETE_UPLOAD).bind(id).execute(&mut *tx).await?;
                    note(tx, &scope, now_ms, ("delete", "upload"), id).await
                }
            })
            .await
    }

    /// Expired uploads, at most `most`, whose rows and files should be deleted.
    pub async fn expired(&self, most: u32) -> StoreResult<Vec<UploadId>> {
        Ok(sqlx::query_scalar(SELECT_EXPIRED).bind(self.0.now_ms()).bind(most).fetch_all(self.0.readers()).await?)
    }

    /// True if there is an upload with this id that has not become a session.
    pub async fn is_unfinished(&self, id: UploadId) -> StoreResult<bool> {
        let found: Option<i64> =
            sqlx::query_scalar(SELECT_IS_UNFINISHED).bind(id).fetch_optional(self.0.readers()).await?;
        Ok(found.is_some())
    }

    /// All uploads that have a file: those that have not become a session.
    pub async fn unfinished(&self) -> StoreResult<Vec<UploadRecord>> {
        let rows = sqlx::query_as(SELECT_UNFINISHED);
        Ok(rows.fetch_all(self.0.readers()).await?)
    }
}

/// An existing recording is no error here: the sender gets the session that it has become.
fn made_or_found(inserted: StoreResult<SessionId>) -> StoreResult<FinishedUpload> {
    match inserted {
        Ok(session) => Ok(FinishedUpload { session, is_new: true, is_duplicate: false }),
        Err(StoreError::Taken { what, existing: Some(id) }) => match id.parse() {
            Ok(session) => Ok(FinishedUpload { session, is_new: false, is_duplicate: true }),
            Err(_) => Err(StoreError::Taken { what, existing: Some(id) }),
        },
        Err(other) => Err(other),
    }
}
