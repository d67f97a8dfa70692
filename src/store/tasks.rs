//! Tasks that trainees practise. Staff change them; people see all of them.

use super::audit::note;
use super::error::{StoreResult, in_use, not_found, taken};
use super::page::{Page, PageRequest};
use super::visibility::{BindScope, require_staff};
use super::{Scope, Store, codes};
use crate::domain::task::{NewTask, TaskChange};
use crate::domain::text::{Code, Key, Name, Paragraphs};
use crate::ids::TaskId;

/// Access to the tasks.
pub struct TaskStore<'s>(pub(super) &'s Store);

/// A task: one exercise.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct TaskRecord {
    /// Its id.
    pub id: TaskId,
    /// Its short unique name.
    pub code: Code,
    /// What people call it.
    pub name: Name,
    /// What to do; may be empty.
    pub description: Paragraphs,
    /// When it was registered, epoch ms.
    pub created_at_ms: i64,
}

const SELECT_CODE: &str = "SELECT 1 FROM task WHERE code = $1";

const INSERT_TASK: &str = "
    INSERT INTO task (id, code, name, description, created_at_ms)
    VALUES ($1, $2, $3, coalesce($4, ''), $5)
    RETURNING id, code, name, description, created_at_ms";

const SELECT_TASKS: &str = "
    SELECT id, code, name, description, created_at_ms FROM task
    WHERE $1 <> 'agent' AND ($3 IS NULL OR code > $3) ORDER BY code LIMIT $4";

const SELECT_TASK: &str = "
    SELECT id, code, name, description, created_at_ms FROM task WHERE $3 IN (id, code) AND $1 <> 'agent'";

const UPDATE_TASK: &str = "
    UPDATE task
    SET code = coalesce($2, code), name = coalesce($3, name), description = coalesce($4, description)
    WHERE id = $1
    RETURNING id, code, name, description, created_at_ms";

const DELETE_TASK: &str = "DELETE FROM task WHERE id = $1";

impl TaskStore<'_> {
    /// Registers a task.
    pub async fn create(&self, scope: &Scope, new: NewTask) -> StoreResult<TaskRecord> {
        require_staff(scope, "registering tasks")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let code = codes::choose(tx, SELECT_CODE, new.code, &new.name, "task").await?;
                let insert = sqlx::query_as(INSERT_TASK);
                let insert = insert.bind(TaskId::at(now_ms)).bind(code).bind(new.name).bind(new.description);
                let task: TaskRecord = insert.bind(now_ms).fetch_one(&mut *tx).await.map_err(taken("code"))?;
                note(tx, &scope, now_ms, ("create", "task"), task.id).await?;
                Ok(task)
            })
            .await
    }

    /// All tasks, by code.
    pub async fn list(&self, scope: &Scope, page: &PageRequest) -> StoreResult<Page<TaskRecord>> {
        let rows = sqlx::query_as(SELECT_TASKS);
        let rows = rows.bind_scope(scope).bind(page.after()).bind(page.row_limit()).fetch_all(self.0.readers()).await?;
        Ok(Page::from_rows(rows, page, |task: &TaskRecord| task.code.to_string()))
    }

    /// One task, by id or code.
    pub async fn get(&self, scope: &Scope, key: &Key) -> StoreResult<TaskRecord> {
        let row = sqlx::query_as(SELECT_TASK);
        let row = row.bind_scope(scope).bind(key).fetch_optional(self.0.readers()).await?;
        row.ok_or(not_found("task"))
    }

    /// Changes a task.
    pub async fn change(&self, scope: &Scope, key: &Key, change: TaskChange) -> StoreResult<TaskRecord> {
        let id = self.get(scope, key).await?.id;
        require_staff(scope, "changing tasks")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let row = sqlx::query_as(UPDATE_TASK);
                let row = row.bind(id).bind(change.code).bind(change.name).bind(change.description);
                let row = row.fetch_optional(&mut *tx).await.map_err(taken("code"))?;
                note(tx, &scope, now_ms, ("change", "task"), id).await?;
                row.ok_or(not_found("task"))
            })
            .await
    }

    /// Deletes a task that has no sessions and is in no course plan.
    pub async fn delete(&self, scope: &Scope, key: &Key) -> StoreResult<()> {
        let id = self.get(scope, key).await?.id;
        require_staff(scope, "deleting tasks")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let delete = sqlx::query(DELETE_TASK).bind(id);
                delete.execute(&mut *tx).await.map_err(in_use("task", "sessions or course plans"))?;
                note(tx, &scope, now_ms, ("delete", "task"), id).await
            })
            .await
    }
}
