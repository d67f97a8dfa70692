//! Kinds of child work, one file each: what the parent requests, what the confined child does, which records the parent
//! accepts, and what it keeps of them. A new kind is a new file and a line in the table below.
//!
//! The child's half opens no file, reads no clock and stores nothing. The parent's half trusts no record: the file that
//! the child decoded may have taken over its decoder.

pub mod advise;
pub mod assemble;
pub mod calibrate;
pub mod check;
pub mod check_edit;
pub mod check_table;
pub mod demux;
mod explain;
pub mod follow;
mod limits;
pub mod mask;
pub mod palette;
mod preview;
pub mod probe;
pub mod recording;
mod reporter;
pub mod score;
pub mod self_test;
pub mod thumbnail;
pub mod track;

use std::fs::File;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::protocol::{self, ChildReply, ChildRequest};
use crate::domain::problem::Problem;
use crate::media::{CapturedFrame, MediaLimits, SourceInfo, VideoFile};
use crate::sandbox::{self, ConfinementError, LandlockStatus};

pub(super) use limits::MAX_TEXT_CHARS;
pub use reporter::Reporter;

/// One kind of child work.
pub trait ChildTask: Serialize + DeserializeOwned {
    /// A record that the child sends, besides those of every child.
    type Record: Serialize + DeserializeOwned;
    /// What the parent keeps of the records.
    type Output: Default;

    /// The child's half: does the work and sends the records.
    ///
    /// # Errors
    /// The work cannot be done, or the parent has closed the pipe.
    fn run(self, inputs: ChildInputs, reporter: &mut Reporter) -> Result<(), StopReason>;

    /// The parent's half: keeps a record, if an honest child could have sent it at this point.
    ///
    /// # Errors
    /// No honest child sends this record.
    fn accept(
        &self,
        record: Self::Record,
        output: &mut Self::Output,
        limits: MediaLimits,
    ) -> Result<ChildEvent, String>;
}

/// Declares the kinds of work: each with its name, the field of [`ChildOutput`], and the type of its request.
macro_rules! child_works {
    ($($(#[$doc:meta])* $kind:ident, $output:ident: $task:ty;)*) => {
        /// What a child is to do.
        #[derive(Debug, Serialize, Deserialize)]
        pub enum ChildWork {
            $($(#[$doc])* $kind($task),)*
        }

        /// A record of one kind of work.
        #[derive(Debug, Serialize, Deserialize)]
        pub enum WorkRecord {
            $($(#[$doc])* $kind(<$task as ChildTask>::Record),)*
        }

        /// The validated output of a child.
        #[derive(Debug, Default)]
        pub struct ChildOutput {
            /// Set once the child is confined; true if Landlock is enforced.
            pub landlock: Option<bool>,
            /// Why the work cannot be done.
            pub(super) problem: Option<Problem>,
            /// The child reported that it was done.
            pub(super) done: bool,
            $($(#[$doc])* pub $output: <$task as ChildTask>::Output,)*
        }

        impl ChildWork {
            fn run(self, inputs: ChildInputs, reporter: &mut Reporter) -> Result<(), StopReason> {
                match self {
                    $(Self::$kind(task) => task.run(inputs, reporter),)*
                }
            }

            /// Keeps a record in the output, if an honest child could have sent it at this point.
            pub(super) fn accept(
                &self,
                record: WorkRecord,
                output: &mut ChildOutput,
                limits: MediaLimits,
            ) -> Result<ChildEvent, String> {
                match (self, record) {
                    $((Self::$kind(task), WorkRecord::$kind(record)) => {
                        task.accept(record, &mut output.$output, limits)
                    })*
                    _ => Err("a reply that does not belong to this work".into()),
                }
            }
        }
    };
}

child_works! {
    /// Decode one recording: size, frames, a preview.
    Probe, probe: probe::ProbeWork;
    /// Decode the first frames of a recording: a picture of it, and whether it can be decoded.
    Thumbnail, thumbnail: thumbnail::ThumbnailWork;
    /// Track one recording. Inputs: the recording, and a photo of the empty box if there is one.
    Track, track: track::TrackWork;
    /// Collect colours and report on them: from one clip, or from one picture per frame. A photo of the empty box is
    /// the last input.
    Palette, palette: palette::PaletteWork;
    /// Find out which tapes suit a box: from a photo of the box without tools, or from a video's first frame.
    Advise, advice: advise::AdviseWork;
    /// Make a mask of the tape colours on each marked picture, and a report on the colours; nothing is stored.
    Mask, mask: mask::MaskWork;
    /// Look for a board in one photo.
    Check, photo_check: check::CheckWork;
    /// Calibrate from one video, or from photos.
    Calibrate, camera_json: calibrate::CalibrateWork;
    /// Test a box: the board and a rod, both in one recording.
    SelfTest, self_test: self_test::SelfTestWork;
    /// Score a session: its stored path, or the table of another tracker.
    Score, score: score::ScoreWork;
    /// Check a new edit against a session's stored path.
    CheckEdit, edit_check: check_edit::CheckEditWork;
    /// Check whether a table of another tracker can be imported.
    CheckTable, table_check: check_table::CheckTableWork;
    /// Track a live recording. Inputs: its log, a pipe of positions in it, and a photo of the empty box if there is
    /// one.
    Follow, followed: follow::FollowWork;
    /// Assemble a recording from a feed's log. Inputs: the log, and last the output file, open for writing.
    Assemble, assembled: assemble::AssembleWork;
    /// Split a live stream into coded frames. Input: a pipe with its bytes as they are pushed.
    Demux, demuxed: demux::DemuxWork;
}

/// What a reply means for the caller at once.
#[derive(Debug)]
pub enum ChildEvent {
    /// Nothing: the content is kept, or the reply is only a sign of life.
    Nothing,
    /// Progress of the child, 0..1.
    Progress(f64),
    /// The result of one record of a feed.
    Followed(follow::FollowReply),
    /// What a pushed stream contains.
    Stream(SourceInfo),
    /// The next coded frame of a pushed stream.
    Coded(CapturedFrame),
}

impl ChildEvent {
    /// The progress after this many of all pictures, if their number is known.
    pub(super) fn progress(done: u64, of: Option<u64>) -> Self {
        let share = of.filter(|&of| of > 0).map(|of| (done as f64 / of as f64).min(1.0));
        share.map_or(ChildEvent::Nothing, ChildEvent::Progress)
    }
}

/// The child's input files, in the order that the work states, and the limits of decoding.
pub struct ChildInputs {
    files: Vec<File>,
    limits: MediaLimits,
}

impl ChildInputs {
    /// The first file.
    fn first(self) -> Result<File, StopReason> {
        self.files.into_iter().next().ok_or_else(no_input)
    }

    /// The first file, and the second if there is one.
    fn first_and_second(self) -> Result<(File, Option<File>), StopReason> {
        let mut files = self.files.into_iter();
        Ok((files.next().ok_or_else(no_input)?, files.next()))
    }

    /// The first two files, and the third if there is one.
    fn first_two_and_third(self) -> Result<([File; 2], Option<File>), StopReason> {
        let mut files = self.files.into_iter();
        let (first, second) = files.next().zip(files.next()).ok_or_else(no_input)?;
        Ok(([first, second], files.next()))
    }

    /// Takes the last file away.
    fn take_last(&mut self) -> Result<File, StopReason> {
        self.files.pop().ok_or_else(no_input)
    }

    /// The last two files.
    fn pair(mut self) -> Result<[File; 2], StopReason> {
        match (self.files.pop(), self.files.pop()) {
            (Some(last), Some(before)) => Ok([before, last]),
            _ => Err(no_input()),
        }
    }

    /// Opens the only recording.
    fn video(self) -> Result<VideoFile, StopReason> {
        let limits = self.limits;
        Ok(VideoFile::open(self.first()?, limits)?)
    }
}

fn no_input() -> StopReason {
    StopReason::Impossible(explain::no_input())
}

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
pub enum StopReason {
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
    let limits = MediaLimits { threads: request.threads, ..MediaLimits::default() };
    let last = match request.work.run(ChildInputs { files: admission.inputs, limits }, &mut reporter) {
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
