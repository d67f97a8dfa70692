//! Scores without tracking: a session's stored path with the present program, or rows from another tracker. The
//! assessment is the same as after tracking. The numbers were validated on arrival and there are no pixels, so no child
//! is needed.

use super::edits;
use super::job_plan::{BoxContext, EarlierSessions};
use super::paths::{PathKind, PathsError, SessionPaths};
use super::results::{self, AssessmentRows, ProductError};
use super::worker::{WorkError, WorkerPool};
use crate::domain::edit::EditsInForce;
use crate::domain::files::trajectory::{ImportedTable, TrajectoryProblem, read_csv};
use crate::domain::job::{ImportInput, RescoreInput};
use crate::domain::problem::Problem;
use crate::domain::scope::Scope;
use crate::domain::session::{NewResult, NewScore, Versions, VideoFacts, imported_pipeline_version};
use crate::motion::PIPELINE_VERSION;
use crate::queue::HeldJob;
use crate::shutdown::Shutdown;
use crate::store::SessionResult;
use crate::vision::surroundings::Surroundings;

/// Longest stored paths that are scored again, bytes: about four hours of two tools.
const MAX_PATHS_BYTES: u64 = 512 * 1024 * 1024;

/// Why stored data gives no result.
#[derive(Debug, thiserror::Error)]
enum RescoreError {
    #[error(transparent)]
    Product(#[from] ProductError),
    #[error(transparent)]
    Paths(#[from] PathsError),
    #[error(transparent)]
    Rows(#[from] TrajectoryProblem),
    /// The program version that tracked the session did not store the tracker's summary.
    #[error("the stored path does not say how it was tracked")]
    NoTrackingSummary,
}

impl From<RescoreError> for WorkError {
    fn from(error: RescoreError) -> Self {
        match error {
            RescoreError::NoTrackingSummary => no_tracking_summary_problem().into(),
            error => WorkError::Crashed(error.to_string()),
        }
    }
}

/// The result of scoring an imported table, with its path encoded as a blob.
struct ScoredImport {
    assessed: AssessmentRows,
    tools: Vec<String>,
    paths: Vec<u8>,
    facts: VideoFacts,
}

impl WorkerPool {
    /// Scores a table that another tracker measured and stores the result of its session.
    pub(super) async fn score_rows(
        &self,
        held: &HeldJob,
        input: ImportInput,
        ending: &Shutdown,
    ) -> Result<(), WorkError> {
        let table = self.vault.read(input.table.hash, MAX_PATHS_BYTES).await?;
        let edits = self.store.edits().in_force(input.session).await?;
        let revision = edits.revision;
        let scored = self.run_blocking(held, ending, move || score_table(&table, &edits)).await??;
        let versions = Versions {
            pipeline: imported_pipeline_version(&input.tracker),
            tracked_with: None,
            calibration: None,
            palette: None,
            model: None,
        };
        let kept = self.vault.put(&scored.paths).await?;
        let result = NewResult {
            versions,
            edits: revision,
            video: scored.facts,
            tools: scored.tools,
            features: scored.assessed.features,
            evidence: scored.assessed.evidence,
            quality: scored.assessed.quality,
            score: None,
            trajectory: kept.blob(),
            diagnostics: None,
            preview: None,
            surroundings: None,
        };
        Ok(held.finish(async |store, lease| store.jobs().finish_track(lease, result).await).await?)
    }

    /// Scores a session's stored path again and stores the result beside earlier results.
    pub(super) async fn score_paths(
        &self,
        held: &HeldJob,
        input: RescoreInput,
        ending: &Shutdown,
    ) -> Result<(), WorkError> {
        let service = Scope::service();
        let session = self.store.sessions().get(&service, input.session).await?;
        let old = self.store.sessions().result_of(&service, input.session, input.result).await?;
        let mut known = BoxContext::default();
        if let Some(calibration) = old.versions.calibration {
            known.calibration_rms_px = self.store.calibrations().get(&service, calibration).await?.rms_px;
            let earlier = EarlierSessions::before(input.session, calibration, &self.store).await?;
            known.ports = self.earlier_ports(held, earlier, ending).await?;
        }
        if let Some(palette) = old.versions.palette {
            known.surroundings = self.store.surroundings().of_box(palette, session.box_id, session.id).await?;
        }
        let shown = self.store.surroundings().of_session(session.id).await?;
        let blob = self.vault.read(input.trajectory.hash, MAX_PATHS_BYTES).await?;
        let (is_import, frames) = (session.tracker.is_some(), old.video.frames);
        let edits = self.store.edits().in_force(input.session).await?;
        let seen = match old.diagnostics {
            Some(seen) if !edits.changes.is_empty() => self.vault.read(seen, MAX_PATHS_BYTES).await?,
            _ => Vec::new(),
        };
        let revision = edits.revision;
        known.box_answer = edits.box_answer;
        let work = move || match is_import {
            true => assess_stored_import(&blob, frames, &edits),
            false => assess_stored_tracking((&blob, &seen), (&known, shown.as_ref()), &edits),
        };
        let assessed = self.run_blocking(held, ending, work).await??;
        let pipeline = session.tracker.as_ref().map_or_else(|| PIPELINE_VERSION.to_owned(), imported_pipeline_version);
        let score = new_score(&old, pipeline, revision, assessed);
        Ok(held.finish(async |store, lease| store.jobs().finish_rescore(lease, score).await).await?)
    }
}

/// The new score of an old result's path.
fn new_score(old: &SessionResult, pipeline: String, edits: u64, assessed: AssessmentRows) -> NewScore {
    let tracked_with = old.versions.tracked_with.as_ref().unwrap_or(&old.versions.pipeline);
    let tracked_with = (*tracked_with != pipeline).then(|| tracked_with.clone());
    let AssessmentRows { features, evidence, quality } = assessed;
    NewScore { from: old.id, tracked_with, pipeline, edits, features, evidence, quality }
}

/// Assesses the path of a recording that was tracked here, with its edits applied.
fn assess_stored_tracking(
    (blob, seen): (&[u8], &[u8]),
    (known, shown): (&BoxContext, Option<&Surroundings>),
    edits: &EditsInForce,
) -> Result<AssessmentRows, RescoreError> {
    let paths = SessionPaths::from_bytes(blob)?;
    if paths.tracking.is_none() {
        return Err(RescoreError::NoTrackingSummary);
    }
    let edited = edits::apply_edits(&paths, &edits.changes, &edits::unmeasured_of_diagnostics(seen));
    Ok(results::assess_tracked(&edited, known, shown, edits::trimmed_ends(&paths, &edits.changes))?)
}

/// Assesses the stored path of rows from another tracker.
fn assess_stored_import(blob: &[u8], frames: u64, edits: &EditsInForce) -> Result<AssessmentRows, RescoreError> {
    Ok(assess_import(&SessionPaths::from_bytes(blob)?, frames, edits)?)
}

fn assess_import(paths: &SessionPaths, frames: u64, edits: &EditsInForce) -> Result<AssessmentRows, ProductError> {
    let edited = edits::apply_edits(paths, &edits.changes, &[]);
    results::assess_imported(
        &edited.trajectory(PathKind::Smoothed),
        edits::count_remaining_frames(&edited, frames, &edits.changes),
        edits::trimmed_ends(paths, &edits.changes),
    )
}

/// Scores a table that was validated once already on arrival.
fn score_table(table: &[u8], edits: &EditsInForce) -> Result<ScoredImport, RescoreError> {
    let ImportedTable { trajectory, frames, duration_s } = ImportedTable::of(read_csv(table)?);
    let (raw, filtered, frame_times_s) = (Vec::new(), Vec::new(), Vec::new());
    let paths = SessionPaths {
        tools: trajectory.tools,
        frame_times_s,
        raw,
        filtered,
        smoothed: trajectory.samples,
        tracking: None,
        cuts: Vec::new(),
    };
    let assessed = assess_import(&paths, frames, edits)?;
    let facts = VideoFacts { width: None, height: None, frames, duration_s, clock: None };
    Ok(ScoredImport { assessed, paths: paths.to_bytes()?, tools: paths.tools, facts })
}

fn no_tracking_summary_problem() -> Problem {
    let detail = "the program version that tracked this session did not store everything that a score depends on; \
                  request the rescoring with `from=recording`, so that it is tracked again";
    Problem::new("path-alone", "The stored path cannot be scored again", detail)
}
