//! Pieces of work: what they are about and how they stand.
//!
//! ```text
//!            claim                finish
//! queued ───────────▶ running ───────────▶ done
//!   ▲ ▲                │ │ │    fail
//!   │ └── give back ───┘ │ └─────────────▶ failed ──────────┐
//!   ├──── crash, 1st 2nd ┤                                  │
//!   │                    └─ crash, 3rd ──▶ quarantined ─────┤
//!   └───────────────────── retry by a person ───────────────┘
//! ```
//! `failed` means that the work itself says why it cannot be done (not a video, no marker colour); `quarantined` that
//! whoever worked on it died or fell silent, three times.

use serde::{Deserialize, Serialize};

use super::blob::Blob;
use super::calibration::BoardSize;
use super::files::annotations::AnnotationsFile;
use super::named;
use super::text::TrackerName;
use crate::ids::{BoxId, CalibrationId, PaletteId, PersonId, ResultId, SessionId};

named! {
    /// What kind of work.
    JobKind: "job kind" {
        /// Track a session's recording and score it.
        Track = "track",
        /// Score a path that another tracker measured.
        Import = "import",
        /// Score a session's stored path again.
        Rescore = "rescore",
        /// Make a box's next calibration from pictures of a checkerboard.
        Calibrate = "calibrate",
        /// Collect a box's next colour samples from marked frames, or find out which tapes suit it.
        Palette = "palette",
        /// Test whether a box still measures what it should.
        SelfTest = "self_test",
    }
}

named! {
    /// How a job stands.
    JobState: "job state" {
        /// Waits for a worker.
        Queued = "queued",
        /// A worker holds its lease.
        Running = "running",
        /// Its result is stored.
        Done = "done",
        /// The work cannot be done; the problem says why.
        Failed = "failed",
        /// Whoever worked on it died or fell silent too often.
        Quarantined = "quarantined",
    }
}

/// Whose turn comes first; among equals, who has waited longest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Turn {
    /// Work about boxes: sessions wait for it.
    Box = 0,
    /// New sessions: people wait for them.
    Session = 1,
    /// Sessions that have a result already.
    Again = 2,
}

/// What a job works on, as it is stored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum JobInput {
    /// Track a session.
    Track(TrackInput),
    /// Score a path that came alone.
    Import(ImportInput),
    /// Score a stored path again.
    Rescore(RescoreInput),
    /// Calibrate a box's camera.
    Calibrate(CalibrateInput),
    /// Collect a box's colour samples.
    Palette(PaletteInput),
    /// Find out which tapes suit a box.
    Advice(AdviceInput),
    /// Test a box.
    #[serde(rename = "self_test")]
    SelfTest(SelfTestInput),
}

/// A recording, and the versions it is tracked with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackInput {
    /// Whose recording.
    pub session: SessionId,
    /// The recording.
    pub video: Blob,
    /// With which camera.
    pub calibration: CalibrationId,
    /// With which colour samples.
    pub palette: PaletteId,
}

/// Rows of another tracker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImportInput {
    /// Whose.
    pub session: SessionId,
    /// The table as it was sent.
    pub table: Blob,
    /// Who measured it.
    pub tracker: TrackerName,
}

/// A session's result, whose path is scored as the present program does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RescoreInput {
    /// Whose.
    pub session: SessionId,
    /// Which of its results.
    pub result: ResultId,
    /// The paths of that result.
    pub trajectory: Blob,
    /// For which state of the session's edits it was ordered.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub edits: u64,
}

/// Of a session that was never edited the work is written as ever, so that it is the same work.
fn is_zero(edits: &u64) -> bool {
    *edits == 0
}

/// Pictures of a checkerboard.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CalibrateInput {
    /// Whose camera.
    #[serde(rename = "box")]
    pub of: BoxId,
    /// The board.
    pub board: BoardSize,
    /// Side of a square, mm.
    pub square_mm: f64,
    /// Photos, or one video.
    pub files: Vec<NamedBlob>,
    /// Is the one file a video?
    pub is_video: bool,
}

/// Marked frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PaletteInput {
    /// Whose colours.
    #[serde(rename = "box")]
    pub of: BoxId,
    /// What is marked, and the tools' sizes.
    pub annotations: AnnotationsFile,
    /// The clip in which `frame` counts, or one picture per frame.
    pub files: Vec<NamedBlob>,
    /// Is the one file a video? Otherwise file `n` shows frame [`PaletteInput::frames`]`[n]`.
    pub is_video: bool,
    /// Which frame each picture shows; empty for a video.
    pub frames: Vec<u64>,
}

/// A picture of a box without tools.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AdviceInput {
    /// Of which box.
    #[serde(rename = "box")]
    pub of: BoxId,
    /// A photo, or a recording that begins with it.
    pub picture: NamedBlob,
}

/// A recording of a printed board and a rod, and the versions that it tests.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SelfTestInput {
    /// Which box.
    #[serde(rename = "box")]
    pub of: BoxId,
    /// Who asks for it.
    pub person: Option<PersonId>,
    /// Which camera is tested.
    pub calibration: CalibrationId,
    /// Which colour samples are tested.
    pub palette: PaletteId,
    /// The board that lies in the box.
    pub board: BoardSize,
    /// Side of a square, mm.
    pub square_mm: f64,
    /// How far beyond the tape the tool's point lies, mm.
    pub reach_mm: f64,
    /// The recording.
    pub file: NamedBlob,
}

/// A file that came with a request, under the name that it had there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NamedBlob {
    /// Its name, for reports.
    pub name: String,
    /// Its content.
    pub blob: Blob,
}

impl JobInput {
    /// Its kind.
    pub fn kind(&self) -> JobKind {
        match self {
            JobInput::Track(_) => JobKind::Track,
            JobInput::Import(_) => JobKind::Import,
            JobInput::Rescore(_) => JobKind::Rescore,
            JobInput::Calibrate(_) => JobKind::Calibrate,
            JobInput::Palette(_) | JobInput::Advice(_) => JobKind::Palette,
            JobInput::SelfTest(_) => JobKind::SelfTest,
        }
    }

    /// Whose turn it is for.
    pub fn turn(&self) -> Turn {
        match self {
            JobInput::Track(_) | JobInput::Import(_) => Turn::Session,
            JobInput::Rescore(_) => Turn::Again,
            JobInput::Calibrate(_) | JobInput::Palette(_) | JobInput::Advice(_) | JobInput::SelfTest(_) => Turn::Box,
        }
    }

    /// The session it is about, if it is about one.
    pub fn session(&self) -> Option<SessionId> {
        match self {
            JobInput::Track(track) => Some(track.session),
            JobInput::Import(import) => Some(import.session),
            JobInput::Rescore(rescore) => Some(rescore.session),
            JobInput::Calibrate(_) | JobInput::Palette(_) | JobInput::Advice(_) | JobInput::SelfTest(_) => None,
        }
    }

    /// The box it is about, if it is about one.
    pub fn of_box(&self) -> Option<BoxId> {
        match self {
            JobInput::Track(_) | JobInput::Import(_) | JobInput::Rescore(_) => None,
            JobInput::Calibrate(calibrate) => Some(calibrate.of),
            JobInput::Palette(palette) => Some(palette.of),
            JobInput::Advice(advice) => Some(advice.of),
            JobInput::SelfTest(test) => Some(test.of),
        }
    }

    /// The files it reads.
    pub fn blobs(&self) -> Vec<Blob> {
        match self {
            JobInput::Track(track) => vec![track.video],
            JobInput::Import(import) => vec![import.table],
            JobInput::Rescore(rescore) => vec![rescore.trajectory],
            JobInput::Advice(advice) => vec![advice.picture.blob],
            JobInput::SelfTest(test) => vec![test.file.blob],
            JobInput::Calibrate(CalibrateInput { files, .. }) | JobInput::Palette(PaletteInput { files, .. }) => {
                files.iter().map(|file| file.blob).collect()
            }
        }
    }
}
