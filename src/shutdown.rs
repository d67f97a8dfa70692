//! Shutdown: a state that every task can see and wait for, and the immediate abort when a disk cannot be trusted.
//!
//! An orderly shutdown stops accepting requests, keeps partial uploads, releases leases and ends within a fixed time.
//! All other ends are crashes, and every start recovers from a crash.

use std::future::Future;
use std::time::Duration;

use tokio::signal::unix::{SignalKind, signal};
use tokio::task::JoinHandle;
use tokio_util::sync::{CancellationToken, WaitForCancellationFutureOwned};
use tokio_util::task::TaskTracker;

/// Shared by all tasks that must end with the service. Clones share one state.
#[derive(Clone, Debug, Default)]
pub struct Shutdown {
    begun: CancellationToken,
    tasks: TaskTracker,
}

impl Shutdown {
    /// A shutdown that has not begun.
    pub fn new() -> Self {
        Self::default()
    }

    /// Begins the shutdown. A second call has no effect.
    pub fn begin(&self) {
        self.begun.cancel();
        self.tasks.close();
    }

    /// True once the shutdown has begun.
    pub fn is_begun(&self) -> bool {
        self.begun.is_cancelled()
    }

    /// Waits until the shutdown begins.
    pub fn begun(&self) -> WaitForCancellationFutureOwned {
        self.begun.clone().cancelled_owned()
    }

    /// Starts a task that [`Shutdown::finished`] waits for. The task itself must watch [`Shutdown::begun`].
    pub fn spawn<T: Send + 'static>(&self, task: impl Future<Output = T> + Send + 'static) -> JoinHandle<T> {
        self.tasks.spawn(task)
    }

    /// Waits until the shutdown has begun and all tasks have ended. `false` if tasks still run `grace` after it began.
    pub async fn finished(&self, grace: Duration) -> bool {
        self.begun().await;
        tokio::time::timeout(grace, self.tasks.wait()).await.is_ok()
    }

    /// Begins the shutdown at SIGTERM or SIGINT. A second signal ends the process immediately.
    #[expect(
        clippy::disallowed_methods,
        reason = "second signal: acknowledged data is durable; the next start recovers"
    )]
    pub fn begin_on_signals(&self) -> std::io::Result<()> {
        let (mut terminate, mut interrupt) = (signal(SignalKind::terminate())?, signal(SignalKind::interrupt())?);
        let shutdown = self.clone();
        tokio::spawn(async move {
            loop {
                tokio::select! { _ = terminate.recv() => {}, _ = interrupt.recv() => {} }
                if shutdown.is_begun() {
                    std::process::exit(130);
                }
                tracing::info!("signal received; shutting down");
                shutdown.begin();
            }
        });
        Ok(())
    }
}

/// Aborts the process. After a failed fsync the content of the disk is unknown, and a second fsync can report success
/// although pages were lost. A fresh start reads what is really on the disk.
pub fn abort_process(why: &str) -> ! {
    tracing::error!(why, "aborting: written data may not be on the disk");
    eprintln!("trocar: aborting: {why}");
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
