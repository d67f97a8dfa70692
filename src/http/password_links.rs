//! Links for choosing a password without the old one: for a new person, and for one who has forgotten the password. The
//! page's address is `/choose-password#SECRET`: browsers send no part after `#`, so the secret is in no log.

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{AppendHeaders, IntoResponse};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::auth::password::HashRequester;
use super::auth::presented::{browser_secret, set_browser_cookie};
use super::auth::sign_in::{places_of, too_many_attempts};
use super::auth::signed_in::{Administrator, BySignIn};
use super::client_address::ClientAddress;
use super::error::{HandlerResult, ProblemResponse, Refusal};
use super::people::PersonResponse;
use super::read::{AnonymousJson, Json, PathKey, reference_problem};
use super::show::{Created, PageResponse, Time};
use super::state::App;
use crate::domain::scope::Actor;
use crate::domain::secret::{Password, Secret};
use crate::domain::text::{Login, Name};
use crate::ids::{PasswordLinkId, PersonId};
use crate::store::{self, StoreError};

/// A valid link without its secret, which is not stored.
#[derive(Debug, Serialize, ToSchema)]
pub struct PasswordLinkResponse {
    id: PasswordLinkId,
    /// Whose password it sets.
    person: PersonId,
    created_at: Time,
    expires_at: Time,
}

impl From<store::PasswordLinkRecord> for PasswordLinkResponse {
    fn from(link: store::PasswordLinkRecord) -> Self {
        let (created_at, expires_at) = (Time(link.created_at_ms), Time(link.expires_at_ms));
        Self { id: link.id, person: link.person_id, created_at, expires_at }
    }
}

/// List the links for passwords that are still valid
#[utoipa::path(get, path = "/password-links", tag = "people",
    responses((status = OK, body = PageResponse<PasswordLinkResponse>)))]
pub async fn list(
    State(app): State<App>,
    by: Administrator,
) -> HandlerResult<Json<PageResponse<PasswordLinkResponse>>> {
    let links = app.store.password_links().list(&by.scope).await?;
    Ok(Json(PageResponse::whole(links.into_iter().map(PasswordLinkResponse::from))))
}

/// A link to create.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewPasswordLink {
    /// The id of the person who chooses a password.
    person: PersonId,
}

/// A new link with its secret, which no other answer contains.
#[derive(Serialize, ToSchema)]
pub struct MadePasswordLink {
    #[serde(flatten)]
    about: PasswordLinkResponse,
    /// The secret: the person opens `/choose-password#SECRET` of this service. It cannot be read again.
    secret: String,
}

/// Create a link for choosing a password
///
/// It is valid once, for 24 hours unless the settings say otherwise. A new link replaces the person's earlier one. The
/// present password stays valid until the link is used. The link ends when its maker is no administrator any more. A
/// token does not suffice to make one. Instructors make links for their trainees with `POST /invitations`.
#[utoipa::path(post, path = "/password-links", tag = "people", request_body = NewPasswordLink,
    responses((status = CREATED, body = MadePasswordLink)))]
pub async fn create(
    State(app): State<App>,
    BySignIn(by): BySignIn<Administrator>,
    Json(new): Json<NewPasswordLink>,
) -> HandlerResult<Created<MadePasswordLink>> {
    let (links, secret, lifetime) = (app.store.password_links(), Secret::random(), app.settings.password_link());
    let link =
        links.create(&by.scope, new.person, secret.hash(), lifetime).await.map_err(reference_problem("person"))?;
    let location = format!("/api/v1/password-links/{}", link.id);
    Ok(Created { location, made: MadePasswordLink { about: link.into(), secret: secret.as_cookie() } })
}

/// Withdraw a link for a password
///
/// A token does not suffice.
#[utoipa::path(delete, path = "/password-links/{id}", tag = "people", params(("id" = String, Path, description = "id")),
    responses((status = NO_CONTENT)))]
pub async fn withdraw(
    State(app): State<App>,
    BySignIn(by): BySignIn<Administrator>,
    at: PathKey,
) -> HandlerResult<StatusCode> {
    app.store.password_links().withdraw(&by.scope, at.id()?).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// The secret of a link.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PasswordLinkSecret {
    /// The part of the link after `#`.
    #[schema(format = Password)]
    secret: String,
}

/// The account whose password a link sets.
#[derive(Serialize, ToSchema)]
pub struct OpenedPasswordLink {
    login: Login,
    name: Name,
    expires_at: Time,
}

/// Read whose password a link sets
///
/// It stays valid.
#[utoipa::path(post, path = "/password-links/open", tag = "sign-in", request_body = PasswordLinkSecret, security(()),
    responses((status = OK, body = OpenedPasswordLink)))]
pub async fn open(
    State(app): State<App>,
    address: ClientAddress,
    AnonymousJson(PasswordLinkSecret { secret }): AnonymousJson<PasswordLinkSecret>,
) -> HandlerResult<Json<OpenedPasswordLink>> {
    let (link, person) = valid_link(&app, address, &secret).await?;
    let store::PersonRecord { login, name, .. } = person;
    Ok(Json(OpenedPasswordLink { login, name, expires_at: Time(link.expires_at_ms) }))
}

/// A password to set with a link.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PasswordByLink {
    /// The part of the link after `#`.
    #[schema(format = Password)]
    secret: String,
    /// The new password, 10 to 256 bytes, at least 5 different characters.
    #[schema(format = Password, min_length = 10, max_length = 256)]
    new: String,
}

/// Set a password with a link
///
/// Ends the link, signs the account out in every browser and withdraws its tokens. Sign in with the new password
/// afterwards. The browser and its address then count as places that have signed in before: guesses from elsewhere do
/// not make them wait.
#[utoipa::path(post, path = "/password-links/use", tag = "sign-in", request_body = PasswordByLink, security(()),
    responses((status = OK, body = PersonResponse,
            headers(("Set-Cookie" = String, description = "`__Host-trocar-browser`, as of `POST sign-in`")))))]
pub async fn use_link(
    State(app): State<App>,
    address: ClientAddress,
    headers: HeaderMap,
    AnonymousJson(PasswordByLink { secret, new }): AnonymousJson<PasswordByLink>,
) -> HandlerResult<impl IntoResponse> {
    let new = Password::new(new)?;
    let (_, person) = valid_link(&app, address, &secret).await?; // before the expensive hash
    let secret = Secret::from_cookie(&secret).ok_or_else(no_longer_valid)?;
    // The secret proves enough: the attempts of strangers, who fill the queue of the networks, do not delay it.
    let place = app.password_hasher.take_place(HashRequester::Account(Actor::Person(person.id)))?;
    let base = &app.settings.base_path;
    let (browser, places) = places_of(person.id, address, browser_secret(&headers, base));
    let new = place.hash(new).await?;
    let set = app.store.password_links().set_password(secret.hash(), new, address.0, places).await;
    let person = set.map_err(|error| match error {
        StoreError::NotFound { .. } => no_longer_valid(),
        other => other.into(),
    })?;
    app.throttle.forget(&person.login);
    tracing::info!(person = %person.id, "password set with a link");
    let cookie = AppendHeaders([(header::SET_COOKIE, set_browser_cookie(&browser, base))]);
    Ok((cookie, Json(PersonResponse::from(person))))
}

/// The valid link with this secret. A wrong secret counts as a failed sign-in of the client's address.
async fn valid_link(
    app: &App,
    ClientAddress(address): ClientAddress,
    secret: &str,
) -> HandlerResult<(store::PasswordLinkRecord, store::PersonRecord)> {
    let found = match Secret::from_cookie(secret) {
        Some(secret) => app.store.password_links().look_up(secret.hash()).await?,
        None => None,
    };
    if found.is_none() {
        app.throttle.attempt_without_login(address).map_err(too_many_attempts)?;
    }
    found.ok_or_else(no_longer_valid)
}

/// The same for a link that was used, withdrawn or replaced, that has expired, or that never existed.
fn no_longer_valid() -> ProblemResponse {
    Refusal::Gone.with(
        "This link for a password was used, was replaced by a newer one, or has expired. Ask your instructor or an \
         administrator for a new one.",
    )
}
