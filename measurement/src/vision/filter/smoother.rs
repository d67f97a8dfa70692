//! Rauch–Tung–Striebel smoother: the estimate for each instant from the whole recording, without the filter's lag.
//!
//! A run may last for an hour, and a state takes 336 bytes. So a run keeps the measurements, and the filter's state
//! only at every [`BLOCK`]th instant. The states in between are recomputed block by block when the smoother needs
//! them, with the same operations and so the same to the last bit.

use nalgebra::{Matrix3, Point3};

use super::kalman::KalmanState;
use super::motion_model;

/// Instants between two kept states: a run of an hour then keeps as many states as a block has instants.
const BLOCK: usize = 300;

/// A measured position, mm, and its covariance, mm² (exactly symmetric).
pub type MeasuredPosition = (Point3<f64>, Matrix3<f64>);

/// One unbroken run of the filter.
#[derive(Clone, Debug, Default)]
pub struct FilterRun {
    blocks: Vec<Block>,
}

#[derive(Clone, Debug)]
struct Block {
    /// The filter's state at the first instant.
    first: KalmanState,
    instants: Vec<RunInstant>,
}

#[derive(Clone, Copy, Debug)]
struct RunInstant {
    time_s: f64,
    /// Density of the acceleration since the instant before, mm²/s³.
    noise_density: f64,
    measurement: Option<PackedPosition>,
}

/// A [`MeasuredPosition`] with one half of the covariance left out.
#[derive(Clone, Copy, Debug)]
struct PackedPosition {
    tip: Point3<f64>,
    /// Row by row up to the diagonal.
    covariance: [f64; 6],
}

impl From<MeasuredPosition> for PackedPosition {
    fn from((tip, c): MeasuredPosition) -> Self {
        Self { tip, covariance: [c[(0, 0)], c[(1, 0)], c[(1, 1)], c[(2, 0)], c[(2, 1)], c[(2, 2)]] }
    }
}

impl From<PackedPosition> for MeasuredPosition {
    fn from(PackedPosition { tip, covariance: [xx, yx, yy, zx, zy, zz] }: PackedPosition) -> Self {
        (tip, Matrix3::new(xx, yx, zx, yx, yy, zy, zx, zy, zz))
    }
}

impl FilterRun {
    /// Adds the next instant: the filter's state, the acceleration density that it used since the previous instant,
    /// mm²/s³, and the accepted measurement, if any.
    pub fn push(&mut self, time_s: f64, state: &KalmanState, noise_density: f64, believed: Option<MeasuredPosition>) {
        let instant = RunInstant { time_s, noise_density, measurement: believed.map(PackedPosition::from) };
        match self.blocks.last_mut().filter(|block| block.instants.len() < BLOCK) {
            Some(block) => block.instants.push(instant),
            None => self.blocks.push(Block { first: *state, instants: vec![instant] }),
        }
    }

    /// The accepted measurements; `None` for an instant without one.
    pub fn measurements(&self) -> impl Iterator<Item = Option<MeasuredPosition>> {
        self.blocks
            .iter()
            .flat_map(|block| &block.instants)
            .map(|instant| instant.measurement.map(MeasuredPosition::from))
    }

    /// The filter's state at each instant.
    pub fn filtered(&self) -> impl Iterator<Item = KalmanState> {
        self.blocks.iter().flat_map(Block::filtered)
    }

    /// The smoothed state at each instant, from the last to the first.
    pub fn smoothed(&self) -> impl Iterator<Item = KalmanState> {
        let states = |block: &'_ Block| {
            let times = block.instants.iter().map(|instant| (instant.time_s, instant.noise_density));
            times.zip(block.filtered()).collect::<Vec<_>>().into_iter().rev()
        };
        let mut later: Option<(f64, f64, KalmanState)> = None;
        self.blocks.iter().rev().flat_map(states).map(move |((time_s, density_before), own)| {
            let smoothed = later
                .map_or(own, |(later_s, density, later)| smooth_backwards(&own, later_s - time_s, &later, density));
            later = Some((time_s, density_before, smoothed));
            smoothed
        })
    }
}

impl Block {
    /// The filter's states, recomputed.
    fn filtered(&self) -> Vec<KalmanState> {
        let mut states = vec![self.first];
        for pair in self.instants.windows(2) {
            let predicted = states[states.len() - 1].predicted(pair[1].time_s - pair[0].time_s, pair[1].noise_density);
            let believed = pair[1].measurement.map(MeasuredPosition::from);
            states.push(believed.map_or(predicted, |(tip, covariance)| predicted.updated(tip, covariance)));
        }
        states
    }
}

/// Smooths a state with the smoothed state `dt_s` seconds later.
fn smooth_backwards(own: &KalmanState, dt_s: f64, later: &KalmanState, noise_density: f64) -> KalmanState {
    let (step, ahead) = (motion_model::transition(dt_s), own.predicted(dt_s, noise_density));
    let Some(factor) = ahead.covariance.cholesky() else { return *own };
    let gain = factor.solve(&(step * own.covariance)).transpose();
    let covariance = own.covariance + gain * (later.covariance - ahead.covariance) * gain.transpose();
    KalmanState {
        mean: own.mean + gain * (later.mean - ahead.mean),
        covariance: (covariance + covariance.transpose()) * 0.5,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOISE_DENSITY: f64 = 800.0;

    /// A run of several blocks, and the filter's own states.
    fn run() -> (FilterRun, Vec<KalmanState>) {
        let spread = Matrix3::from_diagonal_element(0.3);
        let at = |t: f64| Point3::new(20.0 * t, (3.0 * t).sin() * 8.0, 150.0 + 0.4 * (40.0 * t).sin());
        let mut run = FilterRun::default();
        let (mut last_s, mut states) = (0.0, vec![KalmanState::first_seen(at(0.0), spread, 50.0)]);
        run.push(0.0, &states[0], 0.0, Some((at(0.0), spread)));
        for k in 1..2 * BLOCK as u32 + 40 {
            let time_s = f64::from(k) * 0.04 + 0.01 * f64::from(k % 3);
            let density = NOISE_DENSITY * f64::from(1 + k % 3);
            let predicted = states[states.len() - 1].predicted(time_s - last_s, density);
            let believed = (k % 7 != 0).then_some((at(time_s), spread));
            let state = believed.map_or(predicted, |(tip, covariance)| predicted.updated(tip, covariance));
            run.push(time_s, &state, density, believed);
            (last_s, states) = (time_s, [states, vec![state]].concat());
        }
        (run, states)
    }

    #[test]
    fn the_filters_states_come_again_to_the_last_bit() {
        let (run, states) = run();
        assert!(run.filtered().eq(states));
    }

    #[test]
    fn hindsight_never_makes_less_sure() {
        let (run, states) = run();
        for (filtered, smoothed) in states.iter().rev().zip(run.smoothed()) {
            let gained = (filtered.covariance - smoothed.covariance).symmetric_eigenvalues().min();
            assert!(gained > -1e-6, "covariance grew by {gained}");
        }
    }

    #[test]
    fn the_last_instant_has_no_future_to_learn_from() {
        let (run, states) = run();
        assert_eq!(run.smoothed().next(), states.last().copied());
        assert_eq!(FilterRun::default().smoothed().count(), 0);
    }
}
