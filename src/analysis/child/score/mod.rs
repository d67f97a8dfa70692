//! Scores one session: reads its stored path, or the table of another tracker, and sends features, stretches and the
//! quality verdict. Of a table it sends the rows as well, which the parent stores as the session's path.

use std::fs::File;
use std::io::{BufReader, Read};

use serde::{Deserialize, Serialize};
use serde_json::Value;

mod imported_rows;
mod validation;

use super::limits::set_once;
use super::{ChildEvent, ChildInputs, ChildTask, Reporter, StopReason, WorkRecord, no_input};
use crate::analysis::edits::{Unmeasured, unmeasured_of_diagnostics};
use crate::analysis::paths::SessionPaths;
use crate::analysis::scoring::{
    BoxContext, ScoreRows, ScoringError, paths_of_table, read_table, score_imported, score_tracked,
};
use crate::domain::edit::EditsInForce;
use crate::domain::evidence::EvidenceRow;
use crate::domain::session::FeatureRow;
use crate::media::MediaLimits;
use crate::vision::surroundings::Surroundings;
use crate::vision::trajectory::Sample;

pub use imported_rows::{ImportedRows, MAX_IMPORTED_TOOLS};

/// Rows of a path per record.
const ROWS_PER_RECORD: usize = 1024;

/// Longest file of paths or diagnostics, bytes: about four hours of two tools.
const MAX_STORED_BYTES: u64 = 512 * 1024 * 1024;

/// What to score a session with.
#[derive(Debug, Serialize, Deserialize)]
pub struct ScoreWork {
    /// Where the path comes from.
    pub source: ScoreSource,
    /// Names of the tools, in the path's order; empty for a table, which names them.
    pub tools: Vec<String>,
    /// The edits in force.
    pub edits: EditsInForce,
}

/// Where the path comes from. The file is the first input.
#[derive(Debug, Serialize, Deserialize)]
pub enum ScoreSource {
    /// A table of another tracker.
    Table,
    /// The stored path of such a table.
    ImportedPath {
        /// Number of frames with a row of any tool.
        frames: u64,
    },
    /// The stored path of a recording that was tracked here. The second input, needed for edits, is its diagnostics.
    TrackedPath {
        /// What is known about its box.
        known: BoxContext,
        /// What stands still in it.
        shown: Option<Surroundings>,
    },
}

/// A record about a scored session.
#[derive(Debug, Serialize, Deserialize)]
pub enum ScoringRecord {
    /// The table was read.
    Table {
        /// Names of its tools, in order of first appearance.
        tools: Vec<String>,
        /// Number of its rows.
        rows: u64,
    },
    /// Part of the table's rows, ordered by frame, then tool.
    Rows(Vec<Sample>),
    /// The quality document, as JSON.
    Quality(String),
    /// The features, after the quality.
    Features(Vec<FeatureRow>),
    /// The stretches that made the features, as JSON.
    Evidence(String),
}

/// What is kept of a scored session.
#[derive(Debug, Default)]
pub struct ScoreOutput {
    /// The rows of a table.
    pub imported: Option<ImportedRows>,
    /// The quality document; an object.
    pub quality: Option<Value>,
    /// The features.
    pub features: Option<Vec<FeatureRow>>,
    /// The stretches that made them.
    pub evidence: Option<Vec<EvidenceRow>>,
}

impl ChildTask for ScoreWork {
    type Record = ScoringRecord;
    type Output = ScoreOutput;

    fn run(self, inputs: ChildInputs, reporter: &mut Reporter) -> Result<(), StopReason> {
        let mut files = inputs.files.into_iter();
        let path = files.next().ok_or_else(no_input)?;
        let score = match self.source {
            ScoreSource::Table => {
                let table = read_table(BufReader::new(path))?;
                let paths = paths_of_table(table.trajectory);
                send_rows(&paths, reporter)?;
                score_imported(paths, table.frames, &self.edits)?
            }
            ScoreSource::ImportedPath { frames } => score_imported(read_paths(path)?, frames, &self.edits)?,
            ScoreSource::TrackedPath { known, shown } => {
                let unmeasured = match files.next() {
                    Some(diagnostics) => unmeasured_of_diagnostics(&read_whole(diagnostics, MAX_STORED_BYTES)?),
                    None => Unmeasured::new(),
                };
                score_tracked(read_paths(path)?, &unmeasured, (&known, shown.as_ref()), &self.edits)?
            }
        };
        Ok(send_score(score, reporter)?)
    }

    fn accept(
        &self,
        record: ScoringRecord,
        output: &mut ScoreOutput,
        limits: MediaLimits,
    ) -> Result<ChildEvent, String> {
        match record {
            ScoringRecord::Table { tools, rows } => {
                if !matches!(self.source, ScoreSource::Table) || output.quality.is_some() {
                    return Err("a table at the wrong point".into());
                }
                set_once(&mut output.imported, ImportedRows::new(tools, rows, limits)?, "table")?;
            }
            ScoringRecord::Rows(rows) => {
                let imported = output.imported.as_mut().ok_or("rows before their table")?;
                imported.accept(&rows, limits)?;
            }
            ScoringRecord::Quality(json) => {
                let quality = validation::read_quality(&json, self.tools_of(output)?)?;
                set_once(&mut output.quality, quality, "quality")?;
            }
            ScoringRecord::Features(rows) => {
                let quality = output.quality.as_ref().ok_or("features before the quality")?;
                validation::check_features(&rows, self.tools_of(output)?, quality)?;
                set_once(&mut output.features, rows, "list of features")?;
            }
            ScoringRecord::Evidence(json) => {
                let rows = validation::read_evidence(&json, self.tools_of(output)?)?;
                set_once(&mut output.evidence, rows, "list of stretches")?;
            }
        }
        Ok(ChildEvent::Nothing)
    }
}

impl ScoreWork {
    /// The tools that a score may name: those of the request, or those of the table, all of whose rows have arrived.
    fn tools_of<'a>(&'a self, output: &'a ScoreOutput) -> Result<&'a [String], String> {
        match self.source {
            ScoreSource::Table => {
                let imported = output.imported.as_ref().filter(|imported| imported.is_complete());
                Ok(imported.ok_or("a score before all rows")?.tools())
            }
            ScoreSource::ImportedPath { .. } | ScoreSource::TrackedPath { .. } => Ok(&self.tools),
        }
    }
}

/// Reads a file up to this length, bytes. [`Read::take`] does not request the file's own length, which the system call
/// filter denies.
pub(super) fn read_whole(file: File, most: u64) -> Result<Vec<u8>, ScoringError> {
    let mut bytes = Vec::new();
    file.take(most).read_to_end(&mut bytes).map_err(ScoringError::Read)?;
    Ok(bytes)
}

/// Reads a file of paths.
pub(super) fn read_paths(file: File) -> Result<SessionPaths, ScoringError> {
    Ok(SessionPaths::from_bytes(&read_whole(file, MAX_STORED_BYTES)?)?)
}

fn send_rows(paths: &SessionPaths, reporter: &mut Reporter) -> std::io::Result<()> {
    let score = |record| WorkRecord::Score(record);
    let (tools, rows) = (paths.tools.clone(), paths.smoothed.len() as u64);
    reporter.record(score(ScoringRecord::Table { tools, rows }))?;
    for rows in paths.smoothed.chunks(ROWS_PER_RECORD) {
        reporter.record(score(ScoringRecord::Rows(rows.to_vec())))?;
    }
    Ok(())
}

fn send_score(score: ScoreRows, reporter: &mut Reporter) -> std::io::Result<()> {
    let ScoreRows { features, evidence, quality } = score;
    let evidence = serde_json::to_string(&evidence)?;
    reporter.record(WorkRecord::Score(ScoringRecord::Quality(quality.to_string())))?;
    reporter.record(WorkRecord::Score(ScoringRecord::Features(features)))?;
    reporter.record(WorkRecord::Score(ScoringRecord::Evidence(evidence)))
}

#[cfg(test)]
mod tests;
