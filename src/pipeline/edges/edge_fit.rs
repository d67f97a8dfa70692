//! One edge in all three planes: light on both sides, mixed by blur, coded, and compared with the samples.
//!
//! **In** the samples about a chord, an assumed offset, how blurred the edge is. **Out** by how much the edge lies farther
//! out, how sure that is, what both sides look like. **Method** Gauss–Newton. Per channel (R, G, B) light is
//! `base + limb·cos θ` inside, where `θ` is how far the tube's surface has turned away, and `out + ramp·distance` outside;
//! at a tape's end, where nothing turns away, it changes steadily inside instead. Without the limb its darkening pulls the
//! border inwards by up to a pixel; without the ramp the soft shadow beside a tube pushes it outwards by 0.4.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::edge_curves::EdgeCurves;
use super::equations::{COLUMNS, Constants, Equations, OFFSET, PER_CHANNEL, RESIDUAL, TAUGHT, UNKNOWNS};
use super::probe::Shading;
use super::profile::Profile;
use super::tone::Tone;

/// Depth inside a cut edge over which its shading is counted, pixels.
const CUT_DEPTH_PX: f64 = 10.0;
/// How far the light inside may be from a guess, and from what the recording has taught, as a share of it: base, limb.
const GUESSED_WITHIN: (f64, f64) = (0.7, 1.0);
const LEARNED_WITHIN: (f64, f64) = (0.3, 0.3);
/// How much the background may brighten or darken per pixel outwards: as a share of its light, and at least.
const RAMP_WITHIN: (f64, f64) = (0.1, 0.003);

/// What the first guess tells of the offset, px⁻²: keeps edges that hardly show from leaping about, moves no other.
const GUESS_INFORMATION: f64 = 0.1;

/// A step that makes the squares this much larger is too long.
const WORSE: f64 = 1.05;

/// How an edge is blurred and shaded.
#[derive(Clone, Copy)]
pub struct EdgeLook<'a> {
    /// Standard deviation of the blur of light: lens and motion, pixels.
    pub light_blur_px: f64,
    /// What the lens alone does, pixels.
    pub lens_px: f64,
    /// Standard deviation of what blurs chroma's codes besides: larger pixels and compression, pixels.
    pub chroma_blur_px: f64,
    /// How the surface inside shades.
    pub shading: Shading,
    /// Light to codes.
    pub tone: &'a Tone,
    /// Gamma-coded `[R', G', B']` to codes of Y, U, V, and the codes of black.
    pub codes_from_rgb: Matrix3<f64>,
    /// Codes of black.
    pub black: Vector3<f64>,
}

/// An edge as it is believed to be.
#[derive(Clone, Copy, Debug)]
pub struct EdgeFit {
    /// Light of each channel: `[base, limb, out, ramp]`.
    pub light: [[f64; PER_CHANNEL]; 3],
    /// Distance from the chord, pixels.
    pub offset_px: f64,
    /// Variance of the residuals of each plane, codes².
    pub variance: [f64; 3],
    /// Information on the offset, px⁻².
    pub information: f64,
    /// Gradient and information, with everything else free, on what only many edges teach: the blur of light at a cut, how much
    /// farther out chroma lies at a limb.
    pub taught: (f64, f64),
    /// By how much farther out the edge lies in chroma than in luma, pixels: 0 unless looked for.
    pub chroma_px: f64,
    /// Squared residuals before the last step, codes², and what it was made from.
    before: Option<(f64, [[f64; PER_CHANNEL]; 3], f64)>,
    /// How far the inside's light may be from the first guess, as a share of it: base, and limb beside it.
    expected_within: (f64, f64),
}

impl EdgeFit {
    /// A first guess from both sides' light.
    pub fn between(inside: [f64; 3], outside: [f64; 3], offset_px: f64, shading: Shading) -> Self {
        let (base, limb) = match shading {
            Shading::Limb { .. } => (0.6, 0.6),
            Shading::Cut => (1.0, 0.0),
        };
        let light = std::array::from_fn(|c| [base * inside[c], limb * inside[c], outside[c], 0.0]);
        Self {
            light,
            offset_px,
            variance: [0.0; 3],
            information: 0.0,
            taught: (0.0, 0.0),
            chroma_px: 0.0,
            before: None,
            expected_within: GUESSED_WITHIN,
        }
    }

    /// Takes the inside's light from what is usual there, as bright as it is here.
    pub fn expect_inside(&mut self, usual: [[f64; 2]; 3]) {
        let unsaturated = |light: &f64| *light < 0.9;
        let (here, there) =
            self.inside().iter().zip(usual.map(|l| l[0] + 0.6 * l[1])).fold((0.0, 0.0), |sum, (here, there)| {
                if unsaturated(here) && unsaturated(&there) { (sum.0 + here, sum.1 + there) } else { sum }
            });
        let brighter = if there > 0.0 { (here / there).clamp(0.5, 2.0) } else { 1.0 };
        for (light, usual) in self.light.iter_mut().zip(usual) {
            (light[0], light[1]) = (brighter * usual[0], brighter * usual[1]);
        }
        self.expected_within = LEARNED_WITHIN;
    }

    /// Light some pixels inside.
    pub fn inside(&self) -> [f64; 3] {
        self.light.map(|l| l[0] + 0.6 * l[1])
    }

    /// Light just outside.
    pub fn outside(&self) -> [f64; 3] {
        self.light.map(|l| l[2])
    }
}

impl EdgeLook<'_> {
    /// The codes of some light.
    pub fn codes(&self, light: [f64; 3]) -> [f64; 3] {
        let coded = Vector3::from(light.map(|l| f64::from(self.tone.code(l as f32)[0])));
        (self.codes_from_rgb * coded + self.black).into()
    }

    /// One step, planes weighed by these variances, or half the last one back where it made things worse; returns how far
    /// the offset moved.
    pub fn improve(
        &self,
        luma: &Profile<1>,
        chroma: &Profile<2>,
        noise: [f64; 3],
        fit: &mut EdgeFit,
        first: &EdgeFit,
        equations: &mut Equations,
    ) -> Option<f64> {
        const FEWEST: f32 = 12.0;
        if luma.count + chroma.count < FEWEST {
            return None;
        }
        let products = equations.of(&self.constants(fit, noise), luma, chroma);
        let squares = equations.squares.iter().sum::<f32>().into();
        if let Some((better, light, offset_px)) = fit.before.filter(|before| squares > WORSE * before.0) {
            fit.before = Some((better, light, offset_px));
            let half = 0.5 * (offset_px - fit.offset_px);
            fit.offset_px += half;
            for (now, then) in fit.light.as_flattened_mut().iter_mut().zip(light.as_flattened()) {
                *now = 0.5 * (*now + then);
            }
            return Some(half);
        }
        fit.before = Some((squares, fit.light, fit.offset_px));
        let gram = SMatrix::<f64, COLUMNS, COLUMNS>::from_fn(|i, j| f64::from(products[i.min(j)][i.max(j)]));
        let mut normal: SMatrix<f64, UNKNOWNS, UNKNOWNS> = gram.fixed_view::<UNKNOWNS, UNKNOWNS>(0, 0).into_owned();
        let mut right: SVector<f64, UNKNOWNS> = gram.fixed_view::<UNKNOWNS, 1>(0, RESIDUAL).into_owned();
        for c in 0..3 {
            Prior::of(&first.light[c], first.expected_within).add(
                c,
                &first.light[c],
                &fit.light[c],
                &mut normal,
                &mut right,
            );
        }
        normal[(OFFSET, OFFSET)] += GUESS_INFORMATION;
        right[OFFSET] -= GUESS_INFORMATION * (fit.offset_px - first.offset_px);
        let solver = normal.cholesky()?;
        let step = solver.solve(&right);
        for c in 0..3 {
            for j in 0..PER_CHANNEL {
                fit.light[c][j] += step[c * PER_CHANNEL + j];
            }
        }
        let moved = step[OFFSET].clamp(-1.0, 1.0);
        fit.offset_px += moved;
        // The last unknown's own share of the factor: what is known of it, everything else being free.
        fit.information = (solver.l_dirty()[(OFFSET, OFFSET)].powi(2) - GUESS_INFORMATION).max(0.0);
        let to_taught: SVector<f64, UNKNOWNS> = gram.fixed_view::<UNKNOWNS, 1>(0, TAUGHT).into_owned();
        let through = solver.solve(&to_taught);
        fit.taught = (gram[(TAUGHT, RESIDUAL)] - through.dot(&right), gram[(TAUGHT, TAUGHT)] - through.dot(&to_taught));
        let pixels = [luma.count, chroma.count, chroma.count].map(f64::from);
        let free = 1.0 - (UNKNOWNS as f64 / pixels.iter().sum::<f64>()).min(0.8);
        fit.variance = std::array::from_fn(|p| f64::from(equations.squares[p]) / (pixels[p].max(1.0) * free));
        Some(moved)
    }

    fn constants(&self, fit: &EdgeFit, noise: [f64; 3]) -> Constants<'_> {
        let blur = self.light_blur_px;
        let (limb, shading) = match self.shading {
            Shading::Limb { radius_px } => (true, ((2.0 * blur / radius_px).sqrt(), blur / radius_px)),
            Shading::Cut => (false, (0.0, blur / CUT_DEPTH_PX)),
        };
        Constants {
            curves: EdgeCurves::of(1.0 - (self.lens_px / blur).powi(2)),
            tone: self.tone,
            offset: fit.offset_px as f32,
            chroma: fit.chroma_px as f32,
            chroma_blur: self.chroma_blur_px as f32,
            blur: blur as f32,
            limb,
            shading: (shading.0 as f32, shading.1 as f32),
            light: fit.light.map(|channel| channel.map(|l| l as f32)),
            codes_from_rgb: std::array::from_fn(|p| std::array::from_fn(|c| self.codes_from_rgb[(p, c)] as f32)),
            black: std::array::from_fn(|p| self.black[p] as f32),
            per_noise: noise.map(|n| (1.0 / n) as f32),
        }
    }
}

/// What is believed of one channel's light before it is looked at: inverse variances.
struct Prior {
    /// Of the limb's light from as much as the base has, or from none at a cut.
    shade: f64,
    ramp: f64,
    base: f64,
}

impl Prior {
    fn of(first: &[f64; PER_CHANNEL], within: (f64, f64)) -> Self {
        let inside = (first[0] + 0.6 * first[1]).max(0.01);
        let outside = first[2].max(0.01);
        let square = |sigma: f64| 1.0 / (sigma * sigma);
        let (base, limb) = within;
        Self {
            shade: square(limb * inside),
            ramp: square(RAMP_WITHIN.0 * outside + RAMP_WITHIN.1),
            base: square(base * inside),
        }
    }

    fn add(
        &self,
        channel: usize,
        first: &[f64; PER_CHANNEL],
        now: &[f64; PER_CHANNEL],
        normal: &mut SMatrix<f64, UNKNOWNS, UNKNOWNS>,
        right: &mut SVector<f64, UNKNOWNS>,
    ) {
        let weights = [self.base, self.shade, 1e-3, self.ramp];
        for (j, weight) in weights.into_iter().enumerate() {
            let at = channel * PER_CHANNEL + j;
            normal[(at, at)] += weight;
            right[at] -= weight * (now[j] - first[j]);
        }
    }
}
