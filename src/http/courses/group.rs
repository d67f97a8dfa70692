//! The plan that a group follows: whoever teaches the group says which, and reads how its trainees have come through it.

use axum::extract::State;
use axum::http::StatusCode;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::DueStep;
use crate::cohorts::{self, CourseRow};
use crate::domain::text::Name;
use crate::http::auth::signed_in::Staff;
use crate::http::error::Answer;
use crate::http::read::{At, Json, named};
use crate::http::state::App;
use crate::http::trainees::Trainee;
use crate::ids::{CourseId, GroupId};
use crate::store;
use crate::time::Day;

/// The plan that a group follows.
#[derive(Debug, Serialize, ToSchema)]
pub struct FollowedCourse {
    id: CourseId,
    name: Name,
    /// The course's first day, where the service stands.
    begins: Day,
}

impl FollowedCourse {
    /// This plan, from this day on.
    pub fn new(id: CourseId, name: Name, begins: Day) -> Self {
        Self { id, name, begins }
    }
}

impl From<store::Followed> for FollowedCourse {
    fn from(followed: store::Followed) -> Self {
        let store::Followed { course, name, begins } = followed;
        Self::new(course, name, begins)
    }
}

/// A plan to be followed.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewFollowed {
    /// Which plan.
    course: CourseId,
    /// The course's first day.
    begins: Day,
}

/// A group's trainees against the steps of its course.
#[derive(Serialize, ToSchema)]
pub struct GroupCourse {
    group: GroupId,
    course: FollowedCourse,
    /// The plan's steps, in their order.
    steps: Vec<DueStep>,
    /// Who is in the group, by name; at most 500.
    trainees: Vec<Trainee>,
    /// One row for each of them.
    rows: Vec<CourseRow>,
    /// Are there more trainees in the group than rows?
    more: bool,
}

impl From<cohorts::GroupCourse> for GroupCourse {
    fn from(found: cohorts::GroupCourse) -> Self {
        let cohorts::GroupCourse { group, course, begins, trainees, rows, more } = found;
        Self {
            group: group.id,
            course: FollowedCourse::new(course.id, course.name, begins),
            steps: course.steps.into_iter().map(|step| DueStep::new(step, begins)).collect(),
            trainees: trainees.into_iter().map(Trainee::from).collect(),
            rows,
            more,
        }
    }
}

/// Read how a group's trainees have come through its course
///
/// A standard counts as passed whenever it was passed; sessions count from the course's first day on. Not found, where the group
/// follows no plan.
#[utoipa::path(get, path = "/groups/{id}/course", tag = "courses",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = GroupCourse)))]
pub async fn of_group(State(app): State<App>, by: Staff, at: At) -> Answer<Json<GroupCourse>> {
    Ok(Json(app.cohorts.group_course(&by.scope, at.id()?).await?.into()))
}

/// Let a group follow a course plan, in place of the one that it followed
#[utoipa::path(put, path = "/groups/{id}/course", tag = "courses",
    params(("id" = String, Path, description = "id")), request_body = NewFollowed,
    responses((status = OK, body = GroupCourse)))]
pub async fn follow(
    State(app): State<App>,
    by: Staff,
    at: At,
    Json(NewFollowed { course, begins }): Json<NewFollowed>,
) -> Answer<Json<GroupCourse>> {
    let group = app.store.groups().get(&by.scope, at.id()?).await?.id;
    app.store.courses().follow(&by.scope, group, course, begins).await.map_err(named("course"))?;
    Ok(Json(app.cohorts.group_course(&by.scope, group).await?.into()))
}

/// End that a group follows a course plan; plan and sessions stay
#[utoipa::path(delete, path = "/groups/{id}/course", tag = "courses",
    params(("id" = String, Path, description = "id")), responses((status = NO_CONTENT)))]
pub async fn unfollow(State(app): State<App>, by: Staff, at: At) -> Answer<StatusCode> {
    app.store.courses().unfollow(&by.scope, at.id()?).await?;
    Ok(StatusCode::NO_CONTENT)
}
