//! Why the store did not do what it was asked: a small closed set, which HTTP maps to answers in one place.

use std::sync::Arc;

/// Result of a store function.
pub type StoreResult<T> = Result<T, StoreError>;

/// Why the store did not do it. Nothing was changed.
#[derive(Clone, Debug, thiserror::Error)]
pub enum StoreError {
    /// It does not exist, or the scope does not reach it: nobody can tell which.
    #[error("there is no such {what}")]
    NotFound {
        /// What was asked for.
        what: &'static str,
    },
    /// The scope sees it but may not change it.
    #[error("{what} is for {whom} only")]
    Forbidden {
        /// What was attempted.
        what: &'static str,
        /// Who may.
        whom: &'static str,
    },
    /// Something with this natural key exists already.
    #[error("this {what} is taken")]
    Taken {
        /// Which key.
        what: &'static str,
        /// The id of what has it, where that may be told.
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
    /// It cannot be done in this state, and why.
    #[error("{why}")]
    Refused {
        /// What stands against it, and what to do.
        why: String,
    },
    /// The lease has passed to somebody else, or the job has ended: whatever was computed counts for nothing.
    #[error("the lease on this job is no longer held")]
    LeaseLost,
    /// The disk is full. Works again by itself once there is space.
    #[error("the disk is full")]
    DiskFull,
    /// More is asked than the limits allow at once.
    #[error("the database is busy")]
    Busy,
    /// The store has been closed.
    #[error("the store is closed")]
    Closed,
    /// The file cannot be used by this program.
    #[error("the database cannot be used: {0}")]
    Unusable(String),
    /// Anything else that SQLite says.
    #[error("the database refused: {0}")]
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
/// What `ON DELETE RESTRICT` answers with.
const SQLITE_CONSTRAINT_TRIGGER: i32 = 1811;

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        let code = code(&error);
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
    /// Does a row hold what this program cannot read? That stays so; whatever else a database says may pass.
    pub fn is_unreadable(&self) -> bool {
        let Self::Database(error) = self else { return false };
        matches!(**error, sqlx::Error::ColumnDecode { .. } | sqlx::Error::Decode(_))
    }

    /// Did an fsync fail? Then nothing that was ever written can be relied upon.
    pub(super) fn is_failed_sync(&self) -> bool {
        matches!(self, StoreError::Database(e) if [SQLITE_IOERR_FSYNC, SQLITE_IOERR_DIR_FSYNC].contains(&code(e)))
    }

    /// A refusal with its reason.
    pub(super) fn refused(why: impl Into<String>) -> Self {
        StoreError::Refused { why: why.into() }
    }
}

/// SQLite's extended result code; 0 if the error is not SQLite's.
fn code(error: &sqlx::Error) -> i32 {
    let code = error.as_database_error().and_then(|e| e.code());
    code.and_then(|code| code.parse().ok()).unwrap_or(0)
}

/// For the insert that may meet a natural key: `.map_err(taken("login"))`.
pub(super) fn taken(what: &'static str) -> impl FnOnce(sqlx::Error) -> StoreError {
    move |error| match error.as_database_error() {
        Some(e) if e.is_unique_violation() => StoreError::Taken { what, existing: None },
        _ => error.into(),
    }
}

/// For the delete that something may stand against: `.map_err(in_use("task", "sessions"))`.
pub(super) fn in_use(what: &'static str, by: &'static str) -> impl FnOnce(sqlx::Error) -> StoreError {
    move |error| match code(&error) {
        SQLITE_CONSTRAINT_FOREIGNKEY | SQLITE_CONSTRAINT_TRIGGER => StoreError::InUse { what, by },
        _ => error.into(),
    }
}

/// For the write that names something by id: `.map_err(missing("box"))`.
pub(super) fn missing(what: &'static str) -> impl FnOnce(sqlx::Error) -> StoreError {
    move |error| match error.as_database_error() {
        Some(e) if e.is_foreign_key_violation() => StoreError::NotFound { what },
        _ => error.into(),
    }
}

/// For the note that somebody was here, which may wait for space or a quieter moment: reading and erasing must not.
pub(super) fn noted(done: StoreResult<()>) -> StoreResult<()> {
    if let Err(error @ (StoreError::DiskFull | StoreError::Busy)) = done {
        tracing::warn!(%error, "noting that somebody was here");
        return Ok(());
    }
    done
}

/// A row that must be there: `.fetch_optional(…).await?.ok_or(not_found("task"))`.
pub(super) fn not_found(what: &'static str) -> StoreError {
    StoreError::NotFound { what }
}
