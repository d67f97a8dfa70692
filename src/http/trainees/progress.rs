//! How a trainee gets on at a task.

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

/// What one wants to know.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct Which {
    /// Of which task, by id or code; without it, that of the newest session.
    #[param(value_type = Option<String>)]
    task: Option<Key>,
    /// Which feature, such as `path_length`; without it, those that the task's standard limits, or the duration.
    feature: Option<String>,
    /// Of this tool alone; without it, of all that have the feature.
    tool: Option<String>,
    /// Where it is measured; without it, in three dimensions, if it is measured there.
    space: Option<FeatureSpace>,
    /// Among whom the newest value is placed: a cohort's id or code.
    #[param(value_type = Option<String>)]
    cohort: Option<Key>,
}

/// A trainee's sessions of a task over time: their features, places, learning curves, and what the task's standard makes of
/// them.
#[derive(Serialize, ToSchema)]
pub struct Progress {
    trainee: Trainee,
    /// `null` where none was named and there is no session.
    task: Option<Task>,
    /// What the task asks for; `null` where nobody has set that.
    standard: Option<Standard>,
    /// Among whom the newest values are placed; `null` where none was named.
    cohort: Option<Cohort>,
    #[serde(flatten)]
    course: answer::Course,
}

/// Read how a trainee gets on at a task
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
