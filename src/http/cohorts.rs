//! Reference groups (cohorts). Administrators edit them; every member may read them and their sizes. The list of
//! members is limited to trainees in the caller's scope.

use axum::extract::State;
use axum::http::StatusCode;
use serde::Serialize;
use utoipa::ToSchema;

use super::auth::signed_in::{Administrator, Member};
use super::error::{Answer, Problem, unknown};
use super::read::{At, Json, Params};
use super::show::{Created, Page, Paging, Time};
use super::state::App;
use crate::domain::cohort::NewCohort;
use crate::domain::text::{Code, Name};
use crate::domain::trainee::{Handedness, Level};
use crate::ids::{CohortId, GroupId, TraineeId};
use crate::store::{self, StoreError};

/// A reference group: a list of people, or all people of a level, hand or training group.
#[derive(Debug, Serialize, ToSchema)]
pub struct Cohort {
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

impl From<store::Cohort> for Cohort {
    fn from(cohort: store::Cohort) -> Self {
        let store::Cohort { id, code, name, is_list, level, handedness, group_id, people, created_at_ms } = cohort;
        let created_at = Time(created_at_ms);
        Self { id, code, name, listed: is_list, level, handedness, group: group_id, people, created_at }
    }
}

/// List the cohorts, by code
#[utoipa::path(get, path = "/cohorts", tag = "cohorts", params(Paging), responses((status = OK, body = Page<Cohort>)))]
pub async fn list(State(app): State<App>, by: Member, Params(paging): Params<Paging>) -> Answer<Json<Page<Cohort>>> {
    let cohorts = app.store.cohorts().list(&by.scope, &paging.request(app.settings.page_items)?).await?;
    Ok(Json(Page::of(cohorts, Cohort::from)))
}

/// Create a cohort
#[utoipa::path(post, path = "/cohorts", tag = "cohorts", request_body = NewCohort,
    responses((status = CREATED, body = Cohort)))]
pub async fn create(State(app): State<App>, by: Administrator, Json(new): Json<NewCohort>) -> Answer<Created<Cohort>> {
    let cohort = app.store.cohorts().create(&by.scope, new.checked()?).await.map_err(mistaken)?;
    Ok(Created { location: format!("/api/v1/cohorts/{}", cohort.id), made: cohort.into() })
}

/// Read one cohort
#[utoipa::path(get, path = "/cohorts/{id}", tag = "cohorts", params(("id" = String, Path, description = "id or code")),
    responses((status = OK, body = Cohort)))]
pub async fn get(State(app): State<App>, by: Member, At(key): At) -> Answer<Json<Cohort>> {
    Ok(Json(app.store.cohorts().get(&by.scope, &key).await?.into()))
}

/// List the members of a cohort that the caller may see
///
/// The cohort's `people` counts all members.
#[utoipa::path(get, path = "/cohorts/{id}/members", tag = "cohorts",
    params(("id" = String, Path, description = "id or code"), Paging), responses((status = OK, body = Page<TraineeId>)))]
pub async fn members(
    State(app): State<App>,
    by: Member,
    At(key): At,
    Params(paging): Params<Paging>,
) -> Answer<Json<Page<TraineeId>>> {
    let page = paging.request(app.settings.page_items)?;
    let members = app.store.cohorts().members(&by.scope, &key, &page).await?;
    Ok(Json(Page::of(members, |id| id)))
}

/// Replace a cohort: its name and its people
#[utoipa::path(put, path = "/cohorts/{id}", tag = "cohorts", params(("id" = String, Path, description = "id or code")),
    request_body = NewCohort, responses((status = OK, body = Cohort)))]
pub async fn replace(
    State(app): State<App>,
    by: Administrator,
    At(key): At,
    Json(new): Json<NewCohort>,
) -> Answer<Json<Cohort>> {
    let id = app.store.cohorts().get(&by.scope, &key).await?.id;
    let replaced = app.store.cohorts().replace(&by.scope, id, new.checked()?).await;
    Ok(Json(replaced.map_err(mistaken)?.into()))
}

/// Delete a cohort
///
/// Its people stay, and so do the standards that were set from it.
#[utoipa::path(delete, path = "/cohorts/{id}", tag = "cohorts", params(("id" = String, Path, description = "id or code")),
    responses((status = NO_CONTENT)))]
pub async fn delete(State(app): State<App>, by: Administrator, At(key): At) -> Answer<StatusCode> {
    app.store.cohorts().delete(&by.scope, &key).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Reports a missing group or trainee as a mistake in the body (422), not in the address (404).
fn mistaken(error: StoreError) -> Problem {
    match error {
        StoreError::NotFound { what } => unknown(what, what),
        other => other.into(),
    }
}
