//! The job queue: lease, heartbeat, fencing, rescue. It is independent of the kind of work.
//!
//! A worker calls [`Queue::next`] and gets a [`HeldJob`]: the lease of a job for [`QueueSettings::lease_s`] seconds,
//! extended by each [`HeldJob::progress`] or [`HeldJob::renew_lease`]. Every job ends, even if its worker does not
//! survive:
//!
//! | event | consequence for the job |
//! |---|---|
//! | [`HeldJob::finish`] | done; its result is stored in the same transaction |
//! | [`HeldJob::fail`] | failed, with a problem for people: another attempt would not help |
//! | [`HeldJob::report_crash`] | queued again; quarantined with the reason after `store.max_attempts`, usually the third time |
//! | [`HeldJob::release`] | queued again at its old position, no attempt counted: the service ends or the machine failed |
//! | no heartbeat | queued again by the first sweep after the lease has run out, no attempt counted; quarantined after [`MAX_LOST_LEASES`] |
//!
//! The token of the lease guards every write, so that a worker that has lost its lease changes nothing
//! ([`StoreError::LeaseLost`]). The service may end at any moment: the next start rescues running jobs
//! ([`Queue::recover`]).

mod held;

pub use held::HeldJob;

use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tokio::sync::Notify;

use crate::domain::job::{JobKind, JobState};
use crate::domain::problem::Problem;
use crate::domain::scope::Scope;
use crate::events::{Event, EventBus};
use crate::shutdown::Shutdown;
use crate::store::{JobRecord, MAX_LOST_LEASES, Store, StoreError, StoreResult};
use crate::time::SharedClock;

/// Times of the queue.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct QueueSettings {
    /// How long a lease lasts without a heartbeat, s. Longer: slower rescue; shorter: paused workers lose their jobs.
    /// At least two heartbeats. Usually 30.
    pub lease_s: u64,
    /// How often a worker sends a heartbeat, s. Usually 10.
    pub heartbeat_s: u64,
    /// How often expired leases are looked for, s. Usually 5.
    pub sweep_s: u64,
    /// How often an idle worker polls for jobs, in case a notification was missed, s. Usually 5.
    pub look_s: u64,
}

impl Default for QueueSettings {
    fn default() -> Self {
        Self { lease_s: 30, heartbeat_s: 10, sweep_s: 5, look_s: 5 }
    }
}

impl QueueSettings {
    fn lease(&self) -> Duration {
        Duration::from_secs(self.lease_s)
    }
}

/// The job queue. Clones share one queue.
#[derive(Clone, Debug)]
pub struct Queue {
    inner: Arc<QueueInner>,
}

#[derive(Debug)]
struct QueueInner {
    store: Store,
    clock: SharedClock,
    settings: QueueSettings,
    events: EventBus,
    arrived: Notify,
}

impl Queue {
    /// The queue in this store. It publishes an event for every change of a job.
    pub fn new(store: Store, settings: QueueSettings, events: EventBus, clock: SharedClock) -> Self {
        Self { inner: Arc::new(QueueInner { store, clock, settings, events, arrived: Notify::new() }) }
    }

    /// Wakes an idle worker because a job may have been queued: call it after a session is created or retried. Without
    /// this call the job starts within [`QueueSettings::look_s`].
    pub fn work_arrived(&self) {
        self.inner.arrived.notify_one();
        self.inner.events.publish(Event::Queue);
    }

    /// Waits for the next job and claims it; `None` once the service is ending.
    pub async fn next(&self, worker: &str, shutdown: &Shutdown) -> Option<HeldJob> {
        while !shutdown.is_begun() {
            match self.claim(worker).await {
                Ok(Some(held)) => return Some(held),
                Ok(None) => {}
                Err(error) => tracing::warn!(%error, worker, "could not claim a job; retrying"),
            }
            tokio::select! {
                () = shutdown.begun() => {}
                () = self.inner.arrived.notified() => {}
                () = self.inner.clock.sleep(Duration::from_secs(self.inner.settings.look_s)) => {}
            }
        }
        None
    }

    /// Claims the next job, if any is queued.
    pub async fn claim(&self, worker: &str) -> StoreResult<Option<HeldJob>> {
        let lease = self.inner.store.jobs().claim(worker, self.inner.settings.lease()).await?;
        let Some(lease) = lease else { return Ok(None) };
        self.inner.arrived.notify_one(); // there may be more jobs: wake the next idle worker
        self.publish_job_state(&lease.job).await;
        Ok(Some(HeldJob::new(self.clone(), lease)))
    }

    /// Rescues the jobs whose lease has run out; returns how many.
    pub async fn sweep(&self) -> StoreResult<usize> {
        let detail = Self::detail("the worker did not report progress in time");
        self.rescue(false, Problem::new("worker-silent", "The worker stopped responding", detail)).await
    }

    /// At a start: rescues every running job, since its worker ended with the previous process.
    pub async fn recover(&self) -> StoreResult<usize> {
        let detail = Self::detail("the service stopped suddenly during this work");
        self.rescue(true, Problem::new("service-ended", "The service stopped during the work", detail)).await
    }

    /// Sweeps every [`QueueSettings::sweep_s`] seconds until the service ends.
    pub async fn keep_sweeping(&self, shutdown: &Shutdown) {
        while !shutdown.is_begun() {
            if let Err(error) = self.sweep().await {
                tracing::warn!(%error, "could not look for expired leases; retrying at the next sweep");
            }
            tokio::select! {
                () = shutdown.begun() => {}
                () = self.inner.clock.sleep(Duration::from_secs(self.inner.settings.sweep_s)) => {}
            }
        }
    }

    /// What happened, and how often the work is tried.
    fn detail(what: &str) -> String {
        format!("{what}; after this has happened {MAX_LOST_LEASES} times, the work is not tried again automatically")
    }

    async fn rescue(&self, all: bool, problem: Problem) -> StoreResult<usize> {
        let swept = self.inner.store.jobs().sweep(all, problem).await?;
        for job in &swept.rescued {
            let session = job.session_id.map(tracing::field::display);
            tracing::warn!(job = %job.id, session, state = %job.state, "worker lost; job rescued");
            self.publish_job_state(job).await;
        }
        if !swept.rescued.is_empty() {
            self.work_arrived();
        }
        Ok(swept.rescued.len())
    }

    /// Publishes a job's new state as an event. If the session cannot be read, only the event is lost.
    async fn publish_job_state(&self, job: &JobRecord) {
        let session = match job.session_id {
            Some(id) => self.inner.store.sessions().get(&Scope::service(), id).await.ok(),
            None => None,
        };
        let trainee = session.as_ref().map(|session| session.trainee_id);
        let JobRecord { id, kind, state, progress, .. } = *job;
        self.inner.events.publish(Event::Job { id, kind, state, progress, trainee });
        if let Some(session) = session {
            // Scoring again does not change the session's state; an event follows once another result is current.
            let is_again = kind == JobKind::Rescore;
            let (trainee, status) = (session.trainee_id, if is_again { session.status() } else { Some(state).into() });
            if !is_again || state == JobState::Done {
                self.inner.events.publish(Event::Session { id: session.id, trainee, status, progress });
            }
        }
        self.inner.events.publish(Event::Queue);
    }
}

/// True if the lease was lost: another worker owns the job, or it no longer exists, so the result is discarded without
/// an error.
pub fn is_lease_lost(error: &StoreError) -> bool {
    matches!(error, StoreError::LeaseLost)
}

#[cfg(test)]
mod tests;
