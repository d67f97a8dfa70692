//! Slows down guessing of passwords: failed sign-ins are counted per login, and per address.
//!
//! **Per login.** After a few failures the next attempt has to wait, and the wait doubles with each further failure,
//! from any address. A place that has signed in to the account before (a browser, or an address), or has set its
//! password with a link, has a counter of its own, so that guesses from elsewhere do not lock its owner out. **Per
//! address.** Attempts come out of a budget that refills at a constant rate (the generic cell rate algorithm), so that
//! one address cannot try many logins. Only known browsers are exempt: if known addresses were, the answers there would
//! show which logins exist.
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

/// Most logins, places, addresses and known networks that are remembered, each. At the limit the one with the fewest failures is
/// forgotten, of several the one that failed longest ago. A login has at most 64 characters, so the tables take less
/// than 5 MiB.
const MAX_KEYS: usize = 10_000;
/// One address may fail this many times as often as one login: a training room shares one address.
const LOGINS_PER_ADDRESS: u32 = 12;
/// The first wait after the free failures.
const FIRST_WAIT: Duration = Duration::from_secs(5);
/// The longest wait: a guesser gets four attempts an hour, and the owner of the account does not give up.
const LONGEST_WAIT: Duration = Duration::from_secs(15 * 60);
/// A network is known this long after its last successful sign-in.
const MEMORY_OF_NETWORK: Duration = Duration::from_secs(24 * 60 * 60);
/// Failures are forgotten this long after the last one.
const MEMORY: Duration = Duration::from_secs(60 * 60);

/// Where an attempt comes from.
#[derive(Clone, Copy, Debug)]
pub struct AttemptOrigin {
    /// The client's address.
    pub address: IpAddr,
    /// The place, if it has signed in to this account before.
    pub known_place: Option<KnownPlace>,
}

/// A place that has signed in to an account before.
#[derive(Clone, Copy, Debug)]
pub struct KnownPlace {
    /// Recognises it.
    pub counter: SecretHash,
    /// True for a browser, false for an address.
    pub is_browser: bool,
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
    /// Networks with a successful sign-in, of any account, and when the last one was, epoch ms.
    known_networks: HashMap<IpAddr, i64>,
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
            known_networks: HashMap::new(),
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
        let place = origin.known_place.map(|place| (login.clone(), place.counter));
        match &place {
            Some(place) => counters.of_known_places.wait(place, self.free, now_ms)?,
            None => counters.of_strangers.wait(login, self.free, now_ms)?,
        }
        if !origin.is_known_browser() {
            counters.by_address.take(network_of(origin.address), now_ms)?;
        }
        match place {
            Some(place) => counters.of_known_places.add(place, now_ms),
            None => counters.of_strangers.add(login.clone(), now_ms),
        }
        Ok(attempt)
    }

    /// Forgets the failures of a login, since an administrator has set its password.
    pub fn forget(&self, login: &Login) {
        let counters = &mut *self.counters();
        counters.of_strangers.forget(login);
        counters.of_known_places.failures.retain(|(of, _), _| of != login);
    }

    /// Counts an attempt that cannot be right, with a text that is no login or a password that is too long: only the
    /// address is slowed.
    ///
    /// # Errors
    /// How long to wait.
    pub fn attempt_without_login(&self, address: IpAddr) -> Result<(), Duration> {
        self.counters().by_address.take(network_of(address), self.clock.now_ms())
    }

    /// Whether there was a successful sign-in from the address's network in the last 24 hours, since the service began.
    /// It does not depend on the login, so the answers do not show which logins exist.
    pub fn knows_network_of(&self, address: IpAddr) -> bool {
        let oldest_ms = self.clock.now_ms() - millis(MEMORY_OF_NETWORK);
        self.counters().known_networks.get(&network_of(address)).is_some_and(|last_ms| *last_ms > oldest_ms)
    }

    fn counters(&self) -> std::sync::MutexGuard<'_, Counters> {
        self.counters.lock().unwrap_or_else(PoisonError::into_inner) // numbers only: no panic leaves them half changed
    }
}

impl Counters {
    fn remember_network(&mut self, network: IpAddr, now_ms: i64) {
        if self.known_networks.len() >= MAX_KEYS && !self.known_networks.contains_key(&network) {
            let oldest = self.known_networks.iter().min_by_key(|(_, last_ms)| **last_ms).map(|(network, _)| *network);
            oldest.map(|oldest| self.known_networks.remove(&oldest));
        }
        self.known_networks.insert(network, now_ms);
    }
}

impl AttemptOrigin {
    /// True for a browser that has signed in to this account before.
    pub fn is_known_browser(&self) -> bool {
        self.known_place.is_some_and(|place| place.is_browser)
    }
}

impl SignInAttempt<'_> {
    /// The password was right: takes the attempt back.
    pub fn succeeded(self) {
        let counters = &mut *self.throttle.counters();
        if !self.origin.is_known_browser() {
            counters.by_address.refund(&network_of(self.origin.address));
        }
        counters.remember_network(network_of(self.origin.address), self.throttle.clock.now_ms());
        match self.origin.known_place {
            Some(place) => counters.of_known_places.forget(&(self.login, place.counter)),
            None => counters.of_strangers.take_back(&self.login),
        }
    }
}

/// The network that counts as one address: a subscriber usually has a whole /64 of IPv6.
pub fn network_of(address: IpAddr) -> IpAddr {
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
            let least = self.failures.iter().min_by_key(|(_, failed)| (failed.count, failed.last_ms));
            let least = least.map(|(key, _)| key.clone());
            least.map(|least| self.failures.remove(&least));
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
        let place = KnownPlace { counter: SecretHash([place; 32]), is_browser: true };
        AttemptOrigin { address: HERE, known_place: Some(place) }
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
    fn a_known_address_has_its_own_counter_but_no_budget_of_its_own() {
        let (throttle, _clock) = throttle();
        let place = |is_browser| Some(KnownPlace { counter: SecretHash([7; 32]), is_browser });
        let ada_from = |is_browser| {
            throttle.attempt(&login("ada"), AttemptOrigin { address: HERE, known_place: place(is_browser) }).map(drop)
        };
        for n in 0..5 {
            throttle.attempt(&login("ada"), stranger_at(n)).map(drop).unwrap();
        }
        assert!(ada_from(false).is_ok(), "guesses from elsewhere");
        while throttle.attempt_without_login(HERE).is_ok() {}
        assert!(ada_from(false).is_err(), "as for a login that does not exist");
        assert!(ada_from(true).is_ok());
    }

    #[test]
    fn a_network_is_known_for_a_day_after_a_sign_in_from_it() {
        let (throttle, clock) = throttle();
        let knows = |n| throttle.knows_network_of(stranger_at(n).address);
        throttle.attempt(&login("ada"), stranger_at(1)).map(drop).unwrap();
        assert!(!knows(1), "the password was wrong");
        throttle.attempt(&login("ada"), stranger_at(1)).map(SignInAttempt::succeeded).unwrap();
        assert!(knows(1) && !knows(2));
        clock.advance(MEMORY_OF_NETWORK);
        assert!(!knows(1));
        for n in 0..15_000 {
            clock.advance(Duration::from_millis(1));
            throttle.attempt(&login("ada"), stranger_at(n)).map(SignInAttempt::succeeded).unwrap();
        }
        assert_eq!(throttle.counters().known_networks.len(), MAX_KEYS);
        assert!(knows(14_999) && !knows(0));
    }

    #[test]
    fn a_new_password_ends_the_wait() {
        let (throttle, _clock) = throttle();
        for origin in [stranger_at(1), known(1)] {
            while throttle.attempt(&login("ada"), origin).is_ok() {}
        }
        throttle.forget(&login("ada"));
        assert!([stranger_at(1), known(1)].into_iter().all(|origin| throttle.attempt(&login("ada"), origin).is_ok()));
    }

    #[test]
    fn the_number_of_keys_is_bounded_and_the_fewest_failures_are_forgotten_first() {
        let (throttle, clock) = throttle();
        (0..2).for_each(|n| throttle.attempt(&login("ada"), stranger_at(n)).map(drop).unwrap());
        for n in 0..15_000_u32 {
            clock.advance(Duration::from_millis(1));
            throttle.attempt(&login(&format!("login{n}")), stranger_at(n)).map(drop).unwrap();
            let counter = SecretHash(std::array::from_fn(|i| n.to_be_bytes()[i % 4]));
            let at_place = AttemptOrigin { known_place: Some(KnownPlace { counter, is_browser: true }), ..known(1) };
            throttle.attempt(&login("ada"), at_place).map(drop).unwrap();
        }
        let counters = throttle.counters();
        let knows = |text: &str| counters.of_strangers.failures.contains_key(&login(text));
        assert!(knows("ada") && knows("login14999") && knows("login6000") && !knows("login0"));
        assert_eq!(counters.of_strangers.failures.len(), MAX_KEYS);
        assert_eq!(counters.of_known_places.failures.len(), MAX_KEYS);
        assert!(counters.by_address.full_at_ms.len() <= MAX_KEYS);
    }
}
