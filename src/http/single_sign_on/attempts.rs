//! Sign-ins that have begun: the browser is at the provider, and its answer has not come yet.
//!
//! They are kept in memory, since they last minutes: after a restart of the service, people begin again. Each is bound
//! to the browser that began it, and is used once. Their number is limited, in all and for each network.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::http::header;

use crate::domain::secret::SecretHash;
use crate::http::auth::throttle::network_of;
use crate::http::error::{HandlerResult, Refusal};
use crate::identity_provider::ExpectedAnswer;
use crate::ids::PersonId;
use crate::time::{SharedClock, millis};

/// How long a person may take at the provider: time for a second factor, or for a forgotten password.
pub const ATTEMPT_LIFETIME: Duration = Duration::from_secs(10 * 60);
/// Most of one network: a class of 40 behind one address begins twice, with room.
const MAX_OF_NETWORK: usize = 100;
/// Most in all. Each takes less than 1 KiB.
const MAX_ATTEMPTS: usize = 5_000;

/// A sign-in that has begun.
pub struct ProviderAttempt {
    /// The browser that began it.
    pub browser: SecretHash,
    /// What the provider's answer is verified with.
    pub expected: ExpectedAnswer,
    /// What to do with the answer.
    pub purpose: Purpose,
    /// The page to show afterwards.
    pub next: String,
}

/// What the provider is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// To sign in.
    SignIn,
    /// To link the provider's account to this account, which has signed in.
    Link(PersonId),
}

/// The sign-ins that have begun, by the hash of their state.
pub struct ProviderAttempts {
    clock: SharedClock,
    begun: Mutex<HashMap<SecretHash, Begun>>,
}

struct Begun {
    attempt: ProviderAttempt,
    network: IpAddr,
    ends_at_ms: i64,
}

impl ProviderAttempts {
    /// None yet.
    pub fn new(clock: SharedClock) -> Self {
        Self { clock, begun: Mutex::default() }
    }

    /// Remembers a sign-in until its answer comes or it expires.
    ///
    /// # Errors
    /// There are too many: 429 if this network has its most, else 503.
    pub fn begin(&self, state: SecretHash, attempt: ProviderAttempt, address: IpAddr) -> HandlerResult<()> {
        let (now_ms, network) = (self.clock.now_ms(), network_of(address));
        let mut begun = self.lock();
        begun.retain(|_, one| one.ends_at_ms > now_ms);
        if begun.values().filter(|one| one.network == network).count() >= MAX_OF_NETWORK {
            return Err(Refusal::TooMany
                .with("Too many sign-ins with the provider have begun in your network. Try again in a minute.")
                .header(header::RETRY_AFTER, 60));
        }
        if begun.len() >= MAX_ATTEMPTS {
            return Err(Refusal::Busy
                .with("Too many sign-ins with the provider have begun. Try again in a minute.")
                .header(header::RETRY_AFTER, 60));
        }
        let ends_at_ms = now_ms + millis(ATTEMPT_LIFETIME);
        begun.insert(state, Begun { attempt, network, ends_at_ms });
        Ok(())
    }

    /// Takes the sign-in with this state that this browser began. `None` if there is none, or no longer.
    pub fn take(&self, state: SecretHash, browser: SecretHash) -> Option<ProviderAttempt> {
        let now_ms = self.clock.now_ms();
        let mut begun = self.lock();
        begun.get(&state).filter(|one| one.attempt.browser == browser && one.ends_at_ms > now_ms)?;
        begun.remove(&state).map(|one| one.attempt)
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<SecretHash, Begun>> {
        self.begun.lock().unwrap_or_else(PoisonError::into_inner) // whole at every moment
    }
}
