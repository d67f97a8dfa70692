//! One trainee's courses: what is next, and until when.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::{DueStep, FollowedCourse};
use crate::cohorts::{self, CourseRow, StepProgress};
use crate::domain::text::Name;
use crate::http::auth::signed_in::Member;
use crate::http::error::Answer;
use crate::http::read::{At, Json};
use crate::http::show::Page;
use crate::http::state::App;
use crate::ids::GroupId;

/// A trainee's way through one course.
#[derive(Serialize, ToSchema)]
pub struct OwnCourse {
    /// By which group; `null` to trainees, to whom groups are not shown.
    group: Option<CourseGroup>,
    course: FollowedCourse,
    /// Number, from 1, of the first step that is not passed; `null`: all are.
    next: Option<usize>,
    /// The plan's steps, in their order.
    steps: Vec<OwnStep>,
}

/// A group, by its name.
#[derive(Serialize, ToSchema)]
pub struct CourseGroup {
    id: GroupId,
    name: Name,
}

/// A step, and how it stands.
#[derive(Serialize, ToSchema)]
pub struct OwnStep {
    #[serde(flatten)]
    step: DueStep,
    progress: StepProgress,
}

impl OwnCourse {
    fn new(found: cohorts::OwnCourse, tells_groups: bool) -> Self {
        let cohorts::OwnCourse { of, course, row } = found;
        let CourseRow { next, steps: progress, .. } = row;
        let steps = course.steps.into_iter().map(|step| DueStep::new(step, of.begins)).zip(progress);
        Self {
            group: tells_groups.then_some(CourseGroup { id: of.group_id, name: of.group_name }),
            course: FollowedCourse::new(course.id, course.name, of.begins),
            next,
            steps: steps.map(|(step, progress)| OwnStep { step, progress }).collect(),
        }
    }
}

/// Read how a trainee has come through the courses of their groups, the latest first
///
/// To instructors, those of the groups that they teach.
#[utoipa::path(get, path = "/trainees/{id}/course", tag = "courses",
    params(("id" = String, Path, description = "id or code")), responses((status = OK, body = Page<OwnCourse>)))]
pub async fn of_trainee(State(app): State<App>, by: Member, At(key): At) -> Answer<Json<Page<OwnCourse>>> {
    let found = app.cohorts.own_courses(&by.scope, &key).await?;
    Ok(Json(Page::whole(found.into_iter().map(|of| OwnCourse::new(of, by.scope.is_staff())))))
}
