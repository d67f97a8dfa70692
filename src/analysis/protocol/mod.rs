//! What parent and child say to each other. Each message is one record of [`crate::sandbox`], coded by `postcard`: small,
//! exact to the last bit of a number, and decoded without trust.
//!
//! ```text
//! probe      Confined  Recording  Frames*  Preview                              Done
//! track      Confined  Recording  Frames*  Path*  Quality  Preview              Done
//! palette    Confined  Recording? Alive*   Palette  PaletteReport               Done
//! advise     Confined  PaletteAdvice                                            Done
//! mask       Confined  Alive*              PaletteReport  Mask*                  Done
//! check      Confined  PhotoCheck                                               Done
//! calibrate  Confined  Recording? Alive*   Calibration                          Done
//! self-test  Confined  Alive*              SelfTest                             Done
//! follow     Confined  (Followed | Alive)*                                      Done
//! assemble   Confined  Alive*              Assembled                            Done
//! demux      Confined  Stream  Coded*                                           Done
//! any        …                                                    Problem
//! ```
//! The pipeline's types know no serialisation; their images here are in [`shapes`] and [`rows`].

mod follow;
mod placement;
mod rows;
mod shapes;

use serde::{Deserialize, Serialize};

pub use follow::{FollowWork, Followed, FollowedFrame, FollowedTool, Place, RunningRow, live_features};
pub use placement::{FulcrumShape, PlacementShape};
pub use rows::{PathRow, ReasonShape, SeenRow};
pub use shapes::{
    BoardShape, CalibrationShape, CameraShape, MarginShape, MarkShape, PaletteShape, QualityShape, SideShape,
    ToolQualityShape, ToolShape, ViewShape,
};

use crate::domain::feed::{FrameCodec, TimeBase};
use crate::domain::palette::{FrameMask, PaletteAdvice, PaletteReport};
use crate::domain::photo_check::PhotoCheck;
use crate::domain::problem::Problem;
use crate::domain::self_test::SelfTestReport;
use crate::media::{CapturedFrame, SourceInfo};
use crate::pipeline::trajectory::Kind;

/// What a child is asked to do. Its inputs are descriptors, in the order that the work states.
#[derive(Debug, Serialize, Deserialize)]
pub struct Request {
    /// Decoder threads.
    pub threads: usize,
    /// The work.
    pub work: Work,
}

/// Kinds of work.
#[derive(Debug, Serialize, Deserialize)]
pub enum Work {
    /// Decode one recording: size, frames, a small picture.
    Probe,
    /// Track one recording.
    Track(TrackWork),
    /// Collect colours and judge them: from one clip, or from one picture per frame.
    Palette(PaletteWork),
    /// Find out which tapes suit a box: from a photo of it without tools, or a video's first frame.
    Advise,
    /// Mark what the colours of marked pictures take for tape on each of them, and judge them; nothing is learned.
    Mask(PaletteWork),
    /// Look for a board on one photo.
    Check(BoardShape),
    /// Calibrate from one video, or from photos.
    Calibrate(CalibrateWork),
    /// Test a box: the board and a rod in one recording.
    SelfTest(SelfTestWork),
    /// Track a recording while it arrives: its log, and a pipe of places in it.
    Follow(FollowWork),
    /// Put a feed's frames together: its log in, a recording out, which is the last of the inputs and open for writing.
    Assemble(AssembleWork),
    /// Take a live stream apart into coded frames: a pipe of its bytes, as they are pushed.
    Demux,
}

/// What putting frames together needs besides the log.
#[derive(Debug, Serialize, Deserialize)]
pub struct AssembleWork {
    /// How frames are coded.
    pub codec: FrameCodec,
    /// Picture width and height, pixels.
    pub size: (u32, u32),
    /// The clock of the frames.
    pub time_base: TimeBase,
}

/// What tracking needs besides the recording.
#[derive(Debug, Serialize, Deserialize)]
pub struct TrackWork {
    /// The box's camera.
    pub camera: CameraShape,
    /// Tools to track.
    pub tools: Vec<ToolShape>,
    /// The box's colours.
    pub palette: PaletteShape,
    /// Camera's place.
    pub view: Option<ViewShape>,
}

/// What a self-test needs besides the recording.
#[derive(Debug, Serialize, Deserialize)]
pub struct SelfTestWork {
    /// What the recording is tracked with.
    pub track: TrackWork,
    /// The board that lies in the box.
    pub board: BoardShape,
    /// How far beyond the tape the tool's point lies, mm.
    pub reach_mm: f64,
    /// RMS reprojection error of the camera's calibration, pixels, where it is known.
    pub calibration_rms_px: Option<f64>,
    /// Where trocars were in earlier sessions.
    pub ports: Vec<FulcrumShape>,
}

/// What collecting colours needs besides the pictures.
#[derive(Debug, Serialize, Deserialize)]
pub struct PaletteWork {
    /// Marked rectangles.
    pub marks: Vec<MarkShape>,
    /// The colour that each tool wears: twice, where two wear the same.
    pub tools: Vec<String>,
    /// Frame shown by each input; `None`: the one input is a clip.
    pub frames: Option<Vec<u64>>,
}

/// What calibration needs besides the pictures.
#[derive(Debug, Serialize, Deserialize)]
pub struct CalibrateWork {
    /// The board.
    pub board: BoardShape,
    /// Name of each photo, for the report; `None`: the one input is a video.
    pub photos: Option<Vec<String>>,
    /// The moment that the calibration is to bear, RFC 3339: a child has no clock.
    pub calibrated_at: String,
}

/// What a child answers.
#[derive(Debug, Serialize, Deserialize)]
pub enum Answer {
    /// It is confined; the first word of every child.
    Confined {
        /// Does Landlock hold, at least in part?
        landlock: bool,
    },
    /// What the container says.
    Recording {
        /// Width as displayed, pixels.
        width: u32,
        /// Height as displayed, pixels.
        height: u32,
        /// Frames to expect, if known.
        frames_expected: Option<u64>,
    },
    /// Frames that have been decoded, in order.
    Frames {
        /// Their times, s.
        times_s: Vec<f64>,
        /// What was seen on them; a row per frame and tool.
        seen: Vec<SeenRow>,
    },
    /// What one more record of a feed showed.
    Followed(Followed),
    /// Still at work; for work without frames.
    Alive {
        /// Pictures looked at.
        done: u64,
        /// Of how many, if known.
        of: Option<u64>,
    },
    /// A piece of a path, in order.
    Path {
        /// Of which.
        kind: KindShape,
        /// Its rows.
        rows: Vec<PathRow>,
    },
    /// How tracking went.
    Quality(QualityShape),
    /// A small JPEG of one frame.
    Preview(Vec<u8>),
    /// Collected colours.
    Palette(PaletteShape),
    /// What they are worth.
    PaletteReport(PaletteReport),
    /// Which tapes suit a box.
    PaletteAdvice(PaletteAdvice),
    /// What of the next picture is taken for tape.
    Mask(FrameMask),
    /// What a photo of a board is good for.
    PhotoCheck(PhotoCheck),
    /// A calibration.
    Calibration(CalibrationShape),
    /// What a self-test found.
    SelfTest(Box<SelfTestReport>),
    /// A recording was put together.
    Assembled {
        /// Frames in it.
        frames: u64,
        /// Frames that came but cannot be decoded or shown.
        left_out: u64,
    },
    /// What a pushed stream holds.
    Stream(SourceInfo),
    /// The next frame of a pushed stream, in the order of decoding; without bytes where it is damaged or too long.
    Coded(CapturedFrame),
    /// Why the work cannot be done; the last word.
    Problem(Problem),
    /// The work is done; the last word.
    Done,
}

/// [`Kind`] on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum KindShape {
    /// Unfiltered.
    Raw,
    /// Causal.
    Filtered,
    /// Smoothed.
    Smoothed,
}

impl From<Kind> for KindShape {
    fn from(kind: Kind) -> Self {
        match kind {
            Kind::Raw => Self::Raw,
            Kind::Filtered => Self::Filtered,
            Kind::Smoothed => Self::Smoothed,
        }
    }
}

/// A message as bytes. Fails only for lack of memory.
pub fn encode(message: &impl Serialize) -> Result<Vec<u8>, postcard::Error> {
    postcard::to_stdvec(message)
}

/// Bytes as a message; nothing may be left over.
pub fn decode<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Result<T, postcard::Error> {
    match postcard::take_from_bytes(bytes)? {
        (message, []) => Ok(message),
        _ => Err(postcard::Error::SerdeDeCustom),
    }
}
