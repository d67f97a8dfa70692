//! Receives recordings without a name. They are stored and wait; they are not tracked until a person says whose they
//! are.

use bytes::Bytes;
use futures_util::Stream;

use super::append::BoxError;
use super::begin::{parse_filename, parse_time, unknown};
use super::finish::media_type_of;
use super::{Intake, IntakeError, IntakeResult};
use crate::domain::clock::TimeCorrection;
use crate::domain::role::Role;
use crate::domain::scope::{Actor, Scope};
use crate::domain::text::{FileName, Key};
use crate::domain::waiting_recording::{RecordingAssignment, RecordingSource};
use crate::ids::{BoxId, TaskId, WaitingRecordingId};
use crate::store::{ArrivedRecording, AssignedRecording, AssignmentTarget, NewWaitingRecording};

/// A sender's description of a recording without a name; things are named by id or code.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct UnnamedDescription {
    /// The task, if known.
    pub task: Option<String>,
    /// The box, if known; an agent's is its own.
    pub in_box: Option<String>,
    /// The file name on the sender's machine.
    pub filename: Option<String>,
    /// When it was recorded, RFC 3339.
    pub recorded_at: Option<String>,
    /// The true frame rate, Hz; a decimal number.
    pub true_frame_rate_hz: Option<String>,
    /// The true time from the first frame to the last, s; a decimal number.
    pub true_duration_s: Option<String>,
}

/// A description of a recording without a name, checked and resolved to ids.
#[derive(Clone, Debug, PartialEq)]
pub struct UnnamedRecording {
    task: Option<TaskId>,
    in_box: Option<BoxId>,
    filename: FileName,
    recorded_at_ms: Option<i64>,
    time: Option<TimeCorrection>,
}

impl Intake {
    /// Resolves the names in a description of a recording without a name.
    pub async fn resolve_unnamed(&self, scope: &Scope, about: UnnamedDescription) -> IntakeResult<UnnamedRecording> {
        let own_box = match scope.actor() {
            Actor::Agent(of) => Some(of.to_string()),
            Actor::Person(_) | Actor::Service => None,
        };
        let in_box = match about.in_box.or(own_box) {
            Some(key) => Some(self.store.boxes().get(scope, &Key::from(&key)).await.map_err(unknown("box"))?.id),
            None => None,
        };
        let task = match about.task {
            Some(key) => {
                let scope = scope.upload_scope(); // agents see no tasks, but their recordings are of one
                Some(self.store.tasks().get(&scope, &Key::from(&key)).await.map_err(unknown("task"))?.id)
            }
            None => None,
        };
        Ok(UnnamedRecording {
            task,
            in_box,
            filename: parse_filename(about.filename.as_deref())?,
            recorded_at_ms: about.recorded_at.as_deref().map(|text| self.parse_recorded_at(text)).transpose()?,
            time: parse_time(about.true_frame_rate_hz.as_deref(), about.true_duration_s.as_deref())?,
        })
    }

    /// Receives a whole recording without a name. Call it on a task of its own, since some senders disconnect right
    /// after their last byte.
    pub async fn take_unnamed<B>(
        &self,
        scope: &Scope,
        recording: UnnamedRecording,
        bytes: B,
    ) -> IntakeResult<ArrivedRecording>
    where
        B: Stream<Item = Result<Bytes, BoxError>> + Unpin,
    {
        let kept = self.store_whole(bytes, self.settings.max_bytes).await?;
        let media_type = media_type_of(&self.vault, kept.blob().hash).await?.to_owned();
        let source = if scope.role() == Role::Agent { RecordingSource::Agent } else { RecordingSource::Upload };
        let UnnamedRecording { task, in_box, filename, recorded_at_ms, time } = recording;
        let new = NewWaitingRecording {
            video: kept.blob(),
            media_type,
            filename,
            folder: None,
            source,
            in_box,
            task,
            trainee: None,
            remark: None,
            recorded_at_ms,
            time,
            preview: None,
        };
        let arrived = self.store.waiting_recordings().add(scope, new, self.settings.max_waiting).await?;
        drop(kept); // from here on a row protects the file
        Ok(arrived)
    }

    /// Makes a recording that waits for a name a session.
    pub async fn assign(&self, scope: &Scope, assignment: RecordingAssignment) -> IntakeResult<AssignedRecording> {
        let RecordingAssignment { id, trainee, task, in_box, recorded_at, supervised } = assignment;
        let found = self.store.waiting_recordings().get(scope, id).await?;
        let trainee = self.store.trainees().get(scope, &trainee).await.map_err(unknown("trainee"))?.id;
        let task = match task {
            Some(key) => self.store.tasks().get(scope, &key).await.map_err(unknown("task"))?.id,
            None => found.task_id.ok_or(IntakeError::Missing("task"))?,
        };
        let in_box = match in_box {
            Some(key) => self.store.boxes().get(scope, &key).await.map_err(unknown("box"))?.id,
            None => found.box_id.ok_or(IntakeError::Missing("box"))?,
        };
        let recorded_at_ms = match recorded_at {
            Some(text) => Some(self.parse_recorded_at(&text)?),
            None => found.recorded_at_ms,
        };
        self.assign_to(scope, id, AssignmentTarget { trainee, task, in_box, recorded_at_ms, supervised }).await
    }

    async fn assign_to(
        &self,
        scope: &Scope,
        id: WaitingRecordingId,
        to: AssignmentTarget,
    ) -> IntakeResult<AssignedRecording> {
        let assigned = self.store.waiting_recordings().assign(scope, id, to).await;
        let assigned = assigned.map_err(super::whole::already_exists)?;
        self.announce_session(&self.store.sessions().get(scope, assigned.session).await?);
        Ok(assigned)
    }
}
