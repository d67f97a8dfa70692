//! Keeping files and database in step: recovery at the start, collection of what nothing needs, the check of both.
//!
//! The order of every write makes any sudden end harmless (file first, row second; on delete row first, file second); what
//! is left in between is cleared here. The functions know both the vault and the store, which do not know each other.

mod check;
mod collect;
mod recover;

pub use check::{Finding, check};
pub use collect::{collect, forget_expired_uploads};
pub use recover::{Recovered, recover};

use crate::store::StoreError;
use crate::vault::VaultError;

/// Why upkeep could not be done.
#[derive(Debug, thiserror::Error)]
pub enum UpkeepError {
    /// The database refused.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A file could not be handled.
    #[error(transparent)]
    Vault(#[from] VaultError),
}

/// Result of an upkeep function.
pub type UpkeepResult<T> = Result<T, UpkeepError>;

#[cfg(test)]
mod tests;
