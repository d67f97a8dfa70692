//! Kalman filter of two coordinates in the picture and their velocities: `[u v u̇ v̇]` of a region, or `[ρ θ ρ̇ θ̇]` of
//! a line.
//!
//! The noises of the two coordinates are independent, so that the filter is two filters of one coordinate each.

use nalgebra::{Matrix2, Vector2};

/// Two coordinates. Their units are those of the filter's settings.
pub(super) type CoordinatePair = [f64; 2];

/// Noises of both coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct PairNoise {
    /// Density of the white acceleration, unit²/s³.
    pub(super) acceleration_density: CoordinatePair,
    /// Standard deviation of a measured coordinate.
    pub(super) sigma: CoordinatePair,
    /// Standard deviation of the first velocity, unit/s.
    pub(super) first_speed: CoordinatePair,
}

/// Estimate of both coordinates and their velocities.
#[derive(Clone, Copy, Debug)]
pub(super) struct PairState([CoordinateState; 2]);

/// Estimate of `[x ẋ]`.
#[derive(Clone, Copy, Debug)]
struct CoordinateState {
    mean: Vector2<f64>,
    covariance: Matrix2<f64>,
}

impl PairState {
    /// State of a pair just seen, with unknown velocity.
    pub(super) fn first_seen(seen: CoordinatePair, noise: &PairNoise) -> Self {
        Self([0, 1].map(|i| CoordinateState {
            mean: Vector2::new(seen[i], 0.0),
            covariance: Matrix2::new(noise.sigma[i].powi(2), 0.0, 0.0, noise.first_speed[i].powi(2)),
        }))
    }

    /// The coordinates.
    pub(super) fn pair(&self) -> CoordinatePair {
        self.0.map(|of| of.mean.x)
    }

    /// The state `dt_s` seconds later.
    pub(super) fn predicted(&self, dt_s: f64, noise: &PairNoise) -> Self {
        let step = Matrix2::new(1.0, dt_s, 0.0, 1.0);
        let spread = Matrix2::new(dt_s.powi(3) / 3.0, dt_s.powi(2) / 2.0, dt_s.powi(2) / 2.0, dt_s);
        Self([0, 1].map(|i| CoordinateState {
            mean: step * self.0[i].mean,
            covariance: step * self.0[i].covariance * step.transpose() + spread * noise.acceleration_density[i],
        }))
    }

    /// Squared Mahalanobis distance of a measured pair; two degrees of freedom.
    pub(super) fn distance_squared(&self, seen: CoordinatePair, noise: &PairNoise) -> f64 {
        let of_one = |i: usize| {
            (seen[i] - self.0[i].mean.x).powi(2) / (self.0[i].covariance.m11 + noise.sigma[i] * noise.sigma[i])
        };
        of_one(0) + of_one(1)
    }

    /// The state after a measured pair.
    pub(super) fn updated(&self, seen: CoordinatePair, noise: &PairNoise) -> Self {
        Self([0, 1].map(|i| {
            let CoordinateState { mean, covariance } = self.0[i];
            let variance = covariance.m11 + noise.sigma[i] * noise.sigma[i];
            let gain = covariance.column(0) / variance;
            CoordinateState {
                mean: mean + gain * (seen[i] - mean.x),
                covariance: covariance - gain * gain.transpose() * variance,
            }
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOISE: PairNoise = PairNoise { acceleration_density: [1e-9; 2], sigma: [0.5; 2], first_speed: [100.0; 2] };

    #[test]
    fn two_steps_are_one_of_the_whole_time() {
        let noise = PairNoise { acceleration_density: [40.0, 3.0], ..NOISE };
        let start = PairState::first_seen([3.0, 4.0], &noise).predicted(0.1, &noise).updated([4.0, 3.0], &noise);
        let stepped = start.predicted(0.03, &noise).predicted(0.05, &noise);
        let once = start.predicted(0.08, &noise);
        for i in 0..2 {
            assert!((stepped.0[i].mean - once.0[i].mean).norm() < 1e-9);
            assert!((stepped.0[i].covariance - once.0[i].covariance).norm() < 1e-9 * once.0[i].covariance.norm());
        }
    }

    #[test]
    fn a_steady_motion_is_predicted_after_a_few_measurements() {
        let place = |time_s: f64| [20.0 + 30.0 * time_s, 5.0 - 8.0 * time_s];
        let mut state = PairState::first_seen(place(0.0), &NOISE);
        for frame in 1..10 {
            state = state.predicted(0.04, &NOISE).updated(place(f64::from(frame) * 0.04), &NOISE);
        }
        let ahead = state.predicted(0.2, &NOISE).pair();
        let expected = place(9.0 * 0.04 + 0.2);
        assert!((0..2).all(|i| (ahead[i] - expected[i]).abs() < 0.02), "{ahead:?} {expected:?}");
        assert!(state.predicted(0.2, &NOISE).distance_squared(expected, &NOISE) < 0.01);
    }
}
