//! Error bars: how far a feature may be off because the path that it was measured on has errors.
//!
//! **Method** (a parametric bootstrap): [`replicate`] makes [`REPLICATES`] copies of the path, each with added errors
//! of the size that the path states. The feature is measured on each copy; the spread of these values is the spread of
//! the feature. Errors can shift a feature to one side (they lengthen every path, in any direction). The same shift
//! appears a second time between the path and its replicates, so it is estimated there and removed. **Assumes** that a
//! path's errors are correlated in time as [`replicate`] describes. **Goal:** in 95 of 100 sessions the value on the
//! true path lies within the bar. `docs/accuracy.md` states the share that `benches/figures` (part `features`) measures,
//! on simulated people that were not used to set the errors. **Gives up** if the path states no errors, or if a feature
//! has no value on too many replicates.

pub mod duration;
pub mod replicate;

use super::Feature;

/// Number of replicates: 32 give the spread to 13 %.
pub const REPLICATES: usize = 32;
/// Minimum number of replicates with a value.
const MIN_REPLICATES: usize = 28;
/// Quantile of Student's t at 97.5 % with [`REPLICATES`] − 1 degrees of freedom.
const STUDENT_T: f64 = 2.04;
/// A shift is removed only if it exceeds this many times its own standard error.
const SHIFT_SIGNIFICANCE: f64 = 2.0;
/// Units of lengths, including angles on a sphere around the trocar. Errors add to these in squares. No feature in
/// these units has a sign.
const LENGTH_UNITS: [&str; 4] = ["mm", "mm/s", "rad", "rad/s"];
/// For a quantity that is not a length: a shift above this share of the value is too uncertain to be removed.
const MAX_SHIFT_SHARE: f64 = 0.4;
/// Standard deviation added to a count, because it may be off by one.
const COUNT_SIGMA: f64 = 0.5;
/// Uncertainty of the removed shift, as a standard deviation in multiples of the shift: a session's real errors differ
/// from the stated ones.
const SHIFT_SIGMA_RATIO: f64 = 1.5;

/// The error bar of a value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorBar {
    /// The value before the shift caused by errors was removed.
    pub as_measured: f64,
    /// Standard deviation, in the feature's unit.
    pub sigma: f64,
    /// Lower end of the bar, which is meant to hold the value on the true path in 95 of 100 sessions.
    pub low: f64,
    /// Upper end of the bar.
    pub high: f64,
}

/// Why a value has no error bar.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoErrorBar {
    /// Not computed: during a live recording.
    #[error("not computed here")]
    NotComputed,
    /// There is no value.
    #[error("there is no value")]
    NoValue,
    /// The path does not state its own errors.
    #[error("the path does not state its own errors")]
    ErrorsNotStated,
    /// The value depends on the errors: on many equally likely paths there is none.
    #[error("with other errors of the same size there would be no value")]
    Unsteady,
    /// A duration: a tool moved as the recording began or ended, so the attempt took longer by an unknown time.
    #[error("at least this long: a tool was moving as the recording began or ended")]
    AtLeast,
}

impl NoErrorBar {
    /// All reasons.
    const ALL: [Self; 5] = [Self::NotComputed, Self::NoValue, Self::ErrorsNotStated, Self::Unsteady, Self::AtLeast];

    /// Its stable name, for texts in other languages.
    pub fn code(self) -> &'static str {
        match self {
            Self::NotComputed => "not_computed",
            Self::NoValue => "no_value",
            Self::ErrorsNotStated => "errors_not_stated",
            Self::Unsteady => "unsteady",
            Self::AtLeast => "at_least",
        }
    }

    /// The reason that a result states in words; `None` if this program does not know them. Results store the sentence, so
    /// that a table or a file can be read without this program.
    pub fn of(sentence: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|reason| reason.to_string() == sentence)
    }
}

/// Computes the value with the shift by errors removed, and its error bar, from the measured value and the values of
/// the replicates.
///
/// # Errors
/// [`NoErrorBar::Unsteady`] if too few replicates have a value.
pub fn error_bar(
    feature: &Feature,
    measured: f64,
    replicates: impl Iterator<Item = f64>,
) -> Result<(f64, ErrorBar), NoErrorBar> {
    let (range, values): (_, Vec<f64>) = (feature.range, replicates.collect());
    if values.len() < MIN_REPLICATES {
        return Err(NoErrorBar::Unsteady);
    }
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let spread = (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let is_whole = values.iter().chain([&measured]).all(|value| value.fract() == 0.0);
    let is_count = is_whole && feature.unit == "1" && range.1 > 1.0;
    let shift = mean - measured;
    let is_significant = !is_count && shift.abs() > SHIFT_SIGNIFICANCE * spread / n.sqrt();
    let value = match () {
        _ if !is_significant => measured,
        // Errors add to a length in squares. This matters where there is little else: at rest the whole length comes
        // from errors.
        _ if LENGTH_UNITS.contains(&feature.unit) && shift > 0.0 => {
            (2.0 * measured * measured - mean * mean).max(0.0).sqrt()
        }
        _ if feature.range.0 == 0.0 && shift > MAX_SHIFT_SHARE * measured => measured, // the error bar covers it
        _ => measured - shift,
    };
    let value = value.clamp(range.0, range.1);
    let sigma = spread
        .hypot(if is_significant { SHIFT_SIGMA_RATIO * shift } else { 0.0 })
        .hypot(feature.family.extra_sigma_share() * value);
    let sigma = if is_count { sigma.hypot(COUNT_SIGMA) } else { sigma };
    let [low, high] = [value - STUDENT_T * sigma, value + STUDENT_T * sigma].map(|end| end.clamp(range.0, range.1));
    Ok((value, ErrorBar { as_measured: measured, sigma, low, high }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::features::path::PATH_LENGTH;
    use crate::motion::features::per_movement::{LOG_DIMENSIONLESS_JERK, MOVEMENTS};
    use crate::motion::features::time::IDLE_SHARE;
    use crate::random::Dice;

    #[test]
    fn each_reason_is_found_by_its_sentence_and_has_a_code_of_its_own() {
        let mut codes: Vec<&str> = NoErrorBar::ALL.iter().map(|reason| reason.code()).collect();
        NoErrorBar::ALL.iter().for_each(|reason| assert_eq!(NoErrorBar::of(&reason.to_string()), Some(*reason)));
        codes.sort_unstable();
        codes.dedup();
        assert_eq!(codes.len(), NoErrorBar::ALL.len());
        assert_eq!(NoErrorBar::of("another program's words"), None);
    }

    #[test]
    fn a_shift_by_errors_is_taken_off_and_a_spread_is_stated() {
        let mut dice = Dice::new(1, "errors");
        let values: Vec<f64> = (0..REPLICATES).map(|_| 10.0 + dice.gauss()).collect();
        let (value, bar) = error_bar(&LOG_DIMENSIONLESS_JERK, 5.0, values.into_iter()).unwrap();
        assert!((value - 0.0).abs() < 0.7, "{value}");
        assert!(bar.as_measured == 5.0 && bar.low < value && value < bar.high && bar.sigma > 1.0, "{bar:?}");
    }

    #[test]
    fn a_length_that_is_all_errors_is_none() {
        let mut dice = Dice::new(2, "errors");
        let values: Vec<f64> = (0..REPLICATES).map(|_| 2f64.sqrt() * 40.0 + dice.gauss()).collect();
        let (value, bar) = error_bar(&PATH_LENGTH, 40.0, values.into_iter()).unwrap();
        assert!(value < 10.0 && bar.low == 0.0, "{value} {bar:?}");
    }

    #[test]
    fn a_chance_difference_is_no_shift_and_a_count_stays_whole() {
        let even = (0..REPLICATES).map(|k| 50.0 + f64::from(k as u8 % 2) - 0.4);
        assert_eq!(error_bar(&PATH_LENGTH, 50.0, even).unwrap().0, 50.0);
        let counts = (0..REPLICATES).map(|k| 14.0 + f64::from(k as u8 % 3));
        let (value, bar) = error_bar(&MOVEMENTS, 12.0, counts).unwrap();
        assert!(value == 12.0 && bar.low < 12.0 && bar.high > 12.0, "{bar:?}");
    }

    #[test]
    fn no_bar_leaves_the_range() {
        let values = (0..REPLICATES).map(|k| if k % 2 == 0 { 0.9 } else { 1.0 });
        let (value, bar) = error_bar(&IDLE_SHARE, 0.96, values).unwrap();
        assert!(value <= 1.0 && bar.high == 1.0 && bar.low > 0.7, "{value} {bar:?}");
    }

    #[test]
    fn what_has_no_value_on_many_replicates_has_no_bar() {
        assert_eq!(error_bar(&MOVEMENTS, 1.0, [1.0; MIN_REPLICATES - 1].into_iter()), Err(NoErrorBar::Unsteady));
    }
}
