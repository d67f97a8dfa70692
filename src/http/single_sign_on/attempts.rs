//! Sign-ins that have begun: the browser is at the provider, and its answer has not come yet.
//!
//! They are kept in memory, since they last minutes: after a restart of the service, people begin again. Each is bound
//! to the browser that began it, and is used once.
//!
//! **Limits.** Beginning is never refused: all of a hospital may share one address, and a sign-in that begins proves
//! nothing. At the limit of a browser, its oldest sign-in is forgotten. At the limit in all, the oldest one of the site with
//! the most is, so that one site which begins thousands takes no place from the others. A site is an address of IPv4, or a
//! /48 of IPv6: providers assign that much to one customer, who could else begin from 65,536 networks of one sign-in each.
//! If no site has more than [`ORDINARY_OF_SITE`], the oldest of all is forgotten: a hospital behind one address is not taken
//! for the attacker when the attack comes from many sites. Rejected: a limit for each site, which locks people out by the
//! ordinary use of their colleagues. Wrong answers are limited elsewhere ([`crate::http::auth::throttle`]).

use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::domain::secret::SecretHash;
use crate::identity_provider::ExpectedAnswer;
use crate::ids::PersonId;
use crate::time::{SharedClock, millis};

/// How long a person may take at the provider: time for a second factor, or for a forgotten password.
pub const ATTEMPT_LIFETIME: Duration = Duration::from_secs(10 * 60);
/// Most of one browser: a person who opens many pages at once has one in each.
const MAX_OF_BROWSER: usize = 20;
/// Most in all: a hospital of thousands begins within [`ATTEMPT_LIFETIME`]. Each takes less than 1 KiB.
const MAX_ATTEMPTS: usize = 5_000;
/// Most of one site that are taken for ordinary use: one that begins every six seconds within [`ATTEMPT_LIFETIME`].
const ORDINARY_OF_SITE: usize = 100;

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
    site: IpAddr,
    ends_at_ms: i64,
}

impl ProviderAttempts {
    /// None yet.
    pub fn new(clock: SharedClock) -> Self {
        Self { clock, begun: Mutex::default() }
    }

    /// Remembers a sign-in until its answer comes or it expires.
    pub fn begin(&self, state: SecretHash, attempt: ProviderAttempt, address: IpAddr) {
        let (now_ms, site) = (self.clock.now_ms(), site_of(address));
        let mut begun = self.lock();
        begun.attempts.retain(|_, one| one.ends_at_ms > now_ms);
        begun.make_room(&attempt.browser);
        begun.last += 1;
        let (number, ends_at_ms) = (begun.last, now_ms + millis(ATTEMPT_LIFETIME));
        begun.attempts.insert(state, Begun { number, attempt, site, ends_at_ms });
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
            let mut of_sites: HashMap<IpAddr, usize> = HashMap::new();
            self.attempts.values().for_each(|one| *of_sites.entry(one.site).or_default() += 1);
            let busiest = of_sites.into_iter().max_by_key(|(_, count)| *count);
            match busiest.filter(|(_, count)| *count > ORDINARY_OF_SITE) {
                Some((busiest, _)) => self.forget_oldest(|one| one.site == busiest),
                None => self.forget_oldest(|_| true),
            }
        }
    }

    fn forget_oldest(&mut self, is_meant: impl Fn(&Begun) -> bool) {
        let meant = self.attempts.iter().filter(|(_, one)| is_meant(one));
        let oldest = meant.min_by_key(|(_, one)| one.number).map(|(state, _)| *state);
        oldest.map(|state| self.attempts.remove(&state));
    }
}

/// What probably belongs to one customer of a provider: an address of IPv4, or a /48 of IPv6.
fn site_of(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(v6) => IpAddr::V6(Ipv6Addr::from_bits(v6.to_bits() & (u128::MAX << 80))),
        v4 => v4,
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
    fn a_site_that_begins_thousands_takes_no_place_from_others() {
        let (attempts, own) = (attempts(), Secret::random().hash());
        let colleague = begin(&attempts, own, "10.0.0.1");
        let other = begin(&attempts, own, "10.0.0.2");
        for _ in 0..MAX_ATTEMPTS + 100 {
            begin(&attempts, Secret::random().hash(), "10.0.0.1");
        }
        assert!(attempts.take(other, own).is_some());
        assert!(attempts.take(colleague, own).is_none(), "the oldest of the site with the most is forgotten");
        assert!(attempts.lock().attempts.len() <= MAX_ATTEMPTS);
    }

    #[test]
    fn the_networks_of_one_site_count_together() {
        let (attempts, own) = (attempts(), Secret::random().hash());
        let mut of_hospital = Vec::new();
        for _ in 0..3 * MAX_OF_BROWSER {
            let browser = Secret::random().hash();
            of_hospital.push((begin(&attempts, browser, "10.0.0.1"), browser));
        }
        for network in 0..MAX_ATTEMPTS {
            begin(&attempts, Secret::random().hash(), &format!("2001:db8:7:{network:x}::1"));
        }
        begin(&attempts, own, "2001:db8:8::1");
        assert!(of_hospital.into_iter().all(|(state, browser)| attempts.take(state, browser).is_some()));
    }

    #[test]
    fn without_a_busy_site_the_oldest_sign_in_is_forgotten() {
        let (attempts, own) = (attempts(), Secret::random().hash());
        let oldest = begin(&attempts, own, "203.0.113.1");
        let mut of_hospital = Vec::new();
        for _ in 0..ORDINARY_OF_SITE {
            let browser = Secret::random().hash();
            of_hospital.push((begin(&attempts, browser, "10.0.0.1"), browser));
        }
        for number in 0..MAX_ATTEMPTS - ORDINARY_OF_SITE {
            begin(&attempts, Secret::random().hash(), &format!("2001:db8:{number:x}::1"));
        }
        assert!(attempts.take(oldest, own).is_none());
        assert!(of_hospital.into_iter().all(|(state, browser)| attempts.take(state, browser).is_some()));
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
