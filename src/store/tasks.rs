//! Tasks that trainees practise. Administrators and the instructors of their groups change them; people see all of them.

use sqlx::types::Json;

use super::audit::note;
use super::error::{StoreResult, in_use, not_found, taken};
use super::owners::{self, OwnedThing, require_owner};
use super::page::{Page, PageRequest};
use super::visibility::{BindScope, require_staff};
use super::{Scope, Store, codes};
use crate::domain::rating::RatingForm;
use crate::domain::task::{NewTask, TaskChange, chosen_forms};
use crate::domain::text::{Code, Key, Name, Paragraphs};
use crate::ids::{GroupId, TaskId};

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
    /// The forms that its sessions are rated on; `None`: all.
    #[sqlx(json(nullable))]
    pub rating_forms: Option<Vec<RatingForm>>,
    /// When it was registered, epoch ms.
    pub created_at_ms: i64,
    /// Those of its groups that the scope sees.
    #[sqlx(json)]
    pub owners: Vec<GroupId>,
}

const SELECT_CODE: &str = "SELECT 1 FROM task WHERE code = $1";

const INSERT_TASK: &str = "
    INSERT INTO task (id, code, name, description, created_at_ms, rating_forms)
    VALUES ($1, $2, $3, coalesce($4, ''), $5, $6)";

const SELECT_TASKS: &str = "
    SELECT id, code, name, description, rating_forms, created_at_ms,
           (SELECT json_group_array(group_id) FROM ownership
            WHERE thing_id = task.id
              AND ($1 = 'administrator'
                   OR group_id IN (SELECT group_id FROM group_instructor WHERE person_id = $2))) AS owners
    FROM task
    WHERE $1 <> 'agent' AND ($3 IS NULL OR code > $3) ORDER BY code LIMIT $4";

const SELECT_TASK: &str = "
    SELECT id, code, name, description, rating_forms, created_at_ms,
           (SELECT json_group_array(group_id) FROM ownership
            WHERE thing_id = task.id
              AND ($1 = 'administrator'
                   OR group_id IN (SELECT group_id FROM group_instructor WHERE person_id = $2))) AS owners
    FROM task
    WHERE $3 IN (id, code) AND $1 <> 'agent'";

const UPDATE_TASK: &str = "
    UPDATE task
    SET code = coalesce($2, code), name = coalesce($3, name), description = coalesce($4, description),
        rating_forms = CASE WHEN $5 THEN $6 ELSE rating_forms END
    WHERE id = $1";

const DELETE_TASK: &str = "DELETE FROM task WHERE id = $1";

impl TaskStore<'_> {
    /// Registers a task.
    pub async fn create(&self, scope: &Scope, new: NewTask) -> StoreResult<TaskRecord> {
        require_staff(scope, "registering tasks")?;
        let (by, now_ms, id) = (scope.clone(), self.0.now_ms(), TaskId::at(self.0.now_ms()));
        self.0
            .write(async move |tx| {
                let code = codes::choose(tx, SELECT_CODE, new.code, &new.name, "task").await?;
                let insert = sqlx::query(INSERT_TASK).bind(id).bind(code).bind(new.name).bind(new.description);
                let forms = new.rating_forms.as_deref().and_then(chosen_forms).map(Json);
                insert.bind(now_ms).bind(forms).execute(&mut *tx).await.map_err(taken("code"))?;
                owners::insert(tx, &by, OwnedThing::Task(id), new.groups).await?;
                note(tx, &by, now_ms, ("create", "task"), id).await
            })
            .await?;
        self.get(scope, &Key::from(&id)).await
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

    /// One task that the scope may change, by id or code.
    pub async fn changeable(&self, scope: &Scope, key: &Key) -> StoreResult<TaskRecord> {
        let found = self.get(scope, key).await?;
        require_owner(scope, &found.owners, "changing this task")?;
        Ok(found)
    }

    /// Changes a task.
    pub async fn change(&self, scope: &Scope, key: &Key, change: TaskChange) -> StoreResult<TaskRecord> {
        let id = self.changeable(scope, key).await?.id;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let update = sqlx::query(UPDATE_TASK).bind(id).bind(change.code).bind(change.name);
                let forms = change.rating_forms.as_deref().and_then(chosen_forms).map(Json);
                let update = update.bind(change.description).bind(change.rating_forms.is_some()).bind(forms);
                let update = update.execute(&mut *tx);
                if update.await.map_err(taken("code"))?.rows_affected() == 0 {
                    return Err(not_found("task"));
                }
                if let Some(groups) = change.groups {
                    owners::replace(tx, &by, OwnedThing::Task(id), groups).await?;
                }
                note(tx, &by, now_ms, ("change", "task"), id).await
            })
            .await?;
        self.get(scope, &Key::from(&id)).await
    }

    /// Deletes a task that has no sessions and is in no course plan.
    pub async fn delete(&self, scope: &Scope, key: &Key) -> StoreResult<()> {
        let id = self.changeable(scope, key).await?.id;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let delete = sqlx::query(DELETE_TASK).bind(id);
                delete.execute(&mut *tx).await.map_err(in_use("task", "sessions, exams or course plans"))?;
                note(tx, &scope, now_ms, ("delete", "task"), id).await
            })
            .await
    }
}
