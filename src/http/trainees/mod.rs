//! Trainees. A caller sees the trainees in the own scope; staff register, change and erase trainees.

mod access;
mod consent;
mod enrol;
mod erasures;
mod invitations;
mod merges;
mod progress;
mod retention;
mod xapi;

use std::collections::HashMap;

pub use access::*;
use axum::extract::State;
use axum::http::StatusCode;
pub use consent::*;
pub use enrol::*;
pub use erasures::*;
pub use invitations::*;
pub use merges::*;
pub use progress::*;
pub use retention::*;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
pub use xapi::*;

use super::auth::signed_in::{Member, Staff};
use super::error::HandlerResult;
use super::read::{Json, Params, PathKey};
use super::show::{Created, PageResponse, Paging, Time};
use super::state::App;
use crate::domain::consent::ConsentState;
use crate::domain::scope::Scope;
use crate::domain::text::{Code, Name};
use crate::domain::trainee::{Handedness, Level, NewTrainee, TraineeChange};
use crate::ids::TraineeId;
use crate::store;

/// A trainee.
#[derive(Debug, Serialize, ToSchema)]
pub struct TraineeResponse {
    id: TraineeId,
    code: Code,
    name: Name,
    level: Option<Level>,
    handedness: Option<Handedness>,
    created_at: Time,
    /// True if the caller may erase the trainee. Only an administrator erases one who is in several groups.
    may_erase: bool,
    /// Whether the trainee consents to recordings; `null` in lists of groups, courses, enrolments and in progress.
    consent: Option<ConsentState>,
}

impl TraineeResponse {
    /// The trainee as this scope may see and erase them.
    pub fn new(trainee: store::TraineeRecord, scope: &Scope) -> Self {
        let store::TraineeRecord { id, code, name, level, handedness, created_at_ms, is_in_several_groups } = trainee;
        let may_erase = scope.may_erase_trainee(is_in_several_groups);
        Self { id, code, name, level, handedness, created_at: Time(created_at_ms), may_erase, consent: None }
    }

    /// The same with what is known of their consent.
    fn with_consent(self, states: &HashMap<TraineeId, ConsentState>) -> Self {
        Self { consent: states.get(&self.id).copied(), ..self }
    }
}

/// List the trainees that the caller may see
#[utoipa::path(get, path = "/trainees", tag = "trainees", params(Paging),
    responses((status = OK, body = PageResponse<TraineeResponse>)))]
pub async fn list(
    State(app): State<App>,
    by: Member,
    Params(paging): Params<Paging>,
) -> HandlerResult<Json<PageResponse<TraineeResponse>>> {
    let page = paging.request("trainees", app.settings.page_items)?;
    let trainees = app.store.trainees().list(&by.scope, &page).await?;
    let ids: Vec<TraineeId> = trainees.items.iter().map(|trainee| trainee.id).collect();
    let states = app.store.consents().states(&by.scope, &ids).await?;
    Ok(Json(PageResponse::of(trainees, |trainee| TraineeResponse::new(trainee, &by.scope).with_consent(&states))))
}

/// Register a trainee
#[utoipa::path(post, path = "/trainees", tag = "trainees", request_body = NewTrainee,
    responses((status = CREATED, body = TraineeResponse)))]
pub async fn create(
    State(app): State<App>,
    by: Staff,
    Json(new): Json<NewTrainee>,
) -> HandlerResult<Created<TraineeResponse>> {
    let trainee = app.store.trainees().create(&by.scope, new).await?;
    let location = format!("/api/v1/trainees/{}", trainee.id);
    Ok(Created { location, made: with_consent(&app, &by.scope, trainee).await? })
}

/// Read one trainee
#[utoipa::path(get, path = "/trainees/{id}", tag = "trainees",
    params(("id" = String, Path, description = "id or code")), responses((status = OK, body = TraineeResponse)))]
pub async fn get(State(app): State<App>, by: Member, PathKey(key): PathKey) -> HandlerResult<Json<TraineeResponse>> {
    let trainee = app.store.trainees().get(&by.scope, &key).await?;
    Ok(Json(with_consent(&app, &by.scope, trainee).await?))
}

/// The trainee with what is known of their consent.
async fn with_consent(app: &App, scope: &Scope, trainee: store::TraineeRecord) -> HandlerResult<TraineeResponse> {
    let states = app.store.consents().states(scope, &[trainee.id]).await?;
    Ok(TraineeResponse::new(trainee, scope).with_consent(&states))
}

/// Change a trainee
#[utoipa::path(patch, path = "/trainees/{id}", tag = "trainees",
    params(("id" = String, Path, description = "id or code")), request_body = TraineeChange,
    responses((status = OK, body = TraineeResponse)))]
pub async fn change(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    Json(change): Json<TraineeChange>,
) -> HandlerResult<Json<TraineeResponse>> {
    let trainee = app.store.trainees().change(&by.scope, &key, change).await?;
    Ok(Json(with_consent(&app, &by.scope, trainee).await?))
}

/// How a trainee is erased.
#[derive(Clone, Copy, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct EraseQuery {
    /// `true`: the trainee is hidden and signed out at once and erased after the days of the setting
    /// `retention.erase_days`. Until then `POST trainees/{id}/restore` takes the erasure back. `false`: erased at once,
    /// also if the trainee waits for an erasure.
    #[serde(default)]
    can_be_taken_back: bool,
}

/// Erase a trainee, with account, recordings and results
///
/// At once, or so that it can be taken back for some days. The files are deleted from the disk within a minute after the
/// erasure, and a restored backup does not bring them back. Only an administrator erases a trainee who is in several
/// groups.
#[utoipa::path(delete, path = "/trainees/{id}", tag = "trainees",
    params(("id" = String, Path, description = "id or code"), EraseQuery), responses((status = NO_CONTENT)))]
pub async fn erase(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    Params(how): Params<EraseQuery>,
) -> HandlerResult<StatusCode> {
    match app.retention.erase_after().filter(|_| how.can_be_taken_back) {
        Some(after) => app.store.pending_erasures().request(&by.scope, &key, after).await?,
        None => app.store.trainees().erase(&by.scope, &key).await?,
    }
    app.end_invalid_check_ins_and_waits().await;
    Ok(StatusCode::NO_CONTENT)
}
