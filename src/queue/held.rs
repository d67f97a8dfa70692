//! A claimed job: the worker's side of the lease.

use std::time::Duration;

use metrics::counter;

use super::Queue;
use crate::domain::job::JobState;
use crate::domain::problem::Problem;
use crate::store::{JobRecord, Lease, Store, StoreResult};

/// A job held by one worker. It can end only once: after the first end the lease is lost. An end that could not be
/// stored, because the disk is full, can be tried again. If this is dropped without an end, the job is rescued when its
/// lease runs out.
#[derive(Debug)]
pub struct HeldJob {
    queue: Queue,
    lease: Lease,
    progress: f64,
}

impl HeldJob {
    pub(super) fn new(queue: Queue, lease: Lease) -> Self {
        Self { queue, lease, progress: 0.0 }
    }

    /// The job, as it was claimed.
    pub fn job(&self) -> &JobRecord {
        &self.lease.job
    }

    /// How often to send a heartbeat.
    pub fn heartbeat_interval(&self) -> Duration {
        Duration::from_secs(self.queue.inner.settings.heartbeat_s)
    }

    /// Reports progress, 0 to 1, and extends the lease. If the error satisfies [`super::is_lease_lost`], stop: another
    /// worker may own the job.
    pub async fn progress(&mut self, progress: f64) -> StoreResult<()> {
        self.progress = progress.clamp(self.progress, 1.0).max(0.0);
        self.renew_lease().await?;
        let job = JobRecord { progress: self.progress, state: JobState::Running, ..self.lease.job.clone() };
        self.queue.publish_job_state(&job).await;
        Ok(())
    }

    /// Extends the lease without new progress.
    pub async fn renew_lease(&self) -> StoreResult<()> {
        self.store().jobs().heartbeat(&self.lease, self.progress, self.queue.inner.settings.lease()).await
    }

    /// Ends the job as done. `save` stores its result with one of the store's `finish_…` functions, which end the job
    /// in the same transaction.
    pub async fn finish<T>(&self, save: impl AsyncFnOnce(&Store, &Lease) -> StoreResult<T>) -> StoreResult<T> {
        let saved = save(self.store(), &self.lease).await?;
        self.queue
            .publish_job_state(&JobRecord { progress: 1.0, state: JobState::Done, ..self.lease.job.clone() })
            .await;
        self.queue.inner.arrived.notify_one(); // a new camera or new colours may have queued the box's sessions
        Ok(saved)
    }

    /// Ends the job as failed, with the reason.
    pub async fn fail(&self, problem: Problem) -> StoreResult<JobRecord> {
        let job = self.store().jobs().fail(&self.lease, problem).await?;
        counter!("trocar_jobs_failed_total").increment(1);
        self.queue.publish_job_state(&job).await;
        Ok(job)
    }

    /// Records that the job's child crashed or timed out. The job is tried again, or quarantined after its last attempt
    /// (`store.max_attempts`, usually the third).
    pub async fn report_crash(&self, problem: Problem) -> StoreResult<JobRecord> {
        let job = self.store().jobs().mark_crashed(&self.lease, problem).await?;
        let session = job.session_id.map(tracing::field::display);
        if job.state == JobState::Quarantined {
            tracing::error!(job = %job.id, session, attempts = job.attempt, "job crashed too often; quarantined");
        } else {
            tracing::warn!(job = %job.id, session, attempts = job.attempt, "job crashed; tried again");
        }
        self.queue.publish_job_state(&job).await;
        self.queue.inner.arrived.notify_one();
        Ok(job)
    }

    /// Releases the job because the service is ending or the machine failed; no attempt is counted.
    pub async fn release(&self) -> StoreResult<()> {
        self.store().jobs().release(&self.lease).await?;
        self.queue
            .publish_job_state(&JobRecord { progress: 0.0, state: JobState::Queued, ..self.lease.job.clone() })
            .await;
        Ok(())
    }

    fn store(&self) -> &Store {
        &self.queue.inner.store
    }
}
