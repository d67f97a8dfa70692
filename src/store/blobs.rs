//! Which files of the vault the database refers to. A file's row is written in the same transaction as the first
//! reference to it, or earlier for a file that may never get one. The row is deleted after the last reference. The file
//! exists before its row and is deleted after it.

use std::fmt;

use sqlx::sqlite::SqliteConnection;

use super::columns::integer;
use super::error::StoreResult;
use super::visibility::require_administrator;
use super::{Scope, Store};
use crate::domain::blob::{Blob, BlobHash};
use crate::domain::text::Code;
use crate::ids::SessionId;

/// Access to the rows of files.
pub struct BlobStore<'s>(pub(super) &'s Store);

/// A session, or a box without a session, that refers to a file. It is shown as a phrase for people.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct BlobUse {
    /// What the file is, such as `recording` or `path`; several joined by commas.
    pub parts: String,
    /// The session; `None`: the file belongs to a box.
    pub session_id: Option<SessionId>,
    /// Code of the session's trainee.
    pub trainee: Option<Code>,
    /// Code of the session's task.
    pub task: Option<Code>,
    /// Code of the box.
    pub box_code: Option<Code>,
}

/// Most uses of one file that are read. A recording has more only if it was sent for many trainees or tasks.
const MAX_USES: u32 = 20;

const SELECT_USES: &str = "
    SELECT replace(group_concat(DISTINCT part), ',', ', ') AS parts, found.session_id, trainee.code AS trainee,
           task.code AS task, training_box.code AS box_code
    FROM (SELECT iif(tracker IS NULL, 'recording', 'table') AS part, id AS session_id, CAST(NULL AS TEXT) AS box_id
          FROM session WHERE video = $1
          UNION ALL SELECT 'path', session_id, NULL FROM result WHERE trajectory = $1
          UNION ALL SELECT 'diagnostics', session_id, NULL FROM result WHERE diagnostics = $1
          UNION ALL SELECT 'preview', session_id, NULL FROM result WHERE preview = $1
          UNION ALL SELECT 'part of a recording without a name', NULL, box_id
          FROM waiting_recording WHERE $1 IN (video, preview)
          UNION ALL SELECT 'file of a ' || kind || ' job', session_id, box_id
          FROM job_file JOIN job ON job.id = job_file.job_id
          WHERE job_file.blob = $1 AND NOT EXISTS
              (SELECT 1 FROM session LEFT JOIN result ON result.session_id = session.id
               WHERE session.id = job.session_id AND $1 IN (session.video, result.trajectory))) AS found
    LEFT JOIN session ON session.id = found.session_id
    LEFT JOIN trainee ON trainee.id = session.trainee_id
    LEFT JOIN task ON task.id = session.task_id
    LEFT JOIN training_box ON training_box.id = coalesce(session.box_id, found.box_id)
    GROUP BY found.session_id, found.box_id ORDER BY found.session_id, found.box_id LIMIT $2";

const SELECT_UNREFERENCED: &str = "
    SELECT hash FROM blob WHERE hash NOT IN (SELECT hash FROM blob_reference) LIMIT $1";

const DELETE_IF_UNREFERENCED: &str = "
    DELETE FROM blob WHERE hash = $1 AND hash NOT IN (SELECT hash FROM blob_reference)";

const SELECT_BLOB: &str = "SELECT 1 FROM blob WHERE hash = $1 AND dropped_at_ms IS NULL";

const SELECT_IS_DROPPED: &str = "SELECT dropped_at_ms IS NOT NULL FROM blob WHERE hash = $1";

const SELECT_TOTAL: &str = "SELECT count(*), coalesce(sum(bytes), 0) FROM blob WHERE dropped_at_ms IS NULL";

const SELECT_BLOBS: &str = "
    SELECT hash, bytes FROM blob WHERE dropped_at_ms IS NULL AND ($1 IS NULL OR hash > $1) ORDER BY hash LIMIT $2";

/// A file that was dropped and is put again is there again.
const INSERT_BLOB: &str = "
    INSERT INTO blob (hash, bytes, created_at_ms) VALUES ($1, $2, $3)
    ON CONFLICT (hash) DO UPDATE SET dropped_at_ms = NULL WHERE dropped_at_ms IS NOT NULL";

impl BlobStore<'_> {
    /// Files that nothing refers to any more, at most `most` of them.
    pub async fn unreferenced(&self, most: u32) -> StoreResult<Vec<BlobHash>> {
        Ok(sqlx::query_scalar(SELECT_UNREFERENCED).bind(most).fetch_all(self.0.readers()).await?)
    }

    /// Deletes a file's row unless something refers to it; `true` if nothing needs the file, so that it may be deleted. The
    /// row of a dropped file stays with its sessions.
    pub async fn forget_if_unreferenced(&self, hash: BlobHash) -> StoreResult<bool> {
        self.0
            .write_with_delete_reserve(|| {
                async move |tx| {
                    sqlx::query(DELETE_IF_UNREFERENCED).bind(hash).execute(&mut *tx).await?;
                    let left: Option<i64> = sqlx::query_scalar(SELECT_BLOB).bind(hash).fetch_optional(tx).await?;
                    Ok(left.is_none())
                }
            })
            .await
    }

    /// Adds a row for a file that nothing refers to yet. If no reference follows, the file is collected.
    pub async fn note(&self, blob: Blob) -> StoreResult<()> {
        let now_ms = self.0.now_ms();
        self.0.write(async move |tx| record(tx, blob, now_ms).await).await
    }

    /// Is there a row for this file, and should the file be there?
    pub async fn has(&self, hash: BlobHash) -> StoreResult<bool> {
        let found: Option<i64> = sqlx::query_scalar(SELECT_BLOB).bind(hash).fetch_optional(self.0.readers()).await?;
        Ok(found.is_some())
    }

    /// Is the file's row marked as dropped? `None` if no row names the file.
    pub async fn is_dropped(&self, hash: BlobHash) -> StoreResult<Option<bool>> {
        Ok(sqlx::query_scalar(SELECT_IS_DROPPED).bind(hash).fetch_optional(self.0.readers()).await?)
    }

    /// The sessions and boxes that refer to a file, at most 20.
    pub async fn uses(&self, scope: &Scope, hash: BlobHash) -> StoreResult<Vec<BlobUse>> {
        require_administrator(scope, "the use of a file")?;
        let uses = sqlx::query_as(SELECT_USES).bind(hash).bind(MAX_USES);
        Ok(uses.fetch_all(self.0.readers()).await?)
    }

    /// The number of files and their total size in bytes: no personal data.
    pub async fn total(&self) -> StoreResult<(u64, u64)> {
        let (files, bytes): (i64, i64) = sqlx::query_as(SELECT_TOTAL).fetch_one(self.0.readers()).await?;
        Ok((files.unsigned_abs(), bytes.unsigned_abs()))
    }

    /// Every file that should be in the vault, by hash; `after` continues.
    pub async fn all(&self, after: Option<BlobHash>, most: u32) -> StoreResult<Vec<Blob>> {
        let rows: Vec<(BlobHash, i64)> =
            sqlx::query_as(SELECT_BLOBS).bind(after).bind(most).fetch_all(self.0.readers()).await?;
        Ok(rows.into_iter().map(|(hash, bytes)| Blob { hash, bytes: bytes.unsigned_abs() }).collect())
    }
}

impl fmt::Display for BlobUse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.parts)?;
        if let Some(session) = self.session_id {
            write!(f, " of session {session}")?;
        }
        let codes = [("trainee", &self.trainee), ("task", &self.task), ("box", &self.box_code)];
        let named: Vec<String> =
            codes.iter().filter_map(|(what, code)| Some(format!("{what} {}", code.as_ref()?))).collect();
        if named.is_empty() { Ok(()) } else { write!(f, " ({})", named.join(", ")) }
    }
}

/// Adds a file's row if it is missing, in the transaction that refers to it.
pub(super) async fn record(tx: &mut SqliteConnection, blob: Blob, now_ms: i64) -> StoreResult<()> {
    sqlx::query(INSERT_BLOB).bind(blob.hash).bind(integer(blob.bytes)).bind(now_ms).execute(tx).await?;
    Ok(())
}
