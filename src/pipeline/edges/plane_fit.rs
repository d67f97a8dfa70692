//! One plane across one edge, where the edge is assumed: linear least squares, and what the residuals say of moving it.

use nalgebra::{Matrix4, SMatrix};

use super::edge_curves::{EDGE_CURVES, EdgeCurves};
use super::plane_samples::{LANES, PlaneSamples};
use super::probe::Shading;

/// Depth inside a cut edge over which its shading is counted, pixels.
const CUT_DEPTH_PX: f64 = 10.0;

/// An edge as it is assumed while the rest is fitted.
#[derive(Clone, Copy, Debug)]
pub struct AssumedEdge {
    /// Blur of the plane across it: standard deviation, pixels.
    pub blur_px: f64,
    /// Distance from the chord, pixels.
    pub offset_px: f64,
    /// How the surface inside shades.
    pub shading: Shading,
    /// The light's surplus along it, codes times pixels.
    pub spill: f64,
    /// Weight, in samples, of the belief that the background does not change outwards.
    pub evenness: f64,
}

/// What a plane shows across an edge, in codes and pixels.
#[derive(Clone, Copy, Debug, Default)]
pub struct PlaneFit {
    /// Code just outside.
    pub outside: f64,
    /// How much higher the code is just inside.
    pub step: f64,
    /// How much it still rises inwards, over the shading's depth.
    pub shade: f64,
    /// Residuals along a bump at the edge, of the step's slope: moving it, shifting the plane and spilling light are all
    /// such bumps.
    pub gradient: f64,
    /// What is left of that bump's square after the linear unknowns.
    pub information: f64,
    /// The same for a wider edge.
    pub blur_gradient: f64,
    /// The same for a wider edge.
    pub blur_information: f64,
    squares: f64,
    freedom: f64,
}

impl PlaneFit {
    /// Variance of the residuals, codes².
    pub fn variance(&self) -> f64 {
        self.squares / self.freedom.max(1.0)
    }
}

impl AssumedEdge {
    /// Fits level, step, shade and shadow; `None` where there are too few samples.
    pub fn fit(&self, samples: &PlaneSamples) -> Option<PlaneFit> {
        const FEWEST: f64 = 8.0;
        let count = samples.len as f64;
        if count < FEWEST {
            return None;
        }
        let gram = self.gram_over(samples);
        let mut normal: Matrix4<f64> = gram.fixed_view::<4, 4>(0, 0).into_owned();
        normal[(2, 2)] += 1e-3 * count; // keeps the shade term bounded where the window is short
        normal[(3, 3)] += self.evenness;
        let [to_bump, to_blur, right] = [4, 5, 6].map(|column| gram.fixed_view::<4, 1>(0, column).into_owned());
        let inverse = normal.try_inverse()?;
        let heights = inverse * right;
        let gradient = gram[(4, 6)] - to_bump.dot(&heights);
        let information = (gram[(4, 4)] - to_bump.dot(&(inverse * to_bump))).max(0.0);
        let explained = if information > 0.0 { gradient * gradient / information } else { 0.0 };
        let step = heights[1];
        Some(PlaneFit {
            outside: heights[0] + f64::from(samples.level),
            step,
            shade: heights[2],
            gradient,
            information,
            blur_gradient: step * (gram[(5, 6)] - to_blur.dot(&heights)),
            blur_information: step * step * (gram[(5, 5)] - to_blur.dot(&(inverse * to_blur))).max(0.0),
            squares: (gram[(6, 6)] - right.dot(&heights) - explained).max(0.0),
            freedom: (count - 5.0).max(1.0),
        })
    }

    /// All products of the seven columns, summed over the samples: level outside, step, shade, shadow, bump along the
    /// edge, wider edge, value.
    ///
    /// The tracker spends most of its time here. [`LANES`] samples are worked on at once, in single precision, which the
    /// centred values allow.
    fn gram_over(&self, samples: &PlaneSamples) -> SMatrix<f64, 7, 7> {
        let Self { blur_px: blur, offset_px: offset, .. } = *self;
        let (limb, radius_px) = match self.shading {
            Shading::Limb { radius_px } => (1.0, radius_px),
            Shading::Cut => (0.0, CUT_DEPTH_PX),
        };
        let [offset, per_px, in_radii, blur_px] = [offset, 1.0 / blur, blur / radius_px, blur].map(|c| c as f32);
        let [limb_scale, cut_scale] =
            [limb * (2.0 * blur / radius_px).sqrt(), (1.0 - limb) * blur / CUT_DEPTH_PX].map(|c| c as f32);
        const FARTHEST: f32 = 1e4; // in standard deviations; beyond are those that only fill the last chunk
        let table: &EdgeCurves = &EDGE_CURVES;
        let mut products = [[[0.0f32; LANES]; 7]; 7];
        for (distances, values) in samples.chunks() {
            let z = distances.map(|distance| (distance - offset) * per_px);
            let curves = z.map(|z| table.at(z));
            let limb = z.map(|z| {
                let inside = (-z * in_radii).clamp(0.0, 1.0);
                limb_scale * (1.0 - inside * (0.25 + 0.04 * inside)) // √(1 − x/2) to 1e-3
            });
            // A ramp that begins at the edge, blurred: outwards, and without `z` of it inwards.
            let outwards: [f32; LANES] =
                std::array::from_fn(|l| if z[l] < FARTHEST { z[l] * (1.0 - curves[l][0]) + curves[l][2] } else { 0.0 });
            let inwards: [f32; LANES] = std::array::from_fn(|l| if z[l] < FARTHEST { outwards[l] - z[l] } else { 0.0 });
            let lanes: [usize; LANES] = std::array::from_fn(|lane| lane);
            let columns = [
                [1.0; LANES],
                lanes.map(|l| curves[l][0]),
                lanes.map(|l| curves[l][1] * limb[l] + inwards[l] * cut_scale),
                outwards.map(|ramp| blur_px * ramp),
                lanes.map(|l| curves[l][2] * per_px),
                lanes.map(|l| curves[l][3] * per_px),
                *values,
            ];
            for (i, first) in columns.iter().enumerate() {
                for (j, second) in columns.iter().enumerate().skip(i) {
                    for (sum, (a, b)) in products[i][j].iter_mut().zip(first.iter().zip(second)) {
                        *sum += a * b;
                    }
                }
            }
        }
        let mut gram = SMatrix::<f64, 7, 7>::zeros();
        for (i, row) in products.iter().enumerate() {
            for (j, lanes) in row.iter().enumerate().skip(i) {
                gram[(i, j)] = f64::from(lanes.iter().sum::<f32>());
            }
        }
        gram[(0, 0)] = samples.len as f64; // not those that only fill the last chunk
        gram.fill_lower_triangle_with_upper_triangle();
        // The spilt light is a bump of known height: taken off the values here, not from each of them.
        let (bump, value) = (gram.column(4).into_owned(), gram.column(6).into_owned());
        gram.set_column(6, &(value - bump * self.spill));
        gram[(6, 6)] -= self.spill * gram[(4, 6)];
        gram
    }
}
