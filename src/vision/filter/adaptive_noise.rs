//! Process noise that adapts to how lively a hand is (Bar-Shalom, Li & Kirubarajan 2001, section 11.2).
//!
//! A filter with the process noise of a steady hand takes a beginner's tremor for measurement error: it rejects every
//! seventh position, bridges it, and is then off by several times the stated error. So a measurement that a steady
//! hand does not explain is accepted with as much more process noise as explains it, up to what hands can do. If that
//! happens repeatedly, predictions without a measurement use more process noise too.

use super::kalman::KalmanState;
use super::smoother::MeasuredPosition;

/// Factors on the usual acceleration density, from a steady hand to the liveliest.
const LEVELS: [f64; 4] = [1.0, 4.0, 16.0, 64.0];

/// A measurement within this squared Mahalanobis distance of a prediction is explained by it: three degrees of
/// freedom, 95 %.
const EXPLAINED_SQUARED: f64 = 7.8;

/// Time constant of the mean level, s.
const MEMORY_S: f64 = 1.0;

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

impl AdaptiveNoise {
    /// Predicts the state `dt_s` later, with the recent mean level.
    pub fn predict(&self, state: &KalmanState, dt_s: f64, usual_density: f64) -> PredictionStep {
        self.at_level(state, dt_s, usual_density, self.level)
    }

    /// Predicts the state at a measurement, with the lowest level that explains the measurement; `None` if the
    /// measurement is outside the gate at every level.
    pub fn predict_towards(
        &self,
        state: &KalmanState,
        dt_s: f64,
        usual_density: f64,
        (tip, covariance): &MeasuredPosition,
        gate: f64,
    ) -> Option<PredictionStep> {
        let mut liveliest = None;
        for level in LEVELS {
            let step = self.at_level(state, dt_s, usual_density, level);
            let squared = step.state.distance_squared(*tip, *covariance);
            liveliest = Some(step).filter(|_| squared <= gate);
            if squared <= EXPLAINED_SQUARED {
                break;
            }
        }
        liveliest
    }

    /// Updates the mean level with a step to a measurement.
    pub fn learn(&mut self, step: &PredictionStep, dt_s: f64) {
        self.level += (step.level - self.level) * -(-dt_s / MEMORY_S).exp_m1();
    }

    fn at_level(&self, state: &KalmanState, dt_s: f64, usual_density: f64, level: f64) -> PredictionStep {
        let noise_density = usual_density * level.max(self.level);
        PredictionStep { state: state.predicted(dt_s, noise_density), noise_density, level }
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
}
