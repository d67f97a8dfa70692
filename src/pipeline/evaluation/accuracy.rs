//! A trajectory against the truth: how far off, how much found, how often wrong.
//!
//! A row is judged by the truth of the same frame and tool. Errors count only where enough of the band could be seen;
//! rows of a tool that is out of sight, or not in the truth at all, are *false tracks*; a row that lies nearer to another tool's tip than to its own
//! is a *swap*. Errors come out separately for observed and for predicted rows, because a tracker that predicts more
//! finds more and errs more.

use std::collections::{HashMap, HashSet};

use nalgebra::Vector3;

use super::truth::{Truth, TruthTool};
use crate::pipeline::trajectory::{Sample, SampleState, Trajectory};

/// Shares of the band from which a tool counts as visible: what a tracker should find, and what it should find well.
pub const VISIBLE_FROM: [f64; 2] = [0.4, 0.8];

/// Below this share of the band a tool is out of sight, and a row for it false.
pub const OUT_OF_SIGHT_BELOW: f64 = 0.02;

/// 95 % of a normal error lies within these, in standard deviations or their square, for one, two and three axes.
const WITHIN_95: [f64; 3] = [1.959_964, 5.991_465, 7.814_728];

/// Fewest rows from which a lag is estimated.
const LAG_ROWS: usize = 10;

/// Why a trajectory cannot be judged by a truth.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EvaluationProblem {
    /// Names of which the truth knows none.
    #[error("the truth knows none of the trajectory's tools ({}), but {}", tools.join(", "), known.join(", "))]
    UnknownTools {
        /// The trajectory's names.
        tools: Vec<String>,
        /// The truth's names.
        known: Vec<String>,
    },
    /// No tool or no frame in the truth.
    #[error("the truth names no tool on any frame")]
    EmptyTruth,
    /// Not one frame in common.
    #[error("the truth has none of the trajectory's frames, the first of which is {first}")]
    UnknownFrames {
        /// The trajectory's first frame.
        first: u64,
    },
}

/// Everything that was measured against one truth.
#[derive(Clone, Debug, PartialEq)]
pub struct Accuracy {
    /// Each tool of the truth, then those that only the trajectory knows.
    pub tools: Vec<ToolAccuracy>,
    /// All tools together.
    pub all: ToolAccuracy,
    /// Rows on frames that the truth does not have.
    pub unjudged: usize,
    /// Largest difference between the two times of one frame, s. More than half a frame's duration means that the two
    /// do not count the same frames.
    pub largest_time_difference_s: f64,
}

/// How well one tool, or all of them, were tracked.
#[derive(Clone, Debug, PartialEq)]
pub struct ToolAccuracy {
    /// The tool's name; `None` for all tools.
    pub tool: Option<String>,
    /// Rows of the trajectory.
    pub rows: usize,
    /// Rows while the tool is out of sight.
    pub false_tracks: usize,
    /// For each of [`VISIBLE_FROM`].
    pub levels: Vec<Level>,
}

/// How well a tool was tracked where at least a given share of its band is visible.
#[derive(Clone, Debug, PartialEq)]
pub struct Level {
    /// The share.
    pub visible_from: f64,
    /// Frames on which so much is visible.
    pub frames: usize,
    /// Of these, how many have a row.
    pub found: usize,
    /// Of these, how many have a row that was observed.
    pub observed: usize,
    /// Rows that lie nearer to another tool's true tip than to their own.
    pub swaps: usize,
    /// Errors of all rows; `None` without a row.
    pub errors: Option<Errors>,
    /// Errors of the observed rows.
    pub observed_errors: Option<Errors>,
    /// Errors of the predicted rows.
    pub predicted_errors: Option<Errors>,
    /// By how much the track lags behind the truth, s, to first order; `None` where too little moves to tell.
    pub lag_s: Option<f64>,
    /// How often the error lies inside the 95 % region that the track itself states; `None` without stated sigmas.
    pub inside: Option<Inside>,
}

/// Errors of a set of rows, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// How many rows.
    pub rows: usize,
    /// In x and y together.
    pub lateral: Spread,
    /// In z.
    pub depth: Spread,
    /// In all three.
    pub three_d: Spread,
    /// Mean of the signed error per axis.
    pub bias_mm: Vector3<f64>,
    /// Standard deviation of the signed error per axis: what a better calibration could not remove.
    pub deviation_mm: Vector3<f64>,
}

/// The size of an error, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Root of the mean square.
    pub rms: f64,
    /// Median.
    pub median: f64,
    /// Exceeded by 5 %.
    pub p95: f64,
    /// Largest.
    pub max: f64,
}

/// Shares of the rows whose error lies inside the region that should hold 95 % of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inside {
    /// Rows that state both sigmas.
    pub rows: usize,
    /// By the ellipse of x and y.
    pub lateral: f64,
    /// By the interval of z.
    pub depth: f64,
    /// By the ellipsoid of all three.
    pub three_d: f64,
}

/// A row with the truth that judges it.
struct Judged<'a> {
    sample: &'a Sample,
    tool: &'a str,
    /// Share of the band that could be seen; 0 for a tool that the truth does not have there.
    visible: f64,
    /// Zero for a tool that the truth does not have there.
    error_mm: Vector3<f64>,
    /// The true velocity, mm/s, where the truth has the frames around.
    velocity_mm_s: Option<Vector3<f64>>,
    nearer_to_another: bool,
}

/// Measures a trajectory against the truth.
pub fn accuracy(trajectory: &Trajectory, truth: &Truth) -> Result<Accuracy, EvaluationProblem> {
    let names = names(trajectory, truth);
    check(trajectory, truth)?;
    let judged = judge(trajectory, truth);
    let of = |tool: Option<&String>| {
        let rows: Vec<&Judged> = judged.iter().filter(|row| tool.is_none_or(|name| row.tool == name)).collect();
        tool_accuracy(tool, &rows, truth)
    };
    Ok(Accuracy {
        tools: names.iter().map(|name| of(Some(name))).collect(),
        all: of(None),
        unjudged: trajectory.samples.len() - judged.len(),
        largest_time_difference_s: largest_time_difference_s(trajectory, truth),
    })
}

/// All tools, the truth's first, each once.
fn names(trajectory: &Trajectory, truth: &Truth) -> Vec<String> {
    let mut known = HashSet::new();
    let of_truth = truth.frames.iter().flat_map(|frame| &frame.tools).map(|tool| &tool.tool);
    of_truth.chain(&trajectory.tools).filter(|name| known.insert(name.as_str())).cloned().collect()
}

fn check(trajectory: &Trajectory, truth: &Truth) -> Result<(), EvaluationProblem> {
    let tools: HashSet<&String> = truth.frames.iter().flat_map(|frame| &frame.tools).map(|tool| &tool.tool).collect();
    if tools.is_empty() {
        return Err(EvaluationProblem::EmptyTruth);
    }
    let Some(first) = trajectory.samples.first() else { return Ok(()) }; // nothing was tracked: a result, not a problem
    if !trajectory.tools.iter().any(|tool| tools.contains(tool)) {
        let mut known: Vec<String> = tools.into_iter().cloned().collect();
        known.sort();
        return Err(EvaluationProblem::UnknownTools { tools: trajectory.tools.clone(), known });
    }
    let frames: HashSet<u64> = truth.frames.iter().map(|frame| frame.frame).collect();
    let any_known = trajectory.samples.iter().any(|sample| frames.contains(&sample.frame));
    if any_known { Ok(()) } else { Err(EvaluationProblem::UnknownFrames { first: first.frame }) }
}

fn judge<'a>(trajectory: &'a Trajectory, truth: &'a Truth) -> Vec<Judged<'a>> {
    let index: HashMap<u64, usize> = truth.frames.iter().enumerate().map(|(i, frame)| (frame.frame, i)).collect();
    let rows = trajectory.samples.iter().filter_map(|sample| {
        let (at, name) = (*index.get(&sample.frame)?, trajectory.tools.get(sample.tool)?);
        let tools = &truth.frames[at].tools;
        let own = tools.iter().find(|tool| tool.tool == *name);
        let distance = |tool: &TruthTool| (sample.tip_mm - tool.tip_mm).norm();
        let mut others = tools.iter().filter(|tool| tool.tool != *name && tool.visible >= OUT_OF_SIGHT_BELOW);
        Some(Judged {
            sample,
            tool: name,
            visible: own.map_or(0.0, |own| own.visible),
            error_mm: own.map_or_else(Vector3::zeros, |own| sample.tip_mm - own.tip_mm),
            velocity_mm_s: velocity_mm_s(truth, at, name),
            nearer_to_another: own.is_some_and(|own| others.any(|other| distance(other) < distance(own))),
        })
    });
    rows.collect()
}

/// The true velocity at a frame, from the frames around it: the truth has no noise that a difference could raise.
fn velocity_mm_s(truth: &Truth, at: usize, name: &str) -> Option<Vector3<f64>> {
    let (before, after) = (truth.frames.get(at.checked_sub(1)?)?, truth.frames.get(at + 1)?);
    let tip = |tools: &[TruthTool]| tools.iter().find(|tool| tool.tool == name).map(|tool| tool.tip_mm);
    Some((tip(&after.tools)? - tip(&before.tools)?) / (after.time_s - before.time_s))
}

fn tool_accuracy(tool: Option<&String>, rows: &[&Judged], truth: &Truth) -> ToolAccuracy {
    ToolAccuracy {
        tool: tool.cloned(),
        rows: rows.len(),
        false_tracks: rows.iter().filter(|row| row.visible < OUT_OF_SIGHT_BELOW).count(),
        levels: VISIBLE_FROM.iter().map(|from| level(*from, tool, rows, truth)).collect(),
    }
}

fn level(visible_from: f64, tool: Option<&String>, rows: &[&Judged], truth: &Truth) -> Level {
    let tools = truth.frames.iter().flat_map(|frame| &frame.tools);
    let visible = |t: &&TruthTool| t.visible >= visible_from && tool.is_none_or(|name| t.tool == *name);
    let rows: Vec<&Judged> = rows.iter().filter(|row| row.visible >= visible_from).copied().collect();
    let of_state = |state: SampleState| {
        let errors: Vec<_> = rows.iter().filter(|r| r.sample.state == state).map(|r| r.error_mm).collect();
        errors
    };
    let observed = of_state(SampleState::Observed);
    Level {
        visible_from,
        frames: tools.filter(visible).count(),
        found: rows.len(),
        observed: observed.len(),
        swaps: rows.iter().filter(|row| row.nearer_to_another).count(),
        errors: Errors::of(&rows.iter().map(|row| row.error_mm).collect::<Vec<_>>()),
        observed_errors: Errors::of(&observed),
        predicted_errors: Errors::of(&of_state(SampleState::Predicted)),
        lag_s: lag_s(&rows),
        inside: inside(&rows),
    }
}

impl Errors {
    fn of(errors: &[Vector3<f64>]) -> Option<Errors> {
        let mean = |of: &dyn Fn(&Vector3<f64>) -> Vector3<f64>| {
            errors.iter().map(of).sum::<Vector3<f64>>() / errors.len() as f64
        };
        let bias_mm = mean(&|e| *e);
        Some(Errors {
            rows: errors.len(),
            lateral: Spread::of(errors.iter().map(|e| e.xy().norm()).collect())?,
            depth: Spread::of(errors.iter().map(|e| e.z.abs()).collect())?,
            three_d: Spread::of(errors.iter().map(Vector3::norm).collect())?,
            bias_mm,
            deviation_mm: mean(&|e| (e - bias_mm).component_mul(&(e - bias_mm))).map(f64::sqrt),
        })
    }
}

impl Spread {
    fn of(mut sizes: Vec<f64>) -> Option<Spread> {
        sizes.sort_by(f64::total_cmp);
        let mean_square = sizes.iter().map(|s| s * s).sum::<f64>() / sizes.len() as f64;
        let (median, p95) = (quantile(&sizes, 0.5)?, quantile(&sizes, 0.95)?);
        Some(Spread { rms: mean_square.sqrt(), median, p95, max: *sizes.last()? })
    }
}

/// A quantile of sorted values, linear between neighbours.
fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let place = share * sorted.len().checked_sub(1)? as f64;
    let (below, above) = (sorted[place.floor() as usize], sorted[place.ceil() as usize]);
    Some(below + (above - below) * place.fract())
}

/// A track that lags by τ errs by −τ·v to first order; τ is the regression of the error on the true velocity.
fn lag_s(rows: &[&Judged]) -> Option<f64> {
    let pairs: Vec<_> = rows.iter().filter_map(|row| Some((row.error_mm, row.velocity_mm_s?))).collect();
    let n = pairs.len() as f64;
    let mean_error = pairs.iter().map(|p| p.0).sum::<Vector3<f64>>() / n;
    let mean_velocity = pairs.iter().map(|p| p.1).sum::<Vector3<f64>>() / n;
    let centred = pairs.iter().map(|(error, velocity)| (error - mean_error, velocity - mean_velocity));
    let (product, square) = centred.fold((0.0, 0.0), |(p, s), (e, v)| (p + e.dot(&v), s + v.norm_squared()));
    (pairs.len() >= LAG_ROWS && square / n > 1.0).then(|| -product / square) // below 1 mm/s nothing moves
}

fn inside(rows: &[&Judged]) -> Option<Inside> {
    let stated: Vec<[bool; 3]> = rows.iter().filter_map(|row| inside_of(row)).collect();
    let share = |axes: usize| stated.iter().filter(|inside| inside[axes]).count() as f64 / stated.len() as f64;
    (!stated.is_empty()).then(|| Inside { rows: stated.len(), depth: share(0), lateral: share(1), three_d: share(2) })
}

/// Is the error inside the 95 % region of z, of x and y, of all three?
fn inside_of(row: &Judged) -> Option<[bool; 3]> {
    let (sigma_xy, sigma_z) = (row.sample.sigma_xy_mm?, row.sample.sigma_z_mm?);
    let depth = (row.error_mm.z / sigma_z).abs();
    let lateral = (row.error_mm.xy() / sigma_xy).norm_squared();
    Some([depth <= WITHIN_95[0], lateral <= WITHIN_95[1], depth * depth + lateral <= WITHIN_95[2]])
}

fn largest_time_difference_s(trajectory: &Trajectory, truth: &Truth) -> f64 {
    let times: HashMap<u64, f64> = truth.frames.iter().map(|frame| (frame.frame, frame.time_s)).collect();
    let differences = trajectory.samples.iter().filter_map(|s| Some((s.time_s - times.get(&s.frame)?).abs()));
    differences.fold(0.0, f64::max)
}

#[cfg(test)]
mod tests;
