//! Features as files: one row per session, tool and feature, as CSV, JSON or Parquet, written row by row as they are
//! read.
//!
//! | column | holds |
//! |---|---|
//! | `session` `trainee` `task` `box` | ids or codes |
//! | `recorded_at` | RFC 3339, UTC |
//! | `tracker` | the tracker that measured it; absent: Trocar |
//! | `verdict` | the quality gate's verdict |
//! | `feature` `tool` `space` `unit` | the feature; no tool: a feature of the session as a whole |
//! | `value` `low` `high` | the value, and the bounds that hold the true value in 95 of 100 sessions |
//! | `not_enough` `no_error` | why there is no value, or no error bar |
//! | `pipeline` `tracked_with` `calibration` `palette` `model` | versions that the value depends on |
//! | `too_uncertain` | why the error bar leaves nothing of the value; absent: it says something, or has no error bar |
//!
//! An absent value is an empty field in CSV, `null` in JSON and a null in Parquet. A number is written in the shortest
//! form that reads back to the same number. In CSV, an apostrophe precedes a text that a spreadsheet would calculate.

mod parquet;
mod table;
#[cfg(test)]
mod tests;

pub use table::{FeatureTable, TableFormat, TableProblem};

use serde::Serialize;

use crate::domain::session::{FeatureRow, Versions};

/// Names of the columns, in order.
pub const COLUMNS: [&str; 22] = [
    "session",
    "trainee",
    "task",
    "box",
    "recorded_at",
    "tracker",
    "verdict",
    "feature",
    "tool",
    "space",
    "unit",
    "value",
    "low",
    "high",
    "not_enough",
    "no_error",
    "pipeline",
    "tracked_with",
    "calibration",
    "palette",
    "model",
    "too_uncertain",
];

/// The session's fields that each of its rows repeats.
#[derive(Clone, Debug, PartialEq)]
pub struct ExportedSession {
    /// The session's id.
    pub session: String,
    /// The trainee: an id or a code, never a name.
    pub trainee: String,
    /// The task's code.
    pub task: String,
    /// The box's code.
    pub in_box: String,
    /// Time of the recording, RFC 3339.
    pub recorded_at: String,
    /// The tracker that measured it, if not Trocar.
    pub tracker: Option<String>,
    /// The quality gate's verdict, if there is one.
    pub verdict: Option<String>,
    /// Versions that the numbers depend on.
    pub versions: Versions,
}

/// One row, in the order of [`COLUMNS`].
#[derive(Clone, Debug, PartialEq, Serialize)]
#[allow(missing_docs)] // the module's table is the documentation
pub struct ExportRow {
    pub session: String,
    pub trainee: String,
    pub task: String,
    #[serde(rename = "box")]
    pub in_box: String,
    pub recorded_at: String,
    pub tracker: Option<String>,
    pub verdict: Option<String>,
    pub feature: String,
    pub tool: Option<String>,
    pub space: &'static str,
    pub unit: String,
    pub value: Option<f64>,
    pub low: Option<f64>,
    pub high: Option<f64>,
    pub not_enough: Option<String>,
    pub no_error: Option<String>,
    pub pipeline: String,
    pub tracked_with: Option<String>,
    pub calibration: Option<String>,
    pub palette: Option<String>,
    pub model: Option<String>,
    pub too_uncertain: Option<&'static str>,
}

/// Characters that begin a formula in a spreadsheet, also in a quoted cell.
const FORMULA_BEGINS: [char; 6] = ['=', '+', '-', '@', '\t', '\r'];

impl ExportRow {
    /// The row as CSV has it: no text begins like a formula.
    fn without_formulas(&self) -> Self {
        let mut row = self.clone();
        let texts = [
            &mut row.session,
            &mut row.trainee,
            &mut row.task,
            &mut row.in_box,
            &mut row.recorded_at,
            &mut row.feature,
            &mut row.unit,
            &mut row.pipeline,
        ];
        let optional = [
            &mut row.tracker,
            &mut row.verdict,
            &mut row.tool,
            &mut row.not_enough,
            &mut row.no_error,
            &mut row.tracked_with,
            &mut row.calibration,
            &mut row.palette,
            &mut row.model,
        ];
        for text in texts.into_iter().chain(optional.into_iter().flatten()) {
            if text.starts_with(FORMULA_BEGINS) {
                text.insert(0, '\'');
            }
        }
        row
    }

    /// The row of one feature of a session.
    pub fn new(whose: &ExportedSession, feature: &FeatureRow) -> Self {
        let ExportedSession { session, trainee, task, in_box, recorded_at, tracker, verdict, versions } = whose.clone();
        let bar = feature.error.as_ref().and_then(|error| error.as_ref().ok());
        Self {
            session,
            trainee,
            task,
            in_box,
            recorded_at,
            tracker,
            verdict,
            feature: feature.name.clone(),
            tool: feature.tool.clone(),
            space: feature.space.name(),
            unit: feature.unit.clone(),
            value: feature.value.as_ref().ok().copied(),
            low: bar.map(|bar| bar.low),
            high: bar.map(|bar| bar.high),
            not_enough: feature.value.as_ref().err().cloned(),
            no_error: feature.error.as_ref().and_then(|error| error.as_ref().err()).cloned(),
            pipeline: versions.pipeline,
            tracked_with: versions.tracked_with,
            calibration: versions.calibration.map(|id| id.to_string()),
            palette: versions.palette.map(|id| id.to_string()),
            model: versions.model,
            too_uncertain: feature.informative().and_then(Result::err),
        }
    }
}
