//! Training boxes. Administrators and the instructors of their groups change them; people see all boxes, an agent its
//! own.

use super::audit::note;
use super::error::{StoreError, StoreResult, in_use, not_found, taken};
use super::owners::{self, OwnedThing, require_owner};
use super::page::{Page, PageRequest};
use super::record_merges::boxes_merged_into;
use super::visibility::{BindScope, require_staff};
use super::{Scope, Store, codes};
use crate::domain::boxes::{BoxChange, NewBox};
use crate::domain::files::annotations::View;
use crate::domain::text::{Code, Key, Name, Paragraphs};
use crate::ids::{BoxId, GroupId};

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
    /// Those of its groups that the scope sees.
    #[sqlx(json)]
    pub owners: Vec<GroupId>,
}

const SELECT_CODE: &str = "SELECT 1 FROM training_box WHERE code = $1";

const INSERT_BOX: &str = "
    INSERT INTO training_box (id, code, name, view, notes, created_at_ms)
    VALUES ($1, $2, $3, $4, coalesce($5, ''), $6)";

const SELECT_BOXES: &str = "
    SELECT id, code, name, view, notes, created_at_ms,
           (SELECT json_group_array(group_id) FROM ownership
            WHERE thing_id = training_box.id
              AND ($1 = 'administrator'
                   OR group_id IN (SELECT group_id FROM group_instructor WHERE person_id = $2))) AS owners
    FROM training_box
    WHERE ($1 <> 'agent' OR $2 = id) AND ($3 IS NULL OR code > $3) AND id NOT IN (SELECT box_id FROM merged_box)
    ORDER BY code LIMIT $4";

const SELECT_BOX: &str = "
    SELECT id, code, name, view, notes, created_at_ms,
           (SELECT json_group_array(group_id) FROM ownership
            WHERE thing_id = training_box.id
              AND ($1 = 'administrator'
                   OR group_id IN (SELECT group_id FROM group_instructor WHERE person_id = $2))) AS owners
    FROM training_box
    WHERE id = (SELECT coalesce(merged.kept_id, named.id) FROM training_box AS named
                LEFT JOIN merged_box AS merged ON merged.box_id = named.id WHERE $3 IN (named.id, named.code))
      AND ($1 <> 'agent' OR $2 = id)";

const UPDATE_BOX: &str = "
    UPDATE training_box
    SET code = coalesce($2, code), name = coalesce($3, name), view = coalesce($4, view),
        notes = coalesce($5, notes)
    WHERE id = $1";

const DELETE_BOX: &str = "DELETE FROM training_box WHERE id = $1";

impl BoxStore<'_> {
    /// Registers a box.
    pub async fn create(&self, scope: &Scope, new: NewBox) -> StoreResult<BoxRecord> {
        require_staff(scope, "registering boxes")?;
        let (by, now_ms, id) = (scope.clone(), self.0.now_ms(), BoxId::at(self.0.now_ms()));
        self.0
            .write(async move |tx| {
                let code = codes::choose(tx, SELECT_CODE, new.code, &new.name, "box").await?;
                let insert = sqlx::query(INSERT_BOX).bind(id).bind(code).bind(new.name).bind(new.view).bind(new.notes);
                insert.bind(now_ms).execute(&mut *tx).await.map_err(taken("code"))?;
                owners::insert(tx, &by, OwnedThing::Box(id), new.groups).await?;
                note(tx, &by, now_ms, ("create", "box"), id).await
            })
            .await?;
        self.get(scope, &Key::from(&id)).await
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

    /// One box that the scope may change, by id or code.
    pub async fn changeable(&self, scope: &Scope, key: &Key) -> StoreResult<BoxRecord> {
        let found = self.get(scope, key).await?;
        require_owner(scope, &found.owners, "changing this box")?;
        Ok(found)
    }

    /// Changes a box.
    pub async fn change(&self, scope: &Scope, key: &Key, change: BoxChange) -> StoreResult<BoxRecord> {
        let id = self.changeable(scope, key).await?.id;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let update = sqlx::query(UPDATE_BOX).bind(id).bind(change.code).bind(change.name);
                let update = update.bind(change.view).bind(change.notes).execute(&mut *tx);
                if update.await.map_err(taken("code"))?.rows_affected() == 0 {
                    return Err(not_found("box"));
                }
                if let Some(groups) = change.groups {
                    owners::replace(tx, &by, OwnedThing::Box(id), groups).await?;
                }
                note(tx, &by, now_ms, ("change", "box"), id).await
            })
            .await?;
        self.get(scope, &Key::from(&id)).await
    }

    /// Deletes a box that has no sessions, with its calibrations, colours and jobs, and the records that were merged into
    /// it.
    pub async fn delete(&self, scope: &Scope, key: &Key) -> StoreResult<()> {
        let found = self.changeable(scope, key).await?;
        if ![found.id.to_string().as_str(), found.code.as_str()].contains(&key.as_str()) {
            return Err(StoreError::refused(format!(
                "this record was merged into box `{}`: separate the two first",
                found.code
            )));
        }
        let (scope, now_ms, id) = (scope.clone(), self.0.now_ms(), found.id);
        self.0
            .write_ending_sign_ins(async move |tx| {
                for record in boxes_merged_into(tx, id).await?.into_iter().chain([id]) {
                    let deleted = sqlx::query(DELETE_BOX).bind(record).execute(&mut *tx).await;
                    deleted.map_err(in_use("box", "sessions, exams, or results of sessions that were moved away"))?;
                }
                note(tx, &scope, now_ms, ("delete", "box"), id).await
            })
            .await
    }
}
