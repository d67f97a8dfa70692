//! Videos that are older than the centre keeps them, and pictures of boxes that no job needs any more. The path and the
//! features of a session stay.

use sqlx::sqlite::SqliteConnection;

use super::audit::note;
use super::error::StoreResult;
use super::{Scope, Store};
use crate::domain::blob::BlobHash;
use crate::ids::{SessionId, TraineeId};

/// Access to what is kept for a limited time.
pub struct RetentionStore<'s>(pub(super) &'s Store);

/// Selects at most `$2` videos all of whose sessions arrived before `$1`, unless a job still has to read one.
const SELECT_OLD_VIDEOS: &str = "
    SELECT DISTINCT blob.hash, blob.bytes FROM session JOIN blob ON blob.hash = session.video
    WHERE session.created_at_ms < $1 AND session.tracker IS NULL AND blob.dropped_at_ms IS NULL
      AND NOT EXISTS (SELECT 1 FROM session AS other
                      WHERE other.video = blob.hash AND (other.created_at_ms >= $1 OR other.tracker IS NOT NULL))
      AND NOT EXISTS (SELECT 1 FROM job_file JOIN job ON job.id = job_file.job_id
                      WHERE job_file.blob = blob.hash AND job.state IN ('queued', 'running'))
    LIMIT $2";

const DROP_BLOB: &str = "UPDATE blob SET dropped_at_ms = $2 WHERE hash = $1";

const SELECT_SESSIONS_OF: &str = "SELECT id FROM session WHERE video = $1";

const SELECT_ENDED_PICTURES: &str = "
    SELECT 1 FROM job_file JOIN job ON job.id = job_id
    WHERE job.box_id IS NOT NULL AND job.state IN ('failed', 'quarantined') AND job.ended_at_ms <= $1 LIMIT 1";

const RELEASE_ENDED_PICTURES: &str = "
    DELETE FROM job_file WHERE job_id IN
        (SELECT id FROM job
         WHERE box_id IS NOT NULL AND state IN ('failed', 'quarantined') AND ended_at_ms <= $1)";

/// The marks of a job and those of the colours that it learned are the same.
const DELETE_SURROUNDINGS_OF_TRAINEE: &str = "
    DELETE FROM palette_surroundings WHERE palette_id IN
        (SELECT palette.id FROM job JOIN palette ON palette.box_id = job.box_id
         WHERE job.kind = 'palette'
           AND json_extract(job.input, '$.annotations') = json_extract(palette.annotations, '$')
           AND EXISTS (SELECT 1 FROM session
                       WHERE session.trainee_id = $1 AND instr(job.input, session.video) > 0))";

const DELETE_SURROUNDINGS_OF_SESSION: &str = "
    DELETE FROM palette_surroundings WHERE palette_id IN
        (SELECT palette.id FROM job JOIN palette ON palette.box_id = job.box_id
         WHERE job.kind = 'palette'
           AND json_extract(job.input, '$.annotations') = json_extract(palette.annotations, '$')
           AND EXISTS (SELECT 1 FROM session WHERE session.id = $1 AND instr(job.input, session.video) > 0))";

pub(super) const DELETE_BOX_JOBS_OF_TRAINEE: &str = "
    DELETE FROM job
    WHERE box_id IS NOT NULL AND EXISTS
        (SELECT 1 FROM session WHERE session.trainee_id = $1 AND instr(job.input, session.video) > 0)";

pub(super) const DELETE_BOX_JOBS_OF_SESSION: &str = "
    DELETE FROM job
    WHERE box_id IS NOT NULL AND EXISTS
        (SELECT 1 FROM session WHERE session.id = $1 AND instr(job.input, session.video) > 0)";

impl RetentionStore<'_> {
    /// The videos that could be dropped if those were due that arrived before this time: number and size in bytes.
    pub async fn old_videos(&self, before_ms: i64) -> StoreResult<(u64, u64)> {
        let rows = sqlx::query_as::<_, (BlobHash, i64)>(SELECT_OLD_VIDEOS).bind(before_ms).bind(-1_i64);
        let rows = rows.fetch_all(self.0.readers()).await?;
        Ok((rows.len() as u64, rows.iter().map(|(_, bytes)| bytes.unsigned_abs()).sum()))
    }

    /// Marks at most `most` videos of sessions that arrived before this time as dropped. Their files may then be deleted.
    pub async fn drop_videos(&self, before_ms: i64, most: u32) -> StoreResult<Vec<BlobHash>> {
        let old = sqlx::query_as::<_, (BlobHash, i64)>(SELECT_OLD_VIDEOS).bind(before_ms).bind(1_i64);
        if old.fetch_optional(self.0.readers()).await?.is_none() {
            return Ok(Vec::new()); // checked with a reader first, since every write costs a commit
        }
        let now_ms = self.0.now_ms();
        self.0
            .write(async move |tx| {
                let old = sqlx::query_as::<_, (BlobHash, i64)>(SELECT_OLD_VIDEOS).bind(before_ms).bind(most);
                let hashes: Vec<BlobHash> = old.fetch_all(&mut *tx).await?.into_iter().map(|(hash, _)| hash).collect();
                for hash in &hashes {
                    sqlx::query(DROP_BLOB).bind(*hash).bind(now_ms).execute(&mut *tx).await?;
                    let sessions: Vec<SessionId> =
                        sqlx::query_scalar(SELECT_SESSIONS_OF).bind(*hash).fetch_all(&mut *tx).await?;
                    for session in sessions {
                        note(tx, &Scope::service(), now_ms, ("delete video", "session"), session).await?;
                    }
                }
                Ok(hashes)
            })
            .await
    }

    /// Releases the pictures of boxes' jobs that failed before this time: until then such a job can be retried.
    pub async fn release_failed_pictures(&self, before_ms: i64) -> StoreResult<()> {
        let ended = sqlx::query(SELECT_ENDED_PICTURES).bind(before_ms);
        if ended.fetch_optional(self.0.readers()).await?.is_none() {
            return Ok(());
        }
        self.0
            .write(async move |tx| {
                sqlx::query(RELEASE_ENDED_PICTURES).bind(before_ms).execute(tx).await?;
                Ok(())
            })
            .await
    }
}

/// Deletes the boxes' jobs that read a recording of this trainee, and the grey pictures that they made of it, before the
/// trainee is erased. What was learned from it stays: numbers.
pub(super) async fn forget_box_jobs_of_trainee(tx: &mut SqliteConnection, trainee: TraineeId) -> StoreResult<()> {
    sqlx::query(DELETE_SURROUNDINGS_OF_TRAINEE).bind(trainee).execute(&mut *tx).await?;
    sqlx::query(DELETE_BOX_JOBS_OF_TRAINEE).bind(trainee).execute(tx).await?;
    Ok(())
}

/// Like [`forget_box_jobs_of_trainee`], before a session is erased.
pub(super) async fn forget_box_jobs_of_session(tx: &mut SqliteConnection, session: SessionId) -> StoreResult<()> {
    sqlx::query(DELETE_SURROUNDINGS_OF_SESSION).bind(session).execute(&mut *tx).await?;
    sqlx::query(DELETE_BOX_JOBS_OF_SESSION).bind(session).execute(tx).await?;
    Ok(())
}
