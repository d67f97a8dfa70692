//! Why a statistic is withheld. A missing statistic is stated as a reason, never as a number.

/// Why there is no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoAnswer {
    /// There are too few data.
    #[error("needs {needed} {of}; there {} {found}", if *found == 1 { "is" } else { "are" })]
    TooFew {
        /// What there is too little of, in the plural: people, experts, sessions.
        of: &'static str,
        /// Number of them.
        found: usize,
        /// Number needed.
        needed: usize,
    },
    /// A value is NaN or infinite, or an error bar does not contain its value.
    #[error("a value or its error bar is not a usable number")]
    NotFinite,
    /// One person appears twice, although each counts once.
    #[error("one person appears twice; each counts once")]
    PersonTwice,
    /// All values are the same, so there is no spread.
    #[error("all values are the same")]
    NoSpread,
    /// Two series agree exactly, so the data support no interval.
    #[error("the values agree exactly, so no interval can be computed")]
    Perfect,
    /// Raters differ more within people than between them, so their mean has no meaning.
    #[error("the raters differ more within people than between them")]
    Discord,
    /// The groups are not separated in the direction that is better.
    #[error("the groups do not differ clearly in the direction that is better")]
    NotApart,
    /// Neither more nor less of the feature is better, so there is no limit to pass.
    #[error("for this feature neither more nor less is better")]
    NoDirection,
    /// Not every row has a rating by every rater.
    #[error("not every person was rated by every rater")]
    Ragged,
    /// The sessions are not numbered in ascending order from 1.
    #[error("the sessions are not numbered in ascending order from 1")]
    NotInOrder,
    /// The named setting has a value that no computation can use.
    #[error("the setting {0} cannot be used")]
    UnusableSetting(&'static str),
}

impl NoAnswer {
    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            NoAnswer::TooFew { .. } => "too_few",
            NoAnswer::NotFinite => "not_finite",
            NoAnswer::PersonTwice => "person_twice",
            NoAnswer::NoSpread => "no_spread",
            NoAnswer::Perfect => "perfect",
            NoAnswer::Discord => "discord",
            NoAnswer::NotApart => "not_apart",
            NoAnswer::NoDirection => "no_direction",
            NoAnswer::Ragged => "ragged",
            NoAnswer::NotInOrder => "not_in_order",
            NoAnswer::UnusableSetting(_) => "unusable_setting",
        }
    }

    /// Refuses fewer than `needed`.
    pub(super) fn at_least(of: &'static str, found: usize, needed: usize) -> Result<(), NoAnswer> {
        if found < needed { Err(NoAnswer::TooFew { of, found, needed }) } else { Ok(()) }
    }

    /// Refuses NaN and infinities.
    pub(super) fn finite(values: &[f64]) -> Result<(), NoAnswer> {
        if values.iter().all(|value| value.is_finite()) { Ok(()) } else { Err(NoAnswer::NotFinite) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_person_is_and_two_people_are() {
        let said = |found| NoAnswer::TooFew { of: "people", found, needed: 10 }.to_string();
        assert_eq!(said(1), "needs 10 people; there is 1");
        assert_eq!([said(0), said(2)], ["needs 10 people; there are 0", "needs 10 people; there are 2"]);
    }
}
