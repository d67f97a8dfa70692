//! Versions of the tasks' lists of error items, and of their score formulas: added, never changed.

use sqlx::types::Json;

use super::audit::note;
use super::error::{StoreError, StoreResult, missing, not_found};
use super::visibility::BindScope;
use super::{Scope, Store};
use crate::domain::error_sheet::{ErrorItem, ScoreFormula};
use crate::domain::text::Key;
use crate::ids::{ErrorListId, ScoreFormulaId, TaskId};
use crate::time::Day;

/// Access to the lists of error items.
pub struct ErrorListStore<'s>(pub(super) &'s Store);

/// Access to the score formulas.
pub struct ScoreFormulaStore<'s>(pub(super) &'s Store);

/// Maximum number of versions of a task's list, and of its formula: all are read.
pub const MAX_VERSIONS: i64 = 200;

/// A version of a task's list of error items.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct ErrorListRecord {
    /// Its id.
    pub id: ErrorListId,
    /// Its task.
    pub task_id: TaskId,
    /// 1, 2, … within the task.
    pub version: i64,
    /// Its items, in their order.
    #[sqlx(json)]
    pub items: Vec<ErrorItem>,
    /// Name of the person who set it; `None` if a program did, or the account has been deleted.
    pub who: Option<String>,
    /// When it was set, epoch ms.
    pub created_at_ms: i64,
}

/// A version of a task's score formula.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct ScoreFormulaRecord {
    /// Its id.
    pub id: ScoreFormulaId,
    /// Its task.
    pub task_id: TaskId,
    /// 1, 2, … within the task.
    pub version: i64,
    /// What it computes.
    #[sqlx(json)]
    pub definition: ScoreFormula,
    /// The first day of the sessions that it scores; `None`: it scores all.
    pub valid_from: Option<Day>,
    /// Name of the person who set it; `None` if a program did, or the account has been deleted.
    pub who: Option<String>,
    /// When it was set, epoch ms.
    pub created_at_ms: i64,
}

const SELECT_ERROR_LISTS: &str = "
    SELECT error_list.id, task_id, version, items, person.name AS who, error_list.created_at_ms
    FROM error_list LEFT JOIN person ON person.id = error_list.person_id
    WHERE task_id = $3 AND $1 <> 'agent' ORDER BY version DESC LIMIT $4";

const INSERT_ERROR_LIST: &str = "
    INSERT INTO error_list (id, task_id, version, items, person_id, created_at_ms)
    SELECT $1, $2, coalesce(max(version), 0) + 1, $3, $4, $5 FROM error_list
    WHERE task_id = $2 HAVING count(*) < $6";

const SELECT_SCORE_FORMULAS: &str = "
    SELECT score_formula.id, task_id, version, definition, valid_from, person.name AS who, score_formula.created_at_ms
    FROM score_formula LEFT JOIN person ON person.id = score_formula.person_id
    WHERE task_id = $3 AND $1 <> 'agent' ORDER BY version DESC LIMIT $4";

const INSERT_SCORE_FORMULA: &str = "
    INSERT INTO score_formula (id, task_id, version, definition, valid_from, person_id, created_at_ms)
    SELECT $1, $2, coalesce(max(version), 0) + 1, $3, $4, $5, $6 FROM score_formula
    WHERE task_id = $2 HAVING count(*) < $7";

impl ErrorListStore<'_> {
    /// Adds a task's next version. If the version in use has the same items, that one is returned.
    ///
    /// # Errors
    /// The task has [`MAX_VERSIONS`] versions.
    pub async fn add(&self, scope: &Scope, of: TaskId, items: Vec<ErrorItem>) -> StoreResult<ErrorListRecord> {
        self.0.tasks().changeable(scope, &Key::from(&of)).await?;
        if let Some(same) = self.in_use(scope, of).await?.filter(|last| last.items == items) {
            return Ok(same);
        }
        let (by, now_ms, id) = (scope.clone(), self.0.now_ms(), ErrorListId::at(self.0.now_ms()));
        self.0
            .write(async move |tx| {
                let insert = sqlx::query(INSERT_ERROR_LIST).bind(id).bind(of).bind(Json(items)).bind(by.person());
                let inserted =
                    insert.bind(now_ms).bind(MAX_VERSIONS).execute(&mut *tx).await.map_err(missing("task"))?;
                refuse_if_full(inserted.rows_affected())?;
                note(tx, &by, now_ms, ("create", "error_list"), id).await
            })
            .await?;
        self.in_use(scope, of).await?.ok_or(not_found("error list"))
    }

    /// The version in use, if the task has one.
    pub async fn in_use(&self, scope: &Scope, of: TaskId) -> StoreResult<Option<ErrorListRecord>> {
        let row = sqlx::query_as(SELECT_ERROR_LISTS).bind_scope(scope).bind(of).bind(1);
        Ok(row.fetch_optional(self.0.readers()).await?)
    }

    /// All versions, newest first.
    pub async fn list(&self, scope: &Scope, of: TaskId) -> StoreResult<Vec<ErrorListRecord>> {
        let rows = sqlx::query_as(SELECT_ERROR_LISTS).bind_scope(scope).bind(of).bind(MAX_VERSIONS);
        Ok(rows.fetch_all(self.0.readers()).await?)
    }
}

impl ScoreFormulaStore<'_> {
    /// Adds a task's next version. If the newest version is the same, that one is returned.
    ///
    /// # Errors
    /// The task has [`MAX_VERSIONS`] versions.
    pub async fn add(
        &self,
        scope: &Scope,
        of: TaskId,
        definition: ScoreFormula,
        valid_from: Option<Day>,
    ) -> StoreResult<ScoreFormulaRecord> {
        self.0.tasks().changeable(scope, &Key::from(&of)).await?;
        let newest = self.newest(scope, of).await?;
        if let Some(same) = newest.filter(|last| last.definition == definition && last.valid_from == valid_from) {
            return Ok(same);
        }
        let (by, now_ms, id) = (scope.clone(), self.0.now_ms(), ScoreFormulaId::at(self.0.now_ms()));
        self.0
            .write(async move |tx| {
                let insert =
                    sqlx::query(INSERT_SCORE_FORMULA).bind(id).bind(of).bind(Json(definition)).bind(valid_from);
                let insert = insert.bind(by.person()).bind(now_ms).bind(MAX_VERSIONS);
                let inserted = insert.execute(&mut *tx).await.map_err(missing("task"))?;
                refuse_if_full(inserted.rows_affected())?;
                note(tx, &by, now_ms, ("create", "score_formula"), id).await
            })
            .await?;
        self.newest(scope, of).await?.ok_or(not_found("score formula"))
    }

    async fn newest(&self, scope: &Scope, of: TaskId) -> StoreResult<Option<ScoreFormulaRecord>> {
        let row = sqlx::query_as(SELECT_SCORE_FORMULAS).bind_scope(scope).bind(of).bind(1);
        Ok(row.fetch_optional(self.0.readers()).await?)
    }

    /// All versions, newest first.
    pub async fn list(&self, scope: &Scope, of: TaskId) -> StoreResult<Vec<ScoreFormulaRecord>> {
        let rows = sqlx::query_as(SELECT_SCORE_FORMULAS).bind_scope(scope).bind(of).bind(MAX_VERSIONS);
        Ok(rows.fetch_all(self.0.readers()).await?)
    }
}

fn refuse_if_full(inserted: u64) -> StoreResult<()> {
    match inserted {
        0 => Err(StoreError::refused(format!("the task has {MAX_VERSIONS} versions of it, which is the limit"))),
        _ => Ok(()),
    }
}
