//! Sessions: recordings and their results.
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | the session and its status |
//! | `list.rs` | lists: filters, orders, counts |
//! | `same_recording.rs` | the same recording under another trainee |
//! | `supervision.rs` | marks that staff saw an attempt |
//! | `queue_positions.rs` | positions in the queue |
//! | `write.rs` | create, retry, erase |
//! | `result.rs` | results and features |
//! | `evidence.rs` | the seconds that determined the features |
//! | `practice.rs` | a trainee's sessions of one task over time, and those of many |
//! | `attention.rs` | recent sessions that need attention |

mod attention;
pub(super) mod evidence;
pub(super) mod list;
pub(super) mod practice;
pub(super) mod queue_positions;
pub(super) mod result;
mod same_recording;
pub(super) mod supervision;
mod write;

pub use attention::AttentionItem;
pub use list::{SessionCount, SessionFilter};
pub use practice::{Practice, PracticeMeasurement, PracticeResult, PracticeSession, TraineeTask};
pub use result::{SessionOrderKey, SessionResult};
pub use same_recording::{SameRecording, SameRecordings};
pub(super) use write::{
    DELETE_SESSION, NewSessionRow, SELECT_SAME_SESSION, SessionArrival, erase_twins, insert, insert_arrived,
    is_trusted_sender, supervising_sender, twins,
};

use super::error::{StoreResult, not_found};
use super::exams::SealedSubject;
use super::visibility::{BindScope, TraineeAudience};
use super::{Scope, Store};
use crate::domain::blob::{Blob, BlobHash};
use crate::domain::job::JobState;
use crate::domain::problem::Problem;
use crate::domain::session::{BoxQuestion, RecordedAtSource, SessionStatus, Supervision};
use crate::domain::text::{Code, FileName, Name, TrackerName};
use crate::domain::trainee::Handedness;
use crate::ids::{BoxId, JobId, SessionId, TaskId, TraineeId};
use crate::time::Day;

pub(in crate::store) const SELECT_CURRENT_RESULT: &str = "SELECT id FROM current_result WHERE session_id = $1";

/// Access to the sessions.
pub struct SessionStore<'s>(pub(super) &'s Store);

/// A recording of a trainee doing a task in a box, with its status.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct SessionRecord {
    /// Its id.
    pub id: SessionId,
    /// The trainee.
    pub trainee_id: TraineeId,
    /// The trainee's name.
    pub trainee_name: Name,
    /// The trainee's code.
    pub trainee_code: Code,
    /// The trainee's preferred hand, if known.
    pub trainee_handedness: Option<Handedness>,
    /// The task.
    pub task_id: TaskId,
    /// What it is called.
    pub task_name: Name,
    /// Its code.
    pub task_code: Code,
    /// The box.
    pub box_id: BoxId,
    /// What it is called.
    pub box_name: Name,
    /// Its code.
    pub box_code: Code,
    /// The recording's file name as it was sent.
    pub filename: FileName,
    /// The recording's media type.
    pub media_type: String,
    /// The recording's file in the vault; `None` while it is arriving.
    pub video: Option<BlobHash>,
    video_bytes: Option<i64>,
    /// When the recording's file was deleted, because the centre keeps videos for a limited time, epoch ms; `None`: it is
    /// there, or still arriving.
    pub video_dropped_at_ms: Option<i64>,
    /// The program that measured the rows, if the session was imported; `video` is then the table as it was sent.
    pub tracker: Option<TrackerName>,
    /// When it was recorded, epoch ms.
    pub recorded_at_ms: i64,
    /// Who says so.
    pub recorded_at_source: RecordedAtSource,
    /// False if that time rests only on a trainee's word or file.
    pub date_known: bool,
    /// Whether a member of staff saw the attempt; `None`: from before this was recorded.
    pub supervision: Option<Supervision>,
    /// When that was recorded, epoch ms.
    pub supervised_at_ms: Option<i64>,
    /// Name of the person who saw it, or who took the mark back; `None` without one, and if the account was deleted.
    pub supervisor: Option<Name>,
    /// When it had arrived completely, epoch ms.
    pub created_at_ms: i64,
    /// The latest tracking or import job, which determines the status. Jobs that only score again do not count, since
    /// the session keeps a result all the while. `None` while its box lacks a camera or colours.
    pub job_id: Option<JobId>,
    /// The state of that job.
    pub job_state: Option<JobState>,
    /// Share of that job done, 0 to 1.
    pub job_progress: Option<f64>,
    /// Why that job failed, or the reason of its last crash.
    #[sqlx(json(nullable))]
    pub job_problem: Option<Problem>,
    /// True if staff set the session aside, so that it counts nowhere.
    pub is_set_aside: bool,
    /// True if it is an attempt of an exam that was voided, so that it counts nowhere.
    pub is_voided: bool,
    /// Whether it shows its box, if that was asked; a session that is asked about counts nowhere.
    pub box_question: Option<BoxQuestion>,
    /// Does its box have a camera?
    pub box_has_camera: bool,
    /// Does its box have colours?
    pub box_has_palette: bool,
    /// Its position in the queue, from 1, while it waits there.
    #[sqlx(skip)]
    pub queue_position: Option<i64>,
}

/// A session that was read once for many callers.
#[derive(Clone, Debug)]
pub struct SharedSession {
    record: SessionRecord,
    audience: TraineeAudience,
}

impl SharedSession {
    /// The session, if this scope of a person or agent sees it.
    pub fn seen_by(&self, scope: &Scope) -> Option<&SessionRecord> {
        self.audience.includes(scope).then_some(&self.record)
    }
}

impl SessionRecord {
    /// Its status, as people see it.
    pub fn status(&self) -> SessionStatus {
        match (self.video, self.job_state, self.video_dropped_at_ms) {
            (None, ..) => SessionStatus::Receiving,
            (Some(_), None, Some(_)) => SessionStatus::Failed,
            (Some(_), state, _) => state.into(),
        }
    }

    /// Says that the recording's file was deleted, and since when, if so.
    pub fn video_deleted(&self) -> Option<String> {
        let day = Day::of(self.video_dropped_at_ms?);
        Some(format!(
            "the video was deleted on {day}, because the centre keeps videos for a limited time: the session keeps its \
             path and its score, and cannot be tracked again"
        ))
    }

    /// The recording's file in the vault; `None` while it is arriving.
    pub fn video_blob(&self) -> Option<Blob> {
        let (hash, bytes) = self.video.zip(self.video_bytes)?;
        Some(Blob { hash, bytes: bytes.unsigned_abs() })
    }

    /// Why it is not scored: the job's problem, or what its box lacks.
    pub fn problem(&self) -> Option<Problem> {
        self.video?; // while it arrives, the box can still be made ready
        if let (None, Some(deleted)) = (self.job_id, self.video_deleted()) {
            return Some(Problem::new("video-deleted", "The video was deleted before it was tracked", deleted));
        }
        let lacking = match (self.job_id, self.box_has_camera, self.box_has_palette) {
            (None, false, false) => "Its camera was not measured yet, and its tool colours were not marked",
            (None, false, true) => "Its camera was not measured yet",
            (None, true, false) => "Its tool colours were not marked yet",
            _ => return self.job_problem.clone(),
        };
        let detail = format!(
            "The recording is safe, but {} is not set up. {lacking}. Instructors and administrators do this under “Set \
             up” on the page of the box; the recording is then scored by itself.",
            self.box_name
        );
        Some(Problem::new("box-not-ready", "The box is not ready", detail))
    }

    /// True if its job crashed or lost its lease too often.
    pub fn is_quarantined(&self) -> bool {
        self.job_state == Some(JobState::Quarantined)
    }
}

const SELECT_SESSION: &str = "
    SELECT session_record.*, (SELECT dropped_at_ms FROM blob WHERE hash = video) AS video_dropped_at_ms, background.*
    FROM session_record JOIN session_background AS background ON background.session_id = session_record.id
    WHERE id = $3
      AND ($1 = 'administrator'
           OR trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($1 <> 'trainee' OR session_record.id NOT IN (SELECT session_id FROM sealed_session))";

impl SessionStore<'_> {
    /// One session.
    pub async fn get(&self, scope: &Scope, id: SessionId) -> StoreResult<SessionRecord> {
        let row: Option<SessionRecord> =
            sqlx::query_as(SELECT_SESSION).bind_scope(scope).bind(id).fetch_optional(self.0.readers()).await?;
        let mut session = row.ok_or(not_found("session"))?;
        self.fill_queue_positions(std::slice::from_mut(&mut session)).await?;
        Ok(session)
    }

    /// One session, for all the people who may see it.
    pub async fn shared(&self, id: SessionId) -> StoreResult<SharedSession> {
        let record = self.get(&Scope::service(), id).await?;
        let audience = self.0.exams().audience(SealedSubject::Session(id), record.trainee_id).await?;
        Ok(SharedSession { record, audience })
    }
}
