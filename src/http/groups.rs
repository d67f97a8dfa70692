//! Training groups: which instructors teach which trainees. Administrators edit groups; instructors see their own.

use axum::extract::State;
use axum::http::StatusCode;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::auth::signed_in::{Administrator, Staff};
use super::courses::FollowedCourse;
use super::error::Answer;
use super::read::{At, Json, Params};
use super::show::{Created, Page, Time};
use super::state::App;
use super::tasks::{Standard, Task};
use super::trainees::Trainee;
use crate::cohorts::{Asked, GroupTable, TableFound};
use crate::domain::session::FeatureSpace;
use crate::domain::text::{Key, Name};
use crate::ids::GroupId;
use crate::store::{self, Members};

/// A training group.
#[derive(Debug, Serialize, ToSchema)]
pub struct Group {
    id: GroupId,
    name: Name,
    #[serde(flatten)]
    members: Members,
    /// The course plan that the group follows; `null`: none.
    course: Option<FollowedCourse>,
    created_at: Time,
}

impl From<store::Group> for Group {
    fn from(group: store::Group) -> Self {
        let store::Group { id, name, created_at_ms, members, follows } = group;
        Self { id, name, members, course: follows.map(FollowedCourse::from), created_at: Time(created_at_ms) }
    }
}

/// List the groups that the caller may see
#[utoipa::path(get, path = "/groups", tag = "groups", responses((status = OK, body = Page<Group>)))]
pub async fn list(State(app): State<App>, by: Staff) -> Answer<Json<Page<Group>>> {
    let groups = app.store.groups().list(&by.scope).await?;
    Ok(Json(Page::whole(groups.into_iter().map(Group::from))))
}

/// A group to create.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewGroup {
    name: Name,
}

/// Create an empty group
#[utoipa::path(post, path = "/groups", tag = "groups", request_body = NewGroup, responses((status = CREATED, body = Group)))]
pub async fn create(State(app): State<App>, by: Administrator, Json(new): Json<NewGroup>) -> Answer<Created<Group>> {
    let group = app.store.groups().create(&by.scope, new.name).await?;
    Ok(Created { location: format!("/api/v1/groups/{}", group.id), made: group.into() })
}

/// Read one group
#[utoipa::path(get, path = "/groups/{id}", tag = "groups", params(("id" = String, Path, description = "id")),
    responses((status = OK, body = Group)))]
pub async fn get(State(app): State<App>, by: Staff, at: At) -> Answer<Json<Group>> {
    let group = app.store.groups().get(&by.scope, at.id()?).await?;
    Ok(Json(group.into()))
}

/// Set all members of a group
#[utoipa::path(put, path = "/groups/{id}/members", tag = "groups", params(("id" = String, Path, description = "id")),
    request_body = Members, responses((status = OK, body = Group)))]
pub async fn set_members(
    State(app): State<App>,
    by: Administrator,
    at: At,
    Json(members): Json<Members>,
) -> Answer<Json<Group>> {
    let group = app.store.groups().set_members(&by.scope, at.id()?, members).await?;
    Ok(Json(group.into()))
}

/// Selects the progress table of a group.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct TableOf {
    /// The task, by id or code.
    #[param(value_type = String)]
    task: Key,
    /// The feature, such as `path_length`; default: the first feature with a limit in the task's standard,
    /// else the duration.
    feature: Option<String>,
    /// The tool; default: the first that has the feature.
    tool: Option<String>,
    /// The space of the feature; default: three dimensions, if the feature is measured there.
    space: Option<FeatureSpace>,
}

/// The progress of a group's trainees in a task, for one feature.
#[derive(Serialize, ToSchema)]
pub struct GroupProgress {
    group: Group,
    task: Task,
    /// The task's standard; `null`: none was set.
    standard: Option<Standard>,
    /// The group's trainees, by name.
    trainees: Vec<Trainee>,
    #[serde(flatten)]
    table: GroupTable,
}

/// Read the progress of a group's trainees in a task
///
/// The whole table in one answer. It is sorted by name, not by value, because values with overlapping error bars have
/// no order.
#[utoipa::path(get, path = "/groups/{id}/progress", tag = "groups",
    params(("id" = String, Path, description = "id"), TableOf), responses((status = OK, body = GroupProgress)))]
pub async fn progress(
    State(app): State<App>,
    by: Staff,
    at: At,
    Params(of): Params<TableOf>,
) -> Answer<Json<GroupProgress>> {
    let TableOf { task, feature, tool, space } = of;
    let asked = Asked { task: Some(task), feature, tool, space, cohort: None };
    let TableFound { group, task, standard, table, trainees } = app.cohorts.table(&by.scope, at.id()?, asked).await?;
    Ok(Json(GroupProgress {
        group: group.into(),
        task: task.into(),
        standard: standard.map(|standard| Standard::new(standard, &by.scope)),
        trainees: trainees.into_iter().map(Trainee::from).collect(),
        table,
    }))
}

/// Delete a group
///
/// Its instructors and trainees stay.
#[utoipa::path(delete, path = "/groups/{id}", tag = "groups", params(("id" = String, Path, description = "id")),
    responses((status = NO_CONTENT)))]
pub async fn delete(State(app): State<App>, by: Administrator, at: At) -> Answer<StatusCode> {
    app.store.groups().delete(&by.scope, at.id()?).await?;
    Ok(StatusCode::NO_CONTENT)
}
