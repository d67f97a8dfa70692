//! The PIN that a trainee checks in with at a box. It opens nothing else, so it may be short; wrong ones are counted.

use std::fmt;

use crate::domain::secret::Password;
use crate::domain::text::Invalid;

/// Number of digits.
const MIN_DIGITS: usize = 4;
const MAX_DIGITS: usize = 8;

/// A PIN: 4 to 8 digits, not one digit repeated and no run such as 1234. `Debug` does not print it.
pub struct CheckInPin(String);

impl CheckInPin {
    /// A PIN to set.
    ///
    /// # Errors
    /// It has the wrong length or other characters than digits, or would be guessed first.
    pub fn new(text: &str) -> Result<Self, Invalid> {
        let pin = Self::attempt(text).ok_or_else(|| Invalid::new("pin", "expected 4 to 8 digits"))?;
        let steps: Vec<i16> = pin.0.as_bytes().windows(2).map(|pair| i16::from(pair[1]) - i16::from(pair[0])).collect();
        if [0, 1, -1].iter().any(|step| steps.iter().all(|one| one == step)) {
            return Err(Invalid::new("pin", "is easy to guess: do not repeat one digit, or count up or down"));
        }
        Ok(pin)
    }

    /// A PIN to check; `None` if it cannot be one.
    pub fn attempt(text: &str) -> Option<Self> {
        let text = text.trim();
        let is_pin = (MIN_DIGITS..=MAX_DIGITS).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_digit());
        is_pin.then(|| Self(text.to_owned()))
    }

    /// The PIN as the text that is hashed, like a password.
    pub fn into_password(self) -> Option<Password> {
        Password::attempt(self.0)
    }
}

impl fmt::Debug for CheckInPin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("CheckInPin(…)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pins_that_are_guessed_first_are_refused() {
        for good in ["2580", "1357", "12340", "98765430"] {
            assert!(CheckInPin::new(good).is_ok(), "{good}");
        }
        for bad in ["1111", "1234", "4321", "0000000", "123", "123456789", "12a4", "", "１２５９"] {
            assert!(CheckInPin::new(bad).is_err(), "{bad}");
        }
    }
}
