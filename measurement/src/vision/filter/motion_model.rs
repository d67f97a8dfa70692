//! Motion model between frames: constant velocity, disturbed by white acceleration (T 4.25, 4.27).
//!
//! The state is `[x ẋ y ẏ z ż]`, mm and mm/s. The noise is that of *continuous* white acceleration of spectral density
//! `q` (mm²/s³), so that two steps of Δt equal one of 2Δt exactly, and uneven or missing frames cause no
//! inconsistency. The piecewise constant acceleration of T 4.27 does not have that property.

use nalgebra::{Matrix6, SMatrix};

/// Transition matrix over `dt_s` seconds.
pub fn transition(dt_s: f64) -> Matrix6<f64> {
    let mut matrix = Matrix6::identity();
    for axis in 0..3 {
        matrix[(2 * axis, 2 * axis + 1)] = dt_s;
    }
    matrix
}

/// Covariance that white acceleration of density `q` (mm²/s³) adds over `dt_s` seconds.
pub fn process_noise(dt_s: f64, q: f64) -> Matrix6<f64> {
    let mut matrix = Matrix6::zeros();
    let block = SMatrix::<f64, 2, 2>::new(dt_s.powi(3) / 3.0, dt_s.powi(2) / 2.0, dt_s.powi(2) / 2.0, dt_s) * q;
    for axis in 0..3 {
        matrix.fixed_view_mut::<2, 2>(2 * axis, 2 * axis).copy_from(&block);
    }
    matrix
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_steps_are_one_of_the_whole_time() {
        let (first, second, q) = (0.03, 0.05, 40.0);
        let whole = transition(second) * transition(first);
        assert!((whole - transition(first + second)).norm() < 1e-12);
        let carried =
            transition(second) * process_noise(first, q) * transition(second).transpose() + process_noise(second, q);
        assert!((carried - process_noise(first + second, q)).norm() < 1e-12);
    }
}
