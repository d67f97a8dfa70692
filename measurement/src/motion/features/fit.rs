//! A local polynomial through uneven samples: Savitzky and Golay's filter without their even spacing.
//!
//! Around an instant, a cubic is fitted by weighted least squares to the samples near it. Its value and derivatives at
//! that instant are the estimate (Savitzky & Golay 1964; weights after Cleveland 1979). The fit uses the real time
//! stamps, so a dropped frame or a variable frame rate shifts nothing. Tricube weights let samples fade in and out of
//! the window: with equal weights the estimate would jump at every sample, and the jerk would show the jumps.

use nalgebra::{Matrix3x4, Matrix4, Vector3, Vector4};

/// Minimum number of samples in a fit: a cubic has four coefficients, and the outermost sample has no weight.
pub const MIN_SAMPLES: usize = 6;

/// The window is widened to this many nearest samples where samples are sparse.
pub const NEIGHBOURS: usize = 7;

/// A vector over time, known at uneven instants.
#[derive(Clone, Copy, Debug)]
pub struct VectorSeries<'a> {
    /// Times, s, ascending.
    pub times_s: &'a [f64],
    /// Values, one per time.
    pub values: &'a [Vector3<f64>],
}

/// The fitted vector at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalFit {
    /// The vector itself.
    pub value: Vector3<f64>,
    /// Its first derivative, per s.
    pub first: Vector3<f64>,
    /// Its second derivative, per s².
    pub second: Vector3<f64>,
}

impl VectorSeries<'_> {
    /// Fits around `at_s`. The half window is `half_window_s`, or the distance of the seventh nearest sample if that is
    /// larger. `None` with fewer than [`MIN_SAMPLES`] samples or if they coincide.
    pub fn fit(&self, at_s: f64, half_window_s: f64) -> Option<LocalFit> {
        let nearest = self.nearest(at_s);
        let farthest = nearest.clone().map(|i| (self.times_s[i] - at_s).abs()).fold(0.0, f64::max);
        let half = half_window_s.max(farthest);
        let first = self.times_s.partition_point(|t| *t <= at_s - half);
        let end = self.times_s.partition_point(|t| *t < at_s + half);
        let (first, end) = (first.min(nearest.start), end.max(nearest.end));
        if end - first < MIN_SAMPLES {
            return None;
        }
        let (mut normal, mut right) = (Matrix4::zeros(), Matrix3x4::zeros());
        for (t, value) in self.times_s[first..end].iter().zip(&self.values[first..end]) {
            let u = (t - at_s) / half; // in −1..1, so that the powers stay comparable
            let powers = Vector4::new(1.0, u, u * u, u * u * u);
            let weight = tricube(u);
            normal += weight * powers * powers.transpose();
            right += weight * value * powers.transpose();
        }
        let coefficients = normal.cholesky()?.solve(&right.transpose()).transpose();
        Some(LocalFit {
            value: coefficients.column(0).into_owned(),
            first: coefficients.column(1) / half,
            second: coefficients.column(2) * (2.0 / (half * half)),
        })
    }

    /// Indices of the samples nearest to an instant.
    fn nearest(&self, at_s: f64) -> std::ops::Range<usize> {
        let mut range = self.times_s.partition_point(|t| *t < at_s)..0;
        range.end = range.start;
        while range.len() < NEIGHBOURS {
            let before = range.start.checked_sub(1).map(|i| at_s - self.times_s[i]);
            let after = self.times_s.get(range.end).map(|t| t - at_s);
            match (before, after) {
                (Some(before), Some(after)) if before < after => range.start -= 1,
                (Some(_), None) => range.start -= 1,
                (_, Some(_)) => range.end += 1,
                (None, None) => break,
            }
        }
        range
    }
}

fn tricube(u: f64) -> f64 {
    let rest = 1.0 - u.abs().powi(3);
    if rest > 0.0 { rest.powi(3) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn too_few_samples_give_nothing() {
        let times: Vec<f64> = (0..5).map(f64::from).collect();
        let values = vec![Vector3::zeros(); 5];
        assert_eq!(VectorSeries { times_s: &times, values: &values }.fit(2.0, 10.0), None);
    }

    proptest! {
        #[test]
        fn a_cubic_is_reproduced_at_uneven_times(
            steps in prop::collection::vec(0.01f64..0.07, 8..30),
            c in prop::array::uniform4(-5.0f64..5.0),
            share in 0.0f64..1.0,
        ) {
            let times: Vec<f64> = steps.iter().scan(0.0, |t, dt| { *t += dt; Some(*t) }).collect();
            let at = share * times[times.len() - 1];
            let curve = |t: f64| c[0] + c[1] * t + c[2] * t * t + c[3] * t * t * t;
            let values: Vec<_> = times.iter().map(|t| Vector3::new(curve(*t), -curve(*t), 2.0)).collect();
            let got = VectorSeries { times_s: &times, values: &values }.fit(at, 0.15).unwrap();
            prop_assert!((got.value.x - curve(at)).abs() < 1e-6);
            prop_assert!((got.first.x - (c[1] + 2.0 * c[2] * at + 3.0 * c[3] * at * at)).abs() < 1e-4);
            prop_assert!((got.second.y + 2.0 * c[2] + 6.0 * c[3] * at).abs() < 1e-2);
            prop_assert!((got.value.z - 2.0).abs() < 1e-9);
        }
    }
}
