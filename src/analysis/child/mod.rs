//! What runs inside the confinement: decode, track, report. It opens no file, reads no clock and stores nothing.

mod assemble;
mod calibrate;
mod check;
mod demux;
mod explain;
mod follow;
mod palette;
mod preview;
mod probe;
mod reporter;
mod self_test;
mod track;

use std::fs::File;

use reporter::Reporter;

use super::protocol::{self, ChildReply, ChildRequest, ChildWork, PaletteWork};
use crate::domain::problem::Problem;
use crate::media::{MediaLimits, VideoFile};
use crate::sandbox::{self, ConfinementError, LandlockStatus};

/// Why a child ends without reporting a problem to its parent.
#[derive(Debug, thiserror::Error)]
pub enum ChildError {
    /// The child could not confine itself, so it did not touch its input.
    #[error("not confined: {0}")]
    Confinement(#[from] ConfinementError),
    /// The request cannot be read: parent and child are not the same program.
    #[error("the request cannot be read: {0}")]
    Request(postcard::Error),
    /// The parent has closed the pipe.
    #[error("the parent has closed the pipe: {0}")]
    ParentGone(#[from] std::io::Error),
}

/// Why a piece of work stopped early.
enum StopReason {
    /// The work cannot be done; the parent receives the reason.
    Impossible(Problem),
    /// The parent has closed the pipe.
    ParentGone(std::io::Error),
}

impl From<std::io::Error> for StopReason {
    fn from(error: std::io::Error) -> Self {
        StopReason::ParentGone(error)
    }
}

impl<E: explain::ToProblem> From<E> for StopReason {
    fn from(error: E) -> Self {
        StopReason::Impossible(error.to_problem())
    }
}

/// The child's whole run: confine, receive the request, work, report the end.
pub fn run() -> Result<(), ChildError> {
    let admission = sandbox::admit()?;
    let mut reporter = Reporter::new();
    reporter.send(&ChildReply::Confined { landlock: admission.enforced != LandlockStatus::NoLandlock })?;
    let request: ChildRequest = protocol::decode(&admission.request).map_err(ChildError::Request)?;
    limit_rayon_threads(request.threads);
    let last = match run_work(request, admission.inputs, &mut reporter) {
        Ok(()) => ChildReply::Done,
        Err(StopReason::Impossible(problem)) => ChildReply::Problem(problem),
        Err(StopReason::ParentGone(error)) => return Err(error.into()),
    };
    Ok(reporter.send(&last)?)
}

/// Limits rayon to the threads of this child. Otherwise each child would start a thread per core, and their stacks
/// count as its memory.
fn limit_rayon_threads(threads: usize) {
    // This fails only if the pool exists already, and then it has the right size: this runs once.
    let _ = rayon::ThreadPoolBuilder::new().num_threads(threads.max(1)).build_global();
}

fn run_work(request: ChildRequest, inputs: Vec<File>, reporter: &mut Reporter) -> Result<(), StopReason> {
    let limits = MediaLimits { threads: request.threads, ..MediaLimits::default() };
    match request.work {
        ChildWork::Probe => probe::run(open(inputs, limits)?, reporter),
        ChildWork::Track(work) => track::run(work, open(inputs, limits)?, reporter),
        ChildWork::Palette(PaletteWork { marks, tools, frames: None }) => {
            palette::from_clip(&marks, &tools, open(inputs, limits)?, reporter)
        }
        ChildWork::Palette(PaletteWork { marks, tools, frames: Some(frames) }) => {
            let pictures = palette::PictureInputs { frames: &frames, inputs, limits };
            palette::from_pictures(&marks, &tools, pictures, reporter)
        }
        ChildWork::Advise => palette::advise_on_tapes(inputs, limits, reporter),
        ChildWork::Mask(PaletteWork { marks, tools, frames }) => {
            let pictures = palette::PictureInputs { frames: &frames.unwrap_or_default(), inputs, limits };
            palette::mask_on(&marks, &tools, pictures, reporter)
        }
        ChildWork::Check(board) => check::run(board, inputs, limits, reporter),
        ChildWork::Calibrate(work) => calibrate::run(work, inputs, limits, reporter),
        ChildWork::SelfTest(work) => self_test::run(work, open(inputs, limits)?, reporter),
        ChildWork::Follow(work) => follow::run(work, inputs, limits, reporter),
        ChildWork::Assemble(work) => assemble::run(work, inputs, reporter),
        ChildWork::Demux => demux::run(inputs, limits, reporter),
    }
}

/// Opens the only recording among the inputs.
fn open(inputs: Vec<File>, limits: MediaLimits) -> Result<VideoFile, StopReason> {
    let file = inputs.into_iter().next().ok_or_else(|| StopReason::Impossible(explain::no_input()))?;
    Ok(VideoFile::open(file, limits)?)
}
