//! The messages between parent and child. Each message is one record of [`crate::sandbox`], encoded by `postcard`:
//! small, exact to the last bit of a number, and decoded without trust.
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
//! The pipeline's types have no serialisation. Their wire forms are in [`shapes`] and [`rows`] and have names that end
//! in `Shape` or `Row`.

mod follow;
mod placement;
mod rows;
mod shapes;

use serde::{Deserialize, Serialize};

pub use follow::{FollowReply, FollowWork, FollowedFrame, FollowedTool, LogPosition, RunningRow, live_features};
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
use crate::vision::trajectory::PathKind;

/// The request to a child. Its inputs are descriptors, in the order that the work states.
#[derive(Debug, Serialize, Deserialize)]
pub struct ChildRequest {
    /// Decoder threads.
    pub threads: usize,
    /// The work.
    pub work: ChildWork,
}

/// Kinds of work.
#[derive(Debug, Serialize, Deserialize)]
pub enum ChildWork {
    /// Decode one recording: size, frames, a preview.
    Probe,
    /// Track one recording.
    Track(TrackWork),
    /// Collect colours and report on them: from one clip, or from one picture per frame.
    Palette(PaletteWork),
    /// Find out which tapes suit a box: from a photo of the box without tools, or from a video's first frame.
    Advise,
    /// Make a mask of the tape colours on each marked picture, and a report on the colours; nothing is stored.
    Mask(PaletteWork),
    /// Look for a board in one photo.
    Check(BoardShape),
    /// Calibrate from one video, or from photos.
    Calibrate(CalibrateWork),
    /// Test a box: the board and a rod, both in one recording.
    SelfTest(SelfTestWork),
    /// Track a live recording. Inputs: its log, and a pipe of positions in it.
    Follow(FollowWork),
    /// Assemble a recording from a feed's log. Inputs: the log, and last the output file, open for writing.
    Assemble(AssembleWork),
    /// Split a live stream into coded frames. Input: a pipe with its bytes as they are pushed.
    Demux,
}

/// What assembling needs besides the log.
#[derive(Debug, Serialize, Deserialize)]
pub struct AssembleWork {
    /// Codec of the frames.
    pub codec: FrameCodec,
    /// Picture width and height, pixels.
    pub size: (u32, u32),
    /// Time base of the frames.
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
    /// Position of the camera.
    pub view: Option<ViewShape>,
}

/// What a self-test needs besides the recording.
#[derive(Debug, Serialize, Deserialize)]
pub struct SelfTestWork {
    /// Camera, tools and colours.
    pub track: TrackWork,
    /// The board in the box.
    pub board: BoardShape,
    /// Distance from the end of the tape to the tool's tip, mm.
    pub reach_mm: f64,
    /// RMS reprojection error of the camera's calibration, pixels, where it is known.
    pub calibration_rms_px: Option<f64>,
    /// Trocar positions in earlier sessions.
    pub ports: Vec<FulcrumShape>,
}

/// What collecting colours needs besides the pictures.
#[derive(Debug, Serialize, Deserialize)]
pub struct PaletteWork {
    /// Marked rectangles.
    pub marks: Vec<MarkShape>,
    /// The tape colour of each tool: a colour occurs twice if two tools wear it.
    pub tools: Vec<String>,
    /// The frame that each input shows; `None` if the only input is a clip.
    pub frames: Option<Vec<u64>>,
}

/// What calibration needs besides the pictures.
#[derive(Debug, Serialize, Deserialize)]
pub struct CalibrateWork {
    /// The board.
    pub board: BoardShape,
    /// Name of each photo, for the report; `None` if the only input is a video.
    pub photos: Option<Vec<String>>,
    /// Time stamp for the calibration, RFC 3339: a child has no clock.
    pub calibrated_at: String,
}

/// A reply from a child.
#[derive(Debug, Serialize, Deserialize)]
pub enum ChildReply {
    /// The child is confined; the first reply of every child.
    Confined {
        /// True if Landlock is enforced, at least in part.
        landlock: bool,
    },
    /// What the container announces.
    Recording {
        /// Width as displayed, pixels.
        width: u32,
        /// Height as displayed, pixels.
        height: u32,
        /// Frames to expect, if known.
        frames_expected: Option<u64>,
    },
    /// Decoded frames, in order.
    Frames {
        /// Their times, s.
        times_s: Vec<f64>,
        /// What the tracker saw in them; a row per frame and tool.
        seen: Vec<SeenRow>,
    },
    /// The result of one record of a feed.
    Followed(FollowReply),
    /// A sign of life and of progress, for work without frames.
    Alive {
        /// Pictures done.
        done: u64,
        /// Pictures in all, if known.
        of: Option<u64>,
    },
    /// Part of a path, in order.
    Path {
        /// Which path.
        kind: KindShape,
        /// Its rows.
        rows: Vec<PathRow>,
    },
    /// The tracker's summary.
    Quality(QualityShape),
    /// A small JPEG of one frame.
    Preview(Vec<u8>),
    /// The colour samples.
    Palette(PaletteShape),
    /// The report on the colours.
    PaletteReport(PaletteReport),
    /// Which tapes suit a box.
    PaletteAdvice(PaletteAdvice),
    /// The pixels classified as tape in the next picture.
    Mask(FrameMask),
    /// How a photo of a board can be used.
    PhotoCheck(PhotoCheck),
    /// A calibration.
    Calibration(CalibrationShape),
    /// The report of a self-test.
    SelfTest(Box<SelfTestReport>),
    /// A recording was assembled.
    Assembled {
        /// Number of frames in it.
        frames: u64,
        /// Number of frames that were left out because they cannot be decoded or shown.
        left_out: u64,
    },
    /// What a pushed stream contains.
    Stream(SourceInfo),
    /// The next frame of a pushed stream, in the order of decoding; without bytes where it is damaged or too long.
    Coded(CapturedFrame),
    /// Why the work cannot be done; the last reply.
    Problem(Problem),
    /// The work is done; the last reply.
    Done,
}

/// Wire form of [`PathKind`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum KindShape {
    /// Unfiltered.
    Raw,
    /// Causal.
    Filtered,
    /// Smoothed.
    Smoothed,
}

impl From<PathKind> for KindShape {
    fn from(kind: PathKind) -> Self {
        match kind {
            PathKind::Raw => Self::Raw,
            PathKind::Filtered => Self::Filtered,
            PathKind::Smoothed => Self::Smoothed,
        }
    }
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
