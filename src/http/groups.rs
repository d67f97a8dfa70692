//! Training groups: which instructors teach which trainees. Administrators edit groups; instructors see their own, and make
//! new ones.

use axum::extract::State;
use axum::http::StatusCode;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::auth::signed_in::{Administrator, Staff};
use super::courses::FollowedCourse;
use super::error::HandlerResult;
use super::read::{Json, Params, PathKey};
use super::show::{Created, PageResponse, Time};
use super::state::App;
use super::tasks::{StandardResponse, TaskResponse};
use super::trainees::TraineeResponse;
use crate::cohorts::{GroupTable, GroupTableAnswer, ProgressSelection};
use crate::domain::hand::Hand;
use crate::domain::session::FeatureSpace;
use crate::domain::text::{Key, Name};
use crate::ids::GroupId;
use crate::store::{self, Members};

/// A training group.
#[derive(Debug, Serialize, ToSchema)]
pub struct GroupResponse {
    id: GroupId,
    name: Name,
    #[serde(flatten)]
    members: Members,
    /// The course plan that the group follows; `null`: none.
    course: Option<FollowedCourse>,
    created_at: Time,
}

impl From<store::GroupRecord> for GroupResponse {
    fn from(group: store::GroupRecord) -> Self {
        let store::GroupRecord { id, name, created_at_ms, members, follows } = group;
        Self { id, name, members, course: follows.map(FollowedCourse::from), created_at: Time(created_at_ms) }
    }
}

/// List the groups that the caller may see
#[utoipa::path(get, path = "/groups", tag = "groups", responses((status = OK, body = PageResponse<GroupResponse>)))]
pub async fn list(State(app): State<App>, by: Staff) -> HandlerResult<Json<PageResponse<GroupResponse>>> {
    let groups = app.store.groups().list(&by.scope).await?;
    Ok(Json(PageResponse::whole(groups.into_iter().map(GroupResponse::from))))
}

/// A group to create.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewGroup {
    name: Name,
}

/// Create a group
///
/// It has no trainees yet. An instructor teaches the group that they create.
#[utoipa::path(post, path = "/groups", tag = "groups", request_body = NewGroup,
    responses((status = CREATED, body = GroupResponse)))]
pub async fn create(
    State(app): State<App>,
    by: Staff,
    Json(new): Json<NewGroup>,
) -> HandlerResult<Created<GroupResponse>> {
    let group = app.store.groups().create(&by.scope, new.name).await?;
    Ok(Created { location: format!("/api/v1/groups/{}", group.id), made: group.into() })
}

/// Read one group
#[utoipa::path(get, path = "/groups/{id}", tag = "groups", params(("id" = String, Path, description = "id")),
    responses((status = OK, body = GroupResponse)))]
pub async fn get(State(app): State<App>, by: Staff, at: PathKey) -> HandlerResult<Json<GroupResponse>> {
    let group = app.store.groups().get(&by.scope, at.id()?).await?;
    Ok(Json(group.into()))
}

/// Set all members of a group
#[utoipa::path(put, path = "/groups/{id}/members", tag = "groups", params(("id" = String, Path, description = "id")),
    request_body = Members, responses((status = OK, body = GroupResponse)))]
pub async fn set_members(
    State(app): State<App>,
    by: Administrator,
    at: PathKey,
    Json(members): Json<Members>,
) -> HandlerResult<Json<GroupResponse>> {
    let group = app.store.groups().set_members(&by.scope, at.id()?, members).await?;
    Ok(Json(group.into()))
}

/// Selects the progress table of a group.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct GroupTableQuery {
    /// The task, by id or code.
    #[param(value_type = String)]
    task: Key,
    /// The feature, such as `path_length`; default: the first feature with a limit in the task's standard,
    /// else the duration.
    feature: Option<String>,
    /// The tool; default: the first that has the feature.
    tool: Option<String>,
    /// The hand that holds the tool.
    in_hand: Option<Hand>,
    /// The space of the feature; default: three dimensions, if the feature is measured there.
    space: Option<FeatureSpace>,
}

/// The progress of a group's trainees in a task, for one feature.
#[derive(Serialize, ToSchema)]
pub struct GroupProgress {
    group: GroupResponse,
    task: TaskResponse,
    /// The task's standard; `null`: none was set.
    standard: Option<StandardResponse>,
    /// The group's trainees, by name.
    trainees: Vec<TraineeResponse>,
    #[serde(flatten)]
    table: GroupTable,
}

/// Read the progress of a group's trainees in a task
///
/// The whole table in one answer. It is sorted by name, not by value, because values with overlapping error bars have
/// no order.
#[utoipa::path(get, path = "/groups/{id}/progress", tag = "groups",
    params(("id" = String, Path, description = "id"), GroupTableQuery), responses((status = OK, body = GroupProgress)))]
pub async fn progress(
    State(app): State<App>,
    by: Staff,
    at: PathKey,
    Params(of): Params<GroupTableQuery>,
) -> HandlerResult<Json<GroupProgress>> {
    let GroupTableQuery { task, feature, tool, in_hand, space } = of;
    let asked = ProgressSelection { task: Some(task), feature, tool, in_hand, space, cohort: None };
    let GroupTableAnswer { group, task, standard, table, trainees } =
        app.cohorts.group_table(&by.scope, at.id()?, asked).await?;
    Ok(Json(GroupProgress {
        group: group.into(),
        task: TaskResponse::new(task, &by.scope),
        standard: standard.map(|standard| StandardResponse::new(standard, &by.scope)),
        trainees: trainees.into_iter().map(|trainee| TraineeResponse::new(trainee, &by.scope)).collect(),
        table,
    }))
}

/// Delete a group
///
/// Its instructors and trainees stay.
#[utoipa::path(delete, path = "/groups/{id}", tag = "groups", params(("id" = String, Path, description = "id")),
    responses((status = NO_CONTENT)))]
pub async fn delete(State(app): State<App>, by: Administrator, at: PathKey) -> HandlerResult<StatusCode> {
    app.store.groups().delete(&by.scope, at.id()?).await?;
    Ok(StatusCode::NO_CONTENT)
}
