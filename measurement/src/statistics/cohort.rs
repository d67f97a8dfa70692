//! Percentile of a value in a reference cohort: among the values of other people at the same task.
//!
//! Percentiles need no model of skill and no assumption about distributions, so they suit small cohorts. The caller
//! selects the cohort: same task, features version and role of the hand; for features in the camera's own axes also the
//! same box and calibration; and without the person who is ranked. Below [`MIN_PEOPLE`] there is no percentile. Its
//! interval contains both uncertainties: the cohort is a sample of people (Wilson), and the value is measured with an
//! error.

use super::interval::{ConfidenceInterval, MeasuredValue, wilson};
use super::no_answer::NoAnswer;
use super::person_values::{MIN_PEOPLE, PersonValues};
use crate::motion::features::Direction;

/// The percentile of a value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CohortPercentile {
    /// Share of the reference values below this one, in per cent; equal values count half.
    pub percentile: f64,
    /// 95 % interval of the percentile among *all* such people, for every true value within the value's bar.
    pub interval: ConfidenceInterval,
    /// Share of the reference values that this one is better than, in per cent, with its interval; `None` if neither
    /// direction is better.
    pub better_than: Option<(f64, ConfidenceInterval)>,
    /// Number of people in the cohort.
    pub people: usize,
    /// True if the interval includes the value's own error; false if that error is unknown.
    pub error_known: bool,
}

/// Computes a value's percentile in a cohort.
///
/// # Errors
/// [`NoAnswer`] if the cohort is too small or the value is unusable.
pub fn percentile_in_cohort(
    measured: MeasuredValue,
    cohort: &PersonValues,
    direction: Direction,
) -> Result<CohortPercentile, NoAnswer> {
    NoAnswer::at_least("people", cohort.count(), MIN_PEOPLE)?;
    let MeasuredValue { value, bar } = measured.checked()?;
    let ends = bar.unwrap_or(ConfidenceInterval { low: value, high: value });
    let doubt = |value| wilson(share_below(value, cohort), cohort.count());
    let interval = ConfidenceInterval { low: 100.0 * doubt(ends.low)?.low, high: 100.0 * doubt(ends.high)?.high };
    let percentile = 100.0 * share_below(value, cohort);
    let better_than = match direction {
        Direction::Higher => Some((percentile, interval)),
        Direction::Lower => Some((100.0 - percentile, interval.map(|end| 100.0 - end))),
        Direction::Neither => None,
    };
    Ok(CohortPercentile { percentile, interval, better_than, people: cohort.count(), error_known: bar.is_some() })
}

/// Share of the cohort's values below this one; equal values count half.
fn share_below(value: f64, cohort: &PersonValues) -> f64 {
    let below = cohort.values().partition_point(|reference| *reference < value);
    let not_above = cohort.values().partition_point(|reference| *reference <= value);
    (below + not_above) as f64 / 2.0 / cohort.count() as f64
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::numbers::distribution::Z_95;

    fn cohort(values: &[f64]) -> PersonValues {
        PersonValues::of_values(values.to_vec()).unwrap()
    }

    fn exact(value: f64) -> MeasuredValue {
        measured(value, 0.0)
    }

    fn measured(value: f64, half: f64) -> MeasuredValue {
        MeasuredValue { value, bar: Some(ConfidenceInterval::around(value, half)) }
    }

    #[test]
    fn the_middle_of_a_cohort_is_the_fiftieth_percentile() {
        let cohort = cohort(&(1..=11).map(f64::from).collect::<Vec<_>>());
        let got = percentile_in_cohort(exact(6.0), &cohort, Direction::Lower).unwrap();
        assert_eq!((got.percentile, got.people), (50.0, 11));
        let (better, interval) = got.better_than.unwrap();
        assert_eq!(better, 50.0);
        // Wilson's interval of a half is symmetric: half its width is z/2 over the root of n + z².
        let half = 50.0 * Z_95 / (11.0 + Z_95 * Z_95).sqrt();
        assert!(
            (interval.low - 50.0 + half).abs() < 1e-9 && (interval.high - 50.0 - half).abs() < 1e-9,
            "{interval:?}"
        );
        assert_eq!(percentile_in_cohort(exact(0.0), &cohort, Direction::Lower).unwrap().better_than.unwrap().0, 100.0);
        assert_eq!(percentile_in_cohort(exact(0.0), &cohort, Direction::Neither).unwrap().better_than, None);
    }

    #[test]
    fn a_value_s_own_error_widens_the_interval() {
        let cohort = cohort(&(1..=40).map(f64::from).collect::<Vec<_>>());
        let at = |measured| percentile_in_cohort(measured, &cohort, Direction::Higher).unwrap();
        let (sharp, blurred) = (at(exact(20.5)), at(measured(20.5, 8.0)));
        assert_eq!(sharp.percentile, blurred.percentile);
        assert!(blurred.interval.low < sharp.interval.low - 10.0 && blurred.interval.high > sharp.interval.high + 10.0);
        let unknown = at(MeasuredValue { value: 20.5, bar: None });
        assert!(!unknown.error_known && sharp.error_known && unknown.interval == sharp.interval);
    }

    #[test]
    fn a_small_cohort_gives_no_place() {
        let of =
            |people: usize, value| percentile_in_cohort(exact(value), &cohort(&vec![1.0; people]), Direction::Lower);
        assert_eq!(of(9, 1.0), Err(NoAnswer::TooFew { of: "people", found: 9, needed: 10 }));
        assert_eq!(of(0, 1.0), Err(NoAnswer::TooFew { of: "people", found: 0, needed: 10 }));
        assert_eq!(of(10, f64::NAN), Err(NoAnswer::NotFinite));
    }

    proptest! {
        #[test]
        fn a_larger_value_never_has_a_lower_percentile_and_lies_in_its_interval(
            references in prop::collection::vec(-10.0f64..10.0, MIN_PEOPLE..40),
            a in -12.0f64..12.0,
            b in -12.0f64..12.0,
            half in 0.0f64..3.0,
        ) {
            let cohort = cohort(&references);
            let of = |value| percentile_in_cohort(measured(value, half), &cohort, Direction::Higher).unwrap();
            prop_assert!(of(a.min(b)).percentile <= of(a.max(b)).percentile);
            let got = of(a);
            prop_assert!(got.interval.low - 1e-9 <= got.percentile && got.percentile <= got.interval.high + 1e-9);
            prop_assert!(got.interval.low >= 0.0 && got.interval.high <= 100.0);
        }
    }
}
