//! A session: one recording of one trainee doing one task in one box, and its results.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::blob::{Blob, BlobHash};
use super::clock::{ClockBasis, RecordingClock, TimeCorrection};
use super::evidence::EvidenceRow;
use super::job::JobState;
use super::named;
use super::text::{FileName, TrackerName};
use crate::ids::{BoxId, CalibrationId, PaletteId, ResultId, TaskId, TraineeId};
use crate::motion::features::errors::NoErrorBar;
use crate::motion::{PIPELINE_VERSION, features};
use crate::vision::surroundings::Surroundings;

named! {
    /// A session's status, for people.
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

named! {
    /// The question whether a session's recording shows the box that it is filed under. Without one, nothing speaks
    /// against the box.
    BoxQuestion: "box question" {
        /// A person has to say. Until then the session counts nowhere.
        Asked = "asked",
        /// A person said that it is this box.
        ThisBox = "this_box",
        /// A person said that it is another box: the session counts nowhere.
        OtherBox = "other_box",
    }
}

named! {
    /// Who says when a session was recorded.
    RecordedAtSource: "recorded_at_source" {
        /// Its sender, from the clock of a camera or computer, or from a file's date.
        Claimed = "claimed",
        /// The service: no usable time was stated, so it is when the recording arrived, or began to.
        Arrival = "arrival",
    }
}

named! {
    /// Whether a member of staff saw the attempt that a session shows.
    Supervision: "supervision" {
        /// A member of staff who had signed in recorded or sent it.
        SentByStaff = "sent_by_staff",
        /// A member of staff said so afterwards.
        Marked = "marked",
        /// No: a trainee or a program sent it, or a member of staff took the mark back.
        None = "none",
    }
}

named! {
    /// What a session came to, in the words of lists: its state until it is done, then whether it met the standard of its
    /// task.
    SessionOutcome: "outcome" {
        /// Its recording is still arriving.
        Receiving = "receiving",
        /// Waits for a worker, or for its box's calibration or colours.
        Queued = "queued",
        /// Being tracked.
        Tracking = "tracking",
        /// Could not be tracked.
        Failed = "failed",
        /// Tracking crashed too often: a person has to look.
        Quarantined = "quarantined",
        /// A person has to say whether it shows its box.
        BoxAsked = "box_asked",
        /// It shows another box.
        OtherBox = "other_box",
        /// The quality gate refused it.
        Refused = "refused",
        /// It met the standard.
        Passed = "passed",
        /// It missed the standard.
        Missed = "missed",
        /// It neither met nor missed the standard: too little is known.
        Undecided = "undecided",
        /// Scored; its task has no standard, or the session was set aside.
        Done = "done",
        /// Scored, with limits to its trustworthiness; `passed`, `missed`, `undecided` or `done` as well.
        UsableWithCare = "usable_with_care",
    }
}

named! {
    /// The order of a list of sessions.
    SessionOrder: "order" {
        /// The last to arrive first.
        Arrival = "arrival",
        /// The last to be recorded first.
        Recorded = "recorded",
    }
}

impl BoxQuestion {
    /// Does a session with this answer count?
    pub fn counts(self) -> bool {
        self == BoxQuestion::ThisBox
    }
}

impl From<Option<JobState>> for SessionStatus {
    /// A session has the state of its latest job that tracks or imports it; without a job, it waits for its box to be
    /// ready.
    fn from(latest_job: Option<JobState>) -> Self {
        match latest_job {
            None | Some(JobState::Queued) => SessionStatus::Queued,
            Some(JobState::Running) => SessionStatus::Tracking,
            Some(JobState::Done) => SessionStatus::Done,
            Some(JobState::Failed | JobState::Quarantined) => SessionStatus::Failed,
        }
    }
}

/// A session to be stored. Its recording is in the vault already.
#[derive(Clone, Debug, PartialEq)]
pub struct NewSession {
    /// The trainee.
    pub trainee: TraineeId,
    /// The task.
    pub task: TaskId,
    /// The box.
    pub in_box: BoxId,
    /// Name of the file as it was sent.
    pub filename: FileName,
    /// Time of the recording, epoch ms; `None` if unknown: the time of arrival is used.
    pub recorded_at_ms: Option<i64>,
    /// The recording.
    pub video: Blob,
    /// The recording's media type, such as `video/mp4`.
    pub media_type: String,
    /// The true time of the recording, if the sender gave it.
    pub time: Option<TimeCorrection>,
}

/// A path that another tracker measured.
#[derive(Clone, Debug)]
pub struct ForeignPath {
    /// The tracker's name.
    pub tracker: TrackerName,
    /// The hash of the path. Tables with other bytes can have the same path.
    pub hash: BlobHash,
}

/// The pipeline version of a result from an imported trajectory. It includes the tracker's name, so that numbers of
/// different trackers are not mixed by accident, just like numbers of different versions of this program.
pub fn imported_pipeline_version(tracker: &TrackerName) -> String {
    format!("{PIPELINE_VERSION} on rows by {tracker}")
}

/// The versions that a result depends on, besides the recording.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Versions {
    /// [`crate::motion::PIPELINE_VERSION`] of the program that made it; with the tracker's name for an imported
    /// trajectory ([`imported_pipeline_version`]).
    pub pipeline: String,
    /// The version that tracked the recording, if a later version scored its trajectory again; `null`: same as
    /// `pipeline`.
    pub tracked_with: Option<String>,
    /// The box's calibration; `null` where Trocar did not track the session.
    pub calibration: Option<CalibrationId>,
    /// The box's colour samples; `null` where Trocar did not track the session.
    pub palette: Option<PaletteId>,
    /// The model that scored it, if any.
    pub model: Option<String>,
}

/// Facts about a recording, from decoding it or from the rows of another tracker.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct VideoFacts {
    /// Width as displayed, pixels; `None` without a picture.
    pub width: Option<u32>,
    /// Height as displayed, pixels.
    pub height: Option<u32>,
    /// Decoded frames; for imported rows, the frames with a row of any tool.
    pub frames: u64,
    /// Time from the first frame to the last, s.
    pub duration_s: f64,
    /// How the times were computed; `None` for imported rows, and for results from versions before this fact.
    pub clock: Option<ResultClock>,
}

/// How the times of a result were computed from the recording's stamps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ResultClock {
    /// Where the times come from, and the factor of all of them.
    #[serde(flatten)]
    pub applied: RecordingClock,
    /// Mean frame rate by the file's stamps, Hz.
    pub stamped_frame_rate_hz: Option<f64>,
    /// Duration by the file's stamps, from the first frame to the last, s.
    pub stamped_duration_s: f64,
    /// True if frames are missing or the frame rate changes: only a true duration can then correct the times.
    #[serde(default)]
    pub is_uneven: bool,
    /// Time on the file's own clock at which time 0 of the session lies, s: more than 0 if the picture begins later than
    /// the sound or than the file. Players count from the file's zero. 0 for results of earlier versions.
    #[serde(default)]
    pub starts_at_s: f64,
}

impl ResultClock {
    /// See [`RecordingClock::may_be_slow_motion`].
    pub fn may_be_slow_motion(&self) -> bool {
        self.applied.may_be_slow_motion(self.stamped_frame_rate_hz)
    }

    /// Are the times those of the file's stamps?
    pub fn is_by_stamps(&self) -> bool {
        self.applied.basis == ClockBasis::Stamps
    }
}

/// One feature of one session.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FeatureRow {
    /// Stable name, such as `path_length`.
    pub name: String,
    /// Title for people.
    pub title: String,
    /// Unit, such as `mm`; `1` for shares, counts and ratios.
    pub unit: String,
    /// The tool's marker; `None` for a feature of the whole session.
    pub tool: Option<String>,
    /// The space that it was measured in: `3d` or `image`.
    pub space: FeatureSpace,
    /// The value, or why there is none: too few observations give a reason, not zero.
    pub value: Result<f64, String>,
    /// The value's error bar, or why it is unknown; `None` without a value, and for results from versions before error
    /// bars existed.
    pub error: Option<Result<FeatureError, String>>,
}

impl FeatureRow {
    /// The feature's family; `None` for a feature that is no longer measured.
    pub fn family(&self) -> Option<&'static str> {
        features::find(&self.name).ok().map(|feature| feature.family.name())
    }

    /// Whether depth decides its value; `None` for a feature that is no longer measured.
    pub fn needs_depth(&self) -> Option<bool> {
        features::find(&self.name).ok().map(|feature| feature.needs_depth(self.space.into()))
    }

    /// Which values are better: `lower`, `higher` or `neither`; `None` for a feature that is no longer measured.
    pub fn better(&self) -> Option<&'static str> {
        features::find(&self.name).ok().map(|feature| feature.direction.name())
    }

    /// Whether the value says something, or why its error bar leaves nothing of it; `None` without a value or error
    /// bar, and for a feature that is no longer measured.
    pub fn informative(&self) -> Option<Result<(), &'static str>> {
        let feature = features::find(&self.name).ok()?;
        let error = self.error.as_ref()?.as_ref().ok()?;
        let value = *self.value.as_ref().ok()?;
        Some(feature.too_uncertain(value, [error.low, error.high]).map_or(Ok(()), |why| Err(why.name())))
    }

    /// The value, if it is known on both sides. A lower bound must not be compared with other values.
    pub fn two_sided_value(&self) -> Option<f64> {
        self.value.as_ref().ok().copied().filter(|_| !self.is_lower_bound())
    }

    /// Why there is no error bar, by its code; `None` if there is one, or for the words of another program.
    pub fn no_error_reason(&self) -> Option<&'static str> {
        let sentence = self.error.as_ref()?.as_ref().err()?;
        NoErrorBar::of(sentence).map(NoErrorBar::code)
    }

    /// True if the value is a lower bound: the recording shows only a part of the attempt.
    pub fn is_lower_bound(&self) -> bool {
        matches!(&self.error, Some(Err(reason)) if *reason == NoErrorBar::AtLeast.to_string())
    }
}

/// The error bar of a value, in its unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct FeatureError {
    /// Standard deviation.
    pub sigma: f64,
    /// Lower bound: in 95 of 100 sessions, the true path's value lies between `low` and `high`.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
    /// The value before bias correction: measurement errors lengthen every path.
    pub as_measured: f64,
}

/// A feature's final value in live tracking, when the recording ended: from the causal filter, over everything that was
/// seen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LiveFeature {
    /// Stable name, such as `path_length`.
    pub name: String,
    /// Title for people.
    pub title: String,
    /// Unit of `value`; `1` for shares, counts and ratios.
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
        /// In millimetres, in the camera's x and y only: the plane parallel to the image.
        Image = "image",
    }
}

/// The result of scoring a session's stored trajectory again. Everything else is taken over from the original result.
#[derive(Clone, Debug, PartialEq)]
pub struct NewScore {
    /// The original result, whose trajectory was scored.
    pub from: ResultId,
    /// Version of the program that scored it.
    pub pipeline: String,
    /// Version of the program that tracked it, if different.
    pub tracked_with: Option<String>,
    /// Revision of the session's edits that was used.
    pub edits: u64,
    /// Features, in display order.
    pub features: Vec<FeatureRow>,
    /// The stretches that made them.
    pub evidence: Vec<EvidenceRow>,
    /// Counts and reasons per tool; an object.
    pub quality: Value,
}

/// The result of tracking a session, to be stored in one transaction. Its files are in the vault already.
#[derive(Clone, Debug, PartialEq)]
pub struct NewResult {
    /// Versions that it depends on.
    pub versions: Versions,
    /// Revision of the session's edits that was used for scoring; the trajectory itself is unedited.
    pub edits: u64,
    /// Facts about the recording.
    pub video: VideoFacts,
    /// Names of the tools, in the trajectory's order.
    pub tools: Vec<String>,
    /// Features, in display order.
    pub features: Vec<FeatureRow>,
    /// The stretches that made them.
    pub evidence: Vec<EvidenceRow>,
    /// Counts and reasons per tool; an object.
    pub quality: Value,
    /// Always empty: reserved for a rank in a reference cohort. Standards and the verdict of skill judge a session.
    pub score: Option<Value>,
    /// Raw, filtered and smoothed paths, in the analysis' own format.
    pub trajectory: Blob,
    /// Diagnostics of the tracker for every frame; `None` where Trocar did not track the session.
    pub diagnostics: Option<Blob>,
    /// A JPEG of one frame.
    pub preview: Option<Blob>,
    /// What stands still in the recording; `None` where Trocar did not track the session, or the picture is too small.
    pub surroundings: Option<Surroundings>,
}
