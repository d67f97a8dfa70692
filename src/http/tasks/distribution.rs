//! Distribution of a feature over people, and the effect of a limit.

use axum::extract::State;
use serde::Deserialize;
use utoipa::IntoParams;

pub use crate::cohorts::Distribution;
use crate::cohorts::DistributionSelection;
use crate::domain::hand::Hand;
use crate::domain::session::FeatureSpace;
use crate::domain::text::Key;
use crate::domain::trainee::Handedness;
use crate::http::auth::signed_in::Staff;
use crate::http::error::{HandlerResult, ProblemResponse};
use crate::http::read::{Json, Params, PathKey};
use crate::http::state::App;

/// Most cohorts in one comparison.
const MAX_COHORTS: usize = 4;

/// Selects a feature, the people and a limit.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct DistributionQuery {
    /// Stable name of a feature such as `duration`, for which smaller or larger values are better.
    feature: String,
    /// The tool's marker; absent for a feature of a hand or of the whole session.
    tool: Option<String>,
    /// The hand that holds the tool; absent for a feature of a tool or of the whole session.
    in_hand: Option<Hand>,
    /// The space of the feature; default: three dimensions, if the feature is measured there.
    space: Option<FeatureSpace>,
    /// The cohorts to compare, by id or code, at most four, separated by commas; default: all people that the caller
    /// may see.
    cohorts: Option<String>,
    /// For a feature of a tool, or of the left or right hand: only people who prefer this hand.
    hand: Option<Handedness>,
    /// A limit to try: the answer then gives the shares of each group that keep and break it.
    limit: Option<f64>,
}

/// Read the distribution of a feature over people
///
/// One value for each person: the median of the last five sessions measured by this version of the program. It contains
/// no names, and only people that the caller may see. With a limit, the share of novices that keep it are its false
/// passes, and the share of experts that break it its false fails. A standard between contrasting groups reports the
/// same shares for its own limit.
#[utoipa::path(get, path = "/tasks/{id}/distribution", tag = "tasks",
    params(("id" = String, Path, description = "id or code"), DistributionQuery),
    responses((status = OK, body = Distribution)))]
pub async fn distribution(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    Params(of): Params<DistributionQuery>,
) -> HandlerResult<Json<Distribution>> {
    let DistributionQuery { feature, tool, in_hand, space, cohorts, hand, limit } = of;
    let cohorts: Vec<Key> = cohorts
        .iter()
        .flat_map(|list| list.split(','))
        .map(str::trim)
        .filter(|key| !key.is_empty())
        .map(Key::from)
        .collect();
    if cohorts.len() > MAX_COHORTS {
        return Err(ProblemResponse::invalid(
            "cohorts",
            format!("are {}; expected at most {MAX_COHORTS}", cohorts.len()),
        ));
    }
    let task = app.store.tasks().get(&by.scope, &key).await?.id;
    let asked = DistributionSelection { feature, tool, in_hand, space, cohorts, hand, limit };
    Ok(Json(app.cohorts.distribution(&by.scope, task, asked).await?))
}
