//! Ending: a state that every task can see and wait for, and the sudden end when a disk cannot be trusted.
//!
//! An orderly end stops accepting, keeps partial uploads, hands leases back and is over within a bounded time. Everything
//! else is crash-only: start-up is recovery.

use std::future::Future;
use std::time::Duration;

use tokio::signal::unix::{SignalKind, signal};
use tokio::task::JoinHandle;
use tokio_util::sync::{CancellationToken, WaitForCancellationFutureOwned};
use tokio_util::task::TaskTracker;

/// Shared by everything that must end with the service. Clones are the same shutdown.
#[derive(Clone, Debug, Default)]
pub struct Shutdown {
    begun: CancellationToken,
    tasks: TaskTracker,
}

impl Shutdown {
    /// Nothing is ending yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Begins to end; again has no effect.
    pub fn begin(&self) {
        self.begun.cancel();
        self.tasks.close();
    }

    /// Has the end begun?
    pub fn is_begun(&self) -> bool {
        self.begun.is_cancelled()
    }

    /// Waits until the end begins.
    pub fn begun(&self) -> WaitForCancellationFutureOwned {
        self.begun.clone().cancelled_owned()
    }

    /// Starts a task that [`Shutdown::finished`] waits for. The task itself must watch [`Shutdown::begun`].
    pub fn spawn<T: Send + 'static>(&self, task: impl Future<Output = T> + Send + 'static) -> JoinHandle<T> {
        self.tasks.spawn(task)
    }

    /// Waits until the end has begun and all tasks are over; `false` if they were not within `grace` of the beginning.
    pub async fn finished(&self, grace: Duration) -> bool {
        self.begun().await;
        tokio::time::timeout(grace, self.tasks.wait()).await.is_ok()
    }

    /// Begins to end at SIGTERM or SIGINT. A second signal ends the process at once.
    #[expect(clippy::disallowed_methods, reason = "asked twice to end: what is durable is, the next start recovers")]
    pub fn begin_on_signals(&self) -> std::io::Result<()> {
        let (mut terminate, mut interrupt) = (signal(SignalKind::terminate())?, signal(SignalKind::interrupt())?);
        let shutdown = self.clone();
        tokio::spawn(async move {
            loop {
                tokio::select! { _ = terminate.recv() => {}, _ = interrupt.recv() => {} }
                if shutdown.is_begun() {
                    std::process::exit(130);
                }
                tracing::info!("ending: a signal asks for it");
                shutdown.begin();
            }
        });
        Ok(())
    }
}

/// Ends the process now. After a failed fsync nobody knows what is on the disk, and asking again can answer "fine" over
/// lost pages; a fresh start reads back what is really there.
pub fn abort(why: &str) -> ! {
    tracing::error!(why, "ending at once: what was written may not be on the disk");
    eprintln!("trocar: ending at once: {why}");
    std::process::abort()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn finished_waits_for_tasks_that_watch_the_beginning() {
        let shutdown = Shutdown::new();
        let seen = shutdown.begun();
        let task = shutdown.spawn(async move {
            seen.await;
            7
        });
        shutdown.begin();
        assert!(shutdown.finished(Duration::from_secs(5)).await);
        assert_eq!(task.await.unwrap(), 7);
    }

    #[tokio::test]
    async fn a_task_that_does_not_end_is_not_waited_for_beyond_the_grace() {
        let shutdown = Shutdown::new();
        shutdown.spawn(std::future::pending::<()>());
        shutdown.begin();
        assert!(!shutdown.finished(Duration::ZERO).await);
    }
}
