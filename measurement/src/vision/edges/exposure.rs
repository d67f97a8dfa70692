//! Estimates a recording's exposure time from the borders that motion has blurred.
//!
//! A webcam in a dim box exposes for as long as 40 ms. With a shorter exposure in the edge model, a moving tape seems
//! wider than it is: light is mixed before it is encoded, so the brighter side seems to reach too far. **Method** Edges
//! that move fast are fitted over a wide window with each of some exposure times; what remains unexplained is summed
//! over the edges. A step of the usual fit cannot show it: its window is as narrow as the assumed blur. One camera
//! recorded all tools, so they decide together ([`decide`]). **Gives up** (`None`) without enough edges that move fast.

use nalgebra::Vector2;

use super::edge_fit::{EdgeAppearance, EdgeFit};
use super::edge_model::{EdgeModel, Likeness, USUAL_EXPOSURE_S};
use super::probe::{FittedEdge, Probe, Shading};
use super::profile;
use crate::vision::frame::Frame;

/// Number of exposure times that are compared.
const EXPOSURES: usize = 16;
/// The shortest and the longest of them, s.
const LIMITS_S: [f64; 2] = [0.001, 0.04];

/// The exposure times that are compared, s: in steps of equal ratio.
fn exposures_s() -> [f64; EXPOSURES] {
    let [shortest, longest] = LIMITS_S;
    std::array::from_fn(|step| shortest * (longest / shortest).powf(step as f64 / (EXPOSURES - 1) as f64))
}

/// Largest number of edges of one tool that count. Beyond it, all of its evidence counts half: automatic exposure follows
/// the light, so old edges are forgotten.
const MAX_EDGES: f64 = 200.0;
/// Number of edges of all tools that decide.
const MIN_EDGES: f64 = 40.0;

/// Misfits of the edges of one tool for each exposure time, as negative logarithms of a likelihood.
#[derive(Clone, Copy, Debug, Default)]
pub struct ExposureEvidence {
    misfits: [f64; EXPOSURES],
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
        /// One frame adds only some of its edges, later fewer: other ones on each frame.
        const MAX_ADDED: usize = 10;
        const LATER_EVERY: usize = 8;
        let every = if self.edges < MIN_EDGES { edges.len().div_ceil(MAX_ADDED) } else { LATER_EVERY }.max(1);
        let first = frame.index as usize % every;
        for FittedEdge { probe, fit } in edges.iter().skip(first).step_by(every) {
            let moved = Probe { motion_px_s: motion_px_s.dot(&probe.outward), ..*probe };
            let Some(misfits) = misfits_of_edge(model, frame, &moved, fit) else { continue };
            self.edges += 1.0;
            self.misfits.iter_mut().zip(misfits).for_each(|(sum, misfit)| *sum += misfit);
        }
        if self.edges > MAX_EDGES {
            self.edges *= 0.5;
            self.misfits.iter_mut().for_each(|sum| *sum *= 0.5);
        }
    }
}

/// The exposure time that explains the edges of all tools best, s; `None` as long as they do not show it.
pub fn decide(tools: impl Iterator<Item = ExposureEvidence>) -> Option<f64> {
    /// The best time is this much likelier than the worst one, by the edges alone: natural logarithm, odds of 50 to 1.
    const MIN_DIFFERENCE: f64 = 4.0;
    /// Cameras expose for the usual time, within a factor of two: natural logarithm.
    const WITHIN: f64 = std::f64::consts::LN_2;
    let mut sum = ExposureEvidence::default();
    for tool in tools {
        sum.edges += tool.edges;
        sum.misfits.iter_mut().zip(tool.misfits).for_each(|(sum, misfit)| *sum += misfit);
    }
    let [least, most] = [f64::min, f64::max].map(|of| sum.misfits.into_iter().reduce(of));
    if sum.edges < MIN_EDGES || most? - least? < MIN_DIFFERENCE {
        return None;
    }
    let beyond_usual = exposures_s().map(|exposure_s| (exposure_s / USUAL_EXPOSURE_S).ln());
    let all: Vec<f64> =
        sum.misfits.iter().zip(beyond_usual).map(|(misfit, by)| misfit + 0.5 * (by / WITHIN).powi(2)).collect();
    let least = all.iter().copied().reduce(f64::min)?;
    let weights: Vec<f64> = all.iter().map(|misfit| (least - misfit).exp()).collect();
    let mean =
        weights.iter().zip(beyond_usual).map(|(weight, by)| weight * by).sum::<f64>() / weights.iter().sum::<f64>();
    Some(USUAL_EXPOSURE_S * mean.exp())
}

/// How badly each exposure time explains an edge; `None` if it moves too little, or so fast that its blur is wider than
/// the tape.
fn misfits_of_edge(model: &EdgeModel, frame: &Frame<'_>, probe: &Probe, found: &EdgeFit) -> Option<[f64; EXPOSURES]> {
    const PASSES: usize = 5;
    /// Least smear over the longest exposure, pixels.
    const MIN_SMEAR_PX: f64 = 8.0;
    /// Window beyond the blur, pixels.
    const REACH_PX: f64 = 4.0;
    /// Pixels of an edge whose errors are alike: those of a block of compression.
    const PIXELS_ALIKE: f64 = 16.0;
    /// Largest misfit of an edge: texture or gloss may imitate blur.
    const MAX_MISFIT: f64 = 2.0;
    let [_, longest] = LIMITS_S;
    let smear_px = probe.motion_px_s.abs() * longest;
    let depth_px = match probe.shading {
        Shading::Limb { radius_px } => 0.9 * radius_px,
        Shading::Cut => f64::INFINITY, // a band is longer than the blur of its ends
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
    if model.likeness == Likeness::AllPlanes {
        first.expect_mirror(wide.shading);
    }
    let mut squares = [0.0; EXPOSURES];
    let mut pixels = 0.0;
    for (squares, exposure_s) in squares.iter_mut().zip(exposures_s()) {
        let appearance = EdgeAppearance {
            light_blur_px: model.light_blur_px(&wide, exposure_s),
            learned_parameter: None,
            ..model.appearance(&wide, frame.shift_x)
        };
        let mut fit = first;
        for _ in 0..PASSES {
            appearance.improve(&luma, &chroma, model.noise, &mut fit, &first)?;
        }
        let counts = [luma.count, chroma.count, chroma.count].map(f64::from);
        pixels = counts.iter().sum();
        *squares = (0..3).map(|plane| counts[plane] * fit.variance[plane] / model.noise[plane]).sum();
    }
    let least = squares.iter().copied().fold(f64::INFINITY, f64::min);
    let independent = pixels / PIXELS_ALIKE;
    (least > 0.0).then(|| squares.map(|squares| (0.5 * independent * (squares / least).ln()).min(MAX_MISFIT)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Evidence of this many edges for a time, s; `strength` is the misfit of a time that is a factor of e off.
    fn evidence(edges: f64, exposure_s: f64, strength: f64) -> ExposureEvidence {
        let misfits = exposures_s().map(|tried_s| strength * (tried_s / exposure_s).ln().powi(2));
        ExposureEvidence { misfits, edges }
    }

    #[test]
    fn edges_that_show_no_time_decide_nothing() {
        assert_eq!(decide([evidence(100.0, 0.012, 0.0)].into_iter()), None);
    }

    #[test]
    fn tools_decide_together() {
        let one = evidence(30.0, 0.03, 20.0);
        assert_eq!(decide([one].into_iter()), None, "too few edges");
        let shown_s = decide([one, one].into_iter()).unwrap();
        assert!((shown_s / 0.03 - 1.0).abs() < 0.1, "{shown_s}");
    }

    #[test]
    fn weak_evidence_stays_near_the_usual_time() {
        let shown_s = decide([evidence(100.0, 0.03, 0.7)].into_iter()).unwrap();
        assert!((0.015..0.025).contains(&shown_s), "{shown_s}");
    }
}
