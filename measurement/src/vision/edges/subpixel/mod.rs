//! Locates an edge to a fraction of a pixel: fits a model of the blurred border of a lit tube to raw pixels.
//!
//! **In** a [`Probe`]: a short chord of a predicted border with its outward normal, ± a few pixels. **Out** the
//! distance of the edge from the chord along the normal, with its standard deviation, pixels.
//!
//! **Method.** First to half a pixel: the position where a plain step explains the pixels best ([`Fineness::Step`]).
//! Then the light on both sides, mixed by lens and motion and encoded by the camera, is fitted to the pixels of all
//! three planes at once ([`super::edge_fit`]), so that any plane with contrast contributes. The light inside starts
//! from the learned light of that part of the outline, which is also known where the tape is overexposed.
//!
//! **Assumes** that the background is even along one chord, and changes steadily, if at all, across the window.
//! **Gives up** if no plane has contrast, if the offset leaves the window, or if the inside is less like the tape than
//! the outside.

use nalgebra::Vector3;

use super::edge_fit::{EdgeFit, LIMB_INSIDE};
use super::edge_model::{EdgeModel, Likeness};
use super::probe::{LocatedEdge, Probe};
use super::profile::{self, Profile};
use crate::vision::frame::Frame;
use crate::vision::segmentation::shaft_evidence;

/// Positions tried for a plain step.
const STEPS_PER_PX: f64 = 2.0;
const MAX_STEPS: usize = 40;
/// Maximum standard deviation of an edge that is kept, pixels.
const MAX_SIGMA_PX: f64 = 1.0;
/// Maximum distance between the finer model's result and the best plain step, pixels.
const MAX_FROM_STEP_PX: f64 = 1.3;
/// Factor from noise alone to all errors. What the model leaves out (texture, creases, gloss, compression, colour
/// mixing) shifts an edge as noise does, more at low contrast, but this many times as much. Measured on edges about
/// true outlines, over scenes of three renderers.
const MODEL_ERROR: f64 = 3.0;
/// Maximum number of passes of the finer model: it is nearly linear.
const MAX_PASSES: usize = 8;

/// If the colour inside an edge is not classified as tape, its distance from the tape's colour must be less than this
/// share of the distance outside. Over 24 clips, most of them of trembling hands, this gave a sixth less error than a
/// factor of 1.
const SURELY_NEARER: f64 = 0.5;

/// Precision of the search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fineness {
    /// To half a pixel: the position where a step explains the pixels best.
    Step,
    /// To a fraction of a pixel.
    Fine,
}

/// Standard deviation of an edge found as a step, pixels.
const STEP_SIGMA_PX: f64 = 0.7;

impl EdgeModel {
    /// Locates the edge near a probe; `is_tape` returns whether codes have the tape's colour.
    pub fn locate(
        &self,
        frame: &Frame<'_>,
        probe: &Probe,
        fineness: Fineness,
        is_tape: impl Fn([u8; 3]) -> bool,
    ) -> Option<LocatedEdge> {
        let luma = profile::of_luma(frame, probe);
        let chroma = profile::of_chroma(frame, self.chroma_right_px, probe);
        let guess = self.sharpest_step(&luma, &chroma, probe)?;
        let look = self.appearance(probe, frame.shift_x);
        let mut first = self.first_guess(&luma, &chroma, guess, probe)?;
        if let Some(usual) = self.usual_inside(probe.part) {
            first.set_usual_inside(usual);
        }
        if self.likeness == Likeness::AllPlanes {
            first.expect_mirror(probe.shading);
        }
        let usual = self.usual_inside(probe.part).map(|light| look.codes(light.map(|l| l.base + LIMB_INSIDE * l.limb)));
        let off_tape = |codes: [f64; 3]| self.off_tape(codes);
        let is_border = |fit: &EdgeFit| {
            let [inside, outside] = [fit.mean_inside(), fit.outside()].map(|light| look.codes(light));
            let is_tape = |codes: [f64; 3]| is_tape(codes.map(|code| code.round().clamp(0.0, 255.0) as u8));
            // Otherwise there is no tape inside (the edge of a shadow or of the mat's print), or tape on both sides (a
            // highlight or a crease). Glare and shade can hide the tape's colour; then the inside must look as this
            // part of the outline usually does.
            let is_usual = || {
                usual.is_none_or(|usual| {
                    colour_distance(inside, usual) < SURELY_NEARER * colour_distance(outside, usual)
                })
            };
            let is_nearer = || off_tape(inside) < off_tape(outside);
            let is_surely_nearer = || off_tape(inside) < SURELY_NEARER * off_tape(outside);
            let is_inside = if is_tape(inside) {
                is_nearer() || self.is_within_tape(inside)
            } else {
                is_nearer() && (is_surely_nearer() || is_usual())
            };
            match self.likeness {
                Likeness::Chroma => (is_inside || self.may_be_shaded_tape(inside)) && !is_tape(outside),
                // The limbs of a shaft are darker than its middle, and its usual colour includes highlights. So what
                // may be the shaft is one if it is darker or greyer than the outside, as its borders are (METHOD 3.6).
                // A dark shaft before a dark box: both sides look like a shaft, and the inside is the nearer one.
                Likeness::AllPlanes => {
                    let is_border = || shaft_evidence::contrast(inside, outside, self.usual_chroma()) >= 1.0;
                    let may_be_shaft = is_inside || is_tape(inside) || self.is_within_tape(inside);
                    may_be_shaft && (is_nearer() || is_border())
                }
            }
        };
        if fineness == Fineness::Step {
            return is_border(&first).then_some(LocatedEdge { offset_px: guess, sigma_px: STEP_SIGMA_PX, fit: None });
        }
        let mut fit = first;
        let mut noise = self.noise;
        for pass in 0..MAX_PASSES {
            if pass > 1 {
                noise = std::array::from_fn(|p| self.noise[p].max(fit.variance[p])); // earlier, it reflects the guess
            }
            let moved = look.improve(&luma, &chroma, noise, &mut fit, &first)?;
            if (fit.offset_px - guess).abs() > MAX_FROM_STEP_PX * (1.5 * look.light_blur_px).max(1.0) {
                return None; // another optimum: the shading term imitates the edge
            }
            if pass > 0 && moved.abs() < f64::max(0.1, 0.2 * MODEL_ERROR / fit.information.sqrt()) {
                break;
            }
        }
        let surplus = fit.variance.iter().zip(noise).map(|(variance, noise)| variance / noise).sum::<f64>() / 3.0;
        fit.information /= surplus.max(1.0);
        if fit.information < 1.0 / (MAX_SIGMA_PX * MAX_SIGMA_PX) {
            return None;
        }
        if !is_border(&fit) {
            return None;
        }
        Some(LocatedEdge { offset_px: fit.offset_px, sigma_px: MODEL_ERROR / fit.information.sqrt(), fit: Some(fit) })
    }

    /// How much of the pixels' variance in all planes the best plain step within some pixels of a probe's chord
    /// explains: as a share of all, and of what the best step in the whole window explains.
    pub fn step_within(&self, frame: &Frame<'_>, probe: &Probe, near_px: f64) -> Option<[f64; 2]> {
        let luma = profile::of_luma(frame, probe);
        let chroma = profile::of_chroma(frame, self.chroma_right_px, probe);
        let weights = self.noise.map(|noise| 1.0 / noise as f32);
        let (_, explained) = best_step(&luma, &chroma, weights, probe, near_px)?;
        let all = variation(&luma, &weights[..1]) + variation(&chroma, &weights[1..]);
        let (_, most) = best_step(&luma, &chroma, weights, probe, f64::INFINITY)?;
        (all > 0.0 && most > 0.0).then(|| [f64::from(explained / all), f64::from(explained / most)])
    }

    /// First guess: the mean light on both sides of a guessed step.
    pub(super) fn first_guess(
        &self,
        luma: &Profile<1>,
        chroma: &Profile<2>,
        guess: f64,
        probe: &Probe,
    ) -> Option<EdgeFit> {
        let mut sums = [[(0.0f32, 0.0f32); 3]; 2];
        add_sides(luma, 0, guess, &mut sums);
        add_sides(chroma, 1, guess, &mut sums);
        if sums.as_flattened().iter().any(|sum| sum.0 == 0.0) {
            return None;
        }
        let [inside, outside] = sums.map(|side| self.light(side.map(|sum| f64::from(sum.1 / sum.0))));
        Some(EdgeFit::first_guess(inside, outside, guess, probe.shading))
    }

    /// Position where one plain step explains the pixels best, to half a pixel. Starting there keeps the finer model
    /// from settling where its shading term imitates the edge.
    fn sharpest_step(&self, luma: &Profile<1>, chroma: &Profile<2>, probe: &Probe) -> Option<f64> {
        best_step(luma, chroma, self.noise.map(|noise| 1.0 / noise as f32), probe, f64::INFINITY).map(|(at, _)| at)
    }
}

/// Shares of the pixels' variance that plain steps explain, by the distance from the chord, summed over probes with the
/// same window.
#[derive(Clone, Copy, Debug)]
pub struct StepShares {
    sums: [f32; MAX_STEPS],
    first: f64,
    count: usize,
    probes: usize,
}

impl Default for StepShares {
    fn default() -> Self {
        Self { sums: [0.0; MAX_STEPS], first: 0.0, count: 0, probes: 0 }
    }
}

impl StepShares {
    /// Adds a probe.
    pub fn add(&mut self, edges: &EdgeModel, frame: &Frame<'_>, probe: &Probe) {
        let luma = profile::of_luma(frame, probe);
        let chroma = profile::of_chroma(frame, edges.chroma_right_px, probe);
        let weights = edges.noise.map(|noise| 1.0 / noise as f32);
        (self.first, self.count) = step_range(probe);
        let mut explained = [0.0; MAX_STEPS];
        explain_by_step(&luma, self.first as f32, &weights[..1], &mut explained[..self.count]);
        explain_by_step(&chroma, self.first as f32, &weights[1..], &mut explained[..self.count]);
        let all = variation(&luma, &weights[..1]) + variation(&chroma, &weights[1..]);
        if all > 0.0 {
            self.probes += 1;
            self.sums.iter_mut().zip(explained).for_each(|(sum, explained)| *sum += explained / all);
        }
    }

    /// Distance of the best step from the chord, pixels, and the mean share that it explains; `None` for fewer probes.
    pub fn best(&self, min_probes: usize) -> Option<(f64, f64)> {
        let best = self.sums[..self.count].iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
        let (step, sum) = best.filter(|_| self.probes >= min_probes)?;
        Some(((self.first + step as f64) / STEPS_PER_PX, f64::from(*sum) / self.probes as f64))
    }
}

/// Steps tried in a probe's window: the first, and their number. Both in steps.
fn step_range(probe: &Probe) -> (f64, usize) {
    let first = ((1.0 - probe.inwards_px) * STEPS_PER_PX).ceil();
    let count = ((probe.outwards_px - 1.0) * STEPS_PER_PX).floor() - first + 1.0;
    (first, (count.max(0.0) as usize).min(MAX_STEPS))
}

/// The best plain step in the profiles of a probe, not farther than some pixels from its chord, and the weighted
/// variance that it explains.
fn best_step(
    luma: &Profile<1>,
    chroma: &Profile<2>,
    weights: [f32; 3],
    probe: &Probe,
    near_px: f64,
) -> Option<(f64, f32)> {
    let (first, count) = step_range(probe);
    let mut explained = [0.0; MAX_STEPS];
    let explained = &mut explained[..count];
    explain_by_step(luma, first as f32, &weights[..1], explained);
    explain_by_step(chroma, first as f32, &weights[1..], explained);
    let place = |step: usize| (first + step as f64) / STEPS_PER_PX;
    let near = explained.iter().enumerate().filter(|(step, _)| place(*step).abs() <= near_px);
    near.max_by(|a, b| a.1.total_cmp(b.1)).map(|(best, most)| (place(best), *most))
}

/// The pixels' squared deviations from their mean, times each plane's weight.
fn variation<const N: usize>(profile: &Profile<N>, weights: &[f32]) -> f32 {
    let of_plane = |plane: usize| {
        let level = profile.bins(plane).map(|(_, pixels, value)| pixels * value).sum::<f32>() / profile.count.max(1.0);
        let between: f32 = profile.bins(plane).map(|(_, pixels, value)| pixels * (value - level).powi(2)).sum();
        between + profile.scatter[plane]
    };
    weights.iter().enumerate().map(|(plane, weight)| weight * of_plane(plane)).sum()
}

/// Distance of two colours, codes.
fn colour_distance(one: [f64; 3], other: [f64; 3]) -> f64 {
    (Vector3::from(one) - Vector3::from(other)).norm()
}

/// Adds counts and sums of the codes on both sides of a guessed step, leaving out pixels near it. The planes have the
/// numbers from `first` on.
fn add_sides<const N: usize>(profile: &Profile<N>, first: usize, guess: f64, sums: &mut [[(f32, f32); 3]; 2]) {
    const CLEAR_PX: f32 = 1.0;
    for plane in 0..N {
        for (distance, pixels, value) in profile.bins(plane) {
            let beyond = distance - guess as f32;
            if beyond.abs() > CLEAR_PX {
                let sum = &mut sums[usize::from(beyond > 0.0)][first + plane];
                *sum = (sum.0 + pixels, sum.1 + pixels * value);
            }
        }
    }
}

/// Adds, for each position of a step from `first` outwards, how much of the variance two means (inside and outside)
/// explain, times each plane's weight.
fn explain_by_step<const N: usize>(profile: &Profile<N>, first: f32, weights: &[f32], into: &mut [f32]) {
    for (plane, weight) in weights.iter().enumerate() {
        let level = profile.bins(plane).map(|(_, pixels, value)| pixels * value).sum::<f32>() / profile.count.max(1.0);
        let mut between = [(0.0f32, 0.0f32); MAX_STEPS + 1]; // count and sum of the pixels before each place
        for (distance, pixels, value) in profile.bins(plane) {
            let place = (distance * STEPS_PER_PX as f32 - first + 1.0).clamp(0.0, into.len() as f32) as usize;
            between[place] = (between[place].0 + pixels, between[place].1 + pixels * (value - level));
        }
        let (mut count, mut sum) = (0.0, 0.0); // the sum of all is 0
        for (explained, (own_count, own_sum)) in into.iter_mut().zip(between) {
            (count, sum) = (count + own_count, sum + own_sum);
            let others = profile.count - count;
            *explained += weight * sum * sum * (1.0 / f32::max(count, 1.0) + 1.0 / f32::max(others, 1.0));
        }
    }
}

#[cfg(test)]
mod tests;
