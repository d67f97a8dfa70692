//! Errors of the vault.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Result of a vault function.
pub type VaultResult<T> = Result<T, VaultError>;

/// Why a vault function failed.
#[derive(Clone, Debug, thiserror::Error)]
pub enum VaultError {
    /// There is no such file.
    #[error("there is no such file in the vault")]
    NotFound,
    /// The disk is full. Works again by itself once there is space.
    #[error("the disk is full")]
    DiskFull,
    /// More bytes arrived than allowed.
    #[error("more than {most} bytes arrived")]
    TooLong {
        /// Maximum number of bytes.
        most: u64,
    },
    /// Another sender has this upload open, or another service uses this folder.
    #[error("{0} is in use")]
    InUse(String),
    /// The service is shutting down, so the file work did not begin.
    #[error("the service is shutting down")]
    ShuttingDown,
    /// The bytes differ from those that were stored.
    #[error("a stored file is damaged: its content no longer matches its name")]
    Damaged,
    /// An upload's file holds fewer bytes than were acknowledged.
    #[error("an upload's file holds {found} bytes, but {noted} were acknowledged")]
    Lost {
        /// Bytes in the file.
        found: u64,
        /// Bytes acknowledged.
        noted: u64,
    },
    /// Any other error of the file system.
    #[error("{doing} `{}`: {source}", path.display())]
    Io {
        /// The operation that failed.
        doing: &'static str,
        /// Its file.
        path: PathBuf,
        /// The system's error.
        source: Arc<io::Error>,
    },
}

/// Why a stored file cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FileLoss {
    /// There is no such file.
    Missing,
    /// Its content does not match its name.
    Damaged,
    /// The system cannot read it, for this reason.
    Unreadable(String),
}

impl FileLoss {
    /// The loss in one word.
    pub fn name(&self) -> &'static str {
        match self {
            FileLoss::Missing => "missing",
            FileLoss::Damaged => "damaged",
            FileLoss::Unreadable(_) => "unreadable",
        }
    }
}

impl fmt::Display for FileLoss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            FileLoss::Unreadable(why) => write!(f, "unreadable ({why})"),
            other => f.write_str(other.name()),
        }
    }
}

impl VaultError {
    /// The loss that this error means if a stored file was being read; `None`: the error says nothing about the file.
    pub fn loss(&self) -> Option<FileLoss> {
        match self {
            VaultError::NotFound => Some(FileLoss::Missing),
            VaultError::Damaged => Some(FileLoss::Damaged),
            VaultError::Io { .. } => Some(FileLoss::Unreadable(self.to_string())),
            _ => None,
        }
    }
}

/// For `map_err`: adds the operation and the file to an error.
pub(super) fn failed(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> VaultError {
    move |error| match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge => VaultError::DiskFull,
        io::ErrorKind::NotFound => VaultError::NotFound,
        _ => VaultError::Io { doing, path: path.to_owned(), source: Arc::new(error) },
    }
}
