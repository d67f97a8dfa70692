//! Photos and frames for which somebody waits, with the board or the brush in their hand: looked at by a child of their own,
//! beside the queue, within a second or two. Nothing of it is kept: the
//! collector takes the files as soon as nobody looks at them.
//!
//! What is seen is what a job would see: the same work of the same confined child, its records checked by the same receipt.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{Semaphore, SemaphorePermit};

use super::attempt::{Attempt, Failure, attempt};
use super::marked::colours_of;
use super::orders;
use super::protocol::{BoardShape, Request, Work};
use super::receipt::Heard;
use super::settings::AnalysisSettings;
use crate::domain::calibration::BoardSize;
use crate::domain::files::annotations::AnnotationsFile;
use crate::domain::job::NamedBlob;
use crate::domain::palette::PalettePreview;
use crate::domain::photo_check::PhotoCheck;
use crate::domain::problem::Problem;
use crate::sandbox::{Program, Stop};
use crate::shutdown::Shutdown;
use crate::time::SharedClock;
use crate::vault::{Vault, VaultError};

/// Any side of a square will do: a photo alone does not tell it.
const SQUARE_MM: f64 = 1.0;

/// Looks at pictures while people wait.
pub struct Glances {
    vault: Vault,
    program: Program,
    settings: AnalysisSettings,
    clock: SharedClock,
    shutdown: Shutdown,
    places: Arc<Semaphore>,
}

/// Why nothing was seen.
#[derive(Debug, thiserror::Error)]
pub enum Unseen {
    /// The pictures cannot be looked at.
    #[error("{}", .0.detail)]
    Problem(Problem),
    /// The child died of them, or took too long.
    #[error("the process that looked at it {0}")]
    Crashed(String),
    /// Nobody looked: this machine could not begin, or broke down.
    #[error("looking at it failed: {0}")]
    Failed(String),
    /// Too many wait already, or the service ends.
    #[error("no place to look at it now")]
    Busy,
    /// The files.
    #[error(transparent)]
    Vault(#[from] VaultError),
}

impl Glances {
    /// With the program of the workers' children, but places of its own.
    pub fn new(
        vault: Vault,
        program: Program,
        settings: AnalysisSettings,
        clock: SharedClock,
        shutdown: Shutdown,
    ) -> Self {
        let places = Arc::new(Semaphore::new(settings.glances.max(1)));
        Self { vault, program, settings, clock, shutdown, places }
    }

    /// Looks for a board on a photo.
    pub async fn check_photo(&self, board: BoardSize, photo: &NamedBlob) -> Result<PhotoCheck, Unseen> {
        let board = BoardShape { columns: board.columns, rows: board.rows, square_mm: SQUARE_MM };
        let heard = self.look(Work::Check(board), std::slice::from_ref(photo)).await?;
        heard.photo_check.ok_or_else(|| Unseen::Crashed("said nothing of the photo".to_owned()))
    }

    /// What these marks take for tape on these frames, of which file `n` shows frame `frames[n]`.
    pub async fn preview(
        &self,
        annotations: &AnnotationsFile,
        files: &[NamedBlob],
        frames: &[u64],
    ) -> Result<PalettePreview, Unseen> {
        let work = orders::palette(annotations, Some(frames.to_vec())).map_err(Unseen::Problem)?;
        let colours = colours_of(&work.tools);
        let heard = self.look(Work::Mask(work), files).await?;
        match heard.palette_report {
            Some(report) if heard.masks.len() == frames.len() => {
                Ok(PalettePreview { colours, frames: heard.masks, report })
            }
            _ => Err(Unseen::Crashed("did not say what it saw on every frame".to_owned())),
        }
    }

    async fn look(&self, work: Work, files: &[NamedBlob]) -> Result<Heard, Unseen> {
        let mut inputs = Vec::with_capacity(files.len());
        for file in files {
            inputs.push(self.vault.open_blob(file.blob.hash).await?.0);
        }
        let _place = self.place().await?;
        let failed = |error: std::io::Error| Unseen::Failed(error.to_string());
        let stop = PulledWhenGone(Stop::new().map_err(failed)?);
        let (program, budget, stopping) = (self.program.clone(), self.settings.glance_budget(), stop.0.clone());
        let request = Request { threads: 1, work };
        let mut child = tokio::task::spawn_blocking(move || {
            attempt(Attempt { program: &program, request, inputs, budget: &budget, stop: &stopping }, |_| ()).0
        });
        let ended = tokio::select! {
            ended = &mut child => ended,
            () = self.shutdown.begun() => { stop.0.pull(); child.await }
        };
        match ended {
            Ok(Ok(heard)) => Ok(heard),
            Ok(Err(Failure::Explained(problem))) => Err(Unseen::Problem(problem)),
            Ok(Err(Failure::Crashed(why))) => Err(Unseen::Crashed(why)),
            Ok(Err(Failure::Stopped)) => Err(Unseen::Busy),
            Err(panic) => Err(Unseen::Failed(panic.to_string())),
        }
    }

    /// A place, once there is one.
    async fn place(&self) -> Result<SemaphorePermit<'_>, Unseen> {
        let longest = Duration::from_secs(self.settings.glance_s);
        tokio::select! {
            place = self.places.acquire() => place.map_err(|_| Unseen::Busy),
            () = self.clock.sleep(longest) => Err(Unseen::Busy),
            () = self.shutdown.begun() => Err(Unseen::Busy),
        }
    }
}

/// Ends a child whose asker has gone.
struct PulledWhenGone(Stop);

impl Drop for PulledWhenGone {
    fn drop(&mut self) {
        self.0.pull();
    }
}
