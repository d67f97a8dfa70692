//! One trainee's courses: the next step, and when it is due.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::{DueStep, FollowedCourse};
use crate::cohorts::{self, CourseRow, StepProgress};
use crate::domain::text::Name;
use crate::http::auth::signed_in::Member;
use crate::http::error::HandlerResult;
use crate::http::read::{Json, PathKey};
use crate::http::show::PageResponse;
use crate::http::state::App;
use crate::ids::GroupId;

/// A trainee's progress in one course.
#[derive(Serialize, ToSchema)]
pub struct OwnCourseResponse {
    /// The group that follows the course; `null` for trainees, who do not see groups.
    group: Option<CourseGroup>,
    course: FollowedCourse,
    /// Number, from 1, of the first step that is not passed; `null`: all steps are passed.
    next: Option<usize>,
    /// The plan's steps, in order.
    steps: Vec<OwnStep>,
}

/// A group, by its name.
#[derive(Serialize, ToSchema)]
pub struct CourseGroup {
    id: GroupId,
    name: Name,
}

/// A step and the trainee's progress in it.
#[derive(Serialize, ToSchema)]
pub struct OwnStep {
    #[serde(flatten)]
    step: DueStep,
    progress: StepProgress,
}

impl OwnCourseResponse {
    fn new(found: cohorts::OwnCourse, show_group: bool) -> Self {
        let cohorts::OwnCourse { of, course, row } = found;
        let CourseRow { next, steps: progress, .. } = row;
        let steps = course.steps.into_iter().map(|step| DueStep::new(step, of.begins)).zip(progress);
        Self {
            group: show_group.then_some(CourseGroup { id: of.group_id, name: of.group_name }),
            course: FollowedCourse::new(course.id, course.name, of.begins),
            next,
            steps: steps.map(|(step, progress)| OwnStep { step, progress }).collect(),
        }
    }
}

/// Read a trainee's progress in the courses of their groups, latest first
///
/// Instructors see the courses of the groups that they teach.
#[utoipa::path(get, path = "/trainees/{id}/courses", tag = "courses",
    params(("id" = String, Path, description = "id or code")),
    responses((status = OK, body = PageResponse<OwnCourseResponse>)))]
pub async fn of_trainee(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
) -> HandlerResult<Json<PageResponse<OwnCourseResponse>>> {
    let found = app.cohorts.own_courses(&by.scope, &key).await?;
    Ok(Json(PageResponse::whole(found.into_iter().map(|of| OwnCourseResponse::new(of, by.scope.is_staff())))))
}
