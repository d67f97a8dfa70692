//! The worker pool: each worker takes one job at a time, runs its child process and saves the result.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;
use tokio::task::JoinError;

use super::attempt::{AttemptFailure, ChildAttempt, run_attempt};
use super::job_plan::{BoxContext, EarlierSessions, JobPlan};
use super::output_validator::{ChildEvent, ChildOutput};
use super::protocol::{ChildRequest, ChildWork};
use super::results::{self, ProductError, TrackResult};
use super::settings::AnalysisSettings;
use crate::domain::job::JobInput;
use crate::domain::problem::Problem;
use crate::domain::session::NewResult;
use crate::motion::quality::ports::Ports;
use crate::queue::{HeldJob, Queue, is_lease_lost};
use crate::sandbox::{Budget, Program, StopSwitch};
use crate::shutdown::Shutdown;
use crate::store::{Store, StoreError};
use crate::time::{SharedClock, to_rfc3339};
use crate::vault::{PinnedBlob, Vault, VaultError};

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
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The vault failed.
    #[error(transparent)]
    Vault(#[from] VaultError),
    /// The system refused a thread, a descriptor or memory.
    #[error("preparing the child process failed: {0}")]
    System(#[from] std::io::Error),
}

impl From<Problem> for WorkError {
    fn from(problem: Problem) -> Self {
        WorkError::Impossible(problem)
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
                Err(WorkError::Store(error)) if is_lease_lost(&error) => {
                    tracing::info!(%job, worker = name, "lease lost: another worker owns the job; result discarded");
                }
                Err(error) => {
                    tracing::error!(
                        %error, %job, worker = name,
                        "job failed on this machine; retried later, pausing 5 s"
                    );
                    tokio::select! { () = shutdown.begun() => {}, () = self.clock.sleep(BACKOFF) => {} }
                }
            }
        }
    }

    /// Runs one job until it is finished, failed or released.
    async fn run_job(&self, mut held: HeldJob, shutdown: &Shutdown) -> Result<(), WorkError> {
        let now = to_rfc3339(self.clock.now_ms());
        let orders = match JobPlan::for_job(&held.job().input, &self.store, &self.vault, &now).await {
            Ok(Some(orders)) => orders,
            Ok(None) => return self.score_without_tracking(held, shutdown).await,
            Err(error) => return self.settle_failure(held, error).await,
        };
        let (tools, known, earlier) = (tool_names(&orders.work), orders.context.clone(), orders.earlier_sessions);
        match self.supervise_child(&mut held, orders, shutdown).await {
            Ok(Ok(heard)) => match self.earlier_ports(&held, earlier, shutdown).await {
                Ok(Some(ports)) => self.save(held, tools, BoxContext { ports, ..known }, heard).await,
                Ok(None) => Ok(held.release().await?),
                Err(error) => self.settle_failure(held, error.into()).await,
            },
            Ok(Err(AttemptFailure::Impossible(problem))) => Ok(held.fail(problem).await.map(drop)?),
            Ok(Err(AttemptFailure::Crashed(reason))) => {
                Ok(held.report_crash(crash_problem(&reason)).await.map(drop)?)
            }
            Ok(Err(AttemptFailure::Stopped)) => Ok(held.release().await?),
            Err(error) => self.settle_failure(held, error.into()).await,
        }
    }

    /// Fails a job that cannot be done. If the machine failed, releases the job without counting an attempt.
    pub(super) async fn settle_failure(&self, held: HeldJob, error: WorkError) -> Result<(), WorkError> {
        match error {
            WorkError::Impossible(problem) => Ok(held.fail(problem).await.map(drop)?),
            WorkError::Store(StoreError::NotFound { what }) => Ok(held.fail(deleted_problem(what)).await.map(drop)?),
            WorkError::Vault(VaultError::Damaged | VaultError::TooLong { .. }) => {
                Ok(held.fail(damaged_problem()).await.map(drop)?)
            }
            WorkError::Vault(VaultError::NotFound) => Ok(held.fail(deleted_problem("file")).await.map(drop)?),
            error => {
                held.release().await?;
                Err(error)
            }
        }
    }

    /// Runs the child; meanwhile reports its progress and renews the lease.
    async fn supervise_child(
        &self,
        held: &mut HeldJob,
        orders: JobPlan,
        shutdown: &Shutdown,
    ) -> std::io::Result<Result<ChildOutput, AttemptFailure>> {
        let stop = StopSwitch::new()?;
        let (progress_sender, mut progress_seen) = watch::channel(0.0);
        let mut child = self.spawn_child(orders, stop.clone(), progress_sender);
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

    /// Trocar positions from earlier sessions, once none of those sessions is being tracked; `None` if the service
    /// shuts down.
    pub(super) async fn earlier_ports(
        &self,
        held: &HeldJob,
        earlier: Option<EarlierSessions>,
        ending: &Shutdown,
    ) -> Result<Option<Ports>, StoreError> {
        let Some(mut earlier) = earlier else { return Ok(Some(Ports::default())) };
        let mut beat = self.clock.sleep(held.heartbeat_interval());
        loop {
            if let Some(ports) = earlier.ports(&self.store).await? {
                return Ok(Some(ports));
            }
            tokio::select! {
                () = ending.begun() => return Ok(None),
                () = &mut beat => {
                    beat = self.clock.sleep(held.heartbeat_interval());
                    held.renew_lease().await?;
                }
                () = self.clock.sleep(PROGRESS_INTERVAL) => {}
            }
        }
    }

    /// Starts the child on a blocking thread, which lives as long as the child.
    fn spawn_child(
        &self,
        orders: JobPlan,
        stop: StopSwitch,
        progress: watch::Sender<f64>,
    ) -> tokio::task::JoinHandle<Result<ChildOutput, AttemptFailure>> {
        let (program, budget, threads) = (self.program.clone(), self.settings.budget(), self.settings.decoder_threads);
        tokio::task::spawn_blocking(move || run_child(&program, &budget, threads, orders, &stop, &progress))
    }

    /// Stores the child's output and ends the job in one transaction; files first, row second.
    async fn save(
        &self,
        held: HeldJob,
        tools: Vec<String>,
        known: BoxContext,
        heard: ChildOutput,
    ) -> Result<(), WorkError> {
        match held.job().input.clone() {
            JobInput::Track(input) => {
                let edits = match self.store.edits().in_force(input.session).await {
                    Ok(edits) => edits,
                    Err(error) => return self.settle_failure(held, error.into()).await,
                };
                let assess = move || TrackResult::new(&input, tools, &known, &edits, heard);
                self.save_tracking(held, tokio::task::spawn_blocking(assess).await).await
            }
            JobInput::Import(_) | JobInput::Rescore(_) => Ok(held.release().await?), // these jobs have no child
            JobInput::Palette(input) => match results::palette(&input.annotations, heard) {
                Ok(new) => {
                    held.finish(async |store, lease| store.jobs().finish_palette(lease, new).await).await?;
                    Ok(())
                }
                Err(error) => Ok(held.report_crash(crash_problem(&error.to_string())).await.map(drop)?),
            },
            JobInput::Advise(_) => match results::advice(heard) {
                Ok(advice) => {
                    Ok(held.finish(async |store, lease| store.jobs().finish_advice(lease, advice).await).await?)
                }
                Err(error) => Ok(held.report_crash(crash_problem(&error.to_string())).await.map(drop)?),
            },
            JobInput::SelfTest(input) => match results::self_test(&input, heard) {
                Ok(new) => {
                    Ok(held.finish(async |store, lease| store.jobs().finish_self_test(lease, new).await).await?)
                }
                Err(error) => Ok(held.report_crash(crash_problem(&error.to_string())).await.map(drop)?),
            },
            JobInput::Calibrate(input) => match results::calibration(input.is_video, heard) {
                Ok(new) => {
                    held.finish(async |store, lease| store.jobs().finish_calibration(lease, new).await).await?;
                    Ok(())
                }
                Err(error) => Ok(held.report_crash(crash_problem(&error.to_string())).await.map(drop)?),
            },
        }
    }

    async fn save_tracking(
        &self,
        held: HeldJob,
        assessed: Result<Result<TrackResult, ProductError>, JoinError>,
    ) -> Result<(), WorkError> {
        let tracked = match assessed {
            Ok(Ok(tracked)) => tracked,
            Ok(Err(error)) => return Ok(held.report_crash(crash_problem(&error.to_string())).await.map(drop)?),
            Err(panic) => return Ok(held.report_crash(crash_problem(&panic.to_string())).await.map(drop)?),
        };
        match self.put_files(tracked).await {
            Ok((result, _kept)) => {
                Ok(held.finish(async |store, lease| store.jobs().finish_track(lease, result).await).await?)
            }
            Err(error) => self.settle_failure(held, error.into()).await,
        }
    }

    /// Puts a result's files into the vault, which protects them from garbage collection until their row exists.
    async fn put_files(&self, tracked: TrackResult) -> Result<(NewResult, Vec<PinnedBlob>), VaultError> {
        let trajectory = self.vault.put(&tracked.paths).await?;
        let diagnostics = self.vault.put(&tracked.diagnostics).await?;
        let preview = match &tracked.preview {
            Some(jpeg) => Some(self.vault.put(jpeg).await?),
            None => None,
        };
        let result = NewResult {
            versions: tracked.versions,
            edits: tracked.edits,
            video: tracked.video,
            tools: tracked.tools,
            features: tracked.features,
            evidence: tracked.evidence,
            quality: tracked.quality,
            score: None,
            trajectory: trajectory.blob(),
            diagnostics: Some(diagnostics.blob()),
            preview: preview.as_ref().map(PinnedBlob::blob),
        };
        Ok((result, [Some(trajectory), Some(diagnostics), preview].into_iter().flatten().collect()))
    }
}

fn run_child(
    program: &Program,
    budget: &Budget,
    threads: usize,
    orders: JobPlan,
    stop: &StopSwitch,
    progress_sender: &watch::Sender<f64>,
) -> Result<ChildOutput, AttemptFailure> {
    let request = ChildRequest { threads, work: orders.work };
    let (result, cost) = run_attempt(ChildAttempt { program, request, inputs: orders.inputs, budget, stop }, |event| {
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

/// The tool names in the child's order.
fn tool_names(work: &ChildWork) -> Vec<String> {
    match work {
        ChildWork::Track(track) => track.tools.iter().map(|tool| tool.name.clone()).collect(),
        _ => Vec::new(), // no other work has rows per tool
    }
}

pub(super) fn crash_problem(reason: &str) -> Problem {
    let detail = format!("the analysis process {reason}; after three attempts it is not tried again automatically");
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
