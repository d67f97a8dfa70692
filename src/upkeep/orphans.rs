//! Files in the vault that no row of the database needs.
//!
//! A crash between a file and its row leaves a few. Many of them have another cause: the database is older than the
//! files, or of another folder, and the right one still names them. So only a few are deleted without a question.

use super::UpkeepResult;
use super::collect::remove;
use super::update_copy::release_in_update_copy;
use crate::domain::blob::BlobHash;
use crate::store::Store;
use crate::vault::Vault;

/// Files that a crash leaves at most: those that are stored at that moment. A machine with eight cores has four
/// workers, each storing the three files of a result, and four recordings may arrive.
const MAX_OF_CRASH: usize = 16;
/// The same for one worker and one recording. In a new centre they may be most of all files.
const FEW: usize = 4;

/// The files that no row needs.
pub(super) struct OrphanFiles {
    /// Files whose row says that they were dropped.
    pub dropped: Vec<BlobHash>,
    /// Files that no row names.
    pub unnamed: Vec<BlobHash>,
    /// Number of all files in the vault.
    pub files: usize,
}

impl OrphanFiles {
    /// Finds them; this is possible only by listing all files.
    pub async fn find(store: &Store, vault: &Vault) -> UpkeepResult<Self> {
        let mut found = Self { dropped: Vec::new(), unnamed: Vec::new(), files: 0 };
        for first in 0..=u8::MAX {
            for blob in vault.blobs(first).await? {
                found.files += 1;
                match store.blobs().is_dropped(blob.hash).await? {
                    Some(false) => {}
                    Some(true) => found.dropped.push(blob.hash),
                    None => found.unnamed.push(blob.hash),
                }
            }
        }
        Ok(found)
    }

    /// True if a crash may have left the unnamed files: they are few, and not most of all files.
    pub fn are_of_crash(&self) -> bool {
        let unnamed = self.unnamed.len();
        unnamed <= FEW || (unnamed <= MAX_OF_CRASH && 2 * unnamed <= self.files)
    }

    /// Deletes all of them. Returns the number deleted.
    pub async fn delete(&self, store: &Store, vault: &Vault) -> UpkeepResult<usize> {
        delete_files(store, vault, self.dropped.iter().chain(&self.unnamed)).await
    }

    /// Deletes those that the service needs no answer for. Returns the numbers of files deleted and kept.
    pub async fn delete_after_crash(&self, store: &Store, vault: &Vault) -> UpkeepResult<[usize; 2]> {
        if self.are_of_crash() {
            return Ok([self.delete(store, vault).await?, 0]);
        }
        tracing::error!(
            orphans = self.unnamed.len(),
            files = self.files,
            "no row of the database names these files; they are kept, because the database is probably older than they \
             are or of another folder, or their deletion failed earlier (see the log): stop the service and put the \
             right database back, or restore a backup; if this database is the right one, stop the service and run \
             `trocar admin delete-orphans`"
        );
        Ok([delete_files(store, vault, &self.dropped).await?, self.unnamed.len()])
    }
}

/// Deletes all files that no row needs: with a person's order, or in a folder that this program has just made. The
/// service must not run on the folder: it stores each file before its row. Returns the number deleted.
pub async fn delete_orphans(store: &Store, vault: &Vault) -> UpkeepResult<usize> {
    let deleted = OrphanFiles::find(store, vault).await?.delete(store, vault).await?;
    release_in_update_copy(vault).await?;
    Ok(deleted)
}

async fn delete_files(store: &Store, vault: &Vault, files: impl IntoIterator<Item = &BlobHash>) -> UpkeepResult<usize> {
    let mut deleted = 0;
    for hash in files {
        deleted += usize::from(remove(store, vault, *hash).await?);
    }
    Ok(deleted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::blob::Blob;

    #[test]
    fn a_crash_leaves_few_files_that_are_not_most_of_all() {
        let cases = [(0, 0, true), (4, 4, true), (5, 9, false), (5, 10, true), (16, 32, true), (17, 100_000, false)];
        for (unnamed, files, expected) in cases {
            let unnamed: Vec<BlobHash> = (0..unnamed).map(|number: u8| Blob::of(&[number]).hash).collect();
            let found = OrphanFiles { dropped: Vec::new(), unnamed, files };
            assert_eq!(found.are_of_crash(), expected, "{} of {files}", found.unnamed.len());
        }
    }
}
