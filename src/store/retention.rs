//! Videos that are older than the centre keeps them, and pictures of boxes that no job needs any more. The path and the
//! features of a session stay.

use sqlx::Sqlite;
use sqlx::query::QueryAs;
use sqlx::sqlite::{SqliteArguments, SqliteConnection};

use super::audit::note;
use super::error::StoreResult;
use super::{Scope, Store};
use crate::domain::blob::BlobHash;
use crate::ids::{SessionId, TraineeId};

/// Access to what is kept for a limited time.
pub struct RetentionStore<'s>(pub(super) &'s Store);

/// Selects at most `$3` videos all of whose sessions have been kept for long enough at `$1`, unless a job still has to
/// read one. `$2` are the months of the centre ([`kept_months`](crate::domain::personal_retention::kept_months) is the
/// same rule). With trainee `$4`, only their videos, as if they were kept for `$5` months. 2,629,800,000 ms are a month. `CROSS JOIN`: SQLite
/// begins with the sessions, not with all files.
pub(super) const SELECT_OLD_VIDEOS: &str = "
    WITH kept (trainee_id, months) AS (
        SELECT trainee.id, CASE WHEN trainee.id = $4 THEN $5
                                WHEN own.months IS NULL THEN $2
                                WHEN own.reason IS NOT NULL OR $2 = 0 THEN own.months
                                WHEN own.months = 0 THEN $2
                                ELSE min(own.months, $2) END
        FROM trainee LEFT JOIN merged_trainee AS merged ON merged.trainee_id = trainee.id
        LEFT JOIN trainee_retention AS own ON own.trainee_id = coalesce(merged.kept_id, trainee.id))
    SELECT DISTINCT blob.hash, blob.bytes
    FROM session CROSS JOIN blob ON blob.hash = session.video JOIN kept ON kept.trainee_id = session.trainee_id
    WHERE session.created_at_ms < $1 - 2629800000 * (SELECT min(any_kept.months) FROM kept AS any_kept
                                                     WHERE any_kept.months > 0)
      AND kept.months > 0 AND session.created_at_ms < $1 - 2629800000 * kept.months
      AND ($4 IS NULL OR session.trainee_id = $4)
      AND session.tracker IS NULL AND blob.dropped_at_ms IS NULL
      AND NOT EXISTS (SELECT 1 FROM session AS other JOIN kept AS other_kept ON other_kept.trainee_id = other.trainee_id
                      WHERE other.video = blob.hash
                        AND (other.tracker IS NOT NULL OR other_kept.months = 0
                             OR other.created_at_ms >= $1 - 2629800000 * other_kept.months))
      AND NOT EXISTS (SELECT 1 FROM waiting_recording WHERE waiting_recording.video = blob.hash)
      AND NOT EXISTS (SELECT 1 FROM job_file JOIN job ON job.id = job_file.job_id
                      WHERE job_file.blob = blob.hash AND job.state IN ('queued', 'running'))
    LIMIT $3";

/// True if a trainee's own months limit how long videos are kept.
const SELECT_HAS_PERSONAL: &str = "SELECT EXISTS (SELECT 1 FROM trainee_retention WHERE months > 0)";

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

/// When videos are due: the time, and the months for which the centre keeps them; 0: it keeps them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VideoAge {
    /// The time, epoch ms.
    pub now_ms: i64,
    /// The centre's months.
    pub centre_months: u32,
}

type OldVideos = QueryAs<'static, Sqlite, (BlobHash, i64), SqliteArguments>;

impl VideoAge {
    /// Binds the first three parameters of [`SELECT_OLD_VIDEOS`].
    pub(super) fn bind(self, query: OldVideos, most: i64) -> OldVideos {
        query.bind(self.now_ms).bind(self.centre_months).bind(most)
    }

    /// Selects at most `most` videos of all trainees; negative: all.
    fn of_all(self, most: i64) -> OldVideos {
        self.bind(sqlx::query_as(SELECT_OLD_VIDEOS), most).bind(None::<TraineeId>).bind(None::<u32>)
    }
}

impl RetentionStore<'_> {
    /// The videos that are due: number and size in bytes.
    pub async fn old_videos(&self, age: VideoAge) -> StoreResult<(u64, u64)> {
        if !self.limits_any(age).await? {
            return Ok((0, 0));
        }
        let rows = age.of_all(-1).fetch_all(self.0.readers()).await?;
        Ok((rows.len() as u64, rows.iter().map(|(_, bytes)| bytes.unsigned_abs()).sum()))
    }

    /// Marks at most `most` videos that are due as dropped. Their files may then be deleted.
    pub async fn drop_videos(&self, age: VideoAge, most: u32) -> StoreResult<Vec<BlobHash>> {
        // Checked with a reader first, since every write costs a commit.
        if !self.limits_any(age).await? || age.of_all(1).fetch_optional(self.0.readers()).await?.is_none() {
            return Ok(Vec::new());
        }
        let now_ms = self.0.now_ms();
        self.0
            .write(async move |tx| {
                let old = age.of_all(i64::from(most)).fetch_all(&mut *tx).await?;
                let hashes: Vec<BlobHash> = old.into_iter().map(|(hash, _)| hash).collect();
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

    /// True if any videos are kept for a limited time.
    async fn limits_any(&self, age: VideoAge) -> StoreResult<bool> {
        Ok(age.centre_months > 0 || sqlx::query_scalar(SELECT_HAS_PERSONAL).fetch_one(self.0.readers()).await?)
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
