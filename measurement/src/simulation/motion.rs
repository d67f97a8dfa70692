//! Motion of a hand as pure functions of time: minimum-jerk reaches that add up, and tremor.
//!
//! A reach follows `10τ³ − 15τ⁴ + 6τ⁵` (Flash & Hogan 1985). Reaches that overlap in time simply add (Flash & Henis
//! 1991), which rounds the corners of a fluent hand's path; a hesitant hand stops at each of them.

use std::f64::consts::TAU;
use std::ops::{Add, Mul};

use nalgebra::Vector3;

use crate::random::Dice;

/// A quantity over time: a start value plus the sum of all reaches so far.
#[derive(Clone, Debug, PartialEq)]
pub struct ReachSum<V> {
    start: V,
    reaches: Vec<MinimumJerkReach<V>>,
}

#[derive(Clone, Debug, PartialEq)]
struct MinimumJerkReach<V> {
    start_s: f64,
    duration_s: f64,
    by: V,
}

impl<V: Copy + Add<Output = V> + Mul<f64, Output = V>> ReachSum<V> {
    /// A quantity that stays at `start`.
    pub fn resting_at(start: V) -> Self {
        Self { start, reaches: Vec::new() }
    }

    /// Adds a smooth step of `by` that begins at `start_s` and lasts `duration_s`.
    pub fn add_reach(&mut self, start_s: f64, duration_s: f64, by: V) {
        self.reaches.push(MinimumJerkReach { start_s, duration_s, by });
    }

    /// The value at a time.
    pub fn at(&self, time_s: f64) -> V {
        let begun = self.reaches.iter().filter(|r| r.start_s < time_s);
        begun.fold(self.start, |sum, r| sum + r.by * progress((time_s - r.start_s) / r.duration_s))
    }
}

/// Share of a minimum-jerk reach that is done after the share `tau` of its time.
fn progress(tau: f64) -> f64 {
    let tau = tau.clamp(0.0, 1.0);
    tau * tau * tau * (10.0 + tau * (6.0 * tau - 15.0))
}

/// A sum of sines in fixed directions: tremor or slow unsteadiness.
#[derive(Clone, Debug, PartialEq)]
pub struct Oscillation(Vec<Sine>);

#[derive(Clone, Debug, PartialEq)]
struct Sine {
    amplitude: Vector3<f64>,
    frequency_hz: f64,
    phase: f64,
}

impl Oscillation {
    /// Motion of `rms` per coordinate, with frequencies spread over `from_hz..to_hz`.
    pub fn new(dice: &mut Dice, rms: f64, from_hz: f64, to_hz: f64) -> Self {
        const SINES: usize = 5;
        let sine = |dice: &mut Dice| Sine {
            amplitude: dice.gauss3() * (rms * (2.0 / SINES as f64).sqrt()),
            frequency_hz: dice.within(from_hz, to_hz),
            phase: dice.within(0.0, TAU),
        };
        Self((0..SINES).map(|_| sine(dice)).collect())
    }

    /// Displacement at a time.
    pub fn at(&self, time_s: f64) -> Vector3<f64> {
        self.0.iter().map(|s| s.amplitude * (TAU * s.frequency_hz * time_s + s.phase).sin()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reach_starts_and_ends_at_rest_and_peaks_at_15_eighths_of_its_mean_speed() {
        let mut course = ReachSum::resting_at(2.0);
        course.add_reach(1.0, 2.0, 10.0);
        assert_eq!((course.at(0.5), course.at(3.0), course.at(9.0)), (2.0, 12.0, 12.0));
        let speed = |t: f64| (course.at(t + 1e-5) - course.at(t - 1e-5)) / 2e-5;
        assert!((speed(2.0) - 15.0 / 8.0 * 5.0).abs() < 1e-6, "{}", speed(2.0));
        assert!(speed(1.0).abs() < 1e-3 && speed(3.0).abs() < 1e-3);
    }

    #[test]
    fn reaches_add_up_at_any_overlap() {
        let mut course = ReachSum::resting_at(0.0);
        course.add_reach(0.0, 2.0, 3.0);
        course.add_reach(1.0, 2.0, -1.0);
        assert!((course.at(3.0) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn tremor_has_the_deviation_asked_for_on_average() {
        let of_seed = |seed| Oscillation::new(&mut Dice::new(seed, "tremor"), 0.3, 5.0, 11.0);
        let square = |o: &Oscillation| (0..500).map(|i| o.at(f64::from(i) * 0.037).norm_squared()).sum::<f64>() / 500.0;
        let mean = (0..60).map(|seed| square(&of_seed(seed))).sum::<f64>() / 60.0;
        assert!(((mean / 3.0).sqrt() / 0.3 - 1.0).abs() < 0.15, "RMS {}", (mean / 3.0).sqrt());
    }
}
