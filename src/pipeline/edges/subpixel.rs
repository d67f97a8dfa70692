//! Where exactly an edge lies: a model of the blurred border of a lit tube, fitted to raw pixels.
//!
//! **In** a [`Probe`]: a short chord of a predicted border with its outward normal, ± a few pixels. **Out** how far the
//! edge lies from it along the normal, with its standard deviation, pixels.
//!
//! **Method.** In every plane (Y, U, V) the light across a border is `out + shadow·distance` outside and
//! `in + shade·√depth` inside, the first term of a Lambertian cylinder's fall-off near its limb, all blurred by a Gaussian
//! of the plane's own width. Without the shade term the limb's darkening would pull the border inwards by up to a pixel;
//! without the shadow term the soft shadow beside a tube pushes it outwards by 0.4 pixel. One offset is shared by the
//! three planes, so that whichever has contrast decides; the rest are linear and eliminated. Pixels are used where they
//! are, at their own distance from the chord: nothing is resampled, so noise stays white.
//!
//! **Assumes** that the background is even along one chord and changes steadily, if at all, across the window. **Gives
//! up** where no plane has contrast, where the offset leaves the window, or where the inside is less like the tape than
//! the outside.

use std::sync::LazyLock;

use nalgebra::{Matrix3, Matrix4, SMatrix, Vector2, Vector3};

use super::edge_curves::{EDGE_CURVES, EdgeCurves};
use super::light::LightSpill;
use super::plane_samples::{LANES, PlaneSamples, gather};
use crate::pipeline::frame::{ColourEncoding, Frame};
use crate::pipeline::space::Pixel;

/// Where to look for an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// Middle of the chord.
    pub middle: Pixel,
    /// Unit normal, out of the tube.
    pub outward: Vector2<f64>,
    /// Half the chord's length, pixels.
    pub half_length_px: f64,
    /// How far to look inwards, pixels.
    pub inwards_px: f64,
    /// How far to look outwards, pixels.
    pub outwards_px: f64,
    /// Speed across the chord, along the normal, pixels/s.
    pub motion_px_s: f64,
    /// How the surface inside shades towards the edge.
    pub shading: Shading,
}

/// How a surface shades towards its edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shading {
    /// A round one that turns away from the camera: a tube of this radius in the picture, pixels.
    Limb {
        /// Radius, pixels.
        radius_px: f64,
    },
    /// One that ends without turning away: a tape's end. Light changes steadily towards it.
    Cut,
}

/// An edge found at a probe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Distance from the probe's chord along its normal, pixels.
    pub offset_px: f64,
    /// Standard deviation of that, pixels: from the noise, and from what the model leaves out.
    pub sigma_px: f64,
}

/// How edges look in this recording: blur and noise of each plane, learned while tracking.
#[derive(Clone)]
pub struct EdgeModel {
    curves: &'static EdgeCurves,
    /// Blur of Y, U, V: standard deviation, pixels.
    pub blur_px: [f64; 3],
    /// Variance of pixels about the model in Y, U, V, codes²: the median of the edges', which creases and patterns beside
    /// some of them do not raise.
    noise: [f64; 3],
    /// The tape's usual chroma, codes.
    tape: Vector2<f64>,
    evidence: [BlurEvidence; 3],
    spill: &'static LightSpill,
    codes_from_rgb: Matrix3<f64>,
    encoding: ColourEncoding,
    /// What the recording's maker decides and no file says; learned.
    habits: Habits,
    /// How long the shutter is open, s; learned from how much moving edges are smeared.
    pub exposure_s: f64,
    exposure_evidence: (f64, f64),
    frames: u32,
    habit_evidence: (Matrix3<f64>, Vector3<f64>),
}

/// `[strength of the light's spill (0: blurred codes, 1: blurred light), shift of chroma samples in x, in y (pixels)]`.
type Habits = Vector3<f64>;

/// Usual habits, and how far from them a recording may be. Chroma lies between its pixels, or on the left one.
const USUAL_HABITS: [f64; 3] = [0.7, 0.0, 0.0];
const HABIT_SPREAD: [f64; 3] = [0.5, 0.3, 0.2];
/// Share of the evidence on each habit that is believed. Where chroma lies must not be learned from what gloss, shade and
/// compression move it by: those last as long as a scene does, so that all of a frame's edges tell no more than a few.
const HABIT_TRUST: [f64; 3] = [1.0, 1e-3, 1e-3];

#[derive(Clone, Copy, Debug, Default)]
struct BlurEvidence {
    gradient: f64,
    information: f64,
    /// Edges, and those among them whose residuals exceed the noise.
    probes: f64,
    noisier: f64,
}

static LIGHT_SPILL: LazyLock<LightSpill> = LazyLock::new(LightSpill::new);

/// Usual exposure, and how short and long one can be, s.
const USUAL_EXPOSURE_S: f64 = 0.008;
const EXPOSURES_S: (f64, f64) = (0.0005, 0.04);

/// Where a plain step is tried.
const STEPS_PER_PX: f64 = 2.0;
const MOST_STEPS: usize = 40;
/// Softest edge that still tells where it is, pixels.
const WORST_SIGMA_PX: f64 = 1.0;
/// Farthest that the finer model may move from the sharpest plain step, pixels.
const FARTHEST_FROM_STEP_PX: f64 = 1.3;
/// Depth inside a cut edge over which its shading is counted, pixels.
const CUT_DEPTH_PX: f64 = 10.0;
/// What the model leaves out (texture, creases, gloss, compression, how colours mix) moves an edge as the noise does, the
/// more the less contrast it has, but by so many times as much: from edges about true outlines, over scenes of three
/// renderers.
const MODEL_ERROR: f64 = 3.0;
/// How much the background may brighten or darken outwards, codes/pixel: tubes throw soft shadows beside themselves.
const SHADOW_SLOPE: f64 = 3.0;
impl EdgeModel {
    /// A model for tape of this mean colour (codes); blur and noise start at usual values and are learned.
    pub fn new(tape_yuv: [f64; 3], encoding: ColourEncoding) -> Self {
        Self {
            curves: &EDGE_CURVES,
            blur_px: [0.9, 1.3, 1.3],
            noise: [6.0, 3.0, 3.0],
            tape: Vector2::new(tape_yuv[1], tape_yuv[2]),
            evidence: Default::default(),
            spill: &LIGHT_SPILL,
            codes_from_rgb: encoding.codes_from_rgb(),
            encoding,
            habits: Vector3::from(USUAL_HABITS),
            exposure_s: USUAL_EXPOSURE_S,
            exposure_evidence: (0.0, 0.0),
            frames: 0,
            habit_evidence: Default::default(),
        }
    }

    /// Moves onto the edge near a probe; `is_tape` tells whether codes are the tape's colour.
    pub fn locate(&mut self, frame: &Frame<'_>, probe: &Probe, is_tape: impl Fn([u8; 3]) -> bool) -> Option<Edge> {
        let blur = self.blur_of(probe);
        let mut samples = [PlaneSamples::default(); 3];
        let chroma_shift = self.habits[1] * probe.outward.x + self.habits[2] * probe.outward.y;
        let (luma, chroma) = samples.split_at_mut(1);
        gather([&frame.y], (0, 0), probe, 0.0, luma);
        gather([&frame.u, &frame.v], (frame.shift_x, frame.shift_y), probe, chroma_shift, chroma);
        samples.iter_mut().for_each(PlaneSamples::complete);
        let mut spill = Vector3::zeros();
        let guess = self.sharpest_step(&samples, probe)?;
        let mut offset = guess;
        let mut fits = [PlaneFit::default(); 3];
        let mut information = 0.0;
        for pass in 0..4 {
            let mut gradient = 0.0;
            information = 0.0;
            for plane in 0..3 {
                fits[plane] = self.fit_plane(
                    blur[plane],
                    &samples[plane],
                    offset,
                    probe.shading,
                    self.habits[0] * spill[plane],
                    self.noise[plane] / (SHADOW_SLOPE * SHADOW_SLOPE),
                )?;
                let noise = self.noise[plane].max(fits[plane].variance());
                gradient += fits[plane].step * fits[plane].gradient / noise;
                information += fits[plane].step.powi(2) * fits[plane].information / noise;
            }
            spill = self.spill_of(&fits, blur[0]);
            if information < 1.0 / (WORST_SIGMA_PX * WORST_SIGMA_PX) {
                return None;
            }
            let step = (gradient / information).clamp(-1.0, 1.0);
            offset += step;
            if (offset - guess).abs() > FARTHEST_FROM_STEP_PX {
                return None; // another optimum, where the shading stands in for the edge
            }
            if pass > 0 && step.abs() < 0.02 {
                break; // the first pass knew no spill yet
            }
        }
        let off_tape =
            |height: fn(&PlaneFit) -> f64| (Vector2::new(height(&fits[1]), height(&fits[2])) - self.tape).norm();
        if off_tape(|fit| fit.outside + fit.step + 0.5 * fit.shade) >= off_tape(|fit| fit.outside) {
            return None; // the outside looks more like the tape than the inside: another edge
        }
        if is_tape(fits.map(|f| f.outside.round().clamp(0.0, 255.0) as u8)) {
            return None; // tape on both sides: a highlight or a crease
        }
        self.learn(&fits, &blur, probe.motion_px_s);
        self.learn_habits(&fits, spill, probe.outward);
        Some(Edge { offset_px: offset, sigma_px: MODEL_ERROR / information.sqrt() })
    }

    /// Where one plain step explains the samples best, to half a pixel: the start, so that the finer model cannot settle
    /// where its shading term imitates the edge.
    fn sharpest_step(&self, samples: &[PlaneSamples; 3], probe: &Probe) -> Option<f64> {
        let first = ((1.0 - probe.inwards_px) * STEPS_PER_PX).ceil();
        let count = ((probe.outwards_px - 1.0) * STEPS_PER_PX).floor() - first + 1.0;
        let mut explained = [0.0; MOST_STEPS];
        let explained = &mut explained[..(count.max(0.0) as usize).min(MOST_STEPS)];
        for (plane, noise) in samples.iter().zip(&self.noise) {
            explain_by_step(plane, first as f32, 1.0 / *noise as f32, explained);
        }
        let (best, _) = explained.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
        Some((first + best as f64) / STEPS_PER_PX)
    }

    /// Blur of the three planes across a probe: the lens's, and the motion's during the exposure.
    fn blur_of(&self, probe: &Probe) -> [f64; 3] {
        let moved = probe.motion_px_s * self.exposure_s;
        self.blur_px.map(|lens| (lens * lens + moved * moved / 12.0).sqrt()) // a uniform smear of length a: variance a²/12
    }

    /// Takes what the frame's edges said of blur and noise into the model. Call once per frame.
    pub fn settle(&mut self) {
        self.frames += 1;
        self.settle_habits();
        let (gradient, information) = std::mem::take(&mut self.exposure_evidence);
        if information > 0.0 {
            let (least, longest) = EXPOSURES_S;
            let step = gradient / (information + 1.0 / USUAL_EXPOSURE_S.powi(2));
            let step = step.clamp(-USUAL_EXPOSURE_S, USUAL_EXPOSURE_S) * self.pace().max(0.05);
            self.exposure_s = (self.exposure_s + step).clamp(least, longest);
        }
        let pace = self.pace();
        for plane in 0..3 {
            let seen = std::mem::take(&mut self.evidence[plane]);
            if seen.information > 400.0 {
                let step = (seen.gradient / seen.information).clamp(-0.2, 0.2);
                self.blur_px[plane] = (self.blur_px[plane] + pace * step).clamp(0.4, 4.0);
            }
            if seen.probes > 0.0 {
                let lean = (seen.noisier - 0.5 * seen.probes) / seen.probes; // 0 where the noise is the median
                self.noise[plane] = (self.noise[plane] * (4.0 * pace * lean).exp()).clamp(0.3, 400.0);
            }
        }
    }

    /// The light's surplus along an edge between the colours that the planes show on both sides: codes times pixels.
    fn spill_of(&self, fits: &[PlaneFit; 3], blur_px: f64) -> Vector3<f64> {
        let outside = fits.map(|f| f.outside);
        let inside = fits.map(|f| f.outside + f.step);
        let surplus = self.spill.between(self.encoding.rgb_of_codes(inside), self.encoding.rgb_of_codes(outside));
        self.codes_from_rgb * surplus * blur_px
    }

    /// What the three planes disagree on tells how the recording was made: each habit moves the edge in each plane by
    /// another amount, while the edge itself moves all alike and is eliminated.
    fn learn_habits(&mut self, fits: &[PlaneFit; 3], spill: Vector3<f64>, outward: Vector2<f64>) {
        let mut own = Matrix3::zeros();
        let (mut cross, mut right) = (Vector3::zeros(), Vector3::zeros());
        let (mut edge_own, mut edge_right) = (0.0, 0.0);
        for (plane, fit) in fits.iter().enumerate() {
            if fit.variance() > 6.0 * self.noise[plane] {
                return;
            }
            let shifted = if plane > 0 { -fit.step } else { 0.0 };
            let by = Vector3::new(spill[plane], shifted * outward.x, shifted * outward.y);
            let (weight, gradient) = (fit.information / self.noise[plane], fit.gradient / self.noise[plane]);
            own += by * by.transpose() * weight;
            cross += by * (fit.step * weight);
            right += by * gradient;
            edge_own += fit.step * fit.step * weight;
            edge_right += fit.step * gradient;
        }
        if edge_own > 0.0 {
            self.habit_evidence.0 += own - cross * cross.transpose() / edge_own;
            self.habit_evidence.1 += right - cross * (edge_right / edge_own);
        }
    }

    /// How far one frame moves what was learned: quickly at first, then as a mean of the last fifty frames.
    fn pace(&self) -> f64 {
        f64::max(0.02, 1.0 / (f64::from(self.frames) + 3.0))
    }

    fn settle_habits(&mut self) {
        let (information, gradient) = std::mem::take(&mut self.habit_evidence);
        let trust = Vector3::from(HABIT_TRUST);
        let gradient = gradient.component_mul(&trust);
        let root = Matrix3::from_diagonal(&trust.map(f64::sqrt));
        let information = root * information * root;
        let prior = Matrix3::from_diagonal(&Vector3::from(HABIT_SPREAD.map(|s| 1.0 / (s * s))));
        let pull = prior * (Vector3::from(USUAL_HABITS) - self.habits);
        if let Some(step) = (information + prior).try_inverse().map(|inverse| inverse * (gradient + pull)) {
            self.habits += step.map(|c| c.clamp(-0.3, 0.3)) * self.pace();
        }
    }

    fn learn(&mut self, fits: &[PlaneFit; 3], blur: &[f64; 3], motion_px_s: f64) {
        let by_exposure = motion_px_s * motion_px_s * self.exposure_s / 12.0;
        for (plane, fit) in fits.iter().enumerate() {
            let seen = &mut self.evidence[plane];
            let variance = fit.variance();
            if variance < 6.0 * self.noise[plane] {
                let (gradient, information) =
                    (fit.blur_gradient / self.noise[plane], fit.blur_information / self.noise[plane]);
                // Lens and motion blur add in squares; each learns by its own share of the whole.
                let (lens, motion) = (self.blur_px[plane] / blur[plane], by_exposure / blur[plane]);
                seen.gradient += gradient * lens;
                seen.information += information * lens * lens;
                self.exposure_evidence.0 += gradient * motion;
                self.exposure_evidence.1 += information * motion * motion;
            }
            seen.probes += 1.0;
            seen.noisier += f64::from(u8::from(variance > self.noise[plane]));
        }
    }

    /// One plane's linear least squares at a fixed offset, and what its residuals say of a bump along the edge: moving
    /// the edge, shifting the plane and spilling light are all such bumps. `evenness` is the weight, in samples, of the
    /// belief that the background does not change outwards.
    fn fit_plane(
        &self,
        blur: f64,
        samples: &PlaneSamples,
        offset: f64,
        shading: Shading,
        spill: f64,
        evenness: f64,
    ) -> Option<PlaneFit> {
        let gram = self.gram_of(blur, samples, offset, shading, spill);
        let count = samples.len as f64;
        if count < 8.0 {
            return None;
        }
        let mut normal: Matrix4<f64> = gram.fixed_view::<4, 4>(0, 0).into_owned();
        normal[(2, 2)] += 1e-3 * count; // keeps the shade term bounded where the window is short
        normal[(3, 3)] += evenness;
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
    fn gram_of(
        &self,
        blur: f64,
        samples: &PlaneSamples,
        offset: f64,
        shading: Shading,
        spill: f64,
    ) -> SMatrix<f64, 7, 7> {
        let (limb, radius_px) = match shading {
            Shading::Limb { radius_px } => (1.0, radius_px),
            Shading::Cut => (0.0, CUT_DEPTH_PX),
        };
        let [offset, per_px, in_radii, blur_px] = [offset, 1.0 / blur, blur / radius_px, blur].map(|c| c as f32);
        let [limb_scale, cut_scale] =
            [limb * (2.0 * blur / radius_px).sqrt(), (1.0 - limb) * blur / CUT_DEPTH_PX].map(|c| c as f32);
        const FARTHEST: f32 = 1e4; // in standard deviations; beyond are those that only fill the last chunk
        let mut products = [[[0.0f32; LANES]; 7]; 7];
        for (distances, values) in samples.chunks() {
            let z = distances.map(|distance| (distance - offset) * per_px);
            let curves = z.map(|z| self.curves.at(z));
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
        gram.set_column(6, &(value - bump * spill));
        gram[(6, 6)] -= spill * gram[(4, 6)];
        gram
    }
}

/// Adds for each place of a step, from `first` outwards, how much two means explain, inside and outside of it, times
/// `weight`.
fn explain_by_step(samples: &PlaneSamples, first: f32, weight: f32, into: &mut [f32]) {
    let mut between = [(0.0f32, 0.0f32); MOST_STEPS + 1]; // count and sum of the samples before each place
    for (distance, value) in samples.pairs() {
        let place = (distance * STEPS_PER_PX as f32 - first + 1.0).clamp(0.0, into.len() as f32) as usize;
        between[place] = (between[place].0 + 1.0, between[place].1 + value);
    }
    let total: f32 = between.iter().map(|b| b.1).sum();
    let (mut count, mut sum) = (0.0, 0.0);
    for (explained, (own_count, own_sum)) in into.iter_mut().zip(between) {
        (count, sum) = (count + own_count, sum + own_sum);
        let outside = total - sum;
        let others = samples.len as f32 - count;
        *explained += weight * (sum * sum / f32::max(count, 1.0) + outside * outside / f32::max(others, 1.0));
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct PlaneFit {
    outside: f64,
    step: f64,
    shade: f64,
    gradient: f64,
    information: f64,
    blur_gradient: f64,
    blur_information: f64,
    squares: f64,
    freedom: f64,
}

impl PlaneFit {
    fn variance(&self) -> f64 {
        self.squares / self.freedom.max(1.0)
    }
}

#[cfg(test)]
mod tests;
