//! Hashes passwords on blocking threads, a few at a time. A check takes as long for an unknown login as for
//! a known one.

use std::sync::LazyLock;

use tokio::sync::Semaphore;

use crate::domain::secret::{Password, PasswordHash};
use crate::http::error::{HandlerResult, ProblemResponse};

/// Limits the hashes computed at once. Each takes 19 MiB and a core: a flood of sign-ins must not occupy all cores.
static HASH_SLOTS: Semaphore = Semaphore::const_new(4);

/// Compared against when the login is unknown, so that the check takes the same time.
static UNKNOWN_LOGIN_HASH: LazyLock<PasswordHash> = LazyLock::new(PasswordHash::unmatchable);

/// The hash to store for a password.
pub async fn hash(password: Password) -> HandlerResult<PasswordHash> {
    run_blocking(move || password.hash()).await
}

/// A hash for an account without a password: no password matches it.
pub async fn unmatchable() -> HandlerResult<PasswordHash> {
    run_blocking(PasswordHash::unmatchable).await
}

/// Whether `tried` matches `stored`. Without a stored hash the answer is no, after the same time.
pub async fn matches(tried: Password, stored: Option<PasswordHash>) -> HandlerResult<bool> {
    run_blocking(move || match stored {
        Some(stored) => stored.matches(&tried),
        None => {
            UNKNOWN_LOGIN_HASH.matches(&tried);
            false
        }
    })
    .await
}

async fn run_blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> HandlerResult<T> {
    let _permit = HASH_SLOTS.acquire().await.map_err(|e| ProblemResponse::internal("waiting for a hash slot", e))?;
    tokio::task::spawn_blocking(work).await.map_err(|e| ProblemResponse::internal("hashing a password", e))
}
