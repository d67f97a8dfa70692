//! Versions of the tasks' standards: added, never changed. The latest is the one in use.

use sqlx::types::Json;

use super::audit::note;
use super::error::{StoreResult, missing, not_found};
use super::visibility::BindScope;
use super::{Scope, Store};
use crate::domain::standard::StandardDefinition;
use crate::domain::text::Key;
use crate::ids::{StandardId, TaskId};

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
}

pub(super) const SELECT_STANDARDS: &str = "
    SELECT * FROM standard_record WHERE task_id = $3 AND $1 <> 'agent' ORDER BY version DESC LIMIT $4";

const SELECT_STANDARDS_IN_USE: &str = "
    SELECT * FROM standard_record
    WHERE task_id IN (SELECT value FROM json_each($3)) AND $1 <> 'agent'
      AND version = (SELECT max(latest.version) FROM standard AS latest
                     WHERE latest.task_id = standard_record.task_id)";

const SELECT_STANDARD: &str = "SELECT * FROM standard_record WHERE id = $3 AND $1 <> 'agent'";

const INSERT_STANDARD: &str = "
    INSERT INTO standard (id, task_id, version, definition, person_id, created_at_ms)
    SELECT $1, $2, coalesce(max(version), 0) + 1, $3, $4, $5 FROM standard
    WHERE task_id = $2";

impl StandardStore<'_> {
    /// Adds a task's next version. If the version in use has the same definition, that one is returned.
    pub async fn add(&self, scope: &Scope, of: TaskId, definition: StandardDefinition) -> StoreResult<StandardRecord> {
        self.0.tasks().changeable(scope, &Key::from(&of)).await?;
        if let Some(same) = self.in_use(scope, of).await?.filter(|last| last.definition == definition) {
            return Ok(same);
        }
        let (by, now_ms, id) = (scope.clone(), self.0.now_ms(), StandardId::at(self.0.now_ms()));
        self.0
            .write(async move |tx| {
                let insert = sqlx::query(INSERT_STANDARD);
                let insert = insert.bind(id).bind(of).bind(Json(definition)).bind(by.person()).bind(now_ms);
                insert.execute(&mut *tx).await.map_err(missing("task"))?;
                note(tx, &by, now_ms, ("create", "standard"), id).await
            })
            .await?;
        let last = self.in_use(scope, of).await?;
        last.ok_or(not_found("standard"))
    }

    /// The version in use, if the task has one.
    pub async fn in_use(&self, scope: &Scope, of: TaskId) -> StoreResult<Option<StandardRecord>> {
        let row = sqlx::query_as(SELECT_STANDARDS).bind_scope(scope).bind(of).bind(1);
        Ok(row.fetch_optional(self.0.readers()).await?)
    }

    /// The versions in use of those of these tasks that have one.
    pub async fn in_use_of(&self, scope: &Scope, tasks: &[TaskId]) -> StoreResult<Vec<StandardRecord>> {
        let rows = sqlx::query_as(SELECT_STANDARDS_IN_USE);
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
