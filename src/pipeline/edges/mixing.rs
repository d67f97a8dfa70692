//! Was light mixed, or were codes? A recording tells within its first second.
//!
//! A lens mixes light. Pictures that were drawn are often shaded and blurred as codes instead, and an edge that is then
//! taken for one in light lies 0.2 to 0.3 pixel off. **Method** the limb of a tube is looked at widely, as if light had been
//! mixed, with one more unknown: how much farther out it lies in chroma than in luma. Medians: −0.09 to 0.19 pixel on six
//! ray-traced tools, 0.43 to 0.60 on five drawn ones, but 0.08 on a dull one. **Assumes** nothing of how wide the edge is, so
//! that a sharp lens and a resting tool do. Dull tape tells nothing: then light is believed, as cameras make it, unless
//! another tool of the recording knows better.

use super::edge_fit::{EdgeFit, EdgeLook};
use super::edge_model::EdgeModel;
use super::equations::Taught;
use super::probe::{Probe, Shading};
use super::profile::Profile;
use super::tone::Mixing;
use crate::pipeline::frame::Frame;

/// Edges that are looked at.
const ENOUGH: usize = 160;
/// Median shift from which codes were mixed, pixels: between what was measured of both kinds.
const CODES_FROM_PX: f32 = 0.25;
/// How far to look on both sides, pixels.
const REACH_PX: f64 = 5.5;

/// What the edges looked at so far say.
#[derive(Clone, Debug, Default)]
pub struct Trial {
    shifts_px: Vec<f32>,
    is_over: bool,
}

impl Trial {
    /// Looks at an edge that was found, unless enough were seen.
    pub(super) fn look(&mut self, model: &EdgeModel, frame: &Frame<'_>, probe: &Probe, found: &EdgeFit) {
        if !self.is_over && self.shifts_px.len() < ENOUGH {
            self.shifts_px.extend(chroma_shift_px(model, frame, probe, found).map(|shift| shift as f32));
        }
    }

    /// The verdict, once, when enough edges were seen.
    pub(super) fn verdict(&mut self) -> Option<Mixing> {
        if self.is_over || self.shifts_px.len() < ENOUGH {
            return None;
        }
        let mut shifts = std::mem::take(&mut self.shifts_px);
        self.is_over = true;
        let (_, median, _) = shifts.select_nth_unstable_by(ENOUGH / 2, f32::total_cmp);
        Some(if *median > CODES_FROM_PX { Mixing::Codes } else { Mixing::Light })
    }
}

/// How much farther out a limb lies in chroma than in luma, if light was mixed; `None` where it is too faint to tell.
fn chroma_shift_px(model: &EdgeModel, frame: &Frame<'_>, probe: &Probe, found: &EdgeFit) -> Option<f64> {
    const PASSES: usize = 6;
    const LEAST_INFORMATION: f64 = 4.0;
    const FARTHEST_PX: f64 = 1.5;
    /// Usual variances: every edge shall count alike.
    const NOISE: [f64; 3] = [4.0, 2.25, 2.25];
    let Shading::Limb { radius_px } = probe.shading else { return None };
    let wide = Probe { inwards_px: f64::min(REACH_PX, 0.9 * radius_px), outwards_px: REACH_PX, ..*probe };
    let luma = Profile::gather([&frame.y], (0, 0), &wide);
    let chroma = Profile::gather([&frame.u, &frame.v], (frame.shift_x, frame.shift_y), &wide);
    let look = EdgeLook { taught: Some(Taught::ChromaShift), ..model.look_in(Mixing::Light, &wide, frame.shift_x) };
    let first = model.first(Mixing::Light, &luma, &chroma, found.offset_px, &wide)?;
    let mut fit = first;
    for pass in 0..PASSES {
        look.improve(&luma, &chroma, NOISE, &mut fit, &first)?;
        if pass > 0 {
            let (gradient, information) = fit.taught;
            fit.chroma_px += (gradient / (information + 1.0)).clamp(-0.4, 0.4);
        }
    }
    let is_clear = fit.information > LEAST_INFORMATION && fit.taught.1 > LEAST_INFORMATION;
    (is_clear && fit.chroma_px.abs() < FARTHEST_PX).then_some(fit.chroma_px)
}
