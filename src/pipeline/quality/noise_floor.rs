//! The noise floor: the speed, mm/s, that the smoothed and the causal path would give a tool that rests.
//!
//! Depth noise dominates every feature of motion: σ_z = 2 mm at 25 frames a second makes a resting tool "move" at 60 mm/s
//! raw, 21 behind a forward filter, 4 behind a smoother, while real tools move at 10 to 30 mm/s.
//!
//! **At rest.** Where the tip stays within a pixel for [`REST_S`], it rests, and the path's own speed there is the answer.
//! Tremor counts as noise: the figure errs to the high side.
//!
//! **Without a rest.** The stated covariances would not do: most of what they hold lasts from frame to frame, and makes
//! no speed. The part that changes is found in the measurements themselves: their third differences, in which a hand's
//! motion hardly shows (a jerk of 4000 mm/s³ makes 0.26 mm at 25 frames a second), over the slowest quarter of the
//! session. One such error is then sent through the very filter and smoother, with the gains that believed covariances
//! give: the squares of the velocities that it makes, summed, are the variance that all of them make together. Errors of
//! neighbouring frames are alike ([`ALIKE`]), which differences hide and no filter averages away: the figure makes up for
//! both. How alike depends on the codec and on the motion, and so the figure holds within a factor of 2.5: true errors of
//! the smoothed velocity over the slowest quarter were 0.6 to 2.5 times it on 24 paths through simulated, ray-traced and
//! drawn scenes, and 11 times on one of a tool that was mostly out of view. Tremor does not count ([`without_tremor`]).

use nalgebra::{Matrix3, Point3, Vector3};

use super::{Evidence, quantile};
use crate::pipeline::filter::kalman::State;
use crate::pipeline::filter::smoother::Run;
use crate::pipeline::tracker::STATED_SHARE;
use crate::pipeline::trajectory::{Kind, Sample, SampleState};

/// How long a tip must stay in its place to be at rest, s: half a second at both ends does not count, where the smoother
/// still remembers the motion.
pub const REST_S: f64 = 2.0;

/// At either end of a rest, s.
const MEMORY_S: f64 = 0.5;

/// How far a resting tip may wander in the picture, pixels: 0.15 mm at 150 mm, less than a hand's tremor.
const REST_PX: f64 = 1.0;

/// Longest step between two measurements of one rest, s.
const UNBROKEN_S: f64 = 0.25;

/// Correlation of the errors of neighbouring frames: none on uncompressed pictures, one half on some of those paths.
const ALIKE: f64 = 0.2;

/// Third differences that a median needs.
const FEWEST: usize = 30;

/// The speed that a resting tool would be given, RMS, mm/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseFloor {
    /// In the smoothed path.
    pub smoothed_mm_s: f64,
    /// In the causal path, as live; `None` where only the smoothed one is known.
    pub causal_mm_s: Option<f64>,
    /// What it was worked out from.
    pub basis: Basis,
}

/// What a noise floor was worked out from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Basis {
    /// Measured while the tool rested for so many seconds.
    Rest(f64),
    /// From how much measurements differ from frame to frame: the tool never rested.
    Measurements,
}

impl Basis {
    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            Basis::Rest(_) => "rest",
            Basis::Measurements => "measurements",
        }
    }
}

pub(super) fn estimate(evidence: &Evidence<'_>, tool: usize) -> Option<NoiseFloor> {
    at_rest(evidence, tool).or_else(|| from_measurements(evidence, tool))
}

/// From the stretches in which the tool rests.
pub(super) fn at_rest(evidence: &Evidence<'_>, tool: usize) -> Option<NoiseFloor> {
    let path: Vec<&Sample> = evidence.smoothed.of_tool(tool).collect();
    let rests = rests(&path);
    let inside = |sample: &Sample| rests.iter().any(|(from, until)| (*from..=*until).contains(&sample.time_s));
    let speed = |samples: &mut dyn Iterator<Item = &Sample>| {
        rms(samples.filter(|s| inside(s)).filter_map(|s| s.velocity_mm_s).map(|v| v.norm()))
    };
    let smoothed_mm_s = speed(&mut path.iter().copied())?;
    let causal_mm_s = evidence.others.and_then(|others| speed(&mut others.path(Kind::Filtered, tool).iter()));
    let rest_s = rests.iter().map(|(from, until)| until - from).sum();
    Some(NoiseFloor { smoothed_mm_s, causal_mm_s, basis: Basis::Rest(rest_s) })
}

/// Beginnings and ends of rests, s, without the parts that remember motion.
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
        if seen[last].0 - seen[first].0 >= REST_S {
            rests.push((seen[first].0 + MEMORY_S, seen[last].0 - MEMORY_S));
            first = last;
        }
        first += 1;
    }
    rests
}

/// The last place up to which the tip stays where it is at `first`.
fn last_in_place(seen: &[(f64, [f64; 2])], first: usize) -> usize {
    let (mut low, mut high) = (seen[first].1, seen[first].1);
    for next in first + 1..seen.len() {
        for axis in 0..2 {
            low[axis] = low[axis].min(seen[next].1[axis]);
            high[axis] = high[axis].max(seen[next].1[axis]);
        }
        let has_moved = (0..2).any(|axis| high[axis] - low[axis] > REST_PX);
        if has_moved || seen[next].0 - seen[next - 1].0 > UNBROKEN_S {
            return next - 1;
        }
    }
    seen.len() - 1
}

/// From how much measurements differ from frame to frame.
pub(super) fn from_measurements(evidence: &Evidence<'_>, tool: usize) -> Option<NoiseFloor> {
    let raw = evidence.others?.path(Kind::Raw, tool);
    let steps = raw.windows(2).filter(|pair| pair[1].frame == pair[0].frame + 1);
    let step_s = quantile(steps.map(|pair| pair[1].time_s - pair[0].time_s).collect(), 0.5)?;
    let sigma = |of: fn(&Sample) -> Option<f64>| quantile(raw.iter().filter_map(of).collect(), 0.5);
    let (lateral, depth) = (sigma(|s| s.sigma_xy_mm)?, sigma(|s| s.sigma_z_mm)?);
    let believed = Vector3::new(lateral, lateral, depth) / STATED_SHARE;
    let passing_depth_mm = evidence.tracker.and_then(|tracker| tracker.tools.get(tool)?.passing_depth_mm);
    let noise = without_tremor(changes(&raw, step_s)?, passing_depth_mm, lateral / depth);
    /// What slow filters leave of alike errors, against independent ones.
    const LEFT: f64 = (1.0 + ALIKE) / (1.0 - ALIKE);
    let speeds = speeds(noise, believed, step_s, evidence.motion.noise_density());
    let (smoothed_mm_s, causal_mm_s) = (speeds.0 * LEFT.sqrt(), speeds.1 * LEFT.sqrt());
    Some(NoiseFloor { smoothed_mm_s, causal_mm_s: Some(causal_mm_s), basis: Basis::Measurements })
}

/// Standard deviation of what changes in the measurements, mm, per axis: a robust one, of third differences from frame to
/// frame, over the slowest quarter of the session.
fn changes(raw: &[Sample], step_s: f64) -> Option<Vector3<f64>> {
    /// Variance of the differences `-1 3 -3 1` of errors of unit variance, of which the next is this much alike.
    const GAIN: f64 = 20.0 - 30.0 * ALIKE + 12.0 * ALIKE * ALIKE - 2.0 * ALIKE * ALIKE * ALIKE;
    /// Standard deviation over median magnitude, of a normal distribution.
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
    if differences.len() < FEWEST {
        return None;
    }
    differences.sort_by(|a, b| a.0.total_cmp(&b.0));
    differences.truncate((differences.len() / 4).max(FEWEST));
    let axis = |i: usize| quantile(differences.iter().map(|(_, d)| d[i].abs()).collect(), 0.5);
    Some(Vector3::new(axis(0)?, axis(1)?, axis(2)?) * PER_MEDIAN / GAIN.sqrt())
}

/// What changes by more than measuring errs is the hand's tremor. Along the line of sight, no more of it is noise than the
/// measurements state to pass: on 29 paths through simulated, ray-traced and drawn scenes that was 1.2 to 5 times the truth.
/// Across it, no more than the noise of depth makes with the stated ratio of both.
fn without_tremor(changes_mm: Vector3<f64>, passing_depth_mm: Option<f64>, lateral_to_depth: f64) -> Vector3<f64> {
    /// What the ratio is at least, for caution.
    const LEAST_RATIO: f64 = 0.2;
    let depth = passing_depth_mm.map_or(changes_mm.z, |passing| changes_mm.z.min(passing));
    let most = depth * lateral_to_depth.max(LEAST_RATIO);
    Vector3::new(changes_mm.x.min(most), changes_mm.y.min(most), depth)
}

/// The RMS speeds that independent errors of standard deviation `noise_mm` make of a rest, in the smoothed and in the causal
/// path, mm/s, where the filter believes in errors of `believed_mm`.
pub(super) fn speeds(noise_mm: Vector3<f64>, believed_mm: Vector3<f64>, step_s: f64, noise_density: f64) -> (f64, f64) {
    /// Longer than any filter here remembers, to either side of the error.
    const SIDE_S: f64 = 3.0;
    const MOST_STEPS: f64 = 500.0;
    let side = (SIDE_S / step_s).clamp(8.0, MOST_STEPS) as usize;
    let covariance = Matrix3::from_diagonal(&believed_mm.component_mul(&believed_mm));
    let mut state = State::first_seen(Point3::origin(), covariance, 0.0);
    let mut run = Run::default();
    run.push(0.0, &state, 0.0, None);
    for step in 1..=2 * side {
        let seen = if step == side { Point3::from(noise_mm) } else { Point3::origin() };
        state = state.predicted(step_s, noise_density).updated(seen, covariance);
        run.push(step as f64 * step_s, &state, noise_density, Some((seen, covariance)));
    }
    let root =
        |states: &mut dyn Iterator<Item = State>| states.map(|s| s.velocity().norm_squared()).sum::<f64>().sqrt();
    (root(&mut run.smoothed()), root(&mut run.filtered()))
}

fn rms(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (count, squares) = values.fold((0u64, 0.0), |(n, s), v| (n + 1, s + v * v));
    (count > 0).then(|| (squares / count as f64).sqrt())
}
