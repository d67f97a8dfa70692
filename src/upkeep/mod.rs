//! Keeps files and database consistent: recovery at the start, collection of unreferenced files, and the check of both.
//!
//! The order of every write makes a crash harmless (file first, row second; when deleting row first, file second).
//! Leftovers are removed here. These functions use both the vault and the store, which do not know each other.
//!
//! | function | when |
//! |---|---|
//! | [`prepare_database`] | once, at every start, before the database is opened |
//! | [`recover()`] | once, at every start, before anything else uses the folder |
//! | [`write_password_file`] | at the first start |
//! | [`run`] | for as long as the service runs: [`apply_retention`], then [`clear_up`] |
//! | [`clear_after_command`] | after a command that may have erased people or changed passwords |
//! | [`check()`] | on request: `trocar admin check` |
//! | [`back_up`] | on request: `trocar admin backup`; and once a day: [`run_backups`] |
//! | [`restore()`] | on request: `trocar admin restore` |
//! | [`delete_orphans`] | on request: `trocar admin delete-orphans` |

use std::path::{Path, PathBuf};
use std::time::Duration;

mod access;
mod backup;
mod check;
mod collect;
mod erasure_list;
mod lost_database;
mod orphans;
mod password_file;
mod recover;
mod restore;
mod retention;
mod scheduled_backups;
mod unfinished_folder;
mod update_copy;

pub use access::{is_readable, require_writable};
pub use backup::{BackupReport, back_up};
pub use check::{Finding, LostFile, check};
use collect::{collect, forget_expired_uploads, remove_orphan_uploads, remove_unreferenced};
pub use erasure_list::{ERASURE_LIST, ErasureListState, ErasureLists};
pub use lost_database::refuse_lost_database;
pub use orphans::delete_orphans;
use password_file::forget_changed_passwords;
pub use password_file::{password_file, write_password_file};
pub use recover::{Recovered, recover};
pub use restore::{ErasureListChoice, Restored, restore};
pub use retention::{RetentionSettings, apply_retention};
pub use scheduled_backups::{BackupProgress, BackupSettings, BackupState, complete_backups, run_backups};
pub use unfinished_folder::{BACKUP_MARK, BackupMark};
pub use update_copy::UPDATE_COPY_FOLDER;
use update_copy::{copy_before_update, erase_in_update_copy, forget_old_update_copy};

use crate::shutdown::Shutdown;
use crate::store::{SchemaState, Store, StoreError, StoreSettings};
use crate::time::SharedClock;
use crate::vault::{Vault, VaultError};

const MIB: u64 = 1 << 20;

/// Why upkeep failed.
#[derive(Debug, thiserror::Error)]
pub enum UpkeepError {
    /// An error of the store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// An error of the vault.
    #[error(transparent)]
    Vault(#[from] VaultError),
    /// A backup would overwrite something.
    #[error("`{}` is not empty: name a folder that is empty or does not exist yet", .0.display())]
    Used(PathBuf),
    /// The service or the command was stopped.
    #[error("interrupted by the stop")]
    Interrupted,
    /// The folder has files of an earlier database, but no database.
    #[error(
        "the database `{}` is missing or empty, but its folder holds {remains} of an earlier one. No new database is \
         made, because it would name none of the files. Put the database back: from a backup, with `trocar admin \
         restore BACKUP --data NEW-FOLDER`, or the copy from before the last update: \
         `before-update/trocar.db` in the data folder, with the program of that time (docs/operations.md, Update). For a new centre, name an empty folder with --data. Copy the folders `uploads` and `feeds` aside first: a start \
         with an older database deletes what it does not know", .database.display()
    )]
    LostDatabase {
        /// The database that is missing.
        database: PathBuf,
        /// What was found.
        remains: String,
    },
    /// This user lacks the right.
    #[error(
        "permission denied: `{}` belongs to another user: run the command as this user, with `sudo -u {owner}` before \
         it", .path.display()
    )]
    Denied {
        /// The file or folder.
        path: PathBuf,
        /// Its owner, or the owner of its folder, as `sudo -u` takes it.
        owner: String,
    },
    /// The folder's file system is mounted read-only.
    #[error("`{}` is on a read-only disk: make the disk writable, or copy the folder to another one", .0.display())]
    ReadOnly(PathBuf),
    /// A file or folder cannot be used for another reason.
    #[error("`{}`: {why}", .path.display())]
    Unreadable {
        /// The file or folder.
        path: PathBuf,
        /// The problem.
        why: String,
    },
    /// Recordings were erased repeatedly while they were being copied.
    #[error("recordings were erased repeatedly during the backup: try again")]
    Unsettled,
    /// A list of erasures cannot be read or written.
    #[error("list of erasures `{}`: {why}", .path.display())]
    List {
        /// Its file.
        path: PathBuf,
        /// The problem.
        why: String,
    },
    /// A folder for a backup or a restored backup, or the folder of the scheduled backups, cannot be used.
    #[error("folder `{}`: {why}", .folder.display())]
    Target {
        /// The folder.
        folder: PathBuf,
        /// The problem.
        why: String,
    },
    /// A folder that is to be restored is no backup.
    #[error("`{}` is no backup: it has no database, or an empty one", .0.display())]
    NoBackup(PathBuf),
    /// A backup that is to be restored was not finished.
    #[error(
        "`{}` is no backup: its making was interrupted, or is not finished yet. Name another one; one that was \
         interrupted can be deleted", .0.display()
    )]
    UnfinishedBackup(PathBuf),
    /// No list says who was erased since the backup.
    #[error(
        "there is no list of erasures `{}`: people who were erased since this backup would come back. Name the list with \
         --erasures (a copy is in the data folder), or give --without-erasures", .0.display()
    )]
    NoList(PathBuf),
    /// A list of erasures has no mark of the backup's installation.
    #[error(
        "the list of erasures `{}` does not say that it is complete for the installation that made this backup: people \
         who were erased since would come back. Name another list with --erasures (a copy is in the data folder), or \
         give --without-erasures", .0.display()
    )]
    ForeignList(PathBuf),
    /// A list of erasures may lack erasures.
    #[error(
        "the list of erasures `{}` is complete only until {until}, {why}: people who were erased later would come back. \
         Name a newer list with --erasures (a copy is in the data folder). If there is none, restore with \
         `--erasures-until {until}`, and erase again by hand who was erased later", .path.display()
    )]
    ShortList {
        /// Its file.
        path: PathBuf,
        /// Until when it is complete.
        until: String,
        /// Why not longer.
        why: String,
    },
    /// There is no space for the copy of the database that an update makes.
    #[error(
        "the database is not adapted to this program yet, because the copy that is made before needs up to {} MiB in \
         `{}`{}: free some space and start again, or install the earlier program again. Nothing was changed",
        needed.div_ceil(MIB), .folder.display(),
        .free.map(|free| format!(", where {} MiB are free", free / MIB)).unwrap_or_default()
    )]
    NoSpaceForCopy {
        /// The data folder.
        folder: PathBuf,
        /// Space for copy and change, bytes.
        needed: u64,
        /// Free space, bytes; `None` if it ran out while the copy was made.
        free: Option<u64>,
    },
    /// The copy of the database from before an update cannot be made or deleted.
    #[error("copy from before the update `{}`: {why}", .path.display())]
    UpdateCopy {
        /// The file or folder.
        path: PathBuf,
        /// The problem.
        why: String,
    },
    /// A file with a first password cannot be written or deleted.
    #[error("file with the first password `{}`: {why}", .path.display())]
    PasswordFile {
        /// The file.
        path: PathBuf,
        /// The problem.
        why: String,
    },
    /// The check of the finished backup found a problem.
    #[error("the backup is not sound: {0}")]
    Unsound(Finding),
}

/// Result of an upkeep function.
pub type UpkeepResult<T> = Result<T, UpkeepError>;

/// Makes the database ready for [`Store::open`]: if that would change its schema, copies it first. Call it with the
/// folder locked.
///
/// # Errors
/// [`UpkeepError::LostDatabase`]; a newer program made the database; the disk lacks the space. Nothing was changed.
pub async fn prepare_database(vault: &Vault, database: &Path, settings: &StoreSettings) -> UpkeepResult<()> {
    match Store::found_schema(database, settings).await? {
        SchemaState::Empty => refuse_lost_database(vault, database).await,
        SchemaState::Older => copy_before_update(vault, database, settings).await,
        SchemaState::Current => Ok(()),
    }
}

/// Cleans up repeatedly until the service ends. Erased data has left the folder soon after `every`.
pub async fn run(
    (store, vault): (&Store, &Vault),
    retention: &RetentionSettings,
    mut lists: ErasureLists,
    every: Duration,
    (clock, shutdown): (SharedClock, &Shutdown),
) {
    while !shutdown.is_begun() {
        if let Err(error) = apply_retention((store, vault), retention, clock.now_ms()).await {
            tracing::warn!(%error, "data that is not kept any longer was not all deleted; retrying at the next round");
        }
        if let Err(error) = clear_up(store, vault).await {
            tracing::warn!(%error, "cleaning up failed; retrying at the next round");
        }
        if let Err(error) = forget_old_update_copy(vault, clock.now_ms()) {
            tracing::warn!(%error, "old copy not deleted; retrying at the next round");
        }
        lists.keep(store, clock.now_ms()).await;
        tokio::select! {
            () = shutdown.begun() => {}
            () = clock.sleep(every) => {}
        }
    }
}

/// Removes files that are no longer needed, and erased data from where else it is. A step that fails, such as a file
/// that cannot be deleted, stops no other.
///
/// # Errors
/// The first failure.
pub async fn clear_up(store: &Store, vault: &Vault) -> UpkeepResult<()> {
    let mut steps = Attempts::default();
    steps.note(forget_expired_uploads(store, vault).await);
    steps.note(remove_orphan_uploads(store, vault).await);
    steps.note(collect(store, vault).await);
    steps.note(remove_unreferenced(store, vault).await);
    steps.note(clear_after_command(store, vault).await);
    store.restore_reserves().await;
    steps.note(store.cookies().forget_expired().await.map_err(UpkeepError::from)); // last, since it fails on a full disk
    steps.finish(())
}

/// Removes erased data from the write-ahead log and from the copy before the last update, and the files of passwords
/// that were changed. A step that fails stops no other.
///
/// # Errors
/// The first failure.
pub async fn clear_after_command(store: &Store, vault: &Vault) -> UpkeepResult<()> {
    let mut steps = Attempts::default();
    steps.note(store.purge_erased().await.map_err(UpkeepError::from));
    steps.note(erase_in_update_copy(store, vault).await);
    steps.note(forget_changed_passwords(store, vault.folder()).await);
    steps.finish(())
}

/// Several attempts, each made although an earlier one failed.
#[derive(Default)]
struct Attempts {
    first_error: Option<UpkeepError>,
}

impl Attempts {
    /// Notes the result of one; its value if it succeeded.
    fn note<T>(&mut self, result: UpkeepResult<T>) -> Option<T> {
        result.map_err(|error| self.first_error.get_or_insert(error)).ok()
    }

    /// The value, unless an attempt failed.
    fn finish<T>(self, value: T) -> UpkeepResult<T> {
        self.first_error.map_or(Ok(value), Err)
    }
}

#[cfg(test)]
mod tests;
