//! Sign-ins that have begun: the browser is at the provider, and its answer has not come yet.
//!
//! They are kept in memory, since they last minutes: after a restart of the service, people begin again. Each is bound
//! to the browser that began it, and is used once.
//!
//! **Limits.** Beginning is never refused: all of a hospital may share one address, and a sign-in that begins proves
//! nothing. At the limit of a browser, its oldest sign-in is forgotten. At the limit in all, the oldest one of the network
//! with the most is, so that one network which begins thousands takes no place from the others. Rejected: a limit for each
//! network, which locks people out by the ordinary use of their colleagues. Wrong answers are limited elsewhere
//! ([`crate::http::auth::throttle`]).

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::domain::secret::SecretHash;
use crate::http::auth::throttle::network_of;
use crate::identity_provider::ExpectedAnswer;
use crate::ids::PersonId;
use crate::time::{SharedClock, millis};

/// How long a person may take at the provider: time for a second factor, or for a forgotten password.
pub const ATTEMPT_LIFETIME: Duration = Duration::from_secs(10 * 60);
/// Most of one browser: a person who opens many pages at once has one in each.
const MAX_OF_BROWSER: usize = 20;
/// Most in all: a hospital of thousands begins within [`ATTEMPT_LIFETIME`]. Each takes less than 1 KiB.
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
    begun: Mutex<BegunAttempts>,
}

#[derive(Default)]
struct BegunAttempts {
    attempts: HashMap<SecretHash, Begun>,
    /// Number of the last one.
    last: u64,
}

struct Begun {
    /// 1, 2, … in the order of their beginning.
    number: u64,
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
    pub fn begin(&self, state: SecretHash, attempt: ProviderAttempt, address: IpAddr) {
        let (now_ms, network) = (self.clock.now_ms(), network_of(address));
        let mut begun = self.lock();
        begun.attempts.retain(|_, one| one.ends_at_ms > now_ms);
        begun.make_room(&attempt.browser);
        begun.last += 1;
        let (number, ends_at_ms) = (begun.last, now_ms + millis(ATTEMPT_LIFETIME));
        begun.attempts.insert(state, Begun { number, attempt, network, ends_at_ms });
    }

    /// Takes the sign-in with this state that this browser began. `None` if there is none, or no longer.
    pub fn take(&self, state: SecretHash, browser: SecretHash) -> Option<ProviderAttempt> {
        let now_ms = self.clock.now_ms();
        let mut begun = self.lock();
        begun.attempts.get(&state).filter(|one| one.attempt.browser == browser && one.ends_at_ms > now_ms)?;
        begun.attempts.remove(&state).map(|one| one.attempt)
    }

    fn lock(&self) -> MutexGuard<'_, BegunAttempts> {
        self.begun.lock().unwrap_or_else(PoisonError::into_inner) // whole at every moment
    }
}

impl BegunAttempts {
    /// Forgets the oldest sign-ins, so that there is room for one more of this browser.
    fn make_room(&mut self, browser: &SecretHash) {
        while self.attempts.values().filter(|one| one.attempt.browser == *browser).count() >= MAX_OF_BROWSER {
            self.forget_oldest(|one| one.attempt.browser == *browser);
        }
        while self.attempts.len() >= MAX_ATTEMPTS {
            let mut of_networks: HashMap<IpAddr, usize> = HashMap::new();
            self.attempts.values().for_each(|one| *of_networks.entry(one.network).or_default() += 1);
            let Some((busiest, _)) = of_networks.into_iter().max_by_key(|(_, count)| *count) else { return };
            self.forget_oldest(|one| one.network == busiest);
        }
    }

    fn forget_oldest(&mut self, is_meant: impl Fn(&Begun) -> bool) {
        let meant = self.attempts.iter().filter(|(_, one)| is_meant(one));
        let oldest = meant.min_by_key(|(_, one)| one.number).map(|(state, _)| *state);
        oldest.map(|state| self.attempts.remove(&state));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::secret::Secret;
    use crate::time::ManualClock;

    fn attempts() -> ProviderAttempts {
        ProviderAttempts::new(ManualClock::at(0))
    }

    /// Begins a sign-in; returns its state.
    fn begin(attempts: &ProviderAttempts, browser: SecretHash, address: &str) -> SecretHash {
        let state = Secret::random().hash();
        let expected = ExpectedAnswer::of_no_answer();
        let attempt = ProviderAttempt { browser, expected, purpose: Purpose::SignIn, next: "/".to_owned() };
        attempts.begin(state, attempt, address.parse().unwrap());
        state
    }

    #[test]
    fn a_network_that_begins_thousands_takes_no_place_from_others() {
        let (attempts, own) = (attempts(), Secret::random().hash());
        let colleague = begin(&attempts, own, "10.0.0.1");
        let other = begin(&attempts, own, "10.0.0.2");
        for _ in 0..MAX_ATTEMPTS + 100 {
            begin(&attempts, Secret::random().hash(), "10.0.0.1");
        }
        assert!(attempts.take(other, own).is_some());
        assert!(attempts.take(colleague, own).is_none(), "the oldest of the network with the most is forgotten");
        assert!(attempts.lock().attempts.len() <= MAX_ATTEMPTS);
    }

    #[test]
    fn a_browser_forgets_its_oldest_sign_ins() {
        let (attempts, own) = (attempts(), Secret::random().hash());
        let states: Vec<SecretHash> = (0..MAX_OF_BROWSER + 1).map(|_| begin(&attempts, own, "10.0.0.1")).collect();
        let known: Vec<bool> = states.into_iter().map(|state| attempts.take(state, own).is_some()).collect();
        assert_eq!(known.iter().position(|known| *known), Some(1), "only the first one is forgotten");
        assert_eq!(known.iter().filter(|known| **known).count(), MAX_OF_BROWSER);
    }
}
