//! How long the videos of one trainee are kept, beside what holds for the whole centre. Months count from the arrival of a
//! session; 0 months: videos are kept until the session is erased.

use serde::Deserialize;
use utoipa::ToSchema;

use super::text::{Invalid, Remark};

/// Longest time, months.
pub const MAX_MONTHS: u32 = 1_200;

/// What a trainee's videos are kept for.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewPersonalRetention {
    /// Months after the arrival of a session when its video is deleted, at most 1200; 0: it is kept until the session is
    /// erased; `null`: as the centre's setting says.
    #[serde(deserialize_with = "Option::deserialize")]
    #[schema(required = true)]
    pub months: Option<u32>,
    /// Why the videos are kept longer than the centre keeps them: needed only then.
    #[serde(default)]
    #[schema(value_type = Option<String>)]
    pub reason: Option<Remark>,
    /// The number of videos that the change deletes at once, as the preview gave it; not needed if there are none.
    #[serde(default)]
    pub confirmed_videos: u64,
}

impl NewPersonalRetention {
    /// The reason to store: only a time that is longer than the centre's has one.
    ///
    /// # Errors
    /// A longer time without a reason, or too many months.
    pub fn checked_reason(&self, centre_months: u32) -> Result<Option<Remark>, Invalid> {
        let Some(months) = self.months else { return Ok(None) };
        if months > MAX_MONTHS {
            return Err(Invalid::new(
                "months",
                format!("is {months}; expected at most {MAX_MONTHS}, or 0 to keep videos"),
            ));
        }
        if !is_longer(months, centre_months) {
            return Ok(None);
        }
        let reason = self.reason.clone().ok_or_else(|| {
            Invalid::new("reason", "is missing: say why these videos are kept longer than the centre keeps videos")
        })?;
        Ok(Some(reason))
    }
}

/// True if `months` is longer than `other`; 0 is for ever.
fn is_longer(months: u32, other: u32) -> bool {
    other != 0 && (months == 0 || months > other)
}

/// The months that count: the shorter of both, unless a longer time has a reason. `own`: the trainee's months, and
/// whether they have a reason. The statements of the store say the same in SQL; a test compares them.
pub fn kept_months(centre: u32, own: Option<(u32, bool)>) -> u32 {
    match own {
        None => centre,
        Some((months, true)) => months,
        Some((months, false)) if is_longer(months, centre) => centre,
        Some((months, false)) => months,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shorter_time_counts_unless_the_longer_one_has_a_reason() {
        assert_eq!(kept_months(12, None), 12);
        assert_eq!(kept_months(12, Some((6, false))), 6);
        assert_eq!(kept_months(12, Some((24, false))), 12);
        assert_eq!(kept_months(12, Some((24, true))), 24);
        assert_eq!(kept_months(12, Some((0, true))), 0);
        assert_eq!(kept_months(12, Some((0, false))), 12);
        assert_eq!(kept_months(0, Some((6, false))), 6);
        assert_eq!(kept_months(0, Some((0, false))), 0);
    }

    #[test]
    fn only_a_longer_time_needs_a_reason_and_keeps_it() {
        let new = |months, reason: Option<&str>| NewPersonalRetention {
            months: Some(months),
            reason: reason.map(|text| text.parse().unwrap()),
            confirmed_videos: 0,
        };
        assert_eq!(new(24, None).checked_reason(12).unwrap_err().what, "reason");
        assert_eq!(new(0, None).checked_reason(12).unwrap_err().what, "reason");
        assert_eq!(new(1_201, Some("x")).checked_reason(0).unwrap_err().what, "months");
        assert_eq!(new(6, Some("x")).checked_reason(12).unwrap(), None);
        assert_eq!(new(24, Some("a study")).checked_reason(12).unwrap().unwrap().as_str(), "a study");
        assert_eq!(new(24, None).checked_reason(0).unwrap(), None);
    }
}
