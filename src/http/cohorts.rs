//! Reference groups (cohorts). Administrators edit them; every member may read them and their sizes. The list of
//! members is limited to trainees in the caller's scope.

use axum::extract::State;
use axum::http::StatusCode;
use serde::Serialize;
use utoipa::ToSchema;

use super::auth::signed_in::{Administrator, Member};
use super::error::{HandlerResult, ProblemResponse, unknown_reference};
use super::read::{Json, Params, PathKey};
use super::show::{Created, PageResponse, Paging, Time};
use super::state::App;
use crate::domain::cohort::NewCohort;
use crate::domain::text::{Code, Key, Name};
use crate::domain::trainee::{Handedness, Level};
use crate::ids::{CohortId, GroupId, TraineeId};
use crate::store::{self, StoreError};

/// A reference group: a list of people, or all people of a level, hand or training group.
#[derive(Debug, Serialize, ToSchema)]
pub struct CohortResponse {
    id: CohortId,
    code: Code,
    name: Name,
    /// True if its people are listed; false if it contains all people who match `level`, `handedness` and `group`.
    listed: bool,
    level: Option<Level>,
    handedness: Option<Handedness>,
    group: Option<GroupId>,
    /// Number of people in it, including those without sessions.
    people: i64,
    created_at: Time,
}

impl From<store::CohortRecord> for CohortResponse {
    fn from(cohort: store::CohortRecord) -> Self {
        let store::CohortRecord { id, code, name, is_list, level, handedness, group_id, people, created_at_ms } =
            cohort;
        let created_at = Time(created_at_ms);
        Self { id, code, name, listed: is_list, level, handedness, group: group_id, people, created_at }
    }
}

/// List the cohorts, by code
#[utoipa::path(get, path = "/cohorts", tag = "cohorts", params(Paging),
    responses((status = OK, body = PageResponse<CohortResponse>)))]
pub async fn list(
    State(app): State<App>,
    by: Member,
    Params(paging): Params<Paging>,
) -> HandlerResult<Json<PageResponse<CohortResponse>>> {
    let page = paging.request("cohorts", app.settings.page_items)?;
    let cohorts = app.store.cohorts().list(&by.scope, &page).await?;
    Ok(Json(PageResponse::of(cohorts, CohortResponse::from)))
}

/// Create a cohort
#[utoipa::path(post, path = "/cohorts", tag = "cohorts", request_body = NewCohort,
    responses((status = CREATED, body = CohortResponse)))]
pub async fn create(
    State(app): State<App>,
    by: Administrator,
    Json(new): Json<NewCohort>,
) -> HandlerResult<Created<CohortResponse>> {
    let cohort = app.store.cohorts().create(&by.scope, new.checked()?).await.map_err(reference_error)?;
    Ok(Created { location: format!("/api/v1/cohorts/{}", cohort.id), made: cohort.into() })
}

/// Read one cohort
#[utoipa::path(get, path = "/cohorts/{id}", tag = "cohorts", params(("id" = String, Path, description = "id or code")),
    responses((status = OK, body = CohortResponse)))]
pub async fn get(State(app): State<App>, by: Member, PathKey(key): PathKey) -> HandlerResult<Json<CohortResponse>> {
    Ok(Json(app.store.cohorts().get(&by.scope, &key).await?.into()))
}

/// List the members of a cohort that the caller may see
///
/// The cohort's `people` counts all members.
#[utoipa::path(get, path = "/cohorts/{id}/members", tag = "cohorts",
    params(("id" = String, Path, description = "id or code"), Paging),
    responses((status = OK, body = PageResponse<TraineeId>)))]
pub async fn members(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
    Params(paging): Params<Paging>,
) -> HandlerResult<Json<PageResponse<TraineeId>>> {
    let id = app.store.cohorts().get(&by.scope, &key).await?.id;
    let page = paging.request(format!("cohort-members/{id}"), app.settings.page_items)?;
    let members = app.store.cohorts().members(&by.scope, &Key::from(&id), &page).await?;
    Ok(Json(PageResponse::of(members, |id| id)))
}

/// Replace a cohort: its name and its people
#[utoipa::path(put, path = "/cohorts/{id}", tag = "cohorts", params(("id" = String, Path, description = "id or code")),
    request_body = NewCohort, responses((status = OK, body = CohortResponse)))]
pub async fn replace(
    State(app): State<App>,
    by: Administrator,
    PathKey(key): PathKey,
    Json(new): Json<NewCohort>,
) -> HandlerResult<Json<CohortResponse>> {
    let id = app.store.cohorts().get(&by.scope, &key).await?.id;
    let replaced = app.store.cohorts().replace(&by.scope, id, new.checked()?).await;
    Ok(Json(replaced.map_err(reference_error)?.into()))
}

/// Delete a cohort
///
/// Its people stay, and so do the standards that were set from it.
#[utoipa::path(delete, path = "/cohorts/{id}", tag = "cohorts",
    params(("id" = String, Path, description = "id or code")),
    responses((status = NO_CONTENT)))]
pub async fn delete(State(app): State<App>, by: Administrator, PathKey(key): PathKey) -> HandlerResult<StatusCode> {
    app.store.cohorts().delete(&by.scope, &key).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Reports a missing group or trainee as a mistake in the body (422), not in the address (404).
fn reference_error(error: StoreError) -> ProblemResponse {
    match error {
        StoreError::NotFound { what } => unknown_reference(what, what),
        other => other.into(),
    }
}
