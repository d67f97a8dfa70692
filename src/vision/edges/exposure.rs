//! Estimates a recording's exposure time from the borders that motion has blurred.
//!
//! A webcam in a dim box exposes for as long as 40 ms. With a shorter exposure in the edge model, a moving tape seems
//! wider than it is: light is mixed before it is encoded, so the brighter side seems to reach too far. **Method** Edges
//! that move fast are fitted over a wide window with each of some exposure times; what remains unexplained is summed
//! over the edges. A step of the usual fit cannot show it: its window is as narrow as the assumed blur. One camera
//! recorded all tools, so they decide together ([`decide`]). **Gives up** (`None`) without enough edges that move fast.

use nalgebra::Vector2;

use super::edge_fit::{EdgeAppearance, EdgeFit};
use super::edge_model::{EdgeModel, USUAL_EXPOSURE_S};
use super::probe::{FittedEdge, Probe, Shading};
use super::profile;
use crate::vision::frame::Frame;

/// Exposure times that are compared, s.
const EXPOSURES_S: [f64; 14] =
    [0.001, 0.002, 0.004, 0.006, 0.008, 0.010, 0.012, 0.015, 0.018, 0.021, 0.025, 0.030, 0.035, 0.040];

/// Number of edges of one tool that are remembered. Then half of the evidence is forgotten: automatic exposure follows
/// the light.
const REMEMBERED: f64 = 200.0;
/// Number of edges of all tools that decide.
const MIN_EDGES: f64 = 40.0;

/// Misfits of the edges of one tool for each exposure time, as negative logarithms of a likelihood.
#[derive(Clone, Copy, Debug, Default)]
pub struct ExposureEvidence {
    misfits: [f64; EXPOSURES_S.len()],
    edges: f64,
}

impl ExposureEvidence {
    /// Adds some of a frame's edges. `motion_px_s`: motion of the tool in the picture, pixels/s.
    pub(super) fn add(
        &mut self,
        model: &EdgeModel,
        frame: &Frame<'_>,
        edges: &[FittedEdge],
        motion_px_s: Vector2<f64>,
    ) {
        /// At first all edges are added, later every so many.
        const LATER_EVERY: usize = 8;
        let every = if self.edges < MIN_EDGES { 1 } else { LATER_EVERY };
        for FittedEdge { probe, fit } in edges.iter().step_by(every) {
            let moved = Probe { motion_px_s: motion_px_s.dot(&probe.outward), ..*probe };
            let Some(misfits) = misfits(model, frame, &moved, fit) else { continue };
            self.edges += 1.0;
            self.misfits.iter_mut().zip(misfits).for_each(|(sum, misfit)| *sum += misfit);
        }
        if self.edges > REMEMBERED {
            self.edges *= 0.5;
            self.misfits.iter_mut().for_each(|sum| *sum *= 0.5);
        }
    }
}

/// The exposure time that explains the edges of all tools best, s; `None` as long as they do not show it.
pub fn decide(tools: impl Iterator<Item = ExposureEvidence>) -> Option<f64> {
    /// The best time is this much likelier than the worst one: natural logarithm.
    const CLEAR: f64 = 4.0;
    /// Cameras expose for the usual time, within a factor of two: natural logarithm.
    const WITHIN: f64 = std::f64::consts::LN_2;
    let mut sum = ExposureEvidence::default();
    for tool in tools {
        sum.edges += tool.edges;
        sum.misfits.iter_mut().zip(tool.misfits).for_each(|(sum, misfit)| *sum += misfit);
    }
    for (misfit, exposure_s) in sum.misfits.iter_mut().zip(EXPOSURES_S) {
        *misfit += 0.5 * ((exposure_s / USUAL_EXPOSURE_S).ln() / WITHIN).powi(2);
    }
    let least = sum.misfits.iter().copied().fold(f64::INFINITY, f64::min);
    let most = sum.misfits.iter().copied().fold(0.0, f64::max);
    if sum.edges < MIN_EDGES || most - least < CLEAR {
        return None;
    }
    let weights = sum.misfits.map(|misfit| (least - misfit).exp());
    let weighted = weights.iter().zip(EXPOSURES_S).map(|(weight, exposure_s)| weight * exposure_s);
    Some(weighted.sum::<f64>() / weights.iter().sum::<f64>())
}

/// How badly each exposure time explains an edge. `None` for an edge that shows nothing.
fn misfits(model: &EdgeModel, frame: &Frame<'_>, probe: &Probe, found: &EdgeFit) -> Option<[f64; EXPOSURES_S.len()]> {
    const PASSES: usize = 5;
    /// Least smear over the longest exposure, pixels.
    const MIN_SMEAR_PX: f64 = 8.0;
    /// Window beyond the blur, pixels.
    const REACH_PX: f64 = 4.0;
    /// Pixels of an edge whose errors are alike: those of a block of compression.
    const PIXELS_ALIKE: f64 = 16.0;
    /// Largest misfit of an edge: texture or gloss may imitate blur.
    const MAX_MISFIT: f64 = 2.0;
    let longest = EXPOSURES_S.last().copied()?;
    let smear_px = probe.motion_px_s.abs() * longest;
    let depth_px = match probe.shading {
        Shading::Limb { radius_px } => 0.9 * radius_px,
        Shading::Cut => probe.inwards_px.max(REACH_PX + 0.5 * smear_px),
    };
    let reach_px = REACH_PX + 0.5 * smear_px;
    if smear_px < MIN_SMEAR_PX || depth_px < 0.5 * smear_px {
        return None;
    }
    let wide = Probe { inwards_px: reach_px.min(depth_px), outwards_px: reach_px, ..*probe };
    let luma = profile::of_luma(frame, &wide);
    let chroma = profile::of_chroma(frame, model.chroma_right_px, &wide);
    let mut first = model.first_guess(&luma, &chroma, found.offset_px, &wide)?;
    if let Some(usual) = model.usual_inside(probe.part) {
        first.set_usual_inside(usual);
    }
    let mut squares = [0.0; EXPOSURES_S.len()];
    let mut pixels = 0.0;
    for (squares, exposure_s) in squares.iter_mut().zip(EXPOSURES_S) {
        let look = EdgeAppearance {
            light_blur_px: model.light_blur_px(&wide, exposure_s),
            learned_parameter: None,
            ..model.appearance(&wide, frame.shift_x)
        };
        let mut fit = first;
        for _ in 0..PASSES {
            look.improve(&luma, &chroma, model.noise, &mut fit, &first)?;
        }
        let counts = [luma.count, chroma.count, chroma.count].map(f64::from);
        pixels = counts.iter().sum();
        *squares = (0..3).map(|plane| counts[plane] * fit.variance[plane] / model.noise[plane]).sum();
    }
    let least = squares.iter().copied().fold(f64::INFINITY, f64::min);
    let independent = pixels / PIXELS_ALIKE;
    (least > 0.0).then(|| squares.map(|squares| (0.5 * independent * (squares / least).ln()).min(MAX_MISFIT)))
}
