//! Jobs: their inputs, kinds and states.
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
//! `failed`: the job cannot be done, and the problem says why (not a video, no marker colour). `quarantined`: the
//! process that ran the job crashed or stopped responding three times.

use serde::{Deserialize, Serialize};

use super::blob::Blob;
use super::calibration::BoardSize;
use super::files::annotations::AnnotationsFile;
use super::named;
use super::text::TrackerName;
use crate::ids::{BoxId, CalibrationId, PaletteId, PersonId, ResultId, SessionId};

named! {
    /// Kind of job.
    JobKind: "job kind" {
        /// Track a session's recording and score it.
        Track = "track",
        /// Score a trajectory that another tracker measured.
        Import = "import",
        /// Score a session's stored trajectory again.
        Rescore = "rescore",
        /// Make a box's next calibration from pictures of a checkerboard.
        Calibrate = "calibrate",
        /// Collect a box's next colour samples from marked frames.
        Palette = "palette",
        /// Rank the tapes that suit a box. Earlier versions called such a job `palette`.
        Advise = "advise",
        /// Test whether a box still measures correctly.
        SelfTest = "self_test",
    }
}

named! {
    /// State of a job.
    JobState: "job state" {
        /// Waits for a worker.
        Queued = "queued",
        /// A worker holds its lease.
        Running = "running",
        /// Its result is stored.
        Done = "done",
        /// The job cannot be done; the problem says why.
        Failed = "failed",
        /// The process that ran it crashed or stopped responding too often.
        Quarantined = "quarantined",
    }
}

/// Priority of a job in the queue; within one priority, the oldest job runs first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum JobPriority {
    /// Jobs about boxes: sessions wait for them.
    Box = 0,
    /// New sessions: people wait for them.
    Session = 1,
    /// Sessions that have a result already.
    Rescore = 2,
}

/// A job's input, as stored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum JobInput {
    /// Track a session.
    Track(TrackInput),
    /// Score an imported trajectory.
    Import(ImportInput),
    /// Score a stored trajectory again.
    Rescore(RescoreInput),
    /// Calibrate a box's camera.
    Calibrate(CalibrateInput),
    /// Collect a box's colour samples.
    Palette(PaletteInput),
    /// Rank the tapes that suit a box. Jobs of earlier versions are stored as `advice`; another name would change the
    /// hash of the same input.
    #[serde(rename = "advice")]
    Advise(AdviseInput),
    /// Test a box.
    #[serde(rename = "self_test")]
    SelfTest(SelfTestInput),
}

/// A recording, and the versions to track it with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackInput {
    /// The session.
    pub session: SessionId,
    /// The recording.
    pub video: Blob,
    /// The camera's calibration.
    pub calibration: CalibrationId,
    /// The colour samples.
    pub palette: PaletteId,
}

/// A table of another tracker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImportInput {
    /// The session.
    pub session: SessionId,
    /// The table as it was sent.
    pub table: Blob,
    /// The tracker that measured it.
    pub tracker: TrackerName,
}

/// A session's result, whose trajectory is scored again with the present program version.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RescoreInput {
    /// The session.
    pub session: SessionId,
    /// The result.
    pub result: ResultId,
    /// The stored trajectory of that result.
    pub trajectory: Blob,
    /// Revision of the session's edits that the job was created for.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub edits: u64,
}

/// Leaves `edits` out for a session without edits, so that the stored input equals that of older jobs and counts as the
/// same.
fn is_zero(edits: &u64) -> bool {
    *edits == 0
}

/// Pictures of a checkerboard.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CalibrateInput {
    /// The box.
    #[serde(rename = "box")]
    pub of: BoxId,
    /// The board.
    pub board: BoardSize,
    /// Side of a square, mm.
    pub square_mm: f64,
    /// Photos, or one video.
    pub files: Vec<NamedBlob>,
    /// Whether the only file is a video.
    pub is_video: bool,
}

/// Marked frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PaletteInput {
    /// The box.
    #[serde(rename = "box")]
    pub of: BoxId,
    /// The marked rectangles and the tools' sizes.
    pub annotations: AnnotationsFile,
    /// The clip that `frame` refers to, or one picture per frame.
    pub files: Vec<NamedBlob>,
    /// Whether the only file is a video. Otherwise file `n` shows frame [`PaletteInput::frames`]`[n]`.
    pub is_video: bool,
    /// The frame number of each picture; empty for a video.
    pub frames: Vec<u64>,
}

/// A picture of a box without tools.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AdviseInput {
    /// The box.
    #[serde(rename = "box")]
    pub of: BoxId,
    /// A photo, or a video whose first frame is used.
    pub picture: NamedBlob,
}

/// A recording of a printed board and a rod, and the versions to test.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SelfTestInput {
    /// The box.
    #[serde(rename = "box")]
    pub of: BoxId,
    /// The person who requested the test.
    pub person: Option<PersonId>,
    /// The calibration to test.
    pub calibration: CalibrationId,
    /// The colour samples to test.
    pub palette: PaletteId,
    /// The board that lies in the box.
    pub board: BoardSize,
    /// Side of a square, mm.
    pub square_mm: f64,
    /// Distance from the tape to the tool's point, mm.
    pub reach_mm: f64,
    /// The recording.
    pub file: NamedBlob,
}

/// A file sent with a request, under its original name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NamedBlob {
    /// Its name, for reports.
    pub name: String,
    /// Its content.
    pub blob: Blob,
}

impl JobInput {
    /// The job's kind.
    pub fn kind(&self) -> JobKind {
        match self {
            JobInput::Track(_) => JobKind::Track,
            JobInput::Import(_) => JobKind::Import,
            JobInput::Rescore(_) => JobKind::Rescore,
            JobInput::Calibrate(_) => JobKind::Calibrate,
            JobInput::Palette(_) => JobKind::Palette,
            JobInput::Advise(_) => JobKind::Advise,
            JobInput::SelfTest(_) => JobKind::SelfTest,
        }
    }

    /// The job's priority in the queue.
    pub fn priority(&self) -> JobPriority {
        match self {
            JobInput::Track(_) | JobInput::Import(_) => JobPriority::Session,
            JobInput::Rescore(_) => JobPriority::Rescore,
            JobInput::Calibrate(_) | JobInput::Palette(_) | JobInput::Advise(_) | JobInput::SelfTest(_) => {
                JobPriority::Box
            }
        }
    }

    /// The session that the job is about, if any.
    pub fn session(&self) -> Option<SessionId> {
        match self {
            JobInput::Track(track) => Some(track.session),
            JobInput::Import(import) => Some(import.session),
            JobInput::Rescore(rescore) => Some(rescore.session),
            JobInput::Calibrate(_) | JobInput::Palette(_) | JobInput::Advise(_) | JobInput::SelfTest(_) => None,
        }
    }

    /// The box that the job is about, if any.
    pub fn box_id(&self) -> Option<BoxId> {
        match self {
            JobInput::Track(_) | JobInput::Import(_) | JobInput::Rescore(_) => None,
            JobInput::Calibrate(calibrate) => Some(calibrate.of),
            JobInput::Palette(palette) => Some(palette.of),
            JobInput::Advise(advice) => Some(advice.of),
            JobInput::SelfTest(test) => Some(test.of),
        }
    }

    /// The files that the job reads.
    pub fn blobs(&self) -> Vec<Blob> {
        match self {
            JobInput::Track(track) => vec![track.video],
            JobInput::Import(import) => vec![import.table],
            JobInput::Rescore(rescore) => vec![rescore.trajectory],
            JobInput::Advise(advice) => vec![advice.picture.blob],
            JobInput::SelfTest(test) => vec![test.file.blob],
            JobInput::Calibrate(CalibrateInput { files, .. }) | JobInput::Palette(PaletteInput { files, .. }) => {
                files.iter().map(|file| file.blob).collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn advice_keeps_the_stored_text_of_earlier_versions_and_so_its_hash() {
        let stored = r#"{"kind":"advice","box":"01a21932-1d8c-72d4-ad4e-751dd27019c2","picture":{"name":"clip.mp4","#
            .to_owned()
            + r#""blob":{"hash":"b3d294d78eb4710de5fd03f444d4bddba66be3ae1fcd0a52b51c7e9898928d27","bytes":607725}}}"#;
        let input: JobInput = serde_json::from_str(&stored).unwrap();
        assert_eq!(input.kind(), JobKind::Advise);
        assert_eq!(serde_json::to_string(&input).unwrap(), stored);
        let hash = "8f46d94c843df7b3e08a881b6ac8b86b36c5c45b4c979658afe734bceffbeeb6";
        assert_eq!(Blob::of(stored.as_bytes()).hash.to_string(), hash);
    }
}
