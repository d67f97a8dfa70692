//! Exams: staff plan, start and close them, administrators void attempts, trainees see their own.
//!
//! The store decides what a candidate sees of an exam that is not closed, so nothing here repeats it.

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::auth::signed_in::{Administrator, BySignIn, Member, Staff};
use super::boxes::agent::command_problem;
use super::certificates::CertificateResponse;
use super::error::{HandlerResult, ProblemResponse, Refusal};
use super::read::{Json, Params, PathKey, PathPair, reference_problem};
use super::show::{Created, NamedReference, PageResponse, Paging, Time};
use super::state::App;
use crate::box_agents::{AgentCommand, CommandError};
use crate::domain::box_agent::messages::{NamedTask, NamedTrainee};
use crate::domain::box_agent::self_test_need::SelfTestReason;
use crate::domain::certificate::CertificateLanguage;
use crate::domain::exam::{
    AttemptCause, AttemptCompletion, AttemptOutcome, AttemptState, CompletionStatement, ExamBoxProblem, ExamResult,
    ExamStart, ExamState, IdentityCheck, JudgedFigure, NewAttempt, NewExam, RecordingWay, VoidReason,
};
use crate::domain::scope::Scope;
use crate::domain::self_test::TrafficLight;
use crate::domain::text::{Key, Name, Remark};
use crate::ids::{BoxId, ExamId, FeedId, SelfTestId, SessionId};
use crate::store::{AttemptRecord, BoxCommand, ExamFilter, ExamRecord, PlannedExam, WaitingAttempt};
use crate::time::{Day, start_of_day_ms};

/// An exam.
#[derive(Debug, Serialize, ToSchema)]
pub struct ExamResponse {
    id: ExamId,
    /// The candidate.
    trainee: NamedReference,
    task: NamedReference,
    #[serde(rename = "box")]
    in_box: NamedReference,
    /// The version of the task's standard that judges it, fixed when it was planned.
    standard_version: i64,
    /// How many attempts the candidate has.
    attempts_allowed: u32,
    /// How many of them are used. Voided attempts are not: the candidate has them back, and they keep their numbers.
    attempts_used: u32,
    /// A note of the day on which it is to be held; nothing enforces it. `null`: none.
    day: Option<Day>,
    state: ExamState,
    /// Name of the person who planned it; `null` if deleted.
    #[schema(value_type = Option<String>)]
    planned_by: Option<Name>,
    planned_at: Time,
    /// How the examiner confirmed who the candidate is; `null` before the start.
    identity: Option<IdentityCheck>,
    /// Name of the examiner; `null` before the start.
    #[schema(value_type = Option<String>)]
    examiner: Option<Name>,
    /// `null` before the start.
    started_at: Option<Time>,
    /// The result; `null` before the exam is closed.
    result: Option<ExamResult>,
    /// Name of the person who closed or cancelled it.
    #[schema(value_type = Option<String>)]
    ended_by: Option<Name>,
    /// When it was closed or cancelled.
    ended_at: Option<Time>,
    /// The attempts that have begun.
    attempts: Vec<AttemptResponse>,
}

/// An attempt of an exam.
#[derive(Debug, Serialize, ToSchema)]
pub struct AttemptResponse {
    /// 1, 2, … in the order of beginning, for ever: a voided attempt keeps its number.
    number: u32,
    began_at: Time,
    /// `sealed`, for the candidate: it was recorded; the rest follows when the exam is closed.
    state: AttemptState,
    /// Its session; `null` if nothing could be kept, and while it is sealed.
    session: Option<SessionId>,
    /// What it was judged as; `null` before that, and while it is sealed.
    outcome: Option<AttemptOutcome>,
    /// Why it is undecided; `null` otherwise. Without a pass in another attempt, `error_bar`, `not_measured`, `other_box` and
    /// `set_up` leave the exam undecided. If the reason was technical, such as a camera that was covered, an administrator
    /// can void the attempt while the exam is running.
    cause: Option<AttemptCause>,
    /// Version of the measurement that was judged.
    pipeline: Option<String>,
    /// The values and limits that were judged. They stay when the session is scored again.
    figures: Vec<JudgedFigure>,
    judged_at: Option<Time>,
    /// What the examiner says of it; `null`: not said yet, and while it is sealed. One that was broken off is not passed,
    /// also if its recording met the standard.
    completion: Option<AttemptCompletion>,
    /// When it was declared void after a technical failure; `null`: it counts.
    voided_at: Option<Time>,
    /// Name of the person who voided it; `null` for trainees.
    #[schema(value_type = Option<String>)]
    voided_by: Option<Name>,
    /// The technical failure: plain text, never markup; `null` for trainees.
    #[schema(value_type = Option<String>)]
    void_reason: Option<Remark>,
}

/// An exam with the state of its box.
#[derive(Debug, Serialize, ToSchema)]
pub struct ExamDetails {
    #[serde(flatten)]
    exam: ExamResponse,
    /// Whether the box may be used for an exam now; `null` for trainees, and once the exam has ended.
    box_check: Option<ExamBoxCheck>,
    /// True if the agent that stands by at the box can record an attempt now.
    has_agent: bool,
    /// The recordings that were ordered and have not begun, the newest first; empty for trainees, and once the exam has ended.
    waiting: Vec<WaitingAttemptResponse>,
    /// The result if the exam were closed now; `null` if it cannot be closed yet, for trainees, and unless it is running.
    result_if_closed: Option<ExamResult>,
}

/// A recording that was ordered for an exam and has not begun.
#[derive(Debug, Serialize, ToSchema)]
pub struct WaitingAttemptResponse {
    ordered_at: Time,
    /// False if a later order replaced it: it is refused when it begins to arrive.
    may_begin: bool,
    /// True if the agent of the box reports that it records it.
    is_recording: bool,
}

/// Whether a box may be used for an exam now.
#[derive(Debug, Serialize, ToSchema)]
pub struct ExamBoxCheck {
    /// True if an exam can be started.
    is_ready: bool,
    /// Why not; empty if it is ready. A self-test answers each of them.
    problems: Vec<ExamBoxProblem>,
    /// The latest self-test of today; `null`: there is none.
    tested_at: Option<Time>,
    /// Its light.
    light: Option<TrafficLight>,
}

impl From<AttemptRecord> for AttemptResponse {
    fn from(attempt: AttemptRecord) -> Self {
        let (state, outcome) = (attempt.state(), attempt.settled());
        Self {
            number: attempt.number,
            began_at: Time(attempt.began_at_ms),
            state,
            session: attempt.session_id,
            outcome,
            cause: attempt.cause,
            pipeline: attempt.pipeline,
            figures: attempt.figures.unwrap_or_default(),
            judged_at: attempt.judged_at_ms.map(Time),
            completion: attempt.completion,
            voided_at: attempt.voided_at_ms.map(Time),
            voided_by: attempt.voided_by,
            void_reason: attempt.void_reason,
        }
    }
}

impl From<ExamRecord> for ExamResponse {
    fn from(exam: ExamRecord) -> Self {
        let attempts_used = exam.used();
        let named = |id: String, name: Name, code: String| NamedReference { id, name: name.into(), code };
        Self {
            id: exam.id,
            trainee: named(exam.trainee_id.to_string(), exam.trainee_name, exam.trainee_code.into()),
            task: named(exam.task_id.to_string(), exam.task_name, exam.task_code.into()),
            in_box: named(exam.box_id.to_string(), exam.box_name, exam.box_code.into()),
            standard_version: exam.standard_version,
            attempts_allowed: exam.attempts,
            attempts_used,
            day: exam.day,
            state: exam.state,
            planned_by: exam.planned_by,
            planned_at: Time(exam.planned_at_ms),
            identity: exam.identity,
            examiner: exam.examiner,
            started_at: exam.started_at_ms.map(Time),
            result: exam.result,
            ended_by: exam.ended_by,
            ended_at: exam.ended_at_ms.map(Time),
            attempts: exam.begun.into_iter().map(AttemptResponse::from).collect(),
        }
    }
}

/// Selects exams.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct ExamQuery {
    /// Only those in this state.
    state: Option<ExamState>,
    /// Only those of this trainee, by id or code.
    #[param(value_type = Option<String>)]
    trainee: Option<Key>,
    /// Most items on the page, 1 to 200.
    #[param(minimum = 1, maximum = 200)]
    limit: Option<u32>,
    /// `next` of the previous page.
    cursor: Option<String>,
}

/// List the exams that the caller may see, the newest first
///
/// Trainees see their own, without any figure of one that is not closed.
#[utoipa::path(get, path = "/exams", tag = "exams", params(ExamQuery),
    responses((status = OK, body = PageResponse<ExamResponse>)))]
pub async fn list(
    State(app): State<App>,
    by: Member,
    Params(ExamQuery { state, trainee, limit, cursor }): Params<ExamQuery>,
) -> HandlerResult<Json<PageResponse<ExamResponse>>> {
    let page = Paging::new(limit, cursor).request("exams", app.settings.page_items)?;
    let trainee = match trainee {
        Some(key) => Some(app.store.trainees().get(&by.scope, &key).await.map_err(reference_problem("trainee"))?.id),
        None => None,
    };
    let found = app.store.exams().list(&by.scope, ExamFilter { trainee, state }, &page).await?;
    Ok(Json(PageResponse::of(found, ExamResponse::from)))
}

/// Plan an exam
///
/// The version of the task's standard that is valid now judges it; later versions do not. A task without a standard has no
/// exams. The trainee must consent to recordings.
#[utoipa::path(post, path = "/exams", tag = "exams", request_body = NewExam,
    responses((status = CREATED, body = ExamResponse)))]
pub async fn plan(State(app): State<App>, by: Staff, Json(new): Json<NewExam>) -> HandlerResult<Created<ExamResponse>> {
    new.check()?;
    let scope = &by.scope;
    let trainee = app.store.trainees().get(scope, &new.trainee).await.map_err(reference_problem("trainee"))?.id;
    let task = app.store.tasks().get(scope, &new.task).await.map_err(reference_problem("task"))?;
    let in_box = app.store.boxes().get(scope, &new.in_box).await.map_err(reference_problem("box"))?.id;
    let standard = app.store.standards().in_use(scope, task.id).await?.ok_or_else(|| {
        Refusal::Conflict
            .with(format!(
                "The task “{}” has no standard, so an exam could not be judged. Set its standard on the page of the task \
                 first.",
                task.name
            ))
            .of_field("task")
    })?;
    let planned =
        PlannedExam { trainee, task: task.id, in_box, standard: standard.id, attempts: new.attempts, day: new.day };
    let made = app.store.exams().plan(scope, planned).await?;
    Ok(Created { location: format!("/api/v1/exams/{}", made.id), made: made.into() })
}

/// Read an exam
#[utoipa::path(get, path = "/exams/{id}", tag = "exams", params(("id" = String, Path, description = "id")),
    responses((status = OK, body = ExamDetails)))]
pub async fn get(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<Json<ExamDetails>> {
    let exam = app.store.exams().get(&by.scope, at.id()?).await?;
    app.exam_details(&by.scope, exam).await
}

/// Cancel an exam
///
/// Possible before an attempt counts. One that is cancelled already stays as it is.
#[utoipa::path(post, path = "/exams/{id}/cancel", tag = "exams", params(("id" = String, Path, description = "id")),
    responses((status = NO_CONTENT)))]
pub async fn cancel(State(app): State<App>, by: Staff, at: PathKey) -> HandlerResult<StatusCode> {
    let exam = app.store.exams().cancel(&by.scope, at.id()?).await?;
    app.notify_attempts(&by.scope, &exam).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Start an exam
///
/// The caller is the examiner and has confirmed who the candidate is. The box must have passed a self-test today, and
/// nothing may speak for another one (`box_check`). One exam of a trainee, and one in a box, run at a time. A token does not
/// suffice.
#[utoipa::path(post, path = "/exams/{id}/start", tag = "exams", params(("id" = String, Path, description = "id")),
    request_body = ExamStart, responses((status = OK, body = ExamDetails)))]
pub async fn start(
    State(app): State<App>,
    BySignIn(by): BySignIn<Staff>,
    at: PathKey,
    Json(ExamStart { identity }): Json<ExamStart>,
) -> HandlerResult<Json<ExamDetails>> {
    let exam = app.store.exams().get(&by.scope, at.id()?).await?;
    if exam.state != ExamState::Planned {
        return Err(Refusal::Conflict.with("The exam has begun or ended already. Look at it again."));
    }
    let self_test = app.ready_exam_box(&by.scope, exam.box_id).await?;
    let exam = app.store.exams().start(&by.scope, exam.id, identity, self_test).await?;
    app.exam_details(&by.scope, exam).await
}

/// A recording that was ordered for an attempt.
#[derive(Debug, Serialize, ToSchema)]
pub struct OrderedAttempt {
    /// The id that the recording must have in its hello (`docs/feed.md`). Only this recording becomes the attempt.
    recording: FeedId,
}

/// Record the next attempt
///
/// With `agent`, the agent of the box begins at once. With `browser`, the answer names the `recording` that the page sends
/// live. The attempt is used when that recording begins to arrive; a later order replaces one that has not begun. A file
/// is never an attempt. The box is checked as at the start. Refused while the box still records one that was ordered before.
#[utoipa::path(post, path = "/exams/{id}/attempts", tag = "exams", params(("id" = String, Path, description = "id")),
    request_body = NewAttempt, responses((status = CREATED, body = OrderedAttempt)))]
pub async fn order(
    State(app): State<App>,
    by: Staff,
    at: PathKey,
    Json(NewAttempt { way }): Json<NewAttempt>,
) -> HandlerResult<Created<OrderedAttempt>> {
    let exam = app.store.exams().get(&by.scope, at.id()?).await?;
    app.store.consents().require(&by.scope, exam.trainee_id).await?;
    if exam.state != ExamState::Running {
        return Err(Refusal::Conflict.with("The exam is not running, so no attempt can be recorded."));
    }
    if way == RecordingWay::Agent {
        app.check_box_can_record(&by.scope, exam.box_id).await?;
    }
    app.refuse_while_recorded(&by.scope, &exam).await?;
    let self_test = app.ready_exam_box(&by.scope, exam.box_id).await?;
    let recording = app.store.exams().order(&by.scope, exam.id, self_test).await?;
    let id = exam.id;
    if way == RecordingWay::Agent {
        app.record_at_box(&by.scope, exam, recording).await?;
    }
    Ok(Created { location: format!("/api/v1/exams/{id}"), made: OrderedAttempt { recording } })
}

/// Say whether the task of an attempt was completed
///
/// No recording shows it, so the examiner says it, before the exam is closed. An attempt that was broken off is not passed.
/// A token does not suffice.
#[utoipa::path(put, path = "/exams/{id}/attempts/{number}/completion", tag = "exams",
    params(("id" = String, Path, description = "id"), ("number" = u32, Path, description = "number of the attempt")),
    request_body = CompletionStatement, responses((status = OK, body = ExamDetails)))]
pub async fn set_completion(
    State(app): State<App>,
    BySignIn(by): BySignIn<Staff>,
    PathPair(id, number): PathPair<ExamId, u32>,
    Json(CompletionStatement { completion }): Json<CompletionStatement>,
) -> HandlerResult<Json<ExamDetails>> {
    let exam = app.store.exams().set_completion(&by.scope, id, number, completion).await?;
    app.exam_details(&by.scope, exam).await
}

/// Void an attempt after a technical failure
///
/// The candidate has the attempt back. Possible while the exam is running and the attempt is not being recorded.
#[utoipa::path(post, path = "/exams/{id}/attempts/{number}/void", tag = "exams",
    params(("id" = String, Path, description = "id"), ("number" = u32, Path, description = "number of the attempt")),
    request_body = VoidReason, responses((status = OK, body = ExamDetails)))]
pub async fn void(
    State(app): State<App>,
    BySignIn(by): BySignIn<Administrator>,
    PathPair(id, number): PathPair<ExamId, u32>,
    Json(VoidReason { reason }): Json<VoidReason>,
) -> HandlerResult<Json<ExamDetails>> {
    let exam = app.store.exams().void(&by.scope, id, number, reason).await?;
    app.exam_details(&by.scope, exam).await
}

/// What the examiner saw before an exam is closed.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct ExamClosing {
    /// The result that `result_if_closed` had. If it is another one by now, the exam stays open.
    expected_result: Option<ExamResult>,
}

/// Close an exam
///
/// Each attempt must be judged, and called completed or broken off; `result_if_closed` of the exam says what the result would
/// be. With `expected_result` a result that has changed meanwhile is refused (409). From then on the candidate sees result and figures, and nothing of the exam changes any more. Attempts that are left
/// are lost. An exam that cannot be decided is closed without a result for or against the candidate: plan another one. A
/// token does not suffice.
#[utoipa::path(post, path = "/exams/{id}/close", tag = "exams",
    params(("id" = String, Path, description = "id"), ExamClosing),
    responses((status = OK, body = ExamDetails)))]
pub async fn close(
    State(app): State<App>,
    BySignIn(by): BySignIn<Staff>,
    at: PathKey,
    Params(seen): Params<ExamClosing>,
) -> HandlerResult<Json<ExamDetails>> {
    let exam = app.store.exams().close(&by.scope, at.id()?, seen.expected_result).await?;
    app.notify_attempts(&by.scope, &exam).await?;
    app.exam_details(&by.scope, exam).await
}

/// A certificate of an exam to issue.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewExamCertificate {
    /// The language that it is written in.
    language: CertificateLanguage,
    /// True to issue it although its address works only on this computer or in this network.
    #[serde(default)]
    accept_local_address: bool,
}

/// Issue the certificate of an exam that was passed
///
/// It says that it is of an exam, with the examiner, how the identity was confirmed, and the attempts that were used. Its
/// address is checked as that of other certificates: see `accept_local_address` there.
#[utoipa::path(post, path = "/exams/{id}/certificates", tag = "exams", params(("id" = String, Path, description = "id")),
    request_body = NewExamCertificate, responses((status = CREATED, body = CertificateResponse)))]
pub async fn issue(
    State(app): State<App>,
    by: Staff,
    at: PathKey,
    headers: HeaderMap,
    Json(NewExamCertificate { language, accept_local_address }): Json<NewExamCertificate>,
) -> HandlerResult<Created<CertificateResponse>> {
    let exam = app.store.exams().get(&by.scope, at.id()?).await?.id;
    let base = app.lasting_base_url(&headers, accept_local_address)?;
    let made = app.certificates.issue_of_exam(&by.scope, exam, language, &base).await?;
    Ok(Created { location: format!("/api/v1/certificates/{}", made.id), made: made.into() })
}

impl App {
    async fn exam_details(&self, scope: &Scope, exam: ExamRecord) -> HandlerResult<Json<ExamDetails>> {
        let is_open = matches!(exam.state, ExamState::Planned | ExamState::Running);
        let (box_check, waiting) = match scope.is_staff() && is_open {
            true => (
                Some(self.exam_box_check(scope, exam.box_id).await?.0),
                self.store.exams().waiting(scope, exam.id).await?,
            ),
            false => (None, Vec::new()),
        };
        let result_if_closed = exam.result_if_closed().filter(|_| scope.is_staff());
        let recorded = self.recorded_by_box(exam.box_id);
        let shown = |attempt: WaitingAttempt| WaitingAttemptResponse {
            ordered_at: Time(attempt.ordered_at_ms),
            may_begin: attempt.may_begin,
            is_recording: recorded == Some(attempt.recording_id),
        };
        let waiting = waiting.into_iter().map(shown).collect();
        let has_agent = scope.is_staff() && self.box_agents.view(exam.box_id).is_online;
        Ok(Json(ExamDetails { exam: exam.into(), box_check, has_agent, waiting, result_if_closed }))
    }

    /// The recording that the agent of a box reports.
    fn recorded_by_box(&self, of: BoxId) -> Option<FeedId> {
        let view = self.box_agents.view(of);
        let recording = view.state.filter(|_| view.is_online).and_then(|state| state.recording);
        recording.map(|recording| recording.recording)
    }

    /// Refuses another order while the box records one that was ordered before and has not arrived: it would be refused when
    /// it arrives.
    async fn refuse_while_recorded(&self, scope: &Scope, exam: &ExamRecord) -> HandlerResult<()> {
        let recorded = self.recorded_by_box(exam.box_id);
        let waiting = self.store.exams().waiting(scope, exam.id).await?;
        match waiting.iter().any(|attempt| attempt.may_begin && recorded == Some(attempt.recording_id)) {
            true => Err(Refusal::Conflict.with(
                "The box records the attempt that was started before; its first frames have not arrived yet. End that \
                 recording first.",
            )),
            false => Ok(()),
        }
    }

    /// Makes the agent of the box record an attempt. If the agent did not get the order or refused it, the order is taken
    /// back, so that one before it stays valid. Without an answer it stays: the agent may have begun, and a recording
    /// without an order would be an ordinary session, open to the candidate.
    async fn record_at_box(&self, scope: &Scope, exam: ExamRecord, recording: FeedId) -> HandlerResult<()> {
        let about = (exam.box_id, exam.trainee_id);
        self.store.box_agents().note_command(scope, scope, BoxCommand::Start, about).await?;
        let trainee = NamedTrainee { id: exam.trainee_id, name: exam.trainee_name.into() };
        let task = NamedTask { id: exam.task_id, name: exam.task_name.into() };
        let command = AgentCommand::Start(recording, Some(trainee), Some(task));
        let Err(error) = self.box_agents.command(exam.box_id, command).await else { return Ok(()) };
        if error != CommandError::NoAnswer {
            self.store.exams().take_back(scope, exam.id, recording).await?;
        }
        Err(command_problem(error))
    }

    /// The self-test that lets a box be used for an exam now.
    ///
    /// # Errors
    /// The box needs a self-test first.
    async fn ready_exam_box(&self, scope: &Scope, of: BoxId) -> HandlerResult<SelfTestId> {
        let (check, self_test) = self.exam_box_check(scope, of).await?;
        self_test.filter(|_| check.is_ready).ok_or_else(|| {
            let problems: Vec<&str> = check.problems.iter().map(|problem| problem.name()).collect();
            Refusal::Conflict
                .with("The box needs a self-test first. Run it on the page of the box, then go on with the exam.")
                .member("box_problems", problems)
                .member("box", of.to_string())
        })
    }

    /// Whether a box may be used for an exam now, and the self-test that says so.
    async fn exam_box_check(&self, scope: &Scope, of: BoxId) -> HandlerResult<(ExamBoxCheck, Option<SelfTestId>)> {
        let today_ms = start_of_day_ms(self.clock.now_ms());
        let tested = self.store.self_tests().light_since(scope, of, today_ms).await?;
        let mut problems = Vec::new();
        match &tested {
            None => problems.push(ExamBoxProblem::NotTestedToday),
            Some(test) if !matches!(test.light, TrafficLight::Green | TrafficLight::Yellow) => {
                problems.push(ExamBoxProblem::NotPassed);
            }
            Some(test) => {
                let calibration = self.store.calibrations().in_use(scope, of).await?;
                let palette = self.store.palettes().in_use(scope, of).await?;
                let set = [calibration.map(|one| one.created_at_ms), palette.map(|one| one.created_at_ms)];
                if set.iter().any(|set| set.is_none_or(|set_ms| set_ms > test.created_at_ms)) {
                    problems.push(ExamBoxProblem::ChangedSince);
                }
            }
        }
        let reasons = self.self_test_reasons(scope, of).await?;
        problems.extend(reasons.into_iter().map(|reason| match reason {
            SelfTestReason::CameraMoved => ExamBoxProblem::CameraMoved,
            SelfTestReason::LightChanged => ExamBoxProblem::LightChanged,
        }));
        let (tested_at, light) = (tested.map(|test| Time(test.created_at_ms)), tested.map(|test| test.light));
        let check = ExamBoxCheck { is_ready: problems.is_empty(), problems, tested_at, light };
        Ok((check, tested.map(|test| test.id)))
    }

    /// Notifies pages that the sessions of an exam can be seen now.
    async fn notify_attempts(&self, scope: &Scope, exam: &ExamRecord) -> HandlerResult<()> {
        for session in exam.begun.iter().filter_map(|attempt| attempt.session_id) {
            let session = self.store.sessions().get(scope, session).await.map_err(ProblemResponse::from)?;
            self.notify_session_changed(&session);
        }
        Ok(())
    }
}
