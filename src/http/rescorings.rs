//! Scores a task's sessions again, for administrators: start, progress, and the changes by session and by trainee.

use axum::extract::State;
use axum::http::StatusCode;
use serde::Serialize;
use utoipa::ToSchema;

use super::auth::signed_in::Administrator;
use super::error::{HandlerResult, ProblemDocument};
use super::read::{Json, Params, PathKey};
use super::show::{Created, NamedReference, PageResponse, Paging, Time};
use super::state::App;
use crate::domain::rescoring::{FeatureChange, NewRescoring, RescoringItemState, RescoringSource};
use crate::domain::session::Versions;
use crate::domain::standard::SessionJudgement;
use crate::ids::{RescoringId, ResultId, SessionId};
use crate::rescoring::compare;
use crate::store;

/// Most sessions on a page, because two results of each are read.
const MAX_SESSIONS_PER_PAGE: u32 = 50;

/// A rescoring, its progress and its changes.
#[derive(Debug, Serialize, ToSchema)]
pub struct RescoringResponse {
    id: RescoringId,
    task: NamedReference,
    /// What is processed again.
    from: RescoringSource,
    /// True if only sessions are included whose result came from another version of the program.
    only_older: bool,
    /// Version of the program when the rescoring was started.
    pipeline: String,
    /// Version of the task's standard that judges old and new results; `null`: the task had none.
    standard: Option<i64>,
    /// Name of the person who started it.
    who: Option<String>,
    created_at: Time,
    cancelled_at: Option<Time>,
    /// When the last session was finished; `null` while it is running.
    ended_at: Option<Time>,
    /// Share of the sessions that are finished, 0 to 1.
    progress: f64,
    /// Number of sessions in each state.
    sessions: RescoringCounts,
    /// Number of sessions with each kind of change.
    changes: RescoringChanges,
}

/// Number of sessions in each state.
#[derive(Debug, Serialize, ToSchema)]
pub struct RescoringCounts {
    /// All sessions.
    all: i64,
    waiting: i64,
    working: i64,
    done: i64,
    failed: i64,
    cancelled: i64,
}

/// Number of sessions with each kind of change.
#[derive(Debug, Serialize, ToSchema)]
pub struct RescoringChanges {
    /// Sessions that passed before and do not pass now.
    no_longer_passed: i64,
    /// Sessions that did not pass before and pass now.
    now_passed: i64,
    /// Sessions with a feature whose old and new error bars do not overlap: measurement error does not
    /// explain the change.
    apart: i64,
    /// Sessions with a feature that differs by more than rounding (one part in 10⁹), or that only one result has.
    /// Includes the sessions counted in `apart`.
    changed: i64,
}

/// The changes in one session.
#[derive(Debug, Serialize, ToSchema)]
pub struct RescoredSession {
    session: SessionId,
    trainee: NamedReference,
    recorded_at: Time,
    state: RescoringItemState,
    /// Why the session could not be scored again.
    error: Option<ProblemDocument>,
    old: RescoredResult,
    /// `null` until it is done. The same id as `old` if the session had been scored with the present versions already.
    new: Option<RescoredResult>,
    /// Number of features whose old and new error bars do not overlap.
    apart: i64,
    /// Number of features that differ by more than rounding.
    changed: i64,
    /// The changed features; those whose error bars do not overlap come first.
    features: Vec<FeatureChange>,
}

/// An old or new result of the session.
#[derive(Debug, Serialize, ToSchema)]
pub struct RescoredResult {
    id: ResultId,
    versions: Versions,
    /// Judgement by the rescoring's standard; `null` without a standard, and until both results are compared.
    judgement: Option<SessionJudgement>,
}

/// The changes for one trainee.
#[derive(Debug, Serialize, ToSchema)]
pub struct RescoredTrainee {
    trainee: NamedReference,
    /// The trainee's sessions in the rescoring.
    sessions: i64,
    /// Sessions whose results are compared.
    done: i64,
    changes: RescoringChanges,
}

/// Score a task's sessions again
///
/// Old results stay; the newest counts. New sessions take precedence in the queue. `from: trajectory` scores the stored
/// paths; `from: recording` tracks the recordings again with the boxes' present calibrations and colours.
#[utoipa::path(post, path = "/tasks/{id}/rescorings", tag = "rescorings",
    params(("id" = String, Path, description = "id or code")), request_body = NewRescoring,
    responses((status = CREATED, body = RescoringResponse)))]
pub async fn create(
    State(app): State<App>,
    by: Administrator,
    PathKey(key): PathKey,
    Json(new): Json<NewRescoring>,
) -> HandlerResult<Created<RescoringResponse>> {
    let task = app.store.tasks().get(&by.scope, &key).await?;
    let id = app.store.rescorings().create(&by.scope, task.id, new).await?;
    let made = app.store.rescorings().get(&by.scope, id).await?.into();
    Ok(Created { location: format!("/api/v1/rescorings/{id}"), made })
}

/// List the rescorings, newest first
#[utoipa::path(get, path = "/rescorings", tag = "rescorings", params(Paging),
    responses((status = OK, body = PageResponse<RescoringResponse>)))]
pub async fn list(
    State(app): State<App>,
    by: Administrator,
    Params(paging): Params<Paging>,
) -> HandlerResult<Json<PageResponse<RescoringResponse>>> {
    let page = paging.request("rescorings", app.settings.page_items)?;
    Ok(Json(PageResponse::of(app.store.rescorings().list(&by.scope, &page).await?, RescoringResponse::from)))
}

/// Read a rescoring: its progress and the number of changes
#[utoipa::path(get, path = "/rescorings/{id}", tag = "rescorings", params(("id" = String, Path, description = "id")),
    responses((status = OK, body = RescoringResponse)))]
pub async fn get(State(app): State<App>, by: Administrator, at: PathKey) -> HandlerResult<Json<RescoringResponse>> {
    Ok(Json(app.store.rescorings().get(&by.scope, at.id()?).await?.into()))
}

/// Cancel a rescoring
///
/// Waiting and queued sessions keep their results; running ones run to their end.
#[utoipa::path(post, path = "/rescorings/{id}/cancel", tag = "rescorings",
    params(("id" = String, Path, description = "id")), responses((status = NO_CONTENT)))]
pub async fn cancel(State(app): State<App>, by: Administrator, at: PathKey) -> HandlerResult<StatusCode> {
    app.store.rescorings().cancel(&by.scope, at.id()?).await?;
    app.events.publish(crate::events::Event::Queue);
    Ok(StatusCode::NO_CONTENT)
}

/// List the changes by session
///
/// Sessions whose judgement changed come first.
#[utoipa::path(get, path = "/rescorings/{id}/sessions", tag = "rescorings",
    params(("id" = String, Path, description = "id"), Paging),
    responses((status = OK, body = PageResponse<RescoredSession>)))]
pub async fn sessions(
    State(app): State<App>,
    by: Administrator,
    at: PathKey,
    Params(paging): Params<Paging>,
) -> HandlerResult<Json<PageResponse<RescoredSession>>> {
    let limit = paging.limit().unwrap_or(app.settings.page_items).min(MAX_SESSIONS_PER_PAGE);
    let id: RescoringId = at.id()?;
    let page = paging.at_most(limit).request(format!("rescored-sessions/{id}"), limit)?;
    let store::Page { items, next } = app.store.rescorings().items(&by.scope, id, &page).await?;
    let mut shown = Vec::with_capacity(items.len());
    for item in items {
        let old = app.store.sessions().result_of(&by.scope, item.session_id, item.old_result_id).await?;
        let new = match item.new_result_id {
            Some(new) => Some(app.store.sessions().result_of(&by.scope, item.session_id, new).await?),
            None => None,
        };
        shown.push(RescoredSession::of(item, old, new));
    }
    Ok(Json(PageResponse::of(store::Page { items: shown, next }, |item| item)))
}

/// List the changes by trainee
///
/// Trainees with the most changed judgements come first.
#[utoipa::path(get, path = "/rescorings/{id}/trainees", tag = "rescorings",
    params(("id" = String, Path, description = "id"), Paging),
    responses((status = OK, body = PageResponse<RescoredTrainee>)))]
pub async fn trainees(
    State(app): State<App>,
    by: Administrator,
    at: PathKey,
    Params(paging): Params<Paging>,
) -> HandlerResult<Json<PageResponse<RescoredTrainee>>> {
    let id: RescoringId = at.id()?;
    let page = paging.request(format!("rescored-trainees/{id}"), app.settings.page_items)?;
    let trainees = app.store.rescorings().trainees(&by.scope, id, &page).await?;
    Ok(Json(PageResponse::of(trainees, RescoredTrainee::from)))
}

impl From<store::RescoringRecord> for RescoringResponse {
    fn from(of: store::RescoringRecord) -> Self {
        let ended = of.done + of.failed + of.cancelled;
        Self {
            id: of.id,
            task: NamedReference { id: of.task_id.to_string(), name: of.task_name.into(), code: of.task_code.into() },
            from: of.source,
            only_older: of.only_older,
            pipeline: of.pipeline,
            standard: of.standard,
            who: of.who,
            created_at: Time(of.created_at_ms),
            cancelled_at: of.cancelled_at_ms.map(Time),
            ended_at: of.ended_at_ms.map(Time),
            progress: if of.sessions == 0 { 1.0 } else { ended as f64 / of.sessions as f64 },
            sessions: RescoringCounts {
                all: of.sessions,
                waiting: of.waiting,
                working: of.working,
                done: of.done,
                failed: of.failed,
                cancelled: of.cancelled,
            },
            changes: RescoringChanges {
                no_longer_passed: of.no_longer_passed,
                now_passed: of.now_passed,
                apart: of.apart,
                changed: of.changed,
            },
        }
    }
}

impl From<store::RescoringTrainee> for RescoredTrainee {
    fn from(of: store::RescoringTrainee) -> Self {
        let store::RescoringTrainee { no_longer_passed, now_passed, apart, changed, .. } = of;
        Self {
            trainee: NamedReference {
                id: of.trainee_id.to_string(),
                name: of.trainee_name.into(),
                code: of.trainee_code.into(),
            },
            sessions: of.sessions,
            done: of.done,
            changes: RescoringChanges { no_longer_passed, now_passed, apart, changed },
        }
    }
}

impl RescoredSession {
    fn of(item: store::RescoringItem, old: store::SessionResult, new: Option<store::SessionResult>) -> Self {
        // After a problem, a difference would not be due to the new version of the program.
        let comparable = new.as_ref().filter(|_| item.problem.is_none());
        let features = comparable.map(|new| compare::changes(&old.features, &new.features)).unwrap_or_default();
        let result = |result: store::SessionResult, judgement| RescoredResult {
            id: result.id,
            versions: result.versions,
            judgement,
        };
        Self {
            session: item.session_id,
            trainee: NamedReference {
                id: item.trainee_id.to_string(),
                name: item.trainee_name.into(),
                code: item.trainee_code.into(),
            },
            recorded_at: Time(item.recorded_at_ms),
            state: item.state,
            error: item.problem.map(ProblemDocument::from),
            old: result(old, item.judged_before),
            new: new.map(|new| result(new, item.judged_after)),
            apart: item.features_apart,
            changed: item.features_changed,
            features,
        }
    }
}
