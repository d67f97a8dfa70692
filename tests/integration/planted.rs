//! Sessions with results that were not tracked: they are written to the store directly, beside the running service.

use std::sync::Arc;
use std::time::Duration;

use futures_util::future::join_all;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection};
use trocar::analysis::paths::SessionPaths;
use trocar::domain::blob::Blob;
use trocar::domain::calibration::{CalibrationSource, NewCalibration};
use trocar::domain::edit::EditChange;
use trocar::domain::evidence::EvidenceRow;
use trocar::domain::files::annotations::AnnotationsFile;
use trocar::domain::files::camera::CameraFile;
use trocar::domain::job::{JobInput, PaletteInput};
use trocar::domain::palette::{NewPalette, PaletteReport};
use trocar::domain::problem::Problem;
use trocar::domain::scope::Scope;
use trocar::domain::session::{
    FeatureError, FeatureRow, FeatureSpace, NewResult, NewScore, NewSession, Versions, VideoFacts,
};
use trocar::domain::standard::{StandardDefinition, StandardStart};
use trocar::domain::text::Key;
use trocar::ids::{BoxId, CalibrationId, CutId, PaletteId, SessionId, TaskId, TraineeId};
use trocar::motion::PIPELINE_VERSION;
use trocar::store::{EditBasis, Lease, SessionCutRecord, SessionDestination, Store, StoreSettings};
use trocar::time::SystemClock;
use trocar::vault::Vault;

use crate::support::poll;

/// 2026-01-01.
pub const NEW_YEAR_MS: i64 = 1_767_225_600_000;
pub const DAY_MS: i64 = 86_400_000;

/// Puts sessions into a centre's database.
#[derive(Clone)]
pub struct Planter {
    store: Store,
    in_box: BoxId,
    calibration: CalibrationId,
    palette: PaletteId,
    /// The task `peg`.
    pub task: TaskId,
    /// The evidence rows of each result.
    pub evidence: Vec<EvidenceRow>,
    /// The length of each recording, s.
    pub duration_s: f64,
}

impl Planter {
    /// Opens the database of a service with a box `box-1` and a task `peg`, and gives the box a camera and colours.
    pub async fn open(database: &std::path::Path) -> Self {
        Self::open_box(database, "box-1").await
    }

    /// The same for another box.
    pub async fn open_box(database: &std::path::Path, code: &str) -> Self {
        let settings = StoreSettings::default();
        let store = Store::open(database, &settings, Arc::new(SystemClock)).await.unwrap();
        let service = Scope::service();
        let in_box = store.boxes().get(&service, &Key::from(code)).await.unwrap().id;
        let task = store.tasks().get(&service, &Key::from("peg")).await.unwrap().id;
        let camera = r#"{"width":640,"height":480,"fx":500.1,"fy":500.2,"cx":320,"cy":240,"rms_px":0.31}"#;
        let (camera, source) = (CameraFile::parse(camera).unwrap(), CalibrationSource::File);
        let new = NewCalibration { camera, source, valid_from_ms: None };
        store.calibrations().add(&service, in_box, new).await.unwrap();
        let marks = r#"{"tool_diameter_mm":8,"labels":[{"frame":0,"label":"orange","x":1,"y":1,"w":2,"h":2}]}"#;
        let annotations = AnnotationsFile::parse(marks).unwrap();
        let tools = annotations.marked_tools().unwrap().into_iter().map(Into::into).collect();
        let input = PaletteInput {
            of: in_box,
            annotations: annotations.clone(),
            files: vec![],
            is_video: true,
            frames: vec![],
            empty_box: None,
        };
        store.jobs().enqueue(&service, JobInput::Palette(input)).await.unwrap();
        let lease = store.jobs().claim("planter", Duration::from_secs(60)).await.unwrap().unwrap();
        let palette = NewPalette {
            annotations,
            tools,
            counts: vec![],
            samples: vec![1],
            report: PaletteReport::default(),
            surroundings: None,
        };
        store.jobs().finish_palette(&lease, palette).await.unwrap();
        let calibration = store.calibrations().in_use(&service, in_box).await.unwrap().unwrap().id;
        let palette = store.palettes().in_use(&service, in_box).await.unwrap().unwrap().id;
        Self { store, in_box, calibration, palette, task, evidence: Vec::new(), duration_s: 9.97 }
    }

    /// Measures the next sessions with the box's camera and colours of now.
    pub async fn take_current_set_up(&mut self) {
        let service = Scope::service();
        self.calibration = self.store.calibrations().in_use(&service, self.in_box).await.unwrap().unwrap().id;
        self.palette = self.store.palettes().in_use(&service, self.in_box).await.unwrap().unwrap().id;
    }

    /// The database.
    pub fn store(&self) -> &Store {
        &self.store
    }

    pub async fn trainee(&self, code: &str) -> TraineeId {
        self.store.trainees().get(&Scope::service(), &Key::from(code)).await.unwrap().id
    }

    /// Adds a session with this recording time and these features.
    pub async fn session(&self, trainee: TraineeId, recorded_at_ms: i64, features: Vec<FeatureRow>) {
        self.result(trainee, recorded_at_ms, features, (PIPELINE_VERSION, "valid")).await;
    }

    /// The same, and returns the session.
    pub async fn scored(&self, trainee: TraineeId, recorded_at_ms: i64, features: Vec<FeatureRow>) -> SessionId {
        let session = self.create(trainee, recorded_at_ms).await;
        let lease = self.claim().await;
        self.finish(&lease, features, (PIPELINE_VERSION, "valid"), None).await;
        session
    }

    /// The same with the pipeline version and the verdict of the quality gate.
    pub async fn result(&self, trainee: TraineeId, at_ms: i64, features: Vec<FeatureRow>, origin: (&str, &str)) {
        self.create(trainee, at_ms).await;
        let lease = self.claim().await;
        self.finish(&lease, features, origin, None).await;
    }

    /// Adds a session with these paths. `data` is the service's folder.
    pub async fn paths(&self, trainee: TraineeId, data: &std::path::Path, paths: &SessionPaths) -> SessionId {
        let vault = Vault::open(data).await.unwrap();
        let blob = vault.put(&paths.to_bytes().unwrap()).await.unwrap();
        self.create(trainee, NEW_YEAR_MS).await;
        let lease = self.claim().await;
        self.finish(&lease, Vec::new(), (PIPELINE_VERSION, "valid"), Some(blob.blob())).await;
        session_of(&lease)
    }

    /// Adds several sessions at the same time, so that they share commits.
    pub async fn sessions(&self, mut rows: Vec<(TraineeId, i64, Vec<FeatureRow>)>) {
        let created = join_all(rows.iter().map(|(trainee, at_ms, _)| self.create(*trainee, *at_ms))).await;
        let of =
            |session| rows.iter_mut().zip(&created).find(|(_, id)| **id == session).map(|(row, _)| row.2.split_off(0));
        let leases = join_all(created.iter().map(|_| self.claim())).await;
        let features: Vec<Vec<FeatureRow>> = leases.iter().map(session_of).map(of).map(Option::unwrap).collect();
        let finish = leases
            .iter()
            .zip(features)
            .map(|(lease, features)| self.finish(lease, features, (PIPELINE_VERSION, "valid"), None));
        join_all(finish).await;
    }

    /// Completes the next job of a rescoring, once there is one. `of` gives the new feature for each old duration.
    pub async fn rescore(&self, pipeline: &str, of: impl Fn(f64) -> FeatureRow) {
        self.rescore_with(pipeline, None, of).await;
    }

    /// The same with this quality.
    pub async fn rescore_as(&self, pipeline: &str, quality: serde_json::Value, of: impl Fn(f64) -> FeatureRow) {
        self.rescore_with(pipeline, Some(quality), of).await;
    }

    async fn rescore_with(&self, pipeline: &str, quality: Option<serde_json::Value>, of: impl Fn(f64) -> FeatureRow) {
        let lease = self.claim_when_there().await;
        let JobInput::Rescore(input) = lease.job.input.clone() else { panic!("{:?}", lease.job) };
        let old = self.store.sessions().result_of(&Scope::service(), input.session, input.result).await.unwrap();
        let score = NewScore {
            from: old.id,
            pipeline: pipeline.to_owned(),
            tracked_with: Some(old.versions.pipeline),
            edits: input.edits,
            features: old.features.iter().map(|row| of(*row.value.as_ref().unwrap())).collect(),
            evidence: Vec::new(),
            quality: quality.unwrap_or(old.quality),
        };
        self.store.jobs().finish_rescore(&lease, score).await.unwrap();
    }

    /// Fails the next job of a rescoring: the stored path cannot be scored again.
    pub async fn refuse_rescoring(&self) {
        let lease = self.claim_when_there().await;
        self.store
            .jobs()
            .fail(&lease, Problem::new("path-alone", "It cannot be scored again", "because"))
            .await
            .unwrap();
    }

    /// Adds a version of the task's standard that differs from the newest one and judges all sessions.
    pub async fn standard(&self, change: impl FnOnce(&mut StandardDefinition)) {
        let service = Scope::service();
        let mut definition = self.store.standards().newest(&service, self.task).await.unwrap().unwrap().definition;
        change(&mut definition);
        self.store.standards().add(&service, self.task, definition, Some(StandardStart::Beginning)).await.unwrap();
    }

    /// Trims a session to one second, as an instructor would.
    pub async fn trim(&self, session: SessionId) {
        let why = "Talked at first.".parse().unwrap();
        self.store
            .edits()
            .add(&Scope::service(), session, (EditChange::Trim([1.0, 2.0]), why), EditBasis::default())
            .await
            .unwrap();
    }

    /// Moves a session to a trainee and a task, by their codes.
    pub async fn move_session(&self, session: &str, trainee: &str, task: &str) {
        let task = self.store.tasks().get(&Scope::service(), &Key::from(task)).await.unwrap().id;
        let to = SessionDestination { trainee: Some(self.trainee(trainee).await), task: Some(task), in_box: None };
        let why = "Kim was still signed in.".parse().unwrap();
        self.store.session_moves().add(&Scope::service(), session.parse().unwrap(), to, why).await.unwrap();
    }

    /// Cuts a session `at_s` seconds after its recording begins, as an instructor would. `end_s`: the recording's length.
    pub async fn cut(&self, session: SessionId, at_and_end_s: [f64; 2]) -> SessionCutRecord {
        let why = "Two attempts.".parse().unwrap();
        let cuts = self.store.session_cuts();
        cuts.add(&Scope::service(), session, (at_and_end_s, why), EditBasis::default()).await.unwrap()
    }

    /// Joins the two parts of a cut.
    pub async fn join(&self, session: SessionId, cut: CutId) {
        self.store.session_cuts().join(&Scope::service(), session, cut).await.unwrap();
    }

    /// Completes all jobs in the queue, which track or score sessions. `of` gives the feature of each.
    pub async fn finish_all(&self, of: impl Fn(SessionId) -> FeatureRow) {
        while let Some(lease) = self.store.jobs().claim("planter", Duration::from_secs(60)).await.unwrap() {
            match lease.job.input.clone() {
                JobInput::Track(input) => {
                    let planter = Self { calibration: input.calibration, palette: input.palette, ..self.clone() };
                    planter.finish(&lease, vec![of(input.session)], (PIPELINE_VERSION, "valid"), None).await;
                }
                JobInput::Rescore(input) => {
                    let (service, sessions) = (Scope::service(), self.store.sessions());
                    let old = sessions.result_of(&service, input.session, input.result).await.unwrap();
                    let score = NewScore {
                        from: old.id,
                        pipeline: PIPELINE_VERSION.to_owned(),
                        tracked_with: Some(old.versions.pipeline),
                        edits: input.edits,
                        features: vec![of(input.session)],
                        evidence: Vec::new(),
                        quality: old.quality,
                    };
                    self.store.jobs().finish_rescore(&lease, score).await.unwrap();
                }
                other => panic!("{other:?}"),
            }
        }
    }

    /// Completes the next job in the queue, the tracking of a session.
    pub async fn finish_next(&self, features: Vec<FeatureRow>) {
        let lease = self.claim().await;
        self.finish(&lease, features, (PIPELINE_VERSION, "valid"), None).await;
    }

    /// The same with the verdict of the quality gate.
    pub async fn finish_next_as(&self, features: Vec<FeatureRow>, verdict: &str) {
        let lease = self.claim().await;
        self.finish(&lease, features, (PIPELINE_VERSION, verdict), None).await;
    }

    /// Fails the next job in the queue.
    pub async fn fail_next(&self) {
        let lease = self.claim().await;
        self.store.jobs().fail(&lease, Problem::new("no-video", "It is no video", "because")).await.unwrap();
    }

    /// Claims the next job in the queue and returns its kind.
    pub async fn next_kind(&self) -> &'static str {
        self.claim().await.job.kind.name()
    }

    async fn claim_when_there(&self) -> Lease {
        poll("a job", async || self.store.jobs().claim("planter", Duration::from_secs(60)).await.unwrap()).await
    }

    async fn create(&self, trainee: TraineeId, recorded_at_ms: i64) -> SessionId {
        let new = NewSession {
            trainee,
            task: self.task,
            in_box: self.in_box,
            filename: "clip.mp4".parse().unwrap(),
            recorded_at_ms: Some(recorded_at_ms),
            video: Blob::of(format!("{trainee} {recorded_at_ms}").as_bytes()),
            media_type: "video/mp4".to_owned(),
            time: None,
        };
        self.store.sessions().create(&Scope::service(), new).await.unwrap().id
    }

    async fn claim(&self) -> Lease {
        self.store.jobs().claim("planter", Duration::from_secs(60)).await.unwrap().unwrap()
    }

    async fn finish(
        &self,
        lease: &Lease,
        features: Vec<FeatureRow>,
        (pipeline, verdict): (&str, &str),
        paths: Option<Blob>,
    ) {
        let id = session_of(lease);
        let (pipeline, calibration, palette) = (pipeline.to_owned(), self.calibration, self.palette);
        let result = NewResult {
            versions: Versions {
                pipeline,
                tracked_with: None,
                calibration: Some(calibration),
                palette: Some(palette),
                model: None,
            },
            edits: 0,
            video: VideoFacts {
                width: Some(640),
                height: Some(480),
                frames: 300,
                duration_s: self.duration_s,
                clock: None,
            },
            tools: vec!["orange".to_owned()],
            features,
            evidence: self.evidence.clone(),
            quality: serde_json::json!({ "frames": 300, "verdict": verdict, "reasons": [], "tools": [] }),
            score: None,
            trajectory: paths.unwrap_or_else(|| Blob::of(format!("trajectory {id}").as_bytes())),
            diagnostics: Some(Blob::of(format!("diagnostics {id}").as_bytes())),
            preview: None,
            surroundings: None,
        };
        self.store.jobs().finish_track(lease, result).await.unwrap();
    }
}

/// Puts a version of a box's colours into the database, without learning it. Returns its id.
pub async fn plant_palette(database: &std::path::Path, of: &str, version: i64, created_at_ms: i64) -> String {
    let id = PaletteId::at(NEW_YEAR_MS).to_string();
    let mut connection = SqliteConnectOptions::new().filename(database).connect().await.unwrap();
    let insert = sqlx::query(
        r#"INSERT INTO palette (id, box_id, version, annotations, tools, counts, samples, created_at_ms)
           VALUES ($1, $2, $3, '{"tool_diameter_mm":8,"labels":[]}', '[]', '[]', x'01', $4)"#,
    );
    insert.bind(&id).bind(of).bind(version).bind(created_at_ms).execute(&mut connection).await.unwrap();
    connection.close().await.unwrap();
    id
}

/// Gives a recording that waits for a name to a trainee, as the list of a watched folder does.
pub async fn plant_owner(database: &std::path::Path, waiting: &str, trainee: &str) {
    let mut connection = SqliteConnectOptions::new().filename(database).connect().await.unwrap();
    let update = sqlx::query("UPDATE waiting_recording SET trainee_id = $2 WHERE id = $1").bind(waiting).bind(trainee);
    assert_eq!(update.execute(&mut connection).await.unwrap().rows_affected(), 1);
    connection.close().await.unwrap();
}

fn session_of(lease: &Lease) -> SessionId {
    lease.job.session_id.expect("only sessions are planted")
}

/// A value with its error bar.
pub fn measured(name: &str, unit: &str, tool: Option<&str>, space: FeatureSpace, value: f64, half: f64) -> FeatureRow {
    let error = FeatureError { as_measured: value, sigma: half / 2.0, low: value - half, high: value + half };
    FeatureRow {
        name: name.to_owned(),
        title: name.replace('_', " "),
        unit: unit.to_owned(),
        tool: tool.map(str::to_owned),
        space,
        value: Ok(value),
        error: Some(Ok(error)),
    }
}

/// The duration of a session, s.
pub fn duration(seconds: f64, half: f64) -> FeatureRow {
    measured("duration", "s", None, FeatureSpace::Space3d, seconds, half)
}

/// Puts a self-test of a box with this light into the database, as of now. The box has a camera and colours.
pub async fn plant_self_test(database: &std::path::Path, of: &str, light: &str) {
    const INSERT: &str = "
        INSERT INTO self_test (id, box_id, calibration_id, palette_id, pipeline, light, report, created_at_ms)
        SELECT $1, training_box.id, (SELECT id FROM calibration WHERE box_id = training_box.id ORDER BY version DESC LIMIT 1),
               (SELECT id FROM palette WHERE box_id = training_box.id ORDER BY version DESC LIMIT 1), 'x', $3, '{}', $4
        FROM training_box WHERE code = $2";
    let options = SqliteConnectOptions::new().filename(database).foreign_keys(true);
    let mut connection = options.connect().await.unwrap();
    let now_ms = trocar::time::Clock::now_ms(&SystemClock);
    let id = trocar::ids::SelfTestId::at(now_ms).to_string();
    let insert = sqlx::query(INSERT).bind(id).bind(of).bind(light).bind(now_ms);
    assert_eq!(insert.execute(&mut connection).await.unwrap().rows_affected(), 1);
}

/// Lets a session have arrived at another time.
pub async fn plant_arrival(database: &std::path::Path, session: &str, created_at_ms: i64) {
    let mut connection = SqliteConnectOptions::new().filename(database).connect().await.unwrap();
    let update = sqlx::query("UPDATE session SET created_at_ms = $2 WHERE id = $1").bind(session).bind(created_at_ms);
    assert_eq!(update.execute(&mut connection).await.unwrap().rows_affected(), 1);
    connection.close().await.unwrap();
}
