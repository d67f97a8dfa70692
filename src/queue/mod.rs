//! Work, handed out one job at a time: lease, heartbeat, fencing, rescue. Knows nothing of what the work is.
//!
//! A worker asks [`Queue::next`] and gets [`Held`] work: the right to it for [`QueueSettings::lease_s`] seconds, extended by
//! each [`Held::progress`] or [`Held::beat`]. Whatever happens to the worker, the job ends:
//!
//! | what happens | what becomes of the job |
//! |---|---|
//! | [`Held::finish`] | done, together with what it stored, in one transaction |
//! | [`Held::fail`] | failed, with a problem for people: trying again would not help |
//! | [`Held::crashed`] | queued again; after three times quarantined with the reason |
//! | [`Held::give_back`] | queued again at its old place, nothing counted: the service ends |
//! | silence | as crashed, by the next sweep after the lease has run out |
//!
//! The lease's token guards every write, so that who comes late changes nothing ([`StoreError::LeaseLost`]). The service may
//! end at any moment: the next start rescues what was running ([`Queue::recover`]).

mod held;

pub use held::Held;

use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tokio::sync::Notify;

use crate::domain::job::{JobKind, JobState};
use crate::domain::problem::Problem;
use crate::domain::scope::Scope;
use crate::events::{Event, Events};
use crate::shutdown::Shutdown;
use crate::store::{Job, Store, StoreError, StoreResult};
use crate::time::SharedClock;

/// The queue's times.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct QueueSettings {
    /// How long a job is its worker's without a word from it, s. Longer: slower rescue; shorter: paused workers lose their
    /// jobs. At least two heartbeats. Usually 30.
    pub lease_s: u64,
    /// How often a worker gives word, s. Usually 10.
    pub heartbeat_s: u64,
    /// How often jobs of silent workers are looked for, s. Usually 5.
    pub sweep_s: u64,
    /// How often an idle worker looks for work that nobody told it of, s. Usually 5.
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

/// The queue. Clones are the same queue.
#[derive(Clone, Debug)]
pub struct Queue {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    store: Store,
    clock: SharedClock,
    settings: QueueSettings,
    events: Events,
    arrived: Notify,
}

impl Queue {
    /// The queue in this store; it tells of every change.
    pub fn new(store: Store, settings: QueueSettings, events: Events, clock: SharedClock) -> Self {
        Self { inner: Arc::new(Inner { store, clock, settings, events, arrived: Notify::new() }) }
    }

    /// Says that work may have been queued: call it after a session is made or tried again. Forgotten, the work still starts
    /// within [`QueueSettings::look_s`].
    pub fn work_arrived(&self) {
        self.inner.arrived.notify_one();
        self.inner.events.tell(Event::Queue);
    }

    /// The next job, as soon as there is one; `None` once the service ends.
    pub async fn next(&self, worker: &str, shutdown: &Shutdown) -> Option<Held> {
        while !shutdown.is_begun() {
            match self.claim(worker).await {
                Ok(Some(held)) => return Some(held),
                Ok(None) => {}
                Err(error) => tracing::warn!(%error, worker, "asking for work"),
            }
            tokio::select! {
                () = shutdown.begun() => {}
                () = self.inner.arrived.notified() => {}
                () = self.inner.clock.sleep(Duration::from_secs(self.inner.settings.look_s)) => {}
            }
        }
        None
    }

    /// The job that has waited longest, if any waits.
    pub async fn claim(&self, worker: &str) -> StoreResult<Option<Held>> {
        let lease = self.inner.store.jobs().claim(worker, self.inner.settings.lease()).await?;
        let Some(lease) = lease else { return Ok(None) };
        self.inner.arrived.notify_one(); // there may be more: let the next idle worker look, too
        self.tell(&lease.job).await;
        Ok(Some(Held::new(self.clone(), lease)))
    }

    /// Rescues the jobs of workers that have fallen silent; returns how many.
    pub async fn sweep(&self) -> StoreResult<usize> {
        let problem = Problem::new(
            "worker-silent",
            "The worker fell silent",
            "whoever worked on it gave no word until its time was over; it is tried again, three times in all",
        );
        self.rescue(false, problem).await
    }

    /// At a start: rescues every running job, for whoever ran it ended with the service's last life.
    pub async fn recover(&self) -> StoreResult<usize> {
        let problem = Problem::new(
            "service-ended",
            "The service ended during the work",
            "the service was ended suddenly while it worked on this; it is tried again, three times in all",
        );
        self.rescue(true, problem).await
    }

    /// Sweeps every [`QueueSettings::sweep_s`] until the service ends.
    pub async fn keep_sweeping(&self, shutdown: &Shutdown) {
        while !shutdown.is_begun() {
            if let Err(error) = self.sweep().await {
                tracing::warn!(%error, "looking for silent workers");
            }
            tokio::select! {
                () = shutdown.begun() => {}
                () = self.inner.clock.sleep(Duration::from_secs(self.inner.settings.sweep_s)) => {}
            }
        }
    }

    async fn rescue(&self, all: bool, problem: Problem) -> StoreResult<usize> {
        let swept = self.inner.store.jobs().sweep(all, problem).await?;
        for job in &swept.rescued {
            tracing::warn!(job = %job.id, state = %job.state, attempt = job.attempt, "rescued from a silent worker");
            self.tell(job).await;
        }
        if !swept.rescued.is_empty() {
            self.work_arrived();
        }
        Ok(swept.rescued.len())
    }

    /// Tells whoever watches how a job stands now. News only: a failure to read the session loses an event, nothing else.
    async fn tell(&self, job: &Job) {
        let session = match job.session_id {
            Some(id) => self.inner.store.sessions().get(&Scope::service(), id).await.ok(),
            None => None,
        };
        let trainee = session.as_ref().map(|session| session.trainee_id);
        let Job { id, kind, state, progress, .. } = *job;
        self.inner.events.tell(Event::Job { id, kind, state, progress, trainee });
        if let Some(session) = session {
            // What is only scored again stands as it stood; there is news of it once another result counts.
            let is_again = kind == JobKind::Rescore;
            let (trainee, status) = (session.trainee_id, if is_again { session.status() } else { Some(state).into() });
            if !is_again || state == JobState::Done {
                self.inner.events.tell(Event::Session { id: session.id, trainee, status, progress });
            }
        }
        self.inner.events.tell(Event::Queue);
    }
}

/// Was it the lease that was lost? Then the work is somebody else's now, or gone, and not to be mourned.
pub fn is_lost(error: &StoreError) -> bool {
    matches!(error, StoreError::LeaseLost)
}

#[cfg(test)]
mod tests;
