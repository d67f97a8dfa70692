//! Comments on a moment of a session, or on a stretch of it.

use serde::Deserialize;
use utoipa::ToSchema;

use super::text::{Invalid, Remark};

/// Latest accepted second: no recording is longer than a day.
const MAX_TIME_S: f64 = 86_400.0;

/// A comment to be stored.
#[derive(Clone, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewComment {
    /// The second of the recording that the comment is about.
    pub from_s: f64,
    /// End of the stretch that the comment is about; absent: one moment.
    #[serde(default)]
    pub to_s: Option<f64>,
    /// The comment: 1 to 2000 characters; line breaks are allowed.
    #[schema(value_type = String)]
    pub text: Remark,
}

impl NewComment {
    /// Start and end of the stretch, s.
    ///
    /// # Errors
    /// Seconds outside any recording.
    pub fn span(&self) -> Result<[f64; 2], Invalid> {
        let to_s = self.to_s.unwrap_or(self.from_s);
        let is_second = |second: f64| (0.0..=MAX_TIME_S).contains(&second);
        match (is_second(self.from_s), is_second(to_s) && to_s >= self.from_s) {
            (true, true) => Ok([self.from_s, to_s]),
            (false, _) => {
                Err(Invalid::new("from_s", format!("is {}; expected a second of the recording", self.from_s)))
            }
            (true, false) => Err(Invalid::new("to_s", format!("is {to_s}; expected a second not before `from_s`"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_comment_is_about_a_possible_moment_or_stretch() {
        let about = |from_s, to_s| NewComment { from_s, to_s, text: "Look here.".parse().unwrap() }.span();
        assert_eq!(about(3.5, None), Ok([3.5, 3.5]));
        assert_eq!(about(3.5, Some(9.0)), Ok([3.5, 9.0]));
        for (from_s, to_s) in
            [(-1.0, None), (f64::NAN, None), (1e9, None), (5.0, Some(4.0)), (5.0, Some(f64::INFINITY))]
        {
            assert!(about(from_s, to_s).is_err(), "{from_s} {to_s:?}");
        }
    }

    #[test]
    fn its_text_has_lines_and_no_other_control_character() {
        assert!("Two\nlines".parse::<Remark>().is_ok());
        for bad in ["", "  \n", "a\u{0}b", "a\u{1b}[31m"] {
            assert!(bad.parse::<Remark>().is_err(), "{bad:?}");
        }
        assert!("é".repeat(2000).parse::<Remark>().is_ok() && "é".repeat(2001).parse::<Remark>().is_err());
    }
}
