//! Training groups: which instructors teach which trainees. Administrators change groups; instructors see their own, and
//! make new ones.

use serde::{Deserialize, Serialize};
use sqlx::sqlite::SqliteConnection;

use super::audit::note;
use super::courses::GroupCoursePlan;
use super::error::{StoreResult, in_use, missing, not_found, taken};
use super::visibility::{BindScope, require_administrator, require_staff};
use super::{Scope, Store};
use crate::domain::role::Role;
use crate::domain::text::Name;
use crate::ids::{CourseId, GroupId, PersonId, TraineeId};
use crate::time::Day;

/// Access to the training groups.
pub struct GroupStore<'s>(pub(super) &'s Store);

/// A training group.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GroupRecord {
    /// Its id.
    pub id: GroupId,
    /// What people call it.
    pub name: Name,
    /// When it was made, epoch ms.
    pub created_at_ms: i64,
    /// Its members.
    pub members: Members,
    /// The course plan that it follows, if any.
    pub follows: Option<GroupCoursePlan>,
}

/// The members of a group.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Members {
    /// The instructors who teach it.
    pub instructors: Vec<PersonId>,
    /// The trainees in it.
    pub trainees: Vec<TraineeId>,
}

#[derive(sqlx::FromRow)]
struct GroupRow {
    id: GroupId,
    name: Name,
    created_at_ms: i64,
    course_id: Option<CourseId>,
    course_name: Option<Name>,
    begins: Option<Day>,
}

/// Selects the groups that the scope sees: an administrator's are all, an instructor's those that they teach. For staff
/// only.
const SELECT_GROUPS: &str = "
    SELECT * FROM group_record
    WHERE $1 = 'administrator'
       OR EXISTS (SELECT 1 FROM group_instructor WHERE group_instructor.group_id = group_record.id AND person_id = $2)
    ORDER BY name";

const SELECT_GROUP: &str = "
    SELECT * FROM group_record
    WHERE id = $3
      AND ($1 = 'administrator'
           OR ($1 = 'instructor'
               AND EXISTS (SELECT 1 FROM group_instructor
                           WHERE group_instructor.group_id = group_record.id AND person_id = $2)))";

const INSERT_GROUP: &str = "INSERT INTO training_group (id, name, created_at_ms) VALUES ($1, $2, $3)";

const DELETE_INSTRUCTORS: &str = "DELETE FROM group_instructor WHERE group_id = $1";

/// People who wait for their erasure stay members, since the erasure can be taken back.
const DELETE_TRAINEES: &str = "
    DELETE FROM group_trainee WHERE group_id = $1 AND trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee)";

const INSERT_INSTRUCTOR: &str = "
    INSERT INTO group_instructor (group_id, person_id)
    SELECT $1, id FROM person
    WHERE id = $2 AND role <> 'trainee' ON CONFLICT DO NOTHING";

const INSERT_TRAINEE: &str = "
    INSERT INTO group_trainee (group_id, trainee_id)
    VALUES ($1, coalesce((SELECT kept_id FROM merged_trainee WHERE trainee_id = $2), $2)) ON CONFLICT DO NOTHING";

const DELETE_GROUP: &str = "DELETE FROM training_group WHERE id = $1";

const SELECT_INSTRUCTORS: &str = "SELECT person_id FROM group_instructor WHERE group_id = $1";

const SELECT_TRAINEES: &str = "
    SELECT trainee_id FROM group_trainee
    WHERE group_id = $1 AND trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee)";

impl GroupStore<'_> {
    /// Creates a group without trainees. An instructor teaches the group that they make; otherwise they would not see it.
    pub async fn create(&self, scope: &Scope, name: Name) -> StoreResult<GroupRecord> {
        require_staff(scope, "making groups")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let id = insert(tx, (&scope, now_ms), &name).await?;
                let members = Members { instructors: teacher(&scope).into_iter().collect(), trainees: Vec::new() };
                Ok(GroupRecord { id, name, created_at_ms: now_ms, members, follows: None })
            })
            .await
    }

    /// The groups that the scope sees, by name: all for an administrator, their own for an instructor.
    pub async fn list(&self, scope: &Scope) -> StoreResult<Vec<GroupRecord>> {
        require_staff(scope, "the list of groups")?;
        let rows = sqlx::query_as::<_, GroupRow>(SELECT_GROUPS);
        let mut groups = Vec::new();
        for row in rows.bind_scope(scope).fetch_all(self.0.readers()).await? {
            groups.push(self.with_members(row).await?);
        }
        Ok(groups)
    }

    /// One group that the scope sees.
    pub async fn get(&self, scope: &Scope, id: GroupId) -> StoreResult<GroupRecord> {
        let row = sqlx::query_as::<_, GroupRow>(SELECT_GROUP);
        let row = row.bind_scope(scope).bind(id).fetch_optional(self.0.readers()).await?;
        self.with_members(row.ok_or(not_found("group"))?).await
    }

    /// Replaces the members of a group.
    pub async fn set_members(&self, scope: &Scope, id: GroupId, members: Members) -> StoreResult<GroupRecord> {
        require_administrator(scope, "changing groups")?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                sqlx::query(DELETE_INSTRUCTORS).bind(id).execute(&mut *tx).await?;
                sqlx::query(DELETE_TRAINEES).bind(id).execute(&mut *tx).await?;
                for person in members.instructors {
                    let insert = sqlx::query(INSERT_INSTRUCTOR).bind(id).bind(person);
                    insert.execute(&mut *tx).await.map_err(missing("group"))?;
                }
                for trainee in members.trainees {
                    let insert = sqlx::query(INSERT_TRAINEE).bind(id).bind(trainee);
                    insert.execute(&mut *tx).await.map_err(missing("group or trainee"))?;
                }
                note(tx, &by, now_ms, ("set members", "group"), id).await
            })
            .await?;
        self.get(scope, id).await
    }

    /// Deletes a group that no cohort refers to; its members stay.
    pub async fn delete(&self, scope: &Scope, id: GroupId) -> StoreResult<()> {
        require_administrator(scope, "deleting groups")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let delete = sqlx::query(DELETE_GROUP).bind(id).execute(&mut *tx);
                let deleted = delete.await.map_err(in_use("group", "cohorts"))?;
                if deleted.rows_affected() == 0 {
                    return Err(not_found("group"));
                }
                note(tx, &scope, now_ms, ("delete", "group"), id).await
            })
            .await
    }

    async fn with_members(&self, row: GroupRow) -> StoreResult<GroupRecord> {
        let GroupRow { id, name, created_at_ms, course_id, course_name, begins } = row;
        let instructors = sqlx::query_scalar(SELECT_INSTRUCTORS);
        let trainees = sqlx::query_scalar(SELECT_TRAINEES);
        let members = Members {
            instructors: instructors.bind(id).fetch_all(self.0.readers()).await?,
            trainees: trainees.bind(id).fetch_all(self.0.readers()).await?,
        };
        let followed = course_id.zip(course_name).zip(begins);
        let follows = followed.map(|((course, name), begins)| GroupCoursePlan { course, name, begins });
        Ok(GroupRecord { id, name, created_at_ms, members, follows })
    }
}

/// Creates a group without trainees, taught by the instructor who makes it. The caller has checked that the scope is of
/// staff.
pub(super) async fn insert(
    tx: &mut SqliteConnection,
    (scope, now_ms): (&Scope, i64),
    name: &Name,
) -> StoreResult<GroupId> {
    let id = GroupId::at(now_ms);
    let insert = sqlx::query(INSERT_GROUP).bind(id).bind(name).bind(now_ms);
    insert.execute(&mut *tx).await.map_err(taken("group name"))?;
    if let Some(teacher) = teacher(scope) {
        sqlx::query(INSERT_INSTRUCTOR).bind(id).bind(teacher).execute(&mut *tx).await?;
    }
    note(tx, scope, now_ms, ("create", "group"), id).await?;
    Ok(id)
}

/// The instructor who teaches a group that this scope makes; administrators see all groups.
fn teacher(scope: &Scope) -> Option<PersonId> {
    scope.person().filter(|_| scope.role() == Role::Instructor)
}
