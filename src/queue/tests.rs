//! Tests of the queue on a manual clock: despite all failures of workers, every job ends, every session has one result,
//! and late writes change nothing.

use std::io;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use futures_util::future::join_all;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

use super::{HeldJob, Queue, QueueSettings, is_lease_lost};
use crate::domain::job::JobState;
use crate::domain::problem::Problem;
use crate::domain::scope::Scope;
use crate::events::EventBus;
use crate::shutdown::Shutdown;
use crate::store::testing::TestCentre;
use crate::store::{MAX_LOST_LEASES, PageRequest, SessionFilter, StoreError};

struct QueueFixture {
    centre: TestCentre,
    queue: Queue,
}

impl QueueFixture {
    /// A queue with `jobs` recordings of one trainee.
    async fn with_jobs(jobs: usize) -> Self {
        let centre = TestCentre::with_camera_and_colours().await;
        let trainee = centre.trainee("Ana").await.id;
        let contents: Vec<String> = (0..jobs).map(|job| format!("recording {job}")).collect();
        for some in contents.chunks(20) {
            join_all(some.iter().map(|content| centre.session(trainee, content))).await;
        }
        let queue = Self::queue(&centre);
        Self { centre, queue }
    }

    fn queue(centre: &TestCentre) -> Queue {
        Queue::new(centre.store.clone(), QueueSettings::default(), EventBus::new(), centre.clock.clone())
    }

    async fn claim(&self) -> Option<HeldJob> {
        self.queue.claim("worker").await.unwrap()
    }

    async fn finish(&self, held: HeldJob) -> Result<(), StoreError> {
        let session = held.job().session_id.unwrap();
        let result = self.centre.result(session).await;
        held.finish(async move |store, lease| store.jobs().finish_track(lease, result).await).await
    }

    fn advance_clock(&self, seconds: u64) {
        self.centre.clock.advance(Duration::from_secs(seconds));
    }

    async fn state(&self, held: &HeldJob) -> JobState {
        self.centre.store.jobs().get(&Scope::service(), held.job().id).await.unwrap().state
    }
}

fn problem(detail: &str) -> Problem {
    Problem::new("child-died", "The tracking process died", detail)
}

#[tokio::test]
async fn the_job_of_a_silent_worker_goes_to_another_and_its_late_result_is_discarded() {
    let bench = QueueFixture::with_jobs(1).await;
    let paused = bench.claim().await.unwrap();
    bench.advance_clock(29);
    assert_eq!(bench.queue.sweep().await.unwrap(), 0);
    bench.advance_clock(1);
    assert_eq!(bench.queue.sweep().await.unwrap(), 1);
    let second = bench.claim().await.unwrap();
    assert!(is_lease_lost(&paused.renew_lease().await.unwrap_err()));
    assert!(is_lease_lost(&bench.finish(paused).await.unwrap_err()));
    assert_eq!(bench.state(&second).await, JobState::Running);
    bench.finish(second).await.unwrap();
}

#[tokio::test]
async fn a_worker_that_sends_heartbeats_keeps_its_job() {
    let bench = QueueFixture::with_jobs(1).await;
    let mut held = bench.claim().await.unwrap();
    for step in 1..=10 {
        bench.advance_clock(20);
        held.progress(f64::from(step) / 10.0).await.unwrap();
        assert_eq!(bench.queue.sweep().await.unwrap(), 0);
    }
    bench.finish(held).await.unwrap();
}

#[tokio::test]
async fn a_quarantine_is_logged_with_job_and_session() {
    let bench = QueueFixture::with_jobs(1).await;
    let log = Arc::new(Mutex::new(Vec::new()));
    let written = log.clone();
    let subscriber = tracing_subscriber::fmt().with_ansi(false).with_writer(move || LogWriter(written.clone()));
    let logging = tracing::subscriber::set_default(subscriber.finish());
    let mut job = None;
    for _ in 0..3 {
        let held = bench.claim().await.unwrap();
        job = Some(held.report_crash(problem("signal 11")).await.unwrap());
    }
    drop(logging);
    let (job, log) = (job.unwrap(), String::from_utf8(log.lock().unwrap().clone()).unwrap());
    let quarantines: Vec<&str> = log.lines().filter(|line| line.contains("quarantined")).collect();
    let [line] = quarantines[..] else { panic!("one quarantine in\n{log}") };
    assert!(line.contains(&format!("job={}", job.id)), "{line}");
    assert!(line.contains(&format!("session={}", job.session_id.unwrap())), "{line}");
}

/// Appends to a log in memory.
struct LogWriter(Arc<Mutex<Vec<u8>>>);

impl io::Write for LogWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[tokio::test]
async fn three_crashes_quarantine_a_job_with_the_reason_and_a_person_can_try_again() {
    let bench = QueueFixture::with_jobs(1).await;
    for attempt in 1..=3 {
        let held = bench.claim().await.unwrap();
        assert_eq!(held.job().attempt, attempt);
        held.report_crash(problem("signal 11")).await.unwrap();
    }
    assert!(bench.claim().await.is_none());
    let service = Scope::service();
    let sessions = &bench.centre.store.sessions();
    let session = sessions.list(&service, &SessionFilter::default(), &PageRequest::default()).await.unwrap();
    let session = session.items.into_iter().next().unwrap();
    assert!(session.is_quarantined() && session.problem().unwrap().detail == "signal 11");
    sessions.retry(&service, session.id).await.unwrap();
    let held = bench.claim().await.unwrap();
    assert_eq!(held.job().attempt, 1);
    bench.finish(held).await.unwrap();
}

#[tokio::test]
async fn a_job_that_kills_the_whole_service_is_quarantined_after_many_starts() {
    let bench = QueueFixture::with_jobs(1).await;
    let store = &bench.centre.store;
    for _ in 0..MAX_LOST_LEASES {
        let held = bench.claim().await.unwrap();
        assert_eq!(held.job().attempt, 1);
        assert_eq!(QueueFixture::queue(&bench.centre).recover().await.unwrap(), 1); // a new process of the service
        let problem = store.jobs().get(&Scope::service(), held.job().id).await.unwrap().problem.unwrap();
        assert!(problem.detail.contains("10 times"), "{problem:?}");
    }
    assert!(bench.claim().await.is_none());
    assert_eq!(store.jobs().counts().await.unwrap().quarantined, 1);
}

#[tokio::test]
async fn deaths_of_the_service_and_lost_leases_use_up_no_attempt() {
    let bench = QueueFixture::with_jobs(1).await;
    for _ in 0..2 {
        bench.claim().await.unwrap().report_crash(problem("signal 11")).await.unwrap();
    }
    for _ in 0..2 {
        drop(bench.claim().await.unwrap());
        assert_eq!(QueueFixture::queue(&bench.centre).recover().await.unwrap(), 1); // a new process of the service
        drop(bench.claim().await.unwrap());
        bench.advance_clock(30);
        assert_eq!(bench.queue.sweep().await.unwrap(), 1);
    }
    let third = bench.claim().await.unwrap();
    assert_eq!(third.job().attempt, 3, "four lost leases lie between");
    third.report_crash(problem("signal 11")).await.unwrap();
    assert!(bench.claim().await.is_none(), "the third crash is the last");
}

#[tokio::test]
async fn a_released_job_waits_at_its_old_position_and_counts_no_attempt() {
    let bench = QueueFixture::with_jobs(2).await;
    let first = bench.claim().await.unwrap();
    let id = first.job().id;
    first.release().await.unwrap();
    let again = bench.claim().await.unwrap();
    assert_eq!((again.job().id, again.job().attempt), (id, 1));
}

#[tokio::test]
async fn a_session_that_is_erased_while_it_is_tracked_leaves_nothing_behind() {
    let bench = QueueFixture::with_jobs(1).await;
    let held = bench.claim().await.unwrap();
    let session = held.job().session_id.unwrap();
    bench.centre.store.sessions().erase(&Scope::service(), session).await.unwrap();
    assert!(is_lease_lost(&bench.finish(held).await.unwrap_err()));
    assert_eq!(bench.centre.store.blobs().all(None, 10).await.unwrap().len(), 1); // the recording, until collected
    assert_eq!(bench.centre.store.blobs().unreferenced(10).await.unwrap().len(), 1);
}

#[tokio::test]
async fn many_workers_at_once_never_get_the_same_job() {
    let bench = QueueFixture::with_jobs(60).await;
    let claims = join_all((0..80).map(|_| bench.claim())).await;
    let mut ids: Vec<_> = claims.iter().flatten().map(|held| held.job().id).collect();
    ids.sort();
    ids.dedup();
    assert_eq!(ids.len(), 60);
}

#[tokio::test]
async fn an_idle_worker_wakes_when_work_arrives_and_when_the_service_ends() {
    let bench = QueueFixture::with_jobs(0).await;
    let shutdown = Shutdown::new();
    let trainee = bench.centre.trainee("Ben").await.id;
    let waiting = bench.queue.next("worker", &shutdown);
    let arriving = async {
        bench.centre.session(trainee, "late recording").await;
        bench.queue.work_arrived();
    };
    let (held, ()) = tokio::join!(waiting, arriving);
    bench.finish(held.unwrap()).await.unwrap();
    let (none, ()) = tokio::join!(bench.queue.next("worker", &shutdown), async { shutdown.begin() });
    assert!(none.is_none());
}

#[tokio::test]
async fn every_job_ends_and_every_session_has_one_result() {
    for seed in 0..3 {
        random_life(100, seed).await;
    }
}

/// The same with many jobs; `make long-queue` runs it. The data are in memory (`TMPDIR=/dev/shm`), since 60,000
/// sequential commits take half an hour on a disk, and this property is not about durability.
#[tokio::test]
#[ignore = "takes minutes"]
async fn every_one_of_ten_thousand_jobs_ends() {
    random_life(10_000, 1).await;
}

/// Workers claim, send heartbeats, finish, crash, stop responding and return too late; the service ends and starts
/// again.
async fn random_life(jobs: usize, seed: u64) {
    let bench = QueueFixture::with_jobs(jobs).await;
    let mut chance = StdRng::seed_from_u64(seed);
    let (mut working, mut zombies) = (Vec::new(), Vec::new());
    let (mut refused, mut steps) = (0, 0);
    while open_jobs(&bench).await > 0 {
        steps += 1;
        assert!(steps < 100 * jobs, "no end in sight");
        bench.advance_clock(chance.random_range(0..4));
        match chance.random_range(0..100) {
            0..40 => working.extend(bench.claim().await),
            40..70 => {
                if let Some(held) = pick(&mut working, &mut chance) {
                    late_or(bench.finish(held).await, &mut refused);
                }
            }
            70..80 => {
                if let Some(mut held) = pick(&mut working, &mut chance) {
                    match held.progress(chance.random()).await {
                        Ok(()) => working.push(held),
                        late => late_or(late, &mut refused),
                    }
                }
            }
            80..86 => zombies.extend(pick(&mut working, &mut chance)),
            86..90 => {
                if let Some(held) = pick(&mut working, &mut chance) {
                    late_or(held.report_crash(problem("killed")).await.map(drop), &mut refused);
                }
            }
            90..92 => {
                if let Some(held) = pick(&mut working, &mut chance) {
                    late_or(held.release().await, &mut refused);
                }
            }
            92..98 => drop(bench.queue.sweep().await.unwrap()),
            98 => {
                zombies.append(&mut working); // their processes live on for a while as orphans
                bench.queue.recover().await.unwrap();
            }
            _ => retry_quarantined(&bench).await,
        }
    }
    for zombie in zombies {
        assert!(is_lease_lost(&bench.finish(zombie).await.unwrap_err()), "a zombie's result was accepted");
    }
    let service = Scope::service();
    let counts = bench.centre.store.jobs().counts().await.unwrap();
    assert_eq!((counts.queued, counts.running, counts.quarantined), (0, 0, 0));
    let results = bench.centre.store.count_results().await;
    assert_eq!(results, jobs as i64);
    let after = bench.centre.store.jobs().list(&service, true, &PageRequest::default()).await.unwrap();
    assert!(after.items.is_empty());
    eprintln!("seed {seed}: {jobs} jobs in {steps} steps, {refused} late writes refused");
}

async fn open_jobs(bench: &QueueFixture) -> i64 {
    let counts = bench.centre.store.jobs().counts().await.unwrap();
    counts.queued + counts.running + counts.quarantined
}

async fn retry_quarantined(bench: &QueueFixture) {
    let (service, jobs) = (Scope::service(), bench.centre.store.jobs());
    let all = jobs.list(&service, false, &PageRequest::new(200, None)).await.unwrap();
    for job in all.items.iter().filter(|job| job.state == JobState::Quarantined) {
        jobs.retry(&service, job.id).await.unwrap();
    }
    let which = SessionFilter { status: Some(crate::domain::session::SessionStatus::Failed), ..Default::default() };
    let failed = bench.centre.store.sessions().list(&service, &which, &PageRequest::new(200, None)).await.unwrap();
    for session in failed.items {
        bench.centre.store.sessions().retry(&service, session.id).await.unwrap();
    }
}

fn pick(working: &mut Vec<HeldJob>, chance: &mut StdRng) -> Option<HeldJob> {
    (!working.is_empty()).then(|| working.swap_remove(chance.random_range(0..working.len())))
}

fn late_or(outcome: Result<(), StoreError>, refused: &mut usize) {
    match outcome {
        Ok(()) => {}
        Err(error) if is_lease_lost(&error) => *refused += 1,
        Err(error) => panic!("{error}"),
    }
}

/// The clock stands still unless the test advances it, and so does the sweeper.
#[tokio::test]
async fn the_sweeper_runs_again_after_its_interval() {
    let bench = QueueFixture::with_jobs(1).await;
    let shutdown = Shutdown::new();
    let held = bench.claim().await.unwrap();
    let mut events = Arc::new(bench.queue.inner.events.clone()).subscribe();
    let sweeping = bench.queue.keep_sweeping(&shutdown);
    let turning = async {
        bench.advance_clock(31);
        loop {
            tokio::task::yield_now().await;
            bench.advance_clock(5);
            if bench.state(&held).await == JobState::Queued {
                return shutdown.begin();
            }
        }
    };
    tokio::join!(sweeping, turning);
    assert!(events.next().await.is_some());
}
