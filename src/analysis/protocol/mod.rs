//! The messages between parent and child. Each message is one record of [`crate::sandbox`], encoded by `postcard`:
//! small, exact to the last bit of a number, and decoded without trust.
//!
//! A child sends `Confined` first, then records of its kind of work ([`super::child`]) and signs of life, and at last
//! `Done` or `Problem`. The pipeline's types travel as they are.

mod quality;
mod seen;

use serde::{Deserialize, Serialize};

pub use quality::QualitySummary;
pub use seen::SeenRow;

pub use super::child::advise::AdviseWork;
pub use super::child::assemble::AssembleWork;
pub use super::child::calibrate::{CalibrateWork, RequestedBoard};
pub use super::child::check::CheckWork;
pub use super::child::check_edit::CheckEditWork;
pub use super::child::check_table::CheckTableWork;
pub use super::child::demux::DemuxWork;
pub use super::child::follow::{
    FollowReply, FollowWork, FollowedFrame, FollowedTool, LogPosition, RunningRow, SeenSoFar, live_features,
};
pub use super::child::mask::MaskWork;
pub use super::child::palette::{ColourMark, PaletteWork};
pub use super::child::probe::ProbeWork;
pub use super::child::score::{ScoreSource, ScoreWork};
pub use super::child::self_test::SelfTestWork;
pub use super::child::thumbnail::{Thumbnail, ThumbnailWork};
pub use super::child::track::TrackWork;
pub use super::child::{ChildWork, WorkRecord};
use crate::domain::problem::Problem;

/// The request to a child. Its inputs are descriptors, in the order that the work states.
#[derive(Debug, Serialize, Deserialize)]
pub struct ChildRequest {
    /// Decoder threads.
    pub threads: usize,
    /// The work.
    pub work: ChildWork,
}

/// A reply from a child.
#[derive(Debug, Serialize, Deserialize)]
pub enum ChildReply {
    /// The child is confined; the first reply of every child.
    Confined {
        /// True if Landlock is enforced, at least in part.
        landlock: bool,
    },
    /// A sign of life and of progress, for work without frames.
    Alive {
        /// Pictures done.
        done: u64,
        /// Pictures in all, if known.
        of: Option<u64>,
    },
    /// A record of the work.
    Record(WorkRecord),
    /// Why the work cannot be done; the last reply.
    Problem(Problem),
    /// The work is done; the last reply.
    Done,
}

/// Encodes a message. Fails only for lack of memory.
pub fn encode(message: &impl Serialize) -> Result<Vec<u8>, postcard::Error> {
    postcard::to_stdvec(message)
}

/// Decodes a message; no byte may be left over.
pub fn decode<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Result<T, postcard::Error> {
    match postcard::take_from_bytes(bytes)? {
        (message, []) => Ok(message),
        _ => Err(postcard::Error::SerdeDeCustom),
    }
}
