//! Training boxes. Staff change them; people see all boxes, an agent its own.

use super::audit::note;
use super::error::{StoreResult, in_use, not_found, taken};
use super::page::{Page, PageRequest};
use super::visibility::{BindScope, require_staff};
use super::{Scope, Store, codes};
use crate::domain::boxes::{BoxChange, NewBox};
use crate::domain::files::annotations::View;
use crate::domain::text::{Code, Key, Name, Paragraphs};
use crate::ids::BoxId;

/// Access to the boxes.
pub struct BoxStore<'s>(pub(super) &'s Store);

/// A box trainer with its camera.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct BoxRecord {
    /// Its id.
    pub id: BoxId,
    /// Its short unique name.
    pub code: Code,
    /// What people call it.
    pub name: Name,
    /// The view of its camera, if known.
    pub view: Option<View>,
    /// Anything worth knowing; may be empty.
    pub notes: Paragraphs,
    /// When it was registered, epoch ms.
    pub created_at_ms: i64,
}

const SELECT_CODE: &str = "SELECT 1 FROM training_box WHERE code = $1";

const INSERT_BOX: &str = "
    INSERT INTO training_box (id, code, name, view, notes, created_at_ms)
    VALUES ($1, $2, $3, $4, coalesce($5, ''), $6)
    RETURNING id, code, name, view, notes, created_at_ms";

const SELECT_BOXES: &str = "
    SELECT id, code, name, view, notes, created_at_ms FROM training_box
    WHERE ($1 <> 'agent' OR $2 = id) AND ($3 IS NULL OR code > $3) ORDER BY code LIMIT $4";

const SELECT_BOX: &str = "
    SELECT id, code, name, view, notes, created_at_ms FROM training_box
    WHERE $3 IN (id, code) AND ($1 <> 'agent' OR $2 = id)";

const UPDATE_BOX: &str = "
    UPDATE training_box
    SET code = coalesce($2, code), name = coalesce($3, name), view = coalesce($4, view),
        notes = coalesce($5, notes)
    WHERE id = $1
    RETURNING id, code, name, view, notes, created_at_ms";

const DELETE_BOX: &str = "DELETE FROM training_box WHERE id = $1";

impl BoxStore<'_> {
    /// Registers a box.
    pub async fn create(&self, scope: &Scope, new: NewBox) -> StoreResult<BoxRecord> {
        require_staff(scope, "registering boxes")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let code = codes::choose(tx, SELECT_CODE, new.code, &new.name, "box").await?;
                let insert = sqlx::query_as(INSERT_BOX);
                let insert = insert.bind(BoxId::at(now_ms)).bind(code).bind(new.name).bind(new.view).bind(new.notes);
                let made: BoxRecord = insert.bind(now_ms).fetch_one(&mut *tx).await.map_err(taken("code"))?;
                note(tx, &scope, now_ms, ("create", "box"), made.id).await?;
                Ok(made)
            })
            .await
    }

    /// The boxes that the scope sees, by code.
    pub async fn list(&self, scope: &Scope, page: &PageRequest) -> StoreResult<Page<BoxRecord>> {
        let rows = sqlx::query_as(SELECT_BOXES);
        let rows = rows.bind_scope(scope).bind(page.after()).bind(page.row_limit()).fetch_all(self.0.readers()).await?;
        Ok(Page::from_rows(rows, page, |found: &BoxRecord| found.code.to_string()))
    }

    /// One box, by id or code.
    pub async fn get(&self, scope: &Scope, key: &Key) -> StoreResult<BoxRecord> {
        let row = sqlx::query_as(SELECT_BOX);
        let row = row.bind_scope(scope).bind(key).fetch_optional(self.0.readers()).await?;
        row.ok_or(not_found("box"))
    }

    /// Changes a box.
    pub async fn change(&self, scope: &Scope, key: &Key, change: BoxChange) -> StoreResult<BoxRecord> {
        let id = self.get(scope, key).await?.id;
        require_staff(scope, "changing boxes")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let row = sqlx::query_as(UPDATE_BOX);
                let row = row.bind(id).bind(change.code).bind(change.name).bind(change.view).bind(change.notes);
                let row = row.fetch_optional(&mut *tx).await.map_err(taken("code"))?;
                note(tx, &scope, now_ms, ("change", "box"), id).await?;
                row.ok_or(not_found("box"))
            })
            .await
    }

    /// Deletes a box that has no sessions, with its calibrations, colours and jobs.
    pub async fn delete(&self, scope: &Scope, key: &Key) -> StoreResult<()> {
        let id = self.get(scope, key).await?.id;
        require_staff(scope, "deleting boxes")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let delete = sqlx::query(DELETE_BOX).bind(id);
                delete.execute(&mut *tx).await.map_err(in_use("box", "sessions"))?;
                note(tx, &scope, now_ms, ("delete", "box"), id).await
            })
            .await
    }
}
