//! Where exactly an edge lies: a model of the blurred border of a lit tube, fitted to raw pixels.
//!
//! **In** a [`Probe`]: a short chord of a predicted border with its outward normal, ± a few pixels. **Out** how far the
//! edge lies from it along the normal, with its standard deviation, pixels.
//!
//! **Method.** First to half a pixel: where a plain step explains the pixels best ([`Fineness::Step`]). Then light on both
//! sides of the edge, mixed by the lens and by motion and coded by the camera, is fitted to the pixels of all three planes
//! at once ([`super::edge_fit`]), so that whichever has contrast decides. The inside starts from what the recording has
//! taught of that part of the outline, which tells what overexposed tape hides.
//!
//! **Assumes** that the background is even along one chord and changes steadily, if at all, across the window. **Gives
//! up** where no plane has contrast, where the offset leaves the window, or where the inside is less like the tape than
//! the outside.

use nalgebra::{Vector2, Vector3};

use super::edge_fit::{EdgeFit, LIMB_INSIDE};
use super::edge_model::EdgeModel;
use super::probe::{Edge, Probe};
use super::profile::{self, Profile};
use super::tone::Mixing;
use crate::pipeline::frame::Frame;

/// Where a plain step is tried.
const STEPS_PER_PX: f64 = 2.0;
const MOST_STEPS: usize = 40;
/// Softest edge that still tells where it is, pixels.
const WORST_SIGMA_PX: f64 = 1.0;
/// Farthest that the finer model may move from the sharpest plain step, pixels.
const FARTHEST_FROM_STEP_PX: f64 = 1.3;
/// What the model leaves out (texture, creases, gloss, compression, how colours mix) moves an edge as the noise does, the
/// more the less contrast it has, but by so many times as much: from edges about true outlines, over scenes of three
/// renderers.
const MODEL_ERROR: f64 = 3.0;
/// Passes of the finer model: it is nearly linear.
const MOST_PASSES: usize = 8;

/// Colours within an edge that are not the tape's own are so much nearer to it than those outside: over 24 clips, most of them of
/// trembling hands, a sixth less error than with any that are nearer at all.
const SURELY_NEARER: f64 = 0.5;

/// How closely to look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fineness {
    /// To half a pixel: where a step explains the pixels best.
    Step,
    /// To a fraction of a pixel.
    Fine,
}

/// Standard deviation of an edge that was found as a step, pixels.
const STEP_SIGMA_PX: f64 = 0.7;

impl EdgeModel {
    /// Moves onto the edge near a probe; `is_tape` tells whether codes are the tape's colour.
    pub fn locate(
        &mut self,
        frame: &Frame<'_>,
        probe: &Probe,
        fineness: Fineness,
        is_tape: impl Fn([u8; 3]) -> bool,
    ) -> Option<Edge> {
        let luma = profile::of_luma(frame, probe);
        let chroma = profile::of_chroma(frame, probe);
        let guess = self.sharpest_step(&luma, &chroma, probe)?;
        let look = self.look(probe, frame.shift_x);
        let mut first = self.first(self.mixing, &luma, &chroma, guess, probe)?;
        if let Some(usual) = self.usual_inside(probe.part) {
            first.expect_inside(usual);
        }
        let usual = self.usual_inside(probe.part).map(|light| look.codes(light.map(|l| l.base + LIMB_INSIDE * l.limb)));
        let off_tape = |codes: [f64; 3]| (Vector2::new(codes[1], codes[2]) - self.tape).norm();
        let is_border = |fit: &EdgeFit| {
            let [inside, outside] = [fit.inside(), fit.outside()].map(|light| look.codes(light));
            let is_tape = |codes: [f64; 3]| is_tape(codes.map(|code| code.round().clamp(0.0, 255.0) as u8));
            // Else there is no tape within, the edge of a shadow or of the mat's print; or there is on both sides, a highlight or
            // a crease. Glare and shade take tape's colour away: then it is as this part of the outline usually is.
            let is_usual = || usual.is_none_or(|usual| apart(inside, usual) < SURELY_NEARER * apart(outside, usual));
            let is_surely_tape =
                || is_tape(inside) || off_tape(inside) < SURELY_NEARER * off_tape(outside) || is_usual();
            off_tape(inside) < off_tape(outside) && is_surely_tape() && !is_tape(outside)
        };
        if fineness == Fineness::Step {
            return is_border(&first).then_some(Edge { offset_px: guess, sigma_px: STEP_SIGMA_PX });
        }
        let mut fit = first;
        let mut noise = self.noise;
        for pass in 0..MOST_PASSES {
            if pass > 1 {
                noise = std::array::from_fn(|p| self.noise[p].max(fit.variance[p])); // before, it tells of the guess
            }
            let moved = look.improve(&luma, &chroma, noise, &mut fit, &first)?;
            if (fit.offset_px - guess).abs() > FARTHEST_FROM_STEP_PX * (1.5 * look.light_blur_px).max(1.0) {
                return None; // another optimum, where the shading stands in for the edge
            }
            if pass > 0 && moved.abs() < f64::max(0.1, 0.2 * MODEL_ERROR / fit.information.sqrt()) {
                break;
            }
        }
        let surplus = fit.variance.iter().zip(noise).map(|(variance, noise)| variance / noise).sum::<f64>() / 3.0;
        fit.information /= surplus.max(1.0);
        if fit.information < 1.0 / (WORST_SIGMA_PX * WORST_SIGMA_PX) {
            return None;
        }
        if !is_border(&fit) {
            return None;
        }
        self.found.push((*probe, fit));
        Some(Edge { offset_px: fit.offset_px, sigma_px: MODEL_ERROR / fit.information.sqrt() })
    }

    /// Both sides' light beside a guessed step.
    pub(super) fn first(
        &self,
        mixing: Mixing,
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
        let [inside, outside] = sums.map(|side| self.light(mixing, side.map(|sum| f64::from(sum.1 / sum.0))));
        Some(EdgeFit::between(inside, outside, guess, probe.shading))
    }

    /// Where one plain step explains the samples best, to half a pixel: the start, so that the finer model cannot settle
    /// where its shading term imitates the edge.
    fn sharpest_step(&self, luma: &Profile<1>, chroma: &Profile<2>, probe: &Probe) -> Option<f64> {
        let first = ((1.0 - probe.inwards_px) * STEPS_PER_PX).ceil();
        let count = ((probe.outwards_px - 1.0) * STEPS_PER_PX).floor() - first + 1.0;
        let mut explained = [0.0; MOST_STEPS];
        let explained = &mut explained[..(count.max(0.0) as usize).min(MOST_STEPS)];
        let weights = self.noise.map(|noise| 1.0 / noise as f32);
        explain_by_step(luma, first as f32, &weights[..1], explained);
        explain_by_step(chroma, first as f32, &weights[1..], explained);
        let (best, _) = explained.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
        Some((first + best as f64) / STEPS_PER_PX)
    }
}

/// How far colours lie apart, codes.
fn apart(one: [f64; 3], other: [f64; 3]) -> f64 {
    (Vector3::from(one) - Vector3::from(other)).norm()
}

/// Adds counts and sums of the codes clear of a guessed step, inside and outside of it, for planes from `first` on.
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

/// Adds for each place of a step, from `first` outwards, how much two means explain, inside and outside of it, times
/// each plane's weight.
fn explain_by_step<const N: usize>(profile: &Profile<N>, first: f32, weights: &[f32], into: &mut [f32]) {
    for (plane, weight) in weights.iter().enumerate() {
        let level = profile.bins(plane).map(|(_, pixels, value)| pixels * value).sum::<f32>() / profile.count.max(1.0);
        let mut between = [(0.0f32, 0.0f32); MOST_STEPS + 1]; // count and sum of the pixels before each place
        for (distance, pixels, value) in profile.bins(plane) {
            let place = (distance * STEPS_PER_PX as f32 - first + 1.0).clamp(0.0, into.len() as f32) as usize;
            between[place] = (between[place].0 + pixels, between[place].1 + pixels * (value - level));
        }
        let (mut count, mut sum) = (0.0, 0.0); // the sum of all is none
        for (explained, (own_count, own_sum)) in into.iter_mut().zip(between) {
            (count, sum) = (count + own_count, sum + own_sum);
            let others = profile.count - count;
            *explained += weight * sum * sum * (1.0 / f32::max(count, 1.0) + 1.0 / f32::max(others, 1.0));
        }
    }
}

#[cfg(test)]
mod tests;
