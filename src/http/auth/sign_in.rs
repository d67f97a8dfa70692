//! Sign in, sign out, change the own password.

use std::net::SocketAddr;
use std::time::Duration;

use axum::extract::{ConnectInfo, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{AppendHeaders, IntoResponse};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::password;
use super::presented::{PresentedCredential, clear_cookie, set_cookie};
use super::signed_in::{Member, SignedIn};
use crate::domain::secret::{Password, PasswordHash, Secret};
use crate::domain::text::Login;
use crate::http::error::{HandlerResult, ProblemResponse, Refusal};
use crate::http::people::PersonResponse;
use crate::http::read::Json;
use crate::http::state::App;
use crate::store;

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
}

/// Sign in and receive a cookie
#[utoipa::path(post, path = "/sign-in", tag = "sign-in", request_body = Credentials, security(()),
    responses((status = OK, body = SignInResponse,
            headers(("Set-Cookie" = String,
                    description = "`__Host-trocar`; ends after 30 minutes without a request and after 12 hours at the \
                                   latest")))))]
pub async fn sign_in(
    State(app): State<App>,
    ConnectInfo(peer): ConnectInfo<SocketAddr>,
    headers: HeaderMap,
    Json(tried): Json<Credentials>,
) -> HandlerResult<impl IntoResponse> {
    let attempt = app.throttle.attempt(&tried.login, peer.ip()).map_err(too_many_attempts)?;
    let person = authenticate(&app, tried).await?;
    attempt.succeeded();
    let secret = Secret::random();
    app.store.cookies().create(secret.hash(), &person, app.sign_in_lifetime()).await?;
    if let PresentedCredential::Cookie(before) = PresentedCredential::in_headers(&headers) {
        app.store.cookies().delete_replaced(before).await?;
    }
    tracing::info!(person = %person.id, "signed in");
    Ok((set_cookie_header(set_cookie(&secret)), Json(SignInResponse { person: person.into() })))
}

/// Sign out: invalidates the cookie and removes it from the browser
#[utoipa::path(post, path = "/sign-out", tag = "sign-in", responses((status = NO_CONTENT)))]
pub async fn sign_out(State(app): State<App>, _by: SignedIn, headers: HeaderMap) -> HandlerResult<impl IntoResponse> {
    if let PresentedCredential::Cookie(secret) = PresentedCredential::in_headers(&headers) {
        app.store.cookies().delete(secret).await?;
    }
    Ok((StatusCode::NO_CONTENT, set_cookie_header(clear_cookie())))
}

/// Old and new password.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PasswordChange {
    /// The current password.
    #[schema(format = Password)]
    old: String,
    /// The new password, 10 to 256 bytes.
    #[schema(format = Password, min_length = 10, max_length = 256)]
    new: String,
}

/// Change the own password
///
/// Signs the account out in every browser.
#[utoipa::path(post, path = "/me/password", tag = "sign-in", request_body = PasswordChange,
    responses((status = NO_CONTENT)))]
pub async fn change_password(
    State(app): State<App>,
    ConnectInfo(peer): ConnectInfo<SocketAddr>,
    member: Member,
    Json(change): Json<PasswordChange>,
) -> HandlerResult<StatusCode> {
    let id = member.scope.person().ok_or_else(ProblemResponse::not_found)?;
    let person = app.store.people().get(&member.scope, id).await?;
    let new = Password::new(change.new)?;
    let attempt = app.throttle.attempt(person.login.as_str(), peer.ip()).map_err(too_many_attempts)?;
    authenticate(&app, Credentials { login: person.login.to_string(), password: change.old }).await?;
    attempt.succeeded();
    app.store.people().set_password(&member.scope, id, password::hash(new).await?).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// The account with these credentials. Takes the same time whether the login exists or not.
async fn authenticate(app: &App, tried: Credentials) -> HandlerResult<store::PersonRecord> {
    let found = match tried.login.parse::<Login>() {
        Ok(login) => app.store.people().by_login(&login).await?,
        Err(_) => None,
    };
    let (person, stored): (Option<store::PersonRecord>, Option<PasswordHash>) = found.unzip();
    let password = Password::attempt(tried.password).ok_or_else(wrong_credentials)?;
    match (password::matches(password, stored).await?, person) {
        (true, Some(person)) => Ok(person),
        _ => Err(wrong_credentials()),
    }
}

fn wrong_credentials() -> ProblemResponse {
    Refusal::WrongCredentials.with("Check login and password. An administrator can set a new password.")
}

fn too_many_attempts(wait: Duration) -> ProblemResponse {
    let seconds = wait.as_secs() + 1;
    Refusal::TooMany
        .with(format!("There were too many failed attempts to sign in. Try again in {seconds} s."))
        .header(header::RETRY_AFTER, seconds)
}

fn set_cookie_header(cookie: HeaderValue) -> AppendHeaders<[(header::HeaderName, HeaderValue); 1]> {
    AppendHeaders([(header::SET_COOKIE, cookie)])
}
