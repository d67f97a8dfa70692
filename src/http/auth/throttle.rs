//! Limits failed sign-ins: a few a minute per login and address, more per address alone.
//!
//! An attempt takes a token before the password is checked, so parallel attempts gain nothing. A right password refunds
//! the token, so many people behind one address can sign in. (`governor` cannot refund.) Tokens come back at a constant
//! rate: the generic cell rate algorithm, with one number per key.

use std::collections::HashMap;
use std::hash::Hash;
use std::net::IpAddr;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use crate::time::SharedClock;

/// Most keys that are remembered. At the limit, keys with all their tokens are dropped. If there are none, attempts
/// with new keys are refused: then ten thousand logins or addresses are failing at once.
const MAX_KEYS: usize = 10_000;
/// One address may fail this many times as often as one login from it: a training room shares one address.
const LOGINS_PER_ADDRESS: u32 = 12;

/// Limits failed sign-ins per login and address, and per address.
pub struct Throttle {
    clock: SharedClock,
    by_login: Mutex<CellRateLimiter<(String, IpAddr)>>,
    by_address: Mutex<CellRateLimiter<IpAddr>>,
}

/// A sign-in attempt that has taken its tokens.
pub struct SignInAttempt<'t> {
    throttle: &'t Throttle,
    login: (String, IpAddr),
}

impl Throttle {
    /// Allows `per_min` failures a minute for a login from an address.
    pub fn new(per_min: u32, clock: SharedClock) -> Self {
        Self {
            clock,
            by_login: Mutex::new(CellRateLimiter::new(per_min)),
            by_address: Mutex::new(CellRateLimiter::new(per_min.saturating_mul(LOGINS_PER_ADDRESS))),
        }
    }

    /// Takes a token of the login and one of the address.
    ///
    /// # Errors
    /// How long to wait, if either has none left.
    pub fn attempt(&self, login: &str, address: IpAddr) -> Result<SignInAttempt<'_>, Duration> {
        let (login, now_ms) = ((login.to_lowercase(), address), self.clock.now_ms());
        lock(&self.by_address).take(&address, now_ms)?;
        lock(&self.by_login).take(&login, now_ms)?;
        Ok(SignInAttempt { throttle: self, login })
    }
}

impl SignInAttempt<'_> {
    /// The password was right: refunds the tokens.
    pub fn succeeded(self) {
        lock(&self.throttle.by_address).refund(&self.login.1);
        lock(&self.throttle.by_login).refund(&self.login);
    }
}

fn lock<T>(places: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    places.lock().unwrap_or_else(PoisonError::into_inner) // numbers only: no panic leaves them half changed
}

/// A rate limiter for many keys, each with `per_min` tokens that come back one by one.
struct CellRateLimiter<K> {
    /// When a key has all its tokens again, epoch ms.
    full_at_ms: HashMap<K, i64>,
    /// Time until one token comes back, ms.
    token_interval_ms: i64,
    /// Tokens of a key.
    max_tokens: i64,
}

impl<K: Eq + Hash + Clone> CellRateLimiter<K> {
    fn new(per_min: u32) -> Self {
        let max_tokens = i64::from(per_min.max(1));
        Self { full_at_ms: HashMap::new(), token_interval_ms: (60_000 / max_tokens).max(1), max_tokens }
    }

    fn take(&mut self, key: &K, now_ms: i64) -> Result<(), Duration> {
        if self.full_at_ms.len() >= MAX_KEYS && !self.full_at_ms.contains_key(key) {
            self.full_at_ms.retain(|_, full_at_ms| *full_at_ms > now_ms);
            if self.full_at_ms.len() >= MAX_KEYS {
                return Err(Duration::from_secs(60));
            }
        }
        let full_at_ms = self.full_at_ms.get(key).map_or(now_ms, |at_ms| now_ms.max(*at_ms)) + self.token_interval_ms;
        let wait_ms = full_at_ms - now_ms - self.token_interval_ms * self.max_tokens;
        if wait_ms > 0 {
            return Err(Duration::from_millis(wait_ms.unsigned_abs()));
        }
        self.full_at_ms.insert(key.clone(), full_at_ms);
        Ok(())
    }

    fn refund(&mut self, key: &K) {
        if let Some(full_at_ms) = self.full_at_ms.get_mut(key) {
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
    const THERE: IpAddr = IpAddr::V4(std::net::Ipv4Addr::BROADCAST);

    fn throttle() -> (Throttle, Arc<ManualClock>) {
        let clock = ManualClock::at(1_000_000);
        (Throttle::new(5, clock.clone()), clock)
    }

    #[test]
    fn one_login_from_one_address_is_slowed_and_others_are_not() {
        let (throttle, clock) = throttle();
        for _ in 0..5 {
            throttle.attempt("ada", HERE).map(drop).unwrap();
        }
        assert_eq!(throttle.attempt("Ada", HERE).err(), Some(Duration::from_secs(12)));
        assert!(throttle.attempt("bob", HERE).is_ok());
        assert!(throttle.attempt("ada", THERE).is_ok());
        clock.advance(Duration::from_secs(12));
        assert!(throttle.attempt("ada", HERE).is_ok());
        assert!(throttle.attempt("ada", HERE).is_err());
    }

    #[test]
    fn a_right_password_costs_nothing() {
        let (throttle, _clock) = throttle();
        for _ in 0..1000 {
            throttle.attempt("ada", HERE).map(SignInAttempt::succeeded).unwrap();
        }
    }

    #[test]
    fn trying_many_logins_from_one_address_is_slowed_too() {
        let (throttle, _clock) = throttle();
        let refused = (0..100).filter(|n| throttle.attempt(&format!("login{n}"), HERE).is_err()).count();
        assert_eq!(refused, 40);
    }

    #[test]
    fn the_number_of_keys_is_bounded() {
        let (throttle, clock) = throttle();
        let addresses = |from: u32| (from..from + 10_000).map(|n| IpAddr::from(n.to_be_bytes()));
        assert_eq!(addresses(0).filter(|a| throttle.attempt("ada", *a).is_err()).count(), 0);
        assert!(throttle.attempt("ada", HERE).is_err(), "full");
        clock.advance(Duration::from_secs(60));
        assert!(throttle.attempt("ada", HERE).is_ok(), "recovered keys are forgotten");
        assert!(lock(&throttle.by_address).full_at_ms.len() <= MAX_KEYS);
    }
}
