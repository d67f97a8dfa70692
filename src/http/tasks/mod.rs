//! Tasks: the exercises that trainees do. Every member may read them; administrators and the instructors of
//! their groups may change them.

mod distribution;
mod errors;
mod features;
mod models;
mod raters;
mod standards;

use axum::extract::State;
use axum::http::StatusCode;
pub use distribution::*;
pub use errors::*;
pub use features::*;
pub use models::*;
pub use raters::*;
use serde::Serialize;
pub use standards::*;
use utoipa::ToSchema;

use crate::domain::rating::RatingForm;
use crate::domain::scope::Scope;
use crate::domain::task::{NewTask, TaskChange};
use crate::domain::text::{Code, Name, Paragraphs};
use crate::http::auth::signed_in::{Member, Staff};
use crate::http::error::HandlerResult;
use crate::http::read::{Json, Params, PathKey, owners_problem};
use crate::http::show::{Created, PageResponse, Paging, Time};
use crate::http::state::App;
use crate::ids::{GroupId, TaskId};
use crate::store;

/// A task: an exercise in the box.
#[derive(Debug, Serialize, ToSchema)]
pub struct TaskResponse {
    id: TaskId,
    code: Code,
    name: Name,
    description: Paragraphs,
    /// The forms that its sessions are rated on.
    rating_forms: Vec<RatingForm>,
    created_at: Time,
    /// The groups whose instructors may change it, those that the caller sees: an administrator all, an instructor the
    /// own ones.
    groups: Vec<GroupId>,
    /// True if the caller may change it.
    may_change: bool,
}

impl TaskResponse {
    /// The task as this scope may see and change it.
    pub fn new(task: store::TaskRecord, scope: &Scope) -> Self {
        let store::TaskRecord { id, code, name, description, rating_forms, created_at_ms, owners } = task;
        let may_change = scope.may_change(&owners);
        let rating_forms = rating_forms.unwrap_or_else(|| RatingForm::ALL.to_vec());
        let created_at = Time(created_at_ms);
        Self { id, code, name, description, rating_forms, created_at, groups: owners, may_change }
    }
}

/// List the tasks
#[utoipa::path(get, path = "/tasks", tag = "tasks", params(Paging),
    responses((status = OK, body = PageResponse<TaskResponse>)))]
pub async fn list(
    State(app): State<App>,
    by: Member,
    Params(paging): Params<Paging>,
) -> HandlerResult<Json<PageResponse<TaskResponse>>> {
    let page = paging.request("tasks", app.settings.page_items)?;
    let tasks = app.store.tasks().list(&by.scope, &page).await?;
    Ok(Json(PageResponse::of(tasks, |task| TaskResponse::new(task, &by.scope))))
}

/// Register a task
///
/// An instructor's task belongs to the instructor's groups, unless `groups` names some of them. An administrator's task
/// belongs to the named groups; without any, only administrators may change it.
#[utoipa::path(post, path = "/tasks", tag = "tasks", request_body = NewTask,
    responses((status = CREATED, body = TaskResponse)))]
pub async fn create(
    State(app): State<App>,
    by: Staff,
    Json(new): Json<NewTask>,
) -> HandlerResult<Created<TaskResponse>> {
    let task = app.store.tasks().create(&by.scope, new).await.map_err(owners_problem)?;
    Ok(Created { location: format!("/api/v1/tasks/{}", task.id), made: TaskResponse::new(task, &by.scope) })
}

/// Read one task
#[utoipa::path(get, path = "/tasks/{id}", tag = "tasks", params(("id" = String, Path, description = "id or code")),
    responses((status = OK, body = TaskResponse)))]
pub async fn get(State(app): State<App>, by: Member, PathKey(key): PathKey) -> HandlerResult<Json<TaskResponse>> {
    let task = app.store.tasks().get(&by.scope, &key).await?;
    Ok(Json(TaskResponse::new(task, &by.scope)))
}

/// Change a task
///
/// For administrators and the instructors of its groups.
#[utoipa::path(patch, path = "/tasks/{id}", tag = "tasks", params(("id" = String, Path, description = "id or code")),
    request_body = TaskChange, responses((status = OK, body = TaskResponse)))]
pub async fn change(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    Json(change): Json<TaskChange>,
) -> HandlerResult<Json<TaskResponse>> {
    let task = app.store.tasks().change(&by.scope, &key, change).await.map_err(owners_problem)?;
    Ok(Json(TaskResponse::new(task, &by.scope)))
}

/// Delete a task that has no sessions and is in no course plan
///
/// For administrators and the instructors of its groups.
#[utoipa::path(delete, path = "/tasks/{id}", tag = "tasks", params(("id" = String, Path, description = "id or code")),
    responses((status = NO_CONTENT)))]
pub async fn delete(State(app): State<App>, by: Staff, PathKey(key): PathKey) -> HandlerResult<StatusCode> {
    app.store.tasks().delete(&by.scope, &key).await?;
    Ok(StatusCode::NO_CONTENT)
}
