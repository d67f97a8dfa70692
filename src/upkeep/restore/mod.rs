//! Restores a backup into a new data folder, and erases again what was erased since the backup.

use std::path::{Path, PathBuf};

use tokio::fs::{File, OpenOptions};

use super::backup::{copy_blobs, unless_stopped, verify_copy};
use super::erasure_list::{ERASURE_LIST, extend_list, read_list};
use super::unfinished_folder::{BackupMark, UnfinishedFolder, folder_error, refuse_used};
use super::{LostFile, UpkeepError, UpkeepResult, recover};
use crate::domain::erasure::{ErasedKind, Erasure};
use crate::shutdown::Shutdown;
use crate::store::{Store, StoreError, StoreSettings};
use crate::time::SharedClock;
use crate::vault::Vault;

/// What a restored folder holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Restored {
    /// Number of files, all verified.
    pub files: u64,
    /// The files that the backup lacks, or that are damaged in it.
    pub missing: Vec<LostFile>,
    /// Number of people and recordings that were erased again.
    pub erased_again: usize,
    /// Accounts that could not be deleted again, and why.
    pub kept: Vec<String>,
}

/// Restores `backup` into the folder `to`, which is empty, does not exist yet, or was left by an interrupted restore.
/// `erasures` is the list of erasures since the backup: by default the one beside it; `None` restores without one. A
/// file that the backup lacks stops nothing. A stop ends it at once.
///
/// # Errors
/// Also [`UpkeepError::Interrupted`]. What was written into the folder is removed.
pub async fn restore(
    backup: &Path,
    to: &Path,
    erasures: Option<Option<PathBuf>>,
    database: &str,
    clock: SharedClock,
    stop: &Shutdown,
) -> UpkeepResult<Restored> {
    refuse_used(to)?;
    if !backup.join(database).is_file() {
        return Err(UpkeepError::NoBackup(backup.to_owned()));
    }
    if BackupMark::read(backup)? == Some(BackupMark::Unfinished) {
        return Err(UpkeepError::UnfinishedBackup(backup.to_owned()));
    }
    let erasures = match erasures {
        None => Vec::new(),
        Some(named) => {
            let list = named.unwrap_or_else(|| backup.parent().unwrap_or(backup).join(ERASURE_LIST));
            if !list.is_file() {
                return Err(UpkeepError::NoList(list));
            }
            read_list(&list)?
        }
    };
    let folder = UnfinishedFolder::begin(to).await?;
    let restored = match restore_into(to, backup, erasures, database, clock, stop).await {
        Ok(restored) => folder.unmark().map(|()| restored),
        failed => failed,
    };
    folder.end(restored, stop)
}

/// Writes the database and its files into the folder, without what the list names.
async fn restore_into(
    to: &Path,
    backup: &Path,
    erasures: Vec<Erasure>,
    database: &str,
    clock: SharedClock,
    stop: &Shutdown,
) -> UpkeepResult<Restored> {
    let (from, files) = (Vault::open_existing(backup), Vault::open(to).await?);
    let path = to.join(database);
    let copying = async { copy_private(&backup.join(database), &path).await.map_err(folder_error(to)) };
    unless_stopped(stop, copying).await?;
    let store = Store::open(&path, &StoreSettings::default(), clock).await?;
    let lost = copy_blobs(&store, &from, &files, stop).await?;
    let (mut erased_again, mut kept) = (0, Vec::new());
    // Accounts last: those of trainees are deleted with them.
    let (people, others): (Vec<_>, Vec<_>) =
        last_requests(&erasures).into_iter().partition(|erasure| erasure.kind == ErasedKind::Person);
    for erasure in others.into_iter().chain(people) {
        match store.erasures().repeat(erasure).await {
            Ok(existed) => erased_again += usize::from(existed),
            Err(StoreError::Refused { why }) => kept.push(format!("{} {}: {why}", erasure.kind, erasure.id)),
            Err(error) => return Err(error.into()),
        }
    }
    recover(&store, &files).await?; // removes the files of what was erased
    store.purge_erased().await?;
    extend_list(&to.join(ERASURE_LIST), &erasures)?;
    let missing = verify_copy(&store, &files, &lost, stop).await?;
    let (wanted, _) = store.blobs().total().await?;
    store.close().await;
    Ok(Restored { files: wanted - missing.len() as u64, missing, erased_again, kept })
}

/// Copies a file. Only its owner may read the copy, even if others may read the original.
async fn copy_private(from: &Path, to: &Path) -> std::io::Result<()> {
    let mut original = File::open(from).await?;
    let mut copy = OpenOptions::new().write(true).create_new(true).mode(0o600).open(to).await?;
    tokio::io::copy(&mut original, &mut copy).await?;
    copy.sync_all().await
}

/// The entries of a list without the requests that a later one of the same trainee replaces: only the last says whether the
/// trainee waits for an erasure.
fn last_requests(erasures: &[Erasure]) -> Vec<&Erasure> {
    let is_request = |erasure: &Erasure| matches!(erasure.kind, ErasedKind::Pending | ErasedKind::TakenBack);
    let is_replaced = |number: usize, erasure: &Erasure| {
        erasures[number + 1..].iter().any(|later| is_request(later) && later.id == erasure.id)
    };
    let entries = erasures.iter().enumerate();
    entries
        .filter(|(number, entry)| !is_request(entry) || !is_replaced(*number, entry))
        .map(|(_, entry)| entry)
        .collect()
}

#[cfg(test)]
mod tests;
