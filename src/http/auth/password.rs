//! Passwords off the async threads, a few at a time, and as slow for a login that does not exist as for one that does.

use std::sync::LazyLock;

use tokio::sync::Semaphore;

use crate::domain::secret::{Password, PasswordHash};
use crate::http::error::{Answer, Problem};

/// Hashes computed at once. Each takes 19 MiB and a core: a flood of sign-ins must not take them all.
static PLACES: Semaphore = Semaphore::const_new(4);

/// Compared with when the login is unknown.
static NOBODY: LazyLock<PasswordHash> = LazyLock::new(PasswordHash::of_nobody);

/// What to store of a password.
pub async fn hash(password: Password) -> Answer<PasswordHash> {
    apart(move || password.hash()).await
}

/// Whether `tried` is the password behind `stored`; without a stored hash the answer is no, after the same time.
pub async fn matches(tried: Password, stored: Option<PasswordHash>) -> Answer<bool> {
    apart(move || match stored {
        Some(stored) => stored.matches(&tried),
        None => {
            NOBODY.matches(&tried);
            false
        }
    })
    .await
}

async fn apart<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Answer<T> {
    let _place = PLACES.acquire().await.map_err(|e| Problem::internal("waiting for a place to hash", e))?;
    tokio::task::spawn_blocking(work).await.map_err(|e| Problem::internal("hashing a password", e))
}
