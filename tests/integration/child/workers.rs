//! Workers on a real store, vault and queue, with real children: the state of a job after each possible child end.

use std::sync::Arc;

use trocar::analysis::paths::SessionPaths;
use trocar::analysis::{AnalysisSettings, WorkerPool};
use trocar::domain::blob::Blob;
use trocar::domain::calibration::{CalibrationSource, NewCalibration};
use trocar::domain::files::annotations::AnnotationsFile;
use trocar::domain::files::camera::CameraFile;
use trocar::domain::job::{JobInput, JobState, NamedBlob, PaletteInput, TrackInput};
use trocar::domain::palette::ColourGrade;
use trocar::domain::scope::Scope;
use trocar::domain::session::{NewResult, NewSession, SessionStatus, Versions, VideoFacts};
use trocar::domain::text::Key;
use trocar::events::{Event, EventBus, EventDelivery, EventSubscriber};
use trocar::ids::{JobId, SessionId, TaskId, TraineeId};
use trocar::queue::{Queue, QueueSettings};
use trocar::shutdown::Shutdown;
use trocar::store::{BoxRecord, JobRecord, Store, StoreSettings};
use trocar::time::{ManualClock, SharedClock};
use trocar::vault::Vault;
use trocar::vision::trajectory::PathKind;

use super::tracking::SharedScene;
use super::*;
use crate::support::{captured_log, with_advancing_clock};

/// A centre with one box, trainee and task, whose workers a test starts.
struct Centre {
    store: Store,
    vault: Vault,
    queue: Queue,
    clock: Arc<ManualClock>,
    subscriber: EventSubscriber,
    shutdown: Shutdown,
    the_box: BoxRecord,
    trainee: TraineeId,
    task: TaskId,
    _folder: tempfile::TempDir,
}

impl Centre {
    async fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let clock = ManualClock::at(1_795_292_040_000);
        let shared: SharedClock = clock.clone();
        let store =
            Store::open(&folder.path().join("trocar.db"), &StoreSettings::default(), shared.clone()).await.unwrap();
        let vault = Vault::open(folder.path()).await.unwrap();
        let events = EventBus::new();
        let subscriber = events.subscribe();
        let queue = Queue::new(store.clone(), QueueSettings::default(), events, shared);
        let service = Scope::service();
        let named = |name: &str| serde_json::json!({ "name": name });
        let the_box = store.boxes().create(&service, serde_json::from_value(named("Box 1")).unwrap()).await.unwrap();
        let trainee =
            store.trainees().create(&service, serde_json::from_value(named("Ada")).unwrap()).await.unwrap().id;
        let task = store.tasks().create(&service, serde_json::from_value(named("Pegs")).unwrap()).await.unwrap().id;
        let shutdown = Shutdown::new();
        Self { store, vault, queue, clock, subscriber, shutdown, the_box, trainee, task, _folder: folder }
    }

    fn start_workers(&self, program: Program) {
        let workers = WorkerPool {
            store: self.store.clone(),
            vault: self.vault.clone(),
            queue: self.queue.clone(),
            clock: self.clock.clone(),
            settings: AnalysisSettings::default(),
            program,
        };
        workers.start_workers(1, &self.shutdown);
    }

    async fn calibrate(&self, camera: CameraFile) {
        let new = NewCalibration { camera, source: CalibrationSource::File, valid_from_ms: None };
        self.store.calibrations().add(&Scope::service(), self.the_box.id, new).await.unwrap();
    }

    async fn mark(&self, annotations: AnnotationsFile, clip: &[u8]) -> JobId {
        let kept = self.vault.put(clip).await.unwrap();
        let input = PaletteInput {
            of: self.the_box.id,
            annotations,
            files: vec![NamedBlob { name: "clip.mp4".into(), blob: kept.blob() }],
            is_video: true,
            frames: vec![],
            empty_box: None,
        };
        let job = self.store.jobs().enqueue(&Scope::service(), JobInput::Palette(input)).await.unwrap();
        self.queue.work_arrived();
        job.id
    }

    async fn upload(&self, recording: &[u8]) -> SessionId {
        let kept = self.vault.put(recording).await.unwrap();
        let new = NewSession {
            trainee: self.trainee,
            task: self.task,
            in_box: self.the_box.id,
            filename: "clip.mp4".parse().unwrap(),
            recorded_at_ms: None,
            video: kept.blob(),
            media_type: "video/mp4".into(),
            time: None,
        };
        let session = self.store.sessions().create(&Scope::service(), new).await.unwrap();
        self.queue.work_arrived();
        session.id
    }

    async fn job(&self, id: JobId) -> JobRecord {
        self.store.jobs().get(&Scope::service(), id).await.unwrap()
    }

    /// Waits for an event that satisfies the condition.
    async fn wait_for_event(&mut self, expected: impl Fn(&Event) -> bool) {
        let patience = Duration::from_secs(120);
        let arrival = async {
            while let Some(delivery) = self.subscriber.next().await {
                if matches!(&delivery, EventDelivery::Event(event) if expected(event)) {
                    return;
                }
            }
            panic!("the event bus is closed");
        };
        tokio::time::timeout(patience, arrival).await.expect("the event did not arrive");
    }

    async fn wait_for_job(&mut self, job: JobId, states: &[JobState]) {
        self.wait_for_event(|e| matches!(e, Event::Job { id, state, .. } if *id == job && states.contains(state)))
            .await;
    }

    async fn close(&self) {
        self.shutdown.begin();
        assert!(self.shutdown.finished(Duration::from_secs(10)).await, "workers do not end");
    }
}

const MARKS: &str = r#"{"tool_diameter_mm":8,"labels":[{"frame":0,"label":"orange","x":1,"y":1,"w":2,"h":2},
                       {"frame":0,"label":"background","x":9,"y":9,"w":2,"h":2}]}"#;

/// A program that never sends anything.
fn silent_program() -> Program {
    Program::at("/bin/sleep", &["1000"])
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_becomes_features_path_diagnostics_and_picture() {
    let Some(scene) = SharedScene::find("V1") else { return };
    let recording = std::fs::read(scene.video()).unwrap();
    let mut centre = Centre::new().await;
    centre.start_workers(program());
    centre.calibrate(scene.camera.clone()).await;
    let session = centre.upload(&recording).await;
    centre.mark(scene.annotations.clone(), &recording).await; // the session was waiting for it
    let ended = [SessionStatus::Done, SessionStatus::Failed];
    centre
        .wait_for_event(|e| matches!(e, Event::Session { id, status, .. } if *id == session && ended.contains(status)))
        .await;
    let service = Scope::service();
    let stored = centre.store.sessions().get(&service, session).await.unwrap();
    assert_eq!((stored.status(), stored.problem()), (SessionStatus::Done, None));
    let result = centre.store.sessions().result(&service, session).await.unwrap().unwrap();
    assert_eq!(result.versions.pipeline, trocar::motion::PIPELINE_VERSION);
    assert_eq!((result.video.width, result.video.height), (Some(scene.camera.width), Some(scene.camera.height)));
    assert!(result.features.iter().any(|f| f.value.is_ok()), "{:?}", result.features);
    let paths = SessionPaths::from_bytes(&centre.vault.read(result.trajectory, 1 << 30).await.unwrap()).unwrap();
    assert_eq!(paths.tools, result.tools);
    assert_eq!(paths.frame_times_s.len() as u64, result.video.frames);
    assert!(paths.trajectory(PathKind::Smoothed).samples.len() as u64 > result.video.frames / 2);
    let diagnostics = centre.vault.read(result.diagnostics.unwrap(), 1 << 30).await.unwrap();
    let diagnostics: serde_json::Value = serde_json::from_slice(&diagnostics).unwrap();
    assert!(diagnostics["columns"]["tip_u_px"].as_array().unwrap().iter().any(|tip| tip.is_number()));
    let preview = centre.vault.read(result.preview.unwrap(), 1 << 20).await.unwrap();
    assert!(image::load_from_memory(&preview).unwrap().width() > 100);
    let colours = centre.store.palettes().in_use(&service, centre.the_box.id).await.unwrap().unwrap().report.unwrap();
    let grades: Vec<_> = colours.verdicts.iter().map(|verdict| verdict.grade).collect();
    assert_eq!((grades, colours.warnings), (vec![ColourGrade::Good; 2], vec![]));
    centre.close().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_impossible_job_fails_at_once_with_its_reason() {
    let mut centre = Centre::new().await;
    centre.start_workers(program());
    let job = centre.mark(serde_json::from_str(MARKS).unwrap(), b"not a video").await;
    centre.wait_for_job(job, &[JobState::Failed]).await;
    let job = centre.job(job).await;
    assert_eq!((job.attempt, job.problem.unwrap().slug.as_str()), (1, "not-a-video"));
    centre.close().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_whose_child_dies_three_times_is_quarantined_with_the_reason() {
    let mut centre = Centre::new().await;
    centre.start_workers(Program::at("/bin/false", &[]));
    let job = centre.mark(serde_json::from_str(MARKS).unwrap(), b"a clip").await;
    centre.wait_for_job(job, &[JobState::Quarantined]).await;
    let job = centre.job(job).await;
    assert_eq!((job.attempt, job.max_attempts), (3, 3));
    assert!(job.problem.as_ref().unwrap().detail.contains("status 1"), "{job:?}");
    centre.close().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_log_names_the_job_of_a_child_that_dies() {
    captured_log();
    let mut centre = Centre::new().await;
    centre.start_workers(Program::at("/bin/false", &[]));
    let job = centre.mark(serde_json::from_str(MARKS).unwrap(), b"a clip").await;
    centre.wait_for_job(job, &[JobState::Quarantined]).await;
    centre.close().await;
    let log = captured_log();
    let named = |what: &str| log.lines().filter(|line| line.contains(what) && line.contains(&job.to_string())).count();
    assert_eq!((named("child process failed"), named("quarantined")), (3, 1), "{log}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stopping_service_returns_its_job_to_the_queue_unchanged() {
    let mut centre = Centre::new().await;
    centre.start_workers(silent_program());
    let job = centre.mark(serde_json::from_str(MARKS).unwrap(), b"a clip").await;
    centre.wait_for_job(job, &[JobState::Running]).await;
    centre.close().await;
    let job = centre.job(job).await;
    assert_eq!((job.state, job.attempt, job.problem), (JobState::Queued, 0, None));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_whose_lease_is_lost_ends_its_child_and_saves_nothing() {
    let mut centre = Centre::new().await;
    centre.start_workers(silent_program());
    let job = centre.mark(serde_json::from_str(MARKS).unwrap(), b"a clip").await;
    centre.wait_for_job(job, &[JobState::Running]).await;
    centre.queue.recover().await.unwrap(); // takes the lease away, as a sweep would
    centre.wait_for_job(job, &[JobState::Queued]).await;
    centre.clock.advance(Duration::from_secs(10)); // the next heartbeat finds out
    centre.wait_for_job(job, &[JobState::Running]).await; // the worker is free for the next job: this one again
    assert_eq!(centre.job(job).await.attempt, 1, "a lost lease is no attempt");
    assert!(centre.store.palettes().in_use(&Scope::service(), centre.the_box.id).await.unwrap().is_none());
    centre.close().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_whose_file_is_gone_fails_with_that_reason() {
    let mut centre = Centre::new().await;
    let job = centre.mark(serde_json::from_str(MARKS).unwrap(), b"a clip").await;
    let blob = centre.job(job).await.input.facts().blobs[0];
    centre.vault.delete_if(blob.hash, async { Ok::<_, trocar::vault::VaultError>(true) }).await.unwrap();
    centre.start_workers(program());
    centre.wait_for_job(job, &[JobState::Failed]).await;
    assert_eq!(centre.job(job).await.problem.unwrap().slug, "input-gone");
    assert!(centre.store.boxes().get(&Scope::service(), &Key::from(&centre.the_box.id)).await.is_ok());
    centre.close().await;
}

/// The result of a session whose trocars were 30 mm away from those of V1.
fn result_with_moved_trocars(versions: Versions, number: u64) -> NewResult {
    let covariance = [2.0, 0.0, 0.0, 2.0, 0.0, 2.0];
    let tool = |name: &str, at_mm: [f64; 3]| serde_json::json!({"tool": name, "fulcrum": {"at_mm": at_mm, "covariance_mm2": covariance}});
    let tools = [tool("left", [-88.8, 108.7, 64.9]), tool("right", [150.6, 97.0, 54.1])];
    NewResult {
        versions,
        edits: 0,
        video: VideoFacts { width: Some(640), height: Some(480), frames: 300, duration_s: 9.97, clock: None },
        tools: vec!["left".into(), "right".into()],
        features: vec![],
        evidence: vec![],
        quality: serde_json::json!({"verdict": "valid", "reasons": [], "tools": tools}),
        score: None,
        trajectory: Blob::of(format!("trajectory {number}").as_bytes()),
        diagnostics: Some(Blob::of(format!("diagnostics {number}").as_bytes())),
        preview: None,
        surroundings: None,
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_earlier_sessions_for_comparison_do_not_depend_on_which_worker_was_quicker() {
    let Some(scene) = SharedScene::find("V1") else { return };
    let recording = std::fs::read(scene.video()).unwrap();
    let service = Scope::service();
    let mut centre = Centre::new().await;
    centre.start_workers(program());
    centre.calibrate(scene.camera.clone()).await;
    let colours = centre.mark(scene.annotations.clone(), &recording).await;
    centre.wait_for_job(colours, &[JobState::Done]).await;
    centre.close().await;

    // Three sessions came before, and another worker is still busy with the last of them.
    let mut leases = Vec::new();
    for number in 0..3 {
        centre.clock.advance(Duration::from_millis(1));
        centre.upload(format!("recording {number}").as_bytes()).await;
        leases.push(centre.store.jobs().claim("a slow worker", Duration::from_secs(3600)).await.unwrap().unwrap());
    }
    let store = centre.store.clone();
    let finish = async |number: usize| {
        let JobInput::Track(input) = leases[number].job.input.clone() else { panic!("a session") };
        let TrackInput { calibration, palette, .. } = input;
        let versions = Versions {
            pipeline: "1".into(),
            tracked_with: None,
            calibration: Some(calibration),
            palette: Some(palette),
            model: None,
        };
        store.jobs().finish_track(&leases[number], result_with_moved_trocars(versions, number as u64)).await.unwrap();
    };
    finish(0).await;
    finish(1).await;
    centre.clock.advance(Duration::from_millis(1));
    let session = centre.upload(&recording).await;
    centre.shutdown = Shutdown::new();
    centre.start_workers(program());
    let begun = [SessionStatus::Tracking];
    centre
        .wait_for_event(|e| matches!(e, Event::Session { id, status, .. } if *id == session && begun.contains(status)))
        .await;
    finish(2).await;
    let clock = centre.clock.clone();
    {
        let done = [SessionStatus::Done];
        let is_done = centre.wait_for_event(
            |e| matches!(e, Event::Session { id, status, .. } if *id == session && done.contains(status)),
        );
        with_advancing_clock(&clock, Duration::from_secs(1), is_done).await;
    }
    let quality = centre.store.sessions().result(&service, session).await.unwrap().unwrap().quality;
    let reasons: Vec<&str> = quality["reasons"].as_array().unwrap().iter().filter_map(|r| r["name"].as_str()).collect();
    assert!(reasons.contains(&"camera_moved"), "{reasons:?}");
    centre.close().await;
}
