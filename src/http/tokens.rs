//! Access tokens for programs. A token is shown once, when it is created; only its hash is stored. What a token makes
//! does not outlast it.

use axum::extract::State;
use axum::http::StatusCode;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::auth::signed_in::Administrator;
use super::error::{HandlerResult, ProblemResponse};
use super::read::{Json, PathKey, reference_problem};
use super::show::{Created, PageResponse, Time};
use super::state::App;
use crate::domain::role::Role;
use crate::domain::secret::Secret;
use crate::domain::text::{Key, Name};
use crate::domain::token_expiry::TokenExpiry;
use crate::ids::{BoxId, PersonId, TokenId};
use crate::store::{self, ActsAs};

/// A token without its secret, which is not stored.
#[derive(Debug, Serialize, ToSchema)]
pub struct TokenResponse {
    id: TokenId,
    name: Name,
    role: Role,
    /// The person that the token acts for; `null` for an agent.
    person: Option<PersonId>,
    /// The agent's box; `null` for other roles.
    #[serde(rename = "box")]
    of_box: Option<BoxId>,
    /// The token that made it, and that withdraws it when it is deleted; `null` if a person made it who was signed in, or
    /// a command.
    made_with: Option<TokenId>,
    created_at: Time,
    expires_at: Option<Time>,
    /// Time of its last request, to the minute.
    last_used_at: Option<Time>,
}

impl From<store::TokenRecord> for TokenResponse {
    fn from(token: store::TokenRecord) -> Self {
        Self {
            id: token.id,
            name: token.name,
            role: token.role,
            person: token.person_id,
            of_box: token.box_id,
            made_with: token.made_with,
            created_at: Time(token.created_at_ms),
            expires_at: token.expires_at_ms.map(Time),
            last_used_at: token.last_used_at_ms.map(Time),
        }
    }
}

/// List the tokens
#[utoipa::path(get, path = "/tokens", tag = "tokens", responses((status = OK, body = PageResponse<TokenResponse>)))]
pub async fn list(State(app): State<App>, by: Administrator) -> HandlerResult<Json<PageResponse<TokenResponse>>> {
    let tokens = app.store.tokens().list(&by.scope).await?;
    Ok(Json(PageResponse::whole(tokens.into_iter().map(TokenResponse::from))))
}

/// A token to create.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewTokenRequest {
    /// Purpose of the token, for people.
    name: Name,
    /// `agent` for the program beside a box; `administrator` or `instructor` for a program that acts for the caller.
    role: Role,
    /// The agent's box, by id or code; required for the role `agent`, not allowed for others.
    #[serde(rename = "box")]
    of_box: Option<Key>,
    /// Time of expiry, RFC 3339, within ten years, or `never`; default: a year from now. With a token, at the latest
    /// the end of that token, which is the default then if it comes before a year.
    expires_at: Option<String>,
}

/// A new token with its secret, which no other answer contains.
#[derive(Serialize, ToSchema)]
pub struct MadeToken {
    #[serde(flatten)]
    about: TokenResponse,
    /// The secret: the program sends it as `Authorization: Bearer …`. It cannot be read again, so store it now.
    #[schema(example = "trc_…")]
    token: String,
}

/// Create a token
///
/// A token that is created with another token ends with that one at the latest, and is deleted together with it.
#[utoipa::path(post, path = "/tokens", tag = "tokens", request_body = NewTokenRequest,
    responses((status = CREATED, body = MadeToken)))]
pub async fn create(
    State(app): State<App>,
    by: Administrator,
    Json(new): Json<NewTokenRequest>,
) -> HandlerResult<Created<MadeToken>> {
    let acts_as = acts_as(&app, &by, &new).await?;
    let expiry = new.expires_at.as_deref().map(str::parse::<TokenExpiry>).transpose()?;
    let latest_ms = by.scope.token().and_then(|token| token.expires_at_ms);
    let expires_at_ms = TokenExpiry::end_ms(expiry, latest_ms, app.clock.now_ms())?;
    let secret = Secret::random();
    let new = store::NewToken { name: new.name, acts_as, expires_at_ms, secret: secret.hash() };
    let token = app.store.tokens().create(&by.scope, new).await?;
    let location = format!("/api/v1/tokens/{}", token.id);
    Ok(Created { location, made: MadeToken { about: token.into(), token: secret.as_token() } })
}

async fn acts_as(app: &App, by: &Administrator, new: &NewTokenRequest) -> HandlerResult<ActsAs> {
    match (new.role, &new.of_box) {
        (Role::Agent, Some(key)) => {
            let of = app.store.boxes().get(&by.scope, key).await.map_err(reference_problem("box"))?;
            Ok(ActsAs::Agent(of.id))
        }
        (Role::Agent, None) => {
            Err(ProblemResponse::invalid("box", "is required for the role agent; give the box's id or code"))
        }
        (_, Some(_)) => Err(ProblemResponse::invalid("box", "is allowed only for the role agent")),
        (Role::Trainee, None) => Err(ProblemResponse::invalid("role", "expected administrator, instructor or agent")),
        (role, None) => Ok(ActsAs::Person(by.scope.person().ok_or_else(ProblemResponse::not_found)?, role)),
    }
}

/// Delete a token
///
/// Programs that use it lose access at once, and so do those with a token that it made. With a token, only this token
/// and those that it made can be deleted.
#[utoipa::path(delete, path = "/tokens/{id}", tag = "tokens", params(("id" = String, Path, description = "id")),
    responses((status = NO_CONTENT)))]
pub async fn delete(State(app): State<App>, by: Administrator, at: PathKey) -> HandlerResult<StatusCode> {
    app.store.tokens().delete(&by.scope, at.id()?).await?;
    Ok(StatusCode::NO_CONTENT)
}
