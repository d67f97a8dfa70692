//! The noise floor: the speed, mm/s, at which a resting tool would appear to move in the smoothed and in the causal
//! path.
//!
//! Depth noise dominates every feature of motion. At 25 frames a second, σ_z = 2 mm makes a resting tool "move" at 60
//! mm/s in the raw path, at 21 after a forward filter and at 4 after a smoother, while real tools move at 10 to 30
//! mm/s.
//!
//! **At rest.** A tip that stays within a pixel for [`MIN_REST_S`] is at rest, and the path's own speed there is the
//! noise floor. Tremor counts as noise, so this figure errs on the high side.
//!
//! **Without a rest.** The stated covariances are unsuitable: most of the error that they describe lasts from frame to
//! frame and makes no speed. The changing part is found in the measurements: in their third differences over the
//! slowest quarter of the session, which contain almost nothing of a hand's motion (a jerk of 4000 mm/s³ makes 0.26 mm
//! at 25 frames a second). One error of that size is then sent through the same filter and smoother, with the gains
//! that the believed covariances give. The sum of the squared velocities that it causes is the variance that all errors
//! cause together. Errors of adjacent frames are correlated ([`ERROR_CORRELATION`]); differences hide this and no
//! filter averages it away, so the figure is corrected for both. The correlation depends on the codec and on the
//! motion, so the figure holds within a factor of 2.5: true errors of the smoothed velocity over the slowest quarter
//! were 0.6 to 2.5 times the figure on 24 paths through simulated, ray-traced and drawn scenes, and 11 times on one
//! path of a tool that was mostly out of view. Tremor does not count ([`without_tremor`]).

use nalgebra::{Matrix3, Point3, Vector3};

use super::QualityInput;
use crate::numbers::quantile::quantile;
use crate::vision::filter::kalman::KalmanState;
use crate::vision::filter::smoother::FilterRun;
use crate::vision::pose::CHANGING_SHARE;
use crate::vision::trajectory::{PathKind, Sample, SampleState};

/// Minimum time for which a tip must stay in place to be at rest, s. Half a second at both ends does not count, because
/// the smoother still remembers the motion there.
pub const MIN_REST_S: f64 = 2.0;

/// Time left out at either end of a rest, s.
const SMOOTHER_MEMORY_S: f64 = 0.5;

/// Maximum movement of a resting tip in the picture, pixels: 0.15 mm at 150 mm, less than a hand's tremor.
const MAX_REST_PX: f64 = 1.0;

/// Maximum time between two measurements of one rest, s.
const MAX_STEP_S: f64 = 0.25;

/// Correlation of the errors of adjacent frames: 0 on uncompressed pictures, one half on some of those paths.
const ERROR_CORRELATION: f64 = 0.2;

/// Minimum number of third differences for a median.
const MIN_DIFFERENCES: usize = 30;

/// The RMS speed at which a resting tool would appear to move, mm/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseFloor {
    /// In the smoothed path.
    pub smoothed_mm_s: f64,
    /// In the causal path, as in a live feed; `None` if only the smoothed path is known.
    pub causal_mm_s: Option<f64>,
    /// What it was computed from.
    pub basis: NoiseFloorBasis,
}

/// What a noise floor was computed from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoiseFloorBasis {
    /// Measured while the tool rested, for this many seconds.
    Rest(f64),
    /// Derived from the differences of measurements between frames, because the tool never rested.
    Measurements,
}

impl NoiseFloorBasis {
    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            NoiseFloorBasis::Rest(_) => "rest",
            NoiseFloorBasis::Measurements => "measurements",
        }
    }
}

pub(super) fn estimate(evidence: &QualityInput<'_>, tool: usize) -> Option<NoiseFloor> {
    at_rest(evidence, tool).or_else(|| from_measurements(evidence, tool))
}

/// The noise floor from the stretches where the tool rests.
pub(super) fn at_rest(evidence: &QualityInput<'_>, tool: usize) -> Option<NoiseFloor> {
    let path: Vec<&Sample> = evidence.smoothed.of_tool(tool).collect();
    let rests = rests(&path);
    let inside = |sample: &Sample| rests.iter().any(|(from, until)| (*from..=*until).contains(&sample.time_s));
    let speed = |samples: &mut dyn Iterator<Item = &Sample>| {
        rms(samples.filter(|s| inside(s)).filter_map(|s| s.velocity_mm_s).map(|v| v.norm()))
    };
    let smoothed_mm_s = speed(&mut path.iter().copied())?;
    let causal_mm_s = evidence.others.and_then(|others| speed(&mut others.path(PathKind::Filtered, tool).iter()));
    let rest_s = rests.iter().map(|(from, until)| until - from).sum();
    Some(NoiseFloor { smoothed_mm_s, causal_mm_s, basis: NoiseFloorBasis::Rest(rest_s) })
}

/// Start and end of each rest, s, without the ends where the smoother remembers motion.
fn rests(path: &[&Sample]) -> Vec<(f64, f64)> {
    let seen: Vec<(f64, [f64; 2])> = path
        .iter()
        .filter(|s| s.state == SampleState::Observed)
        .filter_map(|s| s.tip_px.map(|at| (s.time_s, [at.x, at.y])))
        .collect();
    let mut rests = Vec::new();
    let mut first = 0;
    while first < seen.len() {
        let last = last_in_place(&seen, first);
        if seen[last].0 - seen[first].0 >= MIN_REST_S {
            rests.push((seen[first].0 + SMOOTHER_MEMORY_S, seen[last].0 - SMOOTHER_MEMORY_S));
            first = last;
        }
        first += 1;
    }
    rests
}

/// Index of the last sample before the tip leaves its position at `first`.
fn last_in_place(seen: &[(f64, [f64; 2])], first: usize) -> usize {
    let (mut low, mut high) = (seen[first].1, seen[first].1);
    for next in first + 1..seen.len() {
        for axis in 0..2 {
            low[axis] = low[axis].min(seen[next].1[axis]);
            high[axis] = high[axis].max(seen[next].1[axis]);
        }
        let has_moved = (0..2).any(|axis| high[axis] - low[axis] > MAX_REST_PX);
        if has_moved || seen[next].0 - seen[next - 1].0 > MAX_STEP_S {
            return next - 1;
        }
    }
    seen.len() - 1
}

/// The noise floor from the differences of measurements between frames.
pub(super) fn from_measurements(evidence: &QualityInput<'_>, tool: usize) -> Option<NoiseFloor> {
    let raw = evidence.others?.path(PathKind::Raw, tool);
    let steps = raw.windows(2).filter(|pair| pair[1].frame == pair[0].frame + 1);
    let step_s = quantile(steps.map(|pair| pair[1].time_s - pair[0].time_s).collect(), 0.5)?;
    let sigma = |of: fn(&Sample) -> Option<f64>| quantile(raw.iter().filter_map(of).collect(), 0.5);
    let (lateral, depth) = (sigma(Sample::sigma_xy_mm)?, sigma(Sample::sigma_z_mm)?);
    // Nearly all of the stated error lasts, and the filter takes only a share of its variance for noise.
    let believed = Vector3::new(lateral, lateral, depth) * CHANGING_SHARE.sqrt();
    let passing_depth_mm = evidence.tracker.and_then(|tracker| tracker.tools.get(tool)?.transient_depth_sigma_mm);
    let noise = without_tremor(changing_sigma(&raw, step_s)?, passing_depth_mm, lateral / depth);
    /// Variance that slow filters leave of correlated errors, relative to independent ones.
    const CORRELATED_GAIN: f64 = (1.0 + ERROR_CORRELATION) / (1.0 - ERROR_CORRELATION);
    let speeds = noise_speeds(noise, believed, step_s, evidence.motion.noise_density());
    let (smoothed_mm_s, causal_mm_s) = (speeds.0 * CORRELATED_GAIN.sqrt(), speeds.1 * CORRELATED_GAIN.sqrt());
    Some(NoiseFloor { smoothed_mm_s, causal_mm_s: Some(causal_mm_s), basis: NoiseFloorBasis::Measurements })
}

/// Standard deviation of the changing part of the errors, mm, per axis: a robust estimate from third differences
/// between frames, over the slowest quarter of the session.
fn changing_sigma(raw: &[Sample], step_s: f64) -> Option<Vector3<f64>> {
    /// Variance of the differences `-1 3 -3 1` of errors of unit variance with this correlation.
    const GAIN: f64 = 20.0 - 30.0 * ERROR_CORRELATION + 12.0 * ERROR_CORRELATION * ERROR_CORRELATION
        - 2.0 * ERROR_CORRELATION * ERROR_CORRELATION * ERROR_CORRELATION;
    /// Standard deviation divided by the median magnitude, for a normal distribution.
    const PER_MEDIAN: f64 = 1.482_6;
    let even = |w: &&[Sample]| {
        w.windows(2).all(|p| p[1].frame == p[0].frame + 1 && ((p[1].time_s - p[0].time_s) / step_s - 1.0).abs() < 0.2)
    };
    let mut differences: Vec<(f64, Vector3<f64>)> = raw
        .windows(4)
        .filter(even)
        .map(|w| {
            let third = (w[3].tip_mm - w[0].tip_mm) - (w[2].tip_mm - w[1].tip_mm) * 3.0;
            ((w[3].tip_mm - w[0].tip_mm).xy().norm(), third)
        })
        .collect();
    if differences.len() < MIN_DIFFERENCES {
        return None;
    }
    differences.sort_by(|a, b| a.0.total_cmp(&b.0));
    differences.truncate((differences.len() / 4).max(MIN_DIFFERENCES));
    let axis = |i: usize| quantile(differences.iter().map(|(_, d)| d[i].abs()).collect(), 0.5);
    Some(Vector3::new(axis(0)?, axis(1)?, axis(2)?) * PER_MEDIAN / GAIN.sqrt())
}

/// Changes beyond the measurement error are the hand's tremor and are removed. Along the line of sight, at most the
/// passing error that the measurements state counts as noise: on 29 paths through simulated, ray-traced and drawn
/// scenes that was 1.2 to 5 times the truth. Across it, at most the depth noise times the stated ratio of both.
fn without_tremor(changes_mm: Vector3<f64>, passing_depth_mm: Option<f64>, lateral_to_depth: f64) -> Vector3<f64> {
    /// Minimum ratio, for caution.
    const MIN_RATIO: f64 = 0.2;
    let depth = passing_depth_mm.map_or(changes_mm.z, |passing| changes_mm.z.min(passing));
    let max_lateral = depth * lateral_to_depth.max(MIN_RATIO);
    Vector3::new(changes_mm.x.min(max_lateral), changes_mm.y.min(max_lateral), depth)
}

/// The RMS speeds that independent errors of standard deviation `noise_mm` cause at rest, in the smoothed and in the
/// causal path, mm/s, if the filter believes in errors of `believed_mm`.
pub(super) fn noise_speeds(
    noise_mm: Vector3<f64>,
    believed_mm: Vector3<f64>,
    step_s: f64,
    noise_density: f64,
) -> (f64, f64) {
    /// Time on either side of the error, s: longer than any filter here remembers.
    const SIDE_S: f64 = 3.0;
    const MAX_STEPS: f64 = 500.0;
    let side = (SIDE_S / step_s).clamp(8.0, MAX_STEPS) as usize;
    let covariance = Matrix3::from_diagonal(&believed_mm.component_mul(&believed_mm));
    let mut state = KalmanState::first_seen(Point3::origin(), covariance, 0.0);
    let mut run = FilterRun::default();
    run.push(0.0, &state, 0.0, None);
    for step in 1..=2 * side {
        let seen = if step == side { Point3::from(noise_mm) } else { Point3::origin() };
        state = state.predicted(step_s, noise_density).updated(seen, covariance);
        run.push(step as f64 * step_s, &state, noise_density, Some((seen, covariance)));
    }
    let root =
        |states: &mut dyn Iterator<Item = KalmanState>| states.map(|s| s.velocity().norm_squared()).sum::<f64>().sqrt();
    (root(&mut run.smoothed()), root(&mut run.filtered()))
}

fn rms(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (count, squares) = values.fold((0u64, 0.0), |(n, s), v| (n + 1, s + v * v));
    (count > 0).then(|| (squares / count as f64).sqrt())
}
