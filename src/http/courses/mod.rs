//! Course plans, and the progress of trainees in a course. Every member may read plans; administrators and
//! the instructors of a plan's groups may change it. Progress is limited to trainees in the caller's scope.
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | plans: list, create, read, replace, delete |
//! | `group.rs` | the plan that a group follows, and the progress of its trainees |
//! | `own.rs` | one trainee's courses |

mod group;
mod own;

use axum::extract::State;
use axum::http::StatusCode;
pub use group::*;
pub use own::*;
use serde::Serialize;
use utoipa::ToSchema;

use super::auth::signed_in::{Member, Staff};
use super::error::{HandlerResult, ProblemResponse, unknown_reference};
use super::read::{Json, Params, PathKey, owners_problem};
use super::show::{Created, NamedReference, PageResponse, Paging, Time};
use super::state::App;
use crate::domain::course::NewCourse;
use crate::domain::scope::Scope;
use crate::domain::text::Name;
use crate::ids::{CourseId, GroupId};
use crate::store::{self, StoreError};
use crate::time::Day;

/// A course plan.
#[derive(Debug, Serialize, ToSchema)]
pub struct CoursePlan {
    id: CourseId,
    name: Name,
    /// Its steps, in order.
    steps: Vec<PlanStep>,
    created_at: Time,
    /// The groups whose instructors may change it, those that the caller sees: an administrator all, an instructor the
    /// own ones.
    groups: Vec<GroupId>,
    /// True if the caller may change it.
    may_change: bool,
}

/// A step of a plan.
#[derive(Debug, Serialize, ToSchema)]
pub struct PlanStep {
    task: NamedReference,
    /// Days from the course's first day until the step is due; 0: due on the first day, `null`: no due date.
    within_days: Option<u32>,
    /// Number of sessions that the step requires since the course began; `null`: it requires a pass of
    /// the task's standard.
    sessions: Option<u32>,
}

/// A step of a plan that a group follows.
#[derive(Debug, Serialize, ToSchema)]
pub struct DueStep {
    #[serde(flatten)]
    step: PlanStep,
    /// The last day on which it is in time; `null`: no due date.
    due: Option<Day>,
}

impl CoursePlan {
    /// The plan as this scope may see and change it.
    pub fn new(course: store::CourseRecord, scope: &Scope) -> Self {
        let store::CourseRecord { id, name, steps, created_at_ms, owners } = course;
        let steps = steps.into_iter().map(PlanStep::from).collect();
        let may_change = scope.may_change(&owners);
        Self { id, name, steps, created_at: Time(created_at_ms), groups: owners, may_change }
    }
}

impl From<store::CourseStep> for PlanStep {
    fn from(step: store::CourseStep) -> Self {
        let store::CourseStep { task_id, task_code, task_name, within_days, sessions } = step;
        let task = NamedReference { id: task_id.to_string(), name: task_name.to_string(), code: task_code.to_string() };
        Self { task, within_days, sessions }
    }
}

impl DueStep {
    /// The step with its due date in a course that begins on this day.
    fn new(step: store::CourseStep, begins: Day) -> Self {
        Self { due: step.due(begins), step: step.into() }
    }
}

/// List the course plans, by name
#[utoipa::path(get, path = "/courses", tag = "courses", params(Paging),
    responses((status = OK, body = PageResponse<CoursePlan>)))]
pub async fn list(
    State(app): State<App>,
    by: Member,
    Params(paging): Params<Paging>,
) -> HandlerResult<Json<PageResponse<CoursePlan>>> {
    let page = paging.request("courses", app.settings.page_items)?;
    let courses = app.store.courses().list(&by.scope, &page).await?;
    Ok(Json(PageResponse::of(courses, |course| CoursePlan::new(course, &by.scope))))
}

/// Create a course plan
///
/// A step without `sessions` requires a pass of its task's standard, so the task must have a standard.
#[utoipa::path(post, path = "/courses", tag = "courses", request_body = NewCourse,
    responses((status = CREATED, body = CoursePlan)))]
pub async fn create(
    State(app): State<App>,
    by: Staff,
    Json(new): Json<NewCourse>,
) -> HandlerResult<Created<CoursePlan>> {
    let course = app.store.courses().create(&by.scope, new.checked()?).await.map_err(reference_error)?;
    Ok(Created { location: format!("/api/v1/courses/{}", course.id), made: CoursePlan::new(course, &by.scope) })
}

/// Read one course plan
#[utoipa::path(get, path = "/courses/{id}", tag = "courses", params(("id" = String, Path, description = "id")),
    responses((status = OK, body = CoursePlan)))]
pub async fn get(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<Json<CoursePlan>> {
    let course = app.store.courses().get(&by.scope, at.id()?).await?;
    Ok(Json(CoursePlan::new(course, &by.scope)))
}

/// Replace a course plan: its name and its steps
///
/// The change applies to all groups that follow the plan. For administrators and the instructors of its groups.
#[utoipa::path(put, path = "/courses/{id}", tag = "courses", params(("id" = String, Path, description = "id")),
    request_body = NewCourse, responses((status = OK, body = CoursePlan)))]
pub async fn replace(
    State(app): State<App>,
    by: Staff,
    at: PathKey,
    Json(new): Json<NewCourse>,
) -> HandlerResult<Json<CoursePlan>> {
    let id = app.store.courses().changeable(&by.scope, at.id()?).await?.id;
    let replaced = app.store.courses().replace(&by.scope, id, new.checked()?).await;
    Ok(Json(CoursePlan::new(replaced.map_err(reference_error)?, &by.scope)))
}

/// Delete a course plan that no group follows
///
/// For administrators and the instructors of its groups.
#[utoipa::path(delete, path = "/courses/{id}", tag = "courses", params(("id" = String, Path, description = "id")),
    responses((status = NO_CONTENT)))]
pub async fn delete(State(app): State<App>, by: Staff, at: PathKey) -> HandlerResult<StatusCode> {
    app.store.courses().delete(&by.scope, at.id()?).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Reports a missing task or group as a mistake in the body (422), not in the address (404).
fn reference_error(error: StoreError) -> ProblemResponse {
    match error {
        StoreError::NotFound { what: "task" } => unknown_reference("task", "task"),
        other => owners_problem(other),
    }
}
