//! A trainee's progress in a task.

use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::Trainee;
use crate::cohorts::{Asked, Found, answer};
use crate::domain::session::FeatureSpace;
use crate::domain::text::Key;
use crate::http::auth::signed_in::Member;
use crate::http::cohorts::Cohort;
use crate::http::error::Answer;
use crate::http::read::{At, Json, Params};
use crate::http::state::App;
use crate::http::tasks::{Standard, Task};

/// Selects task, features and cohort.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct Which {
    /// The task, by id or code; default: the task of the newest session.
    #[param(value_type = Option<String>)]
    task: Option<Key>,
    /// The feature, such as `path_length`; default: the features with a limit in the task's standard,
    /// else the duration.
    feature: Option<String>,
    /// The tool; default: all tools that have the feature.
    tool: Option<String>,
    /// The space of the feature; default: three dimensions, if the feature is measured there.
    space: Option<FeatureSpace>,
    /// The cohort to rank the newest value in, by id or code.
    #[param(value_type = Option<String>)]
    cohort: Option<Key>,
}

/// A trainee's sessions of a task over time: features, ranks in a cohort, learning curves, and judgements by the task's
/// standard.
#[derive(Serialize, ToSchema)]
pub struct Progress {
    trainee: Trainee,
    /// The task; `null` if the request named none and the trainee has no sessions.
    task: Option<Task>,
    /// The task's standard; `null`: none was set.
    standard: Option<Standard>,
    /// The cohort that the newest values are ranked in; `null` if the request named none.
    cohort: Option<Cohort>,
    #[serde(flatten)]
    course: answer::Course,
}

/// Read a trainee's progress in a task
#[utoipa::path(get, path = "/trainees/{id}/progress", tag = "trainees",
    params(("id" = String, Path, description = "id or code"), Which), responses((status = OK, body = Progress)))]
pub async fn progress(
    State(app): State<App>,
    by: Member,
    At(key): At,
    Params(which): Params<Which>,
) -> Answer<Json<Progress>> {
    let Which { task, feature, tool, space, cohort } = which;
    let asked = Asked { task, feature, tool, space, cohort };
    let Found { trainee, task, standard, cohort, course } = app.cohorts.progress(&by.scope, &key, asked).await?;
    Ok(Json(Progress {
        trainee: trainee.into(),
        task: task.map(Task::from),
        standard: standard.map(|standard| Standard::new(standard, &by.scope)),
        cohort: cohort.map(Cohort::from),
        course,
    }))
}
