//! Decides whether blur mixed light or codes in a recording, within its first second.
//!
//! A lens mixes light. Rendered pictures are often shaded and blurred as codes instead; an edge model for light is
//! then off by 0.2 to 0.3 pixel. **Method** The limbs of a tube are fitted over a wide window, as if light had been
//! mixed, with one more unknown: how much farther out the limb lies in chroma than in luma. Medians: −0.25 to 0.19
//! pixel on 19 ray-traced tools, 0.30 on a ray-traced one of dark violet; 0.31 to 0.57 on five drawn tools, and in
//! hard light 0.11 and 0.37 to 0.40. One camera recorded all tools, so their mean decides ([`decide`]): −0.08 to 0.19
//! for light, 0.24 to 0.51 for codes. **Assumes** nothing about the width of the edge, so it also works with a sharp
//! lens and a resting tool. Until the first tool has a result, light is assumed, as with a camera.

use super::edge_fit::{EdgeAppearance, EdgeFit};
use super::edge_model::EdgeModel;
use super::equations::LearnedParameter;
use super::probe::{Probe, Shading};
use super::profile;
use super::tone::BlurDomain;
use crate::vision::frame::Frame;

/// Number of edges that are fitted.
const ENOUGH: usize = 160;
/// A recording with a mean shift above this mixed codes, pixels; the value lies between those measured for both kinds.
const CODES_FROM_PX: f32 = 0.21;
/// Window on both sides of the edge, pixels.
const REACH_PX: f64 = 5.5;

/// The blur domain of a recording, from how much farther out the limbs of each of its tools lie in chroma, pixels.
pub fn decide(shifts_px: impl Iterator<Item = f32>) -> BlurDomain {
    let (tools, sum) = shifts_px.fold((0.0, 0.0), |(tools, sum), shift| (tools + 1.0, sum + shift));
    if sum > CODES_FROM_PX * tools { BlurDomain::Codes } else { BlurDomain::Light }
}

/// Measures the chroma shift of one tool over enough of its edges.
#[derive(Clone)]
pub enum ChromaShiftEstimator {
    /// The chroma shift of each edge so far, pixels.
    Collecting(Vec<f32>),
    /// The median of all edges, pixels.
    Decided(f32),
}

impl Default for ChromaShiftEstimator {
    fn default() -> Self {
        Self::Collecting(Vec::new())
    }
}

impl ChromaShiftEstimator {
    /// Measures an edge, unless enough were measured.
    pub(super) fn observe(&mut self, model: &EdgeModel, frame: &Frame<'_>, probe: &Probe, found: &EdgeFit) {
        let Self::Collecting(shifts_px) = self else { return };
        shifts_px.extend(chroma_shift_px(model, frame, probe, found).map(|shift| shift as f32));
        if shifts_px.len() == ENOUGH {
            let (_, median, _) = shifts_px.select_nth_unstable_by(ENOUGH / 2, f32::total_cmp);
            *self = Self::Decided(*median);
        }
    }

    /// The median chroma shift, pixels, once enough edges were measured.
    pub(super) fn median_px(&self) -> Option<f32> {
        match self {
            Self::Collecting(_) => None,
            Self::Decided(median) => Some(*median),
        }
    }
}

/// How much farther out a limb lies in chroma than in luma if light was mixed, pixels; `None` if the limb is too
/// faint.
fn chroma_shift_px(model: &EdgeModel, frame: &Frame<'_>, probe: &Probe, found: &EdgeFit) -> Option<f64> {
    const PASSES: usize = 6;
    const MIN_INFORMATION: f64 = 4.0;
    const MAX_SHIFT_PX: f64 = 1.5;
    /// Usual variances, so that all edges have the same weight.
    const NOISE: [f64; 3] = [4.0, 2.25, 2.25];
    let Shading::Limb { radius_px } = probe.shading else { return None };
    let wide = Probe { inwards_px: f64::min(REACH_PX, 0.9 * radius_px), outwards_px: REACH_PX, ..*probe };
    let luma = profile::of_luma(frame, &wide);
    let chroma = profile::of_chroma(frame, &wide);
    let look = EdgeAppearance {
        learned_parameter: Some(LearnedParameter::ChromaShift),
        ..model.appearance_in(BlurDomain::Light, &wide, frame.shift_x)
    };
    let first = model.first_guess(BlurDomain::Light, &luma, &chroma, found.offset_px, &wide)?;
    let mut fit = first;
    for pass in 0..PASSES {
        look.improve(&luma, &chroma, NOISE, &mut fit, &first)?;
        if pass > 0 {
            let (gradient, information) = fit.learned_evidence;
            fit.chroma_px += (gradient / (information + 1.0)).clamp(-0.4, 0.4);
        }
    }
    let is_clear = fit.information > MIN_INFORMATION && fit.learned_evidence.1 > MIN_INFORMATION;
    (is_clear && fit.chroma_px.abs() < MAX_SHIFT_PX).then_some(fit.chroma_px)
}
