//! Hashes passwords on blocking threads, a few at a time. A check takes as long for an unknown login as for
//! a known one.

use std::sync::LazyLock;

use tokio::sync::Semaphore;

use crate::domain::secret::{Password, PasswordHash};
use crate::http::error::{Answer, Problem};

/// Limits the hashes computed at once. Each takes 19 MiB and a core: a flood of sign-ins must not occupy all cores.
static PLACES: Semaphore = Semaphore::const_new(4);

/// Compared against when the login is unknown, so that the check takes the same time.
static NOBODY: LazyLock<PasswordHash> = LazyLock::new(PasswordHash::of_nobody);

/// The hash to store for a password.
pub async fn hash(password: Password) -> Answer<PasswordHash> {
    apart(move || password.hash()).await
}

/// Whether `tried` matches `stored`. Without a stored hash the answer is no, after the same time.
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
    let _permit = PLACES.acquire().await.map_err(|e| Problem::internal("waiting for a hash slot", e))?;
    tokio::task::spawn_blocking(work).await.map_err(|e| Problem::internal("hashing a password", e))
}
