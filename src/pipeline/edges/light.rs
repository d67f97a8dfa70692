//! What light does at an edge that codes do not show: blur mixes *light*, but the codes stand for its root.
//!
//! Across a blurred edge the light is a mixture of both sides' light. The camera codes about its 1/2.2nd power, a
//! concave curve, so that the coded picture is brighter along the edge than a blend of the two codes: the brighter side seems to
//! reach too far. Per channel that surplus, integrated across the edge, is the blur times [`LightSpill::surplus`] of both
//! sides' codes. Ignored, it moves a border of bright tape by up to 0.3 px, and differently before every background.

use nalgebra::Vector3;

/// Usual exponent of a camera's coding.
const GAMMA: f64 = 2.2;

/// Steps of the table per channel.
const STEPS: usize = 32;

/// The surplus for all pairs of codes.
#[derive(Clone, Debug)]
pub struct LightSpill {
    table: Vec<f32>,
}

impl LightSpill {
    /// Works the table out by integration across a Gaussian edge.
    pub fn new() -> Self {
        let side = STEPS + 1;
        let code = |i: usize| i as f64 / STEPS as f64;
        let mut table = vec![0.0; side * side];
        for (row, column) in (0..side).flat_map(|row| (0..row).map(move |column| (row, column))) {
            let surplus = integrated(code(row), code(column)) as f32;
            table[row * side + column] = surplus;
            table[column * side + row] = surplus; // which side is which does not matter
        }
        Self { table }
    }

    /// Surplus of one channel between two codes (0..1), in codes times standard deviations of the blur; interpolated.
    pub fn surplus(&self, one: f64, other: f64) -> f64 {
        let place = |code: f64| {
            let at = code.clamp(0.0, 1.0) * STEPS as f64;
            let index = (at as usize).min(STEPS - 1);
            (index, at - index as f64)
        };
        let ((row, down), (column, across)) = (place(one), place(other));
        let at = |r: usize, c: usize| f64::from(self.table[r * (STEPS + 1) + c]);
        let top = at(row, column) * (1.0 - across) + at(row, column + 1) * across;
        let bottom = at(row + 1, column) * (1.0 - across) + at(row + 1, column + 1) * across;
        top * (1.0 - down) + bottom * down
    }

    /// The surplus of all three channels between two colours (gamma-coded R, G, B in 0..1).
    pub fn between(&self, one: Vector3<f64>, other: Vector3<f64>) -> Vector3<f64> {
        one.zip_map(&other, |a, b| self.surplus(a, b))
    }
}

impl Default for LightSpill {
    fn default() -> Self {
        Self::new()
    }
}

fn integrated(one: f64, other: f64) -> f64 {
    let (light_one, light_other) = (one.powf(GAMMA), other.powf(GAMMA));
    let width = 0.1;
    let mut share = 0.0;
    let mut sum = 0.0;
    for step in -45..=45 {
        let z = f64::from(step) * width;
        let density = (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt() * width;
        share += 0.5 * density;
        let mixed = share * light_one + (1.0 - share) * light_other;
        sum += (mixed.max(0.0).powf(1.0 / GAMMA) - (share * one + (1.0 - share) * other)) * width;
        share += 0.5 * density;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_sides_spill_nothing_and_which_is_which_does_not_matter() {
        let spill = LightSpill::new();
        assert!(spill.surplus(0.5, 0.5).abs() < 1e-6);
        assert!(spill.surplus(0.41, 0.41).abs() < 1e-3, "between the table's steps");
        assert!((spill.surplus(0.2, 0.9) - spill.surplus(0.9, 0.2)).abs() < 1e-4);
    }

    #[test]
    fn more_contrast_spills_more() {
        let spill = LightSpill::new();
        let spills: Vec<f64> = [0.8, 0.5, 0.2, 0.05].map(|dark| spill.surplus(1.0, dark)).to_vec();
        assert!(spills.windows(2).all(|pair| pair[0] < pair[1]), "{spills:?}");
        assert!(spills[0] > 0.0);
    }
}
