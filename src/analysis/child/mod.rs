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

use super::protocol::{self, Answer, PaletteWork, Request, Work};
use crate::domain::problem::Problem;
use crate::media::{Limits, VideoFile};
use crate::sandbox::{self, ConfinementError, Enforced};

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
    Silenced(#[from] std::io::Error),
}

/// Why a piece of work stopped early.
enum Halt {
    /// The work cannot be done; the parent receives the reason.
    Explained(Problem),
    /// The parent has closed the pipe.
    Silenced(std::io::Error),
}

impl From<std::io::Error> for Halt {
    fn from(error: std::io::Error) -> Self {
        Halt::Silenced(error)
    }
}

impl<E: explain::Explain> From<E> for Halt {
    fn from(error: E) -> Self {
        Halt::Explained(error.explain())
    }
}

/// The child's whole run: confine, receive the request, work, report the end.
pub fn run() -> Result<(), ChildError> {
    let admission = sandbox::admit()?;
    let mut reporter = Reporter::new();
    reporter.say(&Answer::Confined { landlock: admission.enforced != Enforced::NoLandlock })?;
    let request: Request = protocol::decode(&admission.request).map_err(ChildError::Request)?;
    share_the_cores(request.threads);
    let last = match work(request, admission.inputs, &mut reporter) {
        Ok(()) => Answer::Done,
        Err(Halt::Explained(problem)) => Answer::Problem(problem),
        Err(Halt::Silenced(error)) => return Err(error.into()),
    };
    Ok(reporter.say(&last)?)
}

/// Limits rayon to the threads of this child. Otherwise each child would start a thread per core, and their stacks
/// count as its memory.
fn share_the_cores(threads: usize) {
    // This fails only if the pool exists already, and then it has the right size: this runs once.
    let _ = rayon::ThreadPoolBuilder::new().num_threads(threads.max(1)).build_global();
}

fn work(request: Request, inputs: Vec<File>, reporter: &mut Reporter) -> Result<(), Halt> {
    let limits = Limits { threads: request.threads, ..Limits::default() };
    match request.work {
        Work::Probe => probe::run(open(inputs, limits)?, reporter),
        Work::Track(work) => track::run(work, open(inputs, limits)?, reporter),
        Work::Palette(PaletteWork { marks, tools, frames: None }) => {
            palette::from_clip(&marks, &tools, open(inputs, limits)?, reporter)
        }
        Work::Palette(PaletteWork { marks, tools, frames: Some(frames) }) => {
            let pictures = palette::Pictures { frames: &frames, inputs, limits };
            palette::from_pictures(&marks, &tools, pictures, reporter)
        }
        Work::Advise => palette::advise_on(inputs, limits, reporter),
        Work::Mask(PaletteWork { marks, tools, frames }) => {
            let pictures = palette::Pictures { frames: &frames.unwrap_or_default(), inputs, limits };
            palette::mask_on(&marks, &tools, pictures, reporter)
        }
        Work::Check(board) => check::run(board, inputs, limits, reporter),
        Work::Calibrate(work) => calibrate::run(work, inputs, limits, reporter),
        Work::SelfTest(work) => self_test::run(work, open(inputs, limits)?, reporter),
        Work::Follow(work) => follow::run(work, inputs, limits, reporter),
        Work::Assemble(work) => assemble::run(work, inputs, reporter),
        Work::Demux => demux::run(inputs, limits, reporter),
    }
}

/// Opens the only recording among the inputs.
fn open(inputs: Vec<File>, limits: Limits) -> Result<VideoFile, Halt> {
    let file = inputs.into_iter().next().ok_or_else(|| Halt::Explained(explain::no_input()))?;
    Ok(VideoFile::open(file, limits)?)
}
