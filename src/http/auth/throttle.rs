//! Slows down guessing of passwords: failed sign-ins are counted per login, and per address.
//!
//! **Per login.** After a few failures the next attempt has to wait, and the wait doubles with each further failure,
//! from any address. A place that has signed in to the account before (a browser, or an address) has
//! a counter of its own, so that guesses from elsewhere do not lock its owner out. **Per address.** Attempts of strangers come
//! out of a budget that refills at a constant rate (the generic cell rate algorithm), so that one address cannot try many
//! logins. Known places are exempt: a training room shares one address.
//!
//! An attempt is counted before the password is checked, so parallel attempts gain nothing. Both counters are raised
//! together or not at all. A right password takes the attempt back. (`governor` cannot take back, and knows no growing
//! wait.)

use std::collections::HashMap;
use std::hash::Hash;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use crate::domain::secret::SecretHash;
use crate::domain::text::Login;
use crate::time::{SharedClock, millis};

/// Most logins, places and addresses that are remembered, each. At the limit the one that failed longest ago is
/// forgotten. A login has at most 64 characters, so the tables take less than 5 MiB.
const MAX_KEYS: usize = 10_000;
/// One address may fail this many times as often as one login: a training room shares one address.
const LOGINS_PER_ADDRESS: u32 = 12;
/// The first wait after the free failures.
const FIRST_WAIT: Duration = Duration::from_secs(5);
/// The longest wait: a guesser gets four attempts an hour, and the owner of the account does not give up.
const LONGEST_WAIT: Duration = Duration::from_secs(15 * 60);
/// Failures are forgotten this long after the last one.
const MEMORY: Duration = Duration::from_secs(60 * 60);

/// Where an attempt comes from.
#[derive(Clone, Copy, Debug)]
pub struct AttemptOrigin {
    /// The client's address.
    pub address: IpAddr,
    /// The browser or the address, if it has signed in to this account before.
    pub known_place: Option<SecretHash>,
}

/// Counts failed sign-ins per login, and per address.
pub struct Throttle {
    clock: SharedClock,
    /// Failures without a wait.
    free: u32,
    counters: Mutex<Counters>,
}

struct Counters {
    of_strangers: FailureTable<Login>,
    of_known_places: FailureTable<(Login, SecretHash)>,
    by_address: CellRateLimiter,
}

/// A sign-in attempt that has been counted.
pub struct SignInAttempt<'t> {
    throttle: &'t Throttle,
    login: Login,
    origin: AttemptOrigin,
}

impl Throttle {
    /// Allows `per_min` failures of a login without a wait, and twelve times as many a minute from an address.
    pub fn new(per_min: u32, clock: SharedClock) -> Self {
        let counters = Counters {
            of_strangers: FailureTable::default(),
            of_known_places: FailureTable::default(),
            by_address: CellRateLimiter::new(per_min.saturating_mul(LOGINS_PER_ADDRESS)),
        };
        Self { clock, free: per_min.max(1), counters: Mutex::new(counters) }
    }

    /// Counts an attempt.
    ///
    /// # Errors
    /// How long to wait; then nothing was counted.
    pub fn attempt(&self, login: &Login, origin: AttemptOrigin) -> Result<SignInAttempt<'_>, Duration> {
        let now_ms = self.clock.now_ms();
        let counters = &mut *self.counters();
        let attempt = SignInAttempt { throttle: self, login: login.clone(), origin };
        if let Some(place) = origin.known_place {
            let key = (login.clone(), place);
            counters.of_known_places.wait(&key, self.free, now_ms)?;
            counters.of_known_places.add(key, now_ms);
            return Ok(attempt);
        }
        counters.of_strangers.wait(login, self.free, now_ms)?;
        counters.by_address.take(network_of(origin.address), now_ms)?;
        counters.of_strangers.add(login.clone(), now_ms);
        Ok(attempt)
    }

    /// Counts an attempt with a text that is no login: nobody has it, so only the address is slowed.
    ///
    /// # Errors
    /// How long to wait.
    pub fn attempt_without_login(&self, address: IpAddr) -> Result<(), Duration> {
        self.counters().by_address.take(network_of(address), self.clock.now_ms())
    }

    fn counters(&self) -> std::sync::MutexGuard<'_, Counters> {
        self.counters.lock().unwrap_or_else(PoisonError::into_inner) // numbers only: no panic leaves them half changed
    }
}

impl SignInAttempt<'_> {
    /// The password was right: takes the attempt back.
    pub fn succeeded(self) {
        let counters = &mut *self.throttle.counters();
        match self.origin.known_place {
            Some(place) => counters.of_known_places.forget(&(self.login, place)),
            None => {
                counters.by_address.refund(&network_of(self.origin.address));
                counters.of_strangers.take_back(&self.login);
            }
        }
    }
}

/// The network that counts as one address: a subscriber usually has a whole /64 of IPv6.
fn network_of(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(v6) => IpAddr::V6(Ipv6Addr::from_bits(v6.to_bits() & (u128::MAX << 64))),
        v4 => v4,
    }
}

/// Failures of many keys.
struct FailureTable<K> {
    failures: HashMap<K, Failures>,
}

#[derive(Clone, Copy)]
struct Failures {
    count: u32,
    last_ms: i64,
}

impl<K> Default for FailureTable<K> {
    fn default() -> Self {
        Self { failures: HashMap::new() }
    }
}

impl<K: Eq + Hash + Clone> FailureTable<K> {
    fn wait(&self, key: &K, free: u32, now_ms: i64) -> Result<(), Duration> {
        let Some(failed) = self.failures.get(key).filter(|failed| now_ms - failed.last_ms < millis(MEMORY)) else {
            return Ok(());
        };
        let Some(doublings) = failed.count.checked_sub(free) else { return Ok(()) };
        let wait = FIRST_WAIT.saturating_mul(2_u32.saturating_pow(doublings)).min(LONGEST_WAIT);
        let left_ms = failed.last_ms + millis(wait) - now_ms;
        if left_ms > 0 { Err(Duration::from_millis(left_ms.unsigned_abs())) } else { Ok(()) }
    }

    fn add(&mut self, key: K, now_ms: i64) {
        if self.failures.len() >= MAX_KEYS && !self.failures.contains_key(&key) {
            self.failures.retain(|_, failed| now_ms - failed.last_ms < millis(MEMORY));
        }
        if self.failures.len() >= MAX_KEYS && !self.failures.contains_key(&key) {
            let oldest = self.failures.iter().min_by_key(|(_, failed)| failed.last_ms).map(|(key, _)| key.clone());
            oldest.map(|oldest| self.failures.remove(&oldest));
        }
        let failed = self.failures.entry(key).or_insert(Failures { count: 0, last_ms: now_ms });
        if now_ms - failed.last_ms >= millis(MEMORY) {
            failed.count = 0;
        }
        *failed = Failures { count: failed.count.saturating_add(1), last_ms: now_ms };
    }

    fn take_back(&mut self, key: &K) {
        if let Some(failed) = self.failures.get_mut(key) {
            failed.count = failed.count.saturating_sub(1);
        }
    }

    fn forget(&mut self, key: &K) {
        self.failures.remove(key);
    }
}

/// A rate limiter for many addresses, each with a number of tokens that come back one by one within a minute.
struct CellRateLimiter {
    /// When an address has all its tokens again, epoch ms.
    full_at_ms: HashMap<IpAddr, i64>,
    /// Time until one token comes back, ms.
    token_interval_ms: i64,
    /// Tokens of an address.
    max_tokens: i64,
}

impl CellRateLimiter {
    fn new(per_min: u32) -> Self {
        let max_tokens = i64::from(per_min.max(1));
        Self { full_at_ms: HashMap::new(), token_interval_ms: (60_000 / max_tokens).max(1), max_tokens }
    }

    fn take(&mut self, address: IpAddr, now_ms: i64) -> Result<(), Duration> {
        if self.full_at_ms.len() >= MAX_KEYS && !self.full_at_ms.contains_key(&address) {
            self.full_at_ms.retain(|_, full_at_ms| *full_at_ms > now_ms);
            if self.full_at_ms.len() >= MAX_KEYS {
                let soonest = self.full_at_ms.iter().min_by_key(|(_, at_ms)| **at_ms).map(|(address, _)| *address);
                soonest.map(|soonest| self.full_at_ms.remove(&soonest));
            }
        }
        let full_at_ms =
            self.full_at_ms.get(&address).map_or(now_ms, |at_ms| now_ms.max(*at_ms)) + self.token_interval_ms;
        let wait_ms = full_at_ms - now_ms - self.token_interval_ms * self.max_tokens;
        if wait_ms > 0 {
            return Err(Duration::from_millis(wait_ms.unsigned_abs()));
        }
        self.full_at_ms.insert(address, full_at_ms);
        Ok(())
    }

    fn refund(&mut self, address: &IpAddr) {
        if let Some(full_at_ms) = self.full_at_ms.get_mut(address) {
            *full_at_ms -= self.token_interval_ms;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::time::ManualClock;

    const HERE: IpAddr = IpAddr::V4(std::net::Ipv4Addr::LOCALHOST);

    fn throttle() -> (Throttle, Arc<ManualClock>) {
        let clock = ManualClock::at(1_000_000);
        (Throttle::new(5, clock.clone()), clock)
    }

    fn login(text: &str) -> Login {
        text.parse().unwrap()
    }

    fn stranger_at(n: u32) -> AttemptOrigin {
        AttemptOrigin { address: IpAddr::from(n.to_be_bytes()), known_place: None }
    }

    fn known(place: u8) -> AttemptOrigin {
        AttemptOrigin { address: HERE, known_place: Some(SecretHash([place; 32])) }
    }

    #[test]
    fn guesses_of_one_login_wait_longer_and_longer_from_every_address() {
        let (throttle, clock) = throttle();
        for n in 0..5 {
            throttle.attempt(&login("ada"), stranger_at(n)).map(drop).unwrap();
        }
        let mut waits = Vec::new();
        for n in 5..20 {
            let wait = throttle.attempt(&login("ada"), stranger_at(n)).map(drop).unwrap_err();
            waits.push(wait.as_secs());
            clock.advance(wait);
            throttle.attempt(&login("ada"), stranger_at(n)).map(drop).unwrap();
        }
        assert_eq!(waits[..8], [5, 10, 20, 40, 80, 160, 320, 640]);
        assert!(waits[8..].iter().all(|wait| *wait == 900), "{waits:?}");
        assert!(throttle.attempt(&login("bob"), stranger_at(0)).is_ok(), "other logins do not wait");
        clock.advance(MEMORY);
        assert!(throttle.attempt(&login("ada"), stranger_at(0)).is_ok(), "an hour later all is forgotten");
    }

    #[test]
    fn known_places_do_not_wait_for_the_guesses_of_strangers() {
        let (throttle, _clock) = throttle();
        let guess = |n| throttle.attempt(&login(&format!("login{n}")), AttemptOrigin { known_place: None, ..known(1) });
        assert_eq!((0..100).filter(|n| guess(*n).is_err()).count(), 40, "one address tries many logins");
        for n in 0..5 {
            throttle.attempt(&login("ada"), stranger_at(n)).map(drop).unwrap();
        }
        assert!(throttle.attempt(&login("ada"), stranger_at(9)).is_err());
        throttle.attempt(&login("ada"), known(1)).map(SignInAttempt::succeeded).unwrap();
        for _ in 0..5 {
            throttle.attempt(&login("ada"), known(1)).map(drop).unwrap();
        }
        assert!(throttle.attempt(&login("ada"), known(1)).is_err(), "a stolen browser may not guess either");
        assert!(throttle.attempt(&login("ada"), known(2)).is_ok());
    }

    #[test]
    fn a_right_password_costs_nothing() {
        let (throttle, _clock) = throttle();
        for origin in [stranger_at(1), known(1)] {
            for _ in 0..1000 {
                throttle.attempt(&login("ada"), origin).map(SignInAttempt::succeeded).unwrap();
            }
        }
    }

    #[test]
    fn a_refused_attempt_raises_neither_counter() {
        let (throttle, clock) = throttle();
        let at = |name: &str| throttle.attempt(&login(name), stranger_at(1)).map(drop);
        (0..5).for_each(|_| at("ada").unwrap());
        assert!((0..1000).all(|_| at("ada").is_err()));
        assert_eq!((0..60).filter(|n| at(&format!("login{n}")).is_ok()).count(), 55, "the refused ones took no token");
        assert!((0..1000).all(|_| at("bob").is_err()));
        clock.advance(Duration::from_secs(60));
        assert_eq!((0..6).filter(|_| at("bob").is_ok()).count(), 5, "bob's failures were not counted");
    }

    #[test]
    fn the_addresses_of_one_subscriber_count_as_one() {
        let (throttle, _clock) = throttle();
        let at = |n: u128| IpAddr::V6(Ipv6Addr::from_bits((0x2001_0db8 << 96) + n));
        assert_eq!((0..100).filter(|n| throttle.attempt_without_login(at(*n)).is_ok()).count(), 60);
    }

    #[test]
    fn the_number_of_keys_is_bounded_and_the_oldest_is_forgotten() {
        let (throttle, _clock) = throttle();
        for n in 0..20_000 {
            let attempt = throttle.attempt(&login(&format!("login{n}")), stranger_at(n));
            assert!(attempt.is_ok(), "{n}");
            throttle
                .attempt(
                    &login("ada"),
                    AttemptOrigin { known_place: Some(SecretHash([n as u8; 32])), ..stranger_at(n) },
                )
                .map(drop)
                .ok();
        }
        let counters = throttle.counters();
        assert!(counters.of_strangers.failures.len() <= MAX_KEYS);
        assert!(counters.by_address.full_at_ms.len() <= MAX_KEYS);
        assert!(counters.of_strangers.failures.contains_key(&login("login19999")));
    }
}
