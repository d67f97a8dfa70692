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
