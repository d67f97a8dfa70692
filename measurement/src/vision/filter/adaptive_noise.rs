//! Process noise that adapts to how lively a hand is (Bar-Shalom, Li & Kirubarajan 2001, section 11.2).
//!
//! A filter with the process noise of a steady hand takes a beginner's tremor for measurement error: it rejects every
//! seventh position, bridges it, and is then off by several times the stated error. So a measurement that a steady
//! hand does not explain is accepted with as much more process noise as explains it, up to what hands can do. If that
//! happens repeatedly, predictions without a measurement use more process noise too.

use super::kalman::KalmanState;
use super::smoother::MeasuredPosition;
use crate::numbers::distribution::normal_cdf;

/// Factors on the usual acceleration density, from a steady hand to the liveliest.
const LEVELS: [f64; 4] = [1.0, 4.0, 16.0, 64.0];

/// Time constant of the mean level, s.
const MEMORY_S: f64 = 1.0;

/// Squared Mahalanobis distances of a measurement from a prediction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gate {
    /// Up to this one a measurement is accepted.
    pub accepted: f64,
    /// Up to this one the prediction explains it: 95 % of good measurements.
    explained: f64,
}

impl Gate {
    /// For a measured position, with three degrees of freedom.
    pub fn of_position(accepted: f64) -> Self {
        Self { accepted, explained: 7.8 }
    }

    /// For the line of an axis, with two: its distance from the prediction has no part along it. It accepts the same
    /// share of good measurements as the gate for a position.
    pub fn of_line(accepted_position: f64) -> Self {
        let root = accepted_position.sqrt();
        let density = (-0.5 * accepted_position).exp() / std::f64::consts::TAU.sqrt();
        let beyond = 2.0 * (normal_cdf(-root) + root * density);
        Self { accepted: -2.0 * beyond.ln(), explained: 6.0 }
    }
}

/// How lively a hand was recently.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdaptiveNoise {
    /// Mean factor on the acceleration density; 1 for a steady hand.
    level: f64,
}

impl Default for AdaptiveNoise {
    fn default() -> Self {
        Self { level: LEVELS[0] }
    }
}

/// A predicted state.
#[derive(Clone, Copy, Debug)]
pub struct PredictionStep {
    /// The state.
    pub state: KalmanState,
    /// The acceleration density used, mm²/s³.
    pub noise_density: f64,
    level: f64,
}

/// A step to be predicted.
#[derive(Clone, Copy, Debug)]
pub struct TimeStep {
    /// Its duration, s.
    pub dt_s: f64,
    /// The acceleration density of a steady hand, mm²/s³.
    pub usual_density: f64,
}

impl AdaptiveNoise {
    /// Predicts the state at the end of a step, with the recent mean level.
    pub fn predict(&self, state: &KalmanState, step: TimeStep) -> PredictionStep {
        self.at_level(state, step, self.level)
    }

    /// Predicts the state at a measurement, with the lowest level that explains the measurement; `None` if the
    /// measurement is outside the gate at every level.
    pub fn predict_towards(
        &self,
        state: &KalmanState,
        step: TimeStep,
        (tip, covariance): &MeasuredPosition,
        gate: Gate,
    ) -> Option<PredictionStep> {
        let mut liveliest = None;
        for level in LEVELS {
            let predicted = self.at_level(state, step, level);
            let squared = predicted.state.distance_squared(*tip, *covariance);
            liveliest = Some(predicted).filter(|_| squared <= gate.accepted);
            if squared <= gate.explained {
                break;
            }
        }
        liveliest
    }

    /// Updates the mean level with a step to a measured position.
    pub fn learn(&mut self, step: &PredictionStep, dt_s: f64) {
        self.level += (step.level - self.level) * -(-dt_s / MEMORY_S).exp_m1();
    }

    /// Updates the mean level with a step to the line of an axis. The motion along it is unseen, so it can show a
    /// livelier hand, but no steadier one.
    pub fn learn_from_line(&mut self, step: &PredictionStep, dt_s: f64) {
        if step.level > self.level {
            self.learn(step, dt_s);
        }
    }

    fn at_level(&self, state: &KalmanState, step: TimeStep, level: f64) -> PredictionStep {
        let noise_density = step.usual_density * level.max(self.level);
        PredictionStep { state: state.predicted(step.dt_s, noise_density), noise_density, level }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point3};

    use crate::random::Dice;
    use crate::vision::filter::smoother::{FilterRun, MeasuredPosition};
    use crate::vision::filter::track::Track;
    use crate::vision::filter::track::testing::SETTINGS;

    const FRAME_S: f64 = 0.04;
    const FRAMES: u32 = 400;
    const SIGMA_MM: f64 = 0.15;

    /// Position at a frame of a hand that trembles by this much, mm (RMS).
    fn place(tremor_mm: f64, frame: u32) -> Point3<f64> {
        let time_s = f64::from(frame) * FRAME_S;
        let wave = |hertz: f64| (std::f64::consts::TAU * hertz * time_s).sin() * tremor_mm;
        Point3::new(20.0 * time_s + wave(7.3) + wave(9.1), 8.0 * (2.0 * time_s).sin(), 150.0 + wave(6.2))
    }

    fn measured(tremor_mm: f64, frame: u32, dice: &mut Dice) -> MeasuredPosition {
        (place(tremor_mm, frame) + dice.gauss3() * SIGMA_MM, Matrix3::identity() * (SIGMA_MM * SIGMA_MM))
    }

    /// Share of the accepted measurements of such a hand, and the smoothed path's mean squared error relative to its
    /// stated variance, per coordinate.
    fn followed(tremor_mm: f64) -> (f64, f64) {
        let (mut track, mut run, mut dice) = (Track::default(), FilterRun::default(), Dice::new(9, "a hand"));
        let mut believed = 0;
        for frame in 0..FRAMES {
            let (time_s, at) = (f64::from(frame) * FRAME_S, measured(tremor_mm, frame, &mut dice));
            let advance = track.advance(time_s, Some(at), &SETTINGS);
            believed += u32::from(advance.observed);
            run.push(time_s, &advance.state.unwrap(), advance.noise_density, advance.observed.then_some(at));
        }
        let squared = (0..FRAMES).rev().zip(run.smoothed()).map(|(frame, state)| {
            let miss = state.tip() - place(tremor_mm, frame);
            miss.dot(&state.tip_covariance().cholesky().unwrap().solve(&miss)) / 3.0
        });
        (f64::from(believed) / f64::from(FRAMES), squared.sum::<f64>() / f64::from(FRAMES))
    }

    #[test]
    fn a_tremor_is_followed_and_errs_by_what_is_stated() {
        for tremor_mm in [0.0, 0.3, 0.6, 1.0] {
            let (believed, squared) = followed(tremor_mm);
            assert!(believed > 0.99 && squared < 2.0, "{tremor_mm} mm: {believed} believed, {squared}");
        }
    }

    #[test]
    fn a_wild_measurement_is_refused_however_much_the_hand_trembles() {
        for tremor_mm in [0.0, 0.6] {
            let (mut track, mut dice) = (Track::default(), Dice::new(3, "a hand"));
            for frame in 0..FRAMES {
                let (mut at, is_wild) = (measured(tremor_mm, frame, &mut dice), frame % 50 == 49);
                at.0.x += if is_wild { 40.0 } else { 0.0 };
                let advance = track.advance(f64::from(frame) * FRAME_S, Some(at), &SETTINGS);
                assert!(!(is_wild && advance.observed), "{tremor_mm} mm, frame {frame}");
            }
        }
    }

    /// Position of a hand that moves to and fro at up to 190 mm/s.
    fn swinging(frame: u32) -> Point3<f64> {
        let time_s = f64::from(frame) * FRAME_S;
        let swing = |hertz: f64, mm: f64| (std::f64::consts::TAU * hertz * time_s).sin() * mm;
        Point3::new(swing(0.8, 35.0), swing(0.6, 20.0), 150.0 + swing(0.4, 15.0))
    }

    #[test]
    fn a_hand_that_is_lost_while_it_moves_fast_is_where_it_is_stated() {
        const GAP: std::ops::Range<u32> = 14..18;
        let (mut track, mut run, mut dice) = (Track::default(), FilterRun::default(), Dice::new(5, "a hand"));
        let is_lost = |frame: u32| GAP.contains(&(frame % 23));
        for frame in 0..FRAMES {
            let (time_s, error) = (f64::from(frame) * FRAME_S, dice.gauss3() * SIGMA_MM);
            let covariance = Matrix3::identity() * (SIGMA_MM * SIGMA_MM);
            let seen = Some((swinging(frame) + error, covariance)).filter(|_| !is_lost(frame));
            let advance = track.advance(time_s, seen, &SETTINGS);
            assert_eq!(advance.observed, seen.is_some(), "frame {frame}");
            run.push(time_s, &advance.state.unwrap(), advance.noise_density, seen);
        }
        let smoothed: Vec<_> = run.smoothed().collect::<Vec<_>>().into_iter().rev().collect();
        for (name, states) in [("causal", run.filtered().collect()), ("smoothed", smoothed)] {
            let lost = (0..FRAMES).zip(&states).filter(|(frame, _)| is_lost(*frame));
            let squared = |(frame, state): (u32, &_)| -> f64 {
                let state: &super::KalmanState = state;
                state.distance_squared(swinging(frame), Matrix3::zeros())
            };
            let squared: Vec<f64> = lost.map(squared).collect();
            let inside = squared.iter().filter(|squared| **squared < 7.8).count() as f64 / squared.len() as f64;
            assert!(inside > 0.92, "{name}: {inside} of {} bridged positions lie in their 95 % region", squared.len());
        }
    }

    #[test]
    fn a_line_is_accepted_as_often_as_a_position() {
        // 99.9 % with three and with two degrees of freedom, and 95 %.
        for (position, line) in [(16.266, 13.816), (7.815, 5.991)] {
            assert!((super::Gate::of_line(position).accepted - line).abs() < 2e-3, "{position}");
        }
    }
}
