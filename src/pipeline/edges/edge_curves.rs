//! How a blurred edge looks: a step and a limb's shading under a Gaussian of one, tabled.

use std::sync::LazyLock;

const STEPS_PER_SIGMA: f32 = 32.0;
const TABLE_REACH: f32 = 8.0;
const STEPS: usize = (2.0 * TABLE_REACH * STEPS_PER_SIGMA) as usize;

/// For `z` from −8 to 8 standard deviations outwards: the blurred step's inside share, the blurred root of the depth, the
/// step's slope, and that times `z`.
pub struct EdgeCurves {
    table: [[f32; 4]; STEPS + 1],
}

/// The one table.
pub static EDGE_CURVES: LazyLock<EdgeCurves> = LazyLock::new(EdgeCurves::new);

impl EdgeCurves {
    /// Works the table out by integration.
    fn new() -> Self {
        let density = |x: f64| (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
        // Simpson-free: 161 even steps over ±5 σ are exact to 1e-7 for a Gaussian.
        let blur: Vec<(f64, f64)> = (-80..=80).map(|k| f64::from(k) / 16.0).map(|x| (x, density(x) / 16.0)).collect();
        let table = std::array::from_fn(|i| {
            let z = i as f64 / f64::from(STEPS_PER_SIGMA) - f64::from(TABLE_REACH);
            let depth: f64 = blur.iter().map(|(x, weight)| weight * (x - z).max(0.0).sqrt()).sum();
            [inside_share(z), depth, density(z), density(z) * z].map(|c| c as f32)
        });
        Self { table }
    }

    /// Share, root of the depth, slope, slope times `z`; interpolated.
    #[inline]
    pub fn at(&self, z: f32) -> [f32; 4] {
        let at = ((z + TABLE_REACH) * STEPS_PER_SIGMA).clamp(0.0, STEPS as f32);
        let index = (at as usize).min(STEPS - 1);
        let part = at - index as f32;
        let (low, high) = (self.table[index], self.table[index + 1]);
        let [share, depth, slope, wider] = std::array::from_fn(|i| low[i] + part * (high[i] - low[i]));
        [share, if z < -TABLE_REACH { (-z).sqrt() } else { depth }, slope, wider]
    }
}

/// Gaussian upper tail by numeric integration of its density from `z` on.
pub fn inside_share(z: f64) -> f64 {
    let density = |x: f64| (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
    let steps = 200;
    let width = z / f64::from(steps);
    let half: f64 = (0..steps).map(|k| density((f64::from(k) + 0.5) * width) * width).sum();
    0.5 - half
}
