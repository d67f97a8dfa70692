//! Jobs that are queued, running or ended. See [`crate::domain::job`] for the diagram of states.
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | jobs as people see them |
//! | `enqueue.rs` | enqueue jobs, in the transaction that makes the work necessary |
//! | `lease.rs` | claim, heartbeat, release, rescue: for [`crate::queue`] |
//! | `finish.rs` | store results under the job's lease |

mod enqueue;
mod finish;
mod lease;

pub(super) use enqueue::{
    enqueue_rescore, enqueue_rescore_if_outdated, enqueue_track, enqueue_track_with_priority, enqueue_waiting_sessions,
    insert,
};
#[cfg(test)]
pub(super) use lease::CLAIM; // for the test of its query plan
pub use lease::{Lease, MAX_LOST_LEASES, SweepResult};

use sqlx::types::Json;

use super::audit::note;
use super::error::{StoreError, StoreResult, not_found};
use super::page::{Page, PageRequest};
use super::visibility::{BindScope, require_staff};
use super::{Scope, Store};
use crate::domain::job::{JobInput, JobKind, JobState, PaletteInput};
use crate::domain::palette::PaletteAdvice;
use crate::domain::problem::Problem;
use crate::domain::text::Key;
use crate::ids::{BoxId, JobId, SessionId};

/// Access to the job queue.
pub struct JobStore<'s>(pub(super) &'s Store);

/// A job.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct JobRecord {
    /// Its id.
    pub id: JobId,
    /// Its kind.
    pub kind: JobKind,
    /// Its input.
    #[sqlx(json)]
    pub input: JobInput,
    /// The session that it works on, if any.
    pub session_id: Option<SessionId>,
    /// The box that it works on, if any.
    pub box_id: Option<BoxId>,
    /// Its state.
    pub state: JobState,
    /// Number of claims that ended in a crash of the child, plus the present one.
    pub attempt: i64,
    /// Number of crashes after which it is quarantined.
    pub max_attempts: i64,
    /// Share of the work done, 0 to 1.
    pub progress: f64,
    /// Why it failed, or the reason of its last crash.
    #[sqlx(json(nullable))]
    pub problem: Option<Problem>,
    /// Advice on tape colours for the box, if the job was to give it.
    #[sqlx(json(nullable))]
    pub advice: Option<PaletteAdvice>,
    /// The worker that has the lease.
    pub worker: Option<String>,
    /// When it was first queued, epoch ms.
    pub created_at_ms: i64,
    /// When it was last queued, epoch ms.
    pub queued_at_ms: i64,
    /// When it was last claimed, epoch ms.
    pub started_at_ms: Option<i64>,
    /// When it ended, epoch ms.
    pub ended_at_ms: Option<i64>,
}

/// The number of jobs by state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, sqlx::FromRow)]
pub struct QueueCounts {
    /// Queued jobs.
    pub queued: i64,
    /// Running jobs.
    pub running: i64,
    /// Quarantined jobs.
    pub quarantined: i64,
}

const LIST: &str = "
    SELECT * FROM job
    WHERE EXISTS (SELECT 1 FROM visible_job WHERE role = $1 AND subject IS nullif($2, 'service') AND job_id = job.id)
          AND ($2 IS 'service' OR NOT EXISTS (SELECT 1 FROM session WHERE session.id = job.session_id
                                              AND trainee_id IN (SELECT trainee_id FROM hidden_trainee)))
          AND ($3 IS NULL OR id < $3) AND (NOT $4 OR state IN ('queued', 'running'))
    ORDER BY id DESC LIMIT $5";

const GET: &str = "
    SELECT * FROM job
    WHERE id = $3
          AND EXISTS (SELECT 1 FROM visible_job WHERE role = $1 AND subject IS nullif($2, 'service') AND job_id = job.id)
          AND ($2 IS 'service' OR NOT EXISTS (SELECT 1 FROM session WHERE session.id = job.session_id
                                              AND trainee_id IN (SELECT trainee_id FROM hidden_trainee)))";

const DONE_PALETTE_INPUTS: &str = "
    SELECT input FROM job
    WHERE box_id = $1 AND kind = 'palette' AND state = 'done' AND json_extract(input, '$.empty_box') IS NULL
      AND EXISTS (SELECT 1 FROM job_file WHERE job_file.job_id = job.id)
    ORDER BY created_at_ms DESC LIMIT 100";

const COUNT_FILES: &str = "
    SELECT count(*), count(blob.dropped_at_ms) FROM job_file JOIN blob ON blob.hash = job_file.blob WHERE job_id = $1";

const COUNTS: &str = "
    SELECT (SELECT count(*) FROM job WHERE state = 'queued') AS queued,
           (SELECT count(*) FROM job WHERE state = 'running') AS running,
           (SELECT count(*) FROM job WHERE state = 'quarantined') AS quarantined";

impl JobStore<'_> {
    /// Queues a job on a box. The same work requested twice is one job; a failed job is queued again.
    pub async fn enqueue(&self, scope: &Scope, input: JobInput) -> StoreResult<JobRecord> {
        require_staff(scope, "giving a box new colours, a new camera or a self-test")?;
        if input.facts().of_box.is_none() {
            return Err(StoreError::refused("a session's job is made with the session"));
        }
        self.require_result_allowed(scope, &input).await?;
        let (scope, now_ms, attempts) = (scope.clone(), self.0.now_ms(), self.0.max_attempts());
        self.0
            .write(async move |tx| {
                let id = enqueue::insert(tx, &input, now_ms, attempts).await?;
                note(tx, &scope, now_ms, ("enqueue", "job"), id).await?;
                lease::read(tx, id).await
            })
            .await
    }

    /// The jobs that the scope sees, newest first. With `open` only queued and running ones.
    pub async fn list(&self, scope: &Scope, open: bool, page: &PageRequest) -> StoreResult<Page<JobRecord>> {
        let rows = sqlx::query_as(LIST).bind_scope(scope).bind(page.after()).bind(open).bind(page.row_limit());
        let rows = rows.fetch_all(self.0.readers()).await?;
        Ok(Page::from_rows(rows, page, |job: &JobRecord| job.id.to_string()))
    }

    /// The marks that a box's colours were learned from, while their pictures are kept, the latest first; at most 100.
    /// Only jobs of earlier versions keep them, until the box's surroundings were read.
    pub async fn done_palette_inputs(&self, of: BoxId) -> StoreResult<Vec<PaletteInput>> {
        let rows: Vec<Json<JobInput>> =
            sqlx::query_scalar(DONE_PALETTE_INPUTS).bind(of).fetch_all(self.0.readers()).await?;
        let marks = |Json(input): Json<JobInput>| match input {
            JobInput::Palette(input) => Some(input),
            _ => None,
        };
        Ok(rows.into_iter().filter_map(marks).collect())
    }

    /// One job.
    pub async fn get(&self, scope: &Scope, id: JobId) -> StoreResult<JobRecord> {
        let row = sqlx::query_as(GET).bind_scope(scope).bind(id).fetch_optional(self.0.readers()).await?;
        row.ok_or(not_found("job"))
    }

    /// Queues a failed or quarantined job again; a job in another state stays as it is.
    pub async fn retry(&self, scope: &Scope, id: JobId) -> StoreResult<JobRecord> {
        let job = self.get(scope, id).await?;
        require_staff(scope, "trying a job again")?;
        self.require_result_allowed(scope, &job.input).await?;
        let (files, dropped): (i64, i64) = sqlx::query_as(COUNT_FILES).bind(id).fetch_one(self.0.readers()).await?;
        let is_open = matches!(job.state, JobState::Failed | JobState::Quarantined);
        if is_open && (dropped > 0 || (files == 0 && !job.input.facts().blobs.is_empty())) {
            return Err(StoreError::refused(
                "the files of this job were deleted, because they are kept for a limited time: send them again",
            ));
        }
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                if enqueue::requeue(tx, id, now_ms).await? {
                    let job = lease::read(tx, id).await?;
                    enqueue::raise_priority(tx, id, job.input.facts().priority).await?;
                    note(tx, &scope, now_ms, ("retry", "job"), id).await?;
                }
                lease::read(tx, id).await
            })
            .await
    }

    /// Refuses a job whose result would change a box that the scope may not change.
    async fn require_result_allowed(&self, scope: &Scope, input: &JobInput) -> StoreResult<()> {
        match input.changed_box() {
            Some(of) => self.0.boxes().changeable(scope, &Key::from(&of)).await.map(drop),
            None => Ok(()),
        }
    }

    /// The number of jobs in each state, of all sessions and boxes: no personal data.
    pub async fn counts(&self) -> StoreResult<QueueCounts> {
        Ok(sqlx::query_as(COUNTS).fetch_one(self.0.readers()).await?)
    }
}
