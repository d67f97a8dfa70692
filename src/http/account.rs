//! The caller's own account: the browsers where it is signed in, and the tokens that act as it.

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use serde::Serialize;
use utoipa::ToSchema;

use super::auth::presented::PresentedCredential;
use super::auth::signed_in::{BySignIn, Member};
use super::error::{HandlerResult, ProblemResponse};
use super::read::{Json, PathKey};
use super::show::{PageResponse, Time};
use super::state::App;
use super::tokens::TokenResponse;
use crate::store;

/// A browser where the account is signed in.
#[derive(Debug, Serialize, ToSchema)]
pub struct SignInEntry {
    id: String,
    /// The browser's name, as it states it; empty if unknown.
    browser: String,
    /// The address that it signed in from; empty if unknown.
    address: String,
    signed_in_at: Time,
    /// Time of its last request, to the minute.
    last_seen_at: Time,
    /// True for the browser that asks.
    is_current: bool,
}

impl From<store::SignInRecord> for SignInEntry {
    fn from(record: store::SignInRecord) -> Self {
        let store::SignInRecord { id, browser, address, created_at_ms, last_seen_at_ms, is_current } = record;
        let (signed_in_at, last_seen_at) = (Time(created_at_ms), Time(last_seen_at_ms));
        Self { id, browser, address, signed_in_at, last_seen_at, is_current }
    }
}

/// List the browsers where the own account is signed in
#[utoipa::path(get, path = "/me/sign-ins", tag = "sign-in",
    responses((status = OK, body = PageResponse<SignInEntry>)))]
pub async fn sign_ins(
    State(app): State<App>,
    by: Member,
    headers: HeaderMap,
) -> HandlerResult<Json<PageResponse<SignInEntry>>> {
    let person = by.scope.person().ok_or_else(ProblemResponse::not_found)?;
    let current = match PresentedCredential::in_headers(&headers, &app.settings.base_path) {
        PresentedCredential::Cookie(secret) => Some(secret),
        PresentedCredential::Token(_) | PresentedCredential::Nothing => None,
    };
    let found = app.store.cookies().of_person(person, current, app.sign_in_lifetime()).await?;
    Ok(Json(PageResponse::whole(found.into_iter().map(SignInEntry::from))))
}

/// Sign out one browser of the own account
///
/// A token does not suffice.
#[utoipa::path(delete, path = "/me/sign-ins/{id}", tag = "sign-in",
    params(("id" = String, Path, description = "id")), responses((status = NO_CONTENT)))]
pub async fn end_sign_in(
    State(app): State<App>,
    BySignIn(by): BySignIn<Member>,
    PathKey(id): PathKey,
) -> HandlerResult<StatusCode> {
    let person = by.scope.person().ok_or_else(ProblemResponse::not_found)?;
    app.store.cookies().end(person, id.as_str().to_owned()).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// List the tokens that act as the own account
#[utoipa::path(get, path = "/me/tokens", tag = "tokens", responses((status = OK, body = PageResponse<TokenResponse>)))]
pub async fn tokens(State(app): State<App>, by: Member) -> HandlerResult<Json<PageResponse<TokenResponse>>> {
    let tokens = app.store.tokens().of_person(&by.scope).await?;
    Ok(Json(PageResponse::whole(tokens.into_iter().map(TokenResponse::from))))
}

/// Delete a token that acts as the own account
///
/// Programs that use it lose access at once, and so do those with a token that it made. With a token, only this token
/// and those that it made can be deleted.
#[utoipa::path(delete, path = "/me/tokens/{id}", tag = "tokens", params(("id" = String, Path, description = "id")),
    responses((status = NO_CONTENT)))]
pub async fn delete_token(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<StatusCode> {
    app.store.tokens().delete_own(&by.scope, at.id()?).await?;
    Ok(StatusCode::NO_CONTENT)
}
