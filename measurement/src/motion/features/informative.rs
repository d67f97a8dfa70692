//! Whether a value says something, or is lost in its own error bar.
//!
//! **In:** a value and the ends of its error bar. **Out:** `None` if the value says something, or why it does not.
//! **Method:** the error bar is compared with what was known before anything was measured.
//! - A feature that every working tool has (a length, a speed, a number of movements) is above its smallest possible
//!   value in any case. If the bar reaches that value, the measurement adds nothing to it: half the bar is as wide as
//!   the value itself. A path ratio counts from 1, the straight line, and the spectral arc length from 0 downwards.
//! - A share or a correlation may honestly be 0, and the size of a share is no measure of its error: 2 % ± 3 % is a
//!   result. Such a value says nothing if its bar covers more than half of what is possible. Even among people who
//!   differ as much as the range allows (all values equally common), its reliability σ²ₚ/(σ²ₚ + σ²) is then below
//!   0.85; single people are not compared by less than 0.8 to 0.9 (Nunnally 1978).
//! - A logarithm states a factor. An error of 1 is an error of 100 % of what the logarithm was taken of
//!   (`σ(ln x) = σ(x)/x`), which is the first rule again.
//!
//! **Assumes** nothing about other people: how widely a task's trainees differ decides whether a *comparison* is worth
//! it, and that is for percentiles and standards, which have intervals of their own. Times of view are counted, not
//! measured on a path: they always say something. **Gives up** on a value without an error bar.

use super::{Family, Feature, path, per_movement, spectrum};

/// Shares that no working tool has none of: their bar is compared with the value, not with the range. All of them are
/// far below 1.
const POSITIVE_SHARES: [&Feature; 3] = [&path::ECONOMY_OF_AREA, &path::ECONOMY_OF_VOLUME, &spectrum::TREMOR_SHARE];

/// Logarithms.
const LOGARITHMS: [&Feature; 1] = [&per_movement::LOG_DIMENSIONLESS_JERK];

/// A bar wider than this share of the possible values says nothing.
const MAX_RANGE_SHARE: f64 = 0.5;

/// A logarithm says nothing if half of its bar is at least this wide: a factor of 2.7.
const MAX_LOG_ERROR: f64 = 1.0;

/// Why a value says nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TooUncertain {
    /// The bar reaches the smallest possible value: the error is as large as the value.
    AsLargeAsValue,
    /// The bar covers more than half of the possible values.
    HalfOfRange,
    /// The value is a logarithm, and what it was taken of may be off by a factor of 2.7.
    LargeFactor,
}

impl TooUncertain {
    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            TooUncertain::AsLargeAsValue => "as_large_as_value",
            TooUncertain::HalfOfRange => "half_of_range",
            TooUncertain::LargeFactor => "large_factor",
        }
    }
}

impl Feature {
    /// Why a value with this error bar says nothing; `None` if it says something.
    pub fn too_uncertain(&self, value: f64, [low, high]: [f64; 2]) -> Option<TooUncertain> {
        let half = (value - low).max(high - value); // a bar that the range cuts off is wider on the other side
        match () {
            _ if self.family == Family::View => None,
            _ if LOGARITHMS.contains(&self) => (half >= MAX_LOG_ERROR).then_some(TooUncertain::LargeFactor),
            _ if self.is_part() => {
                (high - low > MAX_RANGE_SHARE * (self.range.1 - self.range.0)).then_some(TooUncertain::HalfOfRange)
            }
            _ => {
                let reaches_none = if self.range.1 <= 0.0 { high >= self.range.1 } else { low <= self.range.0 };
                (reaches_none && low < high).then_some(TooUncertain::AsLargeAsValue)
            }
        }
    }

    /// True for shares and correlations that may be 0.
    fn is_part(&self) -> bool {
        self.unit == "1" && self.range.0 >= -1.0 && self.range.1 <= 1.0 && !POSITIVE_SHARES.contains(&self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::features::{FEATURES, find};

    fn of(name: &str, value: f64, bar: [f64; 2]) -> Option<TooUncertain> {
        find(name).unwrap().too_uncertain(value, bar)
    }

    #[test]
    fn a_size_says_nothing_where_its_error_is_as_large_as_itself() {
        assert_eq!(of("smoothness", 0.4, [0.0, 5.8]), Some(TooUncertain::AsLargeAsValue));
        assert_eq!(of("path_length", 270.0, [251.0, 289.0]), None);
        assert_eq!(of("path_length", 20.0, [0.1, 39.9]), None, "above nothing, however little");
        assert_eq!(of("mean_velocity", 0.0, [0.0, 4.4]), Some(TooUncertain::AsLargeAsValue), "it may be at rest");
        assert_eq!(of("movements", 2.0, [0.0, 4.1]), Some(TooUncertain::AsLargeAsValue));
        assert_eq!(of("tremor_share", 0.004, [0.0, 0.018]), Some(TooUncertain::AsLargeAsValue));
        assert_eq!(of("spectral_arc_length", -1.2, [-2.5, 0.0]), Some(TooUncertain::AsLargeAsValue));
        assert_eq!(of("spectral_arc_length", -1.7, [-2.1, -1.3]), None);
    }

    #[test]
    fn a_ratio_to_the_straight_way_counts_from_one() {
        assert_eq!(of("path_ratio", 1.3, [1.0, 1.8]), Some(TooUncertain::AsLargeAsValue));
        assert_eq!(of("path_ratio", 2.0, [1.2, 2.8]), None);
    }

    #[test]
    fn a_share_may_be_none_and_says_nothing_only_over_half_of_its_range() {
        assert_eq!(of("idle_share", 0.0, [0.0, 0.0]), None);
        assert_eq!(of("idle_share", 0.02, [0.0, 0.05]), None);
        assert_eq!(of("idle_share", 0.3, [0.0, 0.6]), Some(TooUncertain::HalfOfRange));
        assert_eq!(of("synchrony", 0.05, [-0.2, 0.3]), None, "a correlation near 0 is a result");
        assert_eq!(of("synchrony", 0.05, [-0.6, 0.7]), Some(TooUncertain::HalfOfRange));
        assert_eq!(of("long_pauses", 0.0, [0.0, 0.0]), None, "no replicate has a long pause");
        assert_eq!(of("medium_pauses", 0.0, [0.0, 41.0]), Some(TooUncertain::AsLargeAsValue));
    }

    #[test]
    fn a_logarithm_says_nothing_from_an_error_of_a_factor() {
        assert_eq!(of("log_dimensionless_jerk", -2.7, [-12.7, 7.3]), Some(TooUncertain::LargeFactor));
        assert_eq!(of("log_dimensionless_jerk", -6.9, [-7.6, -6.2]), None);
    }

    #[test]
    fn what_the_tracker_counts_always_says_something() {
        for feature in FEATURES.iter().filter(|feature| feature.family == Family::View) {
            assert_eq!(feature.too_uncertain(0.0, [0.0, 1.0]), None, "{feature}");
        }
    }

    #[test]
    fn a_value_without_error_says_something_and_a_wider_bar_never_says_more() {
        for feature in FEATURES {
            let (least, most) = feature.range;
            let clamp = |x: f64| x.clamp(least, most);
            for value in [-7.0, -0.9, 0.0, 0.2, 0.97, 1.4, 300.0].map(clamp) {
                assert_eq!(feature.too_uncertain(value, [value, value]), None, "{feature} {value}");
                let says_nothing = |half: f64| feature.too_uncertain(value, [clamp(value - half), clamp(value + half)]);
                let widths = [0.01, 0.1, 0.5, 1.0, 3.0, 50.0, 1e4].map(says_nothing);
                assert!(widths.is_sorted_by_key(|why| why.is_some()), "{feature} {value}: {widths:?}");
            }
        }
    }
}
