//! Reads rows of stored paths and diagnostics from the disk, without the whole file in memory.
//!
//! Neither format has an index. The first reader of a file therefore verifies it, passes over all of its rows and notes
//! where every thousandth begins; a path of an hour gives 10 kB. Blobs never change, so [`StoredIndexes`] keeps the
//! indexes of the files that were read last. This needs no other format, so files of earlier releases are read in the
//! same way.

mod diagnostics;
mod paths;
mod window;

use std::collections::VecDeque;
use std::fs::File;
use std::sync::{Arc, Mutex, PoisonError};

pub use diagnostics::{DiagnosticsError, DiagnosticsPieces, NameAt, StoredDiagnostics};
pub use paths::{StoredPathRows, StoredPaths};

use super::paths::PathsError;
use crate::domain::blob::BlobHash;
use crate::vault::{Vault, VaultError};
use diagnostics::DiagnosticsIndex;
use paths::PathIndex;

/// Rows between two places that an index notes.
const ROWS_PER_BLOCK: u64 = 1024;

/// Maximum number of indexes of each kind that are kept; they take at most some megabytes.
const MAX_INDEXES: usize = 64;

/// Why a stored file cannot be read by rows.
#[derive(Debug, thiserror::Error)]
pub enum StoredRowsError {
    /// The vault fails, or the file is damaged.
    #[error(transparent)]
    Vault(#[from] VaultError),
    /// Not a file of paths.
    #[error(transparent)]
    Paths(#[from] PathsError),
    /// Not a file of diagnostics.
    #[error(transparent)]
    Diagnostics(#[from] DiagnosticsError),
    /// The thread that read the file ended.
    #[error("reading a stored file was interrupted")]
    Interrupted,
}

/// Opens stored files by their indexes. Clones share the indexes.
#[derive(Clone, Debug, Default)]
pub struct StoredIndexes {
    paths: IndexCache<PathIndex>,
    diagnostics: IndexCache<DiagnosticsIndex>,
}

impl StoredIndexes {
    /// Opens a blob of paths.
    ///
    /// # Errors
    /// The blob cannot be read, is damaged, or holds something else.
    pub async fn open_paths(&self, vault: &Vault, hash: BlobHash) -> Result<StoredPaths, StoredRowsError> {
        let (file, index) = self.paths.open(vault, hash, |file| Ok(PathIndex::build(file)?)).await?;
        Ok(StoredPaths::new(file, index))
    }

    /// Opens a blob of diagnostics.
    ///
    /// # Errors
    /// The blob cannot be read, is damaged, or holds something else.
    pub async fn open_diagnostics(&self, vault: &Vault, hash: BlobHash) -> Result<StoredDiagnostics, StoredRowsError> {
        let (file, index) = self.diagnostics.open(vault, hash, |file| Ok(DiagnosticsIndex::build(file)?)).await?;
        Ok(StoredDiagnostics::new(file, index))
    }
}

/// The indexes of one kind that were used last, the latest first.
type RecentIndexes<T> = VecDeque<(BlobHash, Arc<T>)>;

/// Keeps the indexes of one kind; clones share them.
#[derive(Debug)]
struct IndexCache<T>(Arc<Mutex<RecentIndexes<T>>>);

impl<T> Clone for IndexCache<T> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<T> Default for IndexCache<T> {
    fn default() -> Self {
        Self(Arc::default())
    }
}

impl<T: Send + Sync + 'static> IndexCache<T> {
    /// Opens a blob with its index. `build` makes an index that is not kept.
    async fn open(
        &self,
        vault: &Vault,
        hash: BlobHash,
        build: impl FnOnce(Arc<File>) -> Result<T, StoredRowsError> + Send + 'static,
    ) -> Result<(Arc<File>, Arc<T>), StoredRowsError> {
        if let Some(index) = self.find(hash) {
            let (file, _) = vault.open_blob(hash).await?;
            return Ok((Arc::new(file), index));
        }
        let file = Arc::new(vault.open_verified(hash).await?);
        let opened = file.clone();
        let built = tokio::task::spawn_blocking(move || build(file)).await;
        let index = Arc::new(built.map_err(|_| StoredRowsError::Interrupted)??);
        self.keep(hash, index.clone());
        Ok((opened, index))
    }

    fn find(&self, hash: BlobHash) -> Option<Arc<T>> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let at = kept.iter().position(|(of, _)| *of == hash)?;
        let found = kept.remove(at)?;
        let index = found.1.clone();
        kept.push_front(found);
        Some(index)
    }

    fn keep(&self, hash: BlobHash, index: Arc<T>) {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        kept.retain(|(of, _)| *of != hash);
        kept.push_front((hash, index));
        kept.truncate(MAX_INDEXES);
    }
}

#[cfg(test)]
pub(super) mod tests;
