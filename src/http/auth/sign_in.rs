//! Sign in, sign out, change the own password.

use std::time::Duration;

use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{AppendHeaders, IntoResponse};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::origin::is_from_page;
use super::password::HashRequester;
use super::presented::{PresentedCredential, browser_secret, clear_cookie, set_browser_cookie, set_cookie};
use super::signed_in::{Identified, IdentifiedPerson};
use super::throttle::{AttemptOrigin, KnownPlace, network_of};
use crate::domain::password_state::PasswordState;
use crate::domain::scope::{Actor, Scope};
use crate::domain::secret::{Password, PasswordHash, Secret, SecretHash};
use crate::domain::text::Login;
use crate::http::client_address::ClientAddress;
use crate::http::error::{HandlerResult, ProblemResponse, Refusal};
use crate::http::people::PersonResponse;
use crate::http::read::{AnonymousJson, Json};
use crate::http::state::App;
use crate::ids::PersonId;
use crate::store::{self, StoreError};

/// How much of a browser's name is kept, characters.
const MAX_BROWSER_CHARS: usize = 200;

/// Login and password.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Credentials {
    /// The account's login.
    login: String,
    /// The password.
    #[schema(format = Password)]
    password: String,
}

/// The account that signed in.
#[derive(Serialize, ToSchema)]
pub struct SignInResponse {
    person: PersonResponse,
    /// True if this sign-in may only change the password: every other request is refused as
    /// `password-change-required`.
    must_change_password: bool,
}

/// Sign in and receive a cookie
#[utoipa::path(post, path = "/sign-in", tag = "sign-in", request_body = Credentials, security(()),
    responses((status = OK, body = SignInResponse,
            headers(("Set-Cookie" = String,
                    description = "`__Host-trocar`; ends after 30 minutes without a request and after 12 hours at the \
                                   latest. `__Host-trocar-browser` recognises the browser at its next sign-in, for 180 \
                                   days. Below a path the names begin with `__Secure-`")))))]
pub async fn sign_in(
    State(app): State<App>,
    address: ClientAddress,
    headers: HeaderMap,
    AnonymousJson(tried): AnonymousJson<Credentials>,
) -> HandlerResult<impl IntoResponse> {
    let base = &app.settings.base_path;
    let known_browser = browser_secret(&headers, base).as_ref().map(Secret::hash);
    let (person, verified) = authenticate(&app, tried, address, known_browser).await?;
    let (new, cookies) = new_sign_in(&app, &headers, address, person.id);
    let must_change_password = person.password_state.must_change(new.origin.is_page);
    let created = app.store.cookies().create(new.secret, (&person, &verified), new.lasts, new.origin).await;
    created.map_err(changed_meanwhile)?;
    if let PresentedCredential::Cookie(before) = PresentedCredential::in_headers(&headers, base) {
        app.store.cookies().delete_replaced(before).await?;
    }
    tracing::info!(person = %person.id, "signed in");
    Ok((cookies, Json(SignInResponse { person: person.into(), must_change_password })))
}

/// Sign out: invalidates the cookie and removes it from the browser
#[utoipa::path(post, path = "/sign-out", tag = "sign-in", responses((status = NO_CONTENT)))]
pub async fn sign_out(State(app): State<App>, _by: Identified, headers: HeaderMap) -> HandlerResult<impl IntoResponse> {
    let base = &app.settings.base_path;
    if let PresentedCredential::Cookie(secret) = PresentedCredential::in_headers(&headers, base) {
        app.store.cookies().delete(secret).await?;
    }
    Ok((StatusCode::NO_CONTENT, set_cookie_header(clear_cookie(base))))
}

/// Old and new password.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PasswordChange {
    /// The current password.
    #[schema(format = Password)]
    old: String,
    /// The new password, 10 to 256 bytes, at least 5 different characters.
    #[schema(format = Password, min_length = 10, max_length = 256)]
    new: String,
    /// Keep the tokens that act as this account. Otherwise they are withdrawn, and so are those that they made, for
    /// example for the agents of boxes.
    #[serde(default)]
    keep_tokens: bool,
}

/// Change the own password
///
/// Ends all sign-ins of the account, withdraws its link for a password, and withdraws its tokens and those that they
/// made unless `keep_tokens` is true. The answer signs the caller in again, with another cookie. A password that must be
/// changed cannot be chosen again. A token does not suffice.
#[utoipa::path(post, path = "/me/password", tag = "sign-in", request_body = PasswordChange,
    responses((status = NO_CONTENT, headers(("Set-Cookie" = String, description = "The cookies of `POST sign-in`")))))]
pub async fn change_password(
    State(app): State<App>,
    address: ClientAddress,
    by: IdentifiedPerson,
    headers: HeaderMap,
    Json(change): Json<PasswordChange>,
) -> HandlerResult<impl IntoResponse> {
    let id = by.id;
    let is_same = change.old == change.new;
    let new = Password::new(change.new)?;
    let (person, stored) = require_own_password(&app, &by.scope, (id, address), change.old).await?;
    let requester = HashRequester::Account(Actor::Person(id));
    if person.password_state != PasswordState::Own && is_same {
        return Err(ProblemResponse::invalid("new", "is the password that must be changed; choose another one"));
    }
    let new = app.password_hasher.take_place(requester)?.hash(new).await?;
    let (sign_in, cookies) = new_sign_in(&app, &headers, address, id);
    let set = app.store.people().set_own_password(&by.scope, new, stored, change.keep_tokens, sign_in).await;
    set.map_err(changed_meanwhile)?;
    Ok((StatusCode::NO_CONTENT, cookies))
}

/// Checks the password of a person who is signed in, before what a stranger at an open browser must not do. Returns the
/// account, and the hash of the password.
pub async fn require_own_password(
    app: &App,
    scope: &Scope,
    (id, address): (PersonId, ClientAddress),
    given: String,
) -> HandlerResult<(store::PersonRecord, PasswordHash)> {
    let person = app.store.people().get(scope, id).await?;
    let found = app.store.people().by_login(&person.login).await?;
    let (person, stored) = found.ok_or_else(ProblemResponse::not_found)?;
    // One counter for all addresses: a stolen cookie must not guess on, and the guesses of strangers do not count.
    let place = KnownPlace { counter: SecretHash::of_place(id, "signed in"), is_browser: true };
    let origin = AttemptOrigin { address: address.0, known_place: Some(place) };
    let attempt = (&person.login, origin, given);
    let requester = HashRequester::Account(Actor::Person(id));
    if !try_password(app, requester, attempt, Some(stored.clone()), too_many_attempts).await? {
        return Err(wrong_credentials());
    }
    Ok((person, stored))
}

/// A sign-in of the browser that sent these headers, and the headers of the answer that give it its cookies.
fn new_sign_in(
    app: &App,
    headers: &HeaderMap,
    address: ClientAddress,
    person: PersonId,
) -> (store::NewSignIn, AppendHeaders<[(header::HeaderName, HeaderValue); 2]>) {
    let base = &app.settings.base_path;
    let (secret, (browser, places)) = (Secret::random(), places_of(person, address, browser_secret(headers, base)));
    let origin = new_origin(headers, address, places);
    let cookies = [set_cookie(&secret, base), set_browser_cookie(&browser, base)];
    let new = store::NewSignIn { secret: secret.hash(), lasts: app.sign_in_lifetime(), origin };
    (new, AppendHeaders(cookies.map(|cookie| (header::SET_COOKIE, cookie))))
}

/// From where the browser that sent these headers signs in.
pub(in crate::http) fn new_origin(
    headers: &HeaderMap,
    address: ClientAddress,
    places: Vec<SecretHash>,
) -> store::SignInOrigin {
    let (browser, is_page) = (browser_name(headers), is_from_page(headers));
    store::SignInOrigin { browser, address: address.0.to_string(), is_page, places }
}

/// The secret that recognises a browser, which is a new one if it has none yet, and the places that the browser and its
/// address are for an account.
pub(in crate::http) fn places_of(
    person: PersonId,
    address: ClientAddress,
    browser: Option<Secret>,
) -> (Secret, Vec<SecretHash>) {
    let browser = browser.unwrap_or_else(Secret::random);
    let places = [Some(browser.hash()), place_of(person, address)].into_iter().flatten().collect();
    (browser, places)
}

/// The browser's name as it states it.
fn browser_name(headers: &HeaderMap) -> String {
    let name = headers.get(header::USER_AGENT).and_then(|name| name.to_str().ok()).unwrap_or_default();
    name.chars().take(MAX_BROWSER_CHARS).collect()
}

/// The account with these credentials, and the hash that the password matched. Takes the same time whether the login
/// exists or not.
async fn authenticate(
    app: &App,
    tried: Credentials,
    ClientAddress(address): ClientAddress,
    browser: Option<SecretHash>,
) -> HandlerResult<(store::PersonRecord, PasswordHash)> {
    let Ok(login) = tried.login.parse::<Login>() else {
        app.throttle.attempt_without_login(address).map_err(too_many_sign_ins)?;
        return Err(wrong_credentials());
    };
    let found = app.store.people().by_login(&login).await?;
    let (person, stored): (Option<store::PersonRecord>, Option<PasswordHash>) = found.unzip();
    // The same questions for a login that does not exist.
    let id = person.as_ref().map_or_else(|| PersonId::at(0), |person| person.id);
    let places = [browser, place_of(id, ClientAddress(address))].into_iter().flatten();
    let known = app.store.cookies().known_place(id, places).await?;
    let known_place = known.map(|counter| KnownPlace { counter, is_browser: Some(counter) == browser });
    let origin = AttemptOrigin { address, known_place };
    let requester = if origin.is_known_browser() {
        HashRequester::Account(Actor::Person(id))
    } else {
        app.hash_requester_at(ClientAddress(address))
    };
    let attempt = (&login, origin, tried.password);
    let matches = try_password(app, requester, attempt, stored.clone(), too_many_sign_ins).await?;
    person.zip(stored).filter(|_| matches).ok_or_else(wrong_credentials)
}

/// An account's place that an address is. The machine itself is none: behind a proxy that no setting names, every
/// client has its address.
fn place_of(person: PersonId, ClientAddress(address): ClientAddress) -> Option<SecretHash> {
    let network = network_of(address);
    (!network.is_loopback()).then(|| SecretHash::of_place(person, &network.to_string()))
}

impl App {
    /// The requester of a hash for a client that is not known otherwise.
    pub(in crate::http) fn hash_requester_at(&self, ClientAddress(address): ClientAddress) -> HashRequester {
        let network = network_of(address);
        if self.throttle.knows_network_of(address) {
            HashRequester::KnownNetwork(network)
        } else {
            HashRequester::StrangeNetwork(network)
        }
    }
}

/// Counts an attempt, and says whether the password matches. An attempt without a place in the queue does not count.
/// `too_many` is the refusal of one that has to wait.
async fn try_password(
    app: &App,
    requester: HashRequester,
    (login, origin, password): (&Login, AttemptOrigin, String),
    stored: Option<PasswordHash>,
    too_many: fn(Duration) -> ProblemResponse,
) -> HandlerResult<bool> {
    let Some(password) = Password::attempt(password) else {
        app.throttle.attempt_without_login(origin.address).map_err(too_many)?;
        return Ok(false);
    };
    let place = app.password_hasher.take_place(requester)?;
    let attempt = app.throttle.attempt(login, origin).map_err(too_many)?;
    let matches = place.matches(password, stored).await?;
    if matches {
        attempt.succeeded();
    }
    Ok(matches)
}

fn wrong_credentials() -> ProblemResponse {
    Refusal::WrongCredentials.with("Check login and password. An administrator can send you a link for a new password.")
}

/// Refuses a password that was verified, but was replaced before it could be used.
fn changed_meanwhile(error: StoreError) -> ProblemResponse {
    match error {
        StoreError::NotFound { .. } => wrong_credentials(),
        other => other.into(),
    }
}

/// The refusal of an attempt that has to wait.
pub fn too_many_attempts(wait: Duration) -> ProblemResponse {
    let seconds = wait.as_secs() + 1;
    let reason = format!("There were too many failed attempts. Try again in {seconds} s.");
    Refusal::TooMany.with(reason).member("wait_s", seconds).header(header::RETRY_AFTER, seconds)
}

/// The refusal of a sign-in that has to wait, with the ways in that need not wait.
fn too_many_sign_ins(wait: Duration) -> ProblemResponse {
    let seconds = wait.as_secs() + 1;
    Refusal::TooMany
        .with(format!(
            "There were too many failed attempts to sign in. Try again in {seconds} s. A browser that has signed in to \
             the account before does not wait for the attempts of others, and a link for a new password, from an \
             administrator, works at once."
        ))
        .member("sign_in_wait_s", seconds)
        .header(header::RETRY_AFTER, seconds)
}

fn set_cookie_header(cookie: HeaderValue) -> AppendHeaders<[(header::HeaderName, HeaderValue); 1]> {
    AppendHeaders([(header::SET_COOKIE, cookie)])
}
