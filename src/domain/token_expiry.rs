//! When a new token expires.

use std::str::FromStr;
use std::time::Duration;

use super::text::Invalid;
use crate::time::{from_rfc3339, millis};

/// Lifetime of a token whose maker states none: a year, so that a forgotten program loses access at some time.
const USUAL_LIFETIME: Duration = Duration::from_secs(365 * 86_400);

/// How long ahead of its end a token is said to expire soon: time for an administrator to make another.
const SOON: Duration = Duration::from_secs(30 * 86_400);

/// The end of a token, if that is soon or past; epoch ms.
pub fn expires_soon(expires_at_ms: Option<i64>, now_ms: i64) -> Option<i64> {
    expires_at_ms.filter(|at_ms| *at_ms <= now_ms + millis(SOON))
}

/// When a new token expires. As text: a time in RFC 3339, or `never`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TokenExpiry {
    /// A year after it was made.
    #[default]
    InAYear,
    /// It is valid until it is withdrawn.
    Never,
    /// At this time, epoch ms.
    At(i64),
}

impl TokenExpiry {
    /// The time, epoch ms, for a token that is made at `now_ms`; `None` if it never expires.
    pub fn at_ms(self, now_ms: i64) -> Option<i64> {
        match self {
            Self::InAYear => Some(now_ms + millis(USUAL_LIFETIME)),
            Self::Never => None,
            Self::At(at_ms) => Some(at_ms),
        }
    }
}

impl FromStr for TokenExpiry {
    type Err = Invalid;

    fn from_str(text: &str) -> Result<Self, Invalid> {
        if text == "never" {
            return Ok(Self::Never);
        }
        let why = || Invalid::new("expires_at", "expected an RFC 3339 time such as 2026-12-31T23:59:59Z, or `never`");
        from_rfc3339(text).map(Self::At).ok_or_else(why)
    }
}
