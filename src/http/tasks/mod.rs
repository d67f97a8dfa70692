//! Tasks: the exercises that trainees do. Every member may read them; staff may edit them.

mod distribution;
mod features;
mod models;
mod raters;
mod standards;

use axum::extract::State;
use axum::http::StatusCode;
pub use distribution::*;
pub use features::*;
pub use models::*;
pub use raters::*;
use serde::Serialize;
pub use standards::*;
use utoipa::ToSchema;

use crate::domain::task::{NewTask, TaskChange};
use crate::domain::text::{Code, Name, Paragraphs};
use crate::http::auth::signed_in::{Member, Staff};
use crate::http::error::HandlerResult;
use crate::http::read::{Json, Params, PathKey};
use crate::http::show::{Created, PageResponse, Paging, Time};
use crate::http::state::App;
use crate::ids::TaskId;
use crate::store;

/// A task: an exercise in the box.
#[derive(Debug, Serialize, ToSchema)]
pub struct TaskResponse {
    id: TaskId,
    code: Code,
    name: Name,
    description: Paragraphs,
    created_at: Time,
}

impl From<store::TaskRecord> for TaskResponse {
    fn from(task: store::TaskRecord) -> Self {
        let store::TaskRecord { id, code, name, description, created_at_ms } = task;
        Self { id, code, name, description, created_at: Time(created_at_ms) }
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
    let page = paging.request(app.settings.page_items)?;
    let tasks = app.store.tasks().list(&by.scope, &page).await?;
    Ok(Json(PageResponse::of(tasks, TaskResponse::from)))
}

/// Register a task
#[utoipa::path(post, path = "/tasks", tag = "tasks", request_body = NewTask,
    responses((status = CREATED, body = TaskResponse)))]
pub async fn create(
    State(app): State<App>,
    by: Staff,
    Json(new): Json<NewTask>,
) -> HandlerResult<Created<TaskResponse>> {
    let task = app.store.tasks().create(&by.scope, new).await?;
    Ok(Created { location: format!("/api/v1/tasks/{}", task.id), made: task.into() })
}

/// Read one task
#[utoipa::path(get, path = "/tasks/{id}", tag = "tasks", params(("id" = String, Path, description = "id or code")),
    responses((status = OK, body = TaskResponse)))]
pub async fn get(State(app): State<App>, by: Member, PathKey(key): PathKey) -> HandlerResult<Json<TaskResponse>> {
    let task = app.store.tasks().get(&by.scope, &key).await?;
    Ok(Json(task.into()))
}

/// Change a task
#[utoipa::path(patch, path = "/tasks/{id}", tag = "tasks", params(("id" = String, Path, description = "id or code")),
    request_body = TaskChange, responses((status = OK, body = TaskResponse)))]
pub async fn change(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    Json(change): Json<TaskChange>,
) -> HandlerResult<Json<TaskResponse>> {
    let task = app.store.tasks().change(&by.scope, &key, change).await?;
    Ok(Json(task.into()))
}

/// Delete a task that has no sessions and is in no course plan
#[utoipa::path(delete, path = "/tasks/{id}", tag = "tasks", params(("id" = String, Path, description = "id or code")),
    responses((status = NO_CONTENT)))]
pub async fn delete(State(app): State<App>, by: Staff, PathKey(key): PathKey) -> HandlerResult<StatusCode> {
    app.store.tasks().delete(&by.scope, &key).await?;
    Ok(StatusCode::NO_CONTENT)
}
