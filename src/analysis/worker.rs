//! The worker pool: each worker takes one job at a time, supervises its child process and settles failures. What it does
//! for each kind of job is in [`super::job_kinds`].

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;

use super::attempt::{AttemptFailure, ChildAttempt, run_attempt};
use super::child::{ChildEvent, ChildOutput};
use super::job_plan::{EarlierSessions, JobPlan};
use super::protocol::{ChildRequest, ChildWork};
use super::results::ProductError;
use super::settings::AnalysisSettings;
use crate::domain::problem::Problem;
use crate::motion::quality::ports::Ports;
use crate::queue::{HeldJob, Queue, is_lease_lost};
use crate::sandbox::{Budget, Program, StopSwitch};
use crate::shutdown::Shutdown;
use crate::store::{JobRecord, Store, StoreError};
use crate::time::SharedClock;
use crate::vault::{Vault, VaultError};

/// Interval between progress updates: each one is a database commit.
const PROGRESS_INTERVAL: Duration = Duration::from_secs(1);

/// Pause of a worker after an error of the disk, the database or the system.
const BACKOFF: Duration = Duration::from_secs(5);

/// The workers and what they share.
pub struct WorkerPool {
    /// Database.
    pub store: Store,
    /// Stored files.
    pub vault: Vault,
    /// The queue of jobs.
    pub queue: Queue,
    /// For waits, and for the time stamp of a calibration.
    pub clock: SharedClock,
    /// Limits of the children.
    pub settings: AnalysisSettings,
    /// The child's program: [`WorkerPool::this_program`] except in tests.
    pub program: Program,
}

/// Why a job could not be finished.
#[derive(Debug, thiserror::Error)]
pub(super) enum WorkError {
    /// The job itself cannot be done.
    #[error("{}", .0.detail)]
    Impossible(Problem),
    /// The child or the assessment crashed, timed out, or gave no result.
    #[error("the analysis process {0}")]
    Crashed(String),
    /// The service shuts down, or the lease was lost.
    #[error("stopped")]
    Stopped,
    /// The result could not be stored.
    #[error(transparent)]
    NotStored(StoreError),
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The vault failed.
    #[error(transparent)]
    Vault(#[from] VaultError),
    /// The database, the vault or the system failed: the job was released, and no attempt is counted.
    #[error(transparent)]
    Released(Box<WorkError>),
    /// The system refused a thread, a descriptor or memory.
    #[error("preparing the child process failed: {0}")]
    System(#[from] std::io::Error),
}

impl From<Problem> for WorkError {
    fn from(problem: Problem) -> Self {
        WorkError::Impossible(problem)
    }
}

impl From<ProductError> for WorkError {
    fn from(error: ProductError) -> Self {
        WorkError::Crashed(error.to_string())
    }
}

impl From<AttemptFailure> for WorkError {
    fn from(failure: AttemptFailure) -> Self {
        match failure {
            AttemptFailure::Impossible(problem) => WorkError::Impossible(problem),
            AttemptFailure::Crashed(reason) | AttemptFailure::TimedOut(reason) => WorkError::Crashed(reason),
            AttemptFailure::Stopped => WorkError::Stopped,
        }
    }
}

impl WorkerPool {
    /// This program, run as a child.
    pub fn this_program() -> Program {
        Program::this(&["child"])
    }

    /// Starts this many workers. They work until the service shuts down and then release their jobs.
    pub fn start_workers(self, workers: usize, shutdown: &Shutdown) {
        let pool = Arc::new(self);
        for number in 1..=workers {
            let (pool, shutdown_of_worker) = (pool.clone(), shutdown.clone());
            let name = format!("worker {number} of process {}", std::process::id());
            shutdown.spawn(async move { pool.run_worker(&name, &shutdown_of_worker).await });
        }
    }

    /// Takes jobs from the queue until the service shuts down.
    async fn run_worker(&self, name: &str, shutdown: &Shutdown) {
        while let Some(held) = self.queue.next(name, shutdown).await {
            let job = held.job().id;
            match self.run_job(held, shutdown).await {
                Ok(()) => {}
                Err(WorkError::Store(error) | WorkError::NotStored(error)) if is_lease_lost(&error) => {
                    tracing::info!(%job, worker = name, "lease lost: another worker owns the job; result discarded");
                }
                Err(error) => {
                    match error {
                        WorkError::Store(error) | WorkError::NotStored(error) => tracing::warn!(
                            %error, %job, worker = name,
                            "the job's end could not be stored; tried again after the lease, pausing 5 s"
                        ),
                        error => tracing::error!(
                            %error, %job, worker = name,
                            "job failed on this machine; retried later, pausing 5 s"
                        ),
                    }
                    tokio::select! { () = shutdown.begun() => {}, () = self.clock.sleep(BACKOFF) => {} }
                }
            }
        }
    }

    /// Runs one job until it is finished, failed or released.
    async fn run_job(&self, mut held: HeldJob, shutdown: &Shutdown) -> Result<(), WorkError> {
        match self.work_on(&mut held, shutdown).await {
            Ok(()) => Ok(()),
            Err(error) => settle_failure(&held, error).await,
        }
    }

    /// Runs a child on the files of a job.
    pub(super) async fn run_child(
        &self,
        held: &mut HeldJob,
        work: ChildWork,
        ending: &Shutdown,
    ) -> Result<ChildOutput, WorkError> {
        let plan = JobPlan::new(work, &held.job().input, &self.vault).await?;
        Ok(self.supervise_child(held, plan, ending).await??)
    }

    /// Runs the child; meanwhile reports its progress and renews the lease.
    pub(super) async fn supervise_child(
        &self,
        held: &mut HeldJob,
        plan: JobPlan,
        shutdown: &Shutdown,
    ) -> std::io::Result<Result<ChildOutput, AttemptFailure>> {
        let stop = StopSwitch::new()?;
        let (progress_sender, mut progress_seen) = watch::channel(0.0);
        let mut child = self.spawn_child(held.job(), plan, stop.clone(), progress_sender);
        let mut beat = self.clock.sleep(held.heartbeat_interval());
        let mut pause = self.clock.sleep(Duration::ZERO);
        let mut may_report = true;
        loop {
            let updated = tokio::select! {
                ended = &mut child => return Ok(ended.unwrap_or_else(|e| Err(AttemptFailure::Crashed(e.to_string())))),
                () = shutdown.begun() => { stop.pull(); return Ok(child.await.unwrap_or(Err(AttemptFailure::Stopped))) }
                () = &mut beat => {
                    beat = self.clock.sleep(held.heartbeat_interval());
                    held.renew_lease().await
                }
                () = &mut pause, if !may_report => {
                    may_report = true;
                    Ok(())
                }
                Ok(()) = progress_seen.changed(), if may_report => {
                    (pause, may_report) = (self.clock.sleep(PROGRESS_INTERVAL), false);
                    let progress = *progress_seen.borrow_and_update();
                    held.progress(progress).await
                }
            };
            match updated {
                Ok(()) => {}
                Err(error) if is_lease_lost(&error) => stop.pull(),
                // The lease lasts for several heartbeats. If the store is unavailable for longer, the lease is lost by
                // then.
                Err(error) => {
                    tracing::warn!(%error, job = %held.job().id, "lease renewal failed; retrying at the next heartbeat")
                }
            }
        }
    }

    /// Runs `work` on a blocking thread and renews the lease meanwhile.
    pub(super) async fn run_blocking<T: Send + 'static>(
        &self,
        held: &HeldJob,
        ending: &Shutdown,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, WorkError> {
        let mut work = tokio::task::spawn_blocking(work);
        loop {
            tokio::select! {
                ended = &mut work => return ended.map_err(|panic| WorkError::Crashed(panic.to_string())),
                () = ending.begun() => return Err(WorkError::Stopped),
                () = self.clock.sleep(held.heartbeat_interval()) => held.renew_lease().await?,
            }
        }
    }

    /// Trocar positions from earlier sessions, once none of those sessions is being tracked.
    pub(super) async fn earlier_ports(
        &self,
        held: &HeldJob,
        mut earlier: EarlierSessions,
        ending: &Shutdown,
    ) -> Result<Ports, WorkError> {
        let mut beat = self.clock.sleep(held.heartbeat_interval());
        loop {
            if let Some(ports) = earlier.ports(&self.store).await? {
                return Ok(ports);
            }
            tokio::select! {
                () = ending.begun() => return Err(WorkError::Stopped),
                () = &mut beat => {
                    beat = self.clock.sleep(held.heartbeat_interval());
                    held.renew_lease().await?;
                }
                () = self.clock.sleep(PROGRESS_INTERVAL) => {}
            }
        }
    }

    /// Starts the child on a blocking thread, which lives as long as the child. The thread's log lines name the job.
    fn spawn_child(
        &self,
        job: &JobRecord,
        plan: JobPlan,
        stop: StopSwitch,
        progress: watch::Sender<f64>,
    ) -> tokio::task::JoinHandle<Result<ChildOutput, AttemptFailure>> {
        let budget = self.settings.budget_of(&plan.work);
        let (program, threads) = (self.program.clone(), self.settings.decoder_threads);
        let span = tracing::warn_span!("job", job = %job.id, session = job.session_id.map(tracing::field::display));
        tokio::task::spawn_blocking(move || {
            span.in_scope(|| attempt_plan(&program, &budget, threads, plan, &stop, &progress))
        })
    }
}

/// Ends a job that gave no result. If the database, the vault or the system failed, releases the job without counting
/// an attempt. A child that could not be run counts as a crash.
async fn settle_failure(held: &HeldJob, error: WorkError) -> Result<(), WorkError> {
    let problem = match error {
        WorkError::Impossible(problem) => problem,
        WorkError::Store(StoreError::NotFound { what }) => deleted_problem(what),
        WorkError::Vault(VaultError::Damaged | VaultError::TooLong { .. }) => damaged_problem(),
        WorkError::Vault(VaultError::NotFound) => deleted_problem("file"),
        WorkError::Crashed(reason) => return Ok(held.report_crash(crash_problem(&reason)).await.map(drop)?),
        WorkError::Stopped => return Ok(held.release().await?),
        // The sweep queues the job again when the lease runs out, and counts a lost lease, not an attempt.
        WorkError::NotStored(_) | WorkError::Released(_) => return Err(error),
        WorkError::Store(_) | WorkError::Vault(_) | WorkError::System(_) => {
            held.release().await?;
            return Err(WorkError::Released(Box::new(error)));
        }
    };
    Ok(held.fail(problem).await.map(drop)?)
}

fn attempt_plan(
    program: &Program,
    budget: &Budget,
    threads: usize,
    plan: JobPlan,
    stop: &StopSwitch,
    progress_sender: &watch::Sender<f64>,
) -> Result<ChildOutput, AttemptFailure> {
    let request = ChildRequest { threads, work: plan.work };
    let (result, cost) = run_attempt(ChildAttempt { program, request, inputs: plan.inputs, budget, stop }, |event| {
        if let ChildEvent::Progress(progress) = event {
            progress_sender.send_replace(progress);
        }
    });
    tracing::debug!(
        wall_ms = cost.wall.as_millis() as u64,
        cpu_ms = cost.cpu.as_millis() as u64,
        peak_rss_bytes = cost.peak_rss_bytes,
        output_bytes = cost.output_bytes,
        "child process ended"
    );
    result
}

fn crash_problem(reason: &str) -> Problem {
    let detail =
        format!("the analysis process {reason}; once no attempts are left, it is not tried again automatically");
    Problem::new("analysis-crashed", "The analysis process failed on this file", detail)
}

fn damaged_problem() -> Problem {
    let detail = "a stored file that this analysis needs is damaged: restore it from a backup, then try again";
    Problem::new("input-damaged", "A file that the analysis needs is damaged", detail)
}

fn deleted_problem(what: &str) -> Problem {
    let detail = format!("the {what} that this analysis needs has been deleted");
    Problem::new("input-gone", "A file that the analysis needs was deleted", detail)
}
