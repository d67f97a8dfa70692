//! An agent that stands by, without a server: recordings, their controls, and their files.

use std::process::Command;

use tokio::time::timeout;

use super::unnamed::{FileOutcome, UnnamedFile};
use super::*;
use crate::capture::spool::Spool;
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

/// An agent whose camera is a clip of one second: its end is that of a camera that is plugged in again at once.
fn bench() -> Bench {
    let folder = tempfile::tempdir().unwrap();
    let clip = folder.path().join("camera.avi");
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-v", "error", "-f", "lavfi", "-i", "testsrc2=size=64x48:rate=25", "-t", "1", "-c:v", "mjpeg"]);
    assert!(ffmpeg.arg(&clip).status().unwrap().success());
    let address = clip.to_str().unwrap().to_owned();
    let open: crate::capture::source::OpenSource =
        Arc::new(move |stop| CaptureSource::open(&address, &[], move || stop.load(Ordering::Relaxed)));
    let controls: Arc<Mutex<Vec<&'static str>>> = Arc::default();
    let noted = controls.clone();
    let hold_controls: HoldControls = Arc::new(move |release, _, is_held| {
        let noted = noted.clone();
        Box::pin(async move {
            noted.lock().unwrap().push("held");
            is_held.store(true, Ordering::Release);
            release.begun().await;
            noted.lock().unwrap().push("released");
            is_held.store(false, Ordering::Release);
        })
    });
    let sent: Arc<Mutex<Vec<(UnnamedFile, u64)>>> = Arc::default();
    let received = sent.clone();
    let send_file: SendFile = Arc::new(move |file| {
        let mut video = VideoFile::open(std::fs::File::open(&file.path).unwrap(), MediaLimits::default()).unwrap();
        let pictures = std::iter::from_fn(|| video.next_picture().unwrap().map(drop)).count() as u64;
        received.lock().unwrap().push((file, pictures));
        Box::pin(async { FileOutcome::Received })
    });
    std::fs::write(folder.path().join("token"), "trc_x").unwrap();
    let spool = folder.path().join("spool");
    let shutdown = Shutdown::new();
    let standby = Standby::new(StandbyParts {
        agent: Agent::new(Spool::open(&spool, 1 << 30).unwrap()),
        server: Server::new("http://127.0.0.1:9", "box-1", &folder.path().join("token")).unwrap(),
        camera: CameraKeeper::new(open, Duration::from_secs(5), Duration::from_secs(60), false),
        spool,
        clock: Arc::new(SystemClock),
        hold_controls: Some(hold_controls),
        send_file,
        requires_check_in: false,
        shutdown: shutdown.clone(),
    });
    tokio::spawn({
        let standby = standby.clone();
        async move { standby.run().await }
    });
    Bench { _folder: folder, standby, controls, sent, shutdown }
}

impl Bench {
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
    bench.standby.start_at_box().unwrap();
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
    assert!(bench.standby.note_clock(ClockState { offset_ms: -day_ms, uncertainty_ms: 1 }));
    bench.standby.note_change();
    bench.until(|bench| bench.standby.screen_state().last_unnamed == Some(UnnamedState::Waits)).await;
    let (file, pictures) = bench.sent.lock().unwrap()[0].clone();
    assert!(file.filename.starts_with("box-1 20") && file.task.is_none(), "{file:?}");
    let recorded_ms = crate::time::from_rfc3339(file.recorded_at.as_deref().unwrap()).unwrap();
    let ago_ms = SystemClock.now_ms() - day_ms - recorded_ms;
    assert!((0..20_000).contains(&ago_ms), "{ago_ms} ms ago by the server's time");
    let captured = bench.standby.parts().agent.status().captured;
    let gaps = 2; // at least one: the numbers of gaps hold no picture
    assert!((captured - gaps..captured).contains(&pictures), "{pictures} pictures of {captured} numbers");
    bench.until(|bench| bench.controls.lock().unwrap().last() == Some(&"released")).await;
    assert_eq!(bench.standby.state().spool.recordings, 0);
    bench.shutdown.begin();
}
