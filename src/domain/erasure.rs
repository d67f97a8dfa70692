//! Erasures: which people and recordings were erased. A list of them outlives the data, so that a backup that is
//! restored later does not bring them back.

use std::fmt;
use std::str::FromStr;

use super::named;
use super::text::Invalid;
use crate::time::{from_rfc3339, to_rfc3339};

named! {
    /// What was erased.
    ErasedKind: "kind of erasure" {
        /// A trainee, with all that belongs to them.
        Trainee = "trainee",
        /// A session, with its recording and results.
        Session = "session",
        /// An account.
        Person = "person",
        /// A trainee who waits for their erasure, which can still be taken back.
        Pending = "pending",
        /// A trainee whose erasure was taken back.
        TakenBack = "taken_back",
    }
}

/// One erasure. As text, a line of a list: kind, id and time, separated by blanks.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Erasure {
    /// What was erased, or is to be.
    pub kind: ErasedKind,
    /// Its id.
    pub id: String,
    /// When; for [`ErasedKind::Pending`] when it is due, epoch ms.
    pub at_ms: i64,
}

impl Erasure {
    /// What makes an entry the same as another: an erasure happens once, but it may be requested and taken back
    /// repeatedly.
    pub fn key(&self) -> String {
        if self.is_final() { self.id.clone() } else { self.to_string() }
    }

    /// True if something was erased for good: no request.
    pub fn is_final(&self) -> bool {
        match self.kind {
            ErasedKind::Trainee | ErasedKind::Session | ErasedKind::Person => true,
            ErasedKind::Pending | ErasedKind::TakenBack => false,
        }
    }
}

impl fmt::Display for Erasure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} {}", self.kind, self.id, to_rfc3339(self.at_ms))
    }
}

impl FromStr for Erasure {
    type Err = Invalid;

    fn from_str(line: &str) -> Result<Self, Invalid> {
        let wrong = || Invalid::new("erasure", format!("expected kind, id and time, not `{line}`"));
        let mut parts = line.split(' ');
        let (Some(kind), Some(id), Some(at), None) = (parts.next(), parts.next(), parts.next(), parts.next()) else {
            return Err(wrong());
        };
        let (kind, at_ms) = (kind.parse().map_err(|_| wrong())?, from_rfc3339(at).ok_or_else(wrong)?);
        Ok(Self { kind, id: id.to_owned(), at_ms })
    }
}
