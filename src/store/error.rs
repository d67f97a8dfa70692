//! Errors of the store: a small closed set, which HTTP maps to responses in one place.

use std::path::PathBuf;
use std::sync::Arc;

use crate::domain::consent::ConsentState;

/// Result of a store function.
pub type StoreResult<T> = Result<T, StoreError>;

/// Why a store function failed. Nothing was changed.
#[derive(Clone, Debug, thiserror::Error)]
pub enum StoreError {
    /// It does not exist, or it is outside the caller's scope. The two cases look the same to the caller.
    #[error("there is no such {what}")]
    NotFound {
        /// The kind of thing that was requested.
        what: &'static str,
    },
    /// The caller may see it but may not do this.
    #[error("{what} is for {whom} only")]
    Forbidden {
        /// What was attempted.
        what: &'static str,
        /// The roles that may do it.
        whom: &'static str,
    },
    /// Something with this natural key exists already.
    #[error("this {what} is taken")]
    Taken {
        /// The key that is taken.
        what: &'static str,
        /// The id of the row that has the key, if the caller may know it.
        existing: Option<String>,
    },
    /// Something else still needs it.
    #[error("{what} is still used by {by}")]
    InUse {
        /// What was to be deleted.
        what: &'static str,
        /// What needs it.
        by: &'static str,
    },
    /// It cannot be done in the present state.
    #[error("{why}")]
    Refused {
        /// The reason, and what to do about it.
        why: String,
    },
    /// The session is an attempt of an exam, which is never edited.
    #[error(
        "this session is an attempt of an exam: it cannot be moved, cut, joined, edited, marked or erased. An administrator \
         can void the attempt while the exam is running; it is erased with all data of the person"
    )]
    ExamSession,
    /// The trainee does not consent to new recordings.
    #[error("{}", state.why_refused())]
    ConsentMissing {
        /// What the trainee has decided.
        state: ConsentState,
    },
    /// A limit of the sender, or of all senders, is reached.
    #[error("{why}")]
    LimitReached {
        /// The limit, and what to do about it.
        why: String,
        /// The limit.
        most: u64,
    },
    /// Another worker holds the lease, or the job has ended: the caller's result is discarded.
    #[error("the lease on this job is no longer held")]
    LeaseLost,
    /// The disk is full. Works again by itself once there is space.
    #[error("the disk is full")]
    DiskFull,
    /// The disk lacks the space that opening the database takes, even with the disk reserve.
    #[error("the disk of `{}` is full: free at least {} MiB", folder.display(), needed.div_ceil(1 << 20))]
    NoSpaceToOpen {
        /// The data folder.
        folder: PathBuf,
        /// Space that opening takes, bytes.
        needed: u64,
    },
    /// No connection or lock became free within the timeout.
    #[error("the database is busy")]
    Busy,
    /// The store has been closed.
    #[error("the store is closed")]
    Closed,
    /// The file cannot be used by this program.
    #[error("the database cannot be used: {0}")]
    Unusable(String),
    /// An earlier version of the program made the file, and only the service adapts it.
    #[error(
        "the database cannot be used: its schema is older than this program: start the service once, which makes a \
         copy and then adapts it"
    )]
    OlderSchema,
    /// The file is no database of a service yet.
    #[error("the database cannot be used: it has no tables: start the service once")]
    NoSchema,
    /// Any other error of SQLite.
    #[error("database error: {0}")]
    Database(Arc<sqlx::Error>),
}

/// SQLite's primary result code for a full disk.
const SQLITE_FULL: i32 = 13;
const SQLITE_BUSY: i32 = 5;
/// Growing the shared memory of the write-ahead log failed, which happens on a full disk.
const SQLITE_IOERR_SHMSIZE: i32 = 4874;
const SQLITE_IOERR_FSYNC: i32 = 1034;
const SQLITE_IOERR_DIR_FSYNC: i32 = 1290;
const SQLITE_CONSTRAINT_FOREIGNKEY: i32 = 787;
/// SQLite's code for a violation of `ON DELETE RESTRICT`.
const SQLITE_CONSTRAINT_TRIGGER: i32 = 1811;

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        let code = sqlite_code(&error);
        match error {
            sqlx::Error::PoolTimedOut => StoreError::Busy,
            sqlx::Error::PoolClosed | sqlx::Error::WorkerCrashed => StoreError::Closed,
            _ if code == SQLITE_IOERR_SHMSIZE || code & 0xff == SQLITE_FULL => StoreError::DiskFull,
            _ if code & 0xff == SQLITE_BUSY => StoreError::Busy,
            error => StoreError::Database(Arc::new(error)),
        }
    }
}

impl StoreError {
    /// True if a row holds data that this program cannot decode. That error is permanent; other database errors may be
    /// temporary.
    pub fn is_unreadable(&self) -> bool {
        let Self::Database(error) = self else { return false };
        matches!(**error, sqlx::Error::ColumnDecode { .. } | sqlx::Error::Decode(_))
    }

    /// True if an fsync failed. Then no earlier write can be relied on.
    pub(super) fn is_failed_sync(&self) -> bool {
        const FAILED_SYNCS: [i32; 2] = [SQLITE_IOERR_FSYNC, SQLITE_IOERR_DIR_FSYNC];
        matches!(self, StoreError::Database(error) if FAILED_SYNCS.contains(&sqlite_code(error)))
    }

    /// A [`StoreError::Refused`] with this reason.
    pub(super) fn refused(why: impl Into<String>) -> Self {
        StoreError::Refused { why: why.into() }
    }
}

/// SQLite's extended result code; 0 if the error is not SQLite's.
fn sqlite_code(error: &sqlx::Error) -> i32 {
    let code = error.as_database_error().and_then(|e| e.code());
    code.and_then(|code| code.parse().ok()).unwrap_or(0)
}

/// Maps a unique violation of an insert: `.map_err(taken("login"))`.
pub(super) fn taken(what: &'static str) -> impl FnOnce(sqlx::Error) -> StoreError {
    move |error| match error.as_database_error() {
        Some(e) if e.is_unique_violation() => StoreError::Taken { what, existing: None },
        _ => error.into(),
    }
}

/// Maps a foreign-key violation of a delete: `.map_err(in_use("task", "sessions"))`.
pub(super) fn in_use(what: &'static str, by: &'static str) -> impl FnOnce(sqlx::Error) -> StoreError {
    move |error| match sqlite_code(&error) {
        SQLITE_CONSTRAINT_FOREIGNKEY | SQLITE_CONSTRAINT_TRIGGER => StoreError::InUse { what, by },
        _ => error.into(),
    }
}

/// Maps a foreign-key violation of an insert or update: `.map_err(missing("box"))`.
pub(super) fn missing(what: &'static str) -> impl FnOnce(sqlx::Error) -> StoreError {
    move |error| match error.as_database_error() {
        Some(e) if e.is_foreign_key_violation() => StoreError::NotFound { what },
        _ => error.into(),
    }
}

/// For writing a last-seen time: ignores a full disk and a busy database, because reading and deleting must go on
/// without it.
pub(super) fn ignore_full_or_busy(done: StoreResult<()>) -> StoreResult<()> {
    if let Err(error @ (StoreError::DiskFull | StoreError::Busy)) = done {
        tracing::warn!(%error, "last-seen time not stored; the request continues");
        return Ok(());
    }
    done
}

/// The error for a row that must exist: `.fetch_optional(…).await?.ok_or(not_found("task"))`.
pub(super) fn not_found(what: &'static str) -> StoreError {
    StoreError::NotFound { what }
}
