//! How lively a hand is: process noise of an adjustable level (Bar-Shalom, Li & Kirubarajan 2001, section 11.2).
//!
//! A filter that reckons with a steady hand takes a beginner's tremor for errors of measuring: it refuses every seventh place,
//! bridges it, and errs there by several times what it states. So a step whose measurement a steady hand does not explain is taken
//! with as much more process noise as explains it, up to what hands can do; where that happens again and again, steps without a
//! measurement are reckoned with alike.

use super::kalman::State;
use super::smoother::Position;

/// By how many times the usual density of acceleration a step may be livelier.
const LEVELS: [f64; 4] = [1.0, 4.0, 16.0, 64.0];

/// A measurement within this squared Mahalanobis distance of a prediction is explained by it: three degrees of freedom, 95 %.
const EXPLAINED: f64 = 7.8;

/// For how long a hand is taken for as lively as it was, s.
const MEMORY_S: f64 = 1.0;

/// How lively a hand was lately.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Liveliness {
    /// Mean level, 1 for a steady hand.
    level: f64,
}

impl Default for Liveliness {
    fn default() -> Self {
        Self { level: LEVELS[0] }
    }
}

/// A state that was predicted.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// The state.
    pub state: State,
    /// The density of acceleration, mm²/s³, that was reckoned with.
    pub noise_density: f64,
    level: f64,
}

impl Liveliness {
    /// The state so much later, by a hand that is as lively as it was.
    pub fn ahead(&self, state: &State, dt_s: f64, usual_density: f64) -> Step {
        self.at_level(state, dt_s, usual_density, self.level)
    }

    /// The state when something was measured: by a hand as lively as explains that; `None` where no hand does within the gate.
    pub fn towards(
        &self,
        state: &State,
        dt_s: f64,
        usual_density: f64,
        (tip, covariance): &Position,
        gate: f64,
    ) -> Option<Step> {
        let mut liveliest = None;
        for level in LEVELS {
            let step = self.at_level(state, dt_s, usual_density, level);
            let squared = step.state.distance_squared(*tip, *covariance);
            liveliest = Some(step).filter(|_| squared <= gate);
            if squared <= EXPLAINED {
                break;
            }
        }
        liveliest
    }

    /// Takes a step as an instance of how lively the hand is.
    pub fn learn(&mut self, step: &Step, dt_s: f64) {
        self.level += (step.level - self.level) * -(-dt_s / MEMORY_S).exp_m1();
    }

    fn at_level(&self, state: &State, dt_s: f64, usual_density: f64, level: f64) -> Step {
        let noise_density = usual_density * level.max(self.level);
        Step { state: state.predicted(dt_s, noise_density), noise_density, level }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point3};

    use crate::pipeline::filter::identity::Thread;
    use crate::pipeline::filter::identity::testing::SETTINGS;
    use crate::pipeline::filter::smoother::{Position, Run};
    use crate::random::Dice;

    const FRAME_S: f64 = 0.04;
    const FRAMES: u32 = 400;
    const SIGMA_MM: f64 = 0.15;

    /// Where a hand is that trembles by so much, mm (RMS), at a frame.
    fn place(tremor_mm: f64, frame: u32) -> Point3<f64> {
        let time_s = f64::from(frame) * FRAME_S;
        let wave = |hertz: f64| (std::f64::consts::TAU * hertz * time_s).sin() * tremor_mm;
        Point3::new(20.0 * time_s + wave(7.3) + wave(9.1), 8.0 * (2.0 * time_s).sin(), 150.0 + wave(6.2))
    }

    fn measured(tremor_mm: f64, frame: u32, dice: &mut Dice) -> Position {
        (place(tremor_mm, frame) + dice.gauss3() * SIGMA_MM, Matrix3::identity() * (SIGMA_MM * SIGMA_MM))
    }

    /// Share of the measurements of such a hand that are believed, and the smoothed path's mean squared error in units of what is
    /// stated for it, per coordinate.
    fn followed(tremor_mm: f64) -> (f64, f64) {
        let (mut thread, mut run, mut dice) = (Thread::default(), Run::default(), Dice::new(9, "a hand"));
        let mut believed = 0;
        for frame in 0..FRAMES {
            let (time_s, at) = (f64::from(frame) * FRAME_S, measured(tremor_mm, frame, &mut dice));
            let advance = thread.advance(time_s, Some(at), &SETTINGS);
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
            let (mut thread, mut dice) = (Thread::default(), Dice::new(3, "a hand"));
            for frame in 0..FRAMES {
                let (mut at, is_wild) = (measured(tremor_mm, frame, &mut dice), frame % 50 == 49);
                at.0.x += if is_wild { 40.0 } else { 0.0 };
                let advance = thread.advance(f64::from(frame) * FRAME_S, Some(at), &SETTINGS);
                assert!(!(is_wild && advance.observed), "{tremor_mm} mm, frame {frame}");
            }
        }
    }
}
