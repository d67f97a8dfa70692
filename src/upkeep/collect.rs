//! Collecting: files that nothing refers to any more, uploads whose time is over.

use super::UpkeepResult;
use crate::domain::blob::BlobHash;
use crate::domain::scope::Scope;
use crate::store::Store;
use crate::vault::{Removal, Vault};

/// Items handled per round, so that no list grows without bound.
const ROUND: u32 = 500;

/// Removes the blobs that no row refers to any more: row first, file second. Returns how many went.
pub async fn collect(store: &Store, vault: &Vault) -> UpkeepResult<usize> {
    let mut removed = 0;
    loop {
        let found = store.blobs().unreferenced(ROUND).await?;
        let before = removed;
        for hash in &found {
            removed += usize::from(remove(store, vault, *hash).await?);
        }
        if removed == before || found.len() < ROUND as usize {
            return Ok(removed); // what is left is being put again at this moment
        }
    }
}

/// Removes the blobs that were put and whose row never came: the person was erased meanwhile, or the disk was full. Returns
/// how many went.
pub(super) async fn remove_unnamed(store: &Store, vault: &Vault) -> UpkeepResult<usize> {
    let mut removed = 0;
    for hash in vault.released() {
        // Most have their row, and go with it; it is read first, since asking the writer costs a commit.
        let is_free = async {
            UpkeepResult::Ok(!store.blobs().has(hash).await? && store.blobs().forget_if_unreferenced(hash).await?)
        };
        removed += usize::from(vault.delete_if(hash, is_free).await? == Removal::Removed);
    }
    Ok(removed)
}

/// Removes one blob, unless something refers to it or somebody is just putting it.
pub(super) async fn remove(store: &Store, vault: &Vault, hash: BlobHash) -> UpkeepResult<bool> {
    let is_free = async { UpkeepResult::Ok(store.blobs().forget_if_unreferenced(hash).await?) };
    Ok(vault.delete_if(hash, is_free).await? == Removal::Removed)
}

/// Forgets the uploads that nobody has gone on with in time, and the finished ones that nobody asks about any more. Returns
/// how many went.
pub async fn forget_expired_uploads(store: &Store, vault: &Vault) -> UpkeepResult<usize> {
    let expired = store.uploads().expired(ROUND).await?;
    for id in &expired {
        store.uploads().delete(&Scope::service(), *id).await?;
        vault.delete_upload(*id).await?;
    }
    Ok(expired.len())
}

/// Removes the files of uploads that have no row: erased with their trainee, or become a session, whose blob has a name of
/// its own. Returns how many went.
pub(super) async fn remove_orphan_uploads(store: &Store, vault: &Vault) -> UpkeepResult<usize> {
    let mut removed = 0;
    for id in vault.upload_files().await? {
        if store.uploads().is_unfinished(id).await? {
            continue; // asked before the file is taken, which its sender would be told of as locked
        }
        let is_free = async { UpkeepResult::Ok(!store.uploads().is_unfinished(id).await?) };
        removed += usize::from(vault.delete_upload_if(id, is_free).await? == Removal::Removed);
    }
    Ok(removed)
}
