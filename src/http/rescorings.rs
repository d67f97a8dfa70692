//! Scoring a task's sessions again, for those who run the centre: order, progress, and what changed for whom.

use axum::extract::State;
use axum::http::StatusCode;
use serde::Serialize;
use utoipa::ToSchema;

use super::auth::signed_in::Administrator;
use super::error::{Answer, ProblemDocument};
use super::read::{At, Json, Params};
use super::show::{Created, Named, Page, Paging, Time};
use super::state::App;
use crate::domain::rescoring::{FeatureChange, NewRescoring, RescoringItemState, RescoringSource};
use crate::domain::session::Versions;
use crate::domain::standard::SessionJudgement;
use crate::ids::{RescoringId, ResultId, SessionId};
use crate::rescoring::compare;
use crate::store;

/// Most sessions of a page: two results of each are read.
const MOST_SESSIONS: u32 = 50;

/// An order, how far it is, and what it changed.
#[derive(Debug, Serialize, ToSchema)]
pub struct Rescoring {
    id: RescoringId,
    task: Named,
    /// What is read again.
    from: RescoringSource,
    /// Only sessions whose result was of another version of the program?
    only_older: bool,
    /// Version of the program when it was ordered.
    pipeline: String,
    /// Version of the task's standard that old and new are judged by; `null`: it had none.
    standard: Option<i64>,
    /// Who ordered it.
    who: Option<String>,
    created_at: Time,
    cancelled_at: Option<Time>,
    /// When its last session had ended; `null` while it goes on.
    ended_at: Option<Time>,
    /// Share of the sessions that have ended, 0 to 1.
    progress: f64,
    /// How its sessions stand.
    sessions: Counts,
    /// What changed.
    changes: Changes,
}

/// How many sessions stand how.
#[derive(Debug, Serialize, ToSchema)]
pub struct Counts {
    /// In all.
    all: i64,
    waiting: i64,
    working: i64,
    done: i64,
    failed: i64,
    cancelled: i64,
}

/// In how many sessions what changed.
#[derive(Debug, Serialize, ToSchema)]
pub struct Changes {
    /// Passed before, and not any more.
    no_longer_passed: i64,
    /// Not passed before, and passed now.
    now_passed: i64,
    /// A feature's old and new error bars do not overlap: more than errors of measuring explain.
    apart: i64,
    /// A feature differs beyond rounding (one part in a thousand million), or only one result has it; those that are apart among them.
    changed: i64,
}

/// What changed in one session.
#[derive(Debug, Serialize, ToSchema)]
pub struct RescoredSession {
    session: SessionId,
    trainee: Named,
    recorded_at: Time,
    state: RescoringItemState,
    /// Why the work could not be done.
    error: Option<ProblemDocument>,
    old: RescoredResult,
    /// `null` until it is done. The same id as `old` where the session had been scored with the present versions already.
    new: Option<RescoredResult>,
    /// How many features' error bars do not overlap.
    apart: i64,
    /// How many differ beyond rounding.
    changed: i64,
    /// Those features, the ones that are apart first.
    features: Vec<FeatureChange>,
}

/// A result of it.
#[derive(Debug, Serialize, ToSchema)]
pub struct RescoredResult {
    id: ResultId,
    versions: Versions,
    /// By the standard of the order; `null` without one, and until both are compared.
    judgement: Option<SessionJudgement>,
}

/// What changed for one trainee.
#[derive(Debug, Serialize, ToSchema)]
pub struct RescoredTrainee {
    trainee: Named,
    /// Their sessions in the order.
    sessions: i64,
    /// Those that are compared.
    done: i64,
    changes: Changes,
}

/// Order a task's sessions to be scored again
///
/// Old results stay; the newest counts. New sessions go first. `from: trajectory` scores the stored paths, `from: recording` tracks the
/// recordings again with the boxes' present cameras and colours.
#[utoipa::path(post, path = "/tasks/{id}/rescorings", tag = "rescorings",
    params(("id" = String, Path, description = "id or code")), request_body = NewRescoring,
    responses((status = CREATED, body = Rescoring)))]
pub async fn create(
    State(app): State<App>,
    by: Administrator,
    At(key): At,
    Json(new): Json<NewRescoring>,
) -> Answer<Created<Rescoring>> {
    let task = app.store.tasks().get(&by.scope, &key).await?;
    let id = app.store.rescorings().create(&by.scope, task.id, new).await?;
    let made = app.store.rescorings().get(&by.scope, id).await?.into();
    Ok(Created { location: format!("/api/v1/rescorings/{id}"), made })
}

/// List the orders, newest first
#[utoipa::path(get, path = "/rescorings", tag = "rescorings", params(Paging),
    responses((status = OK, body = Page<Rescoring>)))]
pub async fn list(
    State(app): State<App>,
    by: Administrator,
    Params(paging): Params<Paging>,
) -> Answer<Json<Page<Rescoring>>> {
    let page = paging.request(app.settings.page_items)?;
    Ok(Json(Page::of(app.store.rescorings().list(&by.scope, &page).await?, Rescoring::from)))
}

/// Read an order: how far it is, and how much it changed
#[utoipa::path(get, path = "/rescorings/{id}", tag = "rescorings", params(("id" = String, Path, description = "id")),
    responses((status = OK, body = Rescoring)))]
pub async fn get(State(app): State<App>, by: Administrator, at: At) -> Answer<Json<Rescoring>> {
    Ok(Json(app.store.rescorings().get(&by.scope, at.id()?).await?.into()))
}

/// Call an order off: what waits stays as it is, what runs ends
#[utoipa::path(delete, path = "/rescorings/{id}", tag = "rescorings", params(("id" = String, Path, description = "id")),
    responses((status = NO_CONTENT)))]
pub async fn cancel(State(app): State<App>, by: Administrator, at: At) -> Answer<StatusCode> {
    app.store.rescorings().cancel(&by.scope, at.id()?).await?;
    app.events.tell(crate::events::Event::Queue);
    Ok(StatusCode::NO_CONTENT)
}

/// Read what changed session by session: whose judgement changed first
#[utoipa::path(get, path = "/rescorings/{id}/sessions", tag = "rescorings",
    params(("id" = String, Path, description = "id"), Paging),
    responses((status = OK, body = Page<RescoredSession>)))]
pub async fn sessions(
    State(app): State<App>,
    by: Administrator,
    at: At,
    Params(paging): Params<Paging>,
) -> Answer<Json<Page<RescoredSession>>> {
    let limit = paging.limit().unwrap_or(app.settings.page_items).min(MOST_SESSIONS);
    let page = paging.at_most(limit).request(limit)?;
    let store::Page { items, next } = app.store.rescorings().items(&by.scope, at.id()?, &page).await?;
    let mut shown = Vec::with_capacity(items.len());
    for item in items {
        let old = app.store.sessions().result_of(&by.scope, item.session_id, item.old_result_id).await?;
        let new = match item.new_result_id {
            Some(new) => Some(app.store.sessions().result_of(&by.scope, item.session_id, new).await?),
            None => None,
        };
        shown.push(RescoredSession::of(item, old, new));
    }
    Ok(Json(Page { items: shown, next }))
}

/// Read what changed trainee by trainee: those with most changed judgements first
#[utoipa::path(get, path = "/rescorings/{id}/trainees", tag = "rescorings",
    params(("id" = String, Path, description = "id"), Paging),
    responses((status = OK, body = Page<RescoredTrainee>)))]
pub async fn trainees(
    State(app): State<App>,
    by: Administrator,
    at: At,
    Params(paging): Params<Paging>,
) -> Answer<Json<Page<RescoredTrainee>>> {
    let page = paging.request(app.settings.page_items)?;
    let trainees = app.store.rescorings().trainees(&by.scope, at.id()?, &page).await?;
    Ok(Json(Page::of(trainees, RescoredTrainee::from)))
}

impl From<store::Rescoring> for Rescoring {
    fn from(of: store::Rescoring) -> Self {
        let ended = of.done + of.failed + of.cancelled;
        Self {
            id: of.id,
            task: Named { id: of.task_id.to_string(), name: of.task_name.into(), code: of.task_code.into() },
            from: of.source,
            only_older: of.only_older,
            pipeline: of.pipeline,
            standard: of.standard,
            who: of.who,
            created_at: Time(of.created_at_ms),
            cancelled_at: of.cancelled_at_ms.map(Time),
            ended_at: of.ended_at_ms.map(Time),
            progress: if of.sessions == 0 { 1.0 } else { ended as f64 / of.sessions as f64 },
            sessions: Counts {
                all: of.sessions,
                waiting: of.waiting,
                working: of.working,
                done: of.done,
                failed: of.failed,
                cancelled: of.cancelled,
            },
            changes: Changes {
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
            trainee: Named {
                id: of.trainee_id.to_string(),
                name: of.trainee_name.into(),
                code: of.trainee_code.into(),
            },
            sessions: of.sessions,
            done: of.done,
            changes: Changes { no_longer_passed, now_passed, apart, changed },
        }
    }
}

impl RescoredSession {
    fn of(item: store::RescoringItem, old: store::SessionResult, new: Option<store::SessionResult>) -> Self {
        let comparable = new.as_ref().filter(|_| item.problem.is_none()); // else a difference would not be the program's
        let features = comparable.map(|new| compare::changes(&old.features, &new.features)).unwrap_or_default();
        let result = |result: store::SessionResult, judgement| RescoredResult {
            id: result.id,
            versions: result.versions,
            judgement,
        };
        Self {
            session: item.session_id,
            trainee: Named {
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
