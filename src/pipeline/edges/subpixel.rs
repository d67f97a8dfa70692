//! Where exactly an edge lies: a model of the blurred border of a lit tube, fitted to raw pixels.
//!
//! **In** a [`Probe`]: a short chord of a predicted border with its outward normal, ± a few pixels. **Out** how far the
//! edge lies from it along the normal, with its standard deviation, pixels.
//!
//! **Method.** In every plane (Y, U, V) the light across a border is `out + shadow·distance` outside and
//! `in + shade·√depth` inside, the first term of a Lambertian cylinder's fall-off near its limb, all blurred by a Gaussian
//! of the plane's own width; at a tape's end, where no surface turns away, the shade changes steadily instead. Without the
//! shade term the limb's darkening would pull the border inwards by up to a pixel; without the shadow term the soft shadow
//! beside a tube pushes it outwards by 0.4 pixel. One offset is shared by the
//! three planes, so that whichever has contrast decides; the rest are linear and eliminated. Pixels are used where they
//! are, at their own distance from the chord: nothing is resampled, so noise stays white.
//!
//! **Assumes** that the background is even along one chord and changes steadily, if at all, across the window. **Gives
//! up** where no plane has contrast, where the offset leaves the window, or where the inside is less like the tape than
//! the outside.

use nalgebra::{Vector2, Vector3};

use super::edge_model::EdgeModel;
use super::plane_fit::{AssumedEdge, PlaneFit};
use super::plane_samples::{PlaneSamples, gather};
use super::probe::{Edge, Probe};
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
/// How much the background may brighten or darken outwards, codes/pixel: tubes throw soft shadows beside themselves.
const SHADOW_SLOPE: f64 = 3.0;

impl EdgeModel {
    /// Moves onto the edge near a probe; `is_tape` tells whether codes are the tape's colour.
    pub fn locate(&mut self, frame: &Frame<'_>, probe: &Probe, is_tape: impl Fn([u8; 3]) -> bool) -> Option<Edge> {
        let blur = self.blur_of(probe);
        let mut samples = [PlaneSamples::default(); 3];
        let (luma, chroma) = samples.split_at_mut(1);
        gather([&frame.y], (0, 0), probe, 0.0, luma);
        gather([&frame.u, &frame.v], (frame.shift_x, frame.shift_y), probe, self.chroma_shift(probe.outward), chroma);
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
                let assumed = AssumedEdge {
                    blur_px: blur[plane],
                    offset_px: offset,
                    shading: probe.shading,
                    spill: self.light_strength() * spill[plane],
                    evenness: self.noise[plane] / (SHADOW_SLOPE * SHADOW_SLOPE),
                };
                fits[plane] = assumed.fit(&samples[plane])?;
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
            if pass > 0 && step.abs() < 0.05 {
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
        self.learn(&fits, &blur, spill, probe);
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

#[cfg(test)]
mod tests;
