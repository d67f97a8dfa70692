//! A small training centre for the tests of the store and of the services above it.

use std::sync::Arc;
use std::time::Duration;

use tempfile::TempDir;

use crate::domain::blob::Blob;
use crate::domain::boxes::BoxChange;
use crate::domain::calibration::{CalibrationSource, NewCalibration};
use crate::domain::files::camera::CameraFile;
use crate::domain::job::{JobInput, PaletteInput};
use crate::domain::palette::{NewPalette, PaletteReport};
use crate::domain::password_state::PasswordState;
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::secret::{Password, PasswordHash};
use crate::domain::session::{FeatureError, FeatureRow, FeatureSpace, NewResult, NewSession, Versions, VideoFacts};
use crate::domain::task::TaskChange;
use crate::domain::text::Key;
use crate::ids::{SessionId, TraineeId};
use crate::store::{
    BoxRecord, Lease, Members, NewPerson, PersonRecord, SessionRecord, Store, StoreSettings, TaskRecord, TraineeRecord,
};
use crate::time::ManualClock;

/// 2026-11-21 20:14 UTC.
pub const NOW_MS: i64 = 1_795_292_040_000;
pub const LEASE: Duration = Duration::from_secs(30);

/// A store in its own folder, a manual clock, one box and one task.
pub struct TestCentre {
    pub store: Store,
    pub clock: Arc<ManualClock>,
    pub the_box: BoxRecord,
    pub task: TaskRecord,
    pub folder: TempDir,
}

impl TestCentre {
    pub async fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let clock = ManualClock::at(NOW_MS);
        let store = open(&folder, &clock).await;
        let service = Scope::service();
        let new_box = serde_json::from_str(r#"{"name":"Box 1"}"#).unwrap();
        let the_box = store.boxes().create(&service, new_box).await.unwrap();
        let new_task = serde_json::from_str(r#"{"name":"Peg transfer"}"#).unwrap();
        let task = store.tasks().create(&service, new_task).await.unwrap();
        Self { store, clock, the_box, task, folder }
    }

    /// A centre whose box has a camera and colours, so that sessions can be tracked.
    pub async fn with_camera_and_colours() -> Self {
        let centre = Self::new().await;
        centre.calibrate().await;
        centre.give_colours().await;
        centre
    }

    /// Gives the box a camera for all recordings since [`NOW_MS`].
    pub async fn calibrate(&self) {
        let new = NewCalibration { valid_from_ms: Some(NOW_MS), ..Self::new_calibration() };
        self.store.calibrations().add(&Scope::service(), self.the_box.id, new).await.unwrap();
    }

    pub fn new_calibration() -> NewCalibration {
        NewCalibration { camera: camera(), source: CalibrationSource::File, valid_from_ms: None }
    }

    /// Colours of one orange tool, as a job learns them.
    pub fn new_palette() -> NewPalette {
        let annotations: crate::domain::files::annotations::AnnotationsFile = serde_json::from_str(
            r#"{"tool_diameter_mm":8,"labels":[{"frame":0,"label":"orange","x":1,"y":1,"w":2,"h":2}]}"#,
        )
        .unwrap();
        let tools = annotations.marked_tools().unwrap().into_iter().map(Into::into).collect();
        NewPalette {
            annotations,
            tools,
            counts: vec![],
            samples: vec![1, 2, 3],
            report: PaletteReport::default(),
            surroundings: None,
        }
    }

    pub async fn give_colours(&self) {
        let new = Self::new_palette();
        let input = PaletteInput {
            of: self.the_box.id,
            annotations: new.annotations.clone(),
            files: vec![],
            is_video: true,
            frames: vec![],
            empty_box: None,
        };
        self.store.jobs().enqueue(&Scope::service(), JobInput::Palette(input)).await.unwrap();
        let lease = self.claim().await.unwrap();
        self.store.jobs().finish_palette(&lease, new).await.unwrap();
    }

    pub async fn trainee(&self, name: &str) -> TraineeRecord {
        let new = serde_json::from_value(serde_json::json!({ "name": name })).unwrap();
        self.store.trainees().create(&Scope::service(), new).await.unwrap()
    }

    pub async fn person(&self, login: &str, role: Role, trainee: Option<TraineeId>) -> PersonRecord {
        let new = NewPerson {
            password_state: PasswordState::Own,
            login: login.parse().unwrap(),
            name: login.parse().unwrap(),
            role,
            password: Password::random().hash(),
            trainee,
        };
        self.store.people().create(&Scope::service(), new).await.unwrap()
    }

    /// The stored hash of a person's password.
    pub async fn password_of(&self, person: &PersonRecord) -> PasswordHash {
        self.store.people().by_login(&person.login).await.unwrap().unwrap().1
    }

    /// A group. It owns the box and the task together with the earlier groups.
    pub async fn group(&self, name: &str, instructors: &[&PersonRecord], trainees: &[&TraineeRecord]) {
        let service = Scope::service();
        let group = self.store.groups().create(&service, name.parse().unwrap()).await.unwrap();
        let members = Members {
            instructors: instructors.iter().map(|p| p.id).collect(),
            trainees: trainees.iter().map(|t| t.id).collect(),
        };
        self.store.groups().set_members(&service, group.id, members).await.unwrap();
        let groups = self.store.groups().list(&service).await.unwrap().into_iter().map(|group| group.id).collect();
        let owned = BoxChange { groups: Some(groups), ..BoxChange::default() };
        self.store.boxes().change(&service, &Key::from(&self.the_box.id), owned.clone()).await.unwrap();
        let owned = TaskChange { groups: owned.groups, ..TaskChange::default() };
        self.store.tasks().change(&service, &Key::from(&self.task.id), owned).await.unwrap();
    }

    pub fn new_session(&self, trainee: TraineeId, content: &str) -> NewSession {
        NewSession {
            trainee,
            task: self.task.id,
            in_box: self.the_box.id,
            filename: "clip.mp4".parse().unwrap(),
            recorded_at_ms: None,
            video: Blob::of(content.as_bytes()),
            media_type: "video/mp4".to_owned(),
            time: None,
        }
    }

    pub async fn session(&self, trainee: TraineeId, content: &str) -> SessionRecord {
        self.store.sessions().create(&Scope::service(), self.new_session(trainee, content)).await.unwrap()
    }

    /// A session that was recorded at this time and tracked, with these features.
    pub async fn practised(&self, trainee: TraineeId, recorded_at_ms: i64, features: Vec<FeatureRow>) -> SessionRecord {
        self.practised_as(trainee, recorded_at_ms, features, serde_json::json!({ "frames": 300 })).await
    }

    /// Like [`TestCentre::practised`], with this quality document. The result's tools are those of the features, if they
    /// have any.
    pub async fn practised_as(
        &self,
        trainee: TraineeId,
        recorded_at_ms: i64,
        features: Vec<FeatureRow>,
        quality: serde_json::Value,
    ) -> SessionRecord {
        let new = self.new_session(trainee, &format!("{trainee} {recorded_at_ms}"));
        let new = NewSession { recorded_at_ms: Some(recorded_at_ms), ..new };
        let session = self.store.sessions().create(&Scope::service(), new).await.unwrap();
        let lease = self.claim().await.unwrap();
        let mut tools: Vec<String> = features.iter().filter_map(|row| row.tool.clone()).collect();
        tools.dedup();
        let usual = self.result(session.id).await;
        let tools = if tools.is_empty() { usual.tools.clone() } else { tools };
        let result = NewResult { features, quality, tools, ..usual };
        self.store.jobs().finish_track(&lease, result).await.unwrap();
        session
    }

    pub async fn claim(&self) -> Option<Lease> {
        self.store.jobs().claim("worker 1", LEASE).await.unwrap()
    }

    pub async fn result(&self, session: SessionId) -> NewResult {
        let service = Scope::service();
        let calibration = self.store.calibrations().in_use(&service, self.the_box.id).await.unwrap().unwrap().id;
        let palette = self.store.palettes().in_use(&service, self.the_box.id).await.unwrap().unwrap().id;
        NewResult {
            versions: Versions {
                pipeline: "1".to_owned(),
                tracked_with: None,
                calibration: Some(calibration),
                palette: Some(palette),
                model: None,
            },
            edits: 0,
            video: VideoFacts { width: Some(640), height: Some(480), frames: 300, duration_s: 9.97, clock: None },
            tools: vec!["orange".to_owned()],
            features: vec![
                feature("path_length", Ok(123.456_789_012_345)),
                feature("motion_smoothness", Err("fewer than 30 observations")),
            ],
            evidence: Vec::new(),
            quality: serde_json::json!({ "frames": 300 }),
            score: None,
            trajectory: Blob::of(format!("trajectory of {session}").as_bytes()),
            diagnostics: Some(Blob::of(format!("diagnostics of {session}").as_bytes())),
            preview: None,
            surroundings: None,
        }
    }
}

pub async fn open(folder: &TempDir, clock: &Arc<ManualClock>) -> Store {
    Store::open(&folder.path().join("trocar.sqlite"), &StoreSettings::default(), clock.clone()).await.unwrap()
}

pub fn camera() -> CameraFile {
    CameraFile::parse(r#"{"width":640,"height":480,"fx":500.1,"fy":500.2,"cx":320,"cy":240,"rms_px":0.31}"#).unwrap()
}

/// The session's duration, s, with its error bar.
pub fn duration(seconds: f64, half: f64) -> FeatureRow {
    let bar = FeatureError { as_measured: seconds, sigma: half / 2.0, low: seconds - half, high: seconds + half };
    let (tool, unit) = (None, "s".to_owned());
    FeatureRow { tool, unit, error: Some(Ok(bar)), ..feature("duration", Ok(seconds)) }
}

fn feature(name: &str, value: Result<f64, &str>) -> FeatureRow {
    FeatureRow {
        name: name.to_owned(),
        title: name.replace('_', " "),
        unit: "mm".to_owned(),
        tool: Some("orange".to_owned()),
        space: FeatureSpace::Space3d,
        value: value.map_err(str::to_owned),
        error: value.ok().map(|at| Ok(FeatureError { as_measured: at, sigma: 1.0, low: at - 2.0, high: at + 2.0 })),
    }
}

impl Store {
    /// Number of ratings and of comments.
    pub async fn count_ratings_and_comments(&self) -> [i64; 2] {
        let sql = "SELECT (SELECT count(*) FROM rating), (SELECT count(*) FROM comment)";
        let (ratings, comments) = sqlx::query_as(sql).fetch_one(self.readers()).await.unwrap();
        [ratings, comments]
    }

    /// Number of results, of all sessions and versions.
    pub async fn count_results(&self) -> i64 {
        sqlx::query_scalar("SELECT count(*) FROM result").fetch_one(self.readers()).await.unwrap()
    }
}
