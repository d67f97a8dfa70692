//! How edges look in one recording, learned while tracking: blur, noise of each plane, exposure.
//!
//! **In** the fits of the edges along every tube that is believed ([`EdgeModel::learn`]). **Out** what the next frame's
//! edges are expected to look like. **Method** lens and exposure follow the gradient of the residuals at the band's ends, the
//! blur of chroma that at its borders, each by a Kalman filter of one state; light inside each part of the outline is a mean
//! over its last edges; noise follows the median; whether light or codes were mixed, all tools of a recording tell together
//! ([`super::mixing`]).

use std::ops::Range;

use nalgebra::{Matrix3, Vector2, Vector3};

use super::edge_fit::{EdgeFit, EdgeLook, InsideLight};
use super::equations::Taught;
use super::mixing::Trial;
use super::probe::{Probe, Shading};
use super::tone::{Mixing, Tone};
use crate::pipeline::frame::{ColourEncoding, Frame};

/// How edges look in this recording: blur and noise of each plane, learned while tracking.
#[derive(Clone)]
pub struct EdgeModel {
    /// Blur of light by the lens: standard deviation, pixels.
    pub lens_px: f64,
    /// Variance of pixels about the model in Y, U, V, codes²: the median of the edges', which creases and patterns beside
    /// some of them do not raise.
    pub(super) noise: [f64; 3],
    /// The tape's usual chroma, codes.
    pub(super) tape: Vector2<f64>,
    /// What blur mixes.
    pub mixing: Mixing,
    encoding: ColourEncoding,
    codes_from_rgb: Matrix3<f64>,
    black: Vector3<f64>,
    /// How long the shutter is open, s; learned from how much moving edges are smeared.
    pub exposure_s: f64,
    /// Blur of chroma's codes beyond that of light, pixels of luma per halving.
    pub(super) chroma_blur_px: f64,
    lens: Learned,
    chroma_blur: Learned,
    exposure: Learned,
    /// Edges, and those among them whose residuals exceed the noise, plane by plane.
    noisier: [(f64, f64); 3],
    /// Light inside each of the outline's parts, as it usually is.
    inside: [UsualInside; 4],
    trial: Trial,
    frames: u32,
    /// Edges of this frame.
    pub(super) found: Vec<(Probe, EdgeFit)>,
}

/// What is known of a number that a recording teaches: a Kalman filter of one state.
#[derive(Clone, Copy, Debug)]
struct Learned {
    /// Variance of the number now, and before anything was seen.
    variance: f64,
    usual_variance: f64,
    gradient: f64,
    information: f64,
}

impl Learned {
    /// Share of the evidence that is believed: the edges of a frame, and of the next, err alike.
    const TRUST: f64 = 0.2;
    /// Frames after which a number may be another by its usual spread.
    const MEMORY: f64 = 20_000.0;

    fn new(sigma: f64) -> Self {
        Self { variance: sigma * sigma, usual_variance: sigma * sigma, gradient: 0.0, information: 0.0 }
    }

    /// Takes a gradient and its information into the evidence.
    fn see(&mut self, gradient: f64, information: f64) {
        self.gradient += gradient;
        self.information += information;
    }

    /// The number after all that was seen.
    fn settle(&mut self, value: f64) -> f64 {
        let (gradient, information) = (std::mem::take(&mut self.gradient), std::mem::take(&mut self.information));
        self.variance = 1.0 / (1.0 / self.variance + Self::TRUST * information);
        let step = self.variance * Self::TRUST * gradient;
        self.variance += self.usual_variance / Self::MEMORY;
        value + step
    }
}

/// Light inside one part of an outline: the mean of each channel, and over how many edges that was learned.
#[derive(Clone, Copy, Debug, Default)]
struct UsualInside {
    light: [InsideLight; 3],
    edges: f64,
}

impl UsualInside {
    /// Edges after which it is known.
    const ENOUGH: f64 = 8.0;
    /// Edges that it remembers.
    const MEMORY: f64 = 200.0;

    fn known(&self) -> Option<&Self> {
        (self.edges >= Self::ENOUGH).then_some(self)
    }

    fn learn(&mut self, fit: &EdgeFit) {
        self.edges = (self.edges + 1.0).min(Self::MEMORY);
        for (mean, told) in self.light.iter_mut().zip(fit.told()) {
            mean.base += (told.base - mean.base) / self.edges;
            mean.limb += (told.limb - mean.limb) / self.edges;
            mean.guessed += (told.guessed - mean.guessed) / self.edges;
        }
    }
}

/// The first parts of an outline are limbs, the others are ends.
const LIMBS: usize = 2;
/// Mean light from which some of it was cut off.
const OVEREXPOSED: f64 = 0.85;
/// Usual blur of a lens, pixels.
const USUAL_LENS_PX: f64 = 0.7;
/// Usual exposure, and how short and long one can be, s.
const USUAL_EXPOSURE_S: f64 = 0.012;
const EXPOSURES_S: (f64, f64) = (0.0005, 0.04);
/// How sharp and soft a lens can be, pixels.
const LENSES_PX: (f64, f64) = (0.3, 4.0);
/// Blur of chroma's codes beyond that of light, in pixels of luma per halving: the mean of two pixels has 0.5, and
/// compression takes a little.
const USUAL_CHROMA_BLUR_PX: f64 = 0.8;
/// How little and how much that can be.
const CHROMA_BLURS_PX: (f64, f64) = (0.1, 1.5);

impl EdgeModel {
    /// A model for tape of this mean colour (codes); blur and noise start at usual values and are learned.
    pub fn new(tape_yuv: [f64; 3], encoding: ColourEncoding) -> Self {
        let codes_from_rgb = encoding.codes_from_rgb();
        Self {
            lens_px: USUAL_LENS_PX,
            noise: [6.0, 3.0, 3.0],
            tape: Vector2::new(tape_yuv[1], tape_yuv[2]),
            mixing: Mixing::Light,
            encoding,
            codes_from_rgb,
            black: Vector3::from(encoding.black()),
            exposure_s: USUAL_EXPOSURE_S,
            chroma_blur_px: USUAL_CHROMA_BLUR_PX,
            lens: Learned::new(0.3),
            chroma_blur: Learned::new(0.3),
            exposure: Learned::new(0.5 * USUAL_EXPOSURE_S),
            noisier: Default::default(),
            inside: Default::default(),
            trial: Trial::default(),
            frames: 0,
            found: Vec::new(),
        }
    }

    /// How an edge at a probe is expected to look.
    pub(super) fn look(&self, probe: &Probe, chroma_halvings: u8) -> EdgeLook<'static> {
        self.look_in(self.mixing, probe, chroma_halvings)
    }

    /// The same if this was mixed.
    pub(super) fn look_in(&self, mixing: Mixing, probe: &Probe, chroma_halvings: u8) -> EdgeLook<'static> {
        EdgeLook {
            light_blur_px: self.light_blur_px(probe),
            lens_px: self.lens_px,
            chroma_blur_px: self.chroma_blur_px * f64::from(chroma_halvings),
            shading: probe.shading,
            taught: self.is_learning().then_some(if probe.shading == Shading::Cut {
                Taught::LightBlur
            } else {
                Taught::ChromaBlur
            }),
            tone: Tone::of(mixing),
            codes_from_rgb: self.codes_from_rgb,
            black: self.black,
        }
    }

    /// The light that usually lies inside this part of an outline, where it is known. What is overexposed at a tape's end is
    /// taken from the limbs, where the same tape turns into the shade: else the end would seem to lie farther out the more
    /// it is smeared.
    pub(super) fn usual_inside(&self, part: usize) -> Option<[InsideLight; 3]> {
        let mut light = self.inside[part].known()?.light;
        /// Light of the other channels that tells how bright an end is beside the limbs, and how much it may differ.
        const TELLS: f64 = 0.05;
        const BRIGHTER: (f64, f64) = (0.5, 2.0);
        let overexposed = |l: &InsideLight| l.guessed > OVEREXPOSED;
        if let Some(facing) = self.facing_light().filter(|_| part >= LIMBS) {
            let told = light.iter().zip(facing).filter(|(l, _)| !overexposed(l));
            let (here, there) = told.fold((0.0, 0.0), |sum, (l, facing)| (sum.0 + l.base, sum.1 + facing));
            let brighter = if there > TELLS { (here / there).clamp(BRIGHTER.0, BRIGHTER.1) } else { 1.0 };
            for (l, facing) in light.iter_mut().zip(facing).filter(|(l, _)| overexposed(l)) {
                let expected = facing * brighter;
                if expected > l.base {
                    (l.base, l.limb) = (expected, 0.0);
                }
            }
        }
        Some(light)
    }

    /// Light of each channel where the tape faces the camera, as both limbs have it.
    fn facing_light(&self) -> Option<[f64; 3]> {
        let [one, other] = [self.inside[0].known()?, self.inside[1].known()?];
        Some(std::array::from_fn(|c| [one, other].map(|i| i.light[c].base + i.light[c].limb).iter().sum::<f64>() / 2.0))
    }

    /// The light that has these codes, if this was mixed.
    pub(super) fn light(&self, mixing: Mixing, codes: [f64; 3]) -> [f64; 3] {
        let tone = Tone::of(mixing);
        self.encoding.rgb_of_codes(codes).map(|code| tone.light(code.max(0.0))).into()
    }

    /// Blur of light across a probe: the lens's, and the motion's during the exposure.
    fn light_blur_px(&self, probe: &Probe) -> f64 {
        let moved = probe.motion_px_s * self.exposure_s;
        (self.lens_px * self.lens_px + moved * moved / 12.0).sqrt() // a uniform smear of length a: variance a²/12
    }

    /// How much farther out its limbs lie in chroma than in luma if light was mixed, pixels, once enough were seen: tells what
    /// a recording mixed ([`super::mixing::of_recording`]).
    pub fn chroma_shift_px(&self) -> Option<f32> {
        self.trial.told_px()
    }

    /// From now on, this was mixed.
    pub fn believe(&mut self, mixing: Mixing) {
        if mixing != self.mixing {
            self.mixing = mixing;
            self.inside = Default::default(); // light of another kind
        }
    }

    /// Takes what the frame's edges taught of blur and noise into the model. Call once per frame.
    pub fn settle(&mut self) {
        self.found.clear();
        self.frames += 1;
        let pace = self.pace();
        let within = |value: f64, (least, most): (f64, f64)| value.clamp(least, most);
        self.exposure_s = within(self.exposure.settle(self.exposure_s), EXPOSURES_S);
        self.chroma_blur_px = within(self.chroma_blur.settle(self.chroma_blur_px), CHROMA_BLURS_PX);
        self.lens_px = within(self.lens.settle(self.lens_px), LENSES_PX);
        for (noise, (edges, noisier)) in self.noise.iter_mut().zip(std::mem::take(&mut self.noisier)) {
            if edges > 0.0 {
                let lean = (noisier - 0.5 * edges) / edges; // 0 where the noise is the median
                *noise = (*noise * (4.0 * pace * lean).exp()).clamp(0.3, 400.0);
            }
        }
    }

    /// How many edges of this frame have been found so far: they are counted to tell those of one tube from others.
    pub fn found(&self) -> usize {
        self.found.len()
    }

    /// Takes some of the edges that were found on this frame into the evidence: those of the tube that is believed. Edges
    /// along a false tube would teach what keeps it.
    pub fn learn(&mut self, frame: &Frame<'_>, believed: Range<usize>) {
        let found = std::mem::take(&mut self.found);
        for (probe, fit) in found.get(believed).unwrap_or_default() {
            self.learn_from(fit, frame, probe);
        }
        self.found = found;
    }

    fn learn_from(&mut self, fit: &EdgeFit, frame: &Frame<'_>, probe: &Probe) {
        let mut trial = std::mem::take(&mut self.trial);
        trial.look(self, frame, probe, fit);
        self.trial = trial;
        let usual = fit.variance.iter().zip(&self.noise).all(|(variance, noise)| *variance < 6.0 * noise);
        if usual && fit.information > 1.0 {
            self.inside[probe.part].learn(fit);
        }
        if probe.shading == Shading::Cut {
            let blur = self.light_blur_px(probe);
            let (gradient, information) = fit.taught;
            // Lens and motion blur add in squares; each learns by its own share of the whole.
            let (lens, motion) = (self.lens_px / blur, probe.motion_px_s.powi(2) * self.exposure_s / 12.0 / blur);
            self.lens.see(gradient * lens, information * lens * lens);
            self.exposure.see(gradient * motion, information * motion * motion);
        } else if frame.shift_x > 0 {
            let halvings = f64::from(frame.shift_x);
            self.chroma_blur.see(fit.taught.0 * halvings, fit.taught.1 * halvings * halvings);
        }
        for ((seen, variance), noise) in self.noisier.iter_mut().zip(fit.variance).zip(self.noise) {
            *seen = (seen.0 + 1.0, seen.1 + f64::from(u8::from(variance > noise)));
        }
    }

    /// Is this a frame of those that teach the blur? All are at first; later, some are enough.
    fn is_learning(&self) -> bool {
        const ALL_UNTIL: u32 = 40;
        const THEN_EVERY: u32 = 4;
        self.frames < ALL_UNTIL || self.frames.is_multiple_of(THEN_EVERY)
    }

    /// How far one frame moves the noise: quickly at first, then as a mean of the last fifty frames.
    fn pace(&self) -> f64 {
        f64::max(0.02, 1.0 / (f64::from(self.frames) + 3.0))
    }
}
