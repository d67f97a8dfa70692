//! Recent sessions that need attention: one bounded query for each kind. What the caller has dismissed is left out.

use super::super::error::StoreResult;
use super::super::visibility::{BindScope, require_staff};
use super::SessionStore;
use crate::domain::text::{Code, Name};
use crate::ids::{SessionId, TaskId, TraineeId};
use crate::store::Scope;

/// A session that needs attention.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct AttentionItem {
    /// The session.
    pub id: SessionId,
    /// Its trainee.
    pub trainee_id: TraineeId,
    /// The trainee's name.
    pub trainee_name: Name,
    /// The trainee's code.
    pub trainee_code: Code,
    /// Its task.
    pub task_id: TaskId,
    /// The task's name.
    pub task_name: Name,
    /// The task's code.
    pub task_code: Code,
    /// When it was recorded, epoch ms.
    pub recorded_at_ms: i64,
}

const SELECT_REFUSED: &str = "
    SELECT session.id, session.trainee_id, trainee.name AS trainee_name, trainee.code AS trainee_code,
           session.task_id, task.name AS task_name, task.code AS task_code, session.recorded_at_ms
    FROM assessed_session AS session
    JOIN trainee ON trainee.id = session.trainee_id
    JOIN task ON task.id = session.task_id
    WHERE session.created_at_ms >= $3
      AND ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($1 <> 'trainee' OR session.id NOT IN (SELECT session_id FROM sealed_session))
      AND session.verdict = 'refused'
      AND NOT EXISTS (SELECT 1 FROM dismissed_session AS dismissed
                      WHERE dismissed.session_id = session.id AND dismissed.kind = 'refused'
                        AND dismissed.person_id = $5 AND coalesce(dismissed.until_ms > $6, TRUE))
    ORDER BY session.created_at_ms DESC, session.id DESC LIMIT $4";

const SELECT_BOX_ASKED: &str = "
    SELECT session.id, session.trainee_id, trainee.name AS trainee_name, trainee.code AS trainee_code,
           session.task_id, task.name AS task_name, task.code AS task_code, session.recorded_at_ms
    FROM session
    JOIN trainee ON trainee.id = session.trainee_id
    JOIN task ON task.id = session.task_id
    WHERE session.box_question = 'asked'
      AND ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($1 <> 'trainee' OR session.id NOT IN (SELECT session_id FROM sealed_session))
      AND NOT EXISTS (SELECT 1 FROM set_aside_session WHERE set_aside_session.session_id = session.id)
      AND NOT EXISTS (SELECT 1 FROM exam_attempt WHERE exam_attempt.session_id = session.id) -- nothing of it is answered
      AND NOT EXISTS (SELECT 1 FROM dismissed_session AS dismissed
                      WHERE dismissed.session_id = session.id AND dismissed.kind = 'box_asked'
                        AND dismissed.person_id = $4 AND coalesce(dismissed.until_ms > $5, TRUE))
    ORDER BY session.created_at_ms DESC, session.id DESC LIMIT $3";

const SELECT_UNRATED: &str = "
    SELECT session.id, session.trainee_id, trainee.name AS trainee_name, trainee.code AS trainee_code,
           session.task_id, task.name AS task_name, task.code AS task_code, session.recorded_at_ms
    FROM assessed_session AS session
    JOIN trainee ON trainee.id = session.trainee_id
    JOIN task ON task.id = session.task_id
    WHERE session.created_at_ms >= $3
      AND ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($1 <> 'trainee' OR session.id NOT IN (SELECT session_id FROM sealed_session))
      AND session.verdict IS NOT 'refused' AND session.tracker IS NULL
      AND NOT EXISTS (SELECT 1 FROM rating WHERE rating.session_id = session.id)
      AND session.task_id IN (SELECT rated.task_id FROM rating JOIN session AS rated ON rated.id = rating.session_id
                              WHERE rating.created_at_ms >= $5)
      AND NOT EXISTS (SELECT 1 FROM dismissed_session AS dismissed
                      WHERE dismissed.session_id = session.id AND dismissed.kind = 'unrated'
                        AND dismissed.person_id = $6 AND coalesce(dismissed.until_ms > $7, TRUE))
    ORDER BY session.created_at_ms DESC, session.id DESC LIMIT $4";

impl SessionStore<'_> {
    /// Sessions that the quality gate refused, latest first, at most `most`.
    pub async fn refused_since(&self, scope: &Scope, since_ms: i64, most: u32) -> StoreResult<Vec<AttentionItem>> {
        let rows = sqlx::query_as(SELECT_REFUSED);
        let rows = rows.bind_scope(scope).bind(since_ms).bind(most).bind(scope.person()).bind(self.0.now_ms());
        Ok(rows.fetch_all(self.0.readers()).await?)
    }

    /// Sessions that may show another box and that no person has answered for, latest first, at most `most`: they wait
    /// until they are answered, however long.
    pub async fn box_asked(&self, scope: &Scope, most: u32) -> StoreResult<Vec<AttentionItem>> {
        let rows = sqlx::query_as(SELECT_BOX_ASKED);
        let rows = rows.bind_scope(scope).bind(most).bind(scope.person()).bind(self.0.now_ms());
        Ok(rows.fetch_all(self.0.readers()).await?)
    }

    /// Sessions without a rating, of tasks with at least one rating since `rated_since_ms`: other tasks are not rated
    /// at this centre.
    pub async fn unrated_since(
        &self,
        scope: &Scope,
        since_ms: i64,
        rated_since_ms: i64,
        most: u32,
    ) -> StoreResult<Vec<AttentionItem>> {
        require_staff(scope, "the list of unrated sessions")?;
        let rows = sqlx::query_as(SELECT_UNRATED);
        let rows = rows.bind_scope(scope).bind(since_ms).bind(most).bind(rated_since_ms);
        let rows = rows.bind(scope.person()).bind(self.0.now_ms());
        Ok(rows.fetch_all(self.0.readers()).await?)
    }
}
