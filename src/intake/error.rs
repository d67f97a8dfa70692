//! Errors of receiving recordings.

use crate::store::StoreError;
use crate::vault::VaultError;

/// Result of an intake function.
pub type IntakeResult<T> = Result<T, IntakeError>;

/// Why a recording, or a piece of it, was not accepted. Bytes that were acknowledged before are kept.
#[derive(Debug, thiserror::Error)]
pub enum IntakeError {
    /// The trainee, task or box is missing.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// The trainee, task or box does not exist or is outside the scope.
    #[error("there is no such {0}")]
    Unknown(&'static str),
    /// A value that cannot be used.
    #[error("{field}: {why}")]
    Invalid {
        /// The field.
        field: &'static str,
        /// What was expected.
        why: String,
    },
    /// Longer than the limit for a recording, or than announced.
    #[error("more than {most} bytes")]
    TooLong {
        /// Maximum number of bytes.
        most: u64,
    },
    /// No byte arrived.
    #[error("the recording is empty")]
    Empty,
    /// The piece does not begin where the last one ended.
    #[error("{received} bytes have been received")]
    Offset {
        /// Bytes that are durable.
        received: u64,
    },
    /// The upload has expired.
    #[error("the upload has expired")]
    Expired,
    /// The piece does not match its checksum; it was dropped.
    #[error("the bytes differ from their checksum")]
    ChecksumMismatch,
    /// The connection ended before the piece did, with this error; the bytes that arrived are durable.
    #[error("the connection ended early")]
    ConnectionLost(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The sender resumed on another connection while this one was silent; the bytes that arrived are durable.
    #[error("the sender resumed the upload with another request")]
    Resumed,
    /// The service is ending; the bytes that arrived are durable.
    #[error("the service is ending")]
    Ending,
    /// The service is ending, and the bytes of a recording that arrives in one request are not kept.
    #[error("the service is ending; nothing is kept")]
    EndingUnsaved,
    /// The same trainee, task and box already have this recording.
    #[error("this recording is session {session}")]
    AlreadyExists {
        /// The session's id.
        session: String,
    },
    /// An error of the store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// An error of the vault.
    #[error(transparent)]
    Vault(#[from] VaultError),
}
