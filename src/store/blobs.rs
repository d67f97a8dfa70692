//! Which files of the vault the database refers to. A file's row is written in the same transaction as the first
//! reference to it, or earlier for a file that may never get one. The row is deleted after the last reference. The file
//! exists before its row and is deleted after it.

use sqlx::sqlite::SqliteConnection;

use super::Store;
use super::columns::integer;
use super::error::StoreResult;
use crate::domain::blob::{Blob, BlobHash};

/// Access to the rows of files.
pub struct BlobStore<'s>(pub(super) &'s Store);

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

/// Adds a file's row if it is missing, in the transaction that refers to it.
pub(super) async fn record(tx: &mut SqliteConnection, blob: Blob, now_ms: i64) -> StoreResult<()> {
    sqlx::query(INSERT_BLOB).bind(blob.hash).bind(integer(blob.bytes)).bind(now_ms).execute(tx).await?;
    Ok(())
}
