//! How far a feature may be off, because the path it was measured on is.
//!
//! **Method** (a parametric bootstrap): the path is made anew [`REPLICATES`] times, each time with errors added that are like
//! those it states of itself ([`replicate`]), and the feature is measured on each. Their spread is the feature's. Where errors
//! shift a feature to one side (they lengthen every path, whichever way they point), the same shift shows once more between
//! the path and its replicates, and is taken off. **Assumes** that a path's errors hang together in time as [`replicate`]
//! says. Their size was set on 17 scenes of three renderers and chosen among three on six simulated ones. On twelve simulated people
//! who had no part in that, 92.5 of 100 features lay within the bar about the value of the true path; with what
//! [`super::Family`] adds since then, `benches/figures` measures it on twelve others (part `features`). **Gives up** where the path states no errors, or where a
//! feature has no value on too many replicates.

pub mod replicate;

use super::Feature;

/// How many times the path is made anew: the spread of so many is known to 13 %.
pub const REPLICATES: usize = 32;
/// Replicates that must have a value.
const ENOUGH: usize = 28;
/// Quantile of Student's t at 97.5 % with as many degrees of freedom as replicates but one.
const T: f64 = 2.04;
/// A shift is taken off if it is so many times its own standard error.
const SHIFT_SEEN: f64 = 2.0;
/// Units of lengths, also on a sphere about the trocar, to which errors add in squares.
const LENGTHS: [&str; 4] = ["mm", "mm/s", "rad", "rad/s"];
/// A shift by more than this share of a size that is no length is not known well enough to be taken off.
const LARGEST_SHARE: f64 = 0.4;
/// A count may be off by one.
const COUNT_UNSURE: f64 = 0.5;
/// So much of what is taken off may be missing, as a standard deviation: a session's errors are not quite those it states.
const SHIFT_UNSURE: f64 = 1.5;

/// How far a value may be off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorBar {
    /// The value before the shift that errors cause was taken off.
    pub as_measured: f64,
    /// Standard deviation, in the feature's unit.
    pub sigma: f64,
    /// The feature on the true path lies between this
    pub low: f64,
    /// and this in 95 of 100 sessions.
    pub high: f64,
}

/// Why it is not known how far a value may be off.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoErrorBar {
    /// Not worked out here: of windows, and while a recording goes on.
    #[error("not worked out here")]
    NotAsked,
    /// There is no value.
    #[error("there is no value")]
    NoValue,
    /// The path does not say how far it may be off.
    #[error("the path does not state its own errors")]
    NotStated,
    /// The feature's value hangs on errors: on many equally likely paths there is none.
    #[error("with other errors of the same size there would be no value")]
    Unsteady,
}

/// A value without the shift that errors cause, and how far it may be off: from what was measured, and from what
/// replicates of the path gave.
pub fn error_bar(
    feature: &Feature,
    measured: f64,
    replicates: impl Iterator<Item = f64>,
) -> Result<(f64, ErrorBar), NoErrorBar> {
    let (range, values): (_, Vec<f64>) = (feature.range, replicates.collect());
    if values.len() < ENOUGH {
        return Err(NoErrorBar::Unsteady);
    }
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let spread = (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let is_whole = values.iter().chain([&measured]).all(|value| value.fract() == 0.0);
    let is_count = is_whole && feature.unit == "1" && range.1 > 1.0;
    let shift = mean - measured;
    let is_seen = !is_count && shift.abs() > SHIFT_SEEN * spread / n.sqrt();
    let value = match () {
        _ if !is_seen => measured,
        // What errors add to a length they add in squares, which counts where there is little else: at rest, all of it is theirs.
        _ if LENGTHS.contains(&feature.unit) && shift > 0.0 => {
            (2.0 * measured * measured - mean * mean).max(0.0).sqrt()
        }
        _ if feature.range.0 == 0.0 && shift > LARGEST_SHARE * measured => measured, // the bar says it
        _ => measured - shift,
    };
    let value = value.clamp(range.0, range.1);
    let sigma = spread
        .hypot(if is_seen { SHIFT_UNSURE * shift } else { 0.0 })
        .hypot(feature.family.beyond_replicates() * value);
    let sigma = if is_count { sigma.hypot(COUNT_UNSURE) } else { sigma };
    let [low, high] = [value - T * sigma, value + T * sigma].map(|end| end.clamp(range.0, range.1));
    Ok((value, ErrorBar { as_measured: measured, sigma, low, high }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::features::path::PATH_LENGTH;
    use crate::pipeline::features::per_movement::{LOG_DIMENSIONLESS_JERK, MOVEMENTS};
    use crate::pipeline::features::time::IDLE_SHARE;
    use crate::random::Dice;

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
        assert_eq!(error_bar(&MOVEMENTS, 1.0, [1.0; ENOUGH - 1].into_iter()), Err(NoErrorBar::Unsteady));
    }
}
