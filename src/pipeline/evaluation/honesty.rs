//! Are the errors as large as the track itself says? An error bar that is too short is worse than none.
//!
//! A row states σ across (RMS of x and y) and along the line of sight. Were it honest and its axes independent, the
//! error's square in units of σ, summed over the axes, would follow the χ² law of as many degrees of freedom: 95 % of the rows below
//! [`WITHIN_95`], the mean per axis 1 (Bar-Shalom, Li & Kirubarajan 2001, 5.4: normalised estimation error squared).

use super::judged::Judged;
use crate::pipeline::score::interval::wilson;

/// The χ² law's 95 % quantiles for one, two and three degrees of freedom.
pub const WITHIN_95: [f64; 3] = [3.841_459, 5.991_465, 7.814_728];

/// How a track's stated errors compare with its true ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Honesty {
    /// Rows that state both sigmas.
    pub rows: usize,
    /// The interval of z.
    pub depth: Share,
    /// The ellipse of x and y.
    pub lateral: Share,
    /// The ellipsoid of all three.
    pub three_d: Share,
}

/// One region that should hold 95 % of the errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Share {
    /// Share of the errors inside it, 0 to 1.
    pub inside: f64,
    /// Where the true share lies with 95 % (Wilson's binomial interval), were rows independent. Neighbouring rows of a
    /// smoothed track are not: the real interval is wider.
    pub interval: [f64; 2],
    /// Mean normalised squared error per axis: 1 is honest, 4 means that errors are twice as large as stated.
    pub mean_square: f64,
}

impl Honesty {
    /// Of the rows that state sigmas; `None` without any.
    pub(super) fn of(rows: &[&Judged]) -> Option<Honesty> {
        let squares: Vec<[f64; 2]> = rows.iter().filter_map(|row| squares(row)).collect();
        let share =
            |axes: usize, of: fn(&[f64; 2]) -> f64| Share::of(&squares.iter().map(of).collect::<Vec<_>>(), axes);
        Some(Honesty {
            rows: squares.len(),
            depth: share(1, |[_, depth]| *depth)?,
            lateral: share(2, |[lateral, _]| *lateral)?,
            three_d: share(3, |[lateral, depth]| lateral + depth)?,
        })
    }
}

impl Share {
    fn of(squares: &[f64], axes: usize) -> Option<Share> {
        let n = squares.len() as f64;
        let inside = squares.iter().filter(|square| **square <= WITHIN_95[axes - 1]).count() as f64 / n;
        let interval = wilson(inside, squares.len()).ok()?;
        let interval = [interval.low, interval.high];
        Some(Share { inside, interval, mean_square: squares.iter().sum::<f64>() / n / axes as f64 })
    }
}

/// An error's square in units of what its row states, over all three axes; `None` where it states nothing.
pub fn normalised_square(row: &Judged) -> Option<f64> {
    squares(row).map(|[lateral, depth]| lateral + depth)
}

/// Across and along the line of sight.
fn squares(row: &Judged) -> Option<[f64; 2]> {
    let (sigma_xy, sigma_z) = (row.sample.sigma_xy_mm?, row.sample.sigma_z_mm?);
    Some([(row.error_mm.xy() / sigma_xy).norm_squared(), (row.error_mm.z / sigma_z).powi(2)])
}

/// Density of the χ² law of three degrees of freedom.
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
        assert!((share(WITHIN_95[2]) * STEP - 0.95).abs() < 1e-4);
    }
}
