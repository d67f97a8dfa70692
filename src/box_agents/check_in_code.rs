//! The codes that a box shows as a QR code: a person who reads one is at the box. A code is valid for a short time and
//! used once.

use std::time::Duration;

use crate::time::millis;

/// How long a code is valid.
const LIFETIME: Duration = Duration::from_secs(5 * 60);
/// Interval after which the box shows another code, so that one that is just being read stays valid.
pub const RENEWAL_INTERVAL: Duration = Duration::from_secs(2 * 60);
/// Codes of a box that are valid at a time.
const MAX_CODES: usize = 4;
/// Letters and digits that are not mistaken for each other.
const ALPHABET: &[u8; 31] = b"abcdefghjkmnpqrstuvwxyz23456789";
/// Length of a code: 59 bits, far too many to be tried in five minutes.
const CODE_LENGTH: usize = 12;

/// A code for checking in at a box.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct CheckInCode(String);

impl CheckInCode {
    fn random() -> Self {
        let letter = || char::from(ALPHABET[rand::random_range(0..ALPHABET.len())]);
        Self((0..CODE_LENGTH).map(|_| letter()).collect())
    }

    /// The code as text.
    pub(super) fn as_str(&self) -> &str {
        &self.0
    }
}

/// The valid codes of a box, each with its end, ms.
#[derive(Debug, Default)]
pub(super) struct CheckInCodes(Vec<(CheckInCode, i64)>);

impl CheckInCodes {
    /// Makes another code.
    pub(super) fn add(&mut self, now_ms: i64) -> CheckInCode {
        self.0.retain(|(_, ends_ms)| *ends_ms > now_ms);
        if self.0.len() >= MAX_CODES {
            self.0.remove(0);
        }
        let code = CheckInCode::random();
        self.0.push((code.clone(), now_ms + millis(LIFETIME)));
        code
    }

    /// Uses up a code. False if it is not valid.
    pub(super) fn use_up(&mut self, code: &str, now_ms: i64) -> bool {
        self.0.retain(|(_, ends_ms)| *ends_ms > now_ms);
        let found = self.0.iter().position(|(valid, _)| valid.as_str() == code);
        found.map(|at| self.0.remove(at)).is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_is_used_once_and_for_a_short_time() {
        let mut codes = CheckInCodes::default();
        let (first, second) = (codes.add(0), codes.add(1000));
        assert!(codes.use_up(first.as_str(), 2000));
        assert!(!codes.use_up(first.as_str(), 2000), "it was used");
        assert!(!codes.use_up(second.as_str(), 1000 + millis(LIFETIME)), "it is too old");
        assert!(!codes.use_up("", 0));
        let many: Vec<_> = (0..9).map(|_| codes.add(0)).collect();
        assert!(!codes.use_up(many[0].as_str(), 1) && codes.use_up(many[8].as_str(), 1));
    }
}
