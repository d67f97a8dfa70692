//! How reliable the ratings of a task's sessions are, and how they correlate with features.

use axum::extract::State;
use serde::Deserialize;
use utoipa::IntoParams;

use crate::domain::rating::RatingForm;
use crate::http::auth::signed_in::Staff;
use crate::http::error::HandlerResult;
use crate::http::read::{Json, Params, PathKey};
use crate::http::state::App;

pub use crate::cohorts::{Agreement, Correlations};

/// Selects ratings.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct RatingFormQuery {
    /// The rating form.
    form: RatingForm,
}

/// Read the agreement of the raters of a task's sessions
///
/// Intraclass correlations (two-way random effects, absolute agreement) with 95 % intervals. They use blind and
/// complete ratings of people who were rated by the same raters; each person counts once, with the newest such session.
/// Limited to people that the caller may see.
#[utoipa::path(get, path = "/tasks/{id}/agreement", tag = "ratings",
    params(("id" = String, Path, description = "id or code"), RatingFormQuery),
    responses((status = OK, body = Agreement)))]
pub async fn agreement(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    Params(RatingFormQuery { form }): Params<RatingFormQuery>,
) -> HandlerResult<Json<Agreement>> {
    let of = app.store.tasks().get(&by.scope, &key).await?.id;
    Ok(Json(app.cohorts.agreement(&by.scope, of, form).await?))
}

/// Read the correlations between ratings and features of a task's sessions
///
/// Spearman's ρ over people, computed from each person's means over the rated sessions, with 95 % intervals and
/// p-values adjusted for the number of features. Limited to people that the caller may see.
#[utoipa::path(get, path = "/tasks/{id}/correlations", tag = "ratings",
    params(("id" = String, Path, description = "id or code"), RatingFormQuery),
    responses((status = OK, body = Correlations)))]
pub async fn correlations(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    Params(RatingFormQuery { form }): Params<RatingFormQuery>,
) -> HandlerResult<Json<Correlations>> {
    let of = app.store.tasks().get(&by.scope, &key).await?.id;
    Ok(Json(app.cohorts.correlations(&by.scope, of, form).await?))
}
