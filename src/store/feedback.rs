//! Feedback on a trainee's own sessions that is new to the trainee: comments and ratings of other people since the
//! trainee last opened the session. When a session was opened is stored for the person, so it holds on all devices. Only
//! the trainee reads it: it is no proof for staff that feedback was read.

use sqlx::sqlite::SqliteConnection;

use super::attention::RECENT_MS;
use super::error::{StoreError, StoreResult, ignore_full_or_busy, missing};
use super::visibility::BindScope;
use super::{Scope, Store};
use crate::domain::rating::RatingForm;
use crate::domain::text::{Code, Name};
use crate::ids::{PersonId, SessionId, TaskId};

/// Access to the new feedback of trainees.
pub struct FeedbackStore<'s>(pub(super) &'s Store);

/// Maximum number of comments and ratings that are read, newest first.
const MAX_ENTRIES: i64 = 500;

/// A comment or a rating that is new to the trainee.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct FeedbackEntry {
    /// The session.
    pub session_id: SessionId,
    /// When the session was recorded, epoch ms.
    pub recorded_at_ms: i64,
    /// The session's task.
    pub task_id: TaskId,
    /// The task's name.
    pub task_name: Name,
    /// The task's code.
    pub task_code: Code,
    /// Of a rating: its form; `None` for a comment.
    pub form: Option<RatingForm>,
    /// The author; `None` if the account has been deleted.
    pub person_id: Option<PersonId>,
    /// The author's name.
    pub who: Option<Name>,
    /// When it was given, epoch ms.
    pub created_at_ms: i64,
}

/// When a person last opened a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct SessionOpening {
    /// The session.
    pub session_id: SessionId,
    /// When, epoch ms.
    pub opened_at_ms: i64,
}

/// Selects at most `$4` comments and ratings by others than person `$3` on sessions that they have not opened since.
/// Comments of trainees are left out: they are of a trainee whose session it was before it was moved.
const SELECT_NEW_FEEDBACK: &str = "
    WITH own (session_id, recorded_at_ms, task_id, seen_ms) AS
        (SELECT session.id, session.recorded_at_ms, session.task_id, coalesce(opening.opened_at_ms, 0)
         FROM session
         LEFT JOIN session_opening AS opening ON opening.session_id = session.id AND opening.person_id = $3
         WHERE $1 = 'trainee'
           AND session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2)
           AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
           AND ($1 <> 'trainee' OR session.id NOT IN (SELECT session_id FROM sealed_session))),
    entry (session_id, person_id, form, created_at_ms) AS
        (SELECT own.session_id, comment.person_id, NULL, comment.created_at_ms
         FROM own JOIN comment ON comment.session_id = own.session_id AND comment.created_at_ms > own.seen_ms
         UNION ALL
         SELECT own.session_id, rating.person_id, rating.form, rating.created_at_ms
         FROM own JOIN rating ON rating.session_id = own.session_id AND rating.created_at_ms > own.seen_ms)
    SELECT own.session_id, own.recorded_at_ms, task.id AS task_id, task.name AS task_name, task.code AS task_code,
           entry.form, entry.person_id, person.name AS who, entry.created_at_ms
    FROM entry
    JOIN own ON own.session_id = entry.session_id
    JOIN task ON task.id = own.task_id
    LEFT JOIN person ON person.id = entry.person_id
    WHERE entry.person_id IS NOT $3 AND coalesce(person.role, 'instructor') <> 'trainee'
    ORDER BY entry.created_at_ms DESC, own.session_id DESC LIMIT $4";

/// Selects at most `$5` sessions whose result of `$4` or later person `$3` has not seen, the latest result first.
const SELECT_NEW_RESULTS: &str = "
    SELECT session.id FROM session
    JOIN current_result AS result ON result.session_id = session.id
    LEFT JOIN session_opening AS opening ON opening.session_id = session.id AND opening.person_id = $3
    WHERE $1 = 'trainee'
      AND session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2)
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($1 <> 'trainee' OR session.id NOT IN (SELECT session_id FROM sealed_session))
      AND result.created_at_ms >= $4 AND result.created_at_ms > coalesce(opening.opened_at_ms, 0)
    ORDER BY result.created_at_ms DESC, session.id DESC LIMIT $5";

const UPSERT_OPENING: &str = "
    INSERT INTO session_opening (person_id, session_id, opened_at_ms) VALUES ($1, $2, $3)
    ON CONFLICT (person_id, session_id) DO UPDATE SET opened_at_ms = max(opened_at_ms, excluded.opened_at_ms)";

/// Marks all sessions of the trainee as opened by person `$3` at `$4` that have feedback until then.
const UPSERT_ALL_OPENINGS: &str = "
    INSERT INTO session_opening (person_id, session_id, opened_at_ms)
    SELECT $3, session.id, $4 FROM session
    WHERE $1 = 'trainee'
      AND session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2)
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($1 <> 'trainee' OR session.id NOT IN (SELECT session_id FROM sealed_session))
      AND (EXISTS (SELECT 1 FROM comment WHERE comment.session_id = session.id AND comment.created_at_ms <= $4)
           OR EXISTS (SELECT 1 FROM rating WHERE rating.session_id = session.id AND rating.created_at_ms <= $4))
    ON CONFLICT (person_id, session_id) DO UPDATE SET opened_at_ms = max(opened_at_ms, excluded.opened_at_ms)";

const SELECT_OPENING: &str = "SELECT opened_at_ms FROM session_opening WHERE person_id = $1 AND session_id = $2";

const SELECT_OPENINGS: &str = "
    SELECT session_id, opened_at_ms FROM session_opening WHERE person_id = $1 ORDER BY opened_at_ms, session_id";

impl FeedbackStore<'_> {
    /// The comments and ratings that are new to the trainee, newest first.
    pub async fn unseen(&self, scope: &Scope) -> StoreResult<Vec<FeedbackEntry>> {
        let person = require_own(scope)?;
        let rows = sqlx::query_as(SELECT_NEW_FEEDBACK).bind_scope(scope).bind(person).bind(MAX_ENTRIES);
        Ok(rows.fetch_all(self.0.readers()).await?)
    }

    /// Own sessions with a result of the last days that the trainee has not seen, at most `most`.
    pub async fn new_results(&self, scope: &Scope, most: u32) -> StoreResult<Vec<SessionId>> {
        let (person, since_ms) = (require_own(scope)?, self.0.now_ms() - RECENT_MS);
        let rows = sqlx::query_scalar(SELECT_NEW_RESULTS).bind_scope(scope).bind(person).bind(since_ms).bind(most);
        Ok(rows.fetch_all(self.0.readers()).await?)
    }

    /// Stores that the trainee opens one of their own sessions now. On a full disk it stays new. Returns when they opened
    /// it before, epoch ms.
    pub async fn open(&self, scope: &Scope, session: SessionId) -> StoreResult<Option<i64>> {
        let person = require_own(scope)?;
        self.0.sessions().get(scope, session).await?;
        let before = sqlx::query_scalar(SELECT_OPENING).bind(person).bind(session);
        let before: Option<i64> = before.fetch_optional(self.0.readers()).await?;
        let now_ms = self.0.now_ms();
        let stored = self.0.write(async move |tx| upsert_opening(tx, person, session, now_ms).await).await;
        ignore_full_or_busy(stored)?;
        Ok(before)
    }

    /// Marks all feedback until `until_ms` as seen, but nothing that is given later.
    pub async fn mark_all_seen(&self, scope: &Scope, until_ms: i64) -> StoreResult<()> {
        let person = require_own(scope)?;
        let (by, until_ms) = (scope.clone(), until_ms.clamp(0, self.0.now_ms()));
        self.0
            .write(async move |tx| {
                let mark = sqlx::query(UPSERT_ALL_OPENINGS).bind_scope(&by).bind(person).bind(until_ms);
                mark.execute(&mut *tx).await?;
                Ok(())
            })
            .await
    }

    /// When this person last opened each session, for the export of their data.
    pub async fn openings(&self, person: PersonId) -> StoreResult<Vec<SessionOpening>> {
        Ok(sqlx::query_as(SELECT_OPENINGS).bind(person).fetch_all(self.0.readers()).await?)
    }
}

async fn upsert_opening(
    tx: &mut SqliteConnection,
    person: PersonId,
    session: SessionId,
    now_ms: i64,
) -> StoreResult<()> {
    let upsert = sqlx::query(UPSERT_OPENING).bind(person).bind(session).bind(now_ms);
    upsert.execute(tx).await.map_err(missing("session"))?;
    Ok(())
}

/// The account of the trainee who calls.
fn require_own(scope: &Scope) -> StoreResult<PersonId> {
    let person = scope.own_trainee().and(scope.person());
    person.ok_or(StoreError::Forbidden { what: "feedback on own sessions", whom: "trainees" })
}
