//! Why a recording was not taken.

use crate::domain::files::trajectory::ImportProblem;
use crate::store::StoreError;
use crate::vault::VaultError;

/// Result of an intake function.
pub type IntakeResult<T> = Result<T, IntakeError>;

/// Why a recording, or a piece of it, was not taken. What was acknowledged before stays.
#[derive(Debug, thiserror::Error)]
pub enum IntakeError {
    /// It is not said whose, what or where.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// It names a trainee, task or box that is not there, or not to be seen.
    #[error("there is no such {0}")]
    Unknown(&'static str),
    /// A value that cannot be used.
    #[error("{field}: {why}")]
    Invalid {
        /// Which.
        field: &'static str,
        /// What was expected.
        why: String,
    },
    /// Longer than a recording may be, or than was announced.
    #[error("more than {most} bytes")]
    TooLong {
        /// Most bytes.
        most: u64,
    },
    /// Not a byte came.
    #[error("the recording is empty")]
    Empty,
    /// Too many uploads are unfinished.
    #[error("{most} uploads are unfinished")]
    TooMany {
        /// Most of them.
        most: u64,
    },
    /// The piece does not begin where the last one ended.
    #[error("{received} bytes are here")]
    Offset {
        /// Bytes that are durable.
        received: u64,
    },
    /// The upload's time is over.
    #[error("the upload has expired")]
    Expired,
    /// The piece is not what its sender meant; it was dropped.
    #[error("the bytes differ from their checksum")]
    Mismatch,
    /// The connection ended before the piece did, and this is what it said; what came is durable.
    #[error("the connection ended early")]
    Cut(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The sender went on elsewhere while nothing came here; what came is durable.
    #[error("the sender went on with another request")]
    Resumed,
    /// The service ends; what came is durable.
    #[error("the service is ending")]
    Ending,
    /// The same recording of the same trainee, task and box is here.
    #[error("this recording is session {session}")]
    Known {
        /// The session's id.
        session: String,
    },
    /// It is no table of a tracker's rows.
    #[error(transparent)]
    Table(#[from] ImportProblem),
    /// Other tables are being read.
    #[error("{most} tables are being read")]
    Importing {
        /// How many at a time.
        most: usize,
    },
    /// The thread that read a table did not come back.
    #[error("reading a table: {0}")]
    Broken(#[from] tokio::task::JoinError),
    /// The store refused.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The vault refused.
    #[error(transparent)]
    Vault(#[from] VaultError),
}
