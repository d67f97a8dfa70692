//! Who can sign in: for administrators, but for one's own account.

use axum::extract::State;
use axum::http::StatusCode;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::auth::password;
use super::auth::signed_in::{Administrator, SignedIn};
use super::error::{Answer, Problem};
use super::read::{At, Json, Params, named};
use super::show::{Created, Page, Paging, Time};
use super::state::App;
use crate::domain::role::Role;
use crate::domain::scope::Actor;
use crate::domain::secret::Password;
use crate::domain::text::{Key, Login, Name};
use crate::ids::{BoxId, GroupId, PersonId, TraineeId};
use crate::store::{self, PersonChange};

/// Somebody who can sign in.
#[derive(Debug, Serialize, ToSchema)]
pub struct Person {
    id: PersonId,
    login: Login,
    name: Name,
    role: Role,
    /// The trainee that they are, if they train.
    trainee: Option<TraineeId>,
    created_at: Time,
}

impl From<store::Person> for Person {
    fn from(person: store::Person) -> Self {
        let store::Person { id, login, name, role, trainee_id, created_at_ms } = person;
        Self { id, login, name, role, trainee: trainee_id, created_at: Time(created_at_ms) }
    }
}

/// List the accounts
#[utoipa::path(get, path = "/people", tag = "people", params(Paging), responses((status = OK, body = Page<Person>)))]
pub async fn list(
    State(app): State<App>,
    by: Administrator,
    Params(paging): Params<Paging>,
) -> Answer<Json<Page<Person>>> {
    let page = paging.request(app.settings.page_items)?;
    let people = app.store.people().list(&by.scope, &page).await?;
    Ok(Json(Page::of(people, Person::from)))
}

/// An account to be made.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewPerson {
    login: Login,
    name: Name,
    /// `administrator`, `instructor` or `trainee`; programs beside a box get tokens instead.
    role: Role,
    /// 10 to 256 bytes.
    #[schema(format = Password, min_length = 10, max_length = 256)]
    password: String,
    /// The trainee that they are, by id or code: for the role `trainee`, and only then.
    trainee: Option<Key>,
    /// The groups that an instructor teaches.
    #[serde(default)]
    groups: Vec<GroupId>,
}

/// Let somebody in
#[utoipa::path(post, path = "/people", tag = "people", request_body = NewPerson, responses((status = CREATED, body = Person)))]
pub async fn create(State(app): State<App>, by: Administrator, Json(new): Json<NewPerson>) -> Answer<Created<Person>> {
    let (trainee, groups) = check(&app, &by, &new).await?;
    let NewPerson { login, name, role, password, .. } = new;
    let password = password::hash(Password::new(password)?).await?;
    let new = store::NewPerson { login, name, role, password, trainee };
    let person = app.store.people().create(&by.scope, new).await?;
    for mut group in groups {
        group.members.instructors.push(person.id);
        app.store.groups().set_members(&by.scope, group.id, group.members).await?;
    }
    Ok(Created { location: format!("/api/v1/people/{}", person.id), made: person.into() })
}

/// What a new account refers to, all of which must be there before anything is made.
async fn check(app: &App, by: &Administrator, new: &NewPerson) -> Answer<(Option<TraineeId>, Vec<store::Group>)> {
    if new.role == Role::Agent {
        return Err(Problem::invalid("role", "an agent is a program: make a token for it"));
    }
    if (new.role == Role::Trainee) != new.trainee.is_some() {
        return Err(Problem::invalid("trainee", "a trainee's account, and only that, names the trainee that it is of"));
    }
    let trainee = match &new.trainee {
        Some(key) => Some(app.store.trainees().get(&by.scope, key).await.map_err(named("trainee"))?.id),
        None => None,
    };
    let mut groups = Vec::new();
    for id in &new.groups {
        groups.push(app.store.groups().get(&by.scope, *id).await.map_err(named("groups"))?);
    }
    Ok((trainee, groups))
}

/// Changes to an account; what is absent stays.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Change {
    login: Option<Login>,
    name: Option<Name>,
    /// `administrator` or `instructor`. Another role than before signs every browser of the account out.
    role: Option<Role>,
    /// A new password signs every browser of the account out.
    #[schema(format = Password, min_length = 10, max_length = 256)]
    password: Option<String>,
}

/// Change an account
#[utoipa::path(patch, path = "/people/{id}", tag = "people", params(("id" = String, Path, description = "id")),
    request_body = Change, responses((status = OK, body = Person)))]
pub async fn change(
    State(app): State<App>,
    by: Administrator,
    at: At,
    Json(change): Json<Change>,
) -> Answer<Json<Person>> {
    let Change { login, name, role, password } = change;
    let (id, password) = (at.id()?, password.map(Password::new).transpose()?);
    let person = app.store.people().change(&by.scope, id, PersonChange { login, name, role }).await?;
    if let Some(password) = password {
        app.store.people().set_password(&by.scope, id, password::hash(password).await?).await?;
    }
    Ok(Json(person.into()))
}

/// Shut somebody out: account, browsers and tokens
#[utoipa::path(delete, path = "/people/{id}", tag = "people", params(("id" = String, Path, description = "id")),
    responses((status = NO_CONTENT)))]
pub async fn delete(State(app): State<App>, by: Administrator, at: At) -> Answer<StatusCode> {
    app.store.people().delete(&by.scope, at.id()?).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Oneself.
#[derive(Debug, Serialize, ToSchema)]
pub struct Me {
    /// The person's id; a box's agent has none.
    id: Option<PersonId>,
    login: Option<Login>,
    name: Option<Name>,
    /// The role that this sign-in or token carries.
    role: Role,
    /// The trainee that one is, if one trains.
    trainee: Option<TraineeId>,
    /// The box that an agent stands beside.
    #[serde(rename = "box")]
    of_box: Option<BoxId>,
}

/// Who am I?
#[utoipa::path(get, path = "/me", tag = "sign-in", responses((status = OK, body = Me)))]
pub async fn me(State(app): State<App>, who: SignedIn) -> Answer<Json<Me>> {
    let role = who.scope.role();
    let me = match who.scope.actor() {
        Actor::Person(id) => {
            let store::Person { id, login, name, trainee_id, .. } = app.store.people().get(&who.scope, id).await?;
            Me { id: Some(id), login: Some(login), name: Some(name), role, trainee: trainee_id, of_box: None }
        }
        Actor::Agent(of) => Me { id: None, login: None, name: None, role, trainee: None, of_box: Some(of) },
        Actor::Service => return Err(Problem::not_found()),
    };
    Ok(Json(me))
}
