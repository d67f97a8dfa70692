//! Kalman filter of a tip's position and velocity. The gain contains the inverse that is missing in print in T 4.31.

use nalgebra::{Matrix3, Matrix3x6, Matrix6, Point3, Vector3, Vector6};

use super::motion_model;

/// Estimate of a tip's position and velocity at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KalmanState {
    /// `[x ẋ y ẏ z ż]`, mm and mm/s.
    pub mean: Vector6<f64>,
    /// Its covariance.
    pub covariance: Matrix6<f64>,
}

impl KalmanState {
    /// State of a tip just seen, with unknown velocity.
    pub fn first_seen(tip: Point3<f64>, covariance: Matrix3<f64>, speed_mm_s: f64) -> Self {
        let mut mean = Vector6::zeros();
        let mut spread = Matrix6::zeros();
        for i in 0..3 {
            mean[2 * i] = tip[i];
            spread[(2 * i + 1, 2 * i + 1)] = speed_mm_s * speed_mm_s;
            for j in 0..3 {
                spread[(2 * i, 2 * j)] = covariance[(i, j)];
            }
        }
        Self { mean, covariance: spread }
    }

    /// Position, mm.
    pub fn tip(&self) -> Point3<f64> {
        Point3::new(self.mean[0], self.mean[2], self.mean[4])
    }

    /// Velocity, mm/s.
    pub fn velocity(&self) -> Vector3<f64> {
        Vector3::new(self.mean[1], self.mean[3], self.mean[5])
    }

    /// Covariance of the position, mm².
    pub fn tip_covariance(&self) -> Matrix3<f64> {
        let see = observation_matrix();
        see * self.covariance * see.transpose()
    }

    /// The state `dt_s` seconds later, under acceleration noise of density `q`, mm²/s³.
    pub fn predicted(&self, dt_s: f64, q: f64) -> Self {
        let step = motion_model::transition(dt_s);
        Self {
            mean: step * self.mean,
            covariance: step * self.covariance * step.transpose() + motion_model::process_noise(dt_s, q),
        }
    }

    /// Squared Mahalanobis distance of a measured position; three degrees of freedom.
    pub fn distance_squared(&self, tip: Point3<f64>, covariance: Matrix3<f64>) -> f64 {
        let miss = tip - self.tip();
        (self.tip_covariance() + covariance).cholesky().map_or(f64::INFINITY, |c| miss.dot(&c.solve(&miss)))
    }

    /// The state after a measurement; unchanged if the measurement's covariance is not positive definite.
    pub fn updated(&self, tip: Point3<f64>, covariance: Matrix3<f64>) -> Self {
        let see = observation_matrix();
        let Some(innovation) = (see * self.covariance * see.transpose() + covariance).cholesky() else { return *self };
        let gain = (innovation.solve(&(see * self.covariance))).transpose();
        let left = Matrix6::identity() - gain * see;
        // Joseph's form stays symmetric and positive over an hour of frames; (I − K H) P does not.
        let spread = left * self.covariance * left.transpose() + gain * covariance * gain.transpose();
        Self { mean: self.mean + gain * (tip - self.tip()), covariance: (spread + spread.transpose()) * 0.5 }
    }
}

fn observation_matrix() -> Matrix3x6<f64> {
    let mut see = Matrix3x6::zeros();
    for i in 0..3 {
        see[(i, 2 * i)] = 1.0;
    }
    see
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moving() -> KalmanState {
        let mut state = KalmanState::first_seen(Point3::new(1.0, 2.0, 150.0), Matrix3::identity() * 0.2, 30.0);
        state.mean[1] = 12.0;
        state.mean[5] = -7.0;
        state
    }

    #[test]
    fn many_predictions_without_an_observation_are_one_of_the_whole_time() {
        let mut stepped = moving();
        for _ in 0..25 {
            stepped = stepped.predicted(0.04, 50.0);
        }
        let once = moving().predicted(1.0, 50.0);
        assert!((stepped.mean - once.mean).norm() < 1e-9);
        assert!((stepped.covariance - once.covariance).norm() < 1e-9 * once.covariance.norm());
    }

    #[test]
    fn a_perfect_measurement_is_believed_and_a_useless_one_ignored() {
        let seen = Point3::new(5.0, 5.0, 155.0);
        assert!((moving().updated(seen, Matrix3::identity() * 1e-9).tip() - seen).norm() < 1e-6);
        assert!((moving().updated(seen, Matrix3::identity() * 1e12).tip() - moving().tip()).norm() < 1e-6);
    }

    #[test]
    fn a_measurement_never_makes_less_sure() {
        let before = moving();
        let after = before.updated(Point3::new(0.0, 0.0, 140.0), Matrix3::identity() * 3.0);
        assert!((before.covariance - after.covariance).symmetric_eigenvalues().min() > -1e-9);
    }
}
