//! One recording of one trainee doing one task in one box, and what the program made of it.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::blob::Blob;
use super::evidence::EvidenceRow;
use super::job::JobState;
use super::named;
use super::text::{FileName, TrackerName};
use crate::ids::{BoxId, CalibrationId, PaletteId, ResultId, TaskId, TraineeId};
use crate::pipeline::{PIPELINE_VERSION, features};

named! {
    /// How a session stands, for people.
    SessionStatus: "status" {
        /// Its recording is still arriving.
        Receiving = "receiving",
        /// Waits for a worker, or for its box's calibration or colours.
        Queued = "queued",
        /// Being tracked.
        Tracking = "tracking",
        /// Tracked and scored.
        Done = "done",
        /// Could not be tracked; the problem says why.
        Failed = "failed",
    }
}

impl From<Option<JobState>> for SessionStatus {
    /// A session stands as the latest job on it; without one it waits for its box to be ready.
    fn from(latest_job: Option<JobState>) -> Self {
        match latest_job {
            None | Some(JobState::Queued) => SessionStatus::Queued,
            Some(JobState::Running) => SessionStatus::Tracking,
            Some(JobState::Done) => SessionStatus::Done,
            Some(JobState::Failed | JobState::Quarantined) => SessionStatus::Failed,
        }
    }
}

/// A session to be stored. Its recording lies in the vault already.
#[derive(Clone, Debug, PartialEq)]
pub struct NewSession {
    /// Who trained.
    pub trainee: TraineeId,
    /// What they did.
    pub task: TaskId,
    /// Where.
    pub in_box: BoxId,
    /// Name of the file as it was sent.
    pub filename: FileName,
    /// When it was recorded, epoch ms; unknown: when it came.
    pub recorded_at_ms: Option<i64>,
    /// The recording.
    pub video: Blob,
    /// The recording's media type, such as `video/mp4`.
    pub media_type: String,
}

/// What names a result's version where the path came from another tracker: numbers of different trackers are no more mixed
/// unknowingly than those of different versions of this one.
pub fn version_of_rows(tracker: &TrackerName) -> String {
    format!("{PIPELINE_VERSION} on rows by {tracker}")
}

/// Everything that a result depends on besides the recording.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Versions {
    /// [`crate::pipeline::PIPELINE_VERSION`] of the program that made it; with the tracker's name, where it is of another tracker's
    /// rows ([`version_of_rows`]).
    pub pipeline: String,
    /// The same of the program that tracked, where a later one has scored its path again; `null`: `pipeline`.
    pub tracked_with: Option<String>,
    /// The box's camera; `null` where it was not measured here.
    pub calibration: Option<CalibrationId>,
    /// The box's colours; `null` where it was not measured here.
    pub palette: Option<PaletteId>,
    /// The model that scored it, if one did.
    pub model: Option<String>,
}

/// What decoding a recording showed, or the rows of another tracker.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct VideoFacts {
    /// Width as displayed, pixels; `None` without a picture.
    pub width: Option<u32>,
    /// Height as displayed, pixels.
    pub height: Option<u32>,
    /// Decoded frames; of rows, those that any tool has a row on.
    pub frames: u64,
    /// Presentation time from the first frame to the last, s.
    pub duration_s: f64,
}

/// One feature of one session.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FeatureRow {
    /// Stable name, such as `path_length`.
    pub name: String,
    /// Title for people.
    pub title: String,
    /// Unit, such as `mm`; empty for a pure number.
    pub unit: String,
    /// The tool's marker; `None` for a feature of the whole session.
    pub tool: Option<String>,
    /// In which space it was measured: `3d` or `image`.
    pub space: FeatureSpace,
    /// The value, or why there is none: too few observations is an answer, not a zero.
    pub value: Result<f64, String>,
    /// How far the value may be off, or why that is not known; `None` without a value, and of results from before this was
    /// worked out.
    pub error: Option<Result<FeatureError, String>>,
}

impl FeatureRow {
    /// Under which head it stands; `None` of a feature that is measured no more.
    pub fn family(&self) -> Option<&'static str> {
        features::find(&self.name).map(|feature| feature.family.name())
    }
}

/// How far a value may be off, in its unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct FeatureError {
    /// Standard deviation.
    pub sigma: f64,
    /// The value of the true path lies between `low`
    pub low: f64,
    /// and `high` in 95 of 100 sessions.
    pub high: f64,
    /// The value before the shift that errors cause was taken off: errors lengthen every path.
    pub as_measured: f64,
}

/// A feature as it stood when a recording that was tracked while it arrived had come to its end: by the causal filter, over all
/// that was seen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LiveFeature {
    /// Stable name, such as `path_length`.
    pub name: String,
    /// Title for people.
    pub title: String,
    /// Unit of `value`; `1` for a pure number.
    pub unit: String,
    /// The tool's marker.
    pub tool: String,
    /// The value, in three dimensions; `null` where too little was seen.
    pub value: Option<f64>,
}

named! {
    /// Where a feature was measured.
    FeatureSpace: "space" {
        /// In millimetres, in the camera frame.
        Space3d = "3d",
        /// In pixels of the recorded frame.
        Image = "image",
    }
}

/// What scoring a session's stored path again gave. All else is that of the result that it was made from.
#[derive(Clone, Debug, PartialEq)]
pub struct NewScore {
    /// Whose path was scored.
    pub from: ResultId,
    /// Version of the program that scored it.
    pub pipeline: String,
    /// Version of the program that tracked it, if that is another one.
    pub tracked_with: Option<String>,
    /// With which state of the session's edits.
    pub edits: u64,
    /// Features, in the order in which people read them.
    pub features: Vec<FeatureRow>,
    /// The seconds that made them.
    pub evidence: Vec<EvidenceRow>,
    /// Counts and reasons per tool; an object.
    pub quality: Value,
}

/// What tracking a session gave, to be stored in one transaction. Its files lie in the vault already.
#[derive(Clone, Debug, PartialEq)]
pub struct NewResult {
    /// What it was made with.
    pub versions: Versions,
    /// With which state of the session's edits; its path is as it was tracked.
    pub edits: u64,
    /// What decoding showed.
    pub video: VideoFacts,
    /// Names of the tools, in the trajectory's order.
    pub tools: Vec<String>,
    /// Features, in the order in which people read them.
    pub features: Vec<FeatureRow>,
    /// The seconds that made them.
    pub evidence: Vec<EvidenceRow>,
    /// Counts and reasons per tool; an object.
    pub quality: Value,
    /// Place in a reference cohort, if a model scored it; an object.
    pub score: Option<Value>,
    /// Raw, filtered and smoothed paths, in the analysis' own form.
    pub trajectory: Blob,
    /// What the tracker saw on every frame; `None` where it was not tracked here.
    pub diagnostics: Option<Blob>,
    /// A JPEG of one frame.
    pub preview: Option<Blob>,
}
