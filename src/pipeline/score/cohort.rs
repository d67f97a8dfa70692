//! A value's place in a reference cohort: its percentile among the values of other people at the same task.
//!
//! Percentiles need no model of skill and no assumption on distributions, so they are what small cohorts can bear. The
//! caller picks the cohort (one value per person, same task, same pipeline version); below a minimum there is no place.

use crate::pipeline::features::Direction;

/// Fewest reference values from which a percentile is given. With ten, one person more or less shifts it by ten points;
/// with fewer it would say nothing.
pub const FEWEST_REFERENCES: usize = 10;

/// Where a value stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Share of the reference values below this one, in per cent; equal ones count half.
    pub percentile: f64,
    /// Share of the reference values that this one is better than, in per cent; `None` where neither direction is better.
    pub better_than: Option<f64>,
    /// How many reference values there are.
    pub references: usize,
}

/// Why a value has no place.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NoPlace {
    /// Too small a cohort.
    #[error("the cohort has {found} values of this feature; needs {needed}")]
    TooFew {
        /// How many it has.
        found: usize,
        /// How many it takes.
        needed: usize,
    },
    /// The value or a reference is not a number.
    #[error("a value is not a finite number")]
    NotFinite,
}

/// Finds a value's place among reference values.
pub fn place(value: f64, references: &[f64], direction: Direction) -> Result<Place, NoPlace> {
    if references.len() < FEWEST_REFERENCES {
        return Err(NoPlace::TooFew { found: references.len(), needed: FEWEST_REFERENCES });
    }
    if !value.is_finite() || references.iter().any(|reference| !reference.is_finite()) {
        return Err(NoPlace::NotFinite);
    }
    let below = references.iter().filter(|reference| **reference < value).count() as f64;
    let equal = references.iter().filter(|reference| **reference == value).count() as f64;
    let percentile = 100.0 * (below + equal / 2.0) / references.len() as f64;
    let better_than = match direction {
        Direction::Higher => Some(percentile),
        Direction::Lower => Some(100.0 - percentile),
        Direction::Neither => None,
    };
    Ok(Place { percentile, better_than, references: references.len() })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_middle_of_a_cohort_is_the_fiftieth_percentile() {
        let references: Vec<f64> = (1..=11).map(f64::from).collect();
        let got = place(6.0, &references, Direction::Lower).unwrap();
        assert_eq!((got.percentile, got.better_than, got.references), (50.0, Some(50.0), 11));
        assert_eq!(place(0.0, &references, Direction::Lower).unwrap().better_than, Some(100.0));
        assert_eq!(place(0.0, &references, Direction::Neither).unwrap().better_than, None);
    }

    #[test]
    fn a_small_cohort_gives_no_place() {
        assert_eq!(place(1.0, &[1.0; 9], Direction::Lower), Err(NoPlace::TooFew { found: 9, needed: 10 }));
        assert_eq!(place(f64::NAN, &[1.0; 10], Direction::Lower), Err(NoPlace::NotFinite));
    }

    proptest! {
        #[test]
        fn a_larger_value_never_has_a_lower_percentile(
            references in prop::collection::vec(-10.0f64..10.0, FEWEST_REFERENCES..40),
            a in -12.0f64..12.0,
            b in -12.0f64..12.0,
        ) {
            let of = |value| place(value, &references, Direction::Higher).unwrap().percentile;
            prop_assert!(of(a.min(b)) <= of(a.max(b)));
            prop_assert!((0.0..=100.0).contains(&of(a)));
        }
    }
}
