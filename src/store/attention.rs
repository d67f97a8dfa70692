//! What staff dismissed from their own lists of what needs attention. It changes no other list and no data of the
//! trainee, so the audit trail does not have it. What happens later is listed again: a dismissal covers only the sessions
//! or the alarm that it names, and a session only while it is filed under the same trainee and task.

use std::collections::HashSet;

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::error::{StoreError, StoreResult, missing, not_found};
use super::visibility::{BindScope, require_staff, require_trainee};
use super::{Scope, Store};
use crate::domain::attention::{AttentionKind, NewDismissal};
use crate::domain::text::{Code, Name};
use crate::ids::{DismissalId, PersonId, SessionId, TaskId, TraineeId};

/// Access to the dismissals.
pub struct AttentionStore<'s>(pub(super) &'s Store);

/// Maximum number of dismissals of one person.
const MAX_DISMISSALS: i64 = 2_000;

/// Maximum number of dismissals that are listed, newest first.
const MAX_LISTED: i64 = 200;

/// Refused and unrated sessions are listed for this long after their arrival. A dismissal of them is forgotten afterwards.
pub const RECENT_MS: i64 = 14 * 86_400_000;

/// A dismissal that is in force.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct DismissalRecord {
    /// Its id.
    pub id: DismissalId,
    /// What is dismissed.
    pub kind: AttentionKind,
    /// The trainee.
    pub trainee_id: TraineeId,
    /// The trainee's name.
    pub trainee_name: Name,
    /// The trainee's code.
    pub trainee_code: Code,
    /// The task.
    pub task_id: TaskId,
    /// The task's name.
    pub task_name: Name,
    /// The task's code.
    pub task_code: Code,
    /// Number of sessions that it covers; 0 for an alarm.
    pub sessions: i64,
    /// When it ends, epoch ms; `None`: it does not end.
    pub until_ms: Option<i64>,
    /// When it was made, epoch ms.
    pub created_at_ms: i64,
}

/// An alarm: its kind, trainee, task and start, epoch ms.
pub type AlarmKey = (AttentionKind, TraineeId, TaskId, i64);

const INSERT_DISMISSAL: &str = "
    INSERT INTO attention_dismissal (id, person_id, kind, trainee_id, task_id, since_ms, until_ms, created_at_ms)
    SELECT $1, $2, $3, $4, $5, $6, $7, $8
    WHERE (SELECT count(*) FROM attention_dismissal WHERE person_id = $2) < $9";

const INSERT_DISMISSED_SESSION: &str = "
    INSERT INTO attention_dismissal_session (dismissal_id, session_id) SELECT DISTINCT $1, value FROM json_each($2)";

/// Counts which of the sessions `$3` (a JSON array) are of trainee `$4` at task `$5`.
const COUNT_SESSIONS: &str = "
    SELECT count(*) FROM session
    WHERE id IN (SELECT value FROM json_each($3)) AND trainee_id = $4 AND task_id = $5
      AND ($1 = 'administrator'
           OR trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($1 <> 'trainee' OR session.id NOT IN (SELECT session_id FROM sealed_session))";

/// Deletes the dismissals of person `$1` that ended before `$2`, those of recent sessions made before `$3`, and earlier
/// ones of the same alarm: kind `$4` of trainee `$5` at task `$6`.
const DELETE_OUTDATED: &str = "
    DELETE FROM attention_dismissal
    WHERE person_id = $1
      AND (coalesce(until_ms <= $2, FALSE)
           OR kind IN ('refused', 'unrated') AND created_at_ms < $3
           OR kind IN ('relapsed', 'due') AND kind = $4 AND trainee_id = $5 AND task_id = $6)";

const SELECT_DISMISSALS: &str = "
    SELECT dismissal.id, dismissal.kind, trainee.id AS trainee_id, trainee.name AS trainee_name,
           trainee.code AS trainee_code, task.id AS task_id, task.name AS task_name, task.code AS task_code,
           (SELECT count(*) FROM attention_dismissal_session WHERE dismissal_id = dismissal.id) AS sessions,
           dismissal.until_ms, dismissal.created_at_ms
    FROM attention_dismissal AS dismissal
    JOIN trainee ON trainee.id = dismissal.trainee_id
    JOIN task ON task.id = dismissal.task_id
    WHERE dismissal.person_id = $3 AND coalesce(dismissal.until_ms > $4, TRUE)
      AND NOT (dismissal.kind IN ('refused', 'unrated') AND dismissal.created_at_ms < $5)
      AND ($1 = 'administrator'
           OR dismissal.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR dismissal.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
    ORDER BY dismissal.created_at_ms DESC, dismissal.id DESC LIMIT $6";

const SELECT_DISMISSED_ALARMS: &str = "
    SELECT kind, trainee_id, task_id, since_ms FROM attention_dismissal
    WHERE person_id = $1 AND since_ms IS NOT NULL AND coalesce(until_ms > $2, TRUE)";

const DELETE_DISMISSAL: &str = "DELETE FROM attention_dismissal WHERE id = $1 AND person_id = $2";

impl AttentionStore<'_> {
    /// Dismisses sessions or an alarm from the caller's own list. `since_ms`: as [`NewDismissal::since_ms`] gives it.
    pub async fn dismiss(
        &self,
        scope: &Scope,
        new: NewDismissal,
        since_ms: Option<i64>,
    ) -> StoreResult<DismissalRecord> {
        let person = require_person(scope)?;
        let (by, now_ms, id) = (scope.clone(), self.0.now_ms(), DismissalId::at(self.0.now_ms()));
        let until_ms = new.days.map(|days| now_ms + i64::from(days) * 86_400_000);
        self.0
            .write(async move |tx| {
                require_trainee(tx, &by, new.trainee).await?;
                require_sessions(tx, &by, &new).await?;
                let delete = sqlx::query(DELETE_OUTDATED).bind(person).bind(now_ms).bind(now_ms - RECENT_MS);
                delete.bind(new.kind).bind(new.trainee).bind(new.task).execute(&mut *tx).await?;
                let insert = sqlx::query(INSERT_DISMISSAL).bind(id).bind(person).bind(new.kind).bind(new.trainee);
                let insert = insert.bind(new.task).bind(since_ms).bind(until_ms).bind(now_ms).bind(MAX_DISMISSALS);
                if insert.execute(&mut *tx).await.map_err(missing("task"))?.rows_affected() == 0 {
                    return Err(StoreError::refused(format!(
                        "you have dismissed {MAX_DISMISSALS} entries, which is the limit; undo some of them first"
                    )));
                }
                let cover = sqlx::query(INSERT_DISMISSED_SESSION).bind(id).bind(Json(new.sessions));
                cover.execute(&mut *tx).await.map_err(missing("session"))?;
                Ok(())
            })
            .await?;
        let all = self.list(scope).await?;
        all.into_iter().find(|dismissal| dismissal.id == id).ok_or(not_found("dismissal"))
    }

    /// The caller's dismissals that are in force, newest first.
    pub async fn list(&self, scope: &Scope) -> StoreResult<Vec<DismissalRecord>> {
        let (person, now_ms) = (require_person(scope)?, self.0.now_ms());
        let rows = sqlx::query_as(SELECT_DISMISSALS).bind_scope(scope).bind(person).bind(now_ms);
        Ok(rows.bind(now_ms - RECENT_MS).bind(MAX_LISTED).fetch_all(self.0.readers()).await?)
    }

    /// The alarms that the caller has dismissed.
    pub async fn dismissed_alarms(&self, scope: &Scope) -> StoreResult<HashSet<AlarmKey>> {
        let rows = sqlx::query_as(SELECT_DISMISSED_ALARMS).bind(scope.person()).bind(self.0.now_ms());
        let rows: Vec<AlarmKey> = rows.fetch_all(self.0.readers()).await?;
        Ok(rows.into_iter().collect())
    }

    /// Takes one of the caller's own dismissals back.
    pub async fn undo(&self, scope: &Scope, id: DismissalId) -> StoreResult<()> {
        let person = require_person(scope)?;
        self.0
            .write(async move |tx| {
                let delete = sqlx::query(DELETE_DISMISSAL).bind(id).bind(person).execute(tx).await?;
                if delete.rows_affected() == 0 { Err(not_found("dismissal")) } else { Ok(()) }
            })
            .await
    }
}

/// The staff member who calls.
fn require_person(scope: &Scope) -> StoreResult<PersonId> {
    require_staff(scope, "dismissing what needs attention")?;
    scope.person().ok_or(StoreError::Forbidden { what: "dismissing what needs attention", whom: "people" })
}

/// Refuses sessions that are missing, hidden, or of another trainee or task.
async fn require_sessions(tx: &mut SqliteConnection, scope: &Scope, new: &NewDismissal) -> StoreResult<()> {
    let named: HashSet<&SessionId> = new.sessions.iter().collect();
    let count = sqlx::query_scalar(COUNT_SESSIONS).bind_scope(scope).bind(Json(&new.sessions));
    let found: i64 = count.bind(new.trainee).bind(new.task).fetch_one(tx).await?;
    if found as usize == named.len() { Ok(()) } else { Err(not_found("session")) }
}
