//! The connection of an agent that stands by at a box: its state comes in, commands and check-ins go out
//! (`docs/agent.md`). All messages are text.

use std::time::Duration;

use axum::extract::State;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade};
use axum::http::{HeaderMap, header};
use axum::response::Response;
use tokio::time::{Instant, interval, timeout};

use crate::box_agents::{AgentConnection, CheckIn, CheckInPage, RENEWAL_INTERVAL};
use crate::domain::box_agent::CHECK_IN_IDLE;
use crate::domain::box_agent::PROTOCOL;
use crate::domain::box_agent::messages::{
    AgentMessage, CheckInEnd, CheckInRefusal, CheckedIn, LastRecording, NamedTask, NamedTrainee, ToAgent,
};
use crate::domain::box_agent::pin::CheckInPin;
use crate::domain::feed::close_reason::{CloseCode, CloseReason};
use crate::domain::scope::Scope;
use crate::domain::text::Key;
use crate::domain::token_expiry::expires_soon;
use crate::events::{Event, EventDelivery};
use crate::http::auth::password::HashRequester;
use crate::http::auth::signed_in::SignedIn;
use crate::http::base_url::is_of_this_computer;
use crate::http::error::{HandlerResult, Refusal};
use crate::http::read::PathKey;
use crate::http::state::App;
use crate::ids::{BoxId, SessionId, TaskId, TraineeId};
use crate::store::{BoxCommand, PageRequest, SealedSubject, StoreError};
use crate::time::to_rfc3339;

/// Longest message of an agent, bytes.
const MAX_MESSAGE_BYTES: usize = 8192;
/// Longest silence of an agent before its connection is closed. Pages call it silent much earlier.
const SILENCE_TIMEOUT: Duration = Duration::from_secs(20);
/// How long an agent may take to receive a message.
const SEND_TIMEOUT: Duration = Duration::from_secs(5);
/// How long the hello may take to arrive.
const HELLO_TIMEOUT: Duration = Duration::from_secs(10);
/// How often it is stored that an agent was seen, and what the light is compared with is looked up.
const NOTE_INTERVAL: Duration = Duration::from_secs(60);
/// Tasks that a box offers.
const MAX_TASKS: u32 = 60;
/// Longest name of an agent's program, characters.
const MAX_PROGRAM_CHARS: usize = 120;

/// Stand by at a box
///
/// Opens a WebSocket; `docs/agent.md` describes the protocol. For the box's agent only.
#[utoipa::path(get, path = "/boxes/{id}/agent-connection", tag = "boxes",
    params(("id" = String, Path, description = "id or code")),
    responses((status = 101, description = "The connection is a WebSocket from here on")))]
pub async fn agent_connection(
    State(app): State<App>,
    by: SignedIn,
    PathKey(in_box): PathKey,
    headers: HeaderMap,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> HandlerResult<Response> {
    if by.scope.person().is_some() {
        return Err(Refusal::Forbidden.with("Only the agent of a box stands by. Make a token for the box's agent."));
    }
    let upgrade =
        upgrade.map_err(|_| Refusal::BadRequest.with("This address accepts only WebSocket connections of agents."))?;
    let of = app.store.boxes().get(&by.scope, &in_box).await?;
    let place = app.agent_slots.take(&by.scope).ok_or_else(|| {
        let why = "Too many agents stand by with this token, or in all. Stop the others.";
        Refusal::TooMany.with(why).header(header::RETRY_AFTER, 10)
    })?;
    let upgrade = upgrade.max_message_size(MAX_MESSAGE_BYTES).max_frame_size(MAX_MESSAGE_BYTES);
    let upgrade = upgrade.read_buffer_size(4096).write_buffer_size(0).max_write_buffer_size(1 << 18);
    let agent =
        StandingAgent { base: app.base_url(&headers), scope: by.scope, of: of.id, code: of.code.into(), headers };
    Ok(upgrade.on_upgrade(move |mut socket| async move {
        let connection = app.shutdown.spawn({
            let app = app.clone();
            async move {
                let Err(reason) = agent.run(&app, of.name.into(), &mut socket).await;
                agent.note_seen(&app, String::new()).await;
                if let Some(reason) = reason {
                    tracing::info!(in_box = %agent.of, why = reason.why, "connection of an agent closed");
                    let frame = CloseFrame { code: reason.code.number(), reason: reason.truncated().into() };
                    let _ = timeout(SEND_TIMEOUT, socket.send(Message::Close(Some(frame)))).await; // it may be gone
                }
            }
        });
        let _ = connection.await; // a panic is logged where it happened
        drop(place);
    }))
}

/// An agent that stands by, and its box.
struct StandingAgent {
    scope: Scope,
    of: BoxId,
    code: String,
    /// Public address of the service.
    base: String,
    headers: HeaderMap,
}

/// Why a connection ended; `None`: it was lost.
type Ended = Option<CloseReason>;
/// Never returned: a connection always ends with a reason, or is lost.
type Never = std::convert::Infallible;

impl StandingAgent {
    async fn run(&self, app: &App, name: String, socket: &mut WebSocket) -> Result<Never, Ended> {
        let program = self.receive_hello(app, socket).await?;
        let mut connection = app.box_agents.connect(self.of, program.clone(), self.check_in_page());
        self.note_seen(app, program.clone()).await;
        let mut light_reference = self.light_reference(app).await;
        let token_expires_at =
            expires_soon(SignedIn::token_expiry(app, &self.headers).await, app.clock.now_ms()).map(to_rfc3339);
        let (light, max_file_bytes) = (light_reference.clone(), Some(app.service_info.max_upload_bytes));
        let welcome = ToAgent::Welcome { box_name: name, light_reference: light, max_file_bytes, token_expires_at };
        send(socket, &welcome).await?;
        let _ = app.announce_check_in(self.of).await; // a store error is logged there; the agent keeps what it knows
        let mut events = app.events.subscribe();
        let mut signed_out = std::pin::pin!(SignedIn::wait_until_ended(app, &self.headers));
        let (mut renewal, mut noting) = (interval(RENEWAL_INTERVAL), interval(NOTE_INTERVAL));
        let mut silent_at = Instant::now() + SILENCE_TIMEOUT;
        loop {
            tokio::select! {
                biased;
                () = app.shutdown.begun() => return Err(Some(CloseReason::service_stopping())),
                () = &mut signed_out => return Err(Some(CloseReason::signed_out())),
                message = connection.next() => match message {
                    Some(message) => send(socket, &message).await?,
                    None => return Err(Some(CloseReason::new(CloseCode::Superseded, "a later connection of the agent"))),
                },
                received = receive(socket) => {
                    silent_at = Instant::now() + SILENCE_TIMEOUT;
                    if let Some(message) = received? {
                        self.handle(app, &connection, message, socket).await?;
                    }
                }
                _ = renewal.tick() => app.box_agents.renew_check_in_code(self.of),
                _ = noting.tick() => {
                    app.end_invalid_check_ins_and_waits().await; // such as after a new text became due
                    self.note_seen(app, program.clone()).await;
                    let now = self.light_reference(app).await;
                    if now != light_reference {
                        light_reference.clone_from(&now);
                        send(socket, &ToAgent::LightReference { light_reference: now }).await?;
                    }
                }
                event = events.next() => {
                    if self.is_about_last(app, event.as_ref()) {
                        let _ = app.announce_check_in(self.of).await; // as above
                    }
                }
                () = tokio::time::sleep_until(silent_at) => {
                    return Err(Some(CloseReason::new(CloseCode::Silent, "nothing was heard for too long")));
                }
            }
        }
    }

    /// The page for phones. An address of this computer would lead a phone to itself.
    fn check_in_page(&self) -> CheckInPage {
        if is_of_this_computer(&self.base) {
            tracing::warn!(
                address = self.base,
                in_box = self.code,
                "phones cannot open this address: no QR code for the check-in; set http.public_url, or let the agent use \
                 an address of the network"
            );
            return CheckInPage::Unreachable(self.base.clone());
        }
        CheckInPage::At(format!("{}/check-in?box={}", self.base, self.code))
    }

    async fn receive_hello(&self, app: &App, socket: &mut WebSocket) -> Result<String, Ended> {
        let wrong = |why: &str| Some(CloseReason::new(CloseCode::NotUnderstood, why));
        let first = tokio::select! {
            first = timeout(HELLO_TIMEOUT, receive(socket)) => first.map_err(|_| wrong("no hello arrived in time"))??,
            () = app.shutdown.begun() => return Err(Some(CloseReason::service_stopping())),
        };
        match first {
            Some(AgentMessage::Hello { protocol: PROTOCOL, program }) => {
                Ok(program.chars().filter(|c| !c.is_control()).take(MAX_PROGRAM_CHARS).collect())
            }
            Some(AgentMessage::Hello { .. }) => Err(wrong("another protocol: update the agent or the server")),
            _ => Err(wrong("the first message must be hello")),
        }
    }

    async fn handle(
        &self,
        app: &App,
        connection: &AgentConnection,
        message: AgentMessage,
        socket: &mut WebSocket,
    ) -> Result<(), Ended> {
        match message {
            AgentMessage::State { sent_at_ms, state } => {
                let server_ms = app.clock.now_ms();
                send(socket, &ToAgent::Time { sent_at_ms, server_ms }).await?;
                let awaited = state.awaited_start.map(|awaited| awaited.trainee);
                let awaits_another = awaited != app.box_agents.awaited_trainee(self.of);
                if connection.heard(*state) {
                    let _ = app.announce_check_in(self.of).await; // as above
                }
                if awaited.is_some() && awaits_another {
                    app.end_invalid_awaited_starts().await; // the consent may have been withdrawn before this was heard
                }
            }
            AgentMessage::Done { command, refused } => connection.answered(command, refused),
            AgentMessage::CheckIn { trainee, pin } => match self.check_in(app, &trainee, &pin).await {
                Ok(()) => {}
                Err((why, wait_s)) => send(socket, &ToAgent::CheckInRefused { why, wait_s }).await?,
            },
            AgentMessage::CheckOut => {
                if let Some(check_in) = app.box_agents.check_out(self.of) {
                    self.note(app, &check_in.scope, BoxCommand::CheckOut, &check_in.trainee).await;
                }
                let _ = app.announce_check_in(self.of).await; // as above
            }
            AgentMessage::Task { task } => {
                if let Some(task) = self.task(app, task).await {
                    app.box_agents.choose_task(self.of, task);
                }
                let _ = app.announce_check_in(self.of).await; // as above
            }
            AgentMessage::Hello { .. } => {
                return Err(Some(CloseReason::new(CloseCode::NotUnderstood, "hello may be sent only once")));
            }
        }
        Ok(())
    }

    /// A trainee typed code and PIN at the box.
    async fn check_in(&self, app: &App, code: &str, pin: &str) -> Result<(), (CheckInRefusal, u64)> {
        if app.box_agents.was_recording(self.of) {
            return Err((CheckInRefusal::Recording, 0));
        }
        let code = code.trim().to_lowercase();
        let attempts = app.box_agents.pin_attempts();
        attempts.attempt(self.of, &code).map_err(|wait| (CheckInRefusal::TooMany, wait.as_secs() + 1))?;
        let (wrong, busy) = ((CheckInRefusal::Wrong, 0), (CheckInRefusal::Busy, 0));
        let pin = CheckInPin::attempt(pin).and_then(CheckInPin::into_password).ok_or(wrong)?;
        let found = app.store.check_in_pins().by_code(&self.scope, &code).await.map_err(|_| busy)?;
        let place = app.password_hasher.take_place(HashRequester::Account(self.scope.actor())).map_err(|_| busy)?;
        let is_right =
            place.matches(pin, found.as_ref().map(|known| known.pin_hash.clone())).await.map_err(|_| busy)?;
        let known = found.filter(|_| is_right).ok_or(wrong)?;
        attempts.succeeded(self.of, &code);
        let scope = Scope::trainee(known.person_id, known.trainee_id);
        let trainee = app.named_trainee_of(&scope, known.trainee_id).await.map_err(|_| busy)?;
        match app.store.consents().require(&scope, known.trainee_id).await {
            Ok(()) => {}
            Err(StoreError::ConsentMissing { .. }) => return Err((CheckInRefusal::NoConsent, 0)),
            Err(_) => return Err(busy),
        }
        self.note(app, &scope, BoxCommand::CheckIn, &trainee).await;
        app.box_agents.check_in(self.of, trainee, scope, None);
        app.announce_check_in(self.of).await.map_err(|_| busy)
    }

    /// Notes in the audit trail what happened at the box.
    async fn note(&self, app: &App, seen_by: &Scope, command: BoxCommand, trainee: &NamedTrainee) {
        let about = (self.of, trainee.id);
        if let Err(error) = app.store.box_agents().note_command(&self.scope, seen_by, command, about).await {
            tracing::error!(%error, ?command, in_box = %self.of, "audit entry of a box not written");
        }
    }

    async fn task(&self, app: &App, id: TaskId) -> Option<NamedTask> {
        let scope = app.box_agents.view(self.of).check_in?.scope;
        let task = app.store.tasks().get(&scope, &Key::from(&id)).await.ok()?;
        Some(NamedTask { id: task.id, name: task.name.into() })
    }

    /// What the brightness of the picture is compared with: it begins anew with a calibration and with a passed self-test.
    async fn light_reference(&self, app: &App) -> String {
        let calibration = app.store.calibrations().in_use(&self.scope, self.of).await.ok().flatten();
        let test = app.store.self_tests().last_passed(&self.scope, self.of).await.ok().flatten();
        let calibration = calibration.map(|found| found.id.to_string()).unwrap_or_default();
        format!("{calibration}/{}", test.map(|test| test.id.to_string()).unwrap_or_default())
    }

    /// Stores that the agent was seen. An empty name leaves that of the program as it is known.
    async fn note_seen(&self, app: &App, program: String) {
        let program = if program.is_empty() { app.box_agents.view(self.of).program } else { program };
        if let Err(error) = app.store.box_agents().note_seen(self.of, program).await {
            tracing::warn!(%error, in_box = %self.of, "cannot store when the agent was seen last");
        }
    }

    /// Whether an event is about the last recording of the trainee who is checked in.
    fn is_about_last(&self, app: &App, event: Option<&EventDelivery>) -> bool {
        let last = || app.box_agents.view(self.of).check_in.and_then(|check_in| check_in.last);
        match event {
            Some(EventDelivery::Event(Event::Session { id, .. })) => last() == Some(*id),
            Some(EventDelivery::Missed(_)) => last().is_some(),
            _ => false,
        }
    }
}

impl App {
    /// Sends a box's agent who is checked in, with the tasks to choose from and the last recording.
    pub(in crate::http) async fn announce_check_in(&self, of: BoxId) -> HandlerResult<()> {
        let by = match self.box_agents.view(of).check_in {
            Some(check_in) => Some(Box::new(self.checked_in(check_in).await?)),
            None => None,
        };
        let ended = if by.is_none() { self.box_agents.check_in_end(of) } else { None };
        self.box_agents.send(of, ToAgent::CheckedIn { by, ended });
        Ok(())
    }

    /// Ends the check-ins, and the waits for a first movement, of trainees who do not consent to recordings any more, or have
    /// no record any more: it was erased, or merged with another one. Call it after each change that may have that effect.
    pub(in crate::http) async fn end_invalid_check_ins_and_waits(&self) {
        self.end_invalid_awaited_starts().await;
        for (of, CheckIn { trainee, scope, .. }) in self.box_agents.check_ins() {
            let ended = match self.why_check_in_ends(&scope, trainee.id).await {
                Ok(ended) => ended,
                Err(error) => {
                    tracing::error!(%error, in_box = %of, "a check-in was not checked; looked at again within a minute");
                    continue;
                }
            };
            if let Some(why) = ended.filter(|why| self.box_agents.end_check_in(of, trainee.id, *why)) {
                tracing::info!(in_box = %of, ?why, "check-in ended");
                self.box_agents.send(of, ToAgent::CheckedIn { by: None, ended });
            }
        }
    }

    /// Staff may have ordered a wait for a trainee who is not checked in.
    async fn end_invalid_awaited_starts(&self) {
        for (of, trainee) in self.box_agents.awaited_starts() {
            match self.why_awaited_start_ends(trainee).await {
                Ok(None) => {}
                Ok(Some(why)) => {
                    tracing::info!(in_box = %of, ?why, "wait for the first movement ended");
                    self.box_agents.end_awaited_start(of, trainee);
                }
                Err(error) => {
                    tracing::error!(%error, in_box = %of, "a wait was not checked; looked at again within a minute");
                }
            }
        }
    }

    async fn why_awaited_start_ends(&self, trainee: TraineeId) -> Result<Option<CheckInEnd>, StoreError> {
        if self.store.trainees().audience(trainee).await?.is_empty() {
            return Ok(Some(CheckInEnd::NoRecord)); // also while its erasure can still be taken back
        }
        self.why_check_in_ends(&Scope::service(), trainee).await
    }

    async fn why_check_in_ends(&self, scope: &Scope, trainee: TraineeId) -> Result<Option<CheckInEnd>, StoreError> {
        match self.store.trainees().get(scope, &Key::from(&trainee)).await {
            Ok(found) if found.id == trainee => {}
            Ok(_) | Err(StoreError::NotFound { .. }) => return Ok(Some(CheckInEnd::NoRecord)), // another one leads on
            Err(error) => return Err(error),
        }
        match self.store.consents().require(scope, trainee).await {
            Ok(()) => Ok(None),
            Err(StoreError::ConsentMissing { .. }) => Ok(Some(CheckInEnd::NoConsent)),
            Err(StoreError::NotFound { .. }) => Ok(Some(CheckInEnd::NoRecord)),
            Err(error) => Err(error),
        }
    }

    async fn checked_in(&self, check_in: CheckIn) -> HandlerResult<CheckedIn> {
        let tasks = self.store.tasks().list(&check_in.scope, &PageRequest::new(MAX_TASKS, None)).await?;
        let tasks = tasks.items.into_iter().map(|task| NamedTask { id: task.id, name: task.name.into() }).collect();
        let last = match check_in.last {
            Some(session) => self.last_recording(&check_in, session).await?,
            None => None,
        };
        let CheckIn { trainee, task, .. } = check_in;
        Ok(CheckedIn { trainee, task, tasks, last, idle_s: CHECK_IN_IDLE.as_secs() })
    }

    /// A recording of the trainee who is checked in. One that the box kept from another trainee is not shown.
    async fn last_recording(&self, by: &CheckIn, session: SessionId) -> HandlerResult<Option<LastRecording>> {
        if self.store.exams().is_sealed(SealedSubject::Session(session)).await? {
            return Ok(None); // the candidate reads the screen, also if staff made the check-in
        }
        let scope = &by.scope;
        let found = match self.store.sessions().get(scope, session).await {
            Ok(found) if found.trainee_id == by.trainee.id => found,
            Ok(_) | Err(StoreError::NotFound { .. }) => return Ok(None),
            Err(error) => return Err(error.into()),
        };
        Ok(Some(self.judged_session(scope, found).await?.as_last_recording()))
    }

    async fn named_trainee_of(&self, scope: &Scope, id: TraineeId) -> HandlerResult<NamedTrainee> {
        let found = self.store.trainees().get(scope, &Key::from(&id)).await?;
        Ok(NamedTrainee { id: found.id, name: found.name.into() })
    }
}

/// The agent's next message; `None` for one that only shows that it is there.
async fn receive(socket: &mut WebSocket) -> Result<Option<AgentMessage>, Ended> {
    match socket.recv().await {
        None | Some(Ok(Message::Close(_)) | Err(_)) => Err(None),
        Some(Ok(Message::Ping(_) | Message::Pong(_))) => Ok(None),
        Some(Ok(Message::Binary(_))) => Err(Some(CloseReason::new(CloseCode::NotUnderstood, "a message is not text"))),
        Some(Ok(Message::Text(text))) => match serde_json::from_str(&text) {
            Ok(message) => Ok(Some(message)),
            Err(error) => {
                let why = format!("a message is not understood: {error}");
                Err(Some(CloseReason::new(CloseCode::NotUnderstood, why)))
            }
        },
    }
}

async fn send(socket: &mut WebSocket, message: &ToAgent) -> Result<(), Ended> {
    let text = serde_json::to_string(message).unwrap_or_default(); // plain data always serialises
    match timeout(SEND_TIMEOUT, socket.send(Message::Text(text.into()))).await {
        Ok(Ok(())) => Ok(()),
        Ok(Err(_)) => Err(None),
        Err(_) => Err(Some(CloseReason::new(CloseCode::Silent, "the agent does not read"))),
    }
}
