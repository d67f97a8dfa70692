//! Appearance of one tool's edges in one recording, learned while tracking: blur, light inside, noise of each plane.
//!
//! **In** the edge fits along every accepted tube ([`EdgeModel::learn`]). **Out** the expected appearance of the next
//! frame's edges. **Method** Lens blur is learned from the residuals at the band's ends, chroma blur from those at its
//! borders, each by a Kalman filter with one state. The light inside each part of the outline is a mean over recent
//! edges; noise follows the median. All tools of a recording decide together where the chroma samples lie
//! ([`super::chroma_siting`]) and how long the camera exposes ([`super::exposure`]).

use nalgebra::{Matrix3, Vector2, Vector3};

use super::chroma_siting::{ChromaRight, ChromaRightEstimator};
use super::edge_fit::{EdgeAppearance, EdgeFit, InsideLight};
use super::equations::LearnedParameter;
use super::exposure::ExposureEvidence;
use super::probe::{FittedEdge, Probe, Shading};
use super::scalar_filter::ScalarFilter;
use super::tone;
use super::usual_light::UsualInside;
use crate::vision::frame::{ColourEncoding, Frame};
use crate::vision::segmentation::samples::UsualColour;
use crate::vision::tube::{BorderSide, OutlinePart, PerPart};

/// The planes that distinguish what is inside an edge from what is outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Likeness {
    /// Both chroma planes: coloured tape, which light and shade make brighter or darker.
    Chroma,
    /// All planes: a bare shaft, which has no colour of its own.
    AllPlanes,
}

/// Appearance of edges in this recording: blur and noise of each plane, learned while tracking.
#[derive(Clone)]
pub struct EdgeModel {
    /// Blur of light by the lens: standard deviation, pixels.
    pub lens_px: f64,
    /// Variance of pixels about the model in Y, U, V, codes². The median over edges, so that creases and patterns
    /// beside some of them do not raise it.
    pub(super) noise: [f64; 3],
    /// The tape's usual codes.
    tape: Vector3<f64>,
    /// Usual distance of the tape's colour from that, codes.
    tape_spread: f64,
    pub(super) likeness: Likeness,
    encoding: ColourEncoding,
    codes_from_rgb: Matrix3<f64>,
    black: Vector3<f64>,
    /// Exposure time, s: the usual one until [`super::exposure`] has decided.
    pub exposure_s: f64,
    /// Additional blur of the chroma codes, pixels of luma per halving.
    pub(super) chroma_blur_px: f64,
    lens: ScalarFilter,
    chroma_blur: ScalarFilter,
    /// Per plane: number of edges, and number of those with more residual variance than the noise.
    noisier: [(f64, f64); 3],
    /// Usual light inside each part of the outline.
    inside: PerPart<UsualInside>,
    chroma_right: ChromaRightEstimator,
    /// How much farther right chroma samples lie than the frames say, pixels.
    pub(super) chroma_right_px: f32,
    /// Evidence of the exposure time, from edges that move fast.
    pub exposure_evidence: ExposureEvidence,
    frames: u32,
}

/// Mean light above this was partly cut off.
const OVEREXPOSED: f64 = 0.85;
/// Usual blur of a lens, pixels.
const USUAL_LENS_PX: f64 = 0.7;
/// Usual exposure time, s.
pub(super) const USUAL_EXPOSURE_S: f64 = 0.012;
/// Limits of the lens blur, pixels.
const LENSES_PX: (f64, f64) = (0.3, 4.0);
/// Additional blur of the chroma codes, in pixels of luma per halving. The mean of two pixels has 0.5; compression
/// adds a little.
const USUAL_CHROMA_BLUR_PX: f64 = 0.8;
/// Limits of that blur.
const CHROMA_BLURS_PX: (f64, f64) = (0.1, 1.5);

impl EdgeModel {
    /// A model for tape or a shaft of this colour; blur and noise start at usual values and are learned.
    pub fn new(tape: UsualColour, likeness: Likeness, encoding: ColourEncoding) -> Self {
        let codes_from_rgb = encoding.codes_from_rgb();
        let tape_spread = match likeness {
            Likeness::Chroma => tape.chroma_spread,
            Likeness::AllPlanes => tape.luma_spread.hypot(tape.chroma_spread),
        };
        Self {
            lens_px: USUAL_LENS_PX,
            noise: [6.0, 3.0, 3.0],
            tape: Vector3::from(tape.codes),
            tape_spread,
            likeness,
            encoding,
            codes_from_rgb,
            black: Vector3::from(encoding.black()),
            exposure_s: USUAL_EXPOSURE_S,
            chroma_blur_px: USUAL_CHROMA_BLUR_PX,
            lens: ScalarFilter::new(0.3),
            chroma_blur: ScalarFilter::new(0.3),
            noisier: Default::default(),
            inside: Default::default(),
            chroma_right: ChromaRightEstimator::default(),
            chroma_right_px: 0.0,
            exposure_evidence: ExposureEvidence::default(),
            frames: 0,
        }
    }

    /// Expected appearance of an edge at a probe.
    pub(super) fn appearance(&self, probe: &Probe, chroma_halvings: u8) -> EdgeAppearance {
        EdgeAppearance {
            light_blur_px: self.light_blur_px(probe, self.exposure_s),
            lens_px: self.lens_px,
            chroma_blur_px: self.chroma_blur_px * f64::from(chroma_halvings),
            shading: probe.shading,
            learned_parameter: self.is_learning().then_some(if probe.shading == Shading::Cut {
                LearnedParameter::LightBlur
            } else {
                LearnedParameter::ChromaBlur
            }),
            codes_from_rgb: self.codes_from_rgb,
            black: self.black,
        }
    }

    /// The usual light inside this part of an outline, if known. At a tape's end, overexposed channels are taken from
    /// the limbs, where the same tape is less bright. Otherwise the end would seem to lie farther out the more it is
    /// blurred.
    pub(super) fn usual_inside(&self, part: OutlinePart) -> Option<[InsideLight; 3]> {
        let mut light = self.inside[part].known()?.light;
        /// Minimum light of the other channels to compare an end's brightness with the limbs', and limits of that
        /// ratio.
        const MIN_COMPARABLE: f64 = 0.05;
        const BRIGHTNESS_RATIOS: (f64, f64) = (0.5, 2.0);
        let overexposed = |l: &InsideLight| l.guessed > OVEREXPOSED;
        if let Some(facing) = self.facing_light().filter(|_| !part.is_border()) {
            let usable = light.iter().zip(facing).filter(|(l, _)| !overexposed(l));
            let (here, there) = usable.fold((0.0, 0.0), |sum, (l, facing)| (sum.0 + l.base, sum.1 + facing));
            let brighter = if there > MIN_COMPARABLE {
                (here / there).clamp(BRIGHTNESS_RATIOS.0, BRIGHTNESS_RATIOS.1)
            } else {
                1.0
            };
            for (l, facing) in light.iter_mut().zip(facing).filter(|(l, _)| overexposed(l)) {
                let expected = facing * brighter;
                if expected > l.base {
                    (l.base, l.limb) = (expected, 0.0);
                }
            }
        }
        Some(light)
    }

    /// Light of each channel where the tape faces the camera: the mean of both limbs.
    fn facing_light(&self) -> Option<[f64; 3]> {
        let [first, second] = BorderSide::BOTH.map(|side| self.inside[OutlinePart::Border(side)].known());
        let [one, other] = [first?, second?];
        Some(std::array::from_fn(|c| [one, other].map(|i| i.light[c].base + i.light[c].limb).iter().sum::<f64>() / 2.0))
    }

    /// Distance of a colour from the tape's, in the planes that distinguish it, codes.
    pub(super) fn off_tape(&self, codes: [f64; 3]) -> f64 {
        let off = Vector3::from(codes) - self.tape;
        match self.likeness {
            Likeness::Chroma => off.yz().norm(),
            Likeness::AllPlanes => off.norm(),
        }
    }

    /// The tape's usual chroma, codes.
    pub(super) fn usual_chroma(&self) -> [f64; 2] {
        [self.tape.y, self.tape.z]
    }

    /// Is this colour within the range of the tape's, on its lit and on its shaded side?
    pub(super) fn is_within_tape(&self, codes: [f64; 3]) -> bool {
        /// In standard deviations: nine of ten samples are nearer, with any distribution.
        const WITHIN: f64 = 3.0;
        self.off_tape(codes) < WITHIN * self.tape_spread
    }

    /// May this be the tape in shade? Codes of one surface lie on a straight line from black as the light changes, so
    /// in deep shade all surfaces look alike.
    pub(super) fn may_be_shaded_tape(&self, codes: [f64; 3]) -> bool {
        /// Share of the tape's usual luma below which its colour says little.
        const SHADED: f64 = 0.6;
        /// Three times the usual noise of a mean chroma, codes.
        const NEAR_CODES: f64 = 8.0;
        let [codes, tape] = [Vector3::from(codes), self.tape].map(|codes| codes - self.black);
        let share = codes.x / tape.x.max(1.0);
        share < SHADED && (codes - tape * share.max(0.0)).yz().norm() < NEAR_CODES
    }

    /// The light with these codes.
    pub(super) fn light(&self, codes: [f64; 3]) -> [f64; 3] {
        self.encoding.rgb_of_codes(codes).map(|code| tone::light(code.max(0.0))).into()
    }

    /// Blur of light across a probe: by the lens, and by motion during the exposure.
    pub(super) fn light_blur_px(&self, probe: &Probe, exposure_s: f64) -> f64 {
        let moved = probe.motion_px_s * exposure_s;
        (self.lens_px * self.lens_px + moved * moved / 12.0).sqrt() // a uniform blur of length a has variance a²/12
    }

    /// How much farther right edges lie in chroma than in luma; `None` until enough edges were seen. Shows where the
    /// chroma samples lie ([`super::chroma_siting::decide`]).
    pub fn chroma_right(&self) -> Option<ChromaRight> {
        self.chroma_right.estimate()
    }

    /// Sets how much farther right chroma samples lie than the frames say, pixels, from now on.
    pub fn set_chroma_right_px(&mut self, right_px: f32) {
        if right_px != self.chroma_right_px {
            self.chroma_right_px = right_px;
            self.inside = Default::default(); // learned with chroma elsewhere
        }
    }

    /// Updates blur and noise from the frame's evidence. Call once per frame.
    pub fn finish_frame(&mut self) {
        self.frames += 1;
        let pace = self.noise_rate();
        let within = |value: f64, (least, most): (f64, f64)| value.clamp(least, most);
        self.chroma_blur_px = within(self.chroma_blur.update(self.chroma_blur_px), CHROMA_BLURS_PX);
        self.lens_px = within(self.lens.update(self.lens_px), LENSES_PX);
        for (noise, (edges, noisier)) in self.noise.iter_mut().zip(std::mem::take(&mut self.noisier)) {
            if edges > 0.0 {
                let lean = (noisier - 0.5 * edges) / edges; // 0 where the noise is the median
                *noise = (*noise * (4.0 * pace * lean).exp()).clamp(0.3, 400.0);
            }
        }
    }

    /// Adds edges to the evidence: those of the measured tube, which moves by `motion_px_s` in the picture, pixels/s.
    /// Edges along a false tube would teach the model to find that tube again.
    pub fn learn(&mut self, frame: &Frame<'_>, edges: &[FittedEdge], motion_px_s: Vector2<f64>) {
        if self.is_learning() {
            let mut evidence = self.exposure_evidence;
            evidence.add(self, frame, edges, motion_px_s);
            self.exposure_evidence = evidence;
        }
        for FittedEdge { probe, fit } in edges {
            self.learn_from(fit, frame, probe);
        }
    }

    fn learn_from(&mut self, fit: &EdgeFit, frame: &Frame<'_>, probe: &Probe) {
        let mut trial = std::mem::take(&mut self.chroma_right);
        trial.observe(self, frame, probe, fit);
        self.chroma_right = trial;
        let usual = fit.variance.iter().zip(&self.noise).all(|(variance, noise)| *variance < 6.0 * noise);
        if usual && fit.information > 1.0 {
            self.inside[probe.part].learn(fit);
        }
        if probe.shading == Shading::Cut {
            let blur = self.light_blur_px(probe, self.exposure_s);
            let (gradient, information) = fit.learned_evidence;
            let lens = self.lens_px / blur; // the variances of lens and motion blur add up
            self.lens.add_evidence(gradient * lens, information * lens * lens);
        } else if frame.shift_x > 0 {
            let halvings = f64::from(frame.shift_x);
            self.chroma_blur
                .add_evidence(fit.learned_evidence.0 * halvings, fit.learned_evidence.1 * halvings * halvings);
        }
        for ((seen, variance), noise) in self.noisier.iter_mut().zip(fit.variance).zip(self.noise) {
            *seen = (seen.0 + 1.0, seen.1 + f64::from(u8::from(variance > noise)));
        }
    }

    /// Is blur learned on this frame? At first on all frames, later on some.
    fn is_learning(&self) -> bool {
        const ALL_UNTIL: u32 = 40;
        const THEN_EVERY: u32 = 4;
        self.frames < ALL_UNTIL || self.frames.is_multiple_of(THEN_EVERY)
    }

    /// Learning rate of the noise: fast at first, later a mean over the last fifty frames.
    fn noise_rate(&self) -> f64 {
        f64::max(0.02, 1.0 / (f64::from(self.frames) + 3.0))
    }
}
