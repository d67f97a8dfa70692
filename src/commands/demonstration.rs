//! The demonstration centre (`trocar serve --demo`): two simulated boxes, one of them with tools without tape, six
//! trainees of three levels, two tasks, a course, and recordings that pass through the real intake, queue and workers.
//!
//! No result is prepared in advance: the camera is calibrated from simulated photos, the colours are learned from
//! marked frames, and every recording is tracked. A start continues where the last one stopped; a recording is
//! recognised by its trainee, task and file name.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use tokio_util::io::ReaderStream;

use super::simulate::{EMPTY_BOX, SceneOrder, write_scene};
use crate::cohorts::Cohorts;
use crate::domain::boxes::NewBox;
use crate::domain::calibration::BoardSize;
use crate::domain::course::NewCourse;
use crate::domain::files::annotations::{AnnotationsFile, View as FileView};
use crate::domain::job::{CalibrateInput, JobInput, JobState, NamedBlob, PaletteInput, SelfTestInput};
use crate::domain::password_state::PasswordState;
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::secret::Password;
use crate::domain::task::NewTask;
use crate::domain::text::Key;
use crate::domain::trainee::{Handedness, Level, NewTrainee};
use crate::events::EventBus;
use crate::http::state::App;
use crate::ids::{BoxId, GroupId};
use crate::intake::{Intake, IntakeError, RecordingDescription};
use crate::queue::Queue;
use crate::shutdown::Shutdown;
use crate::simulation::tool::SimulatedMarker;
use crate::simulation::{Scenario, Setup, Skill};
use crate::store::{BoxRecord, Members, NewPerson, PageRequest, SessionFilter, Store, StoreError};
use crate::time::{Day, SharedClock, to_rfc3339};
use crate::upkeep;
use crate::vault::{PinnedBlob, Vault};

/// The demonstration instructor's login.
pub const INSTRUCTOR: &str = "instructor";
/// The box of all sessions but one, and the box of tools without tape.
const BOX_CODE: &str = "simulated-box";
const BARE_BOX_CODE: &str = "simulated-box-without-tape";
/// Size of all clips, pixels: one camera, one calibration.
const PICTURE_SIZE: (u32, u32) = (960, 540);
/// Inner corners of the simulated board.
const BOARD: BoardSize = BoardSize { columns: 9, rows: 6 };
/// Side of a square of the board, mm.
const SQUARE_MM: f64 = 21.0;
const SESSIONS_PER_TASK: u64 = 2;
const DAY_MS: i64 = 24 * 3600 * 1000;

const TASKS: [(Scenario, &str, &str); 2] = [
    (Scenario::Pegs, "Peg transfer", "Carry each bead to a peg on the other side, and back."),
    (Scenario::Wire, "Tracing the wire", "Follow the m-shaped wire with the tip, from end to end."),
];

/// Standard of the first task: the published time, reached twice in a row and ten more times.
const STANDARD: &str = r#"{"targets": [{"feature": "duration", "by": {"method": "fls", "preset": "peg_transfer"}}],
    "rule": {"in_a_row": 2, "then_more": 10, "at_most": 80}}"#;

/// A course that began a day before the first recordings, so that it shows every state of a step: the step of two
/// sessions is passed, the step that asks for the standard is overdue, and a further step is open.
const COURSE: &str = r#"{"name": "Basic skills", "steps": [{"task": "wire", "sessions": 2, "within_days": 10},
    {"task": "pegs", "within_days": 14}, {"task": "pegs", "sessions": 20, "within_days": 42}]}"#;
const COURSE_BEGAN_MS: i64 = (SESSIONS_PER_TASK as i64 * 7 + 1) * DAY_MS;

/// The recording in the box of tools without tape.
const BARE_RECORDING: DemonstrationRecording = DemonstrationRecording {
    scenario: Scenario::Pegs,
    trainee: 2,
    attempt: SESSIONS_PER_TASK - 1,
    seed: 101,
    marker: SimulatedMarker::Bare,
};

const TRAINEES: [(&str, Level, Skill, Handedness); 6] = [
    ("Ada Novak", Level::Novice, Skill::NOVICE, Handedness::Right),
    ("Chiara Rossi", Level::Intermediate, Skill::INTERMEDIATE, Handedness::Right),
    ("Elin Berg", Level::Expert, Skill::EXPERT, Handedness::Right),
    ("Ben Okoro", Level::Novice, Skill::NOVICE, Handedness::Left),
    ("David Kim", Level::Intermediate, Skill::INTERMEDIATE, Handedness::Right),
    ("Farid Haddad", Level::Expert, Skill::EXPERT, Handedness::Left),
];

/// A simulated recording of the centre.
#[derive(Clone, Copy)]
struct DemonstrationRecording {
    scenario: Scenario,
    /// Position in [`TRAINEES`].
    trainee: usize,
    /// Number of the trainee's recordings of this task before it.
    attempt: u64,
    seed: u64,
    marker: SimulatedMarker,
}

/// Builds the demonstration centre in a running service.
pub struct DemonstrationBuilder {
    store: Store,
    vault: Vault,
    queue: Queue,
    events: EventBus,
    intake: Intake,
    cohorts: Cohorts,
    clock: SharedClock,
    /// Folder for simulated scenes until they are uploaded; removed afterwards.
    scratch: PathBuf,
}

impl DemonstrationBuilder {
    /// A builder for this service.
    pub fn new(app: &App, scratch: PathBuf) -> Self {
        Self {
            store: app.store.clone(),
            vault: app.vault.clone(),
            queue: app.queue.clone(),
            events: app.events.clone(),
            intake: app.intake.clone(),
            cohorts: app.cohorts.clone(),
            clock: app.clock.clone(),
            scratch,
        }
    }

    /// True if an earlier start registered the centre.
    pub async fn is_registered(&self) -> anyhow::Result<bool> {
        match self.store.boxes().get(&Scope::service(), &Key::from(BOX_CODE)).await {
            Ok(_) => Ok(true),
            Err(StoreError::NotFound { .. }) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }

    /// Registers box, people and tasks, once. Returns the instructor's password if this call registered them; a file
    /// has it, too.
    pub async fn register(&self) -> anyhow::Result<Option<Password>> {
        if self.is_registered().await? {
            return Ok(None);
        }
        let service = Scope::service();
        let password = Password::random();
        let hash = password.hash();
        upkeep::write_password_file(self.vault.folder(), INSTRUCTOR, &password, &hash)?;
        let group = self.store.groups().create(&service, "Demonstration group".parse()?).await?;
        let instructor = NewPerson {
            login: INSTRUCTOR.parse()?,
            name: "Demonstration instructor".parse()?,
            role: Role::Instructor,
            password: hash,
            password_state: PasswordState::Own, // anyone may try the demonstration with it
            trainee: None,
        };
        let instructor = self.store.people().create(&service, instructor).await?;
        let mut members = Members { instructors: vec![instructor.id], trainees: Vec::new() };
        for (name, level, _, handedness) in TRAINEES {
            let trainee = NewTrainee {
                name: name.parse()?,
                code: None,
                level: Some(level),
                handedness: Some(handedness),
                group: None,
            };
            members.trainees.push(self.store.trainees().create(&service, trainee).await?.id);
        }
        self.store.groups().set_members(&service, group.id, members).await?;
        for (scenario, name, description) in TASKS {
            let (code, description) = (Some(scenario.name().parse()?), Some(description.parse()?));
            let new =
                NewTask { name: name.parse()?, code, description, rating_forms: None, groups: Some(vec![group.id]) };
            self.store.tasks().create(&service, new).await?;
        }
        self.set_standard().await?;
        self.follow_course(group.id).await?;
        let notes = "Drawn by `trocar simulate`; its true camera and paths are known.".parse()?;
        let simulated = NewBox {
            name: "Simulated box".parse()?,
            code: Some(BOX_CODE.parse()?),
            view: Some(FileView::Top),
            notes: Some(notes),
            groups: Some(vec![group.id]),
        };
        self.store.boxes().create(&service, simulated).await?; // last: `is_registered` looks for the box
        Ok(Some(password))
    }

    /// Adds a standard for the first task, and a cohort of all trainees for comparison.
    async fn set_standard(&self) -> anyhow::Result<()> {
        let service = Scope::service();
        let task = self.store.tasks().get(&service, &Key::from(TASKS[0].0.name())).await?;
        let proposal = self.cohorts.propose(&service, task.id, serde_json::from_str(STANDARD)?).await?;
        self.store.standards().add(&service, task.id, proposal.definition()?, None).await?;
        let everybody = serde_json::from_str(r#"{"name": "Everybody"}"#)?;
        self.store.cohorts().create(&service, everybody).await?;
        Ok(())
    }

    /// Adds a course plan, and makes the group follow it.
    async fn follow_course(&self, group: GroupId) -> anyhow::Result<()> {
        let service = Scope::service();
        let new: NewCourse = serde_json::from_str(COURSE)?;
        let new = NewCourse { groups: Some(vec![group]), ..new };
        let course = self.store.courses().create(&service, new.checked()?).await?;
        let begins = Day::of(self.clock.now_ms() - COURSE_BEGAN_MS);
        Ok(self.store.courses().follow(&service, group, course.id, begins).await?)
    }

    /// Sets up the box and uploads every missing recording, until all are there or the service ends.
    pub async fn fill(self, shutdown: Shutdown) {
        let ended = tokio::select! {
            filled = self.set_up_and_record() => filled,
            () = shutdown.begun() => Ok(()),
        };
        if let Err(error) = ended {
            tracing::warn!(
                error = format!("{error:#}"),
                "building the demonstration centre failed; the next start continues"
            );
        }
        let _ = tokio::fs::remove_dir_all(&self.scratch).await; // if it fails, the next start removes the folder
    }

    async fn set_up_and_record(&self) -> anyhow::Result<()> {
        let simulated = self.store.boxes().get(&Scope::service(), &Key::from(BOX_CODE)).await?;
        self.set_up_box(simulated.id, SimulatedMarker::Band).await?;
        for attempt in 0..SESSIONS_PER_TASK {
            for (task, (scenario, ..)) in TASKS.into_iter().enumerate() {
                for trainee in 0..TRAINEES.len() {
                    let seed = 1 + attempt * 100 + task as u64 * 10 + trainee as u64;
                    let marker = SimulatedMarker::Band;
                    self.record(DemonstrationRecording { scenario, trainee, attempt, seed, marker }).await?;
                }
            }
            self.self_test(simulated.id).await?;
        }
        let without_tape = self.box_without_tape(&simulated).await?;
        self.set_up_box(without_tape, SimulatedMarker::Bare).await?;
        self.record(BARE_RECORDING).await
    }

    /// The box of tools without tape; registers it if it is missing, with the groups of the other box.
    async fn box_without_tape(&self, simulated: &BoxRecord) -> anyhow::Result<BoxId> {
        let service = Scope::service();
        match self.store.boxes().get(&service, &Key::from(BARE_BOX_CODE)).await {
            Ok(registered) => return Ok(registered.id),
            Err(StoreError::NotFound { .. }) => {}
            Err(error) => return Err(error.into()),
        }
        let new = NewBox {
            name: "Simulated box without tape".parse()?,
            code: Some(BARE_BOX_CODE.parse()?),
            view: simulated.view,
            notes: Some(simulated.notes.clone()),
            groups: Some(simulated.owners.clone()),
        };
        Ok(self.store.boxes().create(&service, new).await?.id)
    }

    /// Makes a self-test, if there is none: half a minute with the board and a rod, at half the usual frame rate.
    async fn self_test(&self, of: BoxId) -> anyhow::Result<()> {
        const FPS: f64 = 12.5;
        const SECONDS: f64 = 27.5; // ends after the first of the two board placements, when the rod has been taken out
        let service = Scope::service();
        if !self.store.self_tests().list(&service, of, &PageRequest::new(1, None)).await?.items.is_empty() {
            return Ok(());
        }
        let calibration = self.store.calibrations().in_use(&service, of).await?.context("the box has no camera")?;
        let palette = self.store.palettes().in_use(&service, of).await?.context("the box has no colours")?;
        let setup = setup_of(Scenario::SelfTest, Skill::EXPERT, 3);
        let frames = Some((SECONDS * FPS) as usize);
        let order = SceneOrder { frames, fps: FPS, boards: 0, ..SceneOrder::new(setup) };
        let folder = self.draw_scene("self-test", order).await?;
        let (kept, files) = self.store_files(&[folder.join("clip.mp4")]).await?;
        let file = files.into_iter().next().context("no recording was drawn")?;
        let (calibration, palette) = (calibration.id, palette.id);
        let (board, square_mm, reach_mm) = (BOARD, SQUARE_MM, 0.0);
        let input = SelfTestInput { of, person: None, calibration, palette, board, square_mm, reach_mm, file };
        self.run_job(JobInput::SelfTest(input), kept).await?;
        Ok(tokio::fs::remove_dir_all(folder).await?)
    }

    /// Dates camera and colours back to the first day of the course: the recordings state earlier days.
    async fn date_back(&self, of: BoxId) -> anyhow::Result<()> {
        let (service, since) = (Scope::service(), Some(self.clock.now_ms() - COURSE_BEGAN_MS));
        let versions = self.store.box_versions();
        if let Some(calibration) = self.store.calibrations().in_use(&service, of).await? {
            versions.set_calibration_valid_from(&service, (of, calibration.id), since).await?;
        }
        if let Some(palette) = self.store.palettes().in_use(&service, of).await? {
            versions.set_palette_valid_from(&service, (of, palette.id), since).await?;
        }
        Ok(())
    }

    /// Calibrates the camera and learns the colours, each with an ordinary job.
    async fn set_up_box(&self, of: BoxId, marker: SimulatedMarker) -> anyhow::Result<()> {
        let service = Scope::service();
        let calibrated = self.store.calibrations().in_use(&service, of).await?.is_some();
        let coloured = self.store.palettes().in_use(&service, of).await?.is_some();
        if calibrated && coloured {
            return Ok(());
        }
        let setup = Setup { marker, ..setup_of(Scenario::Pegs, Skill::EXPERT, 1) };
        let folder = self.draw_scene("set-up", SceneOrder { frames: Some(250), ..SceneOrder::new(setup) }).await?;
        if !calibrated {
            let (kept, files) = self.store_files(&photos(&folder).await?).await?;
            let input = CalibrateInput { of, board: BOARD, square_mm: SQUARE_MM, files, is_video: false };
            self.run_job(JobInput::Calibrate(input), kept).await?;
        }
        if !coloured {
            let (mut kept, files) = self.store_files(&[folder.join("clip.mp4")]).await?;
            let text = tokio::fs::read_to_string(folder.join("annotations.json")).await?;
            let annotations = AnnotationsFile::parse(&text)?;
            let mut empty_box = None;
            if marker == SimulatedMarker::Bare {
                let (photo, mut named) = self.store_files(&[folder.join(EMPTY_BOX)]).await?;
                kept.extend(photo);
                empty_box = named.pop();
            }
            let input = PaletteInput { of, annotations, files, is_video: true, frames: Vec::new(), empty_box };
            self.run_job(JobInput::Palette(input), kept).await?;
        }
        self.date_back(of).await?;
        Ok(tokio::fs::remove_dir_all(folder).await?)
    }

    /// Queues a job and waits until it ends. `kept` protects the files until the job's row does.
    async fn run_job(&self, input: JobInput, kept: Vec<PinnedBlob>) -> anyhow::Result<()> {
        let service = Scope::service();
        let mut events = self.events.subscribe();
        let job = self.store.jobs().enqueue(&service, input).await?;
        drop(kept);
        self.queue.work_arrived();
        loop {
            let now = self.store.jobs().get(&service, job.id).await?;
            match now.state {
                JobState::Done => return Ok(()),
                JobState::Failed | JobState::Quarantined => bail!("setting up the simulated box failed: {now:?}"),
                JobState::Queued | JobState::Running => {}
            }
            events.next().await.context("the service is shutting down")?;
        }
    }

    async fn record(&self, recording: DemonstrationRecording) -> anyhow::Result<()> {
        let DemonstrationRecording { scenario, trainee, attempt, seed, marker } = recording;
        let (name, _, skill, _) = TRAINEES[trainee];
        let code = name.to_lowercase().replace(' ', "-");
        let (in_box, which) = match marker {
            SimulatedMarker::Band => (BOX_CODE, (attempt + 1).to_string()),
            SimulatedMarker::Bare => (BARE_BOX_CODE, "without-tape".to_owned()),
        };
        let filename = format!("{}-{code}-{which}.mp4", scenario.name());
        if self.has_session(&code, scenario, &filename).await? {
            return Ok(());
        }
        let setup = Setup { marker, ..setup_of(scenario, skill, seed) };
        let folder = self.draw_scene(&filename, SceneOrder { boards: 0, ..SceneOrder::new(setup) }).await?;
        let recorded_at = self.clock.now_ms() - (SESSIONS_PER_TASK - attempt) as i64 * 7 * DAY_MS;
        let about = RecordingDescription {
            trainee: Some(code),
            task: Some(scenario.name().to_owned()),
            in_box: Some(in_box.to_owned()),
            filename: Some(filename),
            recorded_at: Some(to_rfc3339(recorded_at)),
            ..RecordingDescription::default()
        };
        let service = Scope::service();
        let recording = self.intake.resolve(&service, about).await?;
        let bytes = ReaderStream::new(tokio::fs::File::open(folder.join("clip.mp4")).await?);
        match self
            .intake
            .take_whole(&service, recording, Box::pin(futures_util::StreamExt::map(bytes, |b| b.map_err(Into::into))))
            .await
        {
            Ok(_) | Err(IntakeError::AlreadyExists { .. }) => Ok(tokio::fs::remove_dir_all(folder).await?),
            Err(error) => Err(error.into()),
        }
    }

    async fn has_session(&self, trainee: &str, scenario: Scenario, filename: &str) -> anyhow::Result<bool> {
        let which = SessionFilter {
            trainee: Some(Key::from(trainee)),
            task: Some(Key::from(scenario.name())),
            ..SessionFilter::default()
        };
        let whole = PageRequest::new(PageRequest::MAX_LIMIT, None);
        let sessions = self.store.sessions().list(&Scope::service(), &which, &whole).await?;
        Ok(sessions.items.iter().any(|session| session.filename.as_str() == filename))
    }

    /// Draws a scene into a folder of its own, on a blocking thread.
    async fn draw_scene(&self, name: &str, order: SceneOrder) -> anyhow::Result<PathBuf> {
        let folder = self.scratch.join(name);
        let made = folder.clone();
        let draw = move || write_scene(&made, &order, &mut |_, _, _| ());
        tokio::task::spawn_blocking(draw).await.context("drawing a scene")??;
        Ok(folder)
    }

    async fn store_files(&self, paths: &[PathBuf]) -> anyhow::Result<(Vec<PinnedBlob>, Vec<NamedBlob>)> {
        let (mut kept, mut files) = (Vec::new(), Vec::new());
        for path in paths {
            let one = self.vault.put(&tokio::fs::read(path).await?).await?;
            files.push(NamedBlob { name: name_of(path), blob: one.blob() });
            kept.push(one);
        }
        Ok((kept, files))
    }
}

/// A scene in the size of all clips.
fn setup_of(scenario: Scenario, skill: Skill, seed: u64) -> Setup {
    Setup { width: PICTURE_SIZE.0, height: PICTURE_SIZE.1, ..Setup::new(scenario, skill, seed) }
}

async fn photos(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut entries = tokio::fs::read_dir(folder.join("boards")).await?;
    let mut paths = Vec::new();
    while let Some(entry) = entries.next_entry().await? {
        paths.push(entry.path());
    }
    paths.sort();
    Ok(paths)
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
