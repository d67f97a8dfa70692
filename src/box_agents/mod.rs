//! The agents that stand by at boxes, as this service knows them: which are connected, the state of each, who is checked
//! in, and the commands that are under way.
//!
//! ```text
//! page ──start, stop──▶ BoxAgents::command ──▶ AgentConnection ──WebSocket──▶ agent
//!                            ▲ answer ────────── heard ◀── state, done ──────────┘
//! ```
//! All of it is in memory. The store keeps only when each agent was seen last, so that a page can say since when a box is
//! silent after the service was started again. A check-in ends with the service: the trainee checks in again.

mod check_in_code;
mod pin_attempts;

pub use check_in_code::RENEWAL_INTERVAL;
pub use pin_attempts::PinAttempts;

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::{mpsc, oneshot};
use tokio::time::timeout;

use check_in_code::CheckInCodes;

use crate::domain::box_agent::messages::{CheckInEnd, NamedTask, NamedTrainee, StartCommand, StopTarget, ToAgent};
use crate::domain::box_agent::state::AgentState;
use crate::domain::box_agent::{CHECK_IN_IDLE, SILENT_AFTER};
use crate::domain::scope::Scope;
use crate::ids::{BoxId, FeedId, SessionId, TraineeId};
use crate::time::{SharedClock, millis};

/// Messages that may wait for an agent. One that does not read them is disconnected.
const MAX_WAITING: usize = 32;
/// How long an agent may take to answer a command. It opens no file and no camera for it.
const COMMAND_TIMEOUT: Duration = Duration::from_secs(8);

/// The agents of all boxes. Clones share them.
#[derive(Clone, Debug)]
pub struct BoxAgents(Arc<BoxAgentsParts>);

#[derive(Debug)]
struct BoxAgentsParts {
    clock: SharedClock,
    state: Mutex<Registry>,
    pin_attempts: PinAttempts,
}

#[derive(Debug, Default)]
struct Registry {
    agents: HashMap<BoxId, BoxEntry>,
    /// Number of the last connection or command.
    last_number: u64,
}

/// What is known of one box.
#[derive(Debug, Default)]
struct BoxEntry {
    link: Option<AgentLink>,
    program: String,
    state: Option<AgentState>,
    /// True if it was recording when it was last heard of, also on an earlier connection.
    was_recording: bool,
    /// When the last message arrived: by the monotonic clock, and epoch ms.
    heard: Option<(i64, i64)>,
    check_in: Option<CheckIn>,
    /// Why the last check-in ended, if it was ended here, and when, by the monotonic clock, ms.
    check_in_end: Option<(CheckInEnd, i64)>,
    /// When a check-in with a code was last refused for missing consent: epoch ms, and by the monotonic clock.
    phone_refusal: Option<(i64, i64)>,
    codes: CheckInCodes,
    check_in_page: CheckInPage,
    /// Commands without an answer.
    waiting: HashMap<u64, oneshot::Sender<Result<(), String>>>,
}

/// The page that a trainee opens on a phone to check in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CheckInPage {
    /// Its address; a code is added to it.
    At(String),
    /// A phone could not open it: this address of the server leads to the phone itself.
    Unreachable(String),
}

impl Default for CheckInPage {
    fn default() -> Self {
        Self::Unreachable(String::new())
    }
}

/// The way to a connected agent.
#[derive(Debug)]
struct AgentLink {
    number: u64,
    sender: mpsc::Sender<ToAgent>,
}

/// A trainee who is checked in at a box.
#[derive(Clone, Debug)]
pub struct CheckIn {
    /// The trainee.
    pub trainee: NamedTrainee,
    /// The scope of the trainee, or of the person who checked the trainee in: what the box may show.
    pub scope: Scope,
    /// The task of the next recording.
    pub task: Option<NamedTask>,
    /// The last recording since the check-in.
    pub last: Option<SessionId>,
    /// When the trainee checked in, epoch ms.
    pub since_ms: i64,
    /// When the trainee last did something, by the monotonic clock, ms.
    active_ms: i64,
}

impl CheckIn {
    /// True if nothing has happened for so long that it has ended.
    fn is_idle(&self, now_ms: i64) -> bool {
        now_ms - self.active_ms > millis(CHECK_IN_IDLE)
    }
}

/// The state of a box's agent, for readers.
#[derive(Clone, Debug, Default)]
pub struct BoxAgentView {
    /// True if it is connected and was heard of a moment ago.
    pub is_online: bool,
    /// When it was last heard of by this service, epoch ms.
    pub last_seen_ms: Option<i64>,
    /// Its program and version.
    pub program: String,
    /// Its last state; old if it is not online.
    pub state: Option<AgentState>,
    /// Who is checked in.
    pub check_in: Option<CheckIn>,
    /// The server's address, if a phone cannot check in with it.
    pub unreachable_server: Option<String>,
}

/// Why a command was not carried out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CommandError {
    /// The agent is not connected.
    Silent,
    /// It did not answer in time: it may carry out the command or not.
    NoAnswer,
    /// It refused: why, for people.
    Refused(String),
}

/// A command to an agent.
#[derive(Clone, Debug)]
pub enum AgentCommand {
    /// Start a recording of this trainee doing this task; without a trainee it waits for a name.
    Start(FeedId, Option<NamedTrainee>, Option<NamedTask>),
    /// The same with the first movement in the picture.
    StartOnMovement(FeedId, NamedTrainee, NamedTask),
    /// End this recording, or this wait for the first movement.
    Stop(StopTarget),
}

impl BoxAgents {
    /// No agent is known.
    pub fn new(clock: SharedClock) -> Self {
        let pin_attempts = PinAttempts::new(clock.clone());
        Self(Arc::new(BoxAgentsParts { clock, state: Mutex::default(), pin_attempts }))
    }

    /// The counters of wrong PINs.
    pub fn pin_attempts(&self) -> &PinAttempts {
        &self.0.pin_attempts
    }

    /// An agent has connected. An earlier connection of the box ends.
    pub fn connect(&self, of: BoxId, program: String, check_in_page: CheckInPage) -> AgentConnection {
        let (sender, inbox) = mpsc::channel(MAX_WAITING);
        let now = self.now();
        let mut registry = self.lock();
        registry.last_number += 1;
        let number = registry.last_number;
        let entry = registry.agents.entry(of).or_default();
        entry.waiting.clear(); // commands that went to the earlier connection
        (entry.link, entry.program, entry.heard) = (Some(AgentLink { number, sender }), program, Some(now));
        // What the agent reported on its earlier connection may not be true any more.
        (entry.check_in_page, entry.state) = (check_in_page, None);
        entry.send_phone_refusal(now.0);
        AgentConnection { agents: self.clone(), of, number, inbox }
    }

    /// The state of one box's agent.
    pub fn view(&self, of: BoxId) -> BoxAgentView {
        let now_ms = self.0.clock.monotonic_ms();
        let registry = self.lock();
        let Some(entry) = registry.agents.get(&of) else { return BoxAgentView::default() };
        BoxAgentView {
            is_online: entry.is_online(now_ms),
            last_seen_ms: entry.heard.map(|(_, at_ms)| at_ms),
            program: entry.program.clone(),
            state: entry.state.clone(),
            check_in: entry.check_in.clone().filter(|check_in| !check_in.is_idle(now_ms)),
            unreachable_server: match &entry.check_in_page {
                CheckInPage::Unreachable(server) if entry.link.is_some() => Some(server.clone()),
                _ => None,
            },
        }
    }

    /// True if a box recorded when it was last heard of: a box without a network records on.
    pub fn was_recording(&self, of: BoxId) -> bool {
        self.lock().agents.get(&of).is_some_and(|entry| entry.was_recording)
    }

    /// Sends a command and waits for the answer.
    ///
    /// # Errors
    /// [`CommandError`].
    pub async fn command(&self, of: BoxId, command: AgentCommand) -> Result<(), CommandError> {
        let (answer, answered) = oneshot::channel();
        {
            let now_ms = self.0.clock.monotonic_ms();
            let mut registry = self.lock();
            registry.last_number += 1;
            let number = registry.last_number;
            let entry = registry.agents.get_mut(&of).filter(|entry| entry.is_online(now_ms));
            let entry = entry.ok_or(CommandError::Silent)?;
            let message = match command {
                AgentCommand::Start(recording, trainee, task) => {
                    ToAgent::Start(StartCommand { command: number, recording, trainee, task, on_movement: false })
                }
                AgentCommand::StartOnMovement(recording, trainee, task) => {
                    let (trainee, task) = (Some(trainee), Some(task));
                    ToAgent::Start(StartCommand { command: number, recording, trainee, task, on_movement: true })
                }
                AgentCommand::Stop(target) => ToAgent::Stop { command: number, target: Some(target) },
            };
            if !entry.send(message) {
                return Err(CommandError::Silent);
            }
            entry.waiting.retain(|_, waiting| !waiting.is_closed());
            entry.waiting.insert(number, answer);
        }
        match timeout(COMMAND_TIMEOUT, answered).await {
            Ok(Ok(Ok(()))) => Ok(()),
            Ok(Ok(Err(why))) => Err(CommandError::Refused(why)),
            Ok(Err(_)) | Err(_) => Err(CommandError::NoAnswer),
        }
    }

    /// Sends a message to a box's agent, if it is connected.
    pub fn send(&self, of: BoxId, message: ToAgent) {
        if let Some(entry) = self.lock().agents.get_mut(&of) {
            entry.send(message);
        }
    }

    /// Lets a box show another code for checking in.
    pub fn renew_check_in_code(&self, of: BoxId) {
        let now_ms = self.0.clock.monotonic_ms();
        if let Some(entry) = self.lock().agents.get_mut(&of) {
            entry.renew_code(now_ms);
        }
    }

    /// Uses up a code that a box shows; the box shows the next one. False if it is none, or too old.
    pub fn use_check_in_code(&self, of: BoxId, code: &str) -> bool {
        let now_ms = self.0.clock.monotonic_ms();
        let mut registry = self.lock();
        let Some(entry) = registry.agents.get_mut(&of) else { return false };
        let is_valid = entry.codes.use_up(code, now_ms);
        if is_valid {
            entry.renew_code(now_ms);
        }
        is_valid
    }

    /// A check-in with a code of the box was refused, because the trainee does not consent to recordings: the box starts no
    /// recording without a name by itself then, because the same person might be recorded.
    pub fn refuse_phone_check_in(&self, of: BoxId) {
        let (now_ms, at_ms) = self.now();
        if let Some(entry) = self.lock().agents.get_mut(&of) {
            entry.phone_refusal = Some((at_ms, now_ms));
            entry.send_phone_refusal(now_ms);
        }
    }

    /// Checks a trainee in at a box. Another one is checked out.
    pub fn check_in(&self, of: BoxId, trainee: NamedTrainee, scope: Scope, task: Option<NamedTask>) {
        let (active_ms, since_ms) = self.now();
        let check_in = CheckIn { trainee, scope, task, last: None, since_ms, active_ms };
        let mut registry = self.lock();
        let entry = registry.agents.entry(of).or_default();
        (entry.check_in, entry.check_in_end, entry.phone_refusal) = (Some(check_in), None, None);
    }

    /// Why the last check-in at a box was ended, for as long as its agent has to hear of it: it may have had no connection
    /// then.
    pub fn check_in_end(&self, of: BoxId) -> Option<CheckInEnd> {
        let now_ms = self.0.clock.monotonic_ms();
        let ended = self.lock().agents.get(&of)?.check_in_end;
        ended.filter(|(_, since_ms)| now_ms - since_ms <= millis(CHECK_IN_IDLE)).map(|(why, _)| why)
    }

    /// The trainees who are checked in, each with the box and the scope of the check-in.
    pub fn check_ins(&self) -> Vec<(BoxId, CheckIn)> {
        let of_one = |(of, entry): (&BoxId, &BoxEntry)| Some((*of, entry.check_in.clone()?));
        self.lock().agents.iter().filter_map(of_one).collect()
    }

    /// Ends the check-in of this trainee at a box, unless another one has checked in meanwhile. True if it has ended.
    pub fn end_check_in(&self, of: BoxId, trainee: TraineeId, why: CheckInEnd) -> bool {
        let now_ms = self.0.clock.monotonic_ms();
        let mut registry = self.lock();
        let Some(entry) = registry.agents.get_mut(&of) else { return false };
        let has_ended = entry.check_in.take_if(|check_in| check_in.trainee.id == trainee).is_some();
        if has_ended {
            entry.check_in_end = Some((why, now_ms));
        }
        has_ended
    }

    /// The trainee whose first movement a box awaits, as it said last.
    pub fn awaited_trainee(&self, of: BoxId) -> Option<TraineeId> {
        let now_ms = self.0.clock.monotonic_ms();
        self.lock().agents.get(&of)?.awaited_trainee(now_ms)
    }

    /// The trainees whose first movement is awaited at a box that can be reached.
    pub fn awaited_starts(&self) -> Vec<(BoxId, TraineeId)> {
        let now_ms = self.0.clock.monotonic_ms();
        let of_one = |(of, entry): (&BoxId, &BoxEntry)| Some((*of, entry.awaited_trainee(now_ms)?));
        self.lock().agents.iter().filter_map(of_one).collect()
    }

    /// Orders that the first movement of this trainee is awaited no longer, and does not wait for the answer: the agent says
    /// in its state what it does.
    pub fn end_awaited_start(&self, of: BoxId, trainee: TraineeId) {
        let mut registry = self.lock();
        registry.last_number += 1;
        let command = registry.last_number;
        if let Some(entry) = registry.agents.get_mut(&of) {
            entry.send(ToAgent::Stop { command, target: Some(StopTarget::AwaitedStart(trainee)) });
        }
    }

    /// Ends the check-in at a box. Returns it.
    pub fn check_out(&self, of: BoxId) -> Option<CheckIn> {
        self.lock().agents.get_mut(&of)?.check_in.take()
    }

    /// A recording of a box was accepted as this session. Returns true if a trainee is checked in there, whose it may be.
    pub fn note_session(&self, of: BoxId, session: SessionId) -> bool {
        let mut registry = self.lock();
        let check_in = registry.agents.get_mut(&of).and_then(|entry| entry.check_in.as_mut());
        check_in.map(|check_in| check_in.last = Some(session)).is_some()
    }

    /// Sets the task of the next recording of the trainee who is checked in.
    pub fn choose_task(&self, of: BoxId, task: NamedTask) {
        let now_ms = self.0.clock.monotonic_ms();
        if let Some(check_in) = self.lock().agents.get_mut(&of).and_then(|entry| entry.check_in.as_mut()) {
            (check_in.task, check_in.active_ms) = (Some(task), now_ms);
        }
    }

    fn now(&self) -> (i64, i64) {
        (self.0.clock.monotonic_ms(), self.0.clock.now_ms())
    }

    fn lock(&self) -> MutexGuard<'_, Registry> {
        self.0.state.lock().unwrap_or_else(PoisonError::into_inner) // every change is one assignment
    }
}

impl BoxEntry {
    fn is_online(&self, now_ms: i64) -> bool {
        let is_fresh = |(heard_ms, _): (i64, i64)| now_ms - heard_ms <= millis(SILENT_AFTER);
        self.link.is_some() && self.heard.is_some_and(is_fresh)
    }

    fn awaited_trainee(&self, now_ms: i64) -> Option<TraineeId> {
        let state = self.state.as_ref().filter(|_| self.is_online(now_ms))?;
        state.awaited_start.map(|awaited| awaited.trainee)
    }

    /// Sends a message. False if there is no connection, or its agent does not read; it is then disconnected.
    fn send(&mut self, message: ToAgent) -> bool {
        let is_sent = self.link.as_ref().is_some_and(|link| link.sender.try_send(message).is_ok());
        if !is_sent {
            self.link = None;
        }
        is_sent
    }

    fn renew_code(&mut self, now_ms: i64) {
        let message = match &self.check_in_page {
            CheckInPage::At(page) => {
                let code = self.codes.add(now_ms);
                ToAgent::CheckInAddress { address: format!("{page}#{}", code.as_str()) }
            }
            CheckInPage::Unreachable(server) => ToAgent::NoCheckInAddress { server: server.clone() },
        };
        self.send(message);
    }

    /// Says that a check-in with the phone was refused, for as long as the person may be there.
    fn send_phone_refusal(&mut self, now_ms: i64) {
        let fresh = self.phone_refusal.filter(|(_, since_ms)| now_ms - since_ms <= millis(CHECK_IN_IDLE));
        if let Some((refused_at_ms, _)) = fresh {
            self.send(ToAgent::PhoneCheckInRefused { refused_at_ms });
        }
    }

    /// Ends a check-in without activity. Returns true if it ended.
    fn end_idle_check_in(&mut self, now_ms: i64) -> bool {
        self.check_in.take_if(|check_in| check_in.is_idle(now_ms)).is_some()
    }
}

/// The connection of one agent. Dropping it disconnects the agent.
#[derive(Debug)]
pub struct AgentConnection {
    agents: BoxAgents,
    of: BoxId,
    number: u64,
    inbox: mpsc::Receiver<ToAgent>,
}

impl AgentConnection {
    /// The next message to send; `None`: a later connection has replaced this one, or the agent does not read.
    pub async fn next(&mut self) -> Option<ToAgent> {
        self.inbox.recv().await
    }

    /// The agent reports its state. Returns true if the check-in ended, because nothing happened for too long.
    pub fn heard(&self, state: AgentState) -> bool {
        let now = self.agents.now();
        let mut registry = self.agents.lock();
        let Some(entry) = registry.agents.get_mut(&self.of).filter(|entry| self.is_of(entry)) else {
            return false;
        };
        if let (Some(check_in), Some(recording)) = (&mut entry.check_in, &state.recording)
            && recording.trainee == Some(check_in.trainee.id)
        {
            check_in.active_ms = now.0;
        }
        let has_ended = entry.end_idle_check_in(now.0);
        entry.was_recording = state.recording.is_some();
        (entry.state, entry.heard) = (Some(state.limited()), Some(now));
        has_ended
    }

    /// The agent answers a command.
    pub fn answered(&self, command: u64, refused: Option<String>) {
        let mut registry = self.agents.lock();
        let Some(entry) = registry.agents.get_mut(&self.of).filter(|entry| self.is_of(entry)) else { return };
        if let Some(waiting) = entry.waiting.remove(&command) {
            let _ = waiting.send(refused.map_or(Ok(()), Err)); // the person who asked may be gone
        }
    }

    fn is_of(&self, entry: &BoxEntry) -> bool {
        entry.link.as_ref().is_some_and(|link| link.number == self.number)
    }
}

impl Drop for AgentConnection {
    fn drop(&mut self) {
        let mut registry = self.agents.lock();
        if let Some(entry) = registry.agents.get_mut(&self.of)
            && self.is_of(entry)
        {
            entry.link = None;
            entry.waiting.clear();
        }
    }
}

#[cfg(test)]
mod tests;
