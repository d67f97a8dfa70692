//! Recovery, which runs at every start. Acknowledged data is never touched.

use super::UpkeepResult;
use super::collect::{collect, remove_orphan_uploads};
use super::orphans::OrphanFiles;
use super::update_copy::release_in_update_copy;
use crate::domain::scope::Scope;
use crate::intake::{self, IntakeError};
use crate::store::{Store, StoreError, UploadRecord};
use crate::vault::{Vault, VaultError};

/// The repairs of a recovery.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Recovered {
    /// Unfinished blobs that were removed.
    pub half_written: usize,
    /// Blobs that no row needs and that were removed.
    pub orphan_blobs: usize,
    /// Blobs without a row that were kept: there are too many for a crash.
    pub kept_orphans: usize,
    /// Upload files without a row that were removed.
    pub orphan_uploads: usize,
    /// Complete uploads that became sessions now.
    pub finished_uploads: usize,
    /// Uploads whose file is shorter than recorded: set back to its length. After a power cut, this happens only if the
    /// disk reported a sync as done before the bytes were safe.
    pub set_back_uploads: usize,
}

impl Recovered {
    /// Logs what was repaired.
    pub fn log(&self) {
        if *self == Self::default() {
            return tracing::info!("data folder checked after the last stop; nothing to repair");
        }
        let Self { half_written, orphan_blobs, kept_orphans, orphan_uploads, finished_uploads, set_back_uploads } =
            self;
        tracing::info!(
            half_written,
            orphan_blobs,
            kept_orphans,
            orphan_uploads,
            finished_uploads,
            set_back_uploads,
            "data folder repaired after the last stop"
        );
    }
}

/// Makes files and database consistent after a crash. Call it with the folder locked, before anything else uses it.
pub async fn recover(store: &Store, vault: &Vault) -> UpkeepResult<Recovered> {
    let mut recovered = Recovered { half_written: vault.clear_incoming().await?, ..Recovered::default() };
    recovered.orphan_uploads = remove_orphan_uploads(store, vault).await?;
    for upload in store.uploads().unfinished().await? {
        recover_upload(store, vault, upload, &mut recovered).await?;
    }
    let collected = collect(store, vault).await?;
    let [removed, kept] = OrphanFiles::find(store, vault).await?.delete_after_crash(store, vault).await?;
    (recovered.orphan_blobs, recovered.kept_orphans) = (collected + removed, kept);
    release_in_update_copy(vault).await?; // a crash may have come between a file and the copy
    Ok(recovered)
}

async fn recover_upload(
    store: &Store,
    vault: &Vault,
    upload: UploadRecord,
    recovered: &mut Recovered,
) -> UpkeepResult<()> {
    let there = match vault.upload_length(upload.id).await {
        Ok(there) => there,
        Err(VaultError::NotFound) => 0,
        Err(error) => return Err(error.into()),
    };
    if there < upload.received {
        tracing::error!(
            upload = %upload.id, noted = upload.received, there,
            "acknowledged bytes lost; upload set back; check the disk"
        );
        store.uploads().set_back(upload.id, there).await?;
        recovered.set_back_uploads += 1;
    } else if upload.received == upload.length {
        recovered.finished_uploads += usize::from(finish(store, vault, &upload).await?);
    }
    Ok(())
}

/// Makes the session of a complete upload, as its last request would have done.
async fn finish(store: &Store, vault: &Vault, upload: &UploadRecord) -> UpkeepResult<bool> {
    match intake::finish(store, vault, &Scope::service(), upload).await {
        Ok(finished) => Ok(finished.is_new),
        Err(IntakeError::Store(StoreError::Refused { .. } | StoreError::ConsentMissing { .. })) => Ok(false), // its sender gets the error
        Err(IntakeError::Store(error)) => Err(error.into()),
        Err(IntakeError::Vault(error)) => Err(error.into()),
        Err(other) => {
            tracing::warn!(upload = %upload.id, error = %other, "complete upload did not become a session");
            Ok(false)
        }
    }
}
