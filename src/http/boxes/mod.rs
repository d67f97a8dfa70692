//! Box trainers, their camera calibrations, tool colours and self-tests.

pub(super) mod agent;
mod agent_connection;
mod calibrations;
mod check_in;
mod form;
mod merges;
mod palette;
mod previews;
mod self_tests;
mod valid_from;

pub use agent::*;
pub use agent_connection::*;
use axum::extract::State;
use axum::http::StatusCode;
pub use calibrations::*;
pub use check_in::*;
pub use merges::*;
pub use palette::*;
pub use previews::*;
pub use self_tests::*;
use serde::Serialize;
use utoipa::ToSchema;
pub use valid_from::*;

use super::auth::signed_in::{Member, Staff};
use super::error::HandlerResult;
use super::read::{Json, Params, PathKey, owners_problem};
use super::show::{Created, PageResponse, Paging, Time};
use super::state::App;
use crate::domain::box_agent::self_test_need::SelfTestReason;
use crate::domain::boxes::{BoxChange, BoxTool, NewBox};
use crate::domain::files::annotations::View;
use crate::domain::scope::Scope;
use crate::domain::text::{Code, Name, Paragraphs};
use crate::domain::token_expiry::expires_soon;
use crate::ids::{BoxId, GroupId};
use crate::store;

/// A box trainer and its setup: camera, colours, self-test.
#[derive(Debug, Serialize, ToSchema)]
pub struct BoxResponse {
    id: BoxId,
    code: Code,
    name: Name,
    /// Where the camera is placed.
    view: Option<View>,
    notes: Paragraphs,
    created_at: Time,
    /// The camera calibration in use; `null`: none, and recordings wait until there is one.
    calibration: Option<CalibrationResponse>,
    /// Version of the colours in use; `null`: none, and recordings wait until there are some.
    palette: Option<i64>,
    /// The tools whose colours were learned.
    tools: Vec<BoxTool>,
    /// The traffic light of today's last self-test; `null`: no self-test today.
    self_test: Option<TodaysLight>,
    /// When the token of the box's agent expires, or expired; `null` if that is not within 30 days. It is the token that
    /// was used last.
    agent_token_expires_at: Option<Time>,
    /// The agent that stands by at the box.
    agent: BoxAgentResponse,
    /// Why the box needs a self-test before the next exam; empty: it needs none.
    self_test_reasons: Vec<SelfTestReason>,
    /// The groups whose instructors may change it, those that the caller sees: an administrator all, an instructor the
    /// own ones.
    groups: Vec<GroupId>,
    /// True if the caller may change it.
    may_change: bool,
}

impl App {
    /// A box with its calibration, colours and self-test of today.
    pub(in crate::http) async fn box_response(
        &self,
        scope: &Scope,
        found: store::BoxRecord,
    ) -> HandlerResult<BoxResponse> {
        let calibration = self.store.calibrations().in_use(scope, found.id).await?;
        let calibration = calibration.map(|found| CalibrationResponse::new(found, true));
        let palette = self.store.palettes().in_use(scope, found.id).await?;
        let agent_expiry = self.store.tokens().agent_expiry(found.id).await?;
        let known = self.known_agents(scope).await?;
        let agent = self.box_agent_response(scope, found.id, known.get(&found.id)).await?;
        let self_test_reasons = self.self_test_reasons(scope, found.id).await?;
        Ok(BoxResponse {
            agent,
            self_test_reasons,
            agent_token_expires_at: expires_soon(agent_expiry, self.clock.now_ms()).map(Time),
            id: found.id,
            code: found.code,
            name: found.name,
            view: found.view,
            notes: found.notes,
            created_at: Time(found.created_at_ms),
            calibration,
            palette: palette.as_ref().map(|palette| palette.version),
            self_test: self.light_of_today(scope, found.id).await?,
            tools: palette.map(|palette| palette.tools).unwrap_or_default(),
            may_change: scope.may_change(&found.owners),
            groups: found.owners,
        })
    }
}

/// List the boxes
#[utoipa::path(get, path = "/boxes", tag = "boxes", params(Paging),
    responses((status = OK, body = PageResponse<BoxResponse>)))]
pub async fn list(
    State(app): State<App>,
    by: Member,
    Params(paging): Params<Paging>,
) -> HandlerResult<Json<PageResponse<BoxResponse>>> {
    let page = paging.request("boxes", app.settings.page_items)?;
    let store::Page { items, next } = app.store.boxes().list(&by.scope, &page).await?;
    let mut shown = Vec::with_capacity(items.len());
    for found in items {
        shown.push(app.box_response(&by.scope, found).await?);
    }
    Ok(Json(PageResponse::of(store::Page { items: shown, next }, |item| item)))
}

/// Register a box
///
/// An instructor's box belongs to the instructor's groups, unless `groups` names some of them. An administrator's box
/// belongs to the named groups; without any, only administrators may change it.
#[utoipa::path(post, path = "/boxes", tag = "boxes", request_body = NewBox,
    responses((status = CREATED, body = BoxResponse)))]
pub async fn create(State(app): State<App>, by: Staff, Json(new): Json<NewBox>) -> HandlerResult<Created<BoxResponse>> {
    let made = app.store.boxes().create(&by.scope, new).await.map_err(owners_problem)?;
    let location = format!("/api/v1/boxes/{}", made.id);
    Ok(Created { location, made: app.box_response(&by.scope, made).await? })
}

/// Read one box
#[utoipa::path(get, path = "/boxes/{id}", tag = "boxes", params(("id" = String, Path, description = "id or code")),
    responses((status = OK, body = BoxResponse)))]
pub async fn get(State(app): State<App>, by: Member, PathKey(key): PathKey) -> HandlerResult<Json<BoxResponse>> {
    let found = app.store.boxes().get(&by.scope, &key).await?;
    Ok(Json(app.box_response(&by.scope, found).await?))
}

/// Change a box
///
/// For administrators and the instructors of its groups.
#[utoipa::path(patch, path = "/boxes/{id}", tag = "boxes", params(("id" = String, Path, description = "id or code")),
    request_body = BoxChange, responses((status = OK, body = BoxResponse)))]
pub async fn change(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    Json(change): Json<BoxChange>,
) -> HandlerResult<Json<BoxResponse>> {
    let changed = app.store.boxes().change(&by.scope, &key, change).await.map_err(owners_problem)?;
    Ok(Json(app.box_response(&by.scope, changed).await?))
}

/// Delete a box that has no sessions
///
/// For administrators and the instructors of its groups.
#[utoipa::path(delete, path = "/boxes/{id}", tag = "boxes", params(("id" = String, Path, description = "id or code")),
    responses((status = NO_CONTENT)))]
pub async fn delete(State(app): State<App>, by: Staff, PathKey(key): PathKey) -> HandlerResult<StatusCode> {
    app.store.boxes().delete(&by.scope, &key).await?;
    Ok(StatusCode::NO_CONTENT)
}
