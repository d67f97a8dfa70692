//! The agent that stands by at a box: its state for people, and their commands to it.

use std::collections::HashMap;

use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::box_agents::{AgentCommand, BoxAgentView, CommandError};
use crate::domain::box_agent::messages::{NamedTask, NamedTrainee, StopTarget};
use crate::domain::box_agent::self_test_need::{SelfTestReason, reasons};
use crate::domain::box_agent::state::{AwaitedStartState, BoxCameraState, ClockState, LightState, SpoolState};
use crate::domain::named;
use crate::domain::scope::Scope;
use crate::domain::text::Key;
use crate::http::auth::signed_in::Member;
use crate::http::error::{HandlerResult, ProblemResponse, Refusal};
use crate::http::read::{Json, PathKey, reference_problem};
use crate::http::show::{NamedReference, PageResponse, Time};
use crate::http::state::App;
use crate::ids::{BoxId, FeedId, SessionId, TaskId, TraineeId};
use crate::store::{BoxAgentRecord, BoxCommand, SealedSubject, StoreError, TraineeRecord};

named! {
    /// Whether the agent of a box can be reached.
    AgentPresence: "presence" {
        /// It was heard of within the last seconds.
        Live = "live",
        /// It was there, and is not heard of any more.
        Silent = "silent",
        /// No agent has ever stood by at the box.
        Never = "never",
    }
}

/// The agent that stands by at a box. What it reports is `null` while it is not `live`.
#[derive(Debug, Serialize, ToSchema)]
pub struct BoxAgentResponse {
    /// Id of the box.
    #[serde(rename = "box")]
    of: BoxId,
    presence: AgentPresence,
    /// When it was last heard of; after a start of the service precise to a minute. `null`: never.
    last_seen_at: Option<Time>,
    /// Its program and version; `null`: there was none.
    program: Option<String>,
    camera: Option<BoxCameraState>,
    light: Option<LightState>,
    spool: Option<SpoolState>,
    clock: Option<ClockResponse>,
    /// The recording that is running; `null`: none.
    recording: Option<BoxRecordingResponse>,
    /// The recording that begins with the first movement in the picture; `null`: none.
    awaited_start: Option<AwaitedStartResponse>,
    /// True if a recording can begin with the first movement (`on_movement`); `null` while the agent is not `live`.
    can_start_on_movement: Option<bool>,
    /// The trainee who is checked in; `null`: none.
    checked_in: Option<CheckInResponse>,
    /// The service's address as the box got it, if a phone cannot open it: the box shows no QR code then. An administrator
    /// sets the right one with `public_url`. `null`: the box shows a code, or is not `live`.
    unreachable_server: Option<String>,
}

/// The clock of the computer beside a box.
#[derive(Debug, Serialize, ToSchema)]
pub struct ClockResponse {
    /// The server's time minus that of the computer, ms.
    offset_ms: i64,
    /// The offset is right to this, ms.
    uncertainty_ms: i64,
    /// True if a person has to set the clock. Times of recordings are corrected meanwhile.
    is_wrong: bool,
}

/// A recording that a box is making.
#[derive(Debug, Serialize, ToSchema)]
pub struct BoxRecordingResponse {
    /// True if it has no name: it will wait for one, and every member of staff may stop it.
    is_unnamed: bool,
    /// The trainee; `null` for one that the caller does not see, and without a name.
    trainee: Option<NamedReference>,
    /// The task; `null` like the trainee, and if it is not known.
    task: Option<NamedReference>,
    /// Its session; `null` like the trainee, and until the first frame has arrived.
    session: Option<SessionId>,
    /// Time since it began, s.
    recorded_s: f64,
    /// Frames so far.
    frames: u64,
}

/// A recording that begins with the first movement in the picture of a box.
#[derive(Debug, Serialize, ToSchema)]
pub struct AwaitedStartResponse {
    /// The trainee; `null` for one that the caller does not see.
    trainee: Option<NamedReference>,
    /// The task; `null` like the trainee.
    task: Option<NamedReference>,
    /// True once the picture is still: a movement is seen only then.
    is_picture_still: bool,
}

/// A trainee who is checked in at a box.
#[derive(Debug, Serialize, ToSchema)]
pub struct CheckInResponse {
    /// The trainee; `null` for one that the caller does not see.
    trainee: Option<NamedReference>,
    /// The task of the next recording; `null`: not chosen.
    task: Option<NamedReference>,
    since: Time,
}

impl App {
    /// Why a box needs a self-test before the next exam; empty: it needs none.
    pub(in crate::http) async fn self_test_reasons(
        &self,
        scope: &Scope,
        of: BoxId,
    ) -> HandlerResult<Vec<SelfTestReason>> {
        let Some(calibration) = self.store.calibrations().in_use(scope, of).await? else { return Ok(Vec::new()) };
        let passed = self.store.self_tests().last_passed(scope, of).await?;
        let since_ms = passed.map_or(0, |test| test.created_at_ms).max(calibration.created_at_ms);
        let camera_moved = self.store.self_tests().camera_has_moved(scope, of, since_ms).await?;
        let view = self.box_agents.view(of);
        let light = view.state.filter(|_| view.is_online).and_then(|state| state.light);
        Ok(reasons(camera_moved, light))
    }

    /// The agents that were seen at the boxes of a scope.
    pub(in crate::http) async fn known_agents(&self, scope: &Scope) -> HandlerResult<HashMap<BoxId, BoxAgentRecord>> {
        let known = self.store.box_agents().list(scope).await?;
        Ok(known.into_iter().map(|record| (record.box_id, record)).collect())
    }

    /// The agent of a box, as this caller may see it. `known`: what the database has of it.
    pub(in crate::http) async fn box_agent_response(
        &self,
        scope: &Scope,
        of: BoxId,
        known: Option<&BoxAgentRecord>,
    ) -> HandlerResult<BoxAgentResponse> {
        let BoxAgentView { is_online, last_seen_ms, program, state, check_in, unreachable_server } =
            self.box_agents.view(of);
        let state = state.filter(|_| is_online);
        let presence = match (is_online, last_seen_ms.is_some() || known.is_some()) {
            (true, _) => AgentPresence::Live,
            (false, true) => AgentPresence::Silent,
            (false, false) => AgentPresence::Never,
        };
        let recording = match state.as_ref().and_then(|state| state.recording) {
            Some(running) => {
                let is_unnamed = running.trainee.is_none();
                let trainee = match running.trainee {
                    Some(trainee) => self.seen_trainee(scope, trainee).await?,
                    None => None,
                };
                let is_seen = trainee.is_some() || (is_unnamed && scope.is_staff());
                let task = self.seen_task(scope, running.task.filter(|_| is_seen)).await?;
                let session = match running.session.filter(|_| trainee.is_some()) {
                    Some(session) if !scope.is_staff() && self.is_sealed(session).await? => None,
                    session => session,
                };
                let (recorded_s, frames) = (running.recorded_s, running.frames);
                Some(BoxRecordingResponse { is_unnamed, trainee, task, session, recorded_s, frames })
            }
            None => None,
        };
        let awaited_start = match state.as_ref().and_then(|state| state.awaited_start) {
            Some(awaited) => Some(self.awaited_start_response(scope, awaited).await?),
            None => None,
        };
        let checked_in = match check_in {
            Some(check_in) => {
                let trainee = self.seen_trainee(scope, check_in.trainee.id).await?;
                let task = check_in.task.map(|task| task.id).filter(|_| trainee.is_some());
                let task = self.seen_task(scope, task).await?;
                Some(CheckInResponse { trainee, task, since: Time(check_in.since_ms) })
            }
            None => None,
        };
        let program = Some(program).filter(|program| !program.is_empty());
        let clock = state.as_ref().and_then(|state| state.clock);
        Ok(BoxAgentResponse {
            of,
            presence,
            last_seen_at: last_seen_ms.or(known.map(|record| record.last_seen_ms)).map(Time),
            program: program.or_else(|| known.map(|record| record.program.clone())),
            camera: state.as_ref().map(|state| state.camera.clone()),
            light: state.as_ref().and_then(|state| state.light),
            can_start_on_movement: state.as_ref().map(|state| state.can_start_on_movement),
            spool: state.map(|state| state.spool),
            clock: clock.map(ClockResponse::from),
            recording,
            awaited_start,
            checked_in,
            unreachable_server: unreachable_server.filter(|_| is_online),
        })
    }

    async fn awaited_start_response(
        &self,
        scope: &Scope,
        awaited: AwaitedStartState,
    ) -> HandlerResult<AwaitedStartResponse> {
        let trainee = self.seen_trainee(scope, awaited.trainee).await?;
        let task = self.seen_task(scope, Some(awaited.task).filter(|_| trainee.is_some())).await?;
        Ok(AwaitedStartResponse { trainee, task, is_picture_still: awaited.is_picture_still })
    }

    async fn is_sealed(&self, session: SessionId) -> HandlerResult<bool> {
        Ok(self.store.exams().is_sealed(SealedSubject::Session(session)).await?)
    }

    /// A trainee by name, if the scope sees the trainee.
    async fn seen_trainee(&self, scope: &Scope, id: TraineeId) -> HandlerResult<Option<NamedReference>> {
        match self.store.trainees().get(scope, &Key::from(&id)).await {
            Ok(TraineeRecord { id, name, code, .. }) => Ok(Some(reference(id, name, code))),
            Err(StoreError::NotFound { .. }) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    async fn seen_task(&self, scope: &Scope, id: Option<TaskId>) -> HandlerResult<Option<NamedReference>> {
        let Some(id) = id else { return Ok(None) };
        match self.store.tasks().get(scope, &Key::from(&id)).await {
            Ok(task) => Ok(Some(reference(task.id, task.name, task.code))),
            Err(StoreError::NotFound { .. }) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// Fails if a box cannot begin a recording now.
    pub(in crate::http) async fn check_box_can_record(&self, scope: &Scope, of: BoxId) -> HandlerResult<()> {
        let view = self.box_agents.view(of);
        let Some(state) = view.state.filter(|_| view.is_online) else { return Err(silent_box()) };
        if state.recording.is_some() {
            return Err(Refusal::Conflict.with("The box is recording already. Stop that recording first."));
        }
        if !state.camera.is_open {
            let why = "The camera of the box is missing. Plug it in; the page Boxes shows when it is back.";
            return Err(Refusal::Conflict.with(why));
        }
        let calibration = self.store.calibrations().in_use(scope, of).await?;
        if let (Some(calibration), Some(width), Some(height)) = (calibration, state.camera.width, state.camera.height)
            && (calibration.camera.width, calibration.camera.height) != (width, height)
        {
            let (right_width, right_height) = (calibration.camera.width, calibration.camera.height);
            return Err(Refusal::Conflict.with(format!(
                "The camera sends pictures of {width}×{height} pixels, but the box is calibrated for \
                 {right_width}×{right_height}. Set the camera of the agent to that size."
            )));
        }
        Ok(())
    }
}

impl App {
    /// Fails if the recording of a trainee cannot begin with the first movement in a box: another one may be there.
    fn check_box_sees_movement(&self, scope: &Scope, of: BoxId, trainee: TraineeId) -> HandlerResult<()> {
        let view = self.box_agents.view(of);
        let checked_in = view.check_in.as_ref().map(|check_in| check_in.trainee.id);
        if checked_in.is_some_and(|checked_in| checked_in != trainee) {
            return Err(Refusal::Conflict.with("Another trainee is checked in at the box, and would be recorded."));
        }
        if checked_in.is_none() && !scope.is_staff() {
            let why = "Check in at the box first: until then nothing says that the next movement there is yours.";
            return Err(Refusal::Conflict.with(why));
        }
        if view.state.is_some_and(|state| state.can_start_on_movement) {
            return Ok(());
        }
        Err(Refusal::Conflict.with(
            "The agent of the box is of an older version and cannot start by itself. Install the version of this server \
             there, or start the recording at once.",
        ))
    }
}

fn reference(id: impl ToString, name: impl Into<String>, code: impl Into<String>) -> NamedReference {
    NamedReference { id: id.to_string(), name: name.into(), code: code.into() }
}

impl From<ClockState> for ClockResponse {
    fn from(clock: ClockState) -> Self {
        let (ClockState { offset_ms, uncertainty_ms }, is_wrong) = (clock, clock.is_wrong());
        Self { offset_ms, uncertainty_ms, is_wrong }
    }
}

fn silent_box() -> ProblemResponse {
    Refusal::Conflict.with(
        "The box is silent: no agent stands by there, or its computer or network is off. Switch it on, or record with \
         the page Record.",
    )
}

/// List the agents that stand by at boxes
///
/// One for each box that ever had one.
#[utoipa::path(get, path = "/agents", tag = "boxes", responses((status = OK, body = PageResponse<BoxAgentResponse>)))]
pub async fn agents(State(app): State<App>, by: Member) -> HandlerResult<Json<PageResponse<BoxAgentResponse>>> {
    let mut shown = Vec::new();
    for (of, known) in app.known_agents(&by.scope).await? {
        shown.push(app.box_agent_response(&by.scope, of, Some(&known)).await?);
    }
    shown.sort_by_key(|agent| agent.of);
    Ok(Json(PageResponse::whole(shown)))
}

/// Read the agent that stands by at a box
#[utoipa::path(get, path = "/boxes/{id}/agent", tag = "boxes", params(("id" = String, Path, description = "id or code")),
    responses((status = OK, body = BoxAgentResponse)))]
pub async fn agent(State(app): State<App>, by: Member, PathKey(key): PathKey) -> HandlerResult<Json<BoxAgentResponse>> {
    let of = app.store.boxes().get(&by.scope, &key).await?.id;
    let known = app.known_agents(&by.scope).await?;
    Ok(Json(app.box_agent_response(&by.scope, of, known.get(&of)).await?))
}

/// A recording to start at a box.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewBoxRecording {
    /// The trainee, by id or code; a trainee may leave it out.
    #[serde(default)]
    trainee: Option<String>,
    /// The task, by id or code; without a name it may be left out.
    #[serde(default)]
    task: Option<String>,
    /// True: without a trainee. The recording waits for a name (`waiting-recordings`). For staff.
    #[serde(default)]
    without_name: bool,
    /// True: begin with the first movement in the picture, not at once. `awaited_start` of the box says so until then; the
    /// wait ends after ten minutes, and with `stop`. Not without a name.
    #[serde(default)]
    on_movement: bool,
}

/// Start a recording at a box
///
/// The agent that stands by there begins at once, or with the first movement in the picture. Staff record the trainees that they see, trainees themselves. Refused
/// (409) while the box is silent or recording, without its camera, or with another picture size than the calibrated one;
/// and (403) for a trainee who does not consent. Staff may start a recording without a name, which waits for one then.
#[utoipa::path(post, path = "/boxes/{id}/agent/start", tag = "boxes",
    params(("id" = String, Path, description = "id or code")), request_body = NewBoxRecording,
    responses((status = OK, body = BoxAgentResponse)))]
pub async fn start_agent(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
    Json(new): Json<NewBoxRecording>,
) -> HandlerResult<Json<BoxAgentResponse>> {
    let of = app.store.boxes().get(&by.scope, &key).await?.id;
    let trainee = match new.without_name {
        true => {
            new.refuse_name(&by.scope)?;
            None
        }
        false => Some(app.named_trainee(&by.scope, new.trainee.as_deref()).await?),
    };
    let task = match &new.task {
        Some(key) => Some(app.named_task(&by.scope, key).await?),
        None if trainee.is_none() => None,
        None => return Err(ProblemResponse::invalid("task", "is missing; name the task that is done")),
    };
    if let Some(trainee) = &trainee {
        app.store.consents().require(&by.scope, trainee.id).await?;
    }
    app.check_box_can_record(&by.scope, of).await?;
    if let Some(trainee) = trainee.as_ref().filter(|_| new.on_movement) {
        app.check_box_sees_movement(&by.scope, of, trainee.id)?;
    }
    let notes = app.store.box_agents();
    match &trainee {
        Some(trainee) => notes.note_command(&by.scope, &by.scope, BoxCommand::Start, (of, trainee.id)).await?,
        None => notes.note_unnamed_command(&by.scope, BoxCommand::StartUnnamed, of).await?,
    }
    let recording = FeedId::at(app.clock.now_ms());
    let command = match (trainee, task) {
        (Some(trainee), Some(task)) if new.on_movement => AgentCommand::StartOnMovement(recording, trainee, task),
        (trainee, task) => AgentCommand::Start(recording, trainee, task),
    };
    app.box_agents.command(of, command).await.map_err(command_problem)?;
    Ok(Json(app.box_agent_response(&by.scope, of, None).await?))
}

impl NewBoxRecording {
    /// Checks a recording without a name.
    fn refuse_name(&self, scope: &Scope) -> HandlerResult<()> {
        if self.trainee.is_some() {
            let why = "a recording without a name has no trainee; leave one of the two out";
            return Err(ProblemResponse::invalid("trainee", why));
        }
        if self.on_movement {
            let why = "a recording without a name does not begin by itself; name the trainee";
            return Err(ProblemResponse::invalid("on_movement", why));
        }
        if !scope.is_staff() {
            return Err(Refusal::Forbidden.with("Only staff start recordings without a name from here."));
        }
        Ok(())
    }
}

/// End the recording of a box, or the wait for the first movement
///
/// For staff who see its trainee, and for the trainee, except an attempt of an exam. Every member of staff ends one without a name.
/// Refused (409) if what the box did has ended meanwhile: what it has begun since continues.
#[utoipa::path(post, path = "/boxes/{id}/agent/stop", tag = "boxes",
    params(("id" = String, Path, description = "id or code")), responses((status = OK, body = BoxAgentResponse)))]
pub async fn stop_agent(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
) -> HandlerResult<Json<BoxAgentResponse>> {
    let of = app.store.boxes().get(&by.scope, &key).await?.id;
    let view = app.box_agents.view(of);
    let state = view.state.filter(|_| view.is_online).ok_or_else(silent_box)?;
    let (trainee, target) = match (state.recording, state.awaited_start) {
        (Some(running), _) => (running.trainee, StopTarget::Recording(running.recording)),
        (None, Some(awaited)) => (Some(awaited.trainee), StopTarget::AwaitedStart(awaited.trainee)),
        (None, None) => return Err(Refusal::Conflict.with("The box is not recording.")),
    };
    match trainee {
        Some(trainee) => {
            if app.seen_trainee(&by.scope, trainee).await?.is_none() {
                let why = "The box records another person. Only that person or their staff can stop it.";
                return Err(Refusal::Conflict.with(why));
            }
            if let StopTarget::Recording(recording) = target
                && !by.scope.is_staff()
                && app.store.exams().is_ordered(recording).await?
            {
                let why = "This recording is an attempt of an exam. The examiner ends it.";
                return Err(Refusal::Conflict.with(why));
            }
            let about = (of, trainee);
            app.store.box_agents().note_command(&by.scope, &by.scope, BoxCommand::Stop, about).await?;
        }
        None if !by.scope.is_staff() => {
            let why = "The box records without a name. Stop it at the box, or ask staff.";
            return Err(Refusal::Conflict.with(why));
        }
        None => app.store.box_agents().note_unnamed_command(&by.scope, BoxCommand::Stop, of).await?,
    }
    app.box_agents.command(of, AgentCommand::Stop(target)).await.map_err(command_problem)?;
    Ok(Json(app.box_agent_response(&by.scope, of, None).await?))
}

impl App {
    /// The trainee that a request names; a trainee may leave it out.
    pub(super) async fn named_trainee(&self, scope: &Scope, named: Option<&str>) -> HandlerResult<NamedTrainee> {
        let key = match (named, scope.own_trainee()) {
            (Some(key), _) => Key::from(&key),
            (None, Some(own)) => Key::from(&own),
            (None, None) => {
                return Err(ProblemResponse::invalid("trainee", "is missing; name the trainee who is recorded"));
            }
        };
        let found = self.store.trainees().get(scope, &key).await.map_err(reference_problem("trainee"))?;
        Ok(NamedTrainee { id: found.id, name: found.name.into() })
    }

    /// The task that a request names.
    pub(super) async fn named_task(&self, scope: &Scope, key: &str) -> HandlerResult<NamedTask> {
        let found = self.store.tasks().get(scope, &Key::from(&key)).await.map_err(reference_problem("task"))?;
        Ok(NamedTask { id: found.id, name: found.name.into() })
    }
}

/// The answer to a command that was not carried out.
pub(in crate::http) fn command_problem(error: CommandError) -> ProblemResponse {
    match error {
        CommandError::Silent => silent_box(),
        CommandError::NoAnswer => {
            Refusal::Conflict.with("The box did not answer. Look at the page Boxes whether it records, then try again.")
        }
        CommandError::Refused(why) => Refusal::Conflict.with(format!("The box refused: {why}.")),
    }
}
