//! A job that is being worked on: the worker's side of the lease.

use std::time::Duration;

use super::Queue;
use crate::domain::job::JobState;
use crate::domain::problem::Problem;
use crate::store::{Job, Lease, Store, StoreResult};

/// A job, held by one worker. It has one end, however often it is asked for: after the first, the lease is lost. An end that
/// could not be stored (the disk is full) can be tried again. Dropped without one, the job is rescued when its lease runs
/// out.
#[derive(Debug)]
pub struct Held {
    queue: Queue,
    lease: Lease,
    progress: f64,
}

impl Held {
    pub(super) fn new(queue: Queue, lease: Lease) -> Self {
        Self { queue, lease, progress: 0.0 }
    }

    /// The job, as it was claimed.
    pub fn job(&self) -> &Job {
        &self.lease.job
    }

    /// How often to give word.
    pub fn heartbeat(&self) -> Duration {
        Duration::from_secs(self.queue.inner.settings.heartbeat_s)
    }

    /// Says how far the work is, 0 to 1, and extends the lease. An error of [`super::is_lost`] means: stop, it is no longer
    /// yours.
    pub async fn progress(&mut self, progress: f64) -> StoreResult<()> {
        self.progress = progress.clamp(self.progress, 1.0).max(0.0);
        self.beat().await?;
        let job = Job { progress: self.progress, state: JobState::Running, ..self.lease.job.clone() };
        self.queue.tell(&job).await;
        Ok(())
    }

    /// Says that the work goes on, and extends the lease.
    pub async fn beat(&self) -> StoreResult<()> {
        self.store().jobs().heartbeat(&self.lease, self.progress, self.queue.inner.settings.lease()).await
    }

    /// Ends the job as done. `save` stores what came of it with one of the store's `finish_…` functions, which end the job
    /// in the same transaction.
    pub async fn finish<T>(&self, save: impl AsyncFnOnce(&Store, &Lease) -> StoreResult<T>) -> StoreResult<T> {
        let saved = save(self.store(), &self.lease).await?;
        self.queue.tell(&Job { progress: 1.0, state: JobState::Done, ..self.lease.job.clone() }).await;
        self.queue.inner.arrived.notify_one(); // a box's new camera or colours may have queued its sessions
        Ok(saved)
    }

    /// Ends the job as failed: the work cannot be done, for this reason.
    pub async fn fail(&self, problem: Problem) -> StoreResult<Job> {
        let job = self.store().jobs().fail(&self.lease, problem).await?;
        self.queue.tell(&job).await;
        Ok(job)
    }

    /// Whoever did the work died or ran out of time: it is tried again, or quarantined after the third time.
    pub async fn crashed(&self, problem: Problem) -> StoreResult<Job> {
        let job = self.store().jobs().crashed(&self.lease, problem).await?;
        self.queue.tell(&job).await;
        self.queue.inner.arrived.notify_one();
        Ok(job)
    }

    /// Hands the job back untouched, because the service ends.
    pub async fn give_back(&self) -> StoreResult<()> {
        self.store().jobs().give_back(&self.lease).await?;
        self.queue.tell(&Job { progress: 0.0, state: JobState::Queued, ..self.lease.job.clone() }).await;
        Ok(())
    }

    fn store(&self) -> &Store {
        &self.queue.inner.store
    }
}
