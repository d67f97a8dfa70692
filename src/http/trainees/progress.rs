//! A trainee's progress in a task.

use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::TraineeResponse;
use crate::cohorts::{ProgressSelection, TraineeProgress, answer};
use crate::domain::hand::Hand;
use crate::domain::session::FeatureSpace;
use crate::domain::text::Key;
use crate::http::auth::signed_in::Member;
use crate::http::cohorts::CohortResponse;
use crate::http::error::HandlerResult;
use crate::http::read::{Json, Params, PathKey};
use crate::http::state::App;
use crate::http::tasks::{StandardResponse, TaskResponse};

/// Selects task, features and cohort.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct ProgressQuery {
    /// The task, by id or code; default: the task of the newest session.
    #[param(value_type = Option<String>)]
    task: Option<Key>,
    /// The feature, such as `path_length`; default: the features with a limit in the task's standard,
    /// else the duration.
    feature: Option<String>,
    /// The tool; default: the whole session, both hands, and the tools whose hand is unknown.
    tool: Option<String>,
    /// The hand that holds the tool.
    in_hand: Option<Hand>,
    /// The space of the feature; default: three dimensions, if the feature is measured there.
    space: Option<FeatureSpace>,
    /// The cohort to rank the newest value in, by id or code.
    #[param(value_type = Option<String>)]
    cohort: Option<Key>,
}

/// A trainee's sessions of a task over time: features, ranks in a cohort, learning curves, and judgements by the task's
/// standard.
#[derive(Serialize, ToSchema)]
pub struct TraineeProgressResponse {
    trainee: TraineeResponse,
    /// The task; `null` if the request named none and the trainee has no sessions.
    task: Option<TaskResponse>,
    /// The version of the task's standard that judges recordings that arrive now; `null`: none does.
    standard: Option<StandardResponse>,
    /// The cohort that the newest values are ranked in; `null` if the request named none.
    cohort: Option<CohortResponse>,
    #[serde(flatten)]
    course: answer::ProgressAnswer,
}

/// Read a trainee's progress in a task
#[utoipa::path(get, path = "/trainees/{id}/progress", tag = "trainees",
    params(("id" = String, Path, description = "id or code"), ProgressQuery),
    responses((status = OK, body = TraineeProgressResponse)))]
pub async fn progress(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
    Params(which): Params<ProgressQuery>,
) -> HandlerResult<Json<TraineeProgressResponse>> {
    let ProgressQuery { task, feature, tool, in_hand, space, cohort } = which;
    let asked = ProgressSelection { task, feature, tool, in_hand, space, cohort };
    let TraineeProgress { trainee, task, standard, cohort, answer } =
        app.cohorts.progress(&by.scope, &key, asked).await?;
    Ok(Json(TraineeProgressResponse {
        trainee: TraineeResponse::new(trainee, &by.scope),
        task: task.map(|task| TaskResponse::new(task, &by.scope)),
        standard: standard.map(|standard| StandardResponse::new(standard, &by.scope)),
        cohort: cohort.map(CohortResponse::from),
        course: answer,
    }))
}
