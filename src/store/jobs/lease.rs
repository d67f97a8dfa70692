//! Leases of jobs: claim, heartbeat, release, rescue.
//!
//! Each claim makes a new token, and every later write must carry it (`AND lease_token = $token`). If a worker is
//! paused, presumed dead and replaced, its later writes change nothing.

use std::time::Duration;

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::super::error::{StoreError, StoreResult, not_found};
use super::{JobRecord, JobStore};
use crate::domain::problem::Problem;
use crate::ids::{JobId, LeaseToken};
use crate::time::millis;

/// The right to work on a job until the lease is lost.
#[derive(Clone, Debug, PartialEq)]
pub struct Lease {
    /// The job as it was claimed.
    pub job: JobRecord,
    /// The token that every write on this job must carry.
    pub token: LeaseToken,
}

/// The result of a sweep.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SweepResult {
    /// Jobs whose lease had run out: queued again or quarantined.
    pub rescued: Vec<JobRecord>,
}

/// The index `job_waiting` has the queue's order.
pub(in crate::store) const CLAIM: &str = "
    UPDATE job SET state = 'running', attempt = attempt + 1, lease_token = $1, lease_until_ms = $2, worker = $3,
                   progress = 0, started_at_ms = $4
    WHERE id = (SELECT id FROM job WHERE state = 'queued' ORDER BY turn, queued_at_ms, id LIMIT 1)
    RETURNING *";

const HEARTBEAT: &str = "
    UPDATE job SET lease_until_ms = $3, progress = max(progress, $4) WHERE id = $1 AND lease_token = $2";

const RELEASE: &str = "
    UPDATE job SET state = 'queued', attempt = attempt - 1, progress = 0, lease_token = NULL, lease_until_ms = NULL,
                   worker = NULL, started_at_ms = NULL
    WHERE id = $1 AND lease_token = $2";

const FAIL: &str = "
    UPDATE job SET state = 'failed', problem = $3, ended_at_ms = $4, lease_token = NULL, lease_until_ms = NULL,
                   worker = NULL
    WHERE id = $1 AND lease_token = $2";

const IS_HELD: &str = "SELECT 1 FROM job WHERE id = $1 AND lease_token = $2";

const EXPIRED_LEASES: &str = "SELECT id FROM job WHERE state = 'running' AND lease_until_ms <= $1 ORDER BY id";

impl JobStore<'_> {
    /// Claims the next job for this worker: the one with the highest priority that has waited longest. Jobs on boxes go
    /// first, since sessions wait for them.
    pub async fn claim(&self, worker: &str, lease: Duration) -> StoreResult<Option<Lease>> {
        let (worker, now_ms) = (worker.to_owned(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let token = LeaseToken::at(now_ms);
                let row = sqlx::query_as(CLAIM).bind(token).bind(now_ms + millis(lease)).bind(worker).bind(now_ms);
                Ok(row.fetch_optional(tx).await?.map(|job| Lease { job, token }))
            })
            .await
    }

    /// Reports progress and extends the lease to `lease` from now.
    pub async fn heartbeat(&self, held: &Lease, progress: f64, lease: Duration) -> StoreResult<()> {
        let (id, token, now_ms) = (held.job.id, held.token, self.0.now_ms());
        let progress = if progress.is_finite() { progress.clamp(0.0, 1.0) } else { 0.0 };
        self.0
            .write(async move |tx| {
                let beat = sqlx::query(HEARTBEAT).bind(id).bind(token).bind(now_ms + millis(lease)).bind(progress);
                require_held(beat.execute(tx).await?.rows_affected())
            })
            .await
    }

    /// Releases a job because the service is ending or the machine failed: it is queued again at its old position, and
    /// no attempt is counted.
    pub async fn release(&self, held: &Lease) -> StoreResult<()> {
        let (id, token) = (held.job.id, held.token);
        self.0
            .write(async move |tx| {
                require_held(sqlx::query(RELEASE).bind(id).bind(token).execute(tx).await?.rows_affected())
            })
            .await
    }

    /// Ends the job as failed, with a problem that another attempt would not solve.
    pub async fn fail(&self, held: &Lease, problem: Problem) -> StoreResult<JobRecord> {
        let (token, id, now_ms) = (held.token, held.job.id, self.0.now_ms());
        self.0
            .write(async move |tx| {
                let failed = sqlx::query(FAIL).bind(id).bind(token).bind(Json(problem)).bind(now_ms);
                require_held(failed.execute(&mut *tx).await?.rows_affected())?;
                read(tx, id).await
            })
            .await
    }

    /// Records that the job's child crashed or timed out: the job is queued again, or quarantined after the last
    /// attempt.
    pub async fn mark_crashed(&self, held: &Lease, problem: Problem) -> StoreResult<JobRecord> {
        let (token, id, now_ms) = (held.token, held.job.id, self.0.now_ms());
        self.0
            .write(async move |tx| {
                let held: Option<i64> =
                    sqlx::query_scalar(IS_HELD).bind(id).bind(token).fetch_optional(&mut *tx).await?;
                held.ok_or(StoreError::LeaseLost)?;
                let row = sqlx::query_as(COUNT_CRASH).bind(id).bind(Json(problem)).bind(now_ms);
                row.fetch_optional(tx).await?.ok_or(StoreError::LeaseLost)
            })
            .await
    }

    /// Rescues the jobs whose lease has run out: each is queued at its old position, or quarantined after
    /// [`MAX_LOST_LEASES`]. With `all` it rescues every running job: for the start after a crash, when no worker can be
    /// alive.
    pub async fn sweep(&self, all: bool, problem: Problem) -> StoreResult<SweepResult> {
        let now_ms = self.0.now_ms();
        self.0
            .write(async move |tx| {
                let until_ms = if all { i64::MAX } else { now_ms };
                let silent: Vec<JobId> = sqlx::query_scalar(EXPIRED_LEASES).bind(until_ms).fetch_all(&mut *tx).await?;
                let mut rescued = Vec::with_capacity(silent.len());
                for id in silent {
                    let row = sqlx::query_as(COUNT_LOST_LEASE).bind(id).bind(Json(problem.clone())).bind(now_ms);
                    let row = row.bind(MAX_LOST_LEASES).fetch_optional(&mut *tx).await?;
                    rescued.push(row.ok_or(StoreError::LeaseLost)?);
                }
                Ok(SweepResult { rescued })
            })
            .await
    }
}

/// Number of lost leases after which a job is quarantined. A lease is lost when power fails or the service is killed,
/// and that says nothing about the job: only after many is the job itself suspected of ending the service.
pub const MAX_LOST_LEASES: u32 = 10;

/// Takes the lease away after a crash of the child: the job is queued at its old position while attempts are left, else
/// quarantined.
const COUNT_CRASH: &str = "
    UPDATE job SET state = CASE WHEN attempt < max_attempts THEN 'queued' ELSE 'quarantined' END,
                   ended_at_ms = CASE WHEN attempt < max_attempts THEN NULL ELSE $3 END,
                   problem = $2, progress = 0, lease_token = NULL, lease_until_ms = NULL, worker = NULL
    WHERE id = $1 AND state = 'running'
    RETURNING *";

/// Takes a lost lease away. It counts as no attempt.
const COUNT_LOST_LEASE: &str = "
    UPDATE job SET state = CASE WHEN lost_leases + 1 < $4 THEN 'queued' ELSE 'quarantined' END,
                   ended_at_ms = CASE WHEN lost_leases + 1 < $4 THEN NULL ELSE $3 END,
                   attempt = attempt - 1, lost_leases = lost_leases + 1,
                   problem = $2, progress = 0, lease_token = NULL, lease_until_ms = NULL, worker = NULL
    WHERE id = $1 AND state = 'running'
    RETURNING *";

const END_AS_DONE: &str = "
    UPDATE job SET state = 'done', progress = 1, problem = NULL, ended_at_ms = $3, lease_token = NULL,
                   lease_until_ms = NULL, worker = NULL
    WHERE id = $1 AND lease_token = $2";

/// Ends a job as done, if the lease is still held.
pub(super) async fn end_as_done(
    tx: &mut SqliteConnection,
    id: JobId,
    token: LeaseToken,
    now_ms: i64,
) -> StoreResult<()> {
    let done = sqlx::query(END_AS_DONE).bind(id).bind(token).bind(now_ms);
    require_held(done.execute(tx).await?.rows_affected())
}

const READ: &str = "SELECT * FROM job WHERE id = $1";

pub(super) async fn read(tx: &mut SqliteConnection, id: JobId) -> StoreResult<JobRecord> {
    sqlx::query_as(READ).bind(id).fetch_optional(tx).await?.ok_or(not_found("job"))
}

fn require_held(rows: u64) -> StoreResult<()> {
    if rows == 1 { Ok(()) } else { Err(StoreError::LeaseLost) }
}
