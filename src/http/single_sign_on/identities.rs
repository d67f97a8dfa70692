//! Links between accounts here and accounts at the provider.

use axum::extract::State;
use axum::http::StatusCode;
use serde::Serialize;
use utoipa::ToSchema;

use crate::domain::text::Name;
use crate::http::auth::signed_in::{Administrator, BySignIn, Member};
use crate::http::error::{HandlerResult, ProblemResponse};
use crate::http::read::{Json, PathKey};
use crate::http::show::{PageResponse, Time};
use crate::http::state::App;
use crate::ids::{IdentityId, PersonId};
use crate::store;

/// An account at a provider, and the person who signs in with it.
#[derive(Debug, Serialize, ToSchema)]
pub struct IdentityResponse {
    id: IdentityId,
    /// Who signs in with it.
    person: PersonId,
    /// Address of the provider.
    issuer: String,
    /// The account's id at the provider.
    subject: String,
    /// The account's name at the provider, at its last use.
    label: Name,
    /// True if the first sign-in made the account here: its role follows its groups at the provider.
    follows_groups: bool,
    created_at: Time,
    /// Its last sign-in; `null` if there was none.
    last_used_at: Option<Time>,
}

impl From<store::IdentityRecord> for IdentityResponse {
    fn from(record: store::IdentityRecord) -> Self {
        let store::IdentityRecord { id, issuer, subject, person_id, label, follows_groups, .. } = record;
        let (created_at, last_used_at) = (Time(record.created_at_ms), record.last_used_at_ms.map(Time));
        Self { id, person: person_id, issuer, subject, label, follows_groups, created_at, last_used_at }
    }
}

/// List the links between accounts here and at the provider
#[utoipa::path(get, path = "/identities", tag = "people",
    responses((status = OK, body = PageResponse<IdentityResponse>)))]
pub async fn list(State(app): State<App>, by: Administrator) -> HandlerResult<Json<PageResponse<IdentityResponse>>> {
    let found = app.store.identities().list(&by.scope).await?;
    Ok(Json(PageResponse::whole(found.into_iter().map(IdentityResponse::from))))
}

/// Remove a link between an account here and one at the provider
///
/// Ends the sign-ins that were made with it. The account here stays. A token does not suffice.
#[utoipa::path(delete, path = "/identities/{id}", tag = "people", params(("id" = String, Path, description = "id")),
    responses((status = NO_CONTENT)))]
pub async fn remove(
    State(app): State<App>,
    BySignIn(by): BySignIn<Administrator>,
    at: PathKey,
) -> HandlerResult<StatusCode> {
    app.store.identities().remove(&by.scope, at.id()?).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// List the accounts at the provider that sign in to the own account
#[utoipa::path(get, path = "/me/identities", tag = "sign-in",
    responses((status = OK, body = PageResponse<IdentityResponse>)))]
pub async fn own(State(app): State<App>, by: Member) -> HandlerResult<Json<PageResponse<IdentityResponse>>> {
    let person = by.scope.person().ok_or_else(ProblemResponse::not_found)?;
    let found = app.store.identities().of_person(&by.scope, person).await?;
    Ok(Json(PageResponse::whole(found.into_iter().map(IdentityResponse::from))))
}

/// Remove a link of the own account
///
/// Ends the sign-ins that were made with it. Refused if the account has no password. A token does not suffice.
#[utoipa::path(delete, path = "/me/identities/{id}", tag = "sign-in",
    params(("id" = String, Path, description = "id")), responses((status = NO_CONTENT)))]
pub async fn remove_own(
    State(app): State<App>,
    BySignIn(by): BySignIn<Member>,
    at: PathKey,
) -> HandlerResult<StatusCode> {
    app.store.identities().remove_own(&by.scope, at.id()?).await?;
    Ok(StatusCode::NO_CONTENT)
}
