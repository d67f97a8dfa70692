//! Checks whether the errors are as large as the track's stated sigmas. An error bar that is too short is worse than
//! none.
//!
//! A row states σ across (RMS of x and y) and along the line of sight. If the sigmas are right and the axes
//! independent, the squared error in units of σ, summed over the axes, follows a χ² distribution with as many degrees
//! of freedom: 95 % of the rows lie below [`CHI_SQUARE_95`], and the mean per axis is 1 (Bar-Shalom, Li & Kirubarajan
//! 2001, 5.4: normalised estimation error squared).

use super::judged::JudgedRow;
use crate::statistics::interval::wilson;

/// The 95 % quantiles of the χ² distribution for one, two and three degrees of freedom.
pub const CHI_SQUARE_95: [f64; 3] = [3.841_459, 5.991_465, 7.814_728];

/// A track's stated errors compared with its true errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SigmaCheck {
    /// Rows that state both sigmas.
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
    /// Checks the rows that state sigmas; `None` if there are none.
    pub(super) fn of(rows: &[&JudgedRow]) -> Option<SigmaCheck> {
        let squares: Vec<[f64; 2]> = rows.iter().filter_map(|row| squares(row)).collect();
        let share = |axes: usize, of: fn(&[f64; 2]) -> f64| {
            SigmaCoverage::of(&squares.iter().map(of).collect::<Vec<_>>(), axes)
        };
        Some(SigmaCheck {
            rows: squares.len(),
            depth: share(1, |[_, depth]| *depth)?,
            lateral: share(2, |[lateral, _]| *lateral)?,
            three_d: share(3, |[lateral, depth]| lateral + depth)?,
        })
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

/// A row's squared error in units of its stated sigmas, summed over all three axes; `None` if it states none.
pub fn normalised_square(row: &JudgedRow) -> Option<f64> {
    squares(row).map(|[lateral, depth]| lateral + depth)
}

/// Squared error in units of sigma, across and along the line of sight.
fn squares(row: &JudgedRow) -> Option<[f64; 2]> {
    let (sigma_xy, sigma_z) = (row.sample.sigma_xy_mm?, row.sample.sigma_z_mm?);
    Some([(row.error_mm.xy() / sigma_xy).norm_squared(), (row.error_mm.z / sigma_z).powi(2)])
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
