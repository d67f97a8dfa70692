//! The audit trail: who changed which data. Each entry is written in the transaction of the change; administrators read
//! it.

use sqlx::sqlite::SqliteConnection;

use super::error::{StoreError, StoreResult};
use super::page::{Page, PageRequest};
use super::visibility::require_administrator;
use super::{Scope, Store};
use crate::domain::text::Key;
use crate::ids::{ExamId, TraineeId};

/// Action and noun of a backup's entry; its subject is the number of files in the backup.
const BACKUP: (&str, &str) = ("create", "backup");

/// Most entries about one trainee that are read.
const MAX_ABOUT_ONE: i64 = 10_000;

/// Access to the audit trail.
pub struct AuditStore<'s>(pub(super) &'s Store);

/// One change.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct AuditEntry {
    /// Order of writing.
    pub id: i64,
    /// When, epoch ms.
    pub at_ms: i64,
    /// `person:ID`, `agent:BOX` or `service`.
    pub actor: String,
    /// `create`, `change`, `erase`, …
    pub action: String,
    /// What kind of thing was changed.
    pub noun: String,
    /// Its id; for `backup` and `tokens`, a number.
    pub subject: String,
    /// The number of the attempt, for a change of an attempt of an exam; `None` otherwise.
    pub attempt: Option<u32>,
    /// Name of the person who made the change; `None` if a program made it, or the account has been deleted.
    pub who: Option<String>,
    /// Name of the changed thing or of the person it belongs to; `None` if it no longer exists or has no name.
    pub called: Option<String>,
    /// The reason that the person gave for an edit or a move of a session, for voiding an attempt of an exam, or for merging
    /// or separating records; `None` otherwise, and if the session, exam or record was erased.
    pub why: Option<String>,
    /// Address of the client that sent the request; `None` for the service and for commands, for changes before it was
    /// recorded, and if the account has been deleted.
    pub address: Option<String>,
}

/// A backup that was made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Backup {
    /// When, epoch ms.
    pub at_ms: i64,
    /// How many files it holds.
    pub files: u64,
}

const SELECT_ENTRIES: &str = "
    SELECT audit.id, at_ms, actor, action, noun, subject, attempt, address, person.name AS who, CASE noun
        WHEN 'trainee' THEN (SELECT name FROM trainee WHERE id = subject)
        WHEN 'password_link' THEN (SELECT name FROM person WHERE id = subject)
        WHEN 'identity' THEN (SELECT name FROM person WHERE id = subject)
        WHEN 'person' THEN (SELECT name FROM person WHERE id = subject)
        WHEN 'group' THEN (SELECT name FROM training_group WHERE id = subject)
        WHEN 'box' THEN (SELECT name FROM training_box WHERE id = subject)
        WHEN 'calibration' THEN
            (SELECT name FROM training_box JOIN calibration ON box_id = training_box.id WHERE calibration.id = subject)
        WHEN 'palette' THEN
            (SELECT name FROM training_box JOIN palette ON box_id = training_box.id WHERE palette.id = subject)
        WHEN 'consent_text' THEN (SELECT coalesce(title_en, title_de) FROM consent_text WHERE id = subject)
        WHEN 'task' THEN (SELECT name FROM task WHERE id = subject)
        WHEN 'cohort' THEN (SELECT name FROM cohort WHERE id = subject)
        WHEN 'course' THEN (SELECT name FROM course WHERE id = subject)
        WHEN 'token' THEN (SELECT name FROM token WHERE id = subject)
        WHEN 'centre' THEN (SELECT name FROM centre)
        WHEN 'standard' THEN (SELECT name FROM task JOIN standard ON task_id = task.id
            WHERE standard.id = subject)
        WHEN 'error_list' THEN (SELECT name FROM task JOIN error_list ON task_id = task.id
            WHERE error_list.id = subject)
        WHEN 'score_formula' THEN (SELECT name FROM task JOIN score_formula ON task_id = task.id
            WHERE score_formula.id = subject)
        WHEN 'error_sheet' THEN
            (SELECT name FROM trainee JOIN session ON trainee_id = trainee.id
                JOIN error_sheet ON session_id = session.id WHERE error_sheet.id = subject)
        WHEN 'rescoring' THEN (SELECT name FROM task JOIN rescoring ON task_id = task.id
            WHERE rescoring.id = subject)
        WHEN 'skill_model' THEN
            (SELECT name FROM task JOIN skill_model ON task_id = task.id WHERE skill_model.id = subject)
        WHEN 'waiting_recording' THEN (SELECT filename FROM waiting_recording WHERE id = subject)
        WHEN 'session' THEN
            (SELECT name FROM trainee JOIN session ON trainee_id = trainee.id WHERE session.id = subject)
        WHEN 'exam' THEN
            (SELECT name FROM trainee JOIN exam ON trainee_id = trainee.id WHERE exam.id = subject)
        WHEN 'rating' THEN
            (SELECT name FROM trainee JOIN session ON trainee_id = trainee.id
                JOIN rating ON session_id = session.id WHERE rating.id = subject)
        WHEN 'comment' THEN
            (SELECT name FROM trainee JOIN session ON trainee_id = trainee.id
                JOIN comment ON session_id = session.id WHERE comment.id = subject)
        WHEN 'session_edit' THEN
            (SELECT name FROM trainee JOIN session ON trainee_id = trainee.id
                JOIN session_edit ON session_id = session.id WHERE session_edit.id = subject)
        END AS called,
        CASE WHEN noun IN ('trainee', 'box') AND action = 'merge' THEN
            (SELECT why FROM record_merge
             WHERE subject IN (kept_trainee_id, kept_box_id) AND created_at_ms = at_ms LIMIT 1)
        WHEN noun IN ('trainee', 'box') AND action = 'separate' THEN
            (SELECT separated_why FROM record_merge
             WHERE subject IN (kept_trainee_id, kept_box_id) AND separated_at_ms = at_ms LIMIT 1)
        WHEN noun = 'exam' AND action = 'void attempt' THEN
            (SELECT void_reason FROM exam_attempt
             WHERE exam_id = subject AND voided_at_ms = at_ms AND number = coalesce(audit.attempt, number) LIMIT 1)
        WHEN noun = 'session' THEN
            coalesce((SELECT why FROM session_move
                      WHERE action = 'move' AND session_id = subject AND created_at_ms = at_ms),
                     (SELECT why FROM session_cut
                      WHERE action = 'cut' AND first_id = subject AND created_at_ms = at_ms),
                     (SELECT why FROM session_edit
                      WHERE kind = action AND session_id = subject AND created_at_ms = at_ms))
        END AS why
    FROM audit
    LEFT JOIN person ON actor LIKE 'person:%' AND person.id = substr(actor, 8)
    WHERE $1 IS NULL OR audit.id < CAST($1 AS INTEGER) ORDER BY audit.id DESC LIMIT $2";

/// Selects at most `$2` entries about trainee `$1`, their account and their sessions, or made by them. The addresses of
/// other people are left out, and so are the names of other trainees: a session may have been moved from them.
const SELECT_ENTRIES_ABOUT: &str = "
    SELECT audit.id, at_ms, actor, action, noun, subject, attempt, CAST(NULL AS TEXT) AS called, CAST(NULL AS TEXT) AS why,
           CASE WHEN person.trainee_id IS NULL OR person.trainee_id = $1 THEN person.name END AS who,
           CASE WHEN person.trainee_id = $1 THEN address END AS address
    FROM audit
    LEFT JOIN person ON actor LIKE 'person:%' AND person.id = substr(actor, 8)
    WHERE (subject = $1 OR subject IN (SELECT merged_trainee.trainee_id FROM merged_trainee WHERE kept_id = $1)
       OR subject IN (SELECT id FROM session WHERE trainee_id = $1)
       OR subject IN (SELECT id FROM exam WHERE trainee_id = $1)
       OR subject IN (SELECT account.id FROM person AS account WHERE account.trainee_id = $1)
       OR actor IN (SELECT 'person:' || account.id FROM person AS account WHERE account.trainee_id = $1))
      AND subject NOT IN (SELECT session_id FROM sealed_session)
    ORDER BY audit.id DESC LIMIT $2";

const SELECT_LAST_BACKUP: &str = "
    SELECT at_ms, subject FROM audit WHERE action = 'create' AND noun = 'backup' ORDER BY id DESC LIMIT 1";

/// A person without an account leaves no address: they have deleted it with this change, or while the request waited.
const INSERT_ENTRY: &str = "
    INSERT INTO audit (at_ms, actor, action, noun, subject, attempt, address)
    VALUES ($1, $2, $3, $4, $5, $7,
            CASE WHEN $2 NOT LIKE 'person:%' OR EXISTS (SELECT 1 FROM person WHERE id = substr($2, 8)) THEN $6 END)";

impl AuditStore<'_> {
    /// Changes, newest first.
    pub async fn list(&self, scope: &Scope, page: &PageRequest) -> StoreResult<Page<AuditEntry>> {
        require_administrator(scope, "the audit trail")?;
        let rows = sqlx::query_as(SELECT_ENTRIES);
        let rows = rows.bind(page.after()).bind(page.row_limit()).fetch_all(self.0.readers()).await?;
        Ok(Page::from_rows(rows, page, |entry: &AuditEntry| entry.id.to_string()))
    }

    /// Changes of this trainee, their account and their sessions, and changes that they made, newest first; at most 10,000.
    /// Only their own changes have an address.
    pub async fn about(&self, scope: &Scope, trainee: TraineeId) -> StoreResult<Vec<AuditEntry>> {
        self.0.trainees().get(scope, &Key::from(&trainee)).await?;
        let rows = sqlx::query_as(SELECT_ENTRIES_ABOUT).bind(trainee).bind(MAX_ABOUT_ONE);
        Ok(rows.fetch_all(self.0.readers()).await?)
    }

    /// Records that data were exported: of a trainee, or of the centre. On a full disk the export works without the entry.
    pub async fn record_export(&self, scope: &Scope, noun: &'static str, subject: impl ToString) -> StoreResult<()> {
        let (scope, now_ms, subject) = (scope.clone(), self.0.now_ms(), subject.to_string());
        let noted = self.0.write(async move |tx| note(tx, &scope, now_ms, ("export", noun), subject).await).await;
        match noted {
            Err(error @ StoreError::DiskFull) => {
                tracing::warn!(%error, "export not in the audit trail; the export continues");
                Ok(())
            }
            noted => noted,
        }
    }

    /// Records that a backup of `files` files was made.
    pub async fn record_backup(&self, files: u64) -> StoreResult<()> {
        let now_ms = self.0.now_ms();
        self.0.write(async move |tx| note(tx, &Scope::service(), now_ms, BACKUP, files).await).await
    }

    /// The latest backup of this centre.
    pub async fn last_backup(&self, scope: &Scope) -> StoreResult<Option<Backup>> {
        require_administrator(scope, "the state of backups")?;
        let row = sqlx::query_as::<_, (i64, String)>(SELECT_LAST_BACKUP);
        let row = row.fetch_optional(self.0.readers()).await?;
        Ok(row.map(|(at_ms, files)| Backup { at_ms, files: files.parse().unwrap_or_default() }))
    }
}

/// Records a change, in the same transaction as the change.
pub(super) async fn note(
    tx: &mut SqliteConnection,
    scope: &Scope,
    now_ms: i64,
    change: (&'static str, &'static str),
    subject: impl ToString,
) -> StoreResult<()> {
    insert(tx, scope, now_ms, change, (subject.to_string(), None)).await
}

/// Records a change of an attempt of an exam, with the number of the attempt.
pub(super) async fn note_attempt(
    tx: &mut SqliteConnection,
    scope: &Scope,
    now_ms: i64,
    action: &'static str,
    (exam, number): (ExamId, u32),
) -> StoreResult<()> {
    insert(tx, scope, now_ms, (action, "exam"), (exam.to_string(), Some(number))).await
}

async fn insert(
    tx: &mut SqliteConnection,
    scope: &Scope,
    now_ms: i64,
    (action, noun): (&'static str, &'static str),
    (subject, attempt): (String, Option<u32>),
) -> StoreResult<()> {
    sqlx::query(INSERT_ENTRY)
        .bind(now_ms)
        .bind(scope.actor().to_string())
        .bind(action)
        .bind(noun)
        .bind(subject)
        .bind(scope.address().map(|address| address.to_string()))
        .bind(attempt)
        .execute(tx)
        .await?;
    Ok(())
}
