//! What a worker does for each kind of job: look up what the child needs, run the child, store the result. A new kind is
//! a branch of [`WorkerPool::work_on`] and the function that it calls.

use super::job_plan::{self, EarlierSessions, JobPlan};
use super::protocol::{AdviseWork, ChildWork, PaletteWork, ScoreSource, ScoreWork};
use super::results::{self, TrackFiles, TrackResult};
use super::scoring::BoxContext;
use super::worker::{WorkError, WorkerPool};
use crate::domain::blob::BlobHash;
use crate::domain::job::{CalibrateInput, JobInput, PaletteInput, SelfTestInput, TrackInput};
use crate::domain::scope::Scope;
use crate::domain::session::NewResult;
use crate::queue::HeldJob;
use crate::shutdown::Shutdown;
use crate::time::to_rfc3339;
use crate::vault::{PinnedBlob, VaultError};

impl WorkerPool {
    /// Does the work of a job and stores its result.
    pub(super) async fn work_on(&self, held: &mut HeldJob, ending: &Shutdown) -> Result<(), WorkError> {
        match held.job().input.clone() {
            JobInput::Track(input) => self.track(held, input, ending).await,
            JobInput::Import(input) => self.score_rows(held, input, ending).await,
            JobInput::Rescore(input) => self.score_paths(held, input, ending).await,
            JobInput::Calibrate(input) => self.calibrate(held, &input, ending).await,
            JobInput::Palette(input) => self.collect_colours(held, &input, ending).await,
            JobInput::Advise(_) => self.advise_on_tapes(held, ending).await,
            JobInput::SelfTest(input) => self.test_box(held, &input, ending).await,
        }
    }

    async fn track(&self, held: &mut HeldJob, input: TrackInput, ending: &Shutdown) -> Result<(), WorkError> {
        let calibration = self.store.calibrations().get(&Scope::service(), input.calibration).await?;
        let earlier = EarlierSessions::before(input.session, input.calibration, &self.store).await?;
        let (work, empty_box) = job_plan::track_work(&input, calibration.camera.camera(), &self.store).await?;
        let tools = work.tracker.tools.iter().map(|tool| tool.name.clone()).collect();
        let mut plan = JobPlan::new(ChildWork::Track(work), &held.job().input, &self.vault).await?;
        if let Some(picture) = empty_box {
            plan = plan.with_empty_box(picture, &self.vault).await?;
        }
        let output = self.supervise_child(held, plan, ending).await??;
        let ports = self.earlier_ports(held, earlier, ending).await?;
        let edits = self.store.edits().in_force(input.session).await?;
        let surroundings = self.box_surroundings(held, (input.session, input.palette), ending).await?;
        let box_answer = edits.box_answer;
        let known = BoxContext { calibration_rms_px: calibration.rms_px, ports, surroundings, box_answer };
        let shown = self.store.sessions().result(&Scope::service(), input.session).await?;
        // Edits are in the times of the current result. Storing this one converts them.
        let edits_clock = shown.and_then(|shown| shown.video.clock).map_or(1.0, |clock| clock.applied.factor);
        let encode = move || TrackResult::new(&input, tools, output);
        let TrackResult { versions, video, tools, surroundings, files } =
            self.run_blocking(held, ending, encode).await??;
        let files = self.put_files(files).await?;
        let clock = video.clock.map_or(1.0, |clock| clock.applied.factor);
        let source = ScoreSource::TrackedPath { known, shown: surroundings.clone() };
        let work = ScoreWork { source, tools: tools.clone(), edits: edits.scaled(clock / edits_clock) };
        let diagnostics = (!work.edits.changes.is_empty()).then(|| files.diagnostics.blob().hash);
        let inputs: Vec<BlobHash> = [files.trajectory.blob().hash].into_iter().chain(diagnostics).collect();
        let score = results::score(self.score(held, work, &inputs, ending).await?)?;
        let result = NewResult {
            versions,
            edits: edits.revision,
            video,
            tools,
            features: score.features,
            evidence: score.evidence,
            quality: score.quality,
            score: None,
            trajectory: files.trajectory.blob(),
            diagnostics: Some(files.diagnostics.blob()),
            preview: files.preview.as_ref().map(PinnedBlob::blob),
            surroundings,
        };
        let stored = held.finish(async |store, lease| store.jobs().finish_track(lease, result).await).await;
        stored.map_err(WorkError::NotStored)
    }

    async fn calibrate(&self, held: &mut HeldJob, input: &CalibrateInput, ending: &Shutdown) -> Result<(), WorkError> {
        let work = job_plan::calibrate_work(input, &to_rfc3339(self.clock.now_ms()));
        let output = self.run_child(held, ChildWork::Calibrate(work), ending).await?;
        let new = results::calibration(input.is_video, output)?;
        let stored = held.finish(async |store, lease| store.jobs().finish_calibration(lease, new).await).await;
        stored.map(drop).map_err(WorkError::NotStored)
    }

    async fn collect_colours(
        &self,
        held: &mut HeldJob,
        input: &PaletteInput,
        ending: &Shutdown,
    ) -> Result<(), WorkError> {
        let work = job_plan::palette_work(&input.annotations, (!input.is_video).then(|| input.frames.clone()))?;
        let work = PaletteWork { has_empty_box: input.empty_box.is_some(), ..work };
        let output = self.run_child(held, ChildWork::Palette(work), ending).await?;
        let new = results::palette(&input.annotations, output)?;
        let stored = held.finish(async |store, lease| store.jobs().finish_palette(lease, new).await).await;
        stored.map(drop).map_err(WorkError::NotStored)
    }

    async fn advise_on_tapes(&self, held: &mut HeldJob, ending: &Shutdown) -> Result<(), WorkError> {
        let output = self.run_child(held, ChildWork::Advise(AdviseWork), ending).await?;
        let advice = results::advice(output)?;
        let stored = held.finish(async |store, lease| store.jobs().finish_advice(lease, advice).await).await;
        stored.map_err(WorkError::NotStored)
    }

    async fn test_box(&self, held: &mut HeldJob, input: &SelfTestInput, ending: &Shutdown) -> Result<(), WorkError> {
        let work = job_plan::self_test_work(input, &self.store).await?;
        let output = self.run_child(held, ChildWork::SelfTest(work), ending).await?;
        let new = results::self_test(input, output)?;
        let stored = held.finish(async |store, lease| store.jobs().finish_self_test(lease, new).await).await;
        stored.map_err(WorkError::NotStored)
    }

    /// Puts a session's files into the vault, which protects them from garbage collection until their row exists.
    async fn put_files(&self, files: TrackFiles) -> Result<StoredTrackFiles, VaultError> {
        let TrackFiles { paths, diagnostics, preview } = files;
        let trajectory = self.vault.put(&paths).await?;
        let diagnostics = self.vault.put(&diagnostics).await?;
        let preview = match preview {
            Some(jpeg) => Some(self.vault.put(&jpeg).await?),
            None => None,
        };
        Ok(StoredTrackFiles { trajectory, diagnostics, preview })
    }
}

/// [`TrackFiles`] in the vault.
struct StoredTrackFiles {
    trajectory: PinnedBlob,
    diagnostics: PinnedBlob,
    preview: Option<PinnedBlob>,
}
