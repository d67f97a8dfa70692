//! How a feature is spread over people, with a limit in it.

use axum::extract::State;
use serde::Deserialize;
use utoipa::IntoParams;

use crate::cohorts::AskedSpread;
pub use crate::cohorts::Distribution;
use crate::domain::session::FeatureSpace;
use crate::domain::text::Key;
use crate::domain::trainee::Handedness;
use crate::http::auth::signed_in::Staff;
use crate::http::error::{Answer, Problem};
use crate::http::read::{At, Json, Params};
use crate::http::state::App;

/// Most cohorts that are held beside each other.
const MOST_COHORTS: usize = 4;

/// Of what, over whom, and where a limit would lie.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct SpreadOf {
    /// Stable name of a feature of which more or less is better, such as `duration`.
    feature: String,
    /// The tool's marker; absent for a feature of the whole session.
    tool: Option<String>,
    /// Where it is measured; absent: in three dimensions, if it is.
    space: Option<FeatureSpace>,
    /// Over these cohorts, by id or code, at most four with commas between; absent: over everybody whom one sees.
    cohorts: Option<String>,
    /// Of a tool's feature: over those who prefer this hand.
    hand: Option<Handedness>,
    /// Where a limit would lie: then each group says which share keeps it and which breaks it.
    limit: Option<f64>,
}

/// Read how a feature is spread over people, and what a limit would make of them
///
/// One value a person, the median of their last five sessions, by this version of the program; without names, and only of people
/// whom one sees. Of novices the share that keeps a limit is its false passes, of experts the share that breaks it its false fails: both
/// as a standard between contrasting groups tells them, at whichever limit.
#[utoipa::path(get, path = "/tasks/{id}/distribution", tag = "tasks",
    params(("id" = String, Path, description = "id or code"), SpreadOf),
    responses((status = OK, body = Distribution)))]
pub async fn distribution(
    State(app): State<App>,
    by: Staff,
    At(key): At,
    Params(of): Params<SpreadOf>,
) -> Answer<Json<Distribution>> {
    let SpreadOf { feature, tool, space, cohorts, hand, limit } = of;
    let cohorts: Vec<Key> = cohorts
        .iter()
        .flat_map(|list| list.split(','))
        .map(str::trim)
        .filter(|key| !key.is_empty())
        .map(Key::from)
        .collect();
    if cohorts.len() > MOST_COHORTS {
        return Err(Problem::invalid("cohorts", format!("are {}; expected at most {MOST_COHORTS}", cohorts.len())));
    }
    let task = app.store.tasks().get(&by.scope, &key).await?.id;
    let asked = AskedSpread { feature, tool, space, cohorts, hand, limit };
    Ok(Json(app.cohorts.distribution(&by.scope, task, asked).await?))
}
