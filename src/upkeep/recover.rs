//! Recovery: every start is one. Nothing that was acknowledged is touched.

use super::UpkeepResult;
use super::collect::{collect, remove, remove_orphan_uploads};
use crate::domain::scope::Scope;
use crate::intake::{self, IntakeError};
use crate::store::{Store, StoreError, Upload};
use crate::vault::{Vault, VaultError};

/// What a start found and put right.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Recovered {
    /// Half-written blobs, removed.
    pub half_written: usize,
    /// Blobs that no row refers to, removed.
    pub orphan_blobs: usize,
    /// Files of uploads that have no row, removed.
    pub orphan_uploads: usize,
    /// Whole uploads that had not become sessions yet, and now have.
    pub finished_uploads: usize,
    /// Uploads whose file is shorter than was noted: set back to what is there. After a power cut on an honest disk there
    /// are none.
    pub set_back_uploads: usize,
}

/// Puts files and database in step after a sudden end. Call it with the folder locked, before anything else uses it.
pub async fn recover(store: &Store, vault: &Vault) -> UpkeepResult<Recovered> {
    let mut recovered = Recovered { half_written: vault.clear_incoming().await?, ..Recovered::default() };
    recovered.orphan_uploads = remove_orphan_uploads(store, vault).await?;
    for upload in store.uploads().unfinished().await? {
        recover_upload(store, vault, upload, &mut recovered).await?;
    }
    recovered.orphan_blobs = collect(store, vault).await? + remove_orphan_blobs(store, vault).await?;
    Ok(recovered)
}

async fn recover_upload(store: &Store, vault: &Vault, upload: Upload, recovered: &mut Recovered) -> UpkeepResult<()> {
    let there = match vault.upload_length(upload.id).await {
        Ok(there) => there,
        Err(VaultError::NotFound) => 0,
        Err(error) => return Err(error.into()),
    };
    if there < upload.received {
        tracing::error!(upload = %upload.id, noted = upload.received, there, "an upload has lost acknowledged bytes");
        store.uploads().set_back(upload.id, there).await?;
        recovered.set_back_uploads += 1;
    } else if upload.received == upload.length {
        recovered.finished_uploads += usize::from(finish(store, vault, &upload).await?);
    }
    Ok(())
}

/// Makes the session of a whole upload, as its last request would have done.
async fn finish(store: &Store, vault: &Vault, upload: &Upload) -> UpkeepResult<bool> {
    match intake::finish(store, vault, &Scope::service(), upload).await {
        Ok(finished) => Ok(finished.is_new),
        Err(IntakeError::Store(StoreError::Refused { .. })) => Ok(false), // its sender will be told
        Err(IntakeError::Store(error)) => Err(error.into()),
        Err(IntakeError::Vault(error)) => Err(error.into()),
        Err(other) => {
            tracing::warn!(upload = %upload.id, error = %other, "a whole upload did not become a session");
            Ok(false)
        }
    }
}

/// Blobs that got their name but never a row: found only by looking at the folder.
async fn remove_orphan_blobs(store: &Store, vault: &Vault) -> UpkeepResult<usize> {
    let mut removed = 0;
    for first in 0..=u8::MAX {
        for blob in vault.blobs(first).await? {
            removed += usize::from(remove(store, vault, blob.hash).await?);
        }
    }
    Ok(removed)
}
