//! Pairs each row of a trajectory with the truth of the same frame and tool.

use std::collections::{HashMap, HashSet};

use nalgebra::Vector3;

use super::truth::{Truth, TruthTool};
use crate::vision::trajectory::{Sample, Trajectory};

/// If less than this share of its band is visible, a tool is out of sight, and a row for it is false.
pub const MIN_VISIBLE_SHARE: f64 = 0.02;

/// Why a trajectory cannot be compared with a truth.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EvaluationProblem {
    /// The truth has none of the trajectory's tools.
    #[error("the truth has none of the trajectory's tools ({}); it has {}", tools.join(", "), known.join(", "))]
    UnknownTools {
        /// The trajectory's names.
        tools: Vec<String>,
        /// The truth's names.
        known: Vec<String>,
    },
    /// The truth has no tool or no frame.
    #[error("the truth names no tool on any frame")]
    EmptyTruth,
    /// Truth and trajectory have no frame in common.
    #[error("the truth has none of the trajectory's frames; the first one is {first}")]
    UnknownFrames {
        /// The trajectory's first frame.
        first: u64,
    },
}

/// A row of a trajectory with the truth of its frame and tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JudgedRow<'a> {
    /// The row.
    pub sample: &'a Sample,
    /// Its tool's name.
    pub tool: &'a str,
    /// The frame's true time, s.
    pub time_s: f64,
    /// Share of the band that could be seen; 0 if the truth does not have the tool on this frame.
    pub visible: f64,
    /// Measured minus true position, mm; zero if the truth does not have the tool on this frame.
    pub error_mm: Vector3<f64>,
    /// True if the row lies nearer to another tool's true tip than to its own.
    pub nearer_to_another: bool,
}

impl JudgedRow<'_> {
    /// True if the tool is out of sight, or does not exist on this frame.
    pub fn is_false(&self) -> bool {
        self.visible < MIN_VISIBLE_SHARE
    }
}

/// Every row whose frame is in the truth, in the trajectory's order.
///
/// # Errors
/// [`EvaluationProblem`] if truth and trajectory have no tool or no frame in common.
pub fn pair_with_truth<'a>(trajectory: &'a Trajectory, truth: &Truth) -> Result<Vec<JudgedRow<'a>>, EvaluationProblem> {
    check(trajectory, truth)?;
    let index: HashMap<u64, usize> = truth.frames.iter().enumerate().map(|(i, frame)| (frame.frame, i)).collect();
    let rows = trajectory.samples.iter().filter_map(|sample| {
        let (frame, name) = (&truth.frames[*index.get(&sample.frame)?], trajectory.tools.get(sample.tool)?);
        let own = frame.tools.iter().find(|tool| tool.tool == *name);
        let distance = |tool: &TruthTool| (sample.tip_mm - tool.tip_mm).norm();
        let mut others = frame.tools.iter().filter(|tool| tool.tool != *name && tool.visible >= MIN_VISIBLE_SHARE);
        Some(JudgedRow {
            sample,
            tool: name,
            time_s: frame.time_s,
            visible: own.map_or(0.0, |own| own.visible),
            error_mm: own.map_or_else(Vector3::zeros, |own| sample.tip_mm - own.tip_mm),
            nearer_to_another: own.is_some_and(|own| others.any(|other| distance(other) < distance(own))),
        })
    });
    Ok(rows.collect())
}

/// All tools, the truth's first, each once.
pub fn tool_names(trajectory: &Trajectory, truth: &Truth) -> Vec<String> {
    let mut known = HashSet::new();
    let of_truth = truth.frames.iter().flat_map(|frame| &frame.tools).map(|tool| &tool.tool);
    of_truth.chain(&trajectory.tools).filter(|name| known.insert(name.as_str())).cloned().collect()
}

fn check(trajectory: &Trajectory, truth: &Truth) -> Result<(), EvaluationProblem> {
    let tools: HashSet<&String> = truth.frames.iter().flat_map(|frame| &frame.tools).map(|tool| &tool.tool).collect();
    if tools.is_empty() {
        return Err(EvaluationProblem::EmptyTruth);
    }
    let Some(first) = trajectory.samples.first() else { return Ok(()) }; // an empty track is a result, not a problem
    if !trajectory.tools.iter().any(|tool| tools.contains(tool)) {
        let mut known: Vec<String> = tools.into_iter().cloned().collect();
        known.sort();
        return Err(EvaluationProblem::UnknownTools { tools: trajectory.tools.clone(), known });
    }
    let frames: HashSet<u64> = truth.frames.iter().map(|frame| frame.frame).collect();
    let any_known = trajectory.samples.iter().any(|sample| frames.contains(&sample.frame));
    if any_known { Ok(()) } else { Err(EvaluationProblem::UnknownFrames { first: first.frame }) }
}
