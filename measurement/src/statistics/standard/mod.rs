//! Standards: the limit that a feature has to meet, its origin, and the judgement on a measured value.
//!
//! Ways to set a limit (METHOD 7.1): the mean of experts without outliers ([`experts`]), the boundary between novices
//! and experts ([`contrasting_groups()`]), the best share of peers ([`best_share`]), or a fixed number
//! ([`FeatureTarget::fixed`], [`fls`]). Published sets of limits differ so much that the choice changes who passes
//! (Luursema 2015), so a target always states its basis. A judgement compares the value's error bar with the limit
//! alone. The limit's own interval shows how well founded the standard is; once the limit is set, the interval passes
//! or fails no trainee.

pub mod contrasting_groups;
pub mod experts;
pub mod fls;

pub use contrasting_groups::{ErrorRate, contrasting_groups, meeting_rate, missing_rate};
pub use experts::{MIN_EXPERTS, best_share, trimmed_experts};

use super::interval::{ConfidenceInterval, MeasuredValue};
use super::no_answer::NoAnswer;
use crate::motion::features::Direction;

/// A limit that a feature has to meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FeatureTarget {
    /// The limit, in the feature's unit; a value equal to it meets it.
    pub limit: f64,
    /// 95 % interval of the limit over other people of the same kind; `None` if it was fixed.
    pub interval: Option<ConfidenceInterval>,
    /// The better side: lower or higher, never neither.
    pub direction: Direction,
    /// What it is based on.
    pub basis: TargetBasis,
}

/// The basis of a limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TargetBasis {
    /// The mean of experts without outliers.
    TrimmedExperts {
        /// Number of measured experts.
        experts: usize,
        /// Number of experts left out because they lay more than two standard deviations off.
        dropped: usize,
    },
    /// The boundary between novices and experts.
    ContrastingGroups {
        /// Number of novices.
        novices: usize,
        /// Number of experts.
        experts: usize,
        /// Share of novices that it lets pass.
        false_pass: ErrorRate,
        /// Share of experts that it fails.
        false_fail: ErrorRate,
    },
    /// The best share of these people.
    BestShare {
        /// Number of people.
        people: usize,
        /// The share, between 0 and 1.
        share: f64,
    },
    /// A number that was chosen.
    Fixed,
    /// A published number, measured with other boxes and clocks: external, not measured here.
    External {
        /// Who published it.
        source: &'static str,
    },
}

/// The judgement on a measured value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TargetJudgement {
    /// The whole error bar meets the limit.
    Pass,
    /// The whole error bar misses the limit.
    Fail,
    /// The error bar covers the limit: neither pass nor fail.
    Undecided,
    /// The value's error is unknown, so its bar may cover the limit: neither pass nor fail.
    ErrorUnknown,
    /// There is no usable value: neither pass nor fail.
    NotMeasured,
}

impl FeatureTarget {
    /// A limit that was chosen.
    ///
    /// # Errors
    /// [`NoAnswer`] for a limit that is not finite, or a feature where neither direction is better.
    pub fn fixed(limit: f64, direction: Direction) -> Result<Self, NoAnswer> {
        Self::new(limit, None, direction, TargetBasis::Fixed)
    }

    fn new(
        limit: f64,
        interval: Option<ConfidenceInterval>,
        direction: Direction,
        basis: TargetBasis,
    ) -> Result<Self, NoAnswer> {
        NoAnswer::finite(&[limit])?;
        sign(direction)?;
        Ok(Self { limit, interval, direction, basis })
    }

    /// Judges a value with its error bar.
    pub fn judge(&self, measured: Option<MeasuredValue>) -> TargetJudgement {
        let Some(Ok(measured)) = measured.map(MeasuredValue::checked) else { return TargetJudgement::NotMeasured };
        let Some(bar) = measured.bar else { return TargetJudgement::ErrorUnknown };
        let keeps = |end: f64| match self.direction {
            Direction::Higher => end >= self.limit,
            _ => end <= self.limit,
        };
        match (keeps(bar.low), keeps(bar.high)) {
            (true, true) => TargetJudgement::Pass,
            (false, false) => TargetJudgement::Fail,
            _ => TargetJudgement::Undecided,
        }
    }

    /// Judges a lower bound: the true value is at least this one.
    pub fn judge_lower_bound(&self, value: f64) -> TargetJudgement {
        match self.direction {
            _ if !value.is_finite() => TargetJudgement::NotMeasured,
            Direction::Higher if value >= self.limit => TargetJudgement::Pass,
            Direction::Lower if value > self.limit => TargetJudgement::Fail,
            _ => TargetJudgement::Undecided,
        }
    }
}

/// The sign that makes larger values better.
///
/// # Errors
/// [`NoAnswer::NoDirection`] if neither direction is better.
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

    fn bar(low: f64, value: f64, high: f64) -> Option<MeasuredValue> {
        Some(MeasuredValue { value, bar: Some(ConfidenceInterval { low, high }) })
    }

    #[test]
    fn a_lower_bound_decides_only_beyond_the_limit() {
        let [less, more] = [Direction::Lower, Direction::Higher].map(|side| FeatureTarget::fixed(48.0, side).unwrap());
        let judged = |target: &FeatureTarget| [40.0, 48.0, 49.0].map(|value| target.judge_lower_bound(value));
        use TargetJudgement::{Fail, Pass, Undecided};
        assert_eq!(judged(&less), [Undecided, Undecided, Fail]);
        assert_eq!(judged(&more), [Undecided, Pass, Pass]);
        assert_eq!(less.judge_lower_bound(f64::NAN), TargetJudgement::NotMeasured);
    }

    #[test]
    fn a_judgement_needs_the_whole_error_bar_on_one_side() {
        let seconds = FeatureTarget::fixed(48.0, Direction::Lower).unwrap();
        assert_eq!(seconds.judge(bar(46.0, 47.0, 48.0)), TargetJudgement::Pass);
        assert_eq!(seconds.judge(bar(46.0, 47.9, 48.1)), TargetJudgement::Undecided);
        assert_eq!(seconds.judge(bar(47.9, 49.0, 50.0)), TargetJudgement::Undecided);
        assert_eq!(seconds.judge(bar(48.1, 49.0, 50.0)), TargetJudgement::Fail);
        let share = FeatureTarget::fixed(0.5, Direction::Higher).unwrap();
        assert_eq!(share.judge(bar(0.5, 0.6, 0.7)), TargetJudgement::Pass);
        assert_eq!(share.judge(bar(0.1, 0.2, 0.3)), TargetJudgement::Fail);
        assert_eq!(share.judge(bar(0.4, 0.6, 0.7)), TargetJudgement::Undecided);
    }

    #[test]
    fn what_is_not_known_neither_passes_nor_fails() {
        let target = FeatureTarget::fixed(48.0, Direction::Lower).unwrap();
        assert_eq!(target.judge(None), TargetJudgement::NotMeasured);
        assert_eq!(target.judge(bar(f64::NAN, 1.0, 2.0)), TargetJudgement::NotMeasured);
        assert_eq!(target.judge(Some(MeasuredValue { value: 10.0, bar: None })), TargetJudgement::ErrorUnknown);
    }

    #[test]
    fn a_limit_is_a_number_and_one_of_its_sides_is_better() {
        assert_eq!(FeatureTarget::fixed(f64::NAN, Direction::Lower), Err(NoAnswer::NotFinite));
        assert_eq!(FeatureTarget::fixed(1.0, Direction::Neither), Err(NoAnswer::NoDirection));
    }

    proptest! {
        #[test]
        fn mirrored_values_have_the_same_judgement(limit in -9.0f64..9.0, value in -9.0f64..9.0, half in 0.0f64..4.0) {
            let lower = FeatureTarget::fixed(limit, Direction::Lower).unwrap();
            let higher = FeatureTarget::fixed(-limit, Direction::Higher).unwrap();
            let judgement = lower.judge(bar(value - half, value, value + half));
            prop_assert_eq!(judgement, higher.judge(bar(-value - half, -value, -value + half)));
        }
    }
}
