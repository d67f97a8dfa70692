//! Keeps files and database consistent: recovery at the start, collection of unreferenced files, and the check of both.
//!
//! The order of every write makes a crash harmless (file first, row second; when deleting row first, file second).
//! Leftovers are removed here. These functions use both the vault and the store, which do not know each other.
//!
//! | function | when |
//! |---|---|
//! | [`recover()`] | once, at every start, before anything else uses the folder |
//! | [`run`] | for as long as the service runs: [`apply_retention`], then [`clear_up`] |
//! | [`check()`] | on request: `trocar admin check` |
//! | [`back_up`] | on request: `trocar admin backup`; and once a day: [`run_backups`] |
//! | [`restore()`] | on request: `trocar admin restore` |

use std::path::PathBuf;
use std::time::Duration;

mod backup;
mod check;
mod collect;
mod erasure_list;
mod recover;
mod restore;
mod retention;
mod scheduled_backups;

pub use backup::{BACKUP_MARK, back_up};
pub use check::{Finding, check};
use collect::{collect, forget_expired_uploads, remove_orphan_uploads, remove_unreferenced};
pub use erasure_list::{ERASURE_LIST, ErasureLists};
pub use recover::{Recovered, recover};
pub use restore::{Restored, restore};
pub use retention::{RetentionSettings, apply_retention};
pub use scheduled_backups::{BackupProgress, BackupSettings, BackupState, complete_backups, run_backups};

use crate::shutdown::Shutdown;
use crate::store::{Store, StoreError};
use crate::time::SharedClock;
use crate::vault::{Vault, VaultError};

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
    /// The folder of the scheduled backups cannot be used.
    #[error("folder of backups `{}`: {why}", .folder.display())]
    Target {
        /// The folder.
        folder: PathBuf,
        /// The problem.
        why: String,
    },
    /// A folder that is to be restored is no backup.
    #[error("`{}` is no backup: it has no database", .0.display())]
    NoBackup(PathBuf),
    /// No list says who was erased since the backup.
    #[error(
        "there is no list of erasures `{}`: people who were erased since this backup would come back. Name the list with \
         --erasures (a copy is in the data folder), or give --without-erasures", .0.display()
    )]
    NoList(PathBuf),
    /// The check of the finished backup found a problem.
    #[error("the backup is not sound: {0}")]
    Unsound(Finding),
}

/// Result of an upkeep function.
pub type UpkeepResult<T> = Result<T, UpkeepError>;

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
        if let Err(error) = lists.update(store).await {
            tracing::error!(%error, "erasures were not listed; a backup restored now would bring erased people back");
        }
        tokio::select! {
            () = shutdown.begun() => {}
            () = clock.sleep(every) => {}
        }
    }
}

/// Removes files that are no longer needed, and erased data from the write-ahead log. A step that fails, such as a file
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
    steps.note(store.purge_erased().await.map_err(UpkeepError::from));
    store.restore_reserves().await;
    steps.note(store.cookies().forget_expired().await.map_err(UpkeepError::from)); // last, since it fails on a full disk
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
