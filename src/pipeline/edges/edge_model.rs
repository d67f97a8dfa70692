//! How edges look in one recording, learned while tracking: blur and noise of each plane, exposure, and what the
//! recording's maker decides and no file says.
//!
//! **In** the fits of every edge that was found ([`EdgeModel::learn`]). **Out** what the next frame's edges are expected to
//! look like. **Method** each learned value follows the gradient of the residuals (Gauss–Newton), quickly at first, then as a
//! mean of the last fifty frames; noise follows the median.

use std::sync::LazyLock;

use nalgebra::{Matrix3, Vector2, Vector3};

use super::light::LightSpill;
use super::plane_fit::PlaneFit;
use super::probe::Probe;
use crate::pipeline::frame::ColourEncoding;

/// How edges look in this recording: blur and noise of each plane, learned while tracking.
#[derive(Clone)]
pub struct EdgeModel {
    /// Blur of Y, U, V: standard deviation, pixels.
    pub blur_px: [f64; 3],
    /// Variance of pixels about the model in Y, U, V, codes²: the median of the edges', which creases and patterns beside
    /// some of them do not raise.
    pub(super) noise: [f64; 3],
    /// The tape's usual chroma, codes.
    pub(super) tape: Vector2<f64>,
    evidence: [BlurEvidence; 3],
    spill: &'static LightSpill,
    codes_from_rgb: Matrix3<f64>,
    encoding: ColourEncoding,
    /// What the recording's maker decides and no file says; learned.
    pub(super) habits: Habits,
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
const HABIT_TRUST: [f64; 3] = [0.03, 1e-3, 1e-3];

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

impl EdgeModel {
    /// A model for tape of this mean colour (codes); blur and noise start at usual values and are learned.
    pub fn new(tape_yuv: [f64; 3], encoding: ColourEncoding) -> Self {
        Self {
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

    /// How far chroma samples lie from where they are taken to, along a direction, pixels.
    pub(super) fn chroma_shift(&self, along: Vector2<f64>) -> f64 {
        self.habits[1] * along.x + self.habits[2] * along.y
    }

    /// How far blur mixes light (1) and not codes (0).
    pub(super) fn light_strength(&self) -> f64 {
        self.habits[0]
    }

    /// Blur of the three planes across a probe: the lens's, and the motion's during the exposure.
    pub(super) fn blur_of(&self, probe: &Probe) -> [f64; 3] {
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
    pub(super) fn spill_of(&self, fits: &[PlaneFit; 3], blur_px: f64) -> Vector3<f64> {
        let outside = fits.map(|f| f.outside);
        let inside = fits.map(|f| f.outside + f.step);
        let surplus = self.spill.between(self.encoding.rgb_of_codes(inside), self.encoding.rgb_of_codes(outside));
        self.codes_from_rgb * surplus * blur_px
    }

    /// Takes the fits of an edge that was found into the evidence.
    pub(super) fn learn(&mut self, fits: &[PlaneFit; 3], blur: &[f64; 3], spill: Vector3<f64>, probe: &Probe) {
        self.learn_blur(fits, blur, probe.motion_px_s);
        self.learn_habits(fits, spill, probe.outward);
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

    fn learn_blur(&mut self, fits: &[PlaneFit; 3], blur: &[f64; 3], motion_px_s: f64) {
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
}
