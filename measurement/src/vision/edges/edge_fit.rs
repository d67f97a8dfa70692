//! Fits one edge in all three planes: light on both sides is mixed by blur, encoded, and compared with the pixels.
//!
//! **In** the profiles across a chord, an initial offset, the edge's expected blur. **Out** the offset of the edge,
//! its certainty, the light on both sides. **Method** Gauss–Newton. Per channel (R, G, B) the light is `base +
//! limb·cos θ` inside, with `θ` the angle between the tube's surface normal and the camera, and `out + ramp·distance`
//! outside. At a tape's end no surface turns away; the light then changes steadily inside. Without the limb term, the
//! limb's darkening would pull the border inwards by up to a pixel; without the ramp, the soft shadow beside a tube
//! would push it outwards by 0.4. Shadow has the same share in all channels, so one ramp for all three loses nothing;
//! one limb for all three would cost 0.4 mm of depth.

use nalgebra::{Matrix3, Vector3};

use super::cholesky::CholeskyFactor;
use super::edge_curves::EdgeCurves;
use super::equations::{
    self, EdgeConstants, EdgeLight, LEARNED, LearnedParameter, OFFSET, RAMP, RESIDUAL, SHADE, UNKNOWNS,
};
use super::probe::Shading;
use super::profile::Profile;
use super::tone;

/// Unit of depth inside a cut edge for its shading term, pixels.
const CUT_DEPTH_PX: f64 = 10.0;
/// How far the light inside may be from a guess, and from the learned light, as a share of it: base, limb.
const GUESSED_WITHIN: (f64, f64) = (0.7, 1.0);
const LEARNED_WITHIN: (f64, f64) = (0.3, 0.3);
/// Change of the background per pixel outwards, as a share of its light: standard deviation.
const RAMP_WITHIN: f64 = 0.1;
/// The same beside a polished tube, over the tube's radius: its shadow on the mat is wider than the tube. A steeper
/// ramp would take the light that the limb mirrors for the background.
const RAMP_WITHIN_RADIUS: f64 = 0.1;
/// Light of the background that the limb of a polished tube mirrors, as a share of it: standard deviation. At grazing
/// incidence every surface mirrors all light, and the lens blurs that within the first pixel.
const MIRRORED: f64 = 0.6;
/// A very wide prior: it only keeps the light outside from diverging.
const ANY_LIGHT: f64 = 30.0;
/// Minimum light of a side when shares of it are computed.
const MIN_LIGHT: f64 = 0.01;
/// How far the offset may be from the guess, pixels. Keeps hardly visible edges from jumping about; no other edge is
/// affected.
const GUESS_WITHIN_PX: f64 = 3.0;

/// Share of the limb term that is present some pixels inside.
pub(super) const LIMB_INSIDE: f64 = 0.6;

/// A step that increases the squared residuals by more than this factor is too long.
const MAX_INCREASE: f64 = 1.05;

/// Expected blur and shading of an edge.
#[derive(Clone, Copy)]
pub struct EdgeAppearance {
    /// Standard deviation of the blur of light: lens and motion, pixels.
    pub light_blur_px: f64,
    /// Part of it due to the lens alone, pixels.
    pub lens_px: f64,
    /// Additional blur of the chroma codes, by larger pixels and compression: standard deviation, pixels.
    pub chroma_blur_px: f64,
    /// How the surface inside shades.
    pub shading: Shading,
    /// The parameter for [`EdgeFit::learned_evidence`].
    pub learned_parameter: Option<LearnedParameter>,
    /// Matrix from gamma-coded `[R', G', B']` to codes of Y, U, V.
    pub codes_from_rgb: Matrix3<f64>,
    /// Codes of black.
    pub black: Vector3<f64>,
}

/// One channel's light inside an edge.
#[derive(Clone, Copy, Debug, Default)]
pub struct InsideLight {
    /// Light inside without the limb term.
    pub base: f64,
    /// The limb term where the surface faces the camera.
    pub limb: f64,
    /// Mean light inside that was used for the first guess.
    pub guessed: f64,
}

/// One number for each unknown.
type Unknowns = [f64; UNKNOWNS];

/// Current estimate of an edge.
#[derive(Clone, Copy, Debug)]
pub struct EdgeFit {
    /// Light of each channel.
    pub light: [EdgeLight<f64>; 3],
    /// Mean light inside, clear of the edge: the basis of the first guess.
    guessed: [f64; 3],
    /// Shading inside and ramp outside beyond the guess: shares of the light there.
    shared: [f64; 4],
    /// Distance from the chord, pixels.
    pub offset_px: f64,
    /// Variance of the residuals of each plane, codes².
    pub variance: [f64; 3],
    /// Information on the offset, px⁻².
    pub information: f64,
    /// Gradient and information on the learned parameter, with all other unknowns free.
    pub learned_evidence: (f64, f64),
    /// How much farther out the edge lies in chroma than in luma, pixels; 0 unless it is estimated.
    pub chroma_px: f64,
    /// Squared residuals before the last step, codes², and that step.
    last_step: Option<(f64, Unknowns)>,
    /// Expected deviation of the light inside from the first guess, as a share of it: base, limb.
    expected_within: (f64, f64),
    /// Expected light inside that is mirrored, as a share of the light outside.
    mirrored: f64,
    /// Expected change of the background per pixel, as a share of its light.
    ramp_within: f64,
}

impl EdgeFit {
    /// First guess from the light of both sides.
    pub fn first_guess(inside: [f64; 3], outside: [f64; 3], offset_px: f64, shading: Shading) -> Self {
        let (base, limb) = match shading {
            Shading::Limb { .. } => (0.6, 0.6),
            Shading::Cut => (1.0, 0.0),
        };
        let light = std::array::from_fn(|c| EdgeLight {
            base: base * inside[c],
            limb: limb * inside[c],
            out: outside[c],
            ramp: 0.0,
            of: (inside[c].max(MIN_LIGHT), outside[c].max(MIN_LIGHT)),
        });
        Self {
            light,
            guessed: inside,
            shared: [0.0; 4],
            offset_px,
            variance: [0.0; 3],
            information: 0.0,
            learned_evidence: (0.0, 0.0),
            chroma_px: 0.0,
            last_step: None,
            expected_within: GUESSED_WITHIN,
            mirrored: 0.0,
            ramp_within: RAMP_WITHIN,
        }
    }

    /// Expects a polished tube, whose limb mirrors the background.
    pub fn expect_mirror(&mut self, shading: Shading) {
        if let Shading::Limb { radius_px } = shading {
            (self.mirrored, self.ramp_within) = (MIRRORED, RAMP_WITHIN_RADIUS / radius_px);
        }
    }

    /// Replaces the light inside by the usual light there, scaled to the brightness of this edge. For the scale,
    /// guesses are compared with guesses, because a guess is not a mean of base and limb.
    pub fn set_usual_inside(&mut self, usual: [InsideLight; 3]) {
        let unsaturated = |light: f64| light < 0.9;
        let (here, there) =
            self.guessed.into_iter().zip(usual).fold((0.0, 0.0), |sum, (here, InsideLight { guessed, .. })| {
                if unsaturated(here) && unsaturated(guessed) { (sum.0 + here, sum.1 + guessed) } else { sum }
            });
        let brighter = if there > 0.0 { (here / there).clamp(0.5, 2.0) } else { 1.0 };
        for (light, usual) in self.light.iter_mut().zip(usual) {
            (light.base, light.limb) = (brighter * usual.base, brighter * usual.limb);
            light.of.0 = (light.base + 0.6 * light.limb).max(MIN_LIGHT);
        }
        self.expected_within = LEARNED_WITHIN;
    }

    /// The fitted light inside, per channel.
    pub fn inside_light(&self) -> [InsideLight; 3] {
        std::array::from_fn(|c| {
            let EdgeLight { base, limb, .. } = self.light[c];
            InsideLight { base, limb, guessed: self.guessed[c] }
        })
    }

    /// Mean light inside, clear of the edge, as it was before the fit. Where gloss or shade hides the tape's colour, the
    /// fitted light is less certain than this.
    pub fn mean_inside(&self) -> [f64; 3] {
        self.guessed
    }

    /// Light some pixels inside.
    pub fn inside(&self) -> [f64; 3] {
        self.light.map(|l| l.base + LIMB_INSIDE * l.limb)
    }

    /// Light just outside.
    pub fn outside(&self) -> [f64; 3] {
        self.light.map(|l| l.out)
    }

    /// Moves every unknown by this share of a step.
    fn apply_step(&mut self, step: &Unknowns, share: f64) {
        for (c, light) in self.light.iter_mut().enumerate() {
            light.base += share * step[c];
            light.out += share * step[3 + c];
            light.limb += share * step[SHADE + c] * light.of.0;
            light.ramp += share * step[RAMP] * light.of.1;
        }
        for (shared, step) in self.shared.iter_mut().zip(&step[SHADE..=RAMP]) {
            *shared += share * step;
        }
        self.offset_px += share * step[OFFSET];
    }

    /// Adds the priors: light about as in the first guess and as mirrored, shading and ramp about as guessed.
    fn add_priors(&self, first: &Self, normal: &mut [Unknowns; UNKNOWNS], right: &mut Unknowns) {
        let (base_within, limb_within) = first.expected_within;
        let mut believe = |at: usize, sigma: f64, now: f64| {
            let weight = 1.0 / (sigma * sigma);
            normal[at][at] += weight;
            right[at] -= weight * now;
        };
        for (c, (now, guess)) in self.light.iter().zip(&first.light).enumerate() {
            let (inside, mirrored) = (guess.of.0, first.mirrored * guess.of.1);
            believe(c, (base_within * inside).hypot(mirrored), now.base - guess.base);
            believe(3 + c, ANY_LIGHT, now.out - guess.out);
            believe(SHADE + c, limb_within.hypot(mirrored / inside), self.shared[c]);
        }
        believe(RAMP, first.ramp_within, self.shared[3]);
        believe(OFFSET, GUESS_WITHIN_PX, self.offset_px - first.offset_px);
    }
}

/// Solution of the normal equations of one edge.
struct Solution {
    /// The step of each unknown.
    step: Unknowns,
    /// Information on the offset, with all other unknowns free.
    information: f64,
    /// Dependence of each unknown on the learned parameter, if there is one.
    through: Option<Unknowns>,
}

/// Solves the normal equations for the residuals and for the learned parameter. The same result with every instruction
/// set.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn solve_normal_equations(
    normal: [Unknowns; UNKNOWNS],
    residuals: Unknowns,
    taught: Option<Unknowns>,
) -> Option<Solution> {
    let factor = CholeskyFactor::new(normal)?;
    #[expect(clippy::manual_map, reason = "a closure would not be of this instruction set")]
    let through = match taught {
        Some(taught) => Some(factor.solve(taught)),
        None => None,
    };
    Some(Solution { step: factor.solve(residuals), information: factor.information_on_last(), through })
}

impl EdgeAppearance {
    /// The codes of this light.
    pub fn codes(&self, light: [f64; 3]) -> [f64; 3] {
        let coded = Vector3::from(light.map(tone::code));
        (self.codes_from_rgb * coded + self.black).into()
    }

    /// Makes one Gauss–Newton step with planes weighted by these variances, or takes half of the last step back if it
    /// made things worse. Returns how far the offset moved.
    pub fn improve(
        &self,
        luma: &Profile<1>,
        chroma: &Profile<2>,
        noise: [f64; 3],
        fit: &mut EdgeFit,
        first: &EdgeFit,
    ) -> Option<f64> {
        const MIN_PIXELS: f32 = 12.0;
        if luma.count + chroma.count < MIN_PIXELS {
            return None;
        }
        let products = equations::products(&self.constants(fit, noise), luma, chroma);
        let squares = products.squares.iter().sum::<f32>().into();
        if let Some((_, step)) = fit.last_step.filter(|(before, _)| squares > MAX_INCREASE * before) {
            fit.last_step = None;
            fit.apply_step(&step, -0.5);
            return Some(-0.5 * step[OFFSET]);
        }
        let column = |of: usize| -> Unknowns { std::array::from_fn(|unknown| products.of(of, unknown)) };
        let mut normal = products.normal();
        let mut right = column(RESIDUAL);
        fit.add_priors(first, &mut normal, &mut right);
        let to_taught = self.learned_parameter.map(|_| column(LEARNED));
        let Solution { mut step, information, through } = solve_normal_equations(normal, right, to_taught)?;
        let most = self.light_blur_px.max(1.0);
        step[OFFSET] = step[OFFSET].clamp(-most, most);
        fit.apply_step(&step, 1.0);
        fit.last_step = Some((squares, step));
        fit.information = (information - 1.0 / GUESS_WITHIN_PX.powi(2)).max(0.0);
        if let (Some(to_taught), Some(through)) = (to_taught, through) {
            let dot = |one: &Unknowns, other: &Unknowns| one.iter().zip(other).map(|(a, b)| a * b).sum::<f64>();
            let gradient = products.of(RESIDUAL, LEARNED) - dot(&through, &right);
            fit.learned_evidence = (gradient, products.of(LEARNED, LEARNED) - dot(&through, &to_taught));
        }
        let pixels = [luma.count, chroma.count, chroma.count].map(f64::from);
        let free = 1.0 - (UNKNOWNS as f64 / pixels.iter().sum::<f64>()).min(0.8);
        fit.variance = std::array::from_fn(|p| f64::from(products.squares[p]) / (pixels[p].max(1.0) * free));
        Some(step[OFFSET])
    }

    fn constants(&self, fit: &EdgeFit, noise: [f64; 3]) -> EdgeConstants<'static> {
        let blur = self.light_blur_px;
        let (limb, shading) = match self.shading {
            Shading::Limb { radius_px } => (true, ((2.0 * blur / radius_px).sqrt(), blur / radius_px)),
            Shading::Cut => (false, (0.0, blur / CUT_DEPTH_PX)),
        };
        EdgeConstants {
            curves: EdgeCurves::for_motion_share(1.0 - (self.lens_px / blur).powi(2)),
            offset: fit.offset_px as f32,
            chroma: fit.chroma_px as f32,
            chroma_blur: self.chroma_blur_px as f32,
            blur: blur as f32,
            limb,
            shading: (shading.0 as f32, shading.1 as f32),
            light: fit.light.map(|l| l.single()),
            learned_parameter: self.learned_parameter,
            codes_from_rgb: std::array::from_fn(|p| std::array::from_fn(|c| self.codes_from_rgb[(p, c)] as f32)),
            black: std::array::from_fn(|p| self.black[p] as f32),
            per_noise: noise.map(|n| (1.0 / n) as f32),
        }
    }
}
