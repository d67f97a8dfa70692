//! Standards of tasks: the limits that a session has to meet. Every member may read standards; administrators and the
//! instructors of the task's groups may set them. A version never changes.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use crate::domain::scope::Scope;
use crate::domain::standard::{NewStandard, Preset, StandardDefinition};
use crate::http::auth::signed_in::{Member, Staff};
use crate::http::error::HandlerResult;
use crate::http::read::{Json, PathKey};
use crate::http::show::{Created, PageResponse, Time};
use crate::http::state::App;
use crate::ids::StandardId;
use crate::store;

pub use crate::cohorts::Proposal;

use crate::cohorts::StandardEffect;

/// A version of a task's standard.
#[derive(Debug, Serialize, ToSchema)]
pub struct StandardResponse {
    id: StandardId,
    /// 1, 2, … within the task.
    version: i64,
    #[serde(flatten)]
    definition: StandardDefinition,
    /// Name of the person who set it; `null` for trainees, and if the person was deleted.
    who: Option<String>,
    created_at: Time,
    /// It judges the recordings that arrived from then on, until a later version does; `null`: from the beginning.
    valid_from: Option<Time>,
}

impl StandardResponse {
    /// The standard as this scope may see it.
    pub fn new(standard: store::StandardRecord, scope: &Scope) -> Self {
        let store::StandardRecord { id, version, definition, who, created_at_ms, valid_from_ms, .. } = standard;
        let who = who.filter(|_| scope.is_staff());
        let definition = if scope.is_administrator() { definition } else { definition.without_fingerprints() };
        let valid_from = (valid_from_ms > 0).then_some(Time(valid_from_ms));
        Self { id, version, definition, who, created_at: Time(created_at_ms), valid_from }
    }
}

/// A standard that is not set yet, and the trainees whose state it would change.
#[derive(Debug, Serialize, ToSchema)]
pub struct StandardProposal {
    #[serde(flatten)]
    proposal: Proposal,
    /// What it would change at once; `null` while a target has no limit.
    effect: Option<StandardEffect>,
}

/// List a task's standards, newest first
///
/// Each judges the recordings that arrived from its `valid_from` on, until a later version does.
#[utoipa::path(get, path = "/tasks/{id}/standards", tag = "tasks",
    params(("id" = String, Path, description = "id or code")),
    responses((status = OK, body = PageResponse<StandardResponse>)))]
pub async fn standards(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
) -> HandlerResult<Json<PageResponse<StandardResponse>>> {
    let of = app.store.tasks().get(&by.scope, &key).await?.id;
    let standards = app.store.standards().list(&by.scope, of).await?;
    Ok(Json(PageResponse::whole(standards.into_iter().map(|standard| StandardResponse::new(standard, &by.scope)))))
}

/// Set a task's standard
///
/// The result is the next version, unless the version in use is the same. A limit derived from cohorts is computed from
/// their present measurements, from the last five sessions of each person; only administrators may set such a limit.
/// Request a proposal first. For administrators and the instructors of the task's groups.
#[utoipa::path(post, path = "/tasks/{id}/standards", tag = "tasks",
    params(("id" = String, Path, description = "id or code")), request_body = NewStandard,
    responses((status = CREATED, body = StandardResponse)))]
pub async fn set_standard(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    Json(new): Json<NewStandard>,
) -> HandlerResult<Created<StandardResponse>> {
    let of = app.store.tasks().changeable(&by.scope, &key).await?.id;
    let start = new.valid_from;
    let definition = app.cohorts.propose(&by.scope, of, new).await?.definition()?;
    let standard = app.store.standards().add(&by.scope, of, definition, start).await?;
    Ok(Created { location: format!("/api/v1/tasks/{of}/standards"), made: StandardResponse::new(standard, &by.scope) })
}

/// Compute a standard without setting it
///
/// The answer names the trainees in the caller's scope whose state at the task would change at once.
#[utoipa::path(post, path = "/tasks/{id}/standards/proposals", tag = "tasks",
    params(("id" = String, Path, description = "id or code")), request_body = NewStandard,
    responses((status = OK, body = StandardProposal)))]
pub async fn propose_standard(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    Json(new): Json<NewStandard>,
) -> HandlerResult<Json<StandardProposal>> {
    let of = app.store.tasks().get(&by.scope, &key).await?.id;
    let start = new.valid_from;
    let proposal = app.cohorts.propose(&by.scope, of, new).await?;
    let effect = match proposal.clone().definition() {
        Ok(definition) => Some(app.cohorts.effect(&by.scope, of, definition, start).await?),
        Err(_) => None,
    };
    Ok(Json(StandardProposal { proposal, effect }))
}

/// List published limits to choose from
///
/// They are the times of the Fundamentals of Laparoscopic Surgery.
#[utoipa::path(get, path = "/tasks/{id}/standards/presets", tag = "tasks",
    params(("id" = String, Path, description = "id or code")), responses((status = OK, body = PageResponse<Preset>)))]
pub async fn presets(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
) -> HandlerResult<Json<PageResponse<Preset>>> {
    app.store.tasks().get(&by.scope, &key).await?;
    Ok(Json(PageResponse::whole(Preset::all())))
}
