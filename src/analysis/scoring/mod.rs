//! Scores a session's path: applies its edits, then `motion` measures features, error bars, stretches and the quality
//! verdict. The same paths and the same context give the same bytes.
//!
//! A long path takes hundreds of MiB and tens of seconds, so only a child process calls these functions
//! ([`super::child::score`]). They take paths by value, to hold each row once.

use std::io::BufRead;
use std::mem;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::edits::{self, Unmeasured};
use super::paths::{PathsError, SessionPaths};
use crate::domain::edit::EditsInForce;
use crate::domain::evidence::{EvidenceRow, MAX_ROWS};
use crate::domain::files::quality::QualityDocument;
use crate::domain::files::trajectory::{ImportedTable, TrajectoryProblem, read_csv};
use crate::domain::session::{FeatureError, FeatureRow};
use crate::motion::assessment::{AssessmentSettings, assess};
use crate::motion::features::FeatureValue;
use crate::motion::features::errors::ErrorBar;
use crate::motion::quality::box_match::are_alike;
use crate::motion::quality::{self, BoxAnswer, BoxEvidence, PortAgreement, Ports, QualityInput};
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::surroundings::{Surroundings, best_resemblance, best_resemblance_moved};
use crate::vision::tracker::{MotionSettings, Quality, ToolQuality};
use crate::vision::trajectory::{SampleState, Trajectory};

/// Why a path gives no score.
#[derive(Debug, thiserror::Error)]
pub enum ScoringError {
    /// The program version that tracked the session did not store the tracker's summary.
    #[error("the stored path does not say how it was tracked")]
    NoTrackingSummary,
    /// The file of paths cannot be decoded.
    #[error(transparent)]
    Paths(#[from] PathsError),
    /// The table cannot be parsed, although it was valid on arrival.
    #[error(transparent)]
    Table(#[from] TrajectoryProblem),
    /// The file cannot be read.
    #[error("reading the file failed: {0}")]
    Read(std::io::Error),
    /// The quality document cannot be encoded.
    #[error("the quality cannot be encoded: {0}")]
    Quality(#[from] serde_json::Error),
}

/// What is known about a recording's box besides the recording.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct BoxContext {
    /// RMS reprojection error of the camera's calibration, pixels, where it is known.
    pub calibration_rms_px: Option<f64>,
    /// Trocar positions in earlier sessions.
    pub ports: Ports,
    /// The box's own pictures of its surroundings.
    pub surroundings: Vec<Surroundings>,
    /// A person's answer whether the recording shows the box.
    pub box_answer: Option<BoxAnswer>,
}

impl BoxContext {
    /// What is known of the box, compared with the surroundings and the trocars of a recording. If the trocars are
    /// displaced as by a moved camera, surroundings that differ within a nudge are searched further away.
    fn evidence(&self, shown: Option<&Surroundings>, trocars: &[Option<Fulcrum>]) -> BoxEvidence {
        let nudged = shown.and_then(|shown| best_resemblance(&self.surroundings, shown));
        let has_moved = || matches!(self.ports.agreement(trocars), PortAgreement::Moved(_));
        let resemblance = match nudged.as_ref().is_some_and(are_alike) || !has_moved() {
            true => nudged,
            false => {
                let moved = shown.and_then(|shown| best_resemblance_moved(&self.surroundings, shown));
                moved.filter(are_alike).or(nudged)
            }
        };
        BoxEvidence { resemblance, answer: self.box_answer }
    }
}

/// The score of a path: what a result stores besides its files.
#[derive(Debug, PartialEq)]
pub struct ScoreRows {
    /// Every feature; the values are withheld if the session is refused.
    pub features: Vec<FeatureRow>,
    /// The stretches that made them.
    pub evidence: Vec<EvidenceRow>,
    /// Counts and reasons per tool; an object.
    pub quality: Value,
}

impl ScoreRows {
    fn of(path: &Trajectory, tools: &[ToolQuality], is_trimmed: [bool; 2], is_refused: bool, quality: Value) -> Self {
        let assessment =
            assess(path, tools, &AssessmentSettings { is_trimmed, window_s: 0.0, ..AssessmentSettings::default() });
        let assessment = if is_refused { assessment.withheld() } else { assessment };
        Self {
            features: assessment.features.iter().map(|value| feature_row(value, &path.tools)).collect(),
            evidence: assessment.stretches.iter().take(MAX_ROWS).map(|of| EvidenceRow::of(of, &path.tools)).collect(),
            quality,
        }
    }
}

/// Scores the path of a recording that was tracked here. `shown`: what stands still in it.
///
/// # Errors
/// The path does not say how it was tracked.
pub fn score_tracked(
    paths: SessionPaths,
    unmeasured: &Unmeasured,
    (known, shown): (&BoxContext, Option<&Surroundings>),
    edits: &EditsInForce,
) -> Result<ScoreRows, ScoringError> {
    let is_trimmed = edits::trimmed_ends(&paths, &edits.changes);
    let mut paths = edited(paths, edits, unmeasured);
    let tracking = paths.tracking.take().ok_or(ScoringError::NoTrackingSummary)?;
    let counts = tracking.quality.quality(&paths.tools);
    let trocars: Vec<_> = counts.tools.iter().map(|tool| tool.fulcrum).collect();
    let smoothed = take_smoothed(&mut paths);
    let figures = quality::measure(&QualityInput {
        smoothed: &smoothed,
        others: Some(&paths),
        tracker: Some(&counts),
        motion: MotionSettings::default(),
        calibration_rms_px: known.calibration_rms_px,
        frames_expected: tracking.frames_expected,
        frames_interlaced: Some(tracking.quality.frames_interlaced),
        ports: Some(&known.ports),
        of_box: Some(known.evidence(shown, &trocars)),
    });
    drop(paths);
    let verdict = quality::judge(&figures);
    let quality = serde_json::to_value(QualityDocument::new(&counts, &figures, &verdict))?;
    Ok(ScoreRows::of(&smoothed, &counts.tools, is_trimmed, verdict.is_refused(), quality))
}

/// Scores the path of rows from another tracker. How they were measured is unknown, so the quality gate judges the path
/// alone, and a value has an error bar only where the rows state their uncertainty.
///
/// # Errors
/// The quality document cannot be encoded.
pub fn score_imported(paths: SessionPaths, frames: u64, edits: &EditsInForce) -> Result<ScoreRows, ScoringError> {
    let is_trimmed = edits::trimmed_ends(&paths, &edits.changes);
    let mut paths = edited(paths, edits, &Unmeasured::new());
    let frames = edits::count_remaining_frames(&paths, frames, &edits.changes);
    let path = take_smoothed(&mut paths);
    let figures = quality::measure(&QualityInput::of_path(&path));
    let verdict = quality::judge(&figures);
    let of_tool = |(tool, name): (usize, &String)| {
        let count = |state| path.of_tool(tool).filter(|sample| sample.state == state).count() as u64;
        let (observed, predicted) = (count(SampleState::Observed), count(SampleState::Predicted));
        let missing = frames.saturating_sub(observed + predicted);
        ToolQuality { tool: name.clone(), observed, predicted, missing, ..ToolQuality::default() }
    };
    let tools = path.tools.iter().enumerate().map(of_tool).collect();
    let counts = Quality { frames, tools, ..Quality::default() };
    let quality = serde_json::to_value(QualityDocument::new(&counts, &figures, &verdict))?;
    Ok(ScoreRows::of(&path, &[], is_trimmed, verdict.is_refused(), quality))
}

/// Reads a table that was validated once already on arrival.
///
/// # Errors
/// The table cannot be parsed.
pub fn read_table(table: impl BufRead) -> Result<ImportedTable, ScoringError> {
    Ok(ImportedTable::of(read_csv(table)?))
}

/// The paths of a session that is measured by another tracker: one smoothed path.
pub fn paths_of_table(trajectory: Trajectory) -> SessionPaths {
    SessionPaths {
        tools: trajectory.tools,
        frame_times_s: Vec::new(),
        raw: Vec::new(),
        filtered: Vec::new(),
        smoothed: trajectory.samples,
        tracking: None,
        cuts: Vec::new(),
    }
}

fn edited(paths: SessionPaths, edits: &EditsInForce, unmeasured: &Unmeasured) -> SessionPaths {
    if edits.changes.is_empty() { paths } else { edits::apply_edits(&paths, &edits.changes, unmeasured) }
}

/// Moves the smoothed path out. The quality figures read only the other two from `paths`.
fn take_smoothed(paths: &mut SessionPaths) -> Trajectory {
    Trajectory {
        tools: paths.tools.clone(),
        samples: mem::take(&mut paths.smoothed),
        frame_times_s: mem::take(&mut paths.frame_times_s),
        cuts: mem::take(&mut paths.cuts),
    }
}

fn feature_row(value: &FeatureValue, tools: &[String]) -> FeatureRow {
    FeatureRow {
        name: value.feature.name.to_owned(),
        title: value.feature.title.to_owned(),
        unit: value.feature.unit.to_owned(),
        tool: value.tool.and_then(|tool| tools.get(tool).cloned()),
        space: value.space.into(),
        value: value.value.map_err(|reason| reason.to_string()),
        error: value.value.ok().map(|_| value.error.map(feature_error).map_err(|reason| reason.to_string())),
    }
}

fn feature_error(ErrorBar { as_measured, sigma, low, high }: ErrorBar) -> FeatureError {
    FeatureError { as_measured, sigma, low, high }
}

#[cfg(test)]
mod tests;
