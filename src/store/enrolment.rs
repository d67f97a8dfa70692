//! Enrols the trainees of a list: all of them or none.

use std::collections::HashMap;

use sqlx::sqlite::SqliteConnection;

use super::audit::note;
use super::error::StoreResult;
use super::trainees::{INSERT_GROUP_TRAINEE, SELECT_CODE, TraineeRecord, TraineeStore, insert};
use super::visibility::{BindScope, require_staff};
use super::{Scope, codes};
use crate::domain::enrolment::{CheckedEnrolment, ReadRows, RowProblem, row_problem};
use crate::domain::role::Role;
use crate::domain::text::Code;
use crate::ids::{GroupId, TraineeId};

/// The outcome of enrolling a list.
#[derive(Clone, Debug, PartialEq)]
pub enum Enrolment {
    /// All are enrolled, in the order of the rows; empty if the list was only checked.
    Done(Vec<TraineeRecord>),
    /// None is enrolled, because of these rows.
    Refused(Vec<RowProblem>),
}

const SELECT_GROUPS_BY_NAME: &str = "
    SELECT name, id FROM training_group
    WHERE $1 = 'administrator'
      OR EXISTS (SELECT 1 FROM group_instructor WHERE group_id = training_group.id AND person_id = $2)";

impl TraineeStore<'_> {
    /// Enrols all trainees of a list in one transaction, or none; with `only_check` it only checks the list. Rows name
    /// groups by their names, which must be in the scope. An instructor's trainee joins one of the instructor's groups. The
    /// problems of the rows themselves are reported together with those that are found here.
    pub async fn enrol(&self, scope: &Scope, read: ReadRows, only_check: bool) -> StoreResult<Enrolment> {
        require_staff(scope, "registering trainees")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let groups = groups_of(tx, &scope).await?;
                let ReadRows { rows, mut problems } = read;
                let mut joins = Vec::with_capacity(rows.len());
                for (index, row) in rows.iter().enumerate() {
                    if let Some(code) = &row.code {
                        let why =
                            || row_problem(index + 1, "code", format!("`{code}` is already taken; choose another"));
                        problems.extend(is_taken(tx, code).await?.then(why));
                    }
                    match choose_group(&scope, &groups, row.group.as_deref()) {
                        Ok(group) => joins.push(group),
                        Err(why) => problems.push(row_problem(index + 1, "group", why)),
                    }
                }
                if !problems.is_empty() {
                    problems.sort_by_key(|problem| problem.row);
                    return Ok(Enrolment::Refused(problems));
                }
                let rows = rows.into_iter().filter_map(|row| row.trainee).collect(); // without problems, all of them
                if only_check {
                    return Ok(Enrolment::Done(Vec::new()));
                }
                Ok(Enrolment::Done(enrol(tx, &scope, now_ms, rows, joins).await?))
            })
            .await
    }
}

async fn enrol(
    tx: &mut SqliteConnection,
    scope: &Scope,
    now_ms: i64,
    rows: Vec<CheckedEnrolment>,
    joins: Vec<Option<GroupId>>,
) -> StoreResult<Vec<TraineeRecord>> {
    let mut order: Vec<usize> = (0..rows.len()).collect();
    order.sort_by_key(|index| rows[*index].code.is_none()); // given codes come first, derived ones use what is left
    let mut enrolled: Vec<(usize, TraineeRecord)> = Vec::with_capacity(rows.len());
    for index in order {
        let row = &rows[index];
        let trainee = TraineeRecord {
            id: TraineeId::at(now_ms),
            code: codes::choose(tx, SELECT_CODE, row.code.clone(), &row.name, "trainee").await?,
            name: row.name.clone(),
            level: row.level,
            handedness: row.handedness,
            created_at_ms: now_ms,
            is_in_several_groups: false,
        };
        insert(tx, &trainee).await?;
        if let Some(group) = joins[index] {
            sqlx::query(INSERT_GROUP_TRAINEE).bind(group).bind(trainee.id).execute(&mut *tx).await?;
        }
        note(tx, scope, now_ms, ("create", "trainee"), trainee.id).await?;
        enrolled.push((index, trainee));
    }
    enrolled.sort_by_key(|(index, _)| *index);
    Ok(enrolled.into_iter().map(|(_, trainee)| trainee).collect())
}

/// The groups that the scope sees, by name.
async fn groups_of(tx: &mut SqliteConnection, scope: &Scope) -> StoreResult<HashMap<String, GroupId>> {
    let rows = sqlx::query_as::<_, (String, GroupId)>(SELECT_GROUPS_BY_NAME);
    Ok(rows.bind_scope(scope).fetch_all(tx).await?.into_iter().collect())
}

/// True if the code is taken. Codes are unique in the centre; the caller does not learn who has it.
async fn is_taken(tx: &mut SqliteConnection, code: &Code) -> StoreResult<bool> {
    let found: Option<i64> = sqlx::query_scalar(SELECT_CODE).bind(code).fetch_optional(tx).await?;
    Ok(found.is_some())
}

/// The group of a row: the named one. Without a name it is an instructor's only group; for administrators it is none.
fn choose_group(
    scope: &Scope,
    groups: &HashMap<String, GroupId>,
    named: Option<&str>,
) -> Result<Option<GroupId>, String> {
    match named {
        Some(name) => match groups.get(name) {
            Some(group) => Ok(Some(*group)),
            None => Err(format!("you have no group called `{name}`: create it first, or correct the name")),
        },
        None if scope.role() != Role::Instructor => Ok(None),
        None if groups.len() == 1 => Ok(groups.values().next().copied()),
        None if groups.is_empty() => Err("you teach no group yet: ask an administrator to add you to one".to_owned()),
        None => Err("is missing: you teach several groups, so name the one to join".to_owned()),
    }
}
