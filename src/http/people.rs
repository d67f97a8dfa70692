//! Accounts. Administrators manage them; every caller can read the own account.

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::auth::password::HashRequester;
use super::auth::presented::PresentedCredential;
use super::auth::signed_in::{Administrator, Identified, require_sign_in};
use super::error::{HandlerResult, ProblemResponse};
use super::read::{Json, Params, PathKey, reference_problem};
use super::show::{Created, PageResponse, Paging, Time};
use super::state::App;
use crate::domain::password_state::PasswordState;
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
    /// Who chose the password, and whether it must be changed.
    password: PasswordState,
    created_at: Time,
}

impl From<store::PersonRecord> for PersonResponse {
    fn from(person: store::PersonRecord) -> Self {
        let store::PersonRecord { id, login, name, role, trainee_id, password_state, created_at_ms } = person;
        let (password, created_at) = (password_state, Time(created_at_ms));
        Self { id, login, name, role, trainee: trainee_id, password, created_at }
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
    let page = paging.request("people", app.settings.page_items)?;
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
    /// 10 to 256 bytes, at least 5 different characters. Without it, the person chooses one with a link
    /// (`password-links`), and cannot sign in before.
    #[schema(format = Password, min_length = 10, max_length = 256)]
    password: Option<String>,
    /// With a password: the person must change it at the first sign-in, before anything else.
    #[serde(default)]
    must_change_password: bool,
    /// The trainee whose account it is, by id or code: required for the role `trainee`, not allowed for others.
    trainee: Option<Key>,
    /// The groups that the new instructor teaches.
    #[serde(default)]
    groups: Vec<GroupId>,
}

/// Create an account
///
/// A token does not suffice to create an administrator.
#[utoipa::path(post, path = "/people", tag = "people", request_body = NewPersonRequest,
    responses((status = CREATED, body = PersonResponse)))]
pub async fn create(
    State(app): State<App>,
    by: Administrator,
    Json(new): Json<NewPersonRequest>,
) -> HandlerResult<Created<PersonResponse>> {
    if new.role == Role::Administrator {
        require_sign_in(&by.scope)?;
    }
    let (trainee, groups) = resolve_references(&app, &by, &new).await?;
    let NewPersonRequest { login, name, role, password, must_change_password, .. } = new;
    refuse_demand_without_password(must_change_password, password.as_deref())?;
    let chosen = password.map(Password::new).transpose()?;
    let place = app.password_hasher.take_place(HashRequester::Account(by.scope.actor()))?;
    let (password, password_state) = match chosen {
        Some(chosen) => (place.hash(chosen).await?, state_of(must_change_password)),
        None => (place.unmatchable().await?, PasswordState::Missing),
    };
    let new = store::NewPerson { login, name, role, password, password_state, trainee };
    let person = app.store.people().create(&by.scope, new).await?;
    for mut group in groups {
        group.members.instructors.push(person.id);
        app.store.groups().set_members(&by.scope, group.id, group.members).await?;
    }
    Ok(Created { location: format!("/api/v1/people/{}", person.id), made: person.into() })
}

/// Refuses to let a password be changed that the same request does not set.
fn refuse_demand_without_password(must_change_password: bool, password: Option<&str>) -> HandlerResult<()> {
    if must_change_password && password.is_none() {
        return Err(ProblemResponse::invalid("must_change_password", "is allowed only together with `password`"));
    }
    Ok(())
}

/// The state of a password that an administrator sets.
fn state_of(must_change_password: bool) -> PasswordState {
    if must_change_password { PasswordState::ChangeRequired } else { PasswordState::Own }
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
    /// `administrator` or `instructor`. A new role signs the account out in every browser, and withdraws the tokens that
    /// exceed it and the links for passwords that a former administrator made. The account of a trainee keeps its role.
    role: Option<Role>,
    /// A new password, 10 to 256 bytes, at least 5 different characters. It signs the account out in every browser.
    #[schema(format = Password, min_length = 10, max_length = 256)]
    password: Option<String>,
    /// With a password: the person must change it at the next sign-in, before anything else.
    #[serde(default)]
    must_change_password: bool,
    /// Keep the account's tokens when its password changes. Otherwise they are withdrawn, and so are those that they
    /// made, for example for the agents of boxes.
    #[serde(default)]
    keep_tokens: bool,
}

/// Change an account
///
/// A token does not suffice to make an administrator, or to change the login, role or password of one.
#[utoipa::path(patch, path = "/people/{id}", tag = "people", params(("id" = String, Path, description = "id")),
    request_body = PersonChangeRequest, responses((status = OK, body = PersonResponse)))]
pub async fn change(
    State(app): State<App>,
    by: Administrator,
    at: PathKey,
    Json(change): Json<PersonChangeRequest>,
) -> HandlerResult<Json<PersonResponse>> {
    let PersonChangeRequest { login, name, role, password, must_change_password, keep_tokens } = change;
    refuse_demand_without_password(must_change_password, password.as_deref())?;
    let (id, password) = (at.id()?, password.map(Password::new).transpose()?);
    let password = match password {
        Some(chosen) => {
            let place = app.password_hasher.take_place(HashRequester::Account(by.scope.actor()))?;
            Some((place.hash(chosen).await?, state_of(must_change_password)))
        }
        None => None,
    };
    let is_new_password = password.is_some();
    let change = PersonChange { login, name, role, password, keep_tokens };
    let person = app.store.people().change(&by.scope, id, change).await?;
    if is_new_password {
        app.throttle.forget(&person.login);
    }
    Ok(Json(person.into()))
}

/// Delete an account
///
/// Also signs the person out in every browser, and deletes the person's tokens, the tokens that these made, for example
/// for the agents of boxes, and the links for passwords that the person made. A token does not suffice to delete an
/// administrator.
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
    /// True if this sign-in may only change the password: every other request is refused as
    /// `password-change-required`.
    must_change_password: bool,
    /// False for an account that signs in with the provider only, and for an agent.
    has_password: bool,
    /// True if this browser was signed in with the provider of single sign-on: sign out with
    /// `POST single-sign-on/sign-out`.
    by_single_sign_on: bool,
}

/// Read the own account
#[utoipa::path(get, path = "/me", tag = "sign-in", responses((status = OK, body = Me)))]
pub async fn me(State(app): State<App>, by: Identified, headers: HeaderMap) -> HandlerResult<Json<Me>> {
    let Identified { scope, must_change_password } = by;
    let role = scope.role();
    let me = match scope.actor() {
        Actor::Person(id) => {
            let person = app.store.people().get(&scope, id).await?;
            let by_single_sign_on = match PresentedCredential::in_headers(&headers, &app.settings.base_path) {
                PresentedCredential::Cookie(secret) => app.store.identities().is_provider_sign_in(secret).await?,
                PresentedCredential::Token(_) | PresentedCredential::Nothing => false,
            };
            let has_password = person.password_state != PasswordState::Missing;
            let store::PersonRecord { id, login, name, trainee_id: trainee, .. } = person;
            let (id, login, name, of_box) = (Some(id), Some(login), Some(name), None);
            Me { id, login, name, role, trainee, of_box, must_change_password, has_password, by_single_sign_on }
        }
        Actor::Agent(of) => {
            let (id, login, name, trainee) = (None, None, None, None);
            let (has_password, by_single_sign_on, of_box) = (false, false, Some(of));
            Me { id, login, name, role, trainee, of_box, must_change_password, has_password, by_single_sign_on }
        }
        Actor::Service => return Err(ProblemResponse::not_found()),
    };
    Ok(Json(me))
}
