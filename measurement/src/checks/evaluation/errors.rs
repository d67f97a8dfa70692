//! Sizes of a set of errors: across the line of sight, along it, and in space.

use nalgebra::Vector3;

use crate::numbers::quantile::interpolated_quantile;

/// Errors of a set of rows, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorSummary {
    /// Number of rows.
    pub rows: usize,
    /// Errors in x and y together.
    pub lateral: ErrorSpread,
    /// Errors in z.
    pub depth: ErrorSpread,
    /// Errors in all three axes.
    pub three_d: ErrorSpread,
    /// Mean of the signed error per axis; positive z means measured too far from the camera.
    pub bias_mm: Vector3<f64>,
    /// Standard deviation of the signed error per axis; a better calibration could not remove it.
    pub deviation_mm: Vector3<f64>,
}

/// The size of an error, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorSpread {
    /// Root of the mean square.
    pub rms: f64,
    /// Median.
    pub median: f64,
    /// Exceeded by 5 %.
    pub p95: f64,
    /// Largest.
    pub max: f64,
}

impl ErrorSummary {
    /// Summarises signed errors, mm; `None` if there are none.
    pub(super) fn of(errors: &[Vector3<f64>]) -> Option<ErrorSummary> {
        let mean = |of: &dyn Fn(&Vector3<f64>) -> Vector3<f64>| {
            errors.iter().map(of).sum::<Vector3<f64>>() / errors.len() as f64
        };
        let bias_mm = mean(&|e| *e);
        Some(ErrorSummary {
            rows: errors.len(),
            lateral: ErrorSpread::of(errors.iter().map(|e| e.xy().norm()).collect())?,
            depth: ErrorSpread::of(errors.iter().map(|e| e.z.abs()).collect())?,
            three_d: ErrorSpread::of(errors.iter().map(Vector3::norm).collect())?,
            bias_mm,
            deviation_mm: mean(&|e| (e - bias_mm).component_mul(&(e - bias_mm))).map(f64::sqrt),
        })
    }
}

impl ErrorSpread {
    /// Summarises sizes, all at least zero; `None` if there are none.
    pub(super) fn of(mut sizes: Vec<f64>) -> Option<ErrorSpread> {
        sizes.sort_by(f64::total_cmp);
        let mean_square = sizes.iter().map(|s| s * s).sum::<f64>() / sizes.len() as f64;
        let (median, p95) = (interpolated_quantile(&sizes, 0.5)?, interpolated_quantile(&sizes, 0.95)?);
        Some(ErrorSpread { rms: mean_square.sqrt(), median, p95, max: *sizes.last()? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_figures_of_the_numbers_to_a_hundred_are_theirs() {
        let spread = ErrorSpread::of((0..=100).rev().map(f64::from).collect()).unwrap();
        assert_eq!((spread.median, spread.p95, spread.max), (50.0, 95.0, 100.0));
        assert!((spread.rms - 3350.0_f64.sqrt()).abs() < 1e-9); // n (2n + 1) / 6 for n = 100
        assert_eq!(ErrorSpread::of(Vec::new()), None);
    }

    #[test]
    fn errors_to_both_sides_have_a_size_but_no_bias() {
        let to_both_sides: Vec<_> = (0..10).map(|i| Vector3::z() * if i % 2 == 0 { 2.0 } else { -2.0 }).collect();
        let errors = ErrorSummary::of(&to_both_sides).unwrap();
        assert_eq!((errors.depth.rms, errors.lateral.rms, errors.bias_mm.z), (2.0, 0.0, 0.0));
        assert_eq!(errors.deviation_mm, Vector3::new(0.0, 0.0, 2.0));
    }
}
