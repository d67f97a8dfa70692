//! The course plan that a group follows, and the progress of its trainees. The group's instructors choose the plan.

use axum::extract::State;
use axum::http::StatusCode;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::DueStep;
use crate::cohorts::{self, CourseRow};
use crate::domain::course::checked_first_day;
use crate::domain::scope::Scope;
use crate::domain::text::Name;
use crate::http::auth::signed_in::Staff;
use crate::http::error::HandlerResult;
use crate::http::read::{Json, PathKey, reference_problem};
use crate::http::state::App;
use crate::http::trainees::TraineeResponse;
use crate::ids::{CourseId, GroupId};
use crate::store;
use crate::time::Day;

/// The plan that a group follows.
#[derive(Debug, Serialize, ToSchema)]
pub struct FollowedCourse {
    id: CourseId,
    name: Name,
    /// The course's first day, in the service's time zone.
    begins: Day,
}

impl FollowedCourse {
    /// The plan with the day on which the group begins it.
    pub fn new(id: CourseId, name: Name, begins: Day) -> Self {
        Self { id, name, begins }
    }
}

impl From<store::GroupCoursePlan> for FollowedCourse {
    fn from(followed: store::GroupCoursePlan) -> Self {
        let store::GroupCoursePlan { course, name, begins } = followed;
        Self::new(course, name, begins)
    }
}

/// The plan that a group shall follow.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FollowCourseRequest {
    /// The plan's id.
    course: CourseId,
    /// The course's first day, within ten years of today.
    begins: Day,
}

/// The progress of a group's trainees in its course.
#[derive(Serialize, ToSchema)]
pub struct GroupCourseResponse {
    group: GroupId,
    course: FollowedCourse,
    /// The plan's steps, in order.
    steps: Vec<DueStep>,
    /// The group's trainees, by name; at most 500.
    trainees: Vec<TraineeResponse>,
    /// One row for each trainee.
    rows: Vec<CourseRow>,
    /// True if the group has more trainees than are listed.
    more: bool,
}

impl GroupCourseResponse {
    /// The progress as this scope may see it.
    fn new(found: cohorts::GroupCourse, scope: &Scope) -> Self {
        let cohorts::GroupCourse { group, course, begins, trainees, rows, more } = found;
        Self {
            group: group.id,
            course: FollowedCourse::new(course.id, course.name, begins),
            steps: course.steps.into_iter().map(|step| DueStep::new(step, begins)).collect(),
            trainees: trainees.into_iter().map(|trainee| TraineeResponse::new(trainee, scope)).collect(),
            rows,
            more,
        }
    }
}

/// Read the progress of a group's trainees in its course
///
/// A standard counts as passed even if it was passed before the course began; sessions count from the course's first
/// day on. The answer is 404 if the group follows no plan.
#[utoipa::path(get, path = "/groups/{id}/course", tag = "courses",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = GroupCourseResponse)))]
pub async fn of_group(State(app): State<App>, by: Staff, at: PathKey) -> HandlerResult<Json<GroupCourseResponse>> {
    Ok(Json(GroupCourseResponse::new(app.cohorts.group_course(&by.scope, at.id()?).await?, &by.scope)))
}

/// Set the course plan that a group follows
///
/// It replaces the plan that the group followed before.
#[utoipa::path(put, path = "/groups/{id}/course", tag = "courses",
    params(("id" = String, Path, description = "id")), request_body = FollowCourseRequest,
    responses((status = OK, body = GroupCourseResponse)))]
pub async fn follow(
    State(app): State<App>,
    by: Staff,
    at: PathKey,
    Json(FollowCourseRequest { course, begins }): Json<FollowCourseRequest>,
) -> HandlerResult<Json<GroupCourseResponse>> {
    let group = app.store.groups().get(&by.scope, at.id()?).await?.id;
    let begins = checked_first_day(begins, Day::of(app.clock.now_ms()))?;
    app.store.courses().follow(&by.scope, group, course, begins).await.map_err(reference_problem("course"))?;
    Ok(Json(GroupCourseResponse::new(app.cohorts.group_course(&by.scope, group).await?, &by.scope)))
}

/// Stop a group from following its course plan
///
/// The plan and the sessions stay.
#[utoipa::path(delete, path = "/groups/{id}/course", tag = "courses",
    params(("id" = String, Path, description = "id")), responses((status = NO_CONTENT)))]
pub async fn unfollow(State(app): State<App>, by: Staff, at: PathKey) -> HandlerResult<StatusCode> {
    app.store.courses().unfollow(&by.scope, at.id()?).await?;
    Ok(StatusCode::NO_CONTENT)
}
