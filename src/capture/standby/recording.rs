//! Start and end of a recording, and sending what the spool holds.

use std::collections::HashMap;
use std::time::Duration;

use tokio::task::{JoinHandle, block_in_place};
use tokio::time::{Instant, timeout};

use super::Standby;
use super::camera::RecordedCamera;
use crate::capture::recorder::{RecordingRules, record};
use crate::capture::sender::{SendOutcome, send};
use crate::capture::source::FrameSource;
use crate::domain::box_agent::messages::{NamedTask, NamedTrainee};
use crate::domain::feed::PROTOCOL;
use crate::domain::feed::messages::Hello;
use crate::ids::FeedId;
use crate::shutdown::Shutdown;
use crate::time::to_rfc3339;

/// How long the controls of a camera settle after it was opened.
const SETTLE_TIME: Duration = Duration::from_secs(2);
/// How long the end of a recording may take when the agent ends.
const END_TIMEOUT: Duration = Duration::from_secs(5);
/// When a recording that the server refused is offered again: a person may have removed the cause.
const REFUSED_PAUSE: Duration = Duration::from_secs(15 * 60);
/// How often the spool is looked at without a reason.
const LOOK_INTERVAL: Duration = Duration::from_secs(30);

/// The recording that is being made.
pub(super) struct RunningRecording {
    pub(super) id: FeedId,
    pub(super) trainee: NamedTrainee,
    pub(super) task: NamedTask,
    pub(super) began: Instant,
    ending: Shutdown,
    recorder: Option<JoinHandle<()>>,
}

impl Standby {
    /// Starts a recording of the trainee who is checked in.
    ///
    /// # Errors
    /// Why not, for people.
    pub fn start_for_check_in(&self) -> Result<(), String> {
        let checked_in =
            self.facts().checked_in.clone().ok_or("check in first: no recording is made without a name")?;
        let task = checked_in.task.ok_or("choose a task first")?;
        self.start(FeedId::at(self.corrected_now_ms()), checked_in.trainee, task)
    }

    /// Starts a recording.
    ///
    /// # Errors
    /// Why not, for people.
    pub(super) fn start(&self, id: FeedId, trainee: NamedTrainee, task: NamedTask) -> Result<(), String> {
        let mut running = self.running();
        if running.is_some() {
            return Err("a recording is running already".to_owned());
        }
        let camera = self.parts().camera.begin().ok_or("the camera is missing")?;
        let hello = self.hello(id, (&trainee, &task), &camera);
        let begun = block_in_place(|| self.parts().agent.spool().begin(hello, self.parts().server.in_box()));
        if let Err(error) = begun {
            self.parts().camera.end();
            return Err(format!("the spool cannot be written ({error}): free space on the computer of the box"));
        }
        self.parts().agent.status().captured = 0;
        let ending = Shutdown::new();
        if let Some(hold) = &self.parts().hold_controls {
            let settle = SETTLE_TIME.saturating_sub(self.parts().camera.open_for());
            hold(ending.clone(), settle, self.0.is_held.clone());
        }
        tracing::info!(recording = %id, trainee = trainee.name, task = task.name, "recording");
        let began = camera.first_arrived.unwrap_or_else(Instant::now);
        let recorder = tokio::spawn(self.clone().record(camera, ending.clone()));
        *running = Some(RunningRecording { id, trainee, task, began, ending, recorder: Some(recorder) });
        drop(running);
        self.0.spool_changed.notify_one();
        self.note_change();
        Ok(())
    }

    async fn record(self, camera: RecordedCamera, ending: Shutdown) {
        let rules = RecordingRules {
            is_paced: false, // the camera's frames come at their times
            seconds: None,
            time_base: camera.info().time_base,
            first_arrived: camera.first_arrived,
        };
        let ended = record(&self.parts().agent, camera, rules, &ending).await;
        tracing::info!(frames = ended.frames, source_lost = ended.source_lost, "recording ended");
        ending.begin(); // releases the camera's controls
        self.parts().camera.end();
        self.running().take();
        self.facts().active = Some(Instant::now());
        self.0.spool_changed.notify_one();
        self.note_change();
    }

    /// Ends the recording that runs.
    ///
    /// # Errors
    /// There is none.
    pub fn stop(&self) -> Result<(), String> {
        let running = self.running();
        let running = running.as_ref().ok_or("no recording is running")?;
        running.ending.begin();
        Ok(())
    }

    /// Ends the recording that runs, and waits until all of it is in the spool.
    pub(super) async fn end_recording(&self) {
        let recorder = self.running().as_mut().and_then(|running| {
            running.ending.begin();
            running.recorder.take()
        });
        if let Some(recorder) = recorder
            && timeout(END_TIMEOUT, recorder).await.is_err()
        {
            tracing::warn!("the recording did not end in time; the next start of the agent sends it");
        }
    }

    fn hello(&self, id: FeedId, (trainee, task): (&NamedTrainee, &NamedTask), camera: &RecordedCamera) -> Hello {
        let info = camera.info();
        let kept_ms = camera.first_arrived.map_or(0, |arrived| crate::time::millis(arrived.elapsed()));
        Hello {
            protocol: PROTOCOL,
            recording: id,
            trainee: trainee.id.to_string(),
            task: task.id.to_string(),
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
        let mut refused: HashMap<FeedId, Instant> = HashMap::new();
        loop {
            refused.retain(|_, since| since.elapsed() < REFUSED_PAUSE);
            let next = {
                let spool = agent.spool();
                let live = spool.live();
                let mut waiting = live.into_iter().chain(spool.ids());
                waiting.find(|id| !refused.contains_key(id))
            };
            let Some(id) = next else {
                let _ = timeout(LOOK_INTERVAL, self.0.spool_changed.notified()).await;
                continue;
            };
            let was_live = agent.spool().live() == Some(id);
            tokio::select! {
                outcome = send(agent, &self.parts().server, id) => match outcome {
                    SendOutcome::Complete(session) => {
                        tracing::info!(%session, "recording complete on the server");
                        self.facts().refused_recording = None;
                    }
                    SendOutcome::Empty => {}
                    SendOutcome::Refused(why) => {
                        refused.insert(id, Instant::now());
                        self.facts().refused_recording = Some(why);
                        self.end_refused(id);
                        // The server had ended the recording, and does not take the rest, for example since the person
                        // has withdrawn the consent.
                        let live = agent.spool().live();
                        if let Some(rest) = live.filter(|live| was_live && *live != id) {
                            refused.insert(rest, Instant::now());
                            self.end_running(id);
                        }
                    }
                },
                () = self.another_is_live(id) => {}
            }
            self.note_change();
        }
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

    /// Waits until another recording than this one runs: it is sent first.
    async fn another_is_live(&self, id: FeedId) {
        loop {
            self.0.spool_changed.notified().await;
            if self.parts().agent.spool().live().is_some_and(|live| live != id) {
                return;
            }
        }
    }
}
