//! Decides where a recording's chroma samples lie, within its first second.
//!
//! With 4:2:0 and 4:2:2 one chroma sample covers two columns: it lies on the first of them (most H.264) or between
//! both (JPEG). Files state this wrongly or not at all. A position that is half a pixel off moves all edges in chroma
//! to one side. **Method** The limbs of a tube are fitted over a wide window, with one more unknown: how much farther
//! out the limb lies in chroma than in luma. The two borders of a tube face opposite ways, so what moves one of them
//! out and the other in is the position of the samples; blur and tone move both alike. One camera recorded all tools,
//! so they decide together ([`decide`]), and only if they show it clearly.

use super::edge_fit::{EdgeAppearance, EdgeFit};
use super::edge_model::EdgeModel;
use super::equations::LearnedParameter;
use super::probe::{Probe, Shading};
use super::profile;
use crate::vision::frame::Frame;

/// Number of edges that are fitted.
const ENOUGH: usize = 160;
/// Minimum spread of the normals, as a sum of squares, to distinguish right from outwards.
const MIN_SPREAD: f32 = 4.0;
/// Number of edges that have the same error, because they lie on one border of one frame.
const EDGES_ALIKE: f32 = 4.0;
/// Window on both sides of the edge, pixels.
const REACH_PX: f64 = 5.5;

/// How much farther right a recording's chroma samples lie than its file says, pixels: 0, or a position of the other
/// kinds of files if the tools' limbs clearly show it. Many files do not state the position, or state a wrong one.
pub fn decide(tools: impl Iterator<Item = ChromaRight>, stated_px: f32, halvings: u8) -> f32 {
    const CLEAR: f32 = 4.0; // standard deviations
    const WITHIN_PX: f32 = 0.15;
    if halvings == 0 {
        return 0.0;
    }
    let (mut sum, mut information) = (0.0, 0.0);
    for tool in tools {
        let weight = tool.sigma_px.powi(-2);
        (sum, information) = (sum + weight * tool.px, information + weight);
    }
    if information == 0.0 {
        return 0.0;
    }
    // An edge that seems to lie too far right in chroma has samples that lie farther left than stated.
    let (measured_px, sigma_px) = (-sum / information, information.powf(-0.5));
    let off = |right_px: f32| ((measured_px - right_px) / sigma_px).powi(2);
    let others = [0.0, 0.5].map(|position| position - stated_px);
    let best = others.into_iter().min_by(|a, b| off(*a).total_cmp(&off(*b))).unwrap_or(0.0);
    let is_clear = off(0.0) - off(best) > CLEAR * CLEAR && (measured_px - best).abs() < WITHIN_PX;
    if is_clear { best } else { 0.0 }
}

/// How much farther right the limbs of one tool lie in chroma than in luma.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChromaRight {
    /// Pixels.
    pub px: f32,
    /// Its standard deviation, pixels.
    pub sigma_px: f32,
}

/// How far an edge lies farther out in chroma, pixels, and the part of its normal that points right.
type ChromaEdge = (f32, f32);

/// Measures where chroma lies over enough edges of one tool.
#[derive(Clone)]
pub enum ChromaRightEstimator {
    /// The edges so far.
    Collecting(Vec<ChromaEdge>),
    /// The result.
    Decided(ChromaRight),
}

impl Default for ChromaRightEstimator {
    fn default() -> Self {
        Self::Collecting(Vec::new())
    }
}

impl ChromaRightEstimator {
    /// Measures an edge, unless enough were measured.
    pub(super) fn observe(&mut self, model: &EdgeModel, frame: &Frame<'_>, probe: &Probe, found: &EdgeFit) {
        let Self::Collecting(edges) = self else { return };
        let shift_px = chroma_shift_px(model, frame, probe, found);
        edges.extend(shift_px.map(|shift| (shift as f32, probe.outward.x as f32)));
        if edges.len() == ENOUGH {
            *self = Self::Decided(farther_right(edges));
        }
    }

    /// The result, once enough edges were measured.
    pub(super) fn estimate(&self) -> Option<ChromaRight> {
        match self {
            Self::Collecting(_) => None,
            Self::Decided(right) => Some(*right),
        }
    }
}

/// Fits `shift = outwards + right · x` to the edges, `x` being the part of the normal that points right. Both borders of
/// a tube face opposite ways, so the two terms do not resemble each other.
fn farther_right(edges: &[ChromaEdge]) -> ChromaRight {
    const ROUNDS: usize = 5;
    let mut shifts: Vec<f32> = edges.iter().map(|edge| edge.0).collect();
    let median = *shifts.select_nth_unstable_by(edges.len() / 2, f32::total_cmp).1;
    let (mut constant, mut right_px, mut spread, mut information) = (median, 0.0, 1.0, 0.0);
    for _ in 0..ROUNDS {
        let mut distances: Vec<f32> = edges.iter().map(|(shift, x)| (shift - constant - right_px * x).abs()).collect();
        let median = *distances.select_nth_unstable_by(edges.len() / 2, f32::total_cmp).1;
        spread = f32::max(1.48 * median, 0.02);
        let (mut n, mut sx, mut sxx, mut sy, mut sxy) = (0.0f32, 0.0f32, 0.0f32, 0.0f32, 0.0f32);
        for (shift, x) in edges {
            let weight = 1.0 / (1.0 + ((shift - constant - right_px * x) / (2.0 * spread)).powi(2)).powi(2);
            (n, sx, sxx) = (n + weight, sx + weight * x, sxx + weight * x * x);
            (sy, sxy) = (sy + weight * shift, sxy + weight * x * shift);
        }
        information = sxx - sx * sx / n;
        if information < MIN_SPREAD {
            return ChromaRight { px: 0.0, sigma_px: f32::INFINITY };
        }
        right_px = (sxy - sx * sy / n) / information;
        constant = (sy - right_px * sx) / n;
    }
    ChromaRight { px: right_px, sigma_px: spread * (EDGES_ALIKE / information).sqrt() }
}

/// How much farther out a limb lies in chroma than in luma, pixels; `None` if the limb is too faint.
fn chroma_shift_px(model: &EdgeModel, frame: &Frame<'_>, probe: &Probe, found: &EdgeFit) -> Option<f64> {
    const PASSES: usize = 6;
    const MIN_INFORMATION: f64 = 4.0;
    const MAX_SHIFT_PX: f64 = 1.5;
    /// Usual variances, so that all edges have the same weight.
    const NOISE: [f64; 3] = [4.0, 2.25, 2.25];
    let Shading::Limb { radius_px } = probe.shading else { return None };
    let wide = Probe { inwards_px: f64::min(REACH_PX, 0.9 * radius_px), outwards_px: REACH_PX, ..*probe };
    let luma = profile::of_luma(frame, &wide);
    let chroma = profile::of_chroma(frame, 0.0, &wide);
    let look = EdgeAppearance {
        learned_parameter: Some(LearnedParameter::ChromaShift),
        ..model.appearance(&wide, frame.shift_x)
    };
    let first = model.first_guess(&luma, &chroma, found.offset_px, &wide)?;
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
