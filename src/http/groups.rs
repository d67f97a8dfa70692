//! Which instructors teach which trainees. Administrators change groups; instructors see their own.

use axum::extract::State;
use axum::http::StatusCode;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::auth::signed_in::{Administrator, Staff};
use super::error::Answer;
use super::read::{At, Json};
use super::show::{Created, Page, Time};
use super::state::App;
use crate::domain::text::Name;
use crate::ids::GroupId;
use crate::store::{self, Members};

/// A training group.
#[derive(Debug, Serialize, ToSchema)]
pub struct Group {
    id: GroupId,
    name: Name,
    #[serde(flatten)]
    members: Members,
    created_at: Time,
}

impl From<store::Group> for Group {
    fn from(group: store::Group) -> Self {
        let store::Group { id, name, created_at_ms, members } = group;
        Self { id, name, members, created_at: Time(created_at_ms) }
    }
}

/// List the groups that one sees
#[utoipa::path(get, path = "/groups", tag = "groups", responses((status = OK, body = Page<Group>)))]
pub async fn list(State(app): State<App>, by: Staff) -> Answer<Json<Page<Group>>> {
    let groups = app.store.groups().list(&by.scope).await?;
    Ok(Json(Page::whole(groups.into_iter().map(Group::from))))
}

/// A group to be made.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewGroup {
    name: Name,
}

/// Make an empty group
#[utoipa::path(post, path = "/groups", tag = "groups", request_body = NewGroup, responses((status = CREATED, body = Group)))]
pub async fn create(State(app): State<App>, by: Administrator, Json(new): Json<NewGroup>) -> Answer<Created<Group>> {
    let group = app.store.groups().create(&by.scope, new.name).await?;
    Ok(Created { location: format!("/api/v1/groups/{}", group.id), made: group.into() })
}

/// Read one group
#[utoipa::path(get, path = "/groups/{id}", tag = "groups", params(("id" = String, Path, description = "id")),
    responses((status = OK, body = Group)))]
pub async fn get(State(app): State<App>, by: Staff, at: At) -> Answer<Json<Group>> {
    let group = app.store.groups().get(&by.scope, at.id()?).await?;
    Ok(Json(group.into()))
}

/// Say who is in a group, all at once
#[utoipa::path(put, path = "/groups/{id}/members", tag = "groups", params(("id" = String, Path, description = "id")),
    request_body = Members, responses((status = OK, body = Group)))]
pub async fn set_members(
    State(app): State<App>,
    by: Administrator,
    at: At,
    Json(members): Json<Members>,
) -> Answer<Json<Group>> {
    let group = app.store.groups().set_members(&by.scope, at.id()?, members).await?;
    Ok(Json(group.into()))
}

/// Dissolve a group; its people stay
#[utoipa::path(delete, path = "/groups/{id}", tag = "groups", params(("id" = String, Path, description = "id")),
    responses((status = NO_CONTENT)))]
pub async fn delete(State(app): State<App>, by: Administrator, at: At) -> Answer<StatusCode> {
    app.store.groups().delete(&by.scope, at.id()?).await?;
    Ok(StatusCode::NO_CONTENT)
}
