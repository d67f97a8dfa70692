//! Why a statistic is withheld: said in words, never as a number.

/// Why there is no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoAnswer {
    /// Too little data to say anything.
    #[error("it takes {needed} {of}, and has {found}")]
    TooFew {
        /// Of what, in the plural: people, experts, sessions.
        of: &'static str,
        /// How many there are.
        found: usize,
        /// How many it takes.
        needed: usize,
    },
    /// A value is NaN or infinite, or an error bar does not hold its value.
    #[error("a value or its error bar is not usable")]
    NotFinite,
    /// One person appears twice where each counts once.
    #[error("one person appears twice; each counts once")]
    PersonTwice,
    /// All values are the same, which no spread can be taken from.
    #[error("all values are the same")]
    NoSpread,
    /// Two series agree exactly, so that the data bear no interval.
    #[error("the values agree exactly, so that they bear no interval")]
    Perfect,
    /// Raters differ more within people than between them: their mean says nothing.
    #[error("the raters differ more within people than between them")]
    Discord,
    /// Two groups do not lie apart in the direction that is better.
    #[error("the groups do not lie apart in the direction that is better")]
    NotApart,
    /// A feature of which neither more nor less is better has no limit to pass.
    #[error("neither more nor less of this is better")]
    NoDirection,
    /// Not every row has a value by every rater.
    #[error("not everybody was rated by every rater")]
    Ragged,
    /// Sessions that are not numbered upwards from 1.
    #[error("the sessions are not numbered upwards from 1")]
    NotInOrder,
    /// A setting that nothing can be computed with.
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
