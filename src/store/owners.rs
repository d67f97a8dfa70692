//! The groups that own boxes, tasks and course plans: their instructors may change them. The store reads the owners with
//! each record, limited to the groups that the scope sees: for an instructor, these are the groups that give the right.

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::Scope;
use super::error::{StoreError, StoreResult, missing, not_found};
use super::visibility::BindScope;
use crate::ids::{BoxId, CourseId, GroupId, TaskId};

/// Something that groups own.
#[derive(Clone, Copy, Debug)]
pub(super) enum OwnedThing {
    Box(BoxId),
    Task(TaskId),
    Course(CourseId),
}

/// The groups that the scope sees.
const SELECT_OWN_GROUPS: &str = "
    SELECT id FROM training_group
    WHERE $1 = 'administrator' OR id IN (SELECT group_id FROM group_instructor WHERE person_id = $2)";

const DELETE_VISIBLE_OWNERS: &str = "
    DELETE FROM ownership
    WHERE thing_id = $3
      AND ($1 = 'administrator' OR group_id IN (SELECT group_id FROM group_instructor WHERE person_id = $2))";

const INSERT_OWNERS: &str = "
    INSERT INTO ownership (group_id, box_id, task_id, course_id)
    SELECT value, $2, $3, $4 FROM json_each($1) WHERE true
    ON CONFLICT DO NOTHING";

/// Refuses a caller who may not change something with these owners. `what` names the attempt: `changing this box`.
pub(super) fn require_owner(scope: &Scope, owners: &[GroupId], what: &'static str) -> StoreResult<()> {
    match scope.may_change(owners) {
        true => Ok(()),
        false => Err(StoreError::Forbidden { what, whom: "administrators and the instructors of its groups" }),
    }
}

/// Gives a new thing its owners: the named groups, by default all groups of the instructor who makes it.
pub(super) async fn insert(
    tx: &mut SqliteConnection,
    scope: &Scope,
    thing: OwnedThing,
    named: Option<Vec<GroupId>>,
) -> StoreResult<()> {
    let own = own_groups(tx, scope).await?;
    let owners = match named {
        Some(named) => visible(&own, named)?,
        None if scope.is_administrator() => Vec::new(),
        None => own,
    };
    if owners.is_empty() && !scope.may_make_unowned() {
        return Err(StoreError::refused(
            "it needs a group that you teach: name one of your groups, or ask an administrator to add you to one",
        ));
    }
    insert_owners(tx, thing, owners).await
}

/// Replaces those owners that the scope sees.
pub(super) async fn replace(
    tx: &mut SqliteConnection,
    scope: &Scope,
    thing: OwnedThing,
    named: Vec<GroupId>,
) -> StoreResult<()> {
    let owners = visible(&own_groups(tx, scope).await?, named)?;
    if owners.is_empty() && !scope.may_make_unowned() {
        return Err(StoreError::refused("keep at least one of your groups: otherwise you could not change it again"));
    }
    sqlx::query(DELETE_VISIBLE_OWNERS).bind_scope(scope).bind(thing.id()).execute(&mut *tx).await?;
    insert_owners(tx, thing, owners).await
}

async fn own_groups(tx: &mut SqliteConnection, scope: &Scope) -> StoreResult<Vec<GroupId>> {
    Ok(sqlx::query_scalar(SELECT_OWN_GROUPS).bind_scope(scope).fetch_all(tx).await?)
}

/// The named groups, if the scope sees all of them.
fn visible(own: &[GroupId], named: Vec<GroupId>) -> StoreResult<Vec<GroupId>> {
    if named.iter().all(|group| own.contains(group)) { Ok(named) } else { Err(not_found("groups")) }
}

async fn insert_owners(tx: &mut SqliteConnection, thing: OwnedThing, owners: Vec<GroupId>) -> StoreResult<()> {
    let (of_box, task, course) = match thing {
        OwnedThing::Box(id) => (Some(id), None, None),
        OwnedThing::Task(id) => (None, Some(id), None),
        OwnedThing::Course(id) => (None, None, Some(id)),
    };
    let insert = sqlx::query(INSERT_OWNERS).bind(Json(owners)).bind(of_box).bind(task).bind(course);
    insert.execute(tx).await.map_err(missing("groups"))?;
    Ok(())
}

impl OwnedThing {
    fn id(self) -> String {
        match self {
            OwnedThing::Box(id) => id.to_string(),
            OwnedThing::Task(id) => id.to_string(),
            OwnedThing::Course(id) => id.to_string(),
        }
    }
}
