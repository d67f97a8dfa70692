//! Sessions: recordings and their results.
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | the session, its status, lists |
//! | `queue_positions.rs` | positions in the queue |
//! | `write.rs` | create, retry, erase |
//! | `result.rs` | results and features |
//! | `evidence.rs` | the seconds that determined the features |
//! | `practice.rs` | a trainee's sessions of one task over time, and those of many |
//! | `attention.rs` | recent sessions that need attention |

mod attention;
pub(super) mod evidence;
pub(super) mod practice;
pub(super) mod queue_positions;
pub(super) mod result;
mod write;

pub use attention::AttentionItem;
pub use practice::{Practice, PracticeMeasurement, PracticeResult, PracticeSession, TraineeTask};
pub use result::{SessionOrderKey, SessionResult};
pub(super) use write::{DELETE_SESSION, NewSessionRow, SELECT_SAME_PATH, SELECT_SAME_SESSION, insert};

use super::error::{StoreResult, not_found};
use super::page::{Page, PageRequest};
use super::visibility::{BindScope, TraineeAudience};
use super::{Scope, Store};
use crate::domain::blob::{Blob, BlobHash};
use crate::domain::job::JobState;
use crate::domain::problem::Problem;
use crate::domain::session::{BoxQuestion, RecordedAtSource, SessionStatus};
use crate::domain::text::{Code, FileName, Key, Name, TrackerName};
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

/// A filter for lists of sessions.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SessionFilter {
    /// Only of this trainee, by id or code.
    pub trainee: Option<Key>,
    /// Only of this task, by id or code.
    pub task: Option<Key>,
    /// Only in this box, by id or code.
    pub in_box: Option<Key>,
    /// Only sessions with this status.
    pub status: Option<SessionStatus>,
    /// Only sessions that count: neither set aside, nor of a box that is asked about.
    pub only_counting: bool,
    /// Only sessions with this recording.
    pub recording: Option<BlobHash>,
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
            (None, false, false) => "calibrated camera and no marked colours",
            (None, false, true) => "calibrated camera",
            (None, true, false) => "marked colours",
            _ => return self.job_problem.clone(),
        };
        let detail = format!(
            "the recording is safe, but box `{}` has no {lacking} yet: send its camera.json or checkerboard photos, \
             and its annotations; tracking then starts by itself",
            self.box_code
        );
        Some(Problem::new("box-not-ready", "The box is not ready", detail))
    }

    /// True if its job crashed or lost its lease too often.
    pub fn is_quarantined(&self) -> bool {
        self.job_state == Some(JobState::Quarantined)
    }
}

const SELECT_SESSIONS: &str = "
    SELECT session_record.*, (SELECT dropped_at_ms FROM blob WHERE hash = video) AS video_dropped_at_ms,
           (SELECT stored.recorded_at_source FROM session AS stored
            WHERE stored.id = session_record.id) AS recorded_at_source
    FROM session_record
    WHERE ($1 = 'administrator'
           OR trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR trainee_id NOT IN (SELECT trainee_id FROM pending_erasure))
      AND ($3 IS NULL OR $3 IN (trainee_id, trainee_code))
      AND ($4 IS NULL OR $4 IN (task_id, task_code))
      AND ($5 IS NULL OR $5 IN (box_id, box_code))
      AND ($6 IS NULL OR $6 = CASE WHEN video IS NULL THEN 'receiving'
                              WHEN job_state = 'running' THEN 'tracking' WHEN job_state = 'done' THEN 'done'
                              WHEN job_state IN ('failed', 'quarantined') THEN 'failed'
                              WHEN job_state IS NULL AND EXISTS (SELECT 1 FROM blob WHERE hash = video
                                                                 AND dropped_at_ms IS NOT NULL) THEN 'failed'
                              ELSE 'queued' END)
      AND ($7 IS NULL OR id < $7)
      AND (NOT $8
           OR NOT EXISTS (SELECT 1 FROM uncounted_session WHERE uncounted_session.session_id = session_record.id))
      AND ($10 IS NULL OR id IN (SELECT same.id FROM session AS same WHERE same.video = $10))
    ORDER BY id DESC LIMIT $9";

const SELECT_SESSION: &str = "
    SELECT session_record.*, (SELECT dropped_at_ms FROM blob WHERE hash = video) AS video_dropped_at_ms,
           (SELECT stored.recorded_at_source FROM session AS stored
            WHERE stored.id = session_record.id) AS recorded_at_source
    FROM session_record
    WHERE id = $3
      AND ($1 = 'administrator'
           OR trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR trainee_id NOT IN (SELECT trainee_id FROM pending_erasure))";

impl SessionStore<'_> {
    /// The sessions that the scope sees, newest first.
    pub async fn list(
        &self,
        scope: &Scope,
        which: &SessionFilter,
        page: &PageRequest,
    ) -> StoreResult<Page<SessionRecord>> {
        let rows = sqlx::query_as(SELECT_SESSIONS);
        let rows = rows.bind_scope(scope).bind(&which.trainee).bind(&which.task).bind(&which.in_box);
        let rows = rows
            .bind(which.status.map(SessionStatus::name))
            .bind(page.after())
            .bind(which.only_counting)
            .bind(page.row_limit())
            .bind(which.recording);
        let mut rows: Vec<SessionRecord> = rows.fetch_all(self.0.readers()).await?;
        self.fill_queue_positions(&mut rows).await?;
        Ok(Page::from_rows(rows, page, |session: &SessionRecord| session.id.to_string()))
    }

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
        let audience = self.0.trainees().audience(record.trainee_id).await?;
        Ok(SharedSession { record, audience })
    }
}
