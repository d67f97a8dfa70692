//! Compares a trajectory with the truth: size of the errors, share found, false tracks and swaps.
//!
//! A row is compared with the truth of the same frame and tool. Errors count only where enough of the band could be
//! seen. Rows of a tool that is out of sight, or not in the truth at all, are *false tracks*. A row that lies nearer to
//! another tool's tip than to its own is a *swap*. Errors are reported separately for observed and predicted rows,
//! because a tracker that predicts more also finds more and has larger errors.

use std::collections::HashMap;

use super::errors::Errors;
use super::honesty::Honesty;
use super::judged::{EvaluationProblem, Judged, judge, names};
use super::lag::{self, Lag};
use super::motion::Motion;
use super::rest::NoiseFloor;
use super::truth::Truth;
use crate::pipeline::trajectory::{SampleState, Trajectory};

/// Minimum visible shares of the band: a tracker should find a tool above the first, and find it well above the second.
pub const VISIBLE_FROM: [f64; 2] = [0.4, 0.8];

/// All figures of a trajectory against one truth.
#[derive(Clone, Debug, PartialEq)]
pub struct Accuracy {
    /// Each tool of the truth, then the tools that only the trajectory has.
    pub tools: Vec<ToolAccuracy>,
    /// All tools together.
    pub all: ToolAccuracy,
    /// Rows on frames that the truth does not have.
    pub unjudged: usize,
    /// Largest difference between the two times of one frame, s. More than half a frame's duration means that truth and
    /// trajectory do not count the same frames.
    pub largest_time_difference_s: f64,
}

/// How well one tool, or all tools together, were tracked.
#[derive(Clone, Debug, PartialEq)]
pub struct ToolAccuracy {
    /// The tool's name; `None` for all tools.
    pub tool: Option<String>,
    /// Rows of the trajectory.
    pub rows: usize,
    /// Rows while the tool is out of sight.
    pub false_tracks: usize,
    /// Speed of the track while the tool rests; `None` if the tool never rests for long enough.
    pub at_rest: Option<NoiseFloor>,
    /// The figures for each of [`VISIBILITY_LEVELS`].
    pub levels: Vec<Level>,
}

/// How well a tool was tracked where at least a given share of its band is visible.
#[derive(Clone, Debug, PartialEq)]
pub struct Level {
    /// Minimum visible share of the band.
    pub visible_from: f64,
    /// Frames with at least this share visible.
    pub frames: usize,
    /// Number of these frames with a row.
    pub found: usize,
    /// Number of these frames with an observed row.
    pub observed: usize,
    /// Rows that lie nearer to another tool's true tip than to their own.
    pub swaps: usize,
    /// Errors of all rows; `None` without a row.
    pub errors: Option<Errors>,
    /// Errors of the observed rows.
    pub observed_errors: Option<Errors>,
    /// Errors of the predicted rows.
    pub predicted_errors: Option<Errors>,
    /// Lag of the track behind the truth.
    pub lag: Lag,
    /// Comparison of the errors with the stated sigmas; `None` without stated sigmas.
    pub honesty: Option<Honesty>,
}

/// Measures a trajectory against the truth.
///
/// # Errors
/// [`EvaluationProblem`] if truth and trajectory have no tool or no frame in common.
pub fn accuracy(trajectory: &Trajectory, truth: &Truth) -> Result<Accuracy, EvaluationProblem> {
    let judged = judge(trajectory, truth)?;
    let names = names(trajectory, truth);
    let motions = names.iter().map(|name| (name.as_str(), Motion::of(truth, name))).collect();
    let of = |tool: Option<&String>| {
        let rows: Vec<&Judged> = judged.iter().filter(|row| tool.is_none_or(|name| row.tool == name)).collect();
        tool_accuracy(tool, &rows, truth, &motions)
    };
    Ok(Accuracy {
        tools: names.iter().map(|name| of(Some(name))).collect(),
        all: of(None),
        unjudged: trajectory.samples.len() - judged.len(),
        largest_time_difference_s: judged.iter().map(|r| (r.sample.time_s - r.time_s).abs()).fold(0.0, f64::max),
    })
}

fn tool_accuracy(
    tool: Option<&String>,
    rows: &[&Judged],
    truth: &Truth,
    motions: &HashMap<&str, Motion>,
) -> ToolAccuracy {
    ToolAccuracy {
        tool: tool.cloned(),
        rows: rows.len(),
        false_tracks: rows.iter().filter(|row| row.is_false()).count(),
        at_rest: NoiseFloor::of(&visible(rows, VISIBLE_FROM[0]), motions),
        levels: VISIBLE_FROM.iter().map(|from| level(*from, tool, rows, truth, motions)).collect(),
    }
}

fn visible<'a>(rows: &[&'a Judged<'a>], from: f64) -> Vec<&'a Judged<'a>> {
    rows.iter().filter(|row| row.visible >= from).copied().collect()
}

fn level(
    visible_from: f64,
    tool: Option<&String>,
    rows: &[&Judged],
    truth: &Truth,
    motions: &HashMap<&str, Motion>,
) -> Level {
    let tools = truth.frames.iter().flat_map(|frame| &frame.tools);
    let seen = tools.filter(|t| t.visible >= visible_from && tool.is_none_or(|name| t.tool == *name));
    let rows = visible(rows, visible_from);
    let of_state = |state: SampleState| {
        let errors: Vec<_> = rows.iter().filter(|r| r.sample.state == state).map(|r| r.error_mm).collect();
        errors
    };
    let observed = of_state(SampleState::Observed);
    Level {
        visible_from,
        frames: seen.count(),
        found: rows.len(),
        observed: observed.len(),
        swaps: rows.iter().filter(|row| row.nearer_to_another).count(),
        errors: Errors::of(&rows.iter().map(|row| row.error_mm).collect::<Vec<_>>()),
        observed_errors: Errors::of(&observed),
        predicted_errors: Errors::of(&of_state(SampleState::Predicted)),
        lag: lag::lag(&rows, motions),
        honesty: Honesty::of(&rows),
    }
}
