//! Standing by at a box: the camera stays open, a connection to the server carries the state of the box and its commands,
//! and recordings begin and end at the word of the server or of the box's own screen (`docs/agent.md`).
//!
//! ```text
//! camera ──frames──▶ CameraKeeper ──while a recording runs──▶ recorder ──▶ spool ──▶ send_spool ──▶ server
//!                        └─ state, brightness ─▶ link ◀── commands, check-ins ──▶ server
//!                                                  ▲
//!                                 screen (commands::agent::screen)
//! ```
//!
//! | file | holds |
//! |---|---|
//! | `awaited_start` | recordings that begin by themselves with the first movement in the picture |
//! | [`camera`] | the camera, kept open over its interruptions |
//! | `clock` | the server's time |
//! | [`light`] | the brightness of the picture, compared with the time after the calibration |
//! | [`link`] | the connection to the server |
//! | `movement` | finding the first movement |
//! | [`refusal`] | why the box does not do what was asked of it |
//! | [`recording`] | start and end of a recording, and sending what the spool holds |
//! | `space` | whether there is space for a recording without a name |
//! | [`unnamed`] | recordings without a name, sent as files |
//!
//! Nothing but the spool is on the disk: after a restart the agent sends what was left and stands by again.

mod awaited_start;
pub mod camera;
mod clock;
pub mod light;
pub mod link;
mod movement;
pub mod recording;
pub mod refusal;
mod space;
pub mod unnamed;

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::{Notify, mpsc, watch};
use tokio::time::Instant;

use awaited_start::AwaitedStart;
use camera::CameraKeeper;
use clock::{ComputerTime, ServerClock};
use recording::RunningRecording;
use refusal::{BoxRefusal, ShownRefusal};
use space::UnnamedLimit;
use unnamed::{SendFile, UnnamedState};

use super::Agent;
use super::connection::Server;
use super::held_controls::HoldControls;
use super::spool::SpooledRecording;
use crate::domain::box_agent::CHECK_IN_IDLE;
use crate::domain::box_agent::messages::{AgentMessage, CheckInEnd, CheckInRefusal, CheckedIn, NamedTask};
use crate::domain::box_agent::state::{AgentState, ClockState, RecordingState, SpoolState};
use crate::ids::{FeedId, TaskId, TraineeId};
use crate::shutdown::Shutdown;
use crate::time::SharedClock;

/// How long the screen says why a check-in has ended: as long as the person may be there, and no longer, because the next
/// person need not know.
const CHECK_IN_END_SHOWN: Duration = CHECK_IN_IDLE;
/// Messages that may wait for the connection to the server.
const MAX_WAITING: usize = 16;

/// What an agent that stands by needs.
pub struct StandbyParts {
    /// Spool and status.
    pub agent: Agent,
    /// The server and the box.
    pub server: Server,
    /// The camera.
    pub camera: CameraKeeper,
    /// Folder of the spool.
    pub spool: PathBuf,
    /// The computer's clock.
    pub clock: SharedClock,
    /// Id of the computer's start: another one after each restart.
    pub boot: String,
    /// Holds the camera's automatic controls; `None`: nothing to hold.
    pub hold_controls: Option<HoldControls>,
    /// Sends the file of a recording without a name.
    pub send_file: SendFile,
    /// True if no recording is made without a name.
    pub requires_check_in: bool,
    /// True if the recording of a trainee who checks in begins with the first movement.
    pub starts_on_movement: bool,
    /// How long a movement is awaited.
    pub movement_patience: Duration,
    /// Ends all.
    pub shutdown: Shutdown,
}

/// An agent that stands by. Clones are the same agent.
#[derive(Clone)]
pub struct Standby(Arc<StandbyShared>);

struct StandbyShared {
    parts: StandbyParts,
    /// Messages for the server.
    outbox: mpsc::Sender<AgentMessage>,
    /// Who waits for them; taken by the connection.
    waiting: tokio::sync::Mutex<mpsc::Receiver<AgentMessage>>,
    facts: Mutex<Facts>,
    running: Mutex<Option<RunningRecording>>,
    is_held: Arc<AtomicBool>,
    /// Changes with everything that the server or the screen shall know at once.
    changes: watch::Sender<u64>,
    /// Notified when the spool may hold something to send.
    spool_changed: Notify,
}

/// What the server has said, and what it is compared with.
#[derive(Debug, Default)]
struct Facts {
    is_connected: bool,
    /// Why there is no connection.
    trouble: String,
    /// True if the server refused the last connection: a person has to act.
    is_refused: bool,
    box_name: String,
    light_reference: Option<String>,
    clock: Option<ServerClock>,
    check_in_address: Option<String>,
    /// The server's address, if a phone cannot open it.
    unreachable_server: Option<String>,
    /// When a check-in with the phone was refused for missing consent: by the server's clock, and here.
    phone_refusal: Option<(i64, Instant)>,
    checked_in: Option<CheckedIn>,
    /// Who left the box, until the server has confirmed it.
    left: Option<TraineeId>,
    /// The task that was chosen here, until the server has confirmed it.
    chosen: Option<TaskId>,
    /// When something last happened that keeps the check-in.
    active: Option<Instant>,
    refusal: Option<(CheckInRefusal, u64)>,
    /// Why a recording stays in the spool although the server is there.
    refused_recording: Option<String>,
    /// Why the last check-in ended, and since when that is known.
    check_in_end: Option<(CheckInEnd, Instant)>,
    /// True once the server has said who is checked in.
    knows_check_in: bool,
    /// True if the person at the box may be one who does not consent: key and pedal start no recording without a name.
    needs_unnamed_button: bool,
    /// The last recording, if it has no name.
    last_unnamed: Option<(FeedId, UnnamedState)>,
    /// The recording that begins with the first movement.
    awaited: Option<AwaitedStart>,
    /// Number of the last one that was awaited.
    last_awaited: u64,
    /// Why the last one that was awaited did not begin.
    start_failed: Option<BoxRefusal>,
    /// The limit that the last recording reached, if it was ended for it.
    reached_limit: Option<UnnamedLimit>,
    /// Longest file that the server takes, bytes, if it has said so.
    max_file_bytes: Option<u64>,
}

/// What the box's screen shows.
#[derive(Clone, Debug, serde::Serialize)]
pub struct ScreenState {
    /// Changes with the other fields.
    pub version: u64,
    /// Name of the box; empty until the server has said it.
    pub box_name: String,
    /// True while the server is connected.
    pub is_connected: bool,
    /// Why it is not, in technical words.
    pub trouble: String,
    /// True if it refuses the box: a person has to act.
    pub is_refused: bool,
    /// Why the camera is missing, as a name that the screen has a text for.
    pub camera_fault: Option<&'static str>,
    /// The state as the server hears it.
    pub state: AgentState,
    /// True if the clock of this computer has to be set.
    pub is_clock_wrong: bool,
    /// The trainee who is checked in.
    pub checked_in: Option<CheckedIn>,
    /// Why the last check-in ended, if neither the trainee nor time ended it; for [`CHECK_IN_END_SHOWN`].
    pub check_in_end: Option<CheckInEnd>,
    /// True if no recording is made without a name.
    pub requires_check_in: bool,
    /// True if key and pedal let a recording begin with the first movement.
    pub starts_on_movement: bool,
    /// Name of the trainee whose recording begins with the first movement.
    pub awaited: Option<String>,
    /// Why a recording that was to begin with the first movement did not.
    pub start_failed: Option<ShownRefusal>,
    /// True if key and pedal start no recording without a name, but only the button that says so.
    pub needs_unnamed_button: bool,
    /// What became of the last recording, if it has no name.
    pub last_unnamed: Option<UnnamedState>,
    /// The limit that the last recording reached, if it was ended for it.
    pub reached_limit: Option<UnnamedLimit>,
    /// Name of the trainee who is recorded; `None` also for a recording without a name.
    pub recorded: Option<String>,
    /// The task of the recording that runs.
    pub recorded_task: Option<String>,
    /// Address for a check-in with a phone.
    pub check_in_address: Option<String>,
    /// The server's address, if a phone cannot open it: there is no code then.
    pub unreachable_server: Option<String>,
    /// True if a check-in with the phone was refused because the consent is missing; for [`CHECK_IN_END_SHOWN`].
    pub is_phone_refused: bool,
    /// Why the last check-in with a PIN was refused, and how long to wait, s.
    pub refusal: Option<(CheckInRefusal, u64)>,
}

impl Standby {
    /// An agent that stands by once [`Standby::run`] is called.
    pub fn new(parts: StandbyParts) -> Self {
        let (outbox, waiting) = mpsc::channel(MAX_WAITING);
        Self(Arc::new(StandbyShared {
            parts,
            outbox,
            waiting: tokio::sync::Mutex::new(waiting),
            facts: Mutex::default(),
            running: Mutex::default(),
            is_held: Arc::default(),
            changes: watch::Sender::new(0),
            spool_changed: Notify::new(),
        }))
    }

    /// Stands by until the shutdown. A recording that runs then ends; what is not sent stays in the spool.
    pub async fn run(&self) {
        let camera = tokio::spawn(self.parts().camera.clone().keep_open(self.clone()));
        let light = tokio::spawn(light::watch(self.clone()));
        let sending = tokio::spawn(self.clone().send_spool());
        let space = tokio::spawn(self.clone().watch_space());
        tokio::select! {
            () = self.clone().stay_connected() => {}
            () = self.parts().shutdown.begun() => {}
        }
        self.end_awaited_start();
        self.end_recording().await;
        for task in [camera, light, sending, space] {
            task.abort();
            let _ = task.await; // the runtime ends next, and no task may use it then
        }
    }

    /// The state of the box.
    pub fn state(&self) -> AgentState {
        let running = self.running().as_ref().map(|running| {
            let session = self.parts().agent.accepted().borrow().filter(|(id, _)| *id == running.id);
            RecordingState {
                recording: running.id,
                trainee: running.trainee.as_ref().map(|of| of.id),
                task: running.task.as_ref().map(|of| of.id),
                session: session.map(|(_, session)| session),
                recorded_s: running.began.elapsed().as_secs_f64(),
                frames: self.parts().agent.status().captured,
            }
        });
        let mut camera = self.parts().camera.state();
        let is_held = camera.is_open && self.0.is_held.load(Ordering::Acquire);
        camera.is_exposure_held = self.parts().hold_controls.as_ref().map(|_| is_held);
        AgentState {
            camera,
            light: self.parts().camera.light(),
            spool: self.spool_state(),
            clock: self.clock_state(),
            recording: running,
            awaited_start: self.awaited_start_state(),
            can_start_on_movement: true,
        }
    }

    fn spool_state(&self) -> SpoolState {
        let refused = self.facts().refused_recording.clone();
        let spool = self.parts().agent.spool();
        let all = || spool.ids().into_iter().filter_map(|id| spool.get(id));
        let unnamed = all().filter(|recording| recording.is_unnamed()).count() as u64;
        let (recordings, frames, bytes) = all()
            .map(SpooledRecording::waiting)
            .fold((0, 0, 0), |(count, frames, bytes), one| (count + 1, frames + one.0, bytes + one.1));
        let is_full = space::is_short(&spool);
        drop(spool);
        let disk = rustix::fs::statvfs(&self.parts().spool).ok();
        let disk_free_bytes = disk.map(|disk| disk.f_bavail.saturating_mul(disk.f_frsize));
        SpoolState { recordings, frames, bytes, unnamed, disk_free_bytes, is_full, refused }
    }

    /// The same for the screen.
    pub fn screen_state(&self) -> ScreenState {
        let version = *self.0.changes.borrow();
        let state = self.state();
        let (recorded, recorded_task) = self.running().as_ref().map_or((None, None), |running| {
            let (trainee, task) = (running.trainee.as_ref(), running.task.as_ref());
            (trainee.map(|of| of.name.clone()), task.map(|of| of.name.clone()))
        });
        let facts = self.facts();
        ScreenState {
            version,
            box_name: facts.box_name.clone(),
            is_connected: facts.is_connected,
            trouble: facts.trouble.clone(),
            is_refused: facts.is_refused,
            camera_fault: state.camera.why.as_deref().map(refusal::camera_fault),
            is_clock_wrong: state.clock.is_some_and(ClockState::is_wrong),
            state,
            checked_in: facts.checked_in.clone(),
            check_in_end: facts
                .check_in_end
                .filter(|ended| ended.1.elapsed() < CHECK_IN_END_SHOWN)
                .map(|ended| ended.0),
            requires_check_in: self.parts().requires_check_in,
            starts_on_movement: self.parts().starts_on_movement,
            awaited: facts.awaited.as_ref().map(|awaited| awaited.trainee.name.clone()),
            start_failed: facts.start_failed.as_ref().map(ShownRefusal::from),
            needs_unnamed_button: facts.needs_unnamed_button,
            last_unnamed: facts.last_unnamed.map(|(_, state)| state),
            reached_limit: facts.reached_limit,
            recorded,
            recorded_task,
            check_in_address: facts.check_in_address.clone(),
            unreachable_server: facts.unreachable_server.clone(),
            is_phone_refused: facts.phone_refusal.is_some_and(|(_, since)| since.elapsed() < CHECK_IN_END_SHOWN),
            refusal: facts.refusal,
        }
    }

    /// Waits until something has changed since this version of [`ScreenState`].
    pub async fn changed_since(&self, version: u64) {
        let _ = self.0.changes.subscribe().wait_for(|now| *now != version).await; // the sender lives as long as this
    }

    /// A trainee typed code and PIN at the box. False if the server cannot be asked now.
    pub fn check_in(&self, trainee: String, pin: String) -> bool {
        if self.running().is_some() {
            self.facts().refusal = Some((CheckInRefusal::Recording, 0));
            self.note_change();
            return true;
        }
        self.facts().refusal = None;
        self.facts().is_connected && self.0.outbox.try_send(AgentMessage::CheckIn { trainee, pin }).is_ok()
    }

    /// The trainee leaves the box.
    pub fn check_out(&self) {
        {
            let mut facts = self.facts();
            facts.left = facts.checked_in.take().map(|checked_in| checked_in.trainee.id).or(facts.left);
            facts.chosen = None;
        }
        let _ = self.0.outbox.try_send(AgentMessage::CheckOut); // without a connection it is sent with the next one
        self.end_awaited_start_of_another();
        self.note_change();
    }

    /// A task was chosen at the box. False if it is none of those that the box offers.
    pub fn choose_task(&self, id: &str) -> bool {
        let chosen = {
            let mut facts = self.facts();
            facts.active = Some(Instant::now());
            let Some(checked_in) = &mut facts.checked_in else { return false };
            let task: Option<NamedTask> = checked_in.tasks.iter().find(|task| task.id.to_string() == id).cloned();
            checked_in.task = task.clone().or(checked_in.task.take());
            facts.chosen = task.as_ref().map(|task| task.id).or(facts.chosen);
            task
        };
        let Some(task) = chosen else { return false };
        let _ = self.0.outbox.try_send(AgentMessage::Task { task: task.id }); // without a connection it is sent with the next one
        self.await_other_task(task);
        self.note_change();
        true
    }

    /// The time, epoch ms, corrected by what the server says.
    fn corrected_now_ms(&self) -> i64 {
        let (known, now) = (self.facts().clock, self.computer_time());
        known.map_or(now.shown_ms, |clock| clock.now_ms(now))
    }

    /// The clock of this computer, compared with the server.
    fn clock_state(&self) -> Option<ClockState> {
        let known = self.facts().clock;
        known.map(|clock| clock.state(self.computer_time()))
    }

    fn computer_time(&self) -> ComputerTime {
        let clock = &self.parts().clock;
        ComputerTime { shown_ms: clock.now_ms(), since_boot_ms: clock.since_boot_ms() }
    }

    /// Ends a check-in without activity; without a connection the server cannot say so.
    fn end_idle_check_in(&self) {
        let is_recording = self.running().is_some();
        let mut facts = self.facts();
        if is_recording {
            facts.active = Some(Instant::now());
        }
        let idle = facts.active.map(|active| active.elapsed());
        let is_idle = |checked_in: &CheckedIn| idle.is_some_and(|idle| idle > Duration::from_secs(checked_in.idle_s));
        if facts.checked_in.take_if(|checked_in| is_idle(checked_in)).is_some() {
            drop(facts);
            self.end_awaited_start_of_another();
            self.note_change();
        }
    }

    fn note_change(&self) {
        self.0.changes.send_modify(|version| *version += 1);
    }

    fn parts(&self) -> &StandbyParts {
        &self.0.parts
    }

    fn facts(&self) -> MutexGuard<'_, Facts> {
        self.0.facts.lock().unwrap_or_else(PoisonError::into_inner) // every change is one assignment
    }

    fn running(&self) -> MutexGuard<'_, Option<RunningRecording>> {
        self.0.running.lock().unwrap_or_else(PoisonError::into_inner) // as above
    }
}

#[cfg(test)]
mod tests;
