//! The keys that sign certificates: Ed25519 (RFC 8032), by `ring`.

use std::fmt;
use std::str::FromStr;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use ring::signature::{ED25519, Ed25519KeyPair, KeyPair, UnparsedPublicKey};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::domain::text::Invalid;

/// What stands before an Ed25519 key in a `SubjectPublicKeyInfo` (RFC 8410).
const SPKI_PREFIX: [u8; 12] = [0x30, 0x2a, 0x30, 0x05, 0x06, 0x03, 0x2b, 0x65, 0x70, 0x03, 0x21, 0x00];
const PEM_BEGIN: &str = "-----BEGIN PUBLIC KEY-----";
const PEM_END: &str = "-----END PUBLIC KEY-----";

/// Length of a key's id, hexadecimal digits.
const ID_LENGTH: usize = 16;

/// Names a key: the first 16 hexadecimal digits of the SHA-256 of the public key.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct CertificateKeyId(String);

/// The public part of a key: it verifies, and anyone may have it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CertificatePublicKey(pub [u8; 32]);

/// The secret part of a key. `Debug` does not print it.
pub struct CertificateSigner {
    seed: [u8; 32],
    pair: Ed25519KeyPair,
}

impl CertificateSigner {
    /// A new key from the thread's generator, which the operating system seeds.
    ///
    /// # Errors
    /// As [`CertificateSigner::from_seed`]; no random seed is refused.
    pub fn random() -> Result<Self, Invalid> {
        Self::from_seed(rand::random())
    }

    /// The key with this seed.
    ///
    /// # Errors
    /// The seed cannot be used.
    pub fn from_seed(seed: [u8; 32]) -> Result<Self, Invalid> {
        let pair = Ed25519KeyPair::from_seed_unchecked(&seed);
        let pair = pair.map_err(|_| Invalid::new("key", "is no seed of an Ed25519 key"))?;
        Ok(Self { seed, pair })
    }

    /// The seed, to store it.
    pub fn seed(&self) -> [u8; 32] {
        self.seed
    }

    /// The public part.
    pub fn public(&self) -> CertificatePublicKey {
        let mut bytes = [0; 32];
        bytes.copy_from_slice(self.pair.public_key().as_ref());
        CertificatePublicKey(bytes)
    }

    /// The signature of these bytes.
    pub fn sign(&self, bytes: &[u8]) -> Vec<u8> {
        self.pair.sign(bytes).as_ref().to_vec()
    }
}

impl fmt::Debug for CertificateSigner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "CertificateSigner({})", self.public().id())
    }
}

impl CertificatePublicKey {
    /// Its id.
    pub fn id(&self) -> CertificateKeyId {
        let digits: String = Sha256::digest(self.0).iter().map(|byte| format!("{byte:02x}")).collect();
        CertificateKeyId(digits.chars().take(ID_LENGTH).collect())
    }

    /// True if this is the key's signature of these bytes.
    pub fn verifies(&self, bytes: &[u8], signature: &[u8]) -> bool {
        UnparsedPublicKey::new(&ED25519, self.0).verify(bytes, signature).is_ok()
    }

    /// The key as a PEM file, which OpenSSL reads too.
    pub fn to_pem(self) -> String {
        format!("{PEM_BEGIN}\n{}\n{PEM_END}\n", STANDARD.encode([SPKI_PREFIX.as_slice(), &self.0].concat()))
    }

    /// All keys of a PEM file.
    ///
    /// # Errors
    /// The file has no public key, or one that is no Ed25519 key.
    pub fn all_of_pem(text: &str) -> Result<Vec<Self>, Invalid> {
        let not_a_key = || Invalid::new("key", "is no public key: expected a PEM file with an Ed25519 key");
        let mut keys = Vec::new();
        for part in text.split(PEM_BEGIN).skip(1) {
            let (body, _) = part.split_once(PEM_END).ok_or_else(not_a_key)?;
            let body: String = body.split_whitespace().collect();
            let bytes = STANDARD.decode(body).map_err(|_| not_a_key())?;
            let key = bytes.strip_prefix(&SPKI_PREFIX).and_then(|key| key.try_into().ok()).ok_or_else(not_a_key)?;
            keys.push(Self(key));
        }
        if keys.is_empty() { Err(not_a_key()) } else { Ok(keys) }
    }
}

impl FromStr for CertificateKeyId {
    type Err = Invalid;

    fn from_str(text: &str) -> Result<Self, Invalid> {
        let is_digit = |byte: u8| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte);
        match text.len() == ID_LENGTH && text.bytes().all(is_digit) {
            true => Ok(Self(text.to_owned())),
            false => Err(Invalid::new("key", "is no id of a key; it has 16 hexadecimal digits")),
        }
    }
}

impl fmt::Display for CertificateKeyId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl TryFrom<String> for CertificateKeyId {
    type Error = Invalid;

    fn try_from(text: String) -> Result<Self, Invalid> {
        text.parse()
    }
}

impl From<CertificateKeyId> for String {
    fn from(id: CertificateKeyId) -> Self {
        id.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes_of(hex: &str) -> Vec<u8> {
        (0..hex.len() / 2).map(|at| u8::from_str_radix(&hex[2 * at..2 * at + 2], 16).unwrap()).collect()
    }

    /// The second example of RFC 8032, section 7.1.
    #[test]
    fn signatures_are_those_of_the_standard() {
        let seed = bytes_of("4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb");
        let signer = CertificateSigner::from_seed(seed.try_into().unwrap()).unwrap();
        let public = bytes_of("3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c");
        assert_eq!(signer.public().0.to_vec(), public);
        let signature = bytes_of(
            "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da\
             085ac1e43e15996e458f3613d0f11d8c387b2eaeb4302aeeb00d291612bb0c00",
        );
        assert_eq!(signer.sign(&[0x72]), signature);
        assert!(signer.public().verifies(&[0x72], &signature));
        assert!(!signer.public().verifies(&[0x73], &signature));
    }

    #[test]
    fn a_key_survives_its_pem_file_and_other_files_are_refused() {
        let keys: Vec<_> = (0..3).map(|seed| CertificateSigner::from_seed([seed; 32]).unwrap().public()).collect();
        let file: String = keys.iter().map(|key| format!("key {}\n{}", key.id(), key.to_pem())).collect();
        assert_eq!(CertificatePublicKey::all_of_pem(&file), Ok(keys.clone()));
        let pem = keys[0].to_pem();
        for other in ["", "key", &pem.replace("MC", "MD"), &pem[..pem.len() - 30], &pem.replace("PUBLIC", "PRIVATE")] {
            assert!(CertificatePublicKey::all_of_pem(other).is_err(), "{other}");
        }
        let id = keys[0].id().to_string();
        assert_eq!(id.parse(), Ok(keys[0].id()));
        assert!(id.to_uppercase().parse::<CertificateKeyId>().is_err() || id.bytes().all(|b| b.is_ascii_digit()));
    }
}
