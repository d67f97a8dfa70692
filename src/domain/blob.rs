//! Files named by their content: a blob's name is the SHA-256 of its bytes, and a blob never changes.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::text::Invalid;

/// SHA-256 of a file's bytes; as text, 64 lower-case hexadecimal digits.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct BlobHash(pub [u8; 32]);

/// A file in the vault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Blob {
    /// The hash of its content, which is its name.
    pub hash: BlobHash,
    /// Length, bytes.
    pub bytes: u64,
}

impl Blob {
    /// The blob of these bytes.
    pub fn of(content: &[u8]) -> Self {
        Self { hash: BlobHash(Sha256::digest(content).into()), bytes: content.len() as u64 }
    }
}

impl BlobHash {
    /// Path of the blob in a data folder, such as `blobs/ab/abcd…`.
    pub fn file(&self) -> String {
        format!("blobs/{:02x}/{self}", self.0[0])
    }
}

impl fmt::Display for BlobHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for BlobHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "BlobHash({self})")
    }
}

impl FromStr for BlobHash {
    type Err = Invalid;

    fn from_str(text: &str) -> Result<Self, Invalid> {
        let refused = || Invalid::new("hash", "expected 64 lower-case hexadecimal digits");
        let small_hex = |b: u8| b.is_ascii_digit() || (b'a'..=b'f').contains(&b);
        if text.len() != 64 || !text.bytes().all(small_hex) {
            return Err(refused());
        }
        let mut bytes = [0; 32];
        for (byte, digits) in bytes.iter_mut().zip(text.as_bytes().chunks_exact(2)) {
            let digits = std::str::from_utf8(digits).map_err(|_| refused())?;
            *byte = u8::from_str_radix(digits, 16).map_err(|_| refused())?;
        }
        Ok(Self(bytes))
    }
}

impl TryFrom<String> for BlobHash {
    type Error = Invalid;

    fn try_from(text: String) -> Result<Self, Invalid> {
        text.parse()
    }
}

impl From<BlobHash> for String {
    fn from(hash: BlobHash) -> String {
        hash.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_of_an_empty_file_is_the_known_one() {
        let known = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
        assert_eq!(Blob::of(b"").hash.to_string(), known);
        assert_eq!(known.parse(), Ok(Blob::of(b"").hash));
    }

    #[test]
    fn only_one_spelling_is_a_hash() {
        let text = Blob::of(b"x").hash.to_string();
        for other in [text.to_uppercase(), text[1..].to_owned(), text.replace('2', "g"), format!("+{}", &text[1..])] {
            assert!(other.parse::<BlobHash>().is_err(), "{other}");
        }
    }
}
