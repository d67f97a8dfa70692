//! A trainee's sessions over time.

use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::Trainee;
use crate::domain::session::SessionStatus;
use crate::domain::text::Key;
use crate::http::auth::signed_in::Member;
use crate::http::error::Answer;
use crate::http::read::{At, Json, Params, named};
use crate::http::sessions::Feature;
use crate::http::show::Time;
use crate::http::state::App;
use crate::http::tasks::Task;
use crate::ids::SessionId;
use crate::store;

/// Sessions of one trainee that are shown at most, the latest ones.
const MOST: u32 = 200;

/// Of which task.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct Which {
    /// Only of this task, by id or code; without it, of all.
    #[param(value_type = Option<String>)]
    task: Option<Key>,
}

/// A trainee's sessions, oldest first, at most the last 200.
#[derive(Serialize, ToSchema)]
pub struct Progress {
    trainee: Trainee,
    task: Option<Task>,
    sessions: Vec<Step>,
}

/// One session on the way.
#[derive(Serialize, ToSchema)]
pub struct Step {
    id: SessionId,
    recorded_at: Time,
    status: SessionStatus,
    features: Vec<Feature>,
}

/// Read how a trainee gets on
#[utoipa::path(get, path = "/trainees/{id}/progress", tag = "trainees",
    params(("id" = String, Path, description = "id or code"), Which), responses((status = OK, body = Progress)))]
pub async fn progress(
    State(app): State<App>,
    by: Member,
    At(key): At,
    Params(which): Params<Which>,
) -> Answer<Json<Progress>> {
    let trainee = app.store.trainees().get(&by.scope, &key).await?;
    let task = match &which.task {
        Some(task) => Some(app.store.tasks().get(&by.scope, task).await.map_err(named("task"))?),
        None => None,
    };
    let steps = app.store.sessions().progress(&by.scope, &key, which.task.as_ref(), MOST).await?;
    let sessions = steps.into_iter().map(Step::from).collect();
    Ok(Json(Progress { trainee: trainee.into(), task: task.map(Task::from), sessions }))
}

impl From<(store::Session, Option<store::SessionResult>)> for Step {
    fn from((session, result): (store::Session, Option<store::SessionResult>)) -> Self {
        let features = result.map(|result| result.features).unwrap_or_default();
        Self {
            id: session.id,
            recorded_at: Time(session.recorded_at_ms),
            status: session.status(),
            features: features.into_iter().map(Feature::from).collect(),
        }
    }
}
