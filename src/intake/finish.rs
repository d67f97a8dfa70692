//! Turns a complete upload into a session: the file becomes a blob, then session and job are stored in one transaction,
//! then the file is deleted.

use tokio::io::AsyncReadExt;

use super::container::{HEAD_BYTES, media_type};
use super::{IntakeError, IntakeResult};
use crate::domain::blob::BlobHash;
use crate::domain::scope::Scope;
use crate::store::{FinishedUpload, Store, StoreError, UploadRecord};
use crate::vault::{Vault, VaultError};

/// Makes the session of a complete upload. Safe to repeat, also at start-up: completed steps are recognised.
pub async fn finish(
    store: &Store,
    vault: &Vault,
    scope: &Scope,
    upload: &UploadRecord,
) -> IntakeResult<FinishedUpload> {
    if let Some(finished) = upload.finished_before() {
        return Ok(finished);
    }
    let kept = match vault.keep_upload(upload.id).await {
        Ok(kept) => kept,
        // Another request has just finished it and deleted the file.
        Err(VaultError::NotFound) => return finished_already(store, scope, upload).await,
        Err(error) => return Err(error.into()),
    };
    let media_type = media_type_of(vault, kept.blob().hash).await?;
    let finished = store.uploads().finish(scope, upload.id, kept.blob(), media_type.to_owned()).await?;
    vault.delete_upload(upload.id).await?;
    Ok(finished)
}

async fn finished_already(store: &Store, scope: &Scope, upload: &UploadRecord) -> IntakeResult<FinishedUpload> {
    let finished = store.uploads().get(scope, upload.id).await?.finished_before();
    finished.ok_or(IntakeError::Store(StoreError::NotFound { what: "upload" }))
}

/// The media type of a stored recording.
pub(super) async fn media_type_of(vault: &Vault, hash: BlobHash) -> IntakeResult<&'static str> {
    let mut head = Vec::with_capacity(HEAD_BYTES);
    let mut reader = vault.open_range(hash, 0, HEAD_BYTES as u64).await?;
    // An unreadable file is not refused here: tracking it will report the problem.
    let _ = reader.read_to_end(&mut head).await;
    Ok(media_type(&head))
}
