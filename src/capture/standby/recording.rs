//! Start and end of a recording, and sending what the spool holds.

use std::collections::HashMap;
use std::time::Duration;

use tokio::task::{JoinHandle, block_in_place};
use tokio::time::{Instant, timeout};

use super::Standby;
use super::camera::RecordedCamera;
use super::refusal::BoxRefusal;
use super::unnamed::{self, UnnamedState};
use crate::capture::held_controls::{HeldControls, SETTLE_TIME};
use crate::capture::recorder::{RecordingRules, record};
use crate::capture::sender::{SendOutcome, send};
use crate::capture::source::FrameSource;
use crate::capture::spool::{SpooledRecording, StartMoment};
use crate::domain::box_agent::messages::{CheckInRefusal, CheckedIn, NamedTask, NamedTrainee, StopTarget};
use crate::domain::feed::PROTOCOL;
use crate::domain::feed::messages::Hello;
use crate::ids::FeedId;
use crate::shutdown::Shutdown;
use crate::time::to_rfc3339;

/// How long the end of a recording may take when the agent ends: frames that wait for a slow disk are still written. The
/// unit allows 15 s.
const END_TIMEOUT: Duration = Duration::from_secs(12);
/// How long the answer to a stop waits for the end of the recording: usually a tenth of a second.
const STOP_PATIENCE: Duration = Duration::from_secs(1);
/// When a recording that the server refused is offered again: a person may have removed the cause.
const REFUSED_PAUSE: Duration = Duration::from_secs(15 * 60);
/// When a recording is tried again that could not be sent for another reason, such as no space for its file. Others are
/// sent meanwhile.
const POSTPONED_PAUSE: Duration = Duration::from_secs(60);
/// How often the spool is looked at without a reason.
const LOOK_INTERVAL: Duration = Duration::from_secs(30);

/// The recording that is being made.
pub(super) struct RunningRecording {
    pub(super) id: FeedId,
    /// `None`: it has no name.
    pub(super) trainee: Option<NamedTrainee>,
    pub(super) task: Option<NamedTask>,
    pub(super) began: Instant,
    ending: Shutdown,
    recorder: Option<JoinHandle<()>>,
    controls: Option<HeldControls>,
}

/// The result of sending a recording of the spool.
pub(super) enum SpoolOutcome {
    /// The server has it.
    Sent,
    /// It has no frames.
    Empty,
    /// The server refuses it: why, and what to do. The recording stays in the spool.
    Refused(String),
    /// It could not be sent now: why, and what to do. The recording stays in the spool.
    Postponed(String),
}

/// A recording that could not be sent, and when it is tried again.
struct Unsent {
    since: Instant,
    until: Instant,
    why: String,
}

impl Unsent {
    fn until(pause: Duration, why: String) -> Self {
        let since = Instant::now();
        Self { since, until: since + pause, why }
    }
}

/// What was pressed at the box to start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StartPress {
    /// The key, the pedal, or the button that starts a recording of the trainee who is checked in.
    Start,
    /// The button that lets the recording of the trainee who is checked in begin with the first movement; on a box that
    /// starts by itself also key and pedal.
    OnMovement,
    /// The button that starts a recording without a name.
    WithoutName,
}

impl Standby {
    /// Starts a recording at the box: of the trainee who is checked in, or without a name.
    ///
    /// # Errors
    /// Why not.
    pub fn start_at_box(&self, press: StartPress) -> Result<(), BoxRefusal> {
        if press == StartPress::Start
            && let Some(started) = self.start_awaited_now()
        {
            return started;
        }
        let id = FeedId::at(self.corrected_now_ms());
        let (checked_in, needs_button) = {
            let facts = self.facts();
            (facts.checked_in.clone(), facts.needs_unnamed_button && !self.parts().requires_check_in)
        };
        match (checked_in, press) {
            (Some(_), StartPress::WithoutName) => Err(BoxRefusal::CheckedIn),
            (Some(CheckedIn { trainee, task: Some(task), .. }), StartPress::Start) => {
                self.start(id, Some(trainee), Some(task))
            }
            (Some(CheckedIn { trainee, task: Some(task), .. }), StartPress::OnMovement) => {
                self.await_movement(trainee, task)
            }
            (Some(_), StartPress::Start | StartPress::OnMovement) => Err(BoxRefusal::NoTask),
            (None, StartPress::OnMovement) => Err(BoxRefusal::MovementNeedsCheckIn),
            (None, StartPress::Start) if needs_button => Err(BoxRefusal::NeedsButton),
            (None, StartPress::Start | StartPress::WithoutName) => {
                self.end_awaited_start();
                self.start(id, None, None)?;
                self.facts().needs_unnamed_button = false;
                Ok(())
            }
        }
    }

    /// Starts a recording; without a trainee it waits for a name.
    ///
    /// # Errors
    /// Why not.
    pub(super) fn start(
        &self,
        id: FeedId,
        trainee: Option<NamedTrainee>,
        task: Option<NamedTask>,
    ) -> Result<(), BoxRefusal> {
        if trainee.is_some() && task.is_none() {
            return Err(BoxRefusal::NoTask);
        }
        if trainee.is_none() {
            self.check_unnamed_start()?;
        }
        self.start_locked(&mut self.running(), id, trainee, task)
    }

    /// The same with the lock of the recording that runs: what is checked under it holds until the recording runs.
    pub(super) fn start_locked(
        &self,
        running: &mut Option<RunningRecording>,
        id: FeedId,
        trainee: Option<NamedTrainee>,
        task: Option<NamedTask>,
    ) -> Result<(), BoxRefusal> {
        if running.is_some() {
            return Err(BoxRefusal::Running);
        }
        let camera = self.parts().camera.begin().ok_or(BoxRefusal::CameraMissing)?;
        let began = camera.first_arrived.unwrap_or_else(Instant::now);
        let start = self.uncorrected_start(began);
        let hello = self.hello(id, (trainee.as_ref(), task.as_ref()), &camera);
        let in_box = self.parts().server.in_box();
        let begun = block_in_place(|| self.parts().agent.spool().begin_uncorrected(hello, in_box, start));
        if let Err(error) = begun {
            self.parts().camera.end();
            return Err(BoxRefusal::of_disk(&error));
        }
        self.parts().agent.status().captured = 0;
        let ending = Shutdown::new();
        let held = self.parts().hold_controls.clone();
        let controls = held.map(|hold| HeldControls::begin(hold, self.settle_time(), self.0.is_held.clone()));
        let (name, of_task) = (trainee.as_ref().map(|of| &of.name), task.as_ref().map(|of| &of.name));
        tracing::info!(recording = %id, trainee = name, task = of_task, "recording");
        let seconds = trainee.is_none().then_some(unnamed::MAX_SECONDS);
        let recorder = tokio::spawn(self.clone().record(camera, seconds, ending.clone()));
        {
            let mut facts = self.facts();
            (facts.last_unnamed, facts.awaited, facts.start_failed) = (None, None, None);
            facts.reached_limit = None;
        }
        self.parts().camera.unwatch();
        *running = Some(RunningRecording { id, trainee, task, began, ending, recorder: Some(recorder), controls });
        self.0.spool_changed.notify_one();
        self.note_change();
        Ok(())
    }

    async fn record(self, camera: RecordedCamera, seconds: Option<f64>, ending: Shutdown) {
        let rules = RecordingRules {
            is_paced: false, // the camera's frames come at their times
            seconds,
            time_base: camera.info().time_base,
            first_arrived: camera.first_arrived,
            holds_controls: self.parts().hold_controls.is_some(),
        };
        let ended = record(&self.parts().agent, camera, rules, &ending).await;
        tracing::info!(frames = ended.frames, source_lost = ended.source_lost, "recording ended");
        self.parts().camera.end();
        let ended_running = self.running().take();
        if let Some(controls) = ended_running.as_ref().and_then(|running| running.controls.as_ref()) {
            controls.release();
        }
        let unnamed = ended_running.filter(|running| running.trainee.is_none() && ended.frames > 0);
        {
            let mut facts = self.facts();
            facts.active = Some(Instant::now());
            facts.refusal = facts.refusal.filter(|(why, _)| *why != CheckInRefusal::Recording);
            facts.last_unnamed = unnamed.map(|running| (running.id, UnnamedState::Kept));
        }
        self.0.spool_changed.notify_one();
        self.note_change();
    }

    /// How long the controls of the camera have to settle yet.
    fn settle_time(&self) -> Duration {
        SETTLE_TIME.saturating_sub(self.parts().camera.open_for())
    }

    /// The camera was opened: a recording that runs holds its controls again, because a camera that was unplugged has
    /// its automatic exposure on.
    pub(super) fn hold_controls_again(&self) {
        let settle = self.settle_time();
        if let Some(controls) = self.running().as_mut().and_then(|running| running.controls.as_mut()) {
            controls.hold_again(settle);
        }
    }

    /// Ends the recording that runs, or no longer awaits the movement that was to start one. On a slow disk the last frames
    /// may still be written afterwards.
    ///
    /// # Errors
    /// There is none, or it is ending already.
    pub async fn stop(&self) -> Result<(), BoxRefusal> {
        if self.end_awaited_start() {
            return Ok(());
        }
        self.stop_recording(None).await
    }

    /// Ends what the server knew of when it gave the order, and nothing else that the box has begun since.
    ///
    /// # Errors
    /// It has ended already, or is ending.
    pub(super) async fn stop_target(&self, target: StopTarget) -> Result<(), BoxRefusal> {
        match target {
            StopTarget::Recording(id) => self.stop_recording(Some(id)).await,
            StopTarget::AwaitedStart(trainee) if self.end_awaited_start_of(trainee) => Ok(()),
            StopTarget::AwaitedStart(_) => Err(BoxRefusal::StopTooLate),
        }
    }

    /// Ends the recording that runs. `id`: only if it is this one.
    async fn stop_recording(&self, id: Option<FeedId>) -> Result<(), BoxRefusal> {
        {
            let running = self.running();
            let running = running.as_ref().ok_or(BoxRefusal::NotRunning)?;
            if id.is_some_and(|id| id != running.id) {
                return Err(BoxRefusal::StopTooLate);
            }
            if running.ending.is_begun() {
                return Err(BoxRefusal::Ending);
            }
            running.ending.begin();
        }
        // So that the state that follows the answer has no recording any more.
        let mut changes = self.0.changes.subscribe();
        let _ = timeout(STOP_PATIENCE, changes.wait_for(|_| self.running().is_none())).await;
        Ok(())
    }

    /// The agent ends: so does the recording that runs. Waits until all of it is in the spool.
    pub(super) async fn end_recording(&self) {
        let recorder = self.running().as_mut().and_then(|running| {
            if !running.ending.is_begun() {
                self.parts().agent.spool().note_broken_off("the agent was stopped while it recorded");
            }
            running.ending.begin();
            running.recorder.take()
        });
        if let Some(recorder) = recorder
            && timeout(END_TIMEOUT, recorder).await.is_err()
        {
            tracing::warn!("the recording did not end in time; the next start of the agent sends it");
        }
    }

    /// What is known of a recording. Without a name it is not sent as a feed, and the trainee is empty.
    fn hello(
        &self,
        id: FeedId,
        (trainee, task): (Option<&NamedTrainee>, Option<&NamedTask>),
        camera: &RecordedCamera,
    ) -> Hello {
        let info = camera.info();
        let kept_ms = camera.first_arrived.map_or(0, |arrived| crate::time::millis(arrived.elapsed()));
        Hello {
            protocol: PROTOCOL,
            recording: id,
            trainee: trainee.map(|of| of.id.to_string()).unwrap_or_default(),
            task: task.map(|of| of.id.to_string()).unwrap_or_default(),
            codec: info.codec,
            width: info.size.0,
            height: info.size.1,
            time_base: info.time_base,
            began_at: to_rfc3339(self.corrected_now_ms() - kept_ms),
            sender: super::link::PROGRAM.to_owned(),
            resumes: true,
        }
    }

    /// Sends what the spool holds: the recording that runs first, then the others, the oldest first.
    pub(super) async fn send_spool(self) {
        let agent = &self.parts().agent;
        let mut unsent: HashMap<FeedId, Unsent> = HashMap::new();
        loop {
            let Some(id) = self.next_to_send(&unsent) else {
                let _ = timeout(LOOK_INTERVAL, self.0.spool_changed.notified()).await;
                continue;
            };
            let was_live = agent.spool().live() == Some(id);
            tokio::select! {
                outcome = self.send_one(id) => {
                    unsent.remove(&id);
                    match outcome {
                        SpoolOutcome::Sent | SpoolOutcome::Empty => {}
                        SpoolOutcome::Postponed(why) => drop(unsent.insert(id, Unsent::until(POSTPONED_PAUSE, why))),
                        SpoolOutcome::Refused(why) => {
                            unsent.insert(id, Unsent::until(REFUSED_PAUSE, why.clone()));
                            self.end_refused(id);
                            // The server had ended the recording, and does not take the rest, for example since the
                            // person has withdrawn the consent.
                            let live = agent.spool().live();
                            if let Some(rest) = live.filter(|live| was_live && *live != id) {
                                unsent.insert(rest, Unsent::until(REFUSED_PAUSE, why));
                                self.end_running(id);
                            }
                        }
                    }
                    let newest = unsent.values().max_by_key(|one| one.since);
                    self.facts().refused_recording = newest.map(|one| one.why.clone());
                }
                () = self.another_is_live(id) => {}
            }
            self.note_change();
        }
    }

    /// The recording that is sent next. One without a name is sent when it has ended, and none before its time is known.
    fn next_to_send(&self, unsent: &HashMap<FeedId, Unsent>) -> Option<FeedId> {
        let spool = self.parts().agent.spool();
        let live = spool.live();
        let may_be_sent = |id: &FeedId| {
            let is_due = unsent.get(id).is_none_or(|one| one.until <= Instant::now());
            let recording = spool.get(*id).filter(|recording| is_due && !self.awaits_time(recording));
            recording.is_some_and(|recording| live != Some(*id) || !recording.is_unnamed())
        };
        live.into_iter().chain(spool.ids()).find(may_be_sent)
    }

    async fn send_one(&self, id: FeedId) -> SpoolOutcome {
        if let Err(error) = self.correct_start(id) {
            let why = format!("the spool cannot be written ({error}): free space on the computer of the box");
            return SpoolOutcome::Postponed(why);
        }
        if self.is_unnamed(id) {
            return self.send_unnamed(id).await;
        }
        match send(&self.parts().agent, &self.parts().server, id).await {
            SendOutcome::Complete(session) => {
                tracing::info!(%session, "recording complete on the server");
                SpoolOutcome::Sent
            }
            SendOutcome::Empty => SpoolOutcome::Empty,
            SendOutcome::Refused(why) => SpoolOutcome::Refused(why),
        }
    }

    /// When a recording begins, if the server's time is not known yet.
    fn uncorrected_start(&self, began: Instant) -> Option<StartMoment> {
        let since_boot_ms = self.computer_time().since_boot_ms - crate::time::millis(began.elapsed());
        let is_known = self.facts().clock.is_some();
        (!is_known).then(|| StartMoment { boot: self.parts().boot.clone(), since_boot_ms })
    }

    /// True if the server's time has to be known before a recording is sent: the server keeps the time that it hears first.
    fn awaits_time(&self, recording: &SpooledRecording) -> bool {
        let is_of_this_boot = |start: &StartMoment| start.boot == self.parts().boot;
        recording.uncorrected_start.as_ref().is_some_and(is_of_this_boot) && self.facts().clock.is_none()
    }

    /// Gives a recording that began before the server's time was known its right time, unless the computer was started
    /// again since.
    fn correct_start(&self, id: FeedId) -> std::io::Result<()> {
        let start = self.parts().agent.spool().get(id).and_then(|recording| recording.uncorrected_start.clone());
        let start = start.filter(|start| start.boot == self.parts().boot);
        let Some((clock, start)) = self.facts().clock.zip(start) else { return Ok(()) };
        let began_at = to_rfc3339(clock.at_ms(start.since_boot_ms));
        block_in_place(|| self.parts().agent.spool().set_start(id, began_at))
    }

    fn is_unnamed(&self, id: FeedId) -> bool {
        self.parts().agent.spool().get(id).is_some_and(SpooledRecording::is_unnamed)
    }

    /// Ends a recording that the server does not accept, so that the box does not seem to record.
    fn end_refused(&self, id: FeedId) {
        let was_welcome = self.parts().agent.accepted().borrow().is_some_and(|(accepted, _)| accepted == id);
        if let Some(running) = self.running().as_ref().filter(|running| running.id == id && !was_welcome) {
            running.ending.begin();
        }
    }

    /// Ends the recording that runs and began with this id.
    fn end_running(&self, id: FeedId) {
        if let Some(running) = self.running().as_ref().filter(|running| running.id == id) {
            running.ending.begin();
        }
    }

    /// Waits until another recording than this one runs and can be sent: it is sent first.
    async fn another_is_live(&self, id: FeedId) {
        loop {
            self.0.spool_changed.notified().await;
            let spool = self.parts().agent.spool();
            let other = spool.live().filter(|live| *live != id).and_then(|live| spool.get(live));
            if other.is_some_and(|other| !other.is_unnamed() && !self.awaits_time(other)) {
                return;
            }
        }
    }
}
