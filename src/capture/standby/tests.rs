//! An agent that stands by, without a server: recordings, their controls, and their files.

use std::io::Write;
use std::process::Command;

use tokio::io::AsyncReadExt;
use tokio::time::timeout;

use super::recording::StartPress;
use super::refusal::BoxRefusal;
use super::unnamed::{FileOutcome, UnnamedFile};
use super::*;
use crate::capture::spool::Spool;
use crate::domain::box_agent::messages::{NamedTrainee, StopTarget};
use crate::media::{CaptureSource, MediaLimits, VideoFile};
use crate::time::{Clock, SystemClock};

/// How long a state may take to come.
const DEADLINE: Duration = Duration::from_secs(20);

struct Bench {
    _folder: tempfile::TempDir,
    standby: Standby,
    /// What happened to the camera's controls, in order.
    controls: Arc<Mutex<Vec<&'static str>>>,
    /// The files that were sent, with the number of their pictures.
    sent: Arc<Mutex<Vec<(UnnamedFile, u64)>>>,
    shutdown: Shutdown,
}

/// Answers to the files that are sent; without an answer, a file is received.
type Answers = Arc<dyn Fn(&UnnamedFile) -> Option<FileOutcome> + Send + Sync>;

/// An agent whose camera is a clip of one second: its end is that of a camera that is plugged in again at once.
fn bench() -> Bench {
    let folder = tempfile::tempdir().unwrap();
    let spool = folder.path().join("spool");
    bench_with(folder, &spool, "boot 1", Arc::new(|_| None))
}

/// The same with this spool, after this start of the computer.
fn bench_with(folder: tempfile::TempDir, spool: &std::path::Path, boot: &str, answers: Answers) -> Bench {
    make_clip(folder.path(), "testsrc2=size=64x48:rate=25", 1);
    bench_with_clip(folder, spool, boot, answers)
}

/// The clip that the camera shows: what this filter of FFmpeg draws.
fn make_clip(folder: &std::path::Path, filter: &str, seconds: u32) {
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-v", "error", "-f", "lavfi", "-i", filter, "-t", &seconds.to_string(), "-c:v", "mjpeg"]);
    assert!(ffmpeg.arg(folder.join("camera.avi")).status().unwrap().success());
}

fn bench_with_clip(folder: tempfile::TempDir, spool: &std::path::Path, boot: &str, answers: Answers) -> Bench {
    let clip = folder.path().join("camera.avi");
    let address = clip.to_str().unwrap().to_owned();
    let open: crate::capture::source::OpenSource =
        Arc::new(move |stop| CaptureSource::open(&address, &[], move || stop.load(Ordering::Relaxed)));
    let controls: Arc<Mutex<Vec<&'static str>>> = Arc::default();
    let sent: Arc<Mutex<Vec<(UnnamedFile, u64)>>> = Arc::default();
    let received = sent.clone();
    let send_file: SendFile = Arc::new(move |file| {
        let (received, answers) = (received.clone(), answers.clone());
        Box::pin(async move {
            let pictures = pictures_of(&file).await;
            let answer = answers(&file).unwrap_or(FileOutcome::Received);
            received.lock().unwrap().push((file, pictures));
            answer
        })
    });
    std::fs::write(folder.path().join("token"), "trc_x").unwrap();
    let shutdown = Shutdown::new();
    let standby = Standby::new(StandbyParts {
        agent: Agent::new(Spool::open(spool, 1 << 30).unwrap()),
        server: Server::new("http://127.0.0.1:9", "box-1", &folder.path().join("token")).unwrap(),
        camera: CameraKeeper::new(open, Duration::from_secs(5), Duration::from_secs(60), false),
        spool: spool.to_owned(),
        clock: Arc::new(SystemClock),
        boot: boot.to_owned(),
        hold_controls: Some(noted_controls(&controls)),
        send_file,
        requires_check_in: false,
        starts_on_movement: false,
        movement_patience: Duration::from_secs(3),
        shutdown: shutdown.clone(),
    });
    tokio::spawn({
        let standby = standby.clone();
        async move { standby.run().await }
    });
    Bench { _folder: folder, standby, controls, sent, shutdown }
}

/// The number of pictures in a file that is sent.
async fn pictures_of(file: &UnnamedFile) -> u64 {
    let mut bytes = Vec::new();
    (file.open)().read_to_end(&mut bytes).await.unwrap();
    assert_eq!(bytes.len() as u64, file.bytes);
    let mut copy = tempfile::tempfile().unwrap();
    copy.write_all(&bytes).unwrap();
    let mut video = VideoFile::open(copy, MediaLimits::default()).unwrap();
    std::iter::from_fn(|| video.next_picture().unwrap().map(drop)).count() as u64
}

/// Controls that note when they are held and released.
fn noted_controls(controls: &Arc<Mutex<Vec<&'static str>>>) -> HoldControls {
    let noted = controls.clone();
    Arc::new(move |release, _, is_held| {
        let noted = noted.clone();
        Box::pin(async move {
            noted.lock().unwrap().push("held");
            is_held.store(true, Ordering::Release);
            release.begun().await;
            noted.lock().unwrap().push("released");
            is_held.store(false, Ordering::Release);
        })
    })
}

/// The clock was compared with the server, which is behind by so much.
fn compare_clock(standby: &Standby, behind_ms: i64) {
    assert!(standby.note_clock(ClockState { offset_ms: -behind_ms, uncertainty_ms: 1 }));
    standby.0.spool_changed.notify_one();
}

impl Bench {
    /// Records some frames without a name.
    async fn record(&self) {
        self.until(|bench| bench.standby.state().camera.is_open).await;
        self.standby.start_at_box(StartPress::Start).unwrap();
        self.until(|bench| bench.standby.state().recording.unwrap().frames > 5).await;
        self.standby.stop().await.unwrap();
    }

    /// Waits until the agent is in such a state.
    async fn until(&self, wanted: impl Fn(&Self) -> bool) {
        let reached = timeout(DEADLINE, async {
            while !wanted(self) {
                let version = self.standby.screen_state().version;
                let _ = timeout(Duration::from_millis(20), self.standby.changed_since(version)).await;
            }
        });
        reached.await.expect("the state is reached in time");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_controls_are_held_again_when_the_camera_is_back_and_a_recording_without_a_name_is_sent_as_a_file() {
    let bench = bench();
    bench.until(|bench| bench.standby.state().camera.is_open).await;
    bench.standby.start_at_box(StartPress::Start).unwrap();
    bench.until(|bench| bench.controls.lock().unwrap().len() >= 3).await;
    assert_eq!(
        bench.controls.lock().unwrap()[..3],
        ["held", "released", "held"],
        "the first hold ends before the next"
    );
    let frames = bench.standby.state().recording.unwrap().frames;
    bench.until(|bench| bench.standby.state().recording.unwrap().frames > frames + 5).await;
    assert_eq!(bench.standby.state().camera.is_exposure_held, Some(true));
    bench.standby.stop().await.unwrap();
    // It began before the server was first heard of, and is not sent before its time is known.
    assert_eq!(bench.standby.screen_state().last_unnamed, Some(UnnamedState::Kept));
    let day_ms = 86_400_000;
    compare_clock(&bench.standby, day_ms);
    bench.until(|bench| bench.standby.screen_state().last_unnamed == Some(UnnamedState::Waits)).await;
    let (file, pictures) = bench.sent.lock().unwrap()[0].clone();
    assert!(file.filename.starts_with("box-1 20") && file.task.is_none(), "{}", file.filename);
    let recorded_ms = crate::time::from_rfc3339(file.recorded_at.as_deref().unwrap()).unwrap();
    let ago_ms = SystemClock.now_ms() - day_ms - recorded_ms;
    assert!((0..20_000).contains(&ago_ms), "{ago_ms} ms ago by the server's time");
    let captured = bench.standby.parts().agent.status().captured;
    assert_eq!(pictures, captured);
    bench.until(|bench| bench.controls.lock().unwrap().last() == Some(&"released")).await;
    assert_eq!(bench.standby.state().spool.recordings, 0);
    bench.shutdown.begin();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_from_before_the_servers_time_gets_the_right_one_after_a_restart_of_the_agent_only() {
    let day_ms = 86_400_000;
    let bench = bench();
    bench.record().await;
    assert!(bench.sent.lock().unwrap().is_empty(), "its time is not known");
    let spool = bench.standby.parts().spool.clone();
    for (boot, is_corrected) in [("boot 1", true), ("boot 2", false)] {
        let folder = tempfile::tempdir().unwrap();
        let copy = folder.path().join("spool");
        assert!(Command::new("cp").arg("-r").arg(&spool).arg(&copy).status().unwrap().success());
        let restarted = bench_with(folder, &copy, boot, Arc::new(|_| None));
        compare_clock(&restarted.standby, day_ms);
        restarted.until(|bench| bench.standby.state().spool.recordings == 0).await;
        let (file, _) = restarted.sent.lock().unwrap()[0].clone();
        let ago_ms = |at: &str| SystemClock.now_ms() - day_ms - crate::time::from_rfc3339(at).unwrap();
        match file.recorded_at.as_deref() {
            Some(at) => assert!(is_corrected && (0..20_000).contains(&ago_ms(at)), "{at}"),
            None => assert!(!is_corrected && file.filename == "box-1.mp4", "{}", file.filename),
        }
        restarted.shutdown.begin();
    }
    bench.shutdown.begin();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_that_cannot_be_sent_does_not_keep_the_next_one_from_being_sent() {
    let folder = tempfile::tempdir().unwrap();
    let spool = folder.path().join("spool");
    let first: Arc<Mutex<Option<FeedId>>> = Arc::default();
    let answers: Answers = Arc::new(move |file| {
        let is_first = *first.lock().unwrap().get_or_insert(file.recording) == file.recording;
        is_first.then(|| FileOutcome::Failed("the server has an internal error".to_owned()))
    });
    let bench = bench_with(folder, &spool, "boot 1", answers);
    bench.record().await;
    bench.record().await;
    compare_clock(&bench.standby, 0);
    bench.until(|bench| bench.standby.screen_state().last_unnamed == Some(UnnamedState::Waits)).await;
    assert_eq!(bench.sent.lock().unwrap().len(), 4, "three attempts, and the other recording");
    let state = bench.standby.state().spool;
    assert_eq!((state.recordings, state.refused.as_deref()), (1, Some("the server has an internal error")));
    bench.shutdown.begin();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_without_a_name_ends_before_its_file_is_longer_than_the_server_takes() {
    const MAX_FILE_BYTES: u64 = 60_000;
    let bench = bench();
    bench.until(|bench| bench.standby.state().camera.is_open).await;
    bench.standby.facts().max_file_bytes = Some(MAX_FILE_BYTES);
    bench.standby.start_at_box(StartPress::Start).unwrap();
    bench.until(|bench| bench.standby.screen_state().reached_limit == Some(UnnamedLimit::FileSize)).await;
    compare_clock(&bench.standby, 0);
    bench.until(|bench| bench.standby.screen_state().last_unnamed == Some(UnnamedState::Waits)).await;
    let (file, pictures) = bench.sent.lock().unwrap()[0].clone();
    assert!((MAX_FILE_BYTES / 2..=MAX_FILE_BYTES).contains(&file.bytes), "{} bytes, {pictures} pictures", file.bytes);
    bench.shutdown.begin();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_wait_for_a_movement_ends_if_nothing_moves_and_with_another_person() {
    let folder = tempfile::tempdir().unwrap();
    let spool = folder.path().join("spool");
    make_clip(folder.path(), "color=c=gray:size=64x48:rate=25", 60);
    let bench = bench_with_clip(folder, &spool, "boot 1", Arc::new(|_| None));
    let (ada, bob) = (trainee("ada"), trainee("bob"));
    bench.until(|bench| bench.standby.state().camera.is_open).await;
    let began = Instant::now();
    bench.standby.await_movement(ada.clone(), task()).unwrap();
    bench.until(|bench| bench.standby.state().awaited_start.is_some_and(|awaited| awaited.is_picture_still)).await;
    bench.until(|bench| bench.standby.state().awaited_start.is_none()).await;
    assert!(began.elapsed() >= Duration::from_secs(3) && bench.standby.state().recording.is_none());

    bench.standby.await_movement(ada, task()).unwrap();
    let checked_in = CheckedIn { trainee: bob, task: None, tasks: vec![task()], last: None, idle_s: 600 };
    bench.standby.note_checked_in(Some(checked_in), None);
    assert!(bench.standby.state().awaited_start.is_none(), "another trainee is at the box");
    assert!(bench.standby.await_movement(trainee("ada"), task()).is_err(), "as above");
    bench.shutdown.begin();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stop_ends_what_it_was_meant_for_and_not_what_has_begun_since() {
    let bench = bench();
    let (ada, other) = (trainee("ada"), TraineeId::at(1));
    bench.until(|bench| bench.standby.state().camera.is_open).await;
    bench.standby.await_movement(ada.clone(), task()).unwrap();
    let of_other = bench.standby.stop_target(StopTarget::AwaitedStart(other)).await;
    assert_eq!((of_other, bench.standby.state().awaited_start.is_some()), (Err(BoxRefusal::StopTooLate), true));
    bench.standby.stop_target(StopTarget::AwaitedStart(ada.id)).await.unwrap();
    assert!(bench.standby.state().awaited_start.is_none());

    // An examiner's order begins while the stop of the wait is on its way.
    let attempt = FeedId::at(SystemClock.now_ms());
    bench.standby.start(attempt, Some(ada.clone()), Some(task())).unwrap();
    for late in [StopTarget::AwaitedStart(ada.id), StopTarget::Recording(FeedId::at(1))] {
        assert_eq!(bench.standby.stop_target(late).await, Err(BoxRefusal::StopTooLate));
    }
    assert_eq!(bench.standby.state().recording.unwrap().recording, attempt);
    bench.standby.stop_target(StopTarget::Recording(attempt)).await.unwrap();
    bench.until(|bench| bench.standby.state().recording.is_none()).await;
    bench.shutdown.begin();
}

fn trainee(name: &str) -> NamedTrainee {
    NamedTrainee { id: TraineeId::at(SystemClock.now_ms()), name: name.to_owned() }
}

fn task() -> NamedTask {
    NamedTask { id: TaskId::at(SystemClock.now_ms()), name: "peg".to_owned() }
}
