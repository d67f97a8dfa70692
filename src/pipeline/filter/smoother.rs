//! Rauch–Tung–Striebel smoother: what the whole recording says of each instant, without the filter's lag.

use super::kalman::State;
use super::motion_model;

/// One instant of a filter's run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Time, s.
    pub time_s: f64,
    /// Before this instant's measurement.
    pub predicted: State,
    /// After it; the same where there was none.
    pub updated: State,
}

/// Smoothed states of one unbroken run, in time order.
pub fn smooth(run: &[Step]) -> Vec<State> {
    let mut smoothed: Vec<State> = run.iter().map(|s| s.updated).collect();
    for i in (0..run.len().saturating_sub(1)).rev() {
        let step = motion_model::transition(run[i + 1].time_s - run[i].time_s);
        let (own, ahead, later) = (run[i].updated, run[i + 1].predicted, smoothed[i + 1]);
        let Some(factor) = ahead.covariance.cholesky() else { continue };
        let gain = factor.solve(&(step * own.covariance)).transpose();
        let covariance = own.covariance + gain * (later.covariance - ahead.covariance) * gain.transpose();
        smoothed[i] = State {
            mean: own.mean + gain * (later.mean - ahead.mean),
            covariance: (covariance + covariance.transpose()) * 0.5,
        };
    }
    smoothed
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Point3};

    fn run() -> Vec<Step> {
        let spread = Matrix3::from_diagonal_element(0.3);
        let at = |t: f64| Point3::new(20.0 * t, (3.0 * t).sin() * 8.0, 150.0 + 0.4 * (40.0 * t).sin());
        let first = State::first_seen(at(0.0), spread, 50.0);
        let mut steps = vec![Step { time_s: 0.0, predicted: first, updated: first }];
        for k in 1..40 {
            let time_s = f64::from(k) * 0.04 + 0.01 * f64::from(k % 3);
            let last = steps[steps.len() - 1];
            let predicted = last.updated.predicted(time_s - last.time_s, 800.0);
            let updated = if k % 7 == 0 { predicted } else { predicted.updated(at(time_s), spread) };
            steps.push(Step { time_s, predicted, updated });
        }
        steps
    }

    #[test]
    fn hindsight_never_makes_less_sure() {
        let run = run();
        for (step, smoothed) in run.iter().zip(smooth(&run)) {
            let gained = (step.updated.covariance - smoothed.covariance).symmetric_eigenvalues().min();
            assert!(gained > -1e-6, "covariance grew by {gained}");
        }
    }

    #[test]
    fn the_last_instant_has_no_future_to_learn_from() {
        let run = run();
        assert_eq!(smooth(&run).last(), run.last().map(|s| &s.updated));
        assert!(smooth(&[]).is_empty());
    }
}
