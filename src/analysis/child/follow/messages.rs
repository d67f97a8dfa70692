//! Messages while a live recording is tracked.
//!
//! The child has two inputs: the feed's log, which the parent appends to, and a pipe of [`LogPosition`]s in it. Frames
//! wait in the log and not in memory, no matter how far the child falls behind.

use std::io::{self, Read};

use serde::{Deserialize, Serialize};

use crate::analysis::protocol::SeenRow;
use crate::domain::feed::{FrameCodec, TimeBase};
use crate::domain::session::LiveFeature;
use crate::motion::features::FeatureValue;
use crate::motion::features::running::LIVE_FEATURES;
use crate::motion::quality::ports::Ports;
use crate::motion::quality::ports::watch::ConfirmedPlacement;
use crate::motion::quality::{Concern, Figures, MovedDuring, QualityCause, Severity, judge};
use crate::vision::reason::MissReason;
use crate::vision::tracker::{Absence, LightSample, ToolReport, TrackerSettings};
use crate::vision::trajectory::Sample;

/// What tracking a live recording needs besides its frames.
#[derive(Debug, Serialize, Deserialize)]
pub struct FollowWork {
    /// The same as for a complete recording.
    pub track: TrackerSettings,
    /// Codec of the frames.
    pub codec: FrameCodec,
    /// Picture width and height, pixels.
    pub size: (u32, u32),
    /// Time base of the frames.
    pub time_base: TimeBase,
    /// Trocar positions in the box's earlier sessions.
    pub ports: Ports,
}

/// A message on the pipe to the child: 16 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LogPosition {
    /// A record of the log.
    Record {
        /// Offset in the log, bytes.
        offset: u64,
        /// Length including the header, bytes.
        bytes: u32,
        /// True if the reply should contain a picture.
        wants_picture: bool,
    },
    /// Nothing has arrived for a while: reply as a sign of life.
    Beat,
}

impl LogPosition {
    /// Length on the pipe, bytes.
    pub const BYTES: usize = 16;
    const BEAT: u64 = u64::MAX;

    /// Encodes the message.
    pub fn to_bytes(self) -> [u8; Self::BYTES] {
        let (offset, bytes, flags) = match self {
            LogPosition::Record { offset, bytes, wants_picture } => (offset, bytes, u32::from(wants_picture)),
            LogPosition::Beat => (Self::BEAT, 0, 0),
        };
        let mut all = [0; Self::BYTES];
        all[..8].copy_from_slice(&offset.to_le_bytes());
        all[8..12].copy_from_slice(&bytes.to_le_bytes());
        all[12..].copy_from_slice(&flags.to_le_bytes());
        all
    }

    /// Reads the next message from a pipe; `None` at its end.
    ///
    /// # Errors
    /// The pipe's errors.
    pub fn read(pipe: &mut impl Read) -> io::Result<Option<Self>> {
        let mut all = [0; Self::BYTES];
        match pipe.read_exact(&mut all) {
            Ok(()) => {}
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(None),
            Err(error) => return Err(error),
        }
        let number = |from: usize| u32::from_le_bytes([all[from], all[from + 1], all[from + 2], all[from + 3]]);
        let offset = u64::from(number(4)) << 32 | u64::from(number(0));
        let record = LogPosition::Record { offset, bytes: number(8), wants_picture: number(12) != 0 };
        Ok(Some(if offset == Self::BEAT { LogPosition::Beat } else { record }))
    }
}

/// The child's reply to a position.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FollowReply {
    /// Tracked frames, none or several: a decoder holds frames back to put them in order.
    pub frames: Vec<FollowedFrame>,
    /// Features so far, about once a second.
    pub running: Option<Vec<RunningRow>>,
    /// Scene light relative to the first frame. Sent with the features.
    pub light: Option<LightSample>,
    /// Lasting shifts of camera and trocars, once a trocar is known. Sent with the features.
    pub placement: Option<ConfirmedPlacement>,
    /// The movement of the camera during this recording, if there was one. Sent with the features.
    pub moved_during: Option<MovedDuring>,
    /// How well each tool was seen so far. Sent with the features.
    pub seen: Option<Vec<SeenSoFar>>,
    /// True while the box behind tools without tape is still being learned. Sent with the features.
    pub is_learning_box: bool,
    /// A small JPEG, and the number of its frame.
    pub picture: Option<(u64, Vec<u8>)>,
}

/// A tracked frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FollowedFrame {
    /// Its number in the feed.
    pub frame: u64,
    /// When it was captured, s.
    pub time_s: f64,
    /// Each tool, in order.
    pub tools: Vec<FollowedTool>,
}

impl FollowedFrame {
    /// The distance of two tips and its standard deviation to first order, mm; `None` if the tips coincide, or if there
    /// are not two.
    pub fn distance_mm(&self) -> Option<[f64; 2]> {
        let [FollowedTool { path: Some(one), .. }, FollowedTool { path: Some(other), .. }] = &self.tools[..] else {
            return None;
        };
        let between = one.tip_mm - other.tip_mm;
        let towards = between.try_normalize(1e-6)?;
        let sigma_mm = |row: &Sample| Some(row.covariance_mm2?.sigma_along_mm(&towards));
        Some([between.norm(), sigma_mm(one)?.hypot(sigma_mm(other)?)])
    }
}

/// A tool on a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FollowedTool {
    /// What the tracker saw of it.
    pub seen: SeenRow,
    /// Its position by the causal filter, if there is one.
    pub path: Option<Sample>,
    /// True if it has no position because it left the view.
    pub left_view: bool,
}

impl FollowedTool {
    /// The wire form of one tool's report.
    pub fn new(frame: u64, report: &ToolReport) -> Self {
        Self {
            seen: SeenRow::new(frame, report),
            path: report.filtered,
            left_view: report.absence == Some(Absence::LeftView),
        }
    }

    /// Why it was not measured on this frame, by the name used in files, API and pages.
    pub fn reason(&self) -> Option<&'static str> {
        self.seen.reason.map(MissReason::name)
    }
}

/// A running feature of a tool.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunningRow {
    /// Index of the tool.
    pub tool: u32,
    /// Index into [`LIVE_FEATURES`].
    pub feature: u32,
    /// Its value, in the feature's unit; `None` where too little was seen.
    pub value: Option<f64>,
}

impl RunningRow {
    /// The wire form of a value; `None` for a feature that is not shown live.
    pub fn new(value: &FeatureValue) -> Option<Self> {
        let feature = LIVE_FEATURES.iter().position(|live| *live == value.feature)?;
        Some(Self { tool: value.tool? as u32, feature: feature as u32, value: value.value.ok() })
    }
}

/// How well a tool was seen so far, judged with the limits for finished sessions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SeenSoFar {
    /// Share of the frames on which it was measured, from the first to the last frame with any tool; `None` before the
    /// first.
    pub coverage: Option<f64>,
    /// The figure that would harm the session most, if the recording ended now.
    pub worst: Option<LiveConcern>,
}

/// A figure beyond its limit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LiveConcern {
    /// Index into [`QualityCause::ALL`].
    pub cause: u32,
    /// The figure, in the cause's unit.
    pub figure: f64,
    /// The limit that it broke.
    pub limit: f64,
    /// True if it would refuse the session.
    pub refuses: bool,
    /// True if the tool is followed by its bare shaft.
    pub is_bare: bool,
}

impl SeenSoFar {
    /// One entry per tool.
    pub fn of_tools(figures: &Figures) -> Vec<Self> {
        let verdict = judge(figures);
        let of_tool = |tool: &crate::motion::quality::ToolFigures| {
            let worst = verdict.concerns().iter().find(|concern| concern.tool.as_deref() == Some(&*tool.tool));
            Self { coverage: tool.coverage, worst: worst.and_then(LiveConcern::new) }
        };
        figures.tools.iter().map(of_tool).collect()
    }

    /// The worst figure with the tool's name, as for a finished session.
    pub fn concern(&self, tool: &str) -> Option<Concern> {
        let LiveConcern { cause, figure, limit, refuses, is_bare } = self.worst?;
        let severity = if refuses { Severity::Refuse } else { Severity::Care };
        let cause = *QualityCause::ALL.get(cause as usize)?;
        let tool = Some(tool.to_owned());
        let (label, longest, rows, at_s) = (None, None, None, None);
        Some(Concern { cause, tool, is_bare, label, longest, rows, at_s, figure, limit, severity })
    }

    /// Every number of it.
    pub fn numbers(&self) -> impl Iterator<Item = f64> + use<> {
        let worst = self.worst.map(|worst| [worst.figure, worst.limit]);
        self.coverage.into_iter().chain(worst.into_iter().flatten())
    }
}

impl LiveConcern {
    fn new(concern: &Concern) -> Option<Self> {
        let cause = QualityCause::ALL.iter().position(|cause| *cause == concern.cause)? as u32;
        let refuses = concern.severity == Severity::Refuse;
        Some(Self { cause, figure: concern.figure, limit: concern.limit, refuses, is_bare: concern.is_bare })
    }
}

/// Running features by name; `tools` are the tool names.
pub fn live_features(rows: &[RunningRow], tools: &[String]) -> Vec<LiveFeature> {
    let named = |row: &RunningRow| {
        let (feature, tool) = (LIVE_FEATURES.get(row.feature as usize)?, tools.get(row.tool as usize)?);
        let [name, title, unit] = [feature.name, feature.title, feature.unit].map(str::to_owned);
        Some(LiveFeature { name, title, unit, tool: tool.clone(), value: row.value })
    };
    rows.iter().filter_map(named).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_survive_their_bytes() {
        let places = [
            LogPosition::Record { offset: 0x0123_4567_89ab_cdef, bytes: 1_048_608, wants_picture: true },
            LogPosition::Record { offset: 0, bytes: 33, wants_picture: false },
            LogPosition::Beat,
        ];
        let bytes: Vec<u8> = places.iter().flat_map(|place| place.to_bytes()).collect();
        let mut pipe = &bytes[..];
        for place in places {
            assert_eq!(LogPosition::read(&mut pipe).unwrap(), Some(place));
        }
        assert_eq!(LogPosition::read(&mut pipe).unwrap(), None);
    }
}
