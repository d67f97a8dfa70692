//! Versions of the tasks' standards: added, never changed. Each is valid from a time on, for the recordings that arrive
//! from then on; the latest of those that are valid is in use.

use sqlx::types::Json;

use super::audit::note;
use super::error::{StoreError, StoreResult, missing, not_found};
use super::visibility::BindScope;
use super::{Scope, Store};
use crate::domain::standard::{StandardDefinition, StandardStart};
use crate::domain::text::Key;
use crate::ids::{StandardId, TaskId};

/// Maximum number of versions of a task's standard: each is judged at every request for progress.
const MAX_VERSIONS: i64 = 200;

/// Access to the tasks' standards.
pub struct StandardStore<'s>(pub(super) &'s Store);

/// A version of a task's standard.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct StandardRecord {
    /// Its id.
    pub id: StandardId,
    /// Its task.
    pub task_id: TaskId,
    /// 1, 2, … within the task.
    pub version: i64,
    /// What it requires.
    #[sqlx(json)]
    pub definition: StandardDefinition,
    /// Name of the person who set it; `None` if a program did, or the account has been deleted.
    pub who: Option<String>,
    /// When it was set, epoch ms.
    pub created_at_ms: i64,
    /// It judges the recordings that arrived from then on, epoch ms; 0: all.
    pub valid_from_ms: i64,
}

impl StandardRecord {
    /// True if setting this definition now would add nothing to this version, the newest of its task.
    pub fn is_same(
        &self,
        definition: &StandardDefinition,
        start: Option<StandardStart>,
        (now_ms, valid_from_ms): (i64, i64),
    ) -> bool {
        let is_valid_since = match start {
            None | Some(StandardStart::Now) => self.valid_from_ms <= now_ms,
            Some(_) => self.valid_from_ms == valid_from_ms,
        };
        self.definition == *definition && is_valid_since
    }

    /// Of a task's versions the one that judges a recording that arrived at this time, epoch ms.
    pub fn valid_at(versions: &[Self], arrived_ms: i64) -> Option<&Self> {
        versions.iter().filter(|version| version.valid_from_ms <= arrived_ms).max_by_key(|version| version.version)
    }
}

pub(super) const SELECT_STANDARDS: &str = "
    SELECT * FROM standard_record WHERE task_id = $3 AND $1 <> 'agent' ORDER BY version DESC LIMIT $4";

const SELECT_STANDARDS_OF_TASKS: &str = "
    SELECT * FROM standard_record
    WHERE task_id IN (SELECT value FROM json_each($3)) AND $1 <> 'agent' ORDER BY task_id, version DESC";

const SELECT_STANDARD_AT: &str = "
    SELECT * FROM standard_record WHERE task_id = $3 AND $1 <> 'agent' AND valid_from_ms <= $4
    ORDER BY version DESC LIMIT 1";

const SELECT_STANDARD: &str = "SELECT * FROM standard_record WHERE id = $3 AND $1 <> 'agent'";

const INSERT_STANDARD: &str = "
    INSERT INTO standard (id, task_id, version, definition, person_id, created_at_ms, valid_from_ms)
    SELECT $1, $2, coalesce(max(version), 0) + 1, $3, $4, $5, $6 FROM standard
    WHERE task_id = $2";

impl StandardStore<'_> {
    /// Adds a task's next version. If the newest version has the same definition and is valid already, that one is
    /// returned.
    ///
    /// # Errors
    /// The task has [`MAX_VERSIONS`] versions.
    pub async fn add(
        &self,
        scope: &Scope,
        of: TaskId,
        definition: StandardDefinition,
        start: Option<StandardStart>,
    ) -> StoreResult<StandardRecord> {
        self.0.tasks().changeable(scope, &Key::from(&of)).await?;
        let newest = self.newest(scope, of).await?;
        let (by, now_ms, id) = (scope.clone(), self.0.now_ms(), StandardId::at(self.0.now_ms()));
        let valid_from_ms = StandardStart::or_usual(start, newest.is_some()).valid_from_ms(now_ms);
        let is_same = |newest: &StandardRecord| newest.is_same(&definition, start, (now_ms, valid_from_ms));
        match newest {
            Some(same) if is_same(&same) => return Ok(same),
            Some(newest) if newest.version >= MAX_VERSIONS => {
                let why = format!("the task has {MAX_VERSIONS} versions of its standard; make a new task");
                return Err(StoreError::refused(why));
            }
            _ => {}
        }
        self.0
            .write(async move |tx| {
                let insert = sqlx::query(INSERT_STANDARD);
                let insert = insert.bind(id).bind(of).bind(Json(definition)).bind(by.person()).bind(now_ms);
                insert.bind(valid_from_ms).execute(&mut *tx).await.map_err(missing("task"))?;
                note(tx, &by, now_ms, ("create", "standard"), id).await
            })
            .await?;
        self.newest(scope, of).await?.ok_or(not_found("standard"))
    }

    /// The newest version, valid already or not; `None` if the task has none.
    pub async fn newest(&self, scope: &Scope, of: TaskId) -> StoreResult<Option<StandardRecord>> {
        let row = sqlx::query_as(SELECT_STANDARDS).bind_scope(scope).bind(of).bind(1);
        Ok(row.fetch_optional(self.0.readers()).await?)
    }

    /// The version that judges recordings that arrive now, if there is one.
    pub async fn in_use(&self, scope: &Scope, of: TaskId) -> StoreResult<Option<StandardRecord>> {
        self.at(scope, of, self.0.now_ms()).await
    }

    /// The version that judges a recording that arrived at this time, epoch ms; `None` if none was valid then.
    pub async fn at(&self, scope: &Scope, of: TaskId, arrived_ms: i64) -> StoreResult<Option<StandardRecord>> {
        let row = sqlx::query_as(SELECT_STANDARD_AT).bind_scope(scope).bind(of).bind(arrived_ms);
        Ok(row.fetch_optional(self.0.readers()).await?)
    }

    /// All versions of these tasks, newest first within each task.
    pub async fn of_tasks(&self, scope: &Scope, tasks: &[TaskId]) -> StoreResult<Vec<StandardRecord>> {
        let rows = sqlx::query_as(SELECT_STANDARDS_OF_TASKS);
        Ok(rows.bind_scope(scope).bind(Json(tasks)).fetch_all(self.0.readers()).await?)
    }

    /// One version.
    pub async fn get(&self, scope: &Scope, id: StandardId) -> StoreResult<StandardRecord> {
        let row = sqlx::query_as(SELECT_STANDARD);
        row.bind_scope(scope).bind(id).fetch_optional(self.0.readers()).await?.ok_or(not_found("standard"))
    }

    /// The last hundred versions, newest first.
    pub async fn list(&self, scope: &Scope, of: TaskId) -> StoreResult<Vec<StandardRecord>> {
        let rows = sqlx::query_as(SELECT_STANDARDS).bind_scope(scope).bind(of).bind(100);
        Ok(rows.fetch_all(self.0.readers()).await?)
    }
}
