//! Standards: the limit that a feature has to keep, where it comes from, and the judgement on a measured value.
//!
//! Ways to set a limit (PEERS 3.5): the mean of experts without outliers ([`experts`]), the line between novices and
//! experts ([`contrasting_groups()`]), the best share of peers ([`best_share`]), or a fixed number ([`Target::fixed`],
//! [`fls`]). Published sets of limits differ so much that the choice changes who passes (Luursema 2015), so a target
//! always says what it was made from. A judgement weighs the value's error bar against the limit alone: the limit's
//! own interval tells how well the standard is founded, and is no ground for passing or failing anybody once it is
//! set.

pub mod contrasting_groups;
pub mod experts;
pub mod fls;

pub use contrasting_groups::{ErrorRate, breaking, contrasting_groups, keeping};
pub use experts::{FEWEST_EXPERTS, best_share, trimmed_experts};

use super::interval::{Interval, Measured};
use super::no_answer::NoAnswer;
use crate::pipeline::features::Direction;

/// A limit that a feature has to keep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// The limit, in the feature's unit; keeping it exactly is enough.
    pub limit: f64,
    /// Where the limit lies with 95 %, other people of the same kind being asked; `None` where it was fixed.
    pub interval: Option<Interval>,
    /// Which side of it is better: lower or higher, never neither.
    pub direction: Direction,
    /// What it was made from.
    pub basis: Basis,
}

/// What a limit was made from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Basis {
    /// The mean of experts without outliers.
    TrimmedExperts {
        /// How many experts were measured.
        experts: usize,
        /// How many of them lay more than two standard deviations off and were left out.
        dropped: usize,
    },
    /// The line between novices and experts.
    ContrastingGroups {
        /// How many novices.
        novices: usize,
        /// How many experts.
        experts: usize,
        /// Share of novices that it lets pass.
        false_pass: ErrorRate,
        /// Share of experts that it fails.
        false_fail: ErrorRate,
    },
    /// As good as the best share of these people.
    BestShare {
        /// How many people.
        people: usize,
        /// The share, between 0 and 1.
        share: f64,
    },
    /// A number that somebody chose.
    Fixed,
    /// A published number, made with other boxes and other clocks: external, not measured here.
    External {
        /// Who published it.
        source: &'static str,
    },
}

impl Basis {
    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            Basis::TrimmedExperts { .. } => "trimmed_experts",
            Basis::ContrastingGroups { .. } => "contrasting_groups",
            Basis::BestShare { .. } => "best_share",
            Basis::Fixed => "fixed",
            Basis::External { .. } => "external",
        }
    }
}

/// What a measured value is worth against a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Judgement {
    /// The whole error bar keeps the limit.
    Pass,
    /// The whole error bar breaks it.
    Fail,
    /// The error bar covers the limit: neither pass nor fail.
    Undecided,
    /// Nothing states the value's error, so that nobody knows whether its bar covers the limit: neither pass nor fail.
    ErrorUnknown,
    /// There is no usable value: neither pass nor fail.
    NotMeasured,
}

impl Judgement {
    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            Judgement::Pass => "pass",
            Judgement::Fail => "fail",
            Judgement::Undecided => "undecided",
            Judgement::ErrorUnknown => "error_unknown",
            Judgement::NotMeasured => "not_measured",
        }
    }
}

impl Target {
    /// A limit that somebody chose.
    pub fn fixed(limit: f64, direction: Direction) -> Result<Self, NoAnswer> {
        Self::new(limit, None, direction, Basis::Fixed)
    }

    fn new(limit: f64, interval: Option<Interval>, direction: Direction, basis: Basis) -> Result<Self, NoAnswer> {
        NoAnswer::finite(&[limit])?;
        sign(direction)?;
        Ok(Self { limit, interval, direction, basis })
    }

    /// Judges a value with its error bar.
    pub fn judge(&self, measured: Option<Measured>) -> Judgement {
        let Some(Ok(measured)) = measured.map(Measured::checked) else { return Judgement::NotMeasured };
        let Some(bar) = measured.bar else { return Judgement::ErrorUnknown };
        let keeps = |end: f64| match self.direction {
            Direction::Higher => end >= self.limit,
            _ => end <= self.limit,
        };
        match (keeps(bar.low), keeps(bar.high)) {
            (true, true) => Judgement::Pass,
            (false, false) => Judgement::Fail,
            _ => Judgement::Undecided,
        }
    }
}

/// What turns a feature so that more is better.
pub(super) fn sign(direction: Direction) -> Result<f64, NoAnswer> {
    match direction {
        Direction::Higher => Ok(1.0),
        Direction::Lower => Ok(-1.0),
        Direction::Neither => Err(NoAnswer::NoDirection),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn bar(low: f64, value: f64, high: f64) -> Option<Measured> {
        Some(Measured { value, bar: Some(Interval { low, high }) })
    }

    #[test]
    fn a_judgement_needs_the_whole_error_bar_on_one_side() {
        let seconds = Target::fixed(48.0, Direction::Lower).unwrap();
        assert_eq!(seconds.judge(bar(46.0, 47.0, 48.0)), Judgement::Pass);
        assert_eq!(seconds.judge(bar(46.0, 47.9, 48.1)), Judgement::Undecided);
        assert_eq!(seconds.judge(bar(47.9, 49.0, 50.0)), Judgement::Undecided);
        assert_eq!(seconds.judge(bar(48.1, 49.0, 50.0)), Judgement::Fail);
        let share = Target::fixed(0.5, Direction::Higher).unwrap();
        assert_eq!(share.judge(bar(0.5, 0.6, 0.7)), Judgement::Pass);
        assert_eq!(share.judge(bar(0.1, 0.2, 0.3)), Judgement::Fail);
        assert_eq!(share.judge(bar(0.4, 0.6, 0.7)), Judgement::Undecided);
    }

    #[test]
    fn what_is_not_known_neither_passes_nor_fails() {
        let target = Target::fixed(48.0, Direction::Lower).unwrap();
        assert_eq!(target.judge(None), Judgement::NotMeasured);
        assert_eq!(target.judge(bar(f64::NAN, 1.0, 2.0)), Judgement::NotMeasured);
        assert_eq!(target.judge(Some(Measured { value: 10.0, bar: None })), Judgement::ErrorUnknown);
    }

    #[test]
    fn a_limit_is_a_number_and_one_of_its_sides_is_better() {
        assert_eq!(Target::fixed(f64::NAN, Direction::Lower), Err(NoAnswer::NotFinite));
        assert_eq!(Target::fixed(1.0, Direction::Neither), Err(NoAnswer::NoDirection));
    }

    proptest! {
        #[test]
        fn mirrored_values_have_the_same_judgement(limit in -9.0f64..9.0, value in -9.0f64..9.0, half in 0.0f64..4.0) {
            let lower = Target::fixed(limit, Direction::Lower).unwrap();
            let higher = Target::fixed(-limit, Direction::Higher).unwrap();
            let judgement = lower.judge(bar(value - half, value, value + half));
            prop_assert_eq!(judgement, higher.judge(bar(-value - half, -value, -value + half)));
        }
    }
}
