//! Analyses photos, frames, new edits and tables at once, outside the queue, for a user who holds the board, marks
//! colours, edits or imports a session, and waits. It takes a second or two. The result is not stored, and files that
//! nothing refers to are deleted by garbage collection.
//!
//! The result is the same as a job's: the same work in the same confined child, validated by the same
//! [`super::output_validator::OutputValidator`].

use std::fs::File;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{Semaphore, SemaphorePermit};

use super::attempt::{AttemptFailure, ChildAttempt, run_attempt};
use super::child::ChildOutput;
use super::job_plan;
use super::protocol::{
    CheckEditWork, CheckTableWork, CheckWork, ChildRequest, ChildWork, MaskWork, PaletteWork, RequestedBoard,
    Thumbnail, ThumbnailWork,
};
use super::settings::AnalysisSettings;
use crate::domain::blob::BlobHash;
use crate::domain::calibration::BoardSize;
use crate::domain::edit::{EditChange, EditsInForce};
use crate::domain::files::annotations::AnnotationsFile;
use crate::domain::job::NamedBlob;
use crate::domain::palette::PalettePreview;
use crate::domain::photo_check::PhotoCheck;
use crate::domain::problem::Problem;
use crate::domain::text::Invalid;
use crate::sandbox::{Program, StopSwitch};
use crate::shutdown::Shutdown;
use crate::time::SharedClock;
use crate::vault::{Vault, VaultError};
use crate::vision::tracker::ToolSpec;

/// A photo alone does not show the side of a square, so any value serves.
const SQUARE_MM: f64 = 1.0;

/// Analyses pictures, edits and tables for users who wait.
pub struct QuickAnalysis {
    vault: Vault,
    program: Program,
    settings: AnalysisSettings,
    clock: SharedClock,
    shutdown: Shutdown,
    slots: Arc<Semaphore>,
}

/// A new edit that was checked against a session's path.
#[derive(Debug)]
pub struct CheckedEdit {
    /// False if the path does not say how it was tracked: it was imported, or an older program version tracked it.
    pub has_summary: bool,
    /// The edit as it can be applied, or why it cannot.
    pub change: Result<EditChange, Invalid>,
}

/// Why a quick analysis gave no result.
#[derive(Debug, thiserror::Error)]
pub enum QuickAnalysisError {
    /// The pictures or the path cannot be analysed.
    #[error("{}", .0.detail)]
    Problem(Problem),
    /// The child crashed on them.
    #[error("the analysis process {0}")]
    Crashed(String),
    /// The child reached its limit of time, s.
    #[error("the analysis took longer than {0} s")]
    TimedOut(u64),
    /// The analysis did not start, or failed for a reason on this machine.
    #[error("the analysis failed: {0}")]
    Failed(String),
    /// Too many analyses are waiting already, or the service is shutting down.
    #[error("too many pictures, edits or tables are being checked now")]
    Busy,
    /// A file could not be read.
    #[error(transparent)]
    Vault(#[from] VaultError),
}

impl QuickAnalysis {
    /// Uses the same program as the workers' children, but its own slots.
    pub fn new(
        vault: Vault,
        program: Program,
        settings: AnalysisSettings,
        clock: SharedClock,
        shutdown: Shutdown,
    ) -> Self {
        let slots = Arc::new(Semaphore::new(settings.glances));
        Self { vault, program, settings, clock, shutdown, slots }
    }

    /// Looks for a board in a photo.
    pub async fn check_photo(&self, board: BoardSize, photo: &NamedBlob) -> Result<PhotoCheck, QuickAnalysisError> {
        let board = RequestedBoard { columns: board.columns, rows: board.rows, square_mm: SQUARE_MM };
        let output = self.run(ChildWork::Check(CheckWork(board)), &[photo.blob.hash]).await?;
        output.photo_check.ok_or_else(|| QuickAnalysisError::Crashed("sent no result for the photo".to_owned()))
    }

    /// Shows the pixels that these marks classify as tape or as bare shaft on these frames, and the shafts of tools without
    /// tape; file `n` shows frame `frames[n]`.
    pub async fn preview(
        &self,
        annotations: &AnnotationsFile,
        files: &[NamedBlob],
        frames: &[u64],
    ) -> Result<PalettePreview, QuickAnalysisError> {
        let work = job_plan::palette_work(annotations, None).map_err(QuickAnalysisError::Problem)?;
        let PaletteWork { marks, tools, .. } = work;
        let colours: Vec<String> = annotations.marked_colours().into_iter().map(str::to_owned).collect();
        let hashes: Vec<BlobHash> = files.iter().map(|file| file.blob.hash).collect();
        let marked = annotations.marked_tools().unwrap_or_default(); // without usable tools, only the colours are shown
        let bare: Vec<ToolSpec> = marked.into_iter().map(ToolSpec::from).filter(ToolSpec::is_bare).collect();
        let places = frames.len() * bare.len();
        let work = MaskWork { marks, tools, colours: colours.clone(), bare, frames: frames.to_vec() };
        let output = self.run(ChildWork::Mask(work), &hashes).await?.mask;
        match output.report {
            Some(report) if output.masks.len() == frames.len() && output.shafts.len() == places => {
                Ok(PalettePreview { colours, frames: output.masks, shafts: output.shafts, report })
            }
            _ => Err(QuickAnalysisError::Crashed("did not send a mask and shafts for every frame".to_owned())),
        }
    }

    /// Checks a new edit against a session's stored path.
    pub async fn check_edit(
        &self,
        path: BlobHash,
        in_force: EditsInForce,
        change: EditChange,
    ) -> Result<CheckedEdit, QuickAnalysisError> {
        let output = self.run(ChildWork::CheckEdit(CheckEditWork { in_force, change }), &[path]).await?.edit_check;
        let checked = output.has_summary.zip(output.checked);
        let checked = checked.map(|(has_summary, change)| CheckedEdit { has_summary, change });
        checked.ok_or_else(|| QuickAnalysisError::Crashed("did not say whether the edit is possible".to_owned()))
    }

    /// Checks whether a table of another tracker can be imported, and returns the hash of its path; the inner error says
    /// why not.
    pub async fn check_table(
        &self,
        table: BlobHash,
        limits: CheckTableWork,
    ) -> Result<Result<BlobHash, String>, QuickAnalysisError> {
        let checked = self.run(ChildWork::CheckTable(limits), &[table]).await?.table_check;
        checked.ok_or_else(|| QuickAnalysisError::Crashed("did not say whether the table is valid".to_owned()))
    }

    /// Makes a picture of the beginning of a recording. The content is not compared with its hash, which would read the
    /// whole file.
    pub async fn thumbnail(&self, recording: BlobHash) -> Result<Thumbnail, QuickAnalysisError> {
        let (file, _) = self.vault.open_blob(recording).await?;
        let output = self.run_on(ChildWork::Thumbnail(ThumbnailWork), vec![file]).await?;
        output.thumbnail.ok_or_else(|| QuickAnalysisError::Crashed("sent no picture of the recording".to_owned()))
    }

    async fn run(&self, work: ChildWork, files: &[BlobHash]) -> Result<ChildOutput, QuickAnalysisError> {
        let mut inputs = Vec::with_capacity(files.len());
        for &file in files {
            // The child cannot compare the content with the hash.
            inputs.push(self.vault.open_verified(file).await?);
        }
        self.run_on(work, inputs).await
    }

    async fn run_on(&self, work: ChildWork, inputs: Vec<File>) -> Result<ChildOutput, QuickAnalysisError> {
        let _place = self.acquire_slot().await?;
        let failed = |error: std::io::Error| QuickAnalysisError::Failed(error.to_string());
        let stop = QuickStopGuard(StopSwitch::new().map_err(failed)?);
        let (program, budget, stopping) = (self.program.clone(), self.settings.quick_budget(&work), stop.0.clone());
        let request = ChildRequest { threads: 1, work };
        let asked_by = tracing::Span::current();
        let mut child = tokio::task::spawn_blocking(move || {
            let what = ChildAttempt { program: &program, request, inputs, budget: &budget, stop: &stopping };
            asked_by.in_scope(|| run_attempt(what, |_| ()).0)
        });
        let ended = tokio::select! {
            ended = &mut child => ended,
            () = self.shutdown.begun() => { stop.0.pull(); child.await }
        };
        match ended {
            Ok(Ok(output)) => Ok(output),
            Ok(Err(AttemptFailure::Impossible(problem))) => Err(QuickAnalysisError::Problem(problem)),
            Ok(Err(AttemptFailure::Crashed(why))) => Err(QuickAnalysisError::Crashed(why)),
            Ok(Err(AttemptFailure::TimedOut(_))) => Err(QuickAnalysisError::TimedOut(self.settings.glance_s)),
            Ok(Err(AttemptFailure::Stopped)) => Err(QuickAnalysisError::Busy),
            Err(panic) => Err(QuickAnalysisError::Failed(panic.to_string())),
        }
    }

    /// Waits for a slot.
    async fn acquire_slot(&self) -> Result<SemaphorePermit<'_>, QuickAnalysisError> {
        let longest = Duration::from_secs(self.settings.glance_s);
        tokio::select! {
            biased;
            place = self.slots.acquire() => place.map_err(|_| QuickAnalysisError::Busy),
            () = self.clock.sleep(longest) => Err(QuickAnalysisError::Busy),
            () = self.shutdown.begun() => Err(QuickAnalysisError::Busy),
        }
    }
}

/// Stops the child when the caller has dropped the request.
struct QuickStopGuard(StopSwitch);

impl Drop for QuickStopGuard {
    fn drop(&mut self) {
        self.0.pull();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::ManualClock;

    #[tokio::test]
    async fn a_damaged_path_is_noticed_before_any_process_reads_it() {
        let folder = tempfile::tempdir().unwrap();
        let vault = Vault::open(folder.path()).await.unwrap();
        let path = vault.put(b"a path").await.unwrap().blob().hash;
        let name = path.to_string();
        std::fs::write(folder.path().join("blobs").join(&name[..2]).join(&name), b"b path").unwrap();
        let (program, settings) = (Program::at("/no/program", &[]), AnalysisSettings::default());
        let analysis = QuickAnalysis::new(vault, program, settings, ManualClock::at(0), Shutdown::new());
        let checked = analysis.check_edit(path, EditsInForce::default(), EditChange::Trim([1.0, 2.0])).await;
        assert!(matches!(checked, Err(QuickAnalysisError::Vault(VaultError::Damaged))), "{checked:?}");
    }
}
