//! Secrets that programs and browsers present to sign in, and the hashes that are stored.
//!
//! A token or cookie is 32 random bytes; only its SHA-256 is stored (it has too much entropy to be guessed, so a slow
//! hash would protect nothing). A password is guessable, so it is stored as argon2id with a salt of its own.

use std::collections::HashSet;
use std::fmt;

use argon2::password_hash::{PasswordHasher, PasswordVerifier, phc};
use argon2::{Algorithm, Argon2, Params, Version};
use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use sha2::{Digest, Sha256};

use super::text::Invalid;
use crate::ids::PersonId;

/// Prefix of a program's token, so that people and scanners recognise a leaked token.
pub const TOKEN_PREFIX: &str = "trc_";

/// A random secret. It is shown once to its owner and never stored; `Debug` does not print it.
pub struct Secret([u8; 32]);

/// The stored hash of a [`Secret`].
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct SecretHash(pub [u8; 32]);

impl Secret {
    /// A new secret from the thread's generator, which the operating system seeds.
    pub fn random() -> Self {
        Self(rand::random())
    }

    /// The secret as a cookie's value.
    pub fn as_cookie(&self) -> String {
        URL_SAFE_NO_PAD.encode(self.0)
    }

    /// The secret as a program's token: `trc_…`.
    pub fn as_token(&self) -> String {
        format!("{TOKEN_PREFIX}{}", self.as_cookie())
    }

    /// Reads a cookie's value; `None` if it cannot be one of ours.
    pub fn from_cookie(text: &str) -> Option<Self> {
        let bytes = URL_SAFE_NO_PAD.decode(text).ok()?;
        bytes.try_into().ok().map(Self)
    }

    /// Reads a program's token; `None` if it cannot be one of ours.
    pub fn from_token(text: &str) -> Option<Self> {
        Self::from_cookie(text.strip_prefix(TOKEN_PREFIX)?)
    }

    /// The hash to store and to look up. The database index compares hashes, so its timing reveals nothing about the
    /// secret.
    pub fn hash(&self) -> SecretHash {
        SecretHash(Sha256::digest(self.0).into())
    }
}

impl SecretHash {
    /// Recognises a place of an account, such as an address. The account's id makes the hashes of two accounts differ.
    pub fn of_place(person: PersonId, place: &str) -> Self {
        Self(Sha256::digest(format!("{person} {place}")).into())
    }
}

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Secret(…)")
    }
}

impl fmt::Debug for SecretHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SecretHash(…)")
    }
}

/// A password as typed by a person: 10 to 256 arbitrary bytes, of at least five different characters.
pub struct Password(String);

impl Password {
    /// Minimum length, bytes.
    pub const MIN_BYTES: usize = 10;
    /// Maximum length, bytes: limits the cost of hashing.
    pub const MAX_BYTES: usize = 256;
    /// Minimum number of different characters.
    pub const MIN_DIFFERENT: usize = 5;

    /// A password to set; checks its length and that it is not a few characters repeated.
    pub fn new(text: impl Into<String>) -> Result<Self, Invalid> {
        let text = text.into();
        let (min, max, different) = (Self::MIN_BYTES, Self::MAX_BYTES, Self::MIN_DIFFERENT);
        if !(min..=max).contains(&text.len()) {
            return Err(Invalid::new("password", format!("has {} bytes; expected {min} to {max}", text.len())));
        }
        if text.chars().collect::<HashSet<_>>().len() < different {
            return Err(Invalid::new("password", format!("has fewer than {different} different characters")));
        }
        Ok(Self(text))
    }

    /// A password to check at sign-in: any text up to the maximum length, since an old password may break today's
    /// rules.
    pub fn attempt(text: impl Into<String>) -> Option<Self> {
        Some(text.into()).filter(|text: &String| text.len() <= Self::MAX_BYTES).map(Self)
    }

    /// A new password that is easy to type: four groups of five letters and digits (98 bits).
    pub fn random() -> Self {
        const ALPHABET: &[u8; 31] = b"abcdefghjkmnpqrstuvwxyz23456789"; // without i l o 0 1
        let letter = || char::from(ALPHABET[rand::random_range(0..ALPHABET.len())]);
        let group = || (0..5).map(|_| letter()).collect::<String>();
        Self([group(), group(), group(), group()].join("-"))
    }

    /// The text, for showing a random password once.
    pub fn reveal(&self) -> &str {
        &self.0
    }

    /// Hashes the password: takes about 30 ms and 19 MiB, so do not call it on an async thread.
    pub fn hash(&self) -> PasswordHash {
        let hash = hasher().hash_password(self.0.as_bytes());
        // Fails only for a salt or length outside argon2's limits: ours are fixed or checked above.
        PasswordHash(hash.map(|hash| hash.to_string()).unwrap_or_default())
    }
}

impl fmt::Debug for Password {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Password(…)")
    }
}

/// The stored hash of a password: an argon2id string in PHC format, with its salt and costs.
#[derive(Clone, PartialEq, Eq)]
pub struct PasswordHash(pub String);

impl PasswordHash {
    /// True if this is the password. Takes about 30 ms, so do not call it on an async thread.
    pub fn matches(&self, password: &Password) -> bool {
        phc::PasswordHash::new(&self.0).is_ok_and(|hash| hasher().verify_password(password.0.as_bytes(), &hash).is_ok())
    }

    /// A hash that no password matches, so that a sign-in with an unknown login takes the same time.
    pub fn unmatchable() -> Self {
        Password::random().hash()
    }
}

impl fmt::Debug for PasswordHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("PasswordHash(…)")
    }
}

/// argon2id, 19 MiB, two passes, one lane: the OWASP minimum. Weaker while unit tests run, which hash often.
fn hasher() -> Argon2<'static> {
    let memory_kib = if cfg!(test) { 64 } else { 19 * 1024 };
    let params = Params::new(memory_kib, 2, 1, None).unwrap_or_default(); // constants inside the limits
    Argon2::new(Algorithm::Argon2id, Version::V0x13, params)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_secret_is_recognised_by_its_hash_as_cookie_and_as_token() {
        let secret = Secret::random();
        assert_eq!(Secret::from_cookie(&secret.as_cookie()).unwrap().hash(), secret.hash());
        assert_eq!(Secret::from_token(&secret.as_token()).unwrap().hash(), secret.hash());
        assert!(Secret::from_token(&secret.as_cookie()).is_none());
        assert!(Secret::from_cookie("short").is_none());
    }

    #[test]
    fn only_the_password_itself_matches_its_hash() {
        let password = Password::new("correct horse").unwrap();
        let hash = password.hash();
        assert!(hash.0.starts_with("$argon2id$v=19$"));
        assert!(hash.matches(&password));
        assert!(!hash.matches(&Password::attempt("correct horsf").unwrap()));
        assert!(!PasswordHash(String::new()).matches(&Password::attempt("").unwrap()));
    }

    #[test]
    fn two_hashes_of_one_password_differ() {
        let password = Password::random();
        assert_ne!(password.hash(), password.hash());
    }

    #[test]
    fn nothing_secret_is_printed() {
        let (secret, password) = (Secret::random(), Password::random());
        let printed = format!("{secret:?} {:?} {password:?} {:?}", secret.hash(), password.hash());
        assert_eq!(printed, "Secret(…) SecretHash(…) Password(…) PasswordHash(…)");
    }

    #[test]
    fn passwords_out_of_bounds_are_refused_with_the_bounds() {
        assert!(Password::new("short").unwrap_err().to_string().contains("expected 10 to 256"));
        assert!(Password::new("x".repeat(257)).is_err());
    }

    #[test]
    fn a_few_characters_repeated_are_no_password() {
        for weak in ["1111111111", "abababababab", "aaaabbbbccccdddd"] {
            let refused = Password::new(weak).unwrap_err().to_string();
            assert!(refused.contains("fewer than 5 different characters"), "{refused}");
            assert!(Password::attempt(weak).is_some(), "an earlier password still signs in");
        }
        assert!(Password::new("abcdeabcde").is_ok() && Password::new("äöüßéäöüßé").is_ok());
    }
}
