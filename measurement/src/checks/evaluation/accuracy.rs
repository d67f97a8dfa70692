//! Compares a trajectory with the truth: size of the errors, share found, false tracks and swaps.
//!
//! A row is compared with the truth of the same frame and tool. Errors count only where enough of the band could be
//! seen. Rows of a tool that is out of sight, or not in the truth at all, are *false tracks*. A row that lies nearer to
//! another tool's tip than to its own is a *swap*. Errors are reported separately for observed and predicted rows,
//! because a tracker that predicts more also finds more and has larger errors.

use std::collections::HashMap;

use super::errors::ErrorSummary;
use super::judged::{EvaluationProblem, JudgedRow, pair_with_truth, tool_names};
use super::lag::{self, Lag};
use super::motion::TrueMotion;
use super::rest_noise::RestNoise;
use super::sigma_check::SigmaCheck;
use super::truth::Truth;
use crate::vision::trajectory::{SampleState, Trajectory};

/// Minimum visible shares of the band: a tracker should find a tool above the first, and find it well above the second.
pub const VISIBILITY_LEVELS: [f64; 2] = [0.4, 0.8];

/// All figures of a trajectory against one truth.
#[derive(Clone, Debug, PartialEq)]
pub struct Accuracy {
    /// Each tool of the truth, then the tools that only the trajectory has.
    pub tools: Vec<ToolAccuracy>,
    /// All tools together.
    pub all: ToolAccuracy,
    /// Rows on frames that the truth does not have.
    pub rows_without_truth: usize,
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
    pub rest_noise: Option<RestNoise>,
    /// The figures for each of [`VISIBILITY_LEVELS`].
    pub levels: Vec<VisibilityLevel>,
}

/// How well a tool was tracked where at least a given share of its band is visible.
#[derive(Clone, Debug, PartialEq)]
pub struct VisibilityLevel {
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
    pub errors: Option<ErrorSummary>,
    /// Errors of the observed rows.
    pub observed_errors: Option<ErrorSummary>,
    /// Errors of the predicted rows.
    pub predicted_errors: Option<ErrorSummary>,
    /// Lag of the track behind the truth.
    pub lag: Lag,
    /// Comparison of the errors with the stated sigmas; `None` without stated sigmas.
    pub sigma_check: Option<SigmaCheck>,
}

/// Measures a trajectory against the truth.
///
/// # Errors
/// [`EvaluationProblem`] if truth and trajectory have no tool or no frame in common.
pub fn accuracy(trajectory: &Trajectory, truth: &Truth) -> Result<Accuracy, EvaluationProblem> {
    let judged = pair_with_truth(trajectory, truth)?;
    let names = tool_names(trajectory, truth);
    let motions = names.iter().map(|name| (name.as_str(), TrueMotion::of(truth, name))).collect();
    let of = |tool: Option<&String>| {
        let rows: Vec<&JudgedRow> = judged.iter().filter(|row| tool.is_none_or(|name| row.tool == name)).collect();
        tool_accuracy(tool, &rows, truth, &motions)
    };
    Ok(Accuracy {
        tools: names.iter().map(|name| of(Some(name))).collect(),
        all: of(None),
        rows_without_truth: trajectory.samples.len() - judged.len(),
        largest_time_difference_s: judged.iter().map(|r| (r.sample.time_s - r.time_s).abs()).fold(0.0, f64::max),
    })
}

fn tool_accuracy(
    tool: Option<&String>,
    rows: &[&JudgedRow],
    truth: &Truth,
    motions: &HashMap<&str, TrueMotion>,
) -> ToolAccuracy {
    ToolAccuracy {
        tool: tool.cloned(),
        rows: rows.len(),
        false_tracks: rows.iter().filter(|row| row.is_false()).count(),
        rest_noise: RestNoise::of(&visible(rows, VISIBILITY_LEVELS[0]), motions),
        levels: VISIBILITY_LEVELS.iter().map(|from| level(*from, tool, rows, truth, motions)).collect(),
    }
}

fn visible<'a>(rows: &[&'a JudgedRow<'a>], from: f64) -> Vec<&'a JudgedRow<'a>> {
    rows.iter().filter(|row| row.visible >= from).copied().collect()
}

fn level(
    visible_from: f64,
    tool: Option<&String>,
    rows: &[&JudgedRow],
    truth: &Truth,
    motions: &HashMap<&str, TrueMotion>,
) -> VisibilityLevel {
    let tools = truth.frames.iter().flat_map(|frame| &frame.tools);
    let seen = tools.filter(|t| t.visible >= visible_from && tool.is_none_or(|name| t.tool == *name));
    let rows = visible(rows, visible_from);
    let of_state = |state: SampleState| {
        let errors: Vec<_> = rows.iter().filter(|r| r.sample.state == state).map(|r| r.error_mm).collect();
        errors
    };
    let observed = of_state(SampleState::Observed);
    VisibilityLevel {
        visible_from,
        frames: seen.count(),
        found: rows.len(),
        observed: observed.len(),
        swaps: rows.iter().filter(|row| row.nearer_to_another).count(),
        errors: ErrorSummary::of(&rows.iter().map(|row| row.error_mm).collect::<Vec<_>>()),
        observed_errors: ErrorSummary::of(&observed),
        predicted_errors: ErrorSummary::of(&of_state(SampleState::Predicted)),
        lag: lag::estimate_lag(&rows, motions),
        sigma_check: SigmaCheck::of(&rows),
    }
}
