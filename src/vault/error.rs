//! Why the vault did not do what it was asked.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Result of a vault function.
pub type VaultResult<T> = Result<T, VaultError>;

/// Why the vault did not do it.
#[derive(Clone, Debug, thiserror::Error)]
pub enum VaultError {
    /// There is no such file.
    #[error("there is no such file in the vault")]
    NotFound,
    /// The disk is full. Works again by itself once there is space.
    #[error("the disk is full")]
    DiskFull,
    /// More bytes came than were allowed.
    #[error("more than {most} bytes came")]
    TooLong {
        /// Most bytes allowed.
        most: u64,
    },
    /// Somebody else has this upload open, or another service this folder.
    #[error("{0} is in use")]
    InUse(String),
    /// The bytes are not those that were stored.
    #[error("a stored file is damaged: its content no longer matches its name")]
    Damaged,
    /// An upload's file holds fewer bytes than were acknowledged.
    #[error("an upload's file holds {found} bytes where {noted} were acknowledged")]
    Lost {
        /// Bytes in the file.
        found: u64,
        /// Bytes acknowledged.
        noted: u64,
    },
    /// Anything else that the file system says.
    #[error("{doing} `{}`: {source}", path.display())]
    Io {
        /// What was being done.
        doing: &'static str,
        /// To which file.
        path: PathBuf,
        /// What the system said.
        source: Arc<io::Error>,
    },
}

/// For `map_err`: what was being done to which file.
pub(super) fn failed(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> VaultError {
    move |error| match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge => VaultError::DiskFull,
        io::ErrorKind::NotFound => VaultError::NotFound,
        _ => VaultError::Io { doing, path: path.to_owned(), source: Arc::new(error) },
    }
}
