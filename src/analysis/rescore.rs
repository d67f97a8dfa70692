//! Scores without tracking: a session's stored path with the present program, or rows from another tracker. The score
//! is computed in a child process ([`super::child::score`]), in the same way as after tracking.

use super::child::score::ScoreOutput;
use super::job_plan::{EarlierSessions, JobPlan};
use super::protocol::{ChildWork, ScoreSource, ScoreWork};
use super::results;
use super::scoring::{BoxContext, ScoreRows};
use super::worker::{WorkError, WorkerPool};
use crate::domain::blob::BlobHash;
use crate::domain::job::{ImportInput, RescoreInput};
use crate::domain::scope::Scope;
use crate::domain::session::{NewResult, NewScore, Versions, VideoFacts, imported_pipeline_version};
use crate::motion::PIPELINE_VERSION;
use crate::queue::HeldJob;
use crate::shutdown::Shutdown;
use crate::store::SessionResult;

impl WorkerPool {
    /// Scores a table that another tracker measured and stores the result of its session.
    pub(super) async fn score_rows(
        &self,
        held: &mut HeldJob,
        input: ImportInput,
        ending: &Shutdown,
    ) -> Result<(), WorkError> {
        let edits = self.store.edits().in_force(input.session).await?;
        let revision = edits.revision;
        let work = ScoreWork { source: ScoreSource::Table, tools: Vec::new(), edits };
        let output = self.score(held, work, &[input.table.hash], ending).await?;
        let (score, imported) = results::imported_score(output)?;
        let versions = Versions {
            pipeline: imported_pipeline_version(&input.tracker),
            tracked_with: None,
            calibration: None,
            palette: None,
            model: None,
        };
        let (frames, duration_s) = (imported.frames(), imported.duration_s());
        let (paths, tools) = imported.into_file();
        let kept = self.vault.put(&paths).await?;
        let result = NewResult {
            versions,
            edits: revision,
            video: VideoFacts { width: None, height: None, frames, duration_s, clock: None },
            tools,
            features: score.features,
            evidence: score.evidence,
            quality: score.quality,
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
        held: &mut HeldJob,
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
        let edits = self.store.edits().in_force(input.session).await?;
        let revision = edits.revision;
        known.box_answer = edits.box_answer;
        let diagnostics = old.diagnostics.filter(|_| !edits.changes.is_empty());
        let files: Vec<BlobHash> = [input.trajectory.hash].into_iter().chain(diagnostics).collect();
        let source = match session.tracker.is_some() {
            true => ScoreSource::ImportedPath { frames: old.video.frames },
            false => ScoreSource::TrackedPath { known, shown },
        };
        let work = ScoreWork { source, tools: old.tools.clone(), edits };
        let score = results::score(self.score(held, work, &files, ending).await?)?;
        let pipeline = session.tracker.as_ref().map_or_else(|| PIPELINE_VERSION.to_owned(), imported_pipeline_version);
        let score = new_score(&old, pipeline, revision, score);
        Ok(held.finish(async |store, lease| store.jobs().finish_rescore(lease, score).await).await?)
    }

    /// Scores a session in a child, which reads these stored files.
    pub(super) async fn score(
        &self,
        held: &mut HeldJob,
        work: ScoreWork,
        files: &[BlobHash],
        ending: &Shutdown,
    ) -> Result<ScoreOutput, WorkError> {
        let mut inputs = Vec::with_capacity(files.len());
        for &hash in files {
            // The child cannot compare the content with the hash, and a damaged path would give wrong numbers.
            inputs.push(self.vault.open_verified(hash).await?);
        }
        let plan = JobPlan { work: ChildWork::Score(work), inputs };
        Ok(self.supervise_child(held, plan, ending).await??.score)
    }
}

/// The new score of an old result's path.
fn new_score(old: &SessionResult, pipeline: String, edits: u64, score: ScoreRows) -> NewScore {
    let tracked_with = old.versions.tracked_with.as_ref().unwrap_or(&old.versions.pipeline);
    let tracked_with = (*tracked_with != pipeline).then(|| tracked_with.clone());
    let ScoreRows { features, evidence, quality } = score;
    NewScore { from: old.id, tracked_with, pipeline, edits, features, evidence, quality }
}
