//! What the ratings of a task's sessions are worth.

use axum::extract::State;
use serde::Deserialize;
use utoipa::IntoParams;

use crate::domain::rating::Form;
use crate::http::auth::signed_in::Staff;
use crate::http::error::Answer;
use crate::http::read::{At, Json, Params};
use crate::http::state::App;

pub use crate::cohorts::{Agreement, Correlations};

/// Of which ratings.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct OfForm {
    /// On which form.
    form: Form,
}

/// Read whether those who rate a task's sessions agree
///
/// Intraclass correlations of blind and whole ratings, of two-way random effects and absolute agreement, with 95 % intervals,
/// over people who were rated by the same raters: each person counts once, by the newest such session. Of those whom one sees.
#[utoipa::path(get, path = "/tasks/{id}/agreement", tag = "ratings",
    params(("id" = String, Path, description = "id or code"), OfForm), responses((status = OK, body = Agreement)))]
pub async fn agreement(
    State(app): State<App>,
    by: Staff,
    At(key): At,
    Params(OfForm { form }): Params<OfForm>,
) -> Answer<Json<Agreement>> {
    let of = app.store.tasks().get(&by.scope, &key).await?.id;
    Ok(Json(app.cohorts.agreement(&by.scope, of, form).await?))
}

/// Read with which features the ratings of a task's sessions go
///
/// Spearman's ρ over people, of the means over their rated sessions, with 95 % intervals and chances adjusted for all features
/// asked at once. Of those whom one sees.
#[utoipa::path(get, path = "/tasks/{id}/correlations", tag = "ratings",
    params(("id" = String, Path, description = "id or code"), OfForm), responses((status = OK, body = Correlations)))]
pub async fn correlations(
    State(app): State<App>,
    by: Staff,
    At(key): At,
    Params(OfForm { form }): Params<OfForm>,
) -> Answer<Json<Correlations>> {
    let of = app.store.tasks().get(&by.scope, &key).await?.id;
    Ok(Json(app.cohorts.correlations(&by.scope, of, form).await?))
}
