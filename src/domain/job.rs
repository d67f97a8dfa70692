//! Jobs: their inputs, kinds and states.
//!
//! ```text
//!            claim                finish
//! queued ───────────▶ running ───────────▶ done
//!   ▲ ▲                │ │ │    fail
//!   │ └─── release ────┘ │ └─────────────▶ failed ──────────┐
//!   ├─── crash, not last ┤                                  │
//!   │                    └─ crash, last ─▶ quarantined ─────┤
//!   └───────────────────── retry by a person ───────────────┘
//! ```
//! `failed`: the job cannot be done, and the problem says why (not a video, no marker colour). `quarantined`: the
//! process that ran the job crashed or stopped responding in its last attempt, usually the third, or the job's lease was
//! lost for the tenth time. An earlier lost lease queues the job again and counts no attempt: the power failed, or the
//! service was killed.

use serde::{Deserialize, Deserializer, Serialize};

use super::blob::Blob;
use super::calibration::BoardSize;
use super::clock::TimeCorrection;
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
    /// What a job works on.
    JobSubject: "subject of a job" {
        /// A session.
        Session = "session",
        /// A box.
        Box = "box",
    }
}

impl JobKind {
    /// What jobs of this kind work on. The store refuses a job of the kind on another subject.
    pub fn subject(self) -> JobSubject {
        match self {
            Self::Track | Self::Import | Self::Rescore => JobSubject::Session,
            Self::Calibrate | Self::Palette | Self::Advise | Self::SelfTest => JobSubject::Box,
        }
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

/// A job's input, as stored. A kind of two words needs a `rename`, because its name is in rows and natural keys.
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
    /// The correction of its times, if a person made one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time: Option<TimeCorrection>,
    /// Number of time corrections that were made and undone by then: an undone one must be tracked again, although
    /// everything else is as before.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub time_revision: u64,
}

/// A table of another tracker.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImportInput {
    /// The session.
    pub session: SessionId,
    /// The table as it was sent.
    pub table: Blob,
    /// The tracker that measured it.
    #[serde(deserialize_with = "read_stored")]
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

/// Reads the tracker's name of a job that was queued under earlier rules.
fn read_stored<'de, D: Deserializer<'de>>(from: D) -> Result<TrackerName, D::Error> {
    String::deserialize(from).map(TrackerName::from_stored)
}

/// Leaves a revision out for a session without edits, so that the stored input equals that of older jobs and counts as the
/// same.
fn is_zero(revision: &u64) -> bool {
    *revision == 0
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
    /// A photo of the box without tools, for tools without tape. It is kept after the job has ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub empty_box: Option<NamedBlob>,
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

/// What else a job's result depends on besides its input: a part of its natural key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum KeyVersion {
    /// The version of the pipeline; the input names everything else.
    Pipeline,
    /// The box's latest calibration: the same photos sent after another calibration are a new job.
    Calibration(BoxId),
    /// The box's latest colour samples.
    Palette(BoxId),
}

/// What the queue needs to know about a job.
#[derive(Clone, Debug, PartialEq)]
pub struct JobFacts {
    /// The job's kind.
    pub kind: JobKind,
    /// Its usual priority.
    pub priority: JobPriority,
    /// The session that it works on, if any: see [`JobKind::subject`].
    pub session: Option<SessionId>,
    /// The box that it works on, if any; every job works on a session or on a box.
    pub of_box: Option<BoxId>,
    /// The files that it reads.
    pub blobs: Vec<Blob>,
    /// The rest of its natural key.
    pub key_version: KeyVersion,
}

impl JobFacts {
    fn on_session(kind: JobKind, session: SessionId, blob: Blob) -> Self {
        let (priority, key_version) = (JobPriority::Session, KeyVersion::Pipeline);
        Self { kind, priority, session: Some(session), of_box: None, blobs: vec![blob], key_version }
    }

    fn on_box<'f>(
        kind: JobKind,
        of: BoxId,
        files: impl IntoIterator<Item = &'f NamedBlob>,
        key_version: KeyVersion,
    ) -> Self {
        let blobs = files.into_iter().map(|file| file.blob).collect();
        Self { kind, priority: JobPriority::Box, session: None, of_box: Some(of), blobs, key_version }
    }
}

impl JobInput {
    /// The box that gets another camera or other colours from this job.
    pub fn changed_box(&self) -> Option<BoxId> {
        match self {
            JobInput::Calibrate(CalibrateInput { of, .. }) | JobInput::Palette(PaletteInput { of, .. }) => Some(*of),
            JobInput::Track(_)
            | JobInput::Import(_)
            | JobInput::Rescore(_)
            | JobInput::Advise(_)
            | JobInput::SelfTest(_) => None,
        }
    }

    /// What the queue needs to know about a job with this input.
    pub fn facts(&self) -> JobFacts {
        match self {
            JobInput::Track(track) => JobFacts::on_session(JobKind::Track, track.session, track.video),
            JobInput::Import(import) => JobFacts::on_session(JobKind::Import, import.session, import.table),
            JobInput::Rescore(RescoreInput { session, trajectory, .. }) => JobFacts {
                priority: JobPriority::Rescore,
                ..JobFacts::on_session(JobKind::Rescore, *session, *trajectory)
            },
            JobInput::Calibrate(CalibrateInput { of, files, .. }) => {
                JobFacts::on_box(JobKind::Calibrate, *of, files, KeyVersion::Calibration(*of))
            }
            JobInput::Palette(PaletteInput { of, files, empty_box, .. }) => {
                JobFacts::on_box(JobKind::Palette, *of, files.iter().chain(empty_box), KeyVersion::Palette(*of))
            }
            JobInput::Advise(AdviseInput { of, picture }) => {
                JobFacts::on_box(JobKind::Advise, *of, [picture], KeyVersion::Palette(*of))
            }
            JobInput::SelfTest(SelfTestInput { of, file, .. }) => {
                JobFacts::on_box(JobKind::SelfTest, *of, [file], KeyVersion::Pipeline)
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
        assert_eq!(input.facts().kind, JobKind::Advise);
        assert_eq!(serde_json::to_string(&input).unwrap(), stored);
        let hash = "8f46d94c843df7b3e08a881b6ac8b86b36c5c45b4c979658afe734bceffbeeb6";
        assert_eq!(Blob::of(stored.as_bytes()).hash.to_string(), hash);
    }
}
