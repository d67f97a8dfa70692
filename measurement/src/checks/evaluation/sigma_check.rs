//! Checks whether the errors are as large as the track's stated sigmas. An error bar that is too short is worse than
//! none.
//!
//! A row states the covariance of its position. If it is right, the squared Mahalanobis length of the error follows a
//! χ² distribution with as many degrees of freedom as axes: 95 % of the rows lie below [`CHI_SQUARE_95`], and the mean
//! per axis is 1 (Bar-Shalom, Li & Kirubarajan 2001, 5.4: normalised estimation error squared).

use nalgebra::Matrix2;

use super::judged::JudgedRow;
use crate::statistics::interval::wilson;

/// The 95 % quantiles of the χ² distribution for one, two and three degrees of freedom.
pub const CHI_SQUARE_95: [f64; 3] = [3.841_459, 5.991_465, 7.814_728];

/// A track's stated errors compared with its true errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SigmaCheck {
    /// Rows that state a covariance.
    pub rows: usize,
    /// The interval of z.
    pub depth: SigmaCoverage,
    /// The ellipse of x and y.
    pub lateral: SigmaCoverage,
    /// The ellipsoid of all three.
    pub three_d: SigmaCoverage,
}

/// One region that should hold 95 % of the errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SigmaCoverage {
    /// Share of the errors inside it, 0 to 1.
    pub inside: f64,
    /// 95 % confidence interval of the true share (Wilson's binomial interval) for independent rows. Neighbouring rows
    /// of a smoothed track are not independent, so the real interval is wider.
    pub interval: [f64; 2],
    /// Mean normalised squared error per axis: 1 means that the sigmas are right, 4 that errors are twice as large as
    /// stated.
    pub mean_square: f64,
}

impl SigmaCheck {
    /// Checks the rows that state a covariance; `None` if there are none.
    pub(super) fn of(rows: &[&JudgedRow]) -> Option<SigmaCheck> {
        let squares: Vec<[f64; 3]> = rows.iter().filter_map(|row| squares(row)).collect();
        let share = |axes: usize| SigmaCoverage::of(&squares.iter().map(|of| of[axes - 1]).collect::<Vec<_>>(), axes);
        Some(SigmaCheck { rows: squares.len(), depth: share(1)?, lateral: share(2)?, three_d: share(3)? })
    }
}

impl SigmaCoverage {
    fn of(squares: &[f64], axes: usize) -> Option<SigmaCoverage> {
        let n = squares.len() as f64;
        let inside = squares.iter().filter(|square| **square <= CHI_SQUARE_95[axes - 1]).count() as f64 / n;
        let interval = wilson(inside, squares.len()).ok()?;
        let interval = [interval.low, interval.high];
        Some(SigmaCoverage { inside, interval, mean_square: squares.iter().sum::<f64>() / n / axes as f64 })
    }
}

/// Squared Mahalanobis length of a row's error; `None` if it states no covariance.
pub fn normalised_square(row: &JudgedRow) -> Option<f64> {
    Some(row.sample.covariance_mm2?.mahalanobis_squared(&row.error_mm))
}

/// Squared Mahalanobis length of the error in depth, of that in x and y, and of the whole error.
fn squares(row: &JudgedRow) -> Option<[f64; 3]> {
    let stated = row.sample.covariance_mm2?;
    let (lateral, depth) = (row.error_mm.xy(), row.error_mm.z);
    let of_lateral = Matrix2::new(stated.xx, stated.xy, stated.xy, stated.yy).cholesky();
    let lateral = of_lateral.map_or(f64::INFINITY, |factor| lateral.dot(&factor.solve(&lateral)));
    Some([depth * depth / stated.zz, lateral, normalised_square(row)?])
}

/// Density of the χ² distribution with three degrees of freedom.
pub fn chi_square_3_density(square: f64) -> f64 {
    square.max(0.0).sqrt() * (-0.5 * square).exp() / std::f64::consts::TAU.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_density_is_one_law_and_leaves_five_percent_beyond_its_quantile() {
        const STEP: f64 = 1e-3;
        let share =
            |to: f64| (0..(to / STEP) as usize).map(|i| chi_square_3_density((i as f64 + 0.5) * STEP)).sum::<f64>();
        assert!((share(60.0) * STEP - 1.0).abs() < 1e-4);
        assert!((share(CHI_SQUARE_95[2]) * STEP - 0.95).abs() < 1e-4);
    }
}
