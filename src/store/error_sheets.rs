//! Error sheets: what raters count while they watch a session.
//!
//! A rater has at most one **open** sheet of a session, which no other person reads. A finished sheet never changes: a
//! correction is a new sheet, and replaces the one before when it is finished.
//!
//! **Blind rating.** Staff see the finished sheets of others only after they have finished one of their own; the
//! session's trainee sees all. A sheet is blind unless its rater had finished one before and others had, too.
//!
//! A sheet belongs to the session and is filled in with a list of one task. While the session is filed under another
//! task, the sheet is kept and does not count.

use std::collections::HashMap;

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::audit::note;
use super::error::{StoreError, StoreResult, missing, not_found};
use super::visibility::{BindScope, require_staff};
use super::{Scope, Store};
use crate::domain::error_sheet::{ErrorItem, ErrorItemKind, MAX_MARKS, NewErrorMark, NewSheetValues};
use crate::domain::text::Name;
use crate::ids::{ErrorListId, ErrorMarkId, ErrorSheetId, PersonId, SessionId, TaskId, TraineeId};

/// Access to the error sheets.
pub struct ErrorSheetStore<'s>(pub(super) &'s Store);

/// Maximum number of sheets of one session by one person.
pub const MAX_PER_RATER: i64 = 20;

/// Maximum number of finished sheets of a session that are read, the newest ones.
const MAX_READ: i64 = 100;

/// Maximum number of sheets of a task for the agreement of raters, of the newest sessions.
const MAX_SHEETS: i64 = 4_000;

/// An error on a sheet.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct ErrorMarkRecord {
    /// Its id.
    pub id: ErrorMarkId,
    /// Its sheet.
    pub sheet_id: ErrorSheetId,
    /// Short name of its item.
    pub item: String,
    /// Second of the recording; `None`: not at one moment.
    pub at_s: Option<f64>,
    /// The amount; `None` for other kinds.
    pub amount: Option<f64>,
}

/// An error sheet.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct ErrorSheetRecord {
    /// Its id.
    pub id: ErrorSheetId,
    /// Its session.
    pub session_id: SessionId,
    /// The rater; `None` if the account has been deleted.
    pub person_id: Option<PersonId>,
    /// The rater's name.
    pub who: Option<Name>,
    /// The task of its list.
    pub task_id: TaskId,
    /// Name of that task.
    pub task_name: Name,
    /// The version of its list.
    pub version: i64,
    /// The items of its list.
    #[sqlx(json)]
    pub items: Vec<ErrorItem>,
    /// The time that the rater typed, s.
    pub time_s: Option<f64>,
    /// Whether the rater could not see the sheets of others; `None` while it is open.
    pub is_blind: Option<bool>,
    /// True if the session is filed under the task of its list.
    pub counts: bool,
    /// When it was begun, epoch ms.
    pub created_at_ms: i64,
    /// When it was finished, epoch ms; `None` while it is open.
    pub finished_at_ms: Option<i64>,
    /// Its marks, in the order of time.
    #[sqlx(skip)]
    pub marks: Vec<ErrorMarkRecord>,
}

/// The sheets of a session that the caller may see.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VisibleErrorSheets {
    /// The caller's open sheet.
    pub open: Option<ErrorSheetRecord>,
    /// The latest finished sheet of each rater, oldest first.
    pub finished: Vec<ErrorSheetRecord>,
    /// Number of finished sheets by others that are hidden until the caller has finished one.
    pub hidden: usize,
}

/// A blind finished sheet of a session of a task, with the session's trainee.
#[derive(Clone, Debug, PartialEq)]
pub struct GivenErrorSheet {
    /// The session.
    pub session: SessionId,
    /// When the session was recorded, epoch ms.
    pub recorded_at_ms: i64,
    /// The session's trainee.
    pub trainee: TraineeId,
    /// The rater.
    pub rater: PersonId,
    /// The items of its list.
    pub items: Vec<ErrorItem>,
    /// Its marks: items with their amounts.
    pub marks: Vec<(String, Option<f64>)>,
}

type GivenSheetRow = (ErrorSheetId, SessionId, i64, TraineeId, PersonId, Json<Vec<ErrorItem>>);
type OpenSheetRow = (ErrorSheetId, Json<Vec<ErrorItem>>);

/// Selects the finished sheets of the sessions `$3` (a JSON array) that no correction replaced, oldest first; of each session
/// the newest `$4`.
const SELECT_FINISHED: &str = "
    SELECT sheet.id, sheet.session_id, sheet.person_id, person.name AS who, list.task_id, task.name AS task_name, list.version, list.items,
           sheet.time_s, sheet.is_blind, list.task_id = session.task_id AS counts, sheet.created_at_ms,
           sheet.finished_at_ms
    FROM (SELECT error_sheet.*,
                 row_number() OVER (PARTITION BY session_id ORDER BY finished_at_ms DESC, rowid DESC) AS place
          FROM error_sheet
          WHERE session_id IN (SELECT value FROM json_each($3)) AND finished_at_ms IS NOT NULL
            AND replaced_at_ms IS NULL) AS sheet
    JOIN session ON session.id = sheet.session_id
    JOIN error_list AS list ON list.id = sheet.list_id
    JOIN task ON task.id = list.task_id
    LEFT JOIN person ON person.id = sheet.person_id
    WHERE $1 <> 'agent' AND sheet.place <= $4
      AND ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($1 <> 'trainee' OR session.id NOT IN (SELECT session_id FROM sealed_session))
    ORDER BY sheet.session_id, sheet.place DESC";

/// Selects the open sheet of session `$3` by person `$4`.
const SELECT_OPEN: &str = "
    SELECT sheet.id, sheet.session_id, sheet.person_id, person.name AS who, list.task_id, task.name AS task_name, list.version, list.items,
           sheet.time_s, sheet.is_blind, list.task_id = session.task_id AS counts, sheet.created_at_ms,
           sheet.finished_at_ms
    FROM error_sheet AS sheet
    JOIN session ON session.id = sheet.session_id
    JOIN error_list AS list ON list.id = sheet.list_id
    JOIN task ON task.id = list.task_id
    JOIN person ON person.id = sheet.person_id
    WHERE $1 <> 'agent' AND sheet.session_id = $3 AND sheet.person_id = $4 AND sheet.finished_at_ms IS NULL";

const SELECT_MARKS: &str = "
    SELECT id, sheet_id, item, at_s, amount FROM error_mark
    WHERE sheet_id IN (SELECT value FROM json_each($1)) ORDER BY at_s, created_at_ms, rowid";

const SELECT_OPEN_ITEMS: &str = "
    SELECT sheet.id, list.items FROM error_sheet AS sheet JOIN error_list AS list ON list.id = sheet.list_id
    WHERE sheet.session_id = $1 AND sheet.person_id = $2 AND sheet.finished_at_ms IS NULL";

/// The list for a new sheet of session `$1` by person `$2`: that of the sheet which is corrected, else the one in use.
const SELECT_LIST_TO_FILL: &str = "
    SELECT coalesce(
        (SELECT sheet.list_id FROM error_sheet AS sheet JOIN error_list AS list ON list.id = sheet.list_id
         WHERE sheet.session_id = session.id AND sheet.person_id = $2 AND sheet.finished_at_ms IS NOT NULL
           AND sheet.replaced_at_ms IS NULL AND list.task_id = session.task_id),
        (SELECT list.id FROM error_list AS list
         WHERE list.task_id = session.task_id AND json_array_length(list.items) > 0
           AND list.version = (SELECT max(latest.version) FROM error_list AS latest
                               WHERE latest.task_id = session.task_id)))
    FROM session WHERE session.id = $1";

/// Begins sheet `$1` of session `$2` by person `$3`, unless they have begun `$6`.
const INSERT_SHEET: &str = "
    INSERT INTO error_sheet (id, session_id, list_id, person_id, created_at_ms)
    SELECT $1, $2, $4, $3, $5
    WHERE (SELECT count(*) FROM error_sheet WHERE session_id = $2 AND person_id = $3) < $6";

/// The finished sheet that sheet `$1` corrects.
const SELECT_CORRECTED: &str = "
    SELECT old.id FROM error_sheet AS new
    JOIN error_sheet AS old ON old.session_id = new.session_id AND old.person_id = new.person_id
                               AND old.list_id = new.list_id
    WHERE new.id = $1 AND old.finished_at_ms IS NOT NULL AND old.replaced_at_ms IS NULL";

const COPY_TIME: &str =
    "UPDATE error_sheet SET time_s = (SELECT old.time_s FROM error_sheet AS old WHERE old.id = $2) WHERE id = $1";

const SELECT_MARKS_TO_COPY: &str = "SELECT item, at_s, amount FROM error_mark WHERE sheet_id = $1 ORDER BY rowid";

/// Adds mark `$1` to sheet `$2`, unless it has `$7`.
const INSERT_MARK: &str = "
    INSERT INTO error_mark (id, sheet_id, item, at_s, amount, created_at_ms)
    SELECT $1, $2, $3, $4, $5, $6 WHERE (SELECT count(*) FROM error_mark WHERE sheet_id = $2) < $7";

const SELECT_IS_MARKED: &str = "SELECT EXISTS (SELECT 1 FROM error_mark WHERE sheet_id = $1 AND item = $2)";

const DELETE_MARK: &str = "DELETE FROM error_mark WHERE id = $1 AND sheet_id = $2 AND amount IS NULL";

const DELETE_AMOUNTS: &str = "DELETE FROM error_mark WHERE sheet_id = $1 AND amount IS NOT NULL";

const SET_TIME: &str = "UPDATE error_sheet SET time_s = $2 WHERE id = $1";

const DELETE_SHEET: &str = "DELETE FROM error_sheet WHERE id = $1";

/// Replaces the earlier finished sheets of the rater of sheet `$1` on lists of the same task.
const REPLACE_EARLIER: &str = "
    UPDATE error_sheet SET replaced_at_ms = max($2, finished_at_ms)
    WHERE id IN (SELECT old.id FROM error_sheet AS new
                 JOIN error_list AS list ON list.id = new.list_id
                 JOIN error_sheet AS old ON old.session_id = new.session_id AND old.person_id = new.person_id
                 JOIN error_list AS old_list ON old_list.id = old.list_id AND old_list.task_id = list.task_id
                 WHERE new.id = $1 AND old.finished_at_ms IS NOT NULL AND old.replaced_at_ms IS NULL)";

/// Finishes sheet `$1`. It is blind unless its rater had finished one of the session and another person had, too.
const FINISH_SHEET: &str = "
    UPDATE error_sheet SET finished_at_ms = max($2, created_at_ms), is_blind = NOT (
        EXISTS (SELECT 1 FROM error_sheet AS own
                WHERE own.session_id = error_sheet.session_id AND own.person_id = error_sheet.person_id
                  AND own.finished_at_ms IS NOT NULL)
        AND EXISTS (SELECT 1 FROM error_sheet AS other
                    WHERE other.session_id = error_sheet.session_id AND other.person_id IS NOT error_sheet.person_id
                      AND other.finished_at_ms IS NOT NULL))
    WHERE id = $1 AND finished_at_ms IS NULL";

const SCALE_MARKS: &str = "
    UPDATE error_mark SET at_s = min(at_s * $2, 86400)
    WHERE at_s IS NOT NULL AND sheet_id IN (SELECT id FROM error_sheet WHERE session_id = $1)";

/// Selects the latest blind finished sheet on a list of task `$3` by each rater of each session of the task that
/// counts; newest sessions first, at most `$4`.
const SELECT_BLIND_SHEETS: &str = "
    SELECT sheet.id, session.id, session.recorded_at_ms, session.trainee_id, sheet.person_id, list.items
    FROM session
    CROSS JOIN error_sheet AS sheet ON sheet.session_id = session.id
    JOIN error_list AS list ON list.id = sheet.list_id
    WHERE session.task_id = $3 AND list.task_id = $3 AND sheet.is_blind = 1 AND sheet.person_id IS NOT NULL
      AND NOT EXISTS (SELECT 1 FROM uncounted_session WHERE uncounted_session.session_id = session.id)
      AND ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND NOT EXISTS (SELECT 1 FROM error_sheet AS later
                      JOIN error_list AS later_list ON later_list.id = later.list_id
                      WHERE later.session_id = sheet.session_id AND later.person_id = sheet.person_id
                      AND later_list.task_id = $3 AND later.is_blind = 1
                      AND (later.finished_at_ms, later.rowid) > (sheet.finished_at_ms, sheet.rowid))
    ORDER BY session.recorded_at_ms DESC, session.id DESC, sheet.id LIMIT $4";

/// Multiplies the times of the marks on a session's sheets, because its recording has other times now.
pub(super) async fn scale_marks(tx: &mut SqliteConnection, session: SessionId, ratio: f64) -> StoreResult<()> {
    sqlx::query(SCALE_MARKS).bind(session).bind(ratio).execute(tx).await?;
    Ok(())
}

impl ErrorSheetStore<'_> {
    /// The sheets of a session that the caller may see.
    pub async fn of_session(&self, scope: &Scope, session: SessionId) -> StoreResult<VisibleErrorSheets> {
        self.0.sessions().get(scope, session).await?;
        let finished = self.finished_of(scope, &[session]).await?.remove(&session).unwrap_or_default();
        Ok(VisibleErrorSheets { open: self.open(scope, session).await?, ..finished })
    }

    /// The finished sheets of these sessions that the caller may see, without the open ones. Sessions outside the scope, and
    /// those without a finished sheet, are left out. All readers of finished sheets of others go through here.
    pub async fn finished_of(
        &self,
        scope: &Scope,
        sessions: &[SessionId],
    ) -> StoreResult<HashMap<SessionId, VisibleErrorSheets>> {
        let rows = sqlx::query_as(SELECT_FINISHED).bind_scope(scope).bind(Json(sessions)).bind(MAX_READ);
        let rows: Vec<ErrorSheetRecord> = rows.fetch_all(self.0.readers()).await?;
        let mut of_each: HashMap<SessionId, Vec<ErrorSheetRecord>> = HashMap::new();
        rows.into_iter().for_each(|sheet| of_each.entry(sheet.session_id).or_default().push(sheet));
        let mut hidden: HashMap<SessionId, usize> = HashMap::new();
        for (session, finished) in &mut of_each {
            let all = finished.len();
            hide_before_own(scope, finished);
            hidden.insert(*session, all - finished.len());
        }
        let shown = self.with_marks(of_each.into_values().flatten().collect()).await?;
        let mut visible: HashMap<SessionId, VisibleErrorSheets> = HashMap::new();
        for (session, hidden) in hidden {
            visible.insert(session, VisibleErrorSheets { hidden, ..VisibleErrorSheets::default() });
        }
        shown.into_iter().for_each(|sheet| visible.entry(sheet.session_id).or_default().finished.push(sheet));
        Ok(visible)
    }

    /// The caller's open sheet of a session.
    async fn open(&self, scope: &Scope, session: SessionId) -> StoreResult<Option<ErrorSheetRecord>> {
        let row = sqlx::query_as(SELECT_OPEN).bind_scope(scope).bind(session).bind(scope.person());
        let row: Option<ErrorSheetRecord> = row.fetch_optional(self.0.readers()).await?;
        Ok(self.with_marks(row.into_iter().collect()).await?.pop())
    }

    async fn with_marks(&self, mut sheets: Vec<ErrorSheetRecord>) -> StoreResult<Vec<ErrorSheetRecord>> {
        let ids: Vec<ErrorSheetId> = sheets.iter().map(|sheet| sheet.id).collect();
        let mut marks = self.marks(&ids).await?;
        sheets.iter_mut().for_each(|sheet| sheet.marks = marks.remove(&sheet.id).unwrap_or_default());
        Ok(sheets)
    }

    async fn marks(&self, sheets: &[ErrorSheetId]) -> StoreResult<HashMap<ErrorSheetId, Vec<ErrorMarkRecord>>> {
        let rows = sqlx::query_as::<_, ErrorMarkRecord>(SELECT_MARKS).bind(Json(sheets));
        let mut marks: HashMap<ErrorSheetId, Vec<ErrorMarkRecord>> = HashMap::new();
        for mark in rows.fetch_all(self.0.readers()).await? {
            marks.entry(mark.sheet_id).or_default().push(mark);
        }
        Ok(marks)
    }

    /// Begins the caller's sheet of a session, or returns the open one. If the caller has finished one, the new sheet
    /// corrects it and begins as its copy.
    ///
    /// # Errors
    /// The session's task has no error items, or the caller has begun [`MAX_PER_RATER`] sheets of the session.
    pub async fn begin(&self, scope: &Scope, session: SessionId) -> StoreResult<ErrorSheetRecord> {
        let person = self.rater(scope, session).await?;
        if let Some(open) = self.open(scope, session).await? {
            return Ok(open);
        }
        let (by, now_ms, id) = (scope.clone(), self.0.now_ms(), ErrorSheetId::at(self.0.now_ms()));
        self.0
            .write(async move |tx| {
                let list = sqlx::query_scalar(SELECT_LIST_TO_FILL).bind(session).bind(person);
                let list: Option<Option<ErrorListId>> = list.fetch_optional(&mut *tx).await?;
                let list = list.ok_or(not_found("session"))?.ok_or_else(|| {
                    StoreError::refused("the session's task has no error items: set them on the task's page first")
                })?;
                let insert = sqlx::query(INSERT_SHEET).bind(id).bind(session).bind(person).bind(list);
                let insert = insert.bind(now_ms).bind(MAX_PER_RATER);
                if insert.execute(&mut *tx).await.map_err(missing("session"))?.rows_affected() == 0 {
                    let why = format!("you have begun {MAX_PER_RATER} sheets of this session, which is the limit");
                    return Err(StoreError::refused(why));
                }
                copy_corrected(tx, id, now_ms).await?;
                note(tx, &by, now_ms, ("create", "error_sheet"), id).await
            })
            .await?;
        self.open(scope, session).await?.ok_or(not_found("error sheet"))
    }

    /// The items of the caller's open sheet, to check a mark or typed values against.
    ///
    /// # Errors
    /// The caller has no open sheet.
    pub async fn open_items(&self, scope: &Scope, session: SessionId) -> StoreResult<Vec<ErrorItem>> {
        let person = self.rater(scope, session).await?;
        let row = sqlx::query_as::<_, OpenSheetRow>(SELECT_OPEN_ITEMS).bind(session).bind(person);
        let row = row.fetch_optional(self.0.readers()).await?;
        row.map(|(_, Json(items))| items).ok_or_else(no_open_sheet)
    }

    /// Marks an error on the caller's open sheet. The mark fits its items. The sheet has an effect only after it is
    /// finished, so its marks are not in the audit trail.
    ///
    /// # Errors
    /// The caller has no open sheet, the item is marked already, or the sheet is full.
    pub async fn mark(&self, scope: &Scope, session: SessionId, new: NewErrorMark) -> StoreResult<ErrorMarkRecord> {
        let person = self.rater(scope, session).await?;
        let (now_ms, id) = (self.0.now_ms(), ErrorMarkId::at(self.0.now_ms()));
        self.0
            .write(async move |tx| {
                let (sheet_id, Json(items)) = open_sheet(tx, session, person).await?;
                let is_once = items.iter().any(|item| item.item == new.item && item.kind == ErrorItemKind::YesNo);
                let is_marked = sqlx::query_scalar(SELECT_IS_MARKED).bind(sheet_id).bind(&new.item);
                if is_once && is_marked.fetch_one(&mut *tx).await? {
                    return Err(StoreError::refused("it is marked already; an item of yes or no is marked once"));
                }
                insert_mark(tx, (id, sheet_id), (&new.item, new.at_s, None), now_ms).await?;
                Ok(ErrorMarkRecord { id, sheet_id, item: new.item, at_s: new.at_s, amount: None })
            })
            .await
    }

    /// Takes a mark back from the caller's open sheet.
    pub async fn unmark(&self, scope: &Scope, session: SessionId, mark: ErrorMarkId) -> StoreResult<()> {
        let person = self.rater(scope, session).await?;
        self.0
            .write(async move |tx| {
                let (sheet, _) = open_sheet(tx, session, person).await?;
                match sqlx::query(DELETE_MARK).bind(mark).bind(sheet).execute(&mut *tx).await?.rows_affected() {
                    0 => Err(not_found("mark")),
                    _ => Ok(()),
                }
            })
            .await
    }

    /// Replaces the typed values of the caller's open sheet. They fit its items.
    pub async fn set_values(
        &self,
        scope: &Scope,
        session: SessionId,
        values: NewSheetValues,
    ) -> StoreResult<ErrorSheetRecord> {
        let person = self.rater(scope, session).await?;
        let now_ms = self.0.now_ms();
        self.0
            .write(async move |tx| {
                let (sheet, _) = open_sheet(tx, session, person).await?;
                sqlx::query(DELETE_AMOUNTS).bind(sheet).execute(&mut *tx).await?;
                for (item, amount) in &values.amounts {
                    let id = ErrorMarkId::at(now_ms);
                    insert_mark(tx, (id, sheet), (item, None, Some(*amount)), now_ms).await?;
                }
                sqlx::query(SET_TIME).bind(sheet).bind(values.time_s).execute(&mut *tx).await?;
                Ok(())
            })
            .await?;
        self.open(scope, session).await?.ok_or(not_found("error sheet"))
    }

    /// Finishes the caller's open sheet: from now on it counts, and replaces the one that it corrects.
    pub async fn finish(&self, scope: &Scope, session: SessionId) -> StoreResult<ErrorSheetRecord> {
        let person = self.rater(scope, session).await?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        let id = self
            .0
            .write(async move |tx| {
                let (id, _) = open_sheet(tx, session, person).await?;
                sqlx::query(REPLACE_EARLIER).bind(id).bind(now_ms).execute(&mut *tx).await?;
                sqlx::query(FINISH_SHEET).bind(id).bind(now_ms).execute(&mut *tx).await?;
                note(tx, &by, now_ms, ("finish", "error_sheet"), id).await?;
                Ok(id)
            })
            .await?;
        let all = self.of_session(scope, session).await?.finished;
        all.into_iter().find(|sheet| sheet.id == id).ok_or(not_found("error sheet"))
    }

    /// Discards the caller's open sheet. A finished one that it would have corrected stays.
    pub async fn discard(&self, scope: &Scope, session: SessionId) -> StoreResult<()> {
        let person = self.rater(scope, session).await?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let (id, _) = open_sheet(tx, session, person).await?;
                sqlx::query(DELETE_SHEET).bind(id).execute(&mut *tx).await?;
                note(tx, &by, now_ms, ("discard", "error_sheet"), id).await
            })
            .await
    }

    /// The blind finished sheets of the task's sessions in the scope: the latest of each rater, newest sessions first.
    pub async fn given(&self, scope: &Scope, task: TaskId) -> StoreResult<Vec<GivenErrorSheet>> {
        require_staff(scope, "the agreement of raters")?;
        let rows = sqlx::query_as::<_, GivenSheetRow>(SELECT_BLIND_SHEETS);
        let rows = rows.bind_scope(scope).bind(task).bind(MAX_SHEETS).fetch_all(self.0.readers()).await?;
        let ids: Vec<ErrorSheetId> = rows.iter().map(|row| row.0).collect();
        let mut marks = self.marks(&ids).await?;
        let given = |(sheet, session, recorded_at_ms, trainee, rater, Json(items)): GivenSheetRow| {
            let marks = marks.remove(&sheet).unwrap_or_default().into_iter().map(|mark| (mark.item, mark.amount));
            GivenErrorSheet { session, recorded_at_ms, trainee, rater, items, marks: marks.collect() }
        };
        Ok(rows.into_iter().map(given).collect())
    }

    /// The calling person, if they may rate the session.
    async fn rater(&self, scope: &Scope, session: SessionId) -> StoreResult<PersonId> {
        self.0.sessions().get(scope, session).await?;
        require_staff(scope, "counting errors")?;
        scope.person().ok_or(StoreError::Forbidden { what: "counting errors", whom: "people" })
    }
}

/// The open sheet of this rater, with its items.
async fn open_sheet(tx: &mut SqliteConnection, session: SessionId, person: PersonId) -> StoreResult<OpenSheetRow> {
    let row = sqlx::query_as(SELECT_OPEN_ITEMS).bind(session).bind(person).fetch_optional(tx).await?;
    row.ok_or_else(no_open_sheet)
}

fn no_open_sheet() -> StoreError {
    StoreError::refused("you have no open error sheet of this session: begin one first")
}

/// Copies marks and time of the sheet that this one corrects, if there is one.
async fn copy_corrected(tx: &mut SqliteConnection, sheet: ErrorSheetId, now_ms: i64) -> StoreResult<()> {
    let corrected: Option<ErrorSheetId> =
        sqlx::query_scalar(SELECT_CORRECTED).bind(sheet).fetch_optional(&mut *tx).await?;
    let Some(corrected) = corrected else { return Ok(()) };
    sqlx::query(COPY_TIME).bind(sheet).bind(corrected).execute(&mut *tx).await?;
    let marks = sqlx::query_as::<_, (String, Option<f64>, Option<f64>)>(SELECT_MARKS_TO_COPY).bind(corrected);
    for (item, at_s, amount) in marks.fetch_all(&mut *tx).await? {
        insert_mark(tx, (ErrorMarkId::at(now_ms), sheet), (&item, at_s, amount), now_ms).await?;
    }
    Ok(())
}

/// Blind rating: removes the finished sheets of one session for staff who have not finished one of their own.
fn hide_before_own(scope: &Scope, finished: &mut Vec<ErrorSheetRecord>) {
    let is_own = |sheet: &ErrorSheetRecord| sheet.person_id.is_some() && sheet.person_id == scope.person();
    if scope.is_staff() && !scope.is_service() && !finished.iter().any(is_own) {
        finished.clear();
    }
}

async fn insert_mark(
    tx: &mut SqliteConnection,
    (id, sheet): (ErrorMarkId, ErrorSheetId),
    (item, at_s, amount): (&str, Option<f64>, Option<f64>),
    now_ms: i64,
) -> StoreResult<()> {
    let insert = sqlx::query(INSERT_MARK).bind(id).bind(sheet).bind(item.to_owned()).bind(at_s).bind(amount);
    match insert.bind(now_ms).bind(MAX_MARKS).execute(tx).await?.rows_affected() {
        0 => Err(StoreError::refused(format!("the sheet has {MAX_MARKS} marks, which is the limit"))),
        _ => Ok(()),
    }
}
