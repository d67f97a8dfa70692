//! The texts that trainees consent to. Administrators publish them; all people read them.

use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::auth::signed_in::{Administrator, Member};
use super::error::HandlerResult;
use super::read::{Json, Params, PathKey};
use super::show::{Created, PageResponse, Time};
use super::state::App;
use crate::domain::consent::{ConsentTextChange, ConsentWording, NewConsentText};
use crate::ids::ConsentTextId;
use crate::store::{ConsentEffect, ConsentTextRecord};
use crate::time::Day;

/// A published version of the consent text.
#[derive(Debug, Serialize, ToSchema)]
pub struct ConsentTextResponse {
    id: ConsentTextId,
    /// Its number: 1, 2, 3, … in the order of publishing.
    version: i64,
    /// The English text; `null`: there is none.
    en: Option<ConsentWording>,
    /// The German text; `null`: there is none.
    de: Option<ConsentWording>,
    /// First day on which new recordings need consent to this version or a later one; `null`: they do not.
    required_from: Option<Day>,
    /// Name of the person who published it; `null` if the person was deleted, and for trainees.
    who: Option<String>,
    published_at: Time,
}

impl From<ConsentTextRecord> for ConsentTextResponse {
    fn from(text: ConsentTextRecord) -> Self {
        let ConsentTextRecord { id, version, en, de, required_from_ms, who, published_at_ms } = text;
        let (required_from, published_at) = (required_from_ms.map(Day::of), Time(published_at_ms));
        Self { id, version, en, de, required_from, who: who.map(String::from), published_at }
    }
}

/// Which text the effect is asked of.
#[derive(Clone, Copy, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct ConsentEffectQuery {
    /// Id of a published text; absent: a text that is still to be published.
    text: Option<ConsentTextId>,
}

/// The trainees whose new recordings stop if a version is required and nothing else happens.
#[derive(Debug, Serialize, ToSchema)]
pub struct ConsentEffectResponse {
    /// Number of all trainees.
    trainees: i64,
    /// Those who have not consented to the version or a later one.
    without_consent: i64,
    /// Those of them with a session that arrived within the last 30 days.
    active_without_consent: i64,
    /// Those of them who have no account: staff have to record their consent from paper.
    without_account: i64,
}

/// List the published consent texts, newest first
///
/// Without any text, recordings need no consent. New recordings of a trainee need consent to the latest version whose day
/// `required_from` has come, or to a later one.
#[utoipa::path(get, path = "/consent-texts", tag = "consent",
    responses((status = OK, body = PageResponse<ConsentTextResponse>)))]
pub async fn list(State(app): State<App>, by: Member) -> HandlerResult<Json<PageResponse<ConsentTextResponse>>> {
    let texts = app.store.consents().texts(&by.scope).await?;
    let shown = texts.into_iter().map(|text| {
        let text = ConsentTextResponse::from(text);
        if by.scope.is_staff() { text } else { ConsentTextResponse { who: None, ..text } }
    });
    Ok(Json(PageResponse::whole(shown)))
}

/// Publish a consent text as the next version
///
/// A published text never changes; another one replaces it as a new version. Read `consent-texts/effect` first: it counts
/// the trainees whose new recordings stop on the day `required_from`.
#[utoipa::path(post, path = "/consent-texts", tag = "consent", request_body = NewConsentText,
    responses((status = CREATED, body = ConsentTextResponse)))]
pub async fn publish(
    State(app): State<App>,
    by: Administrator,
    Json(new): Json<NewConsentText>,
) -> HandlerResult<Created<ConsentTextResponse>> {
    new.check()?;
    let text = app.store.consents().publish(&by.scope, new).await?;
    app.end_invalid_check_ins_and_waits().await;
    Ok(Created { location: "/api/v1/consent-texts".to_owned(), made: text.into() })
}

/// Change when a published consent text becomes required
#[utoipa::path(patch, path = "/consent-texts/{id}", tag = "consent",
    params(("id" = String, Path, description = "id")), request_body = ConsentTextChange,
    responses((status = OK, body = ConsentTextResponse)))]
pub async fn change(
    State(app): State<App>,
    by: Administrator,
    at: PathKey,
    Json(change): Json<ConsentTextChange>,
) -> HandlerResult<Json<ConsentTextResponse>> {
    let text = app.store.consents().change_text(&by.scope, at.id()?, change).await?;
    app.end_invalid_check_ins_and_waits().await;
    Ok(Json(text.into()))
}

/// Count the trainees that requiring a consent text would touch
#[utoipa::path(get, path = "/consent-texts/effect", tag = "consent", params(ConsentEffectQuery),
    responses((status = OK, body = ConsentEffectResponse)))]
pub async fn effect(
    State(app): State<App>,
    by: Administrator,
    Params(of): Params<ConsentEffectQuery>,
) -> HandlerResult<Json<ConsentEffectResponse>> {
    let ConsentEffect { trainees, without_consent, active_without_consent, without_account } =
        app.store.consents().effect(&by.scope, of.text).await?;
    Ok(Json(ConsentEffectResponse { trainees, without_consent, active_without_consent, without_account }))
}
