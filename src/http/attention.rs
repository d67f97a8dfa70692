//! Who needs attention: recent sessions that staff should look at, and the alarms of the standards' charts.

use axum::extract::State;
use axum::http::StatusCode;
use serde::Serialize;
use utoipa::ToSchema;

use super::auth::signed_in::{Member, Staff};
use super::error::HandlerResult;
use super::read::{Json, PathKey, reference_problem};
use super::show::{Created, NamedReference, PageResponse, Time};
use super::state::App;
use crate::cohorts::{Alarm, AlarmKind, Alarms};
use crate::domain::attention::{AttentionKind, NewDismissal};
use crate::domain::scope::Scope;
use crate::ids::{DismissalId, SessionId};
use crate::store::{AttentionItem, DismissalRecord, RECENT_MS, StoreError};
use crate::time::from_rfc3339;

const DAY_MS: i64 = 86_400_000;
/// A task counts as rated if one of its sessions was rated within this time.
const RATED_WINDOW_MS: i64 = 90 * DAY_MS;
/// Most sessions in each list.
const MAX_SESSIONS: u32 = 20;

/// What needs attention, among the trainees in the caller's scope.
#[derive(Debug, Serialize, ToSchema)]
pub struct Attention {
    /// Relapses and due refreshers, latest first.
    alarms: Vec<Alarm>,
    /// True if more people trained recently than were checked for alarms.
    more: bool,
    /// Sessions that may show another box: until a person says whether it is the box, they count nowhere. At most 20.
    box_asked: Vec<SessionToReview>,
    /// Sessions of the last 14 days that the quality gate refused, at most 20.
    refused: Vec<SessionToReview>,
    /// Unrated sessions of the last 14 days, of tasks whose sessions are rated; at most 20. Empty for trainees.
    unrated: Vec<SessionToReview>,
    /// Number of the caller's dismissals: what they cover is not listed.
    dismissed: usize,
}

/// A session that staff should look at.
#[derive(Debug, Serialize, ToSchema)]
pub struct SessionToReview {
    session: SessionId,
    trainee: NamedReference,
    task: NamedReference,
    recorded_at: Time,
}

/// Read what needs attention
///
/// Lists alarms, sessions that may show another box, refused sessions and unrated sessions, without those that the caller
/// has dismissed.
/// `GET /sessions?status=failed` lists failed sessions.
#[utoipa::path(get, path = "/attention", tag = "trainees", responses((status = OK, body = Attention)))]
pub async fn attention(State(app): State<App>, by: Member) -> HandlerResult<Json<Attention>> {
    let (sessions, now_ms) = (app.store.sessions(), app.clock.now_ms());
    let (since, rated_since) = (now_ms.saturating_sub(RECENT_MS), now_ms.saturating_sub(RATED_WINDOW_MS));
    let Alarms { items, more } = app.cohorts.alarms(&by.scope).await?;
    let alarms = app.without_dismissed(&by.scope, items).await?;
    let refused = sessions.refused_since(&by.scope, since, MAX_SESSIONS).await?;
    let box_asked = sessions.box_asked(&by.scope, MAX_SESSIONS).await?;
    let unrated = match by.scope.is_staff() {
        true => sessions.unrated_since(&by.scope, since, rated_since, MAX_SESSIONS).await?,
        false => Vec::new(),
    };
    let wanting = |sessions: Vec<AttentionItem>| sessions.into_iter().map(SessionToReview::from).collect();
    let (box_asked, refused, unrated) = (wanting(box_asked), wanting(refused), wanting(unrated));
    let dismissed = match by.scope.is_staff() {
        true => app.store.attention().list(&by.scope).await?.len(),
        false => 0,
    };
    Ok(Json(Attention { alarms, more, box_asked, refused, unrated, dismissed }))
}

/// What the caller dismissed from their own list.
#[derive(Debug, Serialize, ToSchema)]
pub struct DismissalResponse {
    id: DismissalId,
    kind: AttentionKind,
    trainee: NamedReference,
    task: NamedReference,
    /// Number of sessions that it covers; 0 for an alarm.
    sessions: i64,
    /// When it is listed again; `null`: not again.
    until: Option<Time>,
    created_at: Time,
}

impl From<DismissalRecord> for DismissalResponse {
    fn from(of: DismissalRecord) -> Self {
        let trainee = (of.trainee_id.to_string(), of.trainee_name.to_string(), of.trainee_code.to_string());
        let task = (of.task_id.to_string(), of.task_name.to_string(), of.task_code.to_string());
        let named = |(id, name, code)| NamedReference { id, name, code };
        Self {
            id: of.id,
            kind: of.kind,
            trainee: named(trainee),
            task: named(task),
            sessions: of.sessions,
            until: of.until_ms.map(Time),
            created_at: Time(of.created_at_ms),
        }
    }
}

/// List what the caller has dismissed, newest first
///
/// At most 200. Dismissals that have ended are left out, and so are those of sessions that are too old to be listed.
#[utoipa::path(get, path = "/attention/dismissals", tag = "trainees",
    responses((status = OK, body = PageResponse<DismissalResponse>)))]
pub async fn dismissals(State(app): State<App>, by: Staff) -> HandlerResult<Json<PageResponse<DismissalResponse>>> {
    let dismissals = app.store.attention().list(&by.scope).await?;
    Ok(Json(PageResponse::whole(dismissals.into_iter().map(DismissalResponse::from))))
}

/// Dismiss something from the caller's own list of what needs attention
///
/// It stays in the lists of all others. It covers the named sessions or the named alarm: a later session or alarm of the
/// same trainee and task is listed again. With `days`, it is listed again after that time.
#[utoipa::path(post, path = "/attention/dismissals", tag = "trainees", request_body = NewDismissal,
    responses((status = CREATED, body = DismissalResponse)))]
pub async fn dismiss(
    State(app): State<App>,
    by: Staff,
    Json(new): Json<NewDismissal>,
) -> HandlerResult<Created<DismissalResponse>> {
    let since_ms = new.since_ms()?;
    let made = app.store.attention().dismiss(&by.scope, new, since_ms).await.map_err(|error| match error {
        StoreError::NotFound { what: "trainee" } => reference_problem("trainee")(error),
        StoreError::NotFound { what: "task" } => reference_problem("task")(error),
        StoreError::NotFound { what: "session" } => reference_problem("sessions")(error),
        other => other.into(),
    })?;
    Ok(Created { location: format!("/api/v1/attention/dismissals/{}", made.id), made: made.into() })
}

/// Take an own dismissal back
#[utoipa::path(delete, path = "/attention/dismissals/{id}", tag = "trainees",
    params(("id" = String, Path, description = "id")), responses((status = NO_CONTENT)))]
pub async fn undo_dismissal(State(app): State<App>, by: Staff, at: PathKey) -> HandlerResult<StatusCode> {
    app.store.attention().undo(&by.scope, at.id()?).await?;
    Ok(StatusCode::NO_CONTENT)
}

impl App {
    /// The alarms that this caller has not dismissed.
    async fn without_dismissed(&self, scope: &Scope, alarms: Vec<Alarm>) -> HandlerResult<Vec<Alarm>> {
        let dismissed = self.store.attention().dismissed_alarms(scope).await?;
        let is_shown = |alarm: &Alarm| {
            let kind = match alarm.kind {
                AlarmKind::Relapsed => AttentionKind::Relapsed,
                AlarmKind::Due => AttentionKind::Due,
            };
            let since_ms = from_rfc3339(&alarm.since);
            !since_ms.is_some_and(|since_ms| dismissed.contains(&(kind, alarm.trainee, alarm.task, since_ms)))
        };
        Ok(alarms.into_iter().filter(is_shown).collect())
    }
}

impl From<AttentionItem> for SessionToReview {
    fn from(of: AttentionItem) -> Self {
        let trainee = (of.trainee_id.to_string(), of.trainee_name.to_string(), of.trainee_code.to_string());
        let task = (of.task_id.to_string(), of.task_name.to_string(), of.task_code.to_string());
        let named = |(id, name, code)| NamedReference { id, name, code };
        Self { session: of.id, trainee: named(trainee), task: named(task), recorded_at: Time(of.recorded_at_ms) }
    }
}
