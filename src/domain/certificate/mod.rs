//! Certificates: what one says, its states, and the file that is signed.
//!
//! A certificate is made once and says the same for ever: it holds all of its facts itself, so that a new standard, another
//! score or a new name of a task changes nothing. [`signed_file`] has the signature, [`key`] the keys.

pub mod key;
pub mod signed_file;

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::exam::IdentityCheck;
use super::named;
use super::session::Supervision;
use super::text::{Invalid, Key, Remark};
use key::CertificateKeyId;

/// Format of [`CertificateContent`] that this program writes.
pub const CONTENT_FORMAT: u32 = 1;

/// The format of a certificate of an exam, which has [`CertificateContent::exam`]. In every released version the numbers of
/// its attempts count those that were declared void.
pub const EXAM_FORMAT: u32 = 2;

/// Characters of a code: no letter that is mistaken for a digit.
const CODE_ALPHABET: &[u8; 32] = b"0123456789abcdefghjkmnpqrstvwxyz";
/// 26 characters of 5 bits: as hard to guess as a key of 130 bits.
const CODE_LENGTH: usize = 26;

named! {
    /// The language that a certificate is written in.
    CertificateLanguage: "language" {
        /// English.
        En = "en",
        /// German.
        De = "de",
    }
}

named! {
    /// State of a certificate.
    CertificateState: "state" {
        /// It is valid.
        Valid = "valid",
        /// A session that it relied on was moved, erased or changed, and no member of staff has decided yet.
        UnderReview = "under_review",
        /// It was withdrawn.
        Withdrawn = "withdrawn",
        /// The person's data were erased, and the certificate with them.
        Erased = "erased",
    }
}

named! {
    /// What happened to a certificate.
    CertificateEventKind: "event" {
        /// It was issued.
        Issued = "issued",
        /// A session that it relied on was moved to another person.
        MovedToPerson = "moved_to_person",
        /// A session that it relied on was moved to another task.
        MovedToTask = "moved_to_task",
        /// A session that it relied on was moved to another box.
        MovedToBox = "moved_to_box",
        /// A session that it relied on was erased.
        SessionErased = "session_erased",
        /// A session that it relied on was edited.
        SessionChanged = "session_changed",
        /// A member of staff looked at what happened, and the certificate stays valid.
        Kept = "kept",
        /// It was withdrawn.
        Withdrawn = "withdrawn",
        /// It was made valid again after it had been withdrawn.
        Reinstated = "reinstated",
    }
}

impl CertificateEventKind {
    /// True if the event puts a certificate under review.
    pub fn is_mark(self) -> bool {
        !matches!(self, Self::Issued | Self::Kept | Self::Withdrawn | Self::Reinstated)
    }
}

named! {
    /// How the standard was met.
    CertificateBasis: "basis" {
        /// By the standard's pass rule.
        Rule = "rule",
        /// By the charts.
        Charts = "charts",
        /// In an exam, by an attempt that met all limits.
        Exam = "exam",
    }
}

/// The part of a certificate's public address that cannot be guessed.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(try_from = "String", into = "String")]
#[schema(value_type = String, example = "0a1b2c3d4e5f6g7h8j9kambncp")]
pub struct CertificateCode(String);

impl CertificateCode {
    /// A new code.
    pub fn random() -> Self {
        let character = |_| char::from(CODE_ALPHABET[rand::random_range(0..CODE_ALPHABET.len())]);
        Self((0..CODE_LENGTH).map(character).collect())
    }
}

impl FromStr for CertificateCode {
    type Err = Invalid;

    /// Reads a code as people type it: capital letters, spaces and hyphens do not matter.
    fn from_str(text: &str) -> Result<Self, Invalid> {
        let code: String = text.chars().filter(|c| !matches!(c, ' ' | '-')).take(CODE_LENGTH + 1).collect();
        let code = code.to_ascii_lowercase();
        match code.len() == CODE_LENGTH && code.bytes().all(|byte| CODE_ALPHABET.contains(&byte)) {
            true => Ok(Self(code)),
            false => Err(Invalid::new("code", "is no code of a certificate; it has 26 letters and digits")),
        }
    }
}

impl fmt::Display for CertificateCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl TryFrom<String> for CertificateCode {
    type Error = Invalid;

    fn try_from(text: String) -> Result<Self, Invalid> {
        text.parse()
    }
}

impl From<CertificateCode> for String {
    fn from(code: CertificateCode) -> Self {
        code.0
    }
}

/// All that a certificate says. The file contains it, the database keeps it, and the public page shows it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CertificateContent {
    /// Version of this format.
    pub format: u32,
    /// The code of its public address.
    pub code: CertificateCode,
    /// The public address, where anyone can see whether it is valid.
    pub address: String,
    /// The language that it is written in.
    pub language: CertificateLanguage,
    /// Name of the centre; `null`: it had none.
    pub centre: Option<String>,
    /// Name of the person.
    pub trainee: String,
    /// Name of the task.
    pub task: String,
    /// The standard that was met.
    pub standard: CertifiedStandard,
    /// How it was met.
    pub basis: CertificateBasis,
    /// The exam; absent from a certificate that rests on the progress.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exam: Option<CertifiedExam>,
    /// The day on which the standard was met, such as `2026-11-30` (UTC).
    pub earned_on: String,
    /// The sessions that counted.
    pub sessions: Vec<CertifiedSession>,
    /// Version of the program that issued it.
    pub program: String,
    /// Version of the measurement that scored the sessions.
    pub measurement: String,
    /// Name of the person who issued it.
    pub issuer: String,
    /// The day on which it was issued (UTC).
    pub issued_on: String,
    /// Id of the key that signed it.
    #[schema(value_type = String)]
    pub key: CertificateKeyId,
}

/// The exam of a certificate.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct CertifiedExam {
    /// The day on which it was started.
    pub held_on: String,
    /// Name of the examiner.
    pub examiner: String,
    /// How the examiner confirmed who the candidate is.
    pub identity: IdentityCheck,
    /// How many attempts were used.
    pub attempts_used: u32,
    /// How many attempts the candidate had.
    pub attempts_allowed: u32,
    /// Numbers of the attempts that were declared void after a technical failure; absent: none. They are not used.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub voided: Vec<u32>,
}

/// The standard of a certificate.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct CertifiedStandard {
    /// Its version within the task.
    pub version: i64,
    /// The day on which it was set (UTC).
    pub set_on: String,
    /// Its limits in words, such as `Duration: at most 50 s`.
    pub limits: Vec<String>,
    /// Its pass rule in words; `null`: the charts decided.
    pub rule: Option<String>,
}

/// A session of a certificate.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct CertifiedSession {
    /// Its number among the person's sessions of the task; of an exam, the number of the attempt in the order of
    /// beginning, voided ones included.
    pub number: usize,
    /// The day of its recording (UTC).
    pub recorded_on: String,
    /// False if that day rests only on the word or file of the sender.
    pub day_known: bool,
    /// Whether a member of staff saw the attempt; `null`: not noted.
    pub supervision: Option<Supervision>,
}

/// A certificate to issue.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewCertificate {
    /// The task, by id or code.
    #[schema(value_type = String)]
    pub task: Key,
    /// The language that it is written in.
    pub language: CertificateLanguage,
    /// True: the certificate may have an address that can be opened only on the service's computer or in its network.
    #[serde(default)]
    pub accept_local_address: bool,
}

/// Why the state of a certificate is changed.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CertificateReason {
    /// The reason, 1 to 2000 characters. That of a withdrawal is public: anyone with the certificate's address reads it.
    #[schema(value_type = String)]
    pub reason: Remark,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_is_read_as_people_type_it_and_nothing_else_is_one() {
        for _ in 0..200 {
            let code = CertificateCode::random();
            let text = code.to_string();
            assert_eq!(text.len(), CODE_LENGTH);
            assert_eq!(text.parse(), Ok(code.clone()));
            let typed = format!("{} {}-{}", &text[..9], &text[9..20], &text[20..]).to_uppercase();
            assert_eq!(typed.parse(), Ok(code));
        }
        assert_ne!(CertificateCode::random(), CertificateCode::random());
        for other in
            ["", "0", "0a1b2c3d4e5f6g7h8j9kambnc", "0a1b2c3d4e5f6g7h8j9kambncpq", "0a1b2c3d4e5f6g7h8j9kambncu", "ä"]
        {
            assert!(other.parse::<CertificateCode>().is_err(), "{other}");
        }
    }
}
