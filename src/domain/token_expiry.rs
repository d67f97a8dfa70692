//! When a new token expires.

use std::str::FromStr;
use std::time::Duration;

use super::text::Invalid;
use crate::time::{from_rfc3339, millis, to_rfc3339};

/// Lifetime of a token whose maker states none: a year, so that a forgotten program loses access at some time.
const USUAL_LIFETIME: Duration = Duration::from_secs(365 * 86_400);

/// Longest lifetime that a maker may state: ten years. A later end is mistyped.
const MAX_LIFETIME: Duration = Duration::from_secs(3650 * 86_400);

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
    fn at_ms(self, now_ms: i64) -> Option<i64> {
        match self {
            Self::InAYear => Some(now_ms + millis(USUAL_LIFETIME)),
            Self::Never => None,
            Self::At(at_ms) => Some(at_ms),
        }
    }

    /// The end of a token that is made at `now_ms`, epoch ms; `None` if it never expires. `latest_ms` is the end of the
    /// token that makes it, if one does: the new token ends then at the latest.
    ///
    /// # Errors
    /// A stated end that is later, that has passed, or that is more than ten years ahead.
    pub fn end_ms(stated: Option<Self>, latest_ms: Option<i64>, now_ms: i64) -> Result<Option<i64>, Invalid> {
        let end_ms = stated.unwrap_or_default().at_ms(now_ms);
        let last_ms = now_ms + millis(MAX_LIFETIME);
        if end_ms.is_some_and(|end_ms| !(now_ms + 1..=last_ms).contains(&end_ms)) {
            let (now, last) = (to_rfc3339(now_ms), to_rfc3339(last_ms));
            let why = format!("expected a time after {now} and not after {last}, or `never`");
            return Err(Invalid::new("expires_at", why));
        }
        let Some(latest_ms) = latest_ms else { return Ok(end_ms) };
        if end_ms.is_some_and(|end_ms| end_ms <= latest_ms) {
            return Ok(end_ms);
        }
        if stated.is_none() {
            return Ok(Some(latest_ms));
        }
        let latest = to_rfc3339(latest_ms);
        let why = format!("must not be later than {latest}, when the token ends that makes this one");
        Err(Invalid::new("expires_at", why))
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

#[cfg(test)]
mod tests {
    use super::*;

    const NOW_MS: i64 = 1_800_000_000_000;

    #[test]
    fn a_token_that_a_token_makes_ends_with_it_at_the_latest() {
        let year_ms = NOW_MS + millis(USUAL_LIFETIME);
        let (soon, later) = (NOW_MS + 3_600_000, year_ms + 1);
        let end = |stated, latest_ms| TokenExpiry::end_ms(stated, latest_ms, NOW_MS);
        assert_eq!(end(None, None), Ok(Some(year_ms)));
        assert_eq!(end(Some(TokenExpiry::Never), None), Ok(None));
        assert_eq!(end(None, Some(soon)), Ok(Some(soon)));
        assert_eq!(end(None, Some(later)), Ok(Some(year_ms)));
        assert_eq!(end(Some(TokenExpiry::At(soon)), Some(soon)), Ok(Some(soon)));
        for stated in [TokenExpiry::At(soon + 1), TokenExpiry::InAYear, TokenExpiry::Never] {
            let refused = end(Some(stated), Some(soon)).unwrap_err();
            assert_eq!(refused.what, "expires_at");
            assert!(refused.why.contains(&to_rfc3339(soon)), "{}", refused.why);
        }
    }

    #[test]
    fn a_token_ends_within_ten_years_or_never() {
        let last_ms = NOW_MS + millis(MAX_LIFETIME);
        for end_ms in [NOW_MS + 1, last_ms] {
            assert_eq!(TokenExpiry::end_ms(Some(TokenExpiry::At(end_ms)), None, NOW_MS), Ok(Some(end_ms)));
        }
        for stated in ["2999-12-31T00:00:00Z", "1971-01-01T00:00:00Z", &to_rfc3339(NOW_MS), &to_rfc3339(last_ms + 1)] {
            let refused = TokenExpiry::end_ms(Some(stated.parse().unwrap()), None, NOW_MS).unwrap_err();
            assert!(refused.what == "expires_at" && refused.why.contains("or `never`"), "{stated}: {refused}");
        }
    }
}
