//! Accounts. Administrators manage them; every caller can read the own account.

use axum::extract::State;
use axum::http::StatusCode;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::auth::password;
use super::auth::signed_in::{Administrator, SignedIn};
use super::error::{HandlerResult, ProblemResponse};
use super::read::{Json, Params, PathKey, reference_problem};
use super::show::{Created, PageResponse, Paging, Time};
use super::state::App;
use crate::domain::role::Role;
use crate::domain::scope::Actor;
use crate::domain::secret::Password;
use crate::domain::text::{Key, Login, Name};
use crate::ids::{BoxId, GroupId, PersonId, TraineeId};
use crate::store::{self, PersonChange};

/// An account of a person.
#[derive(Debug, Serialize, ToSchema)]
pub struct PersonResponse {
    id: PersonId,
    login: Login,
    name: Name,
    role: Role,
    /// The trainee whose account this is; `null` for staff.
    trainee: Option<TraineeId>,
    created_at: Time,
}

impl From<store::PersonRecord> for PersonResponse {
    fn from(person: store::PersonRecord) -> Self {
        let store::PersonRecord { id, login, name, role, trainee_id, created_at_ms } = person;
        Self { id, login, name, role, trainee: trainee_id, created_at: Time(created_at_ms) }
    }
}

/// List the accounts
#[utoipa::path(get, path = "/people", tag = "people", params(Paging),
    responses((status = OK, body = PageResponse<PersonResponse>)))]
pub async fn list(
    State(app): State<App>,
    by: Administrator,
    Params(paging): Params<Paging>,
) -> HandlerResult<Json<PageResponse<PersonResponse>>> {
    let page = paging.request(app.settings.page_items)?;
    let people = app.store.people().list(&by.scope, &page).await?;
    Ok(Json(PageResponse::of(people, PersonResponse::from)))
}

/// An account to create.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewPersonRequest {
    login: Login,
    name: Name,
    /// `administrator`, `instructor` or `trainee`. The agent of a box gets a token instead of an account.
    role: Role,
    /// 10 to 256 bytes.
    #[schema(format = Password, min_length = 10, max_length = 256)]
    password: String,
    /// The trainee whose account it is, by id or code: required for the role `trainee`, not allowed for others.
    trainee: Option<Key>,
    /// The groups that the new instructor teaches.
    #[serde(default)]
    groups: Vec<GroupId>,
}

/// Create an account
#[utoipa::path(post, path = "/people", tag = "people", request_body = NewPersonRequest,
    responses((status = CREATED, body = PersonResponse)))]
pub async fn create(
    State(app): State<App>,
    by: Administrator,
    Json(new): Json<NewPersonRequest>,
) -> HandlerResult<Created<PersonResponse>> {
    let (trainee, groups) = resolve_references(&app, &by, &new).await?;
    let NewPersonRequest { login, name, role, password, .. } = new;
    let password = password::hash(Password::new(password)?).await?;
    let new = store::NewPerson { login, name, role, password, trainee };
    let person = app.store.people().create(&by.scope, new).await?;
    for mut group in groups {
        group.members.instructors.push(person.id);
        app.store.groups().set_members(&by.scope, group.id, group.members).await?;
    }
    Ok(Created { location: format!("/api/v1/people/{}", person.id), made: person.into() })
}

/// The trainee and the groups that a new account refers to. All must exist before anything is created.
async fn resolve_references(
    app: &App,
    by: &Administrator,
    new: &NewPersonRequest,
) -> HandlerResult<(Option<TraineeId>, Vec<store::GroupRecord>)> {
    if new.role == Role::Agent {
        return Err(ProblemResponse::invalid("role", "an agent is a program; create a token for it"));
    }
    if (new.role == Role::Trainee) != new.trainee.is_some() {
        return Err(ProblemResponse::invalid(
            "trainee",
            "is required for the role trainee, and not allowed for other roles",
        ));
    }
    let trainee = match &new.trainee {
        Some(key) => Some(app.store.trainees().get(&by.scope, key).await.map_err(reference_problem("trainee"))?.id),
        None => None,
    };
    let mut groups = Vec::new();
    for id in &new.groups {
        groups.push(app.store.groups().get(&by.scope, *id).await.map_err(reference_problem("groups"))?);
    }
    Ok((trainee, groups))
}

/// Changes to an account; absent fields stay as they are.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PersonChangeRequest {
    login: Option<Login>,
    name: Option<Name>,
    /// `administrator` or `instructor`. A new role signs the account out in every browser.
    role: Option<Role>,
    /// A new password, 10 to 256 bytes. It signs the account out in every browser.
    #[schema(format = Password, min_length = 10, max_length = 256)]
    password: Option<String>,
    /// Keep the account's tokens when its password changes. Otherwise they are withdrawn.
    #[serde(default)]
    keep_tokens: bool,
}

/// Change an account
#[utoipa::path(patch, path = "/people/{id}", tag = "people", params(("id" = String, Path, description = "id")),
    request_body = PersonChangeRequest, responses((status = OK, body = PersonResponse)))]
pub async fn change(
    State(app): State<App>,
    by: Administrator,
    at: PathKey,
    Json(change): Json<PersonChangeRequest>,
) -> HandlerResult<Json<PersonResponse>> {
    let PersonChangeRequest { login, name, role, password, keep_tokens } = change;
    let (id, password) = (at.id()?, password.map(Password::new).transpose()?);
    let person = app.store.people().change(&by.scope, id, PersonChange { login, name, role }).await?;
    if let Some(password) = password {
        app.store.people().set_password(&by.scope, id, password::hash(password).await?, keep_tokens).await?;
        app.throttle.forget(&person.login);
    }
    Ok(Json(person.into()))
}

/// Delete an account
///
/// Also signs the person out in every browser and deletes the person's tokens.
#[utoipa::path(delete, path = "/people/{id}", tag = "people", params(("id" = String, Path, description = "id")),
    responses((status = NO_CONTENT)))]
pub async fn delete(State(app): State<App>, by: Administrator, at: PathKey) -> HandlerResult<StatusCode> {
    app.store.people().delete(&by.scope, at.id()?).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// The caller: a person, or the agent of a box.
#[derive(Debug, Serialize, ToSchema)]
pub struct Me {
    /// The person's id; a box's agent has none.
    id: Option<PersonId>,
    login: Option<Login>,
    name: Option<Name>,
    /// The role that this sign-in or token carries.
    role: Role,
    /// The trainee whose account this is; `null` for staff and agents.
    trainee: Option<TraineeId>,
    /// The agent's box; `null` for people.
    #[serde(rename = "box")]
    of_box: Option<BoxId>,
}

/// Read the own account
#[utoipa::path(get, path = "/me", tag = "sign-in", responses((status = OK, body = Me)))]
pub async fn me(State(app): State<App>, by: SignedIn) -> HandlerResult<Json<Me>> {
    let role = by.scope.role();
    let me = match by.scope.actor() {
        Actor::Person(id) => {
            let store::PersonRecord { id, login, name, trainee_id, .. } = app.store.people().get(&by.scope, id).await?;
            Me { id: Some(id), login: Some(login), name: Some(name), role, trainee: trainee_id, of_box: None }
        }
        Actor::Agent(of) => Me { id: None, login: None, name: None, role, trainee: None, of_box: Some(of) },
        Actor::Service => return Err(ProblemResponse::not_found()),
    };
    Ok(Json(me))
}
