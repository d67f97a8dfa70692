//! Keeping files and database in step: recovery at the start, collection of what nothing needs, the check of both.
//!
//! The order of every write makes any sudden end harmless (file first, row second; on delete row first, file second); what
//! is left in between is cleared here. The functions know both the vault and the store, which do not know each other.
//!
//! | function | when |
//! |---|---|
//! | [`recover()`] | once, at every start, before anything else uses the folder |
//! | [`keep`] | for as long as the service runs |
//! | [`check()`] | when somebody asks: `trocar admin check` |
//! | [`back_up`] | when somebody asks: `trocar admin backup` |

use std::path::PathBuf;
use std::time::Duration;

mod backup;
mod check;
mod collect;
mod recover;

pub use backup::back_up;
pub use check::{Finding, check};
use collect::{collect, forget_expired_uploads, remove_orphan_uploads, remove_unnamed};
pub use recover::{Recovered, recover};

use crate::shutdown::Shutdown;
use crate::store::{Store, StoreError};
use crate::time::SharedClock;
use crate::vault::{Vault, VaultError};

/// Why upkeep could not be done.
#[derive(Debug, thiserror::Error)]
pub enum UpkeepError {
    /// The database refused.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A file could not be handled.
    #[error(transparent)]
    Vault(#[from] VaultError),
    /// A backup would overwrite something.
    #[error("`{}` is not empty: name a folder that is, or is not there yet", .0.display())]
    Used(PathBuf),
    /// Recordings were erased faster than they could be copied.
    #[error("recordings were erased again and again during the backup: try once more")]
    Unsettled,
    /// The finished backup has a fault.
    #[error("the backup is not sound: {0}")]
    Unsound(Finding),
}

/// Result of an upkeep function.
pub type UpkeepResult<T> = Result<T, UpkeepError>;

/// Clears up again and again until the service ends. What is erased has left the folder soon after `every`.
pub async fn keep(store: &Store, vault: &Vault, every: Duration, clock: SharedClock, shutdown: &Shutdown) {
    while !shutdown.is_begun() {
        if let Err(error) = clear_up(store, vault).await {
            tracing::warn!(%error, "clearing up behind the work");
        }
        tokio::select! {
            () = shutdown.begun() => {}
            () = clock.sleep(every) => {}
        }
    }
}

/// Removes what is no longer needed, and what was erased from the database's log.
pub async fn clear_up(store: &Store, vault: &Vault) -> UpkeepResult<()> {
    forget_expired_uploads(store, vault).await?;
    remove_orphan_uploads(store, vault).await?;
    collect(store, vault).await?;
    remove_unnamed(store, vault).await?;
    store.forget_erased().await?;
    store.restore_ballast().await;
    store.cookies().forget_expired().await?; // last: on a full disk it fails, and keeps nothing from making room
    Ok(())
}

#[cfg(test)]
mod tests;
