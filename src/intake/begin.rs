//! Checks a recording's trainee, task and box before any byte is sent.

use super::{Intake, IntakeError, IntakeResult};
use crate::domain::clock::TimeCorrection;
use crate::domain::scope::Scope;
use crate::domain::text::{FileName, Key};
use crate::ids::{BoxId, TaskId, TraineeId, UploadId};
use crate::store::{NewUpload, StoreError, UploadRecord};
use crate::time::{from_rfc3339, millis, to_rfc3339};

/// How far a sender's clock may be ahead of the service's, ms: a time zone mistaken by a day at most.
const MAX_CLOCK_AHEAD_MS: i64 = 24 * 3_600_000;

/// File name of a recording that was sent without one.
const DEFAULT_FILENAME: &str = "recording";

/// A sender's description of a recording; things are named by id or code.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RecordingDescription {
    /// The trainee; without it, the trainee who sends.
    pub trainee: Option<String>,
    /// The task.
    pub task: Option<String>,
    /// The box.
    pub in_box: Option<String>,
    /// The file name on the sender's machine.
    pub filename: Option<String>,
    /// When it was recorded, RFC 3339.
    pub recorded_at: Option<String>,
    /// The true frame rate, Hz, where the file's stamps are wrong; a decimal number.
    pub true_frame_rate_hz: Option<String>,
    /// The true time from the first frame to the last, s; a decimal number.
    pub true_duration_s: Option<String>,
}

/// A recording's description, checked and resolved to ids.
#[derive(Clone, Debug, PartialEq)]
pub struct ResolvedRecording {
    pub(super) trainee: TraineeId,
    pub(super) task: TaskId,
    pub(super) in_box: BoxId,
    pub(super) filename: FileName,
    pub(super) recorded_at_ms: Option<i64>,
    pub(super) time: Option<TimeCorrection>,
}

impl Intake {
    /// Resolves the names in the description to things that the scope sees.
    pub async fn resolve(&self, scope: &Scope, about: RecordingDescription) -> IntakeResult<ResolvedRecording> {
        let trainee = about.trainee.or_else(|| scope.own_trainee().map(|own| own.to_string()));
        let trainee = trainee.ok_or(IntakeError::Missing("trainee"))?;
        let task = about.task.ok_or(IntakeError::Missing("task"))?;
        let in_box = about.in_box.ok_or(IntakeError::Missing("box"))?;
        let time = parse_time(about.true_frame_rate_hz.as_deref(), about.true_duration_s.as_deref())?;
        if time.is_some() && scope.own_trainee().is_some() {
            // Other times make a trainee's own work look faster.
            return Err(
                StoreError::Forbidden { what: "correcting times", whom: "administrators and instructors" }.into()
            );
        }
        let trainee = self.store.trainees().get(scope, &Key::from(&trainee)).await.map_err(unknown("trainee"))?;
        self.store.consents().require(scope, trainee.id).await.map_err(unknown("trainee"))?;
        let task = self.store.tasks().get(scope, &Key::from(&task)).await.map_err(unknown("task"))?;
        let in_box = self.store.boxes().get(scope, &Key::from(&in_box)).await.map_err(unknown("box"))?;
        Ok(ResolvedRecording {
            trainee: trainee.id,
            task: task.id,
            in_box: in_box.id,
            filename: parse_filename(about.filename.as_deref())?,
            recorded_at_ms: about.recorded_at.as_deref().map(|text| self.parse_recorded_at(text)).transpose()?,
            time,
        })
    }

    /// Begins an upload of `length` bytes. `metadata` is the sender's text, to be returned on request.
    pub async fn begin(
        &self,
        scope: &Scope,
        recording: ResolvedRecording,
        metadata: String,
        length: u64,
    ) -> IntakeResult<UploadRecord> {
        self.check_length(length)?;
        let id = UploadId::at(self.clock.now_ms());
        // Open until its row exists: an upload's file that is neither open nor in the database is deleted.
        let _open_file = self.vault.create_upload(id).await?;
        let ResolvedRecording { trainee, task, in_box, filename, recorded_at_ms, time } = recording;
        let expires_at_ms = self.clock.now_ms() + millis(self.settings.empty());
        let new =
            NewUpload { id, trainee, task, in_box, filename, metadata, recorded_at_ms, time, length, expires_at_ms };
        match self.store.uploads().create(scope, new, self.settings.max_unfinished).await {
            Ok(upload) => Ok(upload),
            Err(error) => {
                self.vault.delete_upload(id).await?;
                Err(error.into())
            }
        }
    }

    /// The stated time of a recording. A time in the future would keep it the newest for ever.
    pub(super) fn parse_recorded_at(&self, text: &str) -> IntakeResult<i64> {
        let invalid = |why: String| IntakeError::Invalid { field: "recorded_at", why };
        let at_ms = from_rfc3339(text)
            .ok_or_else(|| invalid("expected an RFC 3339 time such as 2026-11-21T20:14:00Z".to_owned()))?;
        let now_ms = self.clock.now_ms();
        if at_ms > now_ms + MAX_CLOCK_AHEAD_MS {
            return Err(invalid(format!(
                "is in the future: the service's clock says {}. Set the clock of the camera or computer right, or leave the \
                 time out",
                to_rfc3339(now_ms)
            )));
        }
        if at_ms < 0 {
            return Err(invalid("is before 1970: set the clock of the camera right, or leave the time out".to_owned()));
        }
        Ok(at_ms)
    }

    /// Refuses a length of 0 or above the limit.
    pub fn check_length(&self, length: u64) -> IntakeResult<()> {
        match length {
            0 => Err(IntakeError::Empty),
            _ if length > self.settings.max_bytes => Err(IntakeError::TooLong { most: self.settings.max_bytes }),
            _ => Ok(()),
        }
    }
}

pub(super) fn unknown(what: &'static str) -> impl FnOnce(StoreError) -> IntakeError {
    move |error| match error {
        StoreError::NotFound { .. } => IntakeError::Unknown(what),
        other => other.into(),
    }
}

pub(super) fn parse_filename(given: Option<&str>) -> IntakeResult<FileName> {
    let parsed = given.unwrap_or(DEFAULT_FILENAME).parse::<FileName>();
    parsed.map_err(|invalid| IntakeError::Invalid { field: "filename", why: invalid.why })
}

/// The correction of the times, from decimal numbers.
pub(super) fn parse_time(
    frame_rate_hz: Option<&str>,
    duration_s: Option<&str>,
) -> IntakeResult<Option<TimeCorrection>> {
    let number = |field: &'static str, text: Option<&str>| {
        let why = || format!("is `{}`; expected a decimal number such as 16.4", text.unwrap_or_default());
        text.map(|text| text.trim().parse::<f64>().map_err(|_| IntakeError::Invalid { field, why: why() })).transpose()
    };
    let (rate, duration) = (number("true_frame_rate_hz", frame_rate_hz)?, number("true_duration_s", duration_s)?);
    TimeCorrection::new(rate, duration)
        .map_err(|invalid| IntakeError::Invalid { field: invalid.what, why: invalid.why })
}
