//! List, count, read, retry, end, supervise and erase sessions.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use axum::extract::State;
use axum::http::StatusCode;
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};

use super::show::SessionResponse;
use crate::domain::access::AccessedPart;
use crate::domain::blob::BlobHash;
use crate::domain::feed::close_reason::CloseCode;
use crate::domain::scope::Scope;
use crate::domain::session::{BoxQuestion, SessionOrder, SessionOutcome, SessionStatus};
use crate::domain::text::{Key, SearchWords};
use crate::events::Event;
use crate::http::auth::signed_in::{Member, Staff};
use crate::http::error::{HandlerResult, ProblemResponse, Refusal};
use crate::http::read::{Json, Params, PathKey};
use crate::http::show::{PageResponse, Paging};
use crate::http::state::App;
use crate::live::Interruption;
use crate::store::{self, SessionCount, SessionFilter, StandardRecord, StoreError};
use crate::time::from_rfc3339;

/// Selects sessions.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct SessionsQuery {
    /// Only of this trainee, by id or code.
    #[param(value_type = Option<String>)]
    trainee: Option<Key>,
    /// Only of this task, by id or code.
    #[param(value_type = Option<String>)]
    task: Option<Key>,
    /// Only recorded in this box, by id or code.
    #[serde(rename = "box")]
    #[param(rename = "box", value_type = Option<String>)]
    in_box: Option<Key>,
    /// Only with this status.
    status: Option<SessionStatus>,
    /// Only with this recording: SHA-256 of the file, 64 hexadecimal digits.
    sha256: Option<String>,
    /// Only with this outcome: the state of a session until it is done, then whether it met the standard in use.
    #[param(inline)]
    outcome: Option<SessionOutcome>,
    /// Only sessions whose trainee, task, box or file has each of these words in its name or code; at most 8 words.
    #[param(value_type = Option<String>)]
    search: Option<SearchWords>,
    /// Only recorded at this moment or later (RFC 3339).
    #[param(format = DateTime)]
    recorded_from: Option<String>,
    /// Only recorded before this moment (RFC 3339).
    #[param(format = DateTime)]
    recorded_before: Option<String>,
    /// `arrival`: the last to arrive first. `recorded`: the last to be recorded first. By default `arrival`.
    #[param(inline)]
    order: Option<SessionOrder>,
    /// Most items on the page, 1 to 200.
    #[param(minimum = 1, maximum = 200)]
    limit: Option<u32>,
    /// `next` of the previous page.
    cursor: Option<String>,
}

impl SessionsQuery {
    fn filter(&self) -> HandlerResult<SessionFilter> {
        Ok(SessionFilter {
            trainee: self.trainee.clone(),
            task: self.task.clone(),
            in_box: self.in_box.clone(),
            status: self.status,
            only_counting: false,
            outcome: self.outcome,
            search: self.search.clone(),
            recorded_from_ms: moment("recorded_from", self.recorded_from.as_deref())?,
            recorded_before_ms: moment("recorded_before", self.recorded_before.as_deref())?,
            recording: self.sha256.as_deref().map(file_hash).transpose()?,
        })
    }
}

fn moment(field: &'static str, text: Option<&str>) -> HandlerResult<Option<i64>> {
    let unreadable = || ProblemResponse::invalid(field, "expected an RFC 3339 time such as 2026-11-21T20:14:00Z");
    text.map(|text| from_rfc3339(text).ok_or_else(unreadable)).transpose()
}

fn file_hash(text: &str) -> HandlerResult<BlobHash> {
    let why = "expected the SHA-256 of a file, 64 hexadecimal digits";
    text.to_ascii_lowercase().parse().map_err(|_| ProblemResponse::invalid("sha256", why))
}

/// List the sessions that the caller may see
///
/// By default the last to arrive come first, whenever they were recorded: a recording may be sent days after it was made.
#[utoipa::path(get, path = "/sessions", tag = "sessions", params(SessionsQuery),
    responses((status = OK, body = PageResponse<SessionResponse>)))]
pub async fn list(
    State(app): State<App>,
    by: Member,
    Params(which): Params<SessionsQuery>,
) -> HandlerResult<Json<PageResponse<SessionResponse>>> {
    let filter = app.filter_of_kept_records(&by.scope, which.filter()?).await?;
    let order = which.order.unwrap_or(SessionOrder::Arrival);
    let list = match order {
        SessionOrder::Arrival => "sessions",
        SessionOrder::Recorded => "sessions-by-recording",
    };
    let page = Paging::new(which.limit, which.cursor).request(list, app.settings.page_items)?;
    let store::Page { items, next } = app.store.sessions().list_ordered(&by.scope, &filter, order, &page).await?;
    let (mut shown, mut standards) = (Vec::with_capacity(items.len()), HashMap::new());
    for session in items {
        let (result, handedness) =
            (app.store.sessions().result(&by.scope, session.id).await?, session.trainee_handedness);
        let arrived_ms = session.created_at_ms;
        let versions: &mut Vec<_> = match standards.entry(session.task_id) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => new.insert(app.store.standards().of_tasks(&by.scope, &[session.task_id]).await?),
        };
        let interruption = app.interruption(&session).await?;
        let response = SessionResponse::of(session, result).with_interruption(interruption);
        shown.push(response.judged_by(StandardRecord::valid_at(versions, arrived_ms), handedness));
    }
    Ok(Json(PageResponse::of(store::Page { items: shown, next }, |item| item)))
}

/// Selects sessions to count.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct SessionCountQuery {
    /// As in `GET /sessions`, like all others.
    #[param(value_type = Option<String>)]
    trainee: Option<Key>,
    #[param(value_type = Option<String>)]
    task: Option<Key>,
    #[serde(rename = "box")]
    #[param(rename = "box", value_type = Option<String>)]
    in_box: Option<Key>,
    status: Option<SessionStatus>,
    #[param(inline)]
    outcome: Option<SessionOutcome>,
    #[param(value_type = Option<String>)]
    search: Option<SearchWords>,
    #[param(format = DateTime)]
    recorded_from: Option<String>,
    #[param(format = DateTime)]
    recorded_before: Option<String>,
}

impl From<SessionCountQuery> for SessionsQuery {
    fn from(which: SessionCountQuery) -> Self {
        let SessionCountQuery { trainee, task, in_box, status, outcome, search, recorded_from, recorded_before } =
            which;
        Self {
            trainee,
            task,
            in_box,
            status,
            sha256: None,
            outcome,
            search,
            recorded_from,
            recorded_before,
            order: None,
            limit: None,
            cursor: None,
        }
    }
}

/// Count the sessions that a filter shows
#[utoipa::path(get, path = "/session-count", tag = "sessions", params(SessionCountQuery),
    responses((status = OK, body = SessionCount)))]
pub async fn count(
    State(app): State<App>,
    by: Member,
    Params(which): Params<SessionCountQuery>,
) -> HandlerResult<Json<SessionCount>> {
    let which = app.filter_of_kept_records(&by.scope, SessionsQuery::from(which).filter()?).await?;
    Ok(Json(app.store.sessions().count(&by.scope, &which).await?))
}

/// Read one session
#[utoipa::path(get, path = "/sessions/{id}", tag = "sessions", params(("id" = String, Path, description = "id")),
    responses((status = OK, body = SessionResponse)))]
pub async fn get(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<Json<SessionResponse>> {
    let session = app.store.sessions().get(&by.scope, at.id()?).await?;
    app.note_access(&by.scope, session.id, AccessedPart::Result);
    let live = app.store.feeds().live_features(&by.scope, session.id).await?;
    let arrival = app.store.feeds().arrival(&by.scope, session.id).await?;
    let early_end = app.store.feeds().early_end(&by.scope, session.id).await?;
    let interruption = app.interruption(&session).await?;
    let setup = app.store.box_versions().of_session(&by.scope, session.id).await?;
    let same = app.store.sessions().same_recordings(&by.scope, session.id).await?;
    let exam = app.store.exams().of_session(&by.scope, session.id).await?;
    let response = app.judged_session(&by.scope, session).await?.with_interruption(interruption).with_setup(setup);
    let response = response.with_same_recordings(same, by.scope.is_staff()).with_exam(exam);
    Ok(Json(response.with_live(live).with_arrival(arrival).with_early_end(early_end)))
}

/// Track a session again
///
/// After a failure, with a newer version of the program, or with the calibration and colours that were valid when it was
/// recorded, if it was tracked with others (`setup`).
#[utoipa::path(post, path = "/sessions/{id}/retry", tag = "sessions",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = SessionResponse)))]
pub async fn retry(State(app): State<App>, by: Staff, at: PathKey) -> HandlerResult<Json<SessionResponse>> {
    let session = app.store.sessions().retry(&by.scope, at.id()?).await?;
    app.notify_session_changed(&session);
    Ok(Json(app.judged_session(&by.scope, session).await?))
}

/// End an interrupted recording
///
/// For a session with the status `receiving` whose sender is gone: the frames that arrived become the recording, which
/// is scored. Without this request it ends by itself after some time.
#[utoipa::path(post, path = "/sessions/{id}/end", tag = "sessions",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = SessionResponse)))]
pub async fn end(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<Json<SessionResponse>> {
    let session = app.store.sessions().get(&by.scope, at.id()?).await?.id;
    let ended = app.feeds.end_interrupted(session).await.map_err(|reason| match reason.code {
        CloseCode::Done => Refusal::Conflict.with("The recording has ended already."),
        CloseCode::OutOfPlace => Refusal::Gone.with("No picture can be read from what arrived. Delete the recording."),
        _ => reason.into(),
    })?;
    let session = app.store.sessions().get(&by.scope, ended).await?;
    Ok(Json(app.judged_session(&by.scope, session).await?))
}

/// A mark that a member of staff saw the attempt.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewSupervision {
    /// True if the caller saw the attempt; false takes the mark back.
    supervised: bool,
}

/// Say whether the caller saw the attempt
///
/// A recording that a member of staff records or sends has the mark from the beginning.
#[utoipa::path(put, path = "/sessions/{id}/supervision", tag = "sessions",
    params(("id" = String, Path, description = "id")), request_body = NewSupervision,
    responses((status = OK, body = SessionResponse)))]
pub async fn supervise(
    State(app): State<App>,
    by: Staff,
    at: PathKey,
    Json(new): Json<NewSupervision>,
) -> HandlerResult<Json<SessionResponse>> {
    let session = app.store.sessions().set_supervised(&by.scope, at.id()?, new.supervised).await?;
    app.notify_session_changed(&session);
    Ok(Json(app.judged_session(&by.scope, session).await?))
}

/// Erase a session with its recording and results
///
/// Trainees may erase their own session while its recording is arriving.
#[utoipa::path(delete, path = "/sessions/{id}", tag = "sessions", params(("id" = String, Path, description = "id")),
    responses((status = NO_CONTENT)))]
pub async fn erase(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<StatusCode> {
    app.store.sessions().erase(&by.scope, at.id()?).await?;
    app.events.publish(Event::Queue);
    Ok(StatusCode::NO_CONTENT)
}

impl App {
    /// The filter with the kept record in place of one that was merged into it.
    async fn filter_of_kept_records(&self, scope: &Scope, filter: SessionFilter) -> HandlerResult<SessionFilter> {
        let mut kept = filter;
        if let Some(key) = &kept.trainee
            && let Some(id) = found(self.store.trainees().get(scope, key).await)?.map(|trainee| trainee.id)
        {
            kept.trainee = Some(Key::from(&id));
        }
        if let Some(key) = &kept.in_box
            && let Some(id) = found(self.store.boxes().get(scope, key).await)?.map(|of| of.id)
        {
            kept.in_box = Some(Key::from(&id));
        }
        Ok(kept)
    }

    /// What is known of a recording whose sender is gone; `None` unless the session is one.
    async fn interruption(&self, session: &store::SessionRecord) -> HandlerResult<Option<Interruption>> {
        match session.status() {
            SessionStatus::Receiving => Ok(self.feeds.interruption(session.id).await?),
            _ => Ok(None),
        }
    }

    /// A session with its latest result, judged by its task's standard and its model of skill.
    pub(in crate::http) async fn judged_session(
        &self,
        scope: &Scope,
        session: store::SessionRecord,
    ) -> HandlerResult<SessionResponse> {
        let (handedness, of) = (session.trainee_handedness, (session.task_id, session.trainee_id));
        let result = self.store.sessions().result(scope, session.id).await?;
        let standard = self.store.standards().at(scope, session.task_id, session.created_at_ms).await?;
        let counts = session.box_question.is_none_or(BoxQuestion::counts);
        let verdict = match result.as_ref().filter(|_| counts) {
            Some(result) => Some(self.cohorts.verdict(scope, of, result).await?),
            None => None,
        };
        Ok(SessionResponse::of(session, result).judged_by(standard.as_ref(), handedness).with_verdict(verdict))
    }

    /// Notifies watchers that a session changed, and workers of a possible job.
    pub fn notify_session_changed(&self, session: &store::SessionRecord) {
        let (id, trainee, status) = (session.id, session.trainee_id, session.status());
        let progress = super::show::progress(status, session.job_progress);
        self.events.publish(Event::Session { id, trainee, status, progress });
        self.queue.work_arrived();
    }
}

/// `None` for what does not exist, or not for the caller.
fn found<T>(read: Result<T, StoreError>) -> HandlerResult<Option<T>> {
    match read {
        Ok(found) => Ok(Some(found)),
        Err(StoreError::NotFound { .. }) => Ok(None),
        Err(error) => Err(error.into()),
    }
}
