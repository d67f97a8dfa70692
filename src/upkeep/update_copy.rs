//! The copy of the database that a start makes before it adapts the database to a newer program: the way back.
//!
//! Only the newest copy is kept, for [`KEPT_MS`]. People who are erased meanwhile are erased in it, too, and it forgets
//! the files of jobs that are deleted meanwhile. A copy that cannot be changed is deleted.

use std::fs::{self, DirBuilder, File, Permissions};
use std::io;
use std::os::unix::fs::{DirBuilderExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use super::erasure_list::erasures_after;
use super::{UpkeepError, UpkeepResult};
use crate::store::{Store, StoreError, StoreResult, StoreSettings};
use crate::vault::{Vault, VaultError};

/// Folder of the copy in the data folder.
pub const UPDATE_COPY_FOLDER: &str = "before-update";
/// File name of a copy that is being made.
const PARTIAL: &str = "partial";
/// Time for which a copy is kept, ms: a centre that has worked with the new program for a month would lose more by
/// going back than by waiting for a correction.
const KEPT_MS: i64 = 30 * 86_400_000;

/// Copies a database whose schema is about to change. The copy replaces an earlier one and is durable when this
/// returns.
///
/// # Errors
/// The disk lacks the space. Nothing was changed.
pub(super) async fn copy_before_update(vault: &Vault, database: &Path, settings: &StoreSettings) -> UpkeepResult<()> {
    let needed = space_for_update(database)?;
    let free = vault.free_bytes().await?;
    if free < needed {
        return Err(UpkeepError::NoSpaceForCopy { folder: vault.folder().to_owned(), needed, free: Some(free) });
    }
    let folder = vault.folder().join(UPDATE_COPY_FOLDER);
    DirBuilder::new().recursive(true).mode(0o700).create(&folder).map_err(copy_error(&folder))?;
    let (partial, copy) = (folder.join(PARTIAL), copy_path(vault, database));
    match Store::copy_file(database, settings, &partial).await {
        Err(StoreError::DiskFull) => {
            let _ = fs::remove_file(&partial); // if it fails, the next start writes it anew
            return Err(UpkeepError::NoSpaceForCopy { folder: vault.folder().to_owned(), needed, free: None });
        }
        copied => copied?,
    }
    let finish = || {
        fs::set_permissions(&partial, Permissions::from_mode(0o600))?;
        fs::rename(&partial, &copy)?;
        File::open(&folder)?.sync_all()?;
        File::open(vault.folder())?.sync_all()
    };
    finish().map_err(copy_error(&folder))?;
    tracing::info!(copy = %copy.display(), "database copied; now adapting it to this program");
    Ok(())
}

/// Erases in the copy, if there is one, the people and recordings that are erased in the database.
pub(super) async fn erase_in_update_copy(store: &Store, vault: &Vault) -> UpkeepResult<()> {
    let Some(copy) = find_copy(vault)? else { return Ok(()) };
    let erasures: Vec<_> = erasures_after(store, 0).await?.into_iter().map(|(_, erasure)| erasure).collect();
    if erasures.is_empty() {
        return Ok(());
    }
    let made = modified(&copy)?;
    let erased = Store::erase_in_copy(&copy, &erasures).await;
    keep_if_changed(vault, &copy, made, erased)
}

/// Removes from the copy, if there is one, the files of jobs that were deleted since it was made: the earlier program
/// would report them as lost, and make no backup any more. Call it after files were deleted.
pub(super) async fn release_in_update_copy(vault: &Vault) -> UpkeepResult<()> {
    let Some(copy) = find_copy(vault)? else { return Ok(()) };
    let made = modified(&copy)?;
    let released = release_deleted_files(vault, &copy).await;
    keep_if_changed(vault, &copy, made, released)
}

async fn release_deleted_files(vault: &Vault, copy: &Path) -> StoreResult<()> {
    let mut deleted = Vec::new();
    for hash in Store::files_of_copy(copy).await? {
        if matches!(vault.open_blob(hash).await, Err(VaultError::NotFound)) {
            deleted.push(hash);
        }
    }
    if deleted.is_empty() { Ok(()) } else { Store::release_in_copy(copy, &deleted).await }
}

/// True if there is a copy.
pub(super) fn has_update_copy(vault: &Vault) -> UpkeepResult<bool> {
    Ok(find_copy(vault)?.is_some())
}

/// Deletes a copy that could not be changed. Else its file keeps its time, which counts for [`KEPT_MS`].
fn keep_if_changed(vault: &Vault, copy: &Path, made: SystemTime, changed: StoreResult<()>) -> UpkeepResult<()> {
    if let Err(error) = changed {
        tracing::warn!(%error, copy = %copy.display(), "erased data not removed from the copy; copy deleted");
        return remove_copy(vault);
    }
    if modified(copy)? != made {
        let opened = File::options().write(true).open(copy);
        opened.and_then(|file| file.set_modified(made)).map_err(copy_error(copy))?;
    }
    Ok(())
}

fn modified(copy: &Path) -> UpkeepResult<SystemTime> {
    fs::metadata(copy).and_then(|found| found.modified()).map_err(copy_error(copy))
}

/// Deletes a copy whose time is over.
pub(super) fn forget_old_update_copy(vault: &Vault, now_ms: i64) -> UpkeepResult<()> {
    let Some(copy) = find_copy(vault)? else { return Ok(()) };
    let made_ms = modified(&copy)?.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis() as i64);
    if now_ms - made_ms > KEPT_MS {
        remove_copy(vault)?;
        tracing::info!(copy = %copy.display(), "copy from before the update is 30 days old; deleted");
    }
    Ok(())
}

fn copy_path(vault: &Vault, database: &Path) -> PathBuf {
    vault.folder().join(UPDATE_COPY_FOLDER).join(database.file_name().unwrap_or_default())
}

/// The finished copy, if there is one.
fn find_copy(vault: &Vault) -> UpkeepResult<Option<PathBuf>> {
    let folder = vault.folder().join(UPDATE_COPY_FOLDER);
    let entries = match fs::read_dir(&folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        entries => entries.map_err(copy_error(&folder))?,
    };
    for entry in entries {
        let path = entry.map_err(copy_error(&folder))?.path();
        // SQLite's journal is beside the copy during an erasure.
        let is_copy = |name: &str| name != PARTIAL && !name.ends_with("-journal");
        if path.file_name().and_then(|name| name.to_str()).is_some_and(is_copy) {
            return Ok(Some(path));
        }
    }
    Ok(None)
}

fn remove_copy(vault: &Vault) -> UpkeepResult<()> {
    let folder = vault.folder().join(UPDATE_COPY_FOLDER);
    fs::remove_dir_all(&folder).map_err(copy_error(&folder))
}

/// Bytes for the copy, and as many for the write-ahead log while the schema changes.
fn space_for_update(database: &Path) -> UpkeepResult<u64> {
    let bytes = fs::metadata(database).map_err(copy_error(database))?.len();
    let mut log = database.as_os_str().to_owned();
    log.push("-wal");
    let log = fs::metadata(log).map_or(0, |log| log.len());
    Ok(2 * (bytes + log))
}

fn copy_error(path: &Path) -> impl Fn(io::Error) -> UpkeepError {
    let path = path.to_owned();
    move |error| UpkeepError::UpdateCopy { path: path.clone(), why: error.to_string() }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::domain::scope::Scope;
    use crate::domain::text::Key;
    use crate::upkeep::clear_up;
    use crate::upkeep::tests::UpkeepFixture;

    /// A centre with a file in the place of the copy.
    async fn with_copy(content: &[u8]) -> (UpkeepFixture, PathBuf) {
        let bench = UpkeepFixture::new().await;
        let copy = bench.vault.folder().join(UPDATE_COPY_FOLDER).join("trocar.db");
        fs::create_dir(copy.parent().unwrap()).unwrap();
        fs::write(&copy, content).unwrap();
        (bench, copy)
    }

    #[tokio::test]
    async fn a_copy_that_cannot_be_changed_is_deleted_with_the_next_erasure() {
        let (bench, copy) = with_copy(b"no database, but perhaps the name of Ana").await;
        let ana = bench.centre.trainee("Ana").await.id;
        clear_up(&bench.centre.store, &bench.vault).await.unwrap();
        assert!(copy.exists());
        bench.centre.store.trainees().erase(&Scope::service(), &Key::from(&ana)).await.unwrap();
        clear_up(&bench.centre.store, &bench.vault).await.unwrap();
        assert!(!copy.exists());
    }

    #[tokio::test]
    async fn a_copy_is_deleted_when_its_time_is_over() {
        let (bench, copy) = with_copy(b"a copy").await;
        let made_ms: i64 = 1_000_000_000;
        let made = UNIX_EPOCH + Duration::from_millis(made_ms.unsigned_abs());
        File::options().write(true).open(&copy).unwrap().set_modified(made).unwrap();
        forget_old_update_copy(&bench.vault, made_ms + KEPT_MS).unwrap();
        assert!(copy.exists());
        forget_old_update_copy(&bench.vault, made_ms + KEPT_MS + 1).unwrap();
        assert!(!copy.exists());
    }
}
