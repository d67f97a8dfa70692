//! Finds where a tool rested, and for how long.
//!
//! In: the smoothed path. Out: [`Hold`]s of at least [`MIN_HOLD_S`], in order of time. A tool rests while its smoothed
//! speed stays below the movement threshold of the features. The beginning and the end of a rest are left out, because
//! the smoother still rounds off the motion before and after.

use nalgebra::{Point3, Vector3};

use crate::motion::features::FeatureSettings;
use crate::vision::covariance::PositionCovariance;
use crate::vision::trajectory::{Sample, SampleState, Trajectory};

/// Minimum duration of a rest, s.
const MIN_HOLD_S: f64 = 1.0;

/// Left out at both ends of a rest, s.
const SETTLING_S: f64 = 0.2;

/// Maximum time without the tool within one rest, s; a longer gap splits the rest in two.
const MAX_GAP_S: f64 = 0.3;

/// Minimum share of a rest's frames where the tool was measured, not bridged.
const MIN_OBSERVED_SHARE: f64 = 0.5;

/// A tool at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hold {
    /// Index into the path's tools.
    pub tool: usize,
    /// When it came to rest, s.
    pub from_s: f64,
    /// When it left, s.
    pub to_s: f64,
    /// Mean tip in the camera frame, mm.
    pub tip_mm: Point3<f64>,
    /// Mean axis, from the hand to the tip.
    pub axis: Vector3<f64>,
    /// The stated covariance of the sample with the median one.
    pub covariance_mm2: Option<PositionCovariance>,
}

/// All rests of all tools.
pub(super) fn holds_of_path(path: &Trajectory) -> Vec<Hold> {
    let mut holds: Vec<Hold> = (0..path.tools.len()).flat_map(|tool| holds_of_tool(path, tool)).collect();
    holds.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
    holds
}

fn holds_of_tool(path: &Trajectory, tool: usize) -> Vec<Hold> {
    let samples: Vec<Sample> = path.of_tool(tool).copied().collect();
    let at_rest_mm_s = FeatureSettings::default().movement_speed_mm_s;
    let rests = |sample: &Sample| sample.velocity_mm_s.is_some_and(|velocity| velocity.norm() < at_rest_mm_s);
    let together = |a: &Sample, b: &Sample| rests(a) == rests(b) && b.time_s - a.time_s <= MAX_GAP_S;
    samples.chunk_by(together).filter(|run| rests(&run[0])).filter_map(hold_of_run).collect()
}

fn hold_of_run(run: &[Sample]) -> Option<Hold> {
    let (from_s, to_s) = (run.first()?.time_s, run.last()?.time_s);
    let settled = (from_s + SETTLING_S)..=(to_s - SETTLING_S);
    let inner: Vec<&Sample> = run.iter().filter(|sample| settled.contains(&sample.time_s)).collect();
    let observed = inner.iter().filter(|sample| sample.state == SampleState::Observed).count();
    if to_s - from_s < MIN_HOLD_S || inner.is_empty() || (observed as f64) < MIN_OBSERVED_SHARE * inner.len() as f64 {
        return None;
    }
    let mean = inner.iter().map(|sample| sample.tip_mm.coords).sum::<Vector3<f64>>() / inner.len() as f64;
    let axis = inner.iter().filter_map(|sample| sample.axis).sum::<Vector3<f64>>().try_normalize(1e-9)?;
    let covariance_mm2 = median_covariance(&inner);
    Some(Hold { tool: run[0].tool, from_s, to_s, tip_mm: mean.into(), axis, covariance_mm2 })
}

/// The stated covariance with the median trace. The median of each entry would not be a covariance.
fn median_covariance(samples: &[&Sample]) -> Option<PositionCovariance> {
    let mut stated: Vec<PositionCovariance> = samples.iter().filter_map(|sample| sample.covariance_mm2).collect();
    let middle = stated.len().checked_sub(1)? / 2;
    let trace = |of: &PositionCovariance| of.matrix().trace();
    Some(*stated.select_nth_unstable_by(middle, |a, b| trace(a).total_cmp(&trace(b))).1)
}
