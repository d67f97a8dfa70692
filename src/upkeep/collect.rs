//! Collection of files that nothing refers to any more, and of expired uploads.

use super::update_copy::release_in_update_copy;
use super::{Attempts, UpkeepResult};
use crate::domain::blob::BlobHash;
use crate::domain::scope::Scope;
use crate::store::Store;
use crate::vault::{Removal, Vault};

/// Items per query, so that no list grows without bound.
const ROUND: u32 = 500;

/// Removes the blobs that nothing refers to any more: row first, file second. Returns the number removed.
pub async fn collect(store: &Store, vault: &Vault) -> UpkeepResult<usize> {
    let (mut removed, mut attempts) = (0, Attempts::default());
    loop {
        let found = store.blobs().unreferenced(ROUND).await?;
        let before = removed;
        for hash in &found {
            removed += usize::from(attempts.note(remove(store, vault, *hash).await).unwrap_or(false));
        }
        if removed == before || found.len() < ROUND as usize {
            if removed > 0 {
                attempts.note(release_in_update_copy(vault).await);
            }
            return attempts.finish(removed); // the rest is just being put again, or cannot be removed
        }
    }
}

/// Removes the blobs that were put but never got a row: the person was erased meanwhile, or the disk was full. Returns
/// the number removed.
pub(super) async fn remove_unreferenced(store: &Store, vault: &Vault) -> UpkeepResult<usize> {
    let (mut removed, mut attempts) = (0, Attempts::default());
    for hash in vault.released() {
        // Most blobs have a row and need no removal here. A reader checks first, since every request to the writer
        // costs a commit.
        let is_free = async {
            UpkeepResult::Ok(!store.blobs().has(hash).await? && store.blobs().forget_if_unreferenced(hash).await?)
        };
        removed += usize::from(attempts.note(vault.delete_if(hash, is_free).await) == Some(Removal::Removed));
    }
    attempts.finish(removed)
}

/// Removes one blob, unless something refers to it or it is just being put.
pub(super) async fn remove(store: &Store, vault: &Vault, hash: BlobHash) -> UpkeepResult<bool> {
    let is_free = async { UpkeepResult::Ok(store.blobs().forget_if_unreferenced(hash).await?) };
    Ok(vault.delete_if(hash, is_free).await? == Removal::Removed)
}

/// Deletes expired uploads, finished and unfinished. Returns the number deleted.
pub async fn forget_expired_uploads(store: &Store, vault: &Vault) -> UpkeepResult<usize> {
    let expired = store.uploads().expired(ROUND).await?;
    let (mut deleted, mut attempts) = (0, Attempts::default());
    for id in &expired {
        let delete = async {
            store.uploads().delete(&Scope::service(), *id).await?;
            UpkeepResult::Ok(vault.delete_upload(*id).await?)
        };
        deleted += usize::from(attempts.note(delete.await).is_some());
    }
    attempts.finish(deleted)
}

/// Removes upload files without an unfinished row: the trainee was erased, or the upload became a session, whose blob
/// has a name of its own. Returns the number removed.
pub(super) async fn remove_orphan_uploads(store: &Store, vault: &Vault) -> UpkeepResult<usize> {
    let (mut removed, mut attempts) = (0, Attempts::default());
    for id in vault.upload_files().await? {
        if store.uploads().is_unfinished(id).await? {
            continue; // checked before the file is opened, since its sender would find it locked
        }
        let is_free = async { UpkeepResult::Ok(!store.uploads().is_unfinished(id).await?) };
        removed += usize::from(attempts.note(vault.delete_upload_if(id, is_free).await) == Some(Removal::Removed));
    }
    attempts.finish(removed)
}
