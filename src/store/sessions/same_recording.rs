//! The same recording under another trainee: one of them did not do it.

use super::super::error::StoreResult;
use super::super::visibility::BindScope;
use super::SessionStore;
use crate::domain::text::{Code, Name};
use crate::ids::{SessionId, TaskId, TraineeId};
use crate::store::Scope;

/// A session of another trainee with the same recording.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct SameRecording {
    /// The session.
    pub session: SessionId,
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
    /// When it arrived, epoch ms.
    pub created_at_ms: i64,
}

/// The sessions of other trainees with the same recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SameRecordings {
    /// Those whose trainees the scope sees, the first to arrive first; at most [`MAX_SHOWN`].
    pub seen: Vec<SameRecording>,
    /// True if there are any, also of trainees that the scope does not see.
    pub exist: bool,
}

/// Most sessions that are named.
const MAX_SHOWN: u32 = 20;

const SELECT_SAME_ELSEWHERE: &str = "
    SELECT other.id AS session, other.trainee_id, trainee.name AS trainee_name, trainee.code AS trainee_code,
           other.task_id, task.name AS task_name, task.code AS task_code, other.created_at_ms
    FROM session AS this
    CROSS JOIN session AS other ON other.id IN (SELECT id FROM session WHERE video = this.video
                                                UNION SELECT id FROM session WHERE path_hash = this.path_hash)
    JOIN trainee ON trainee.id = other.trainee_id JOIN task ON task.id = other.task_id
    WHERE this.id = $3 AND other.trainee_id <> this.trainee_id
      AND coalesce(other.cut_of, other.id) <> coalesce(this.cut_of, this.id)
      AND ($1 = 'administrator'
           OR other.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR other.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($1 <> 'trainee' OR other.id NOT IN (SELECT session_id FROM sealed_session))
    ORDER BY other.created_at_ms, other.id LIMIT $4";

const SELECT_IS_ELSEWHERE: &str = "
    SELECT EXISTS (SELECT 1 FROM session AS this
                   CROSS JOIN session AS other ON other.id IN
                       (SELECT id FROM session WHERE video = this.video
                        UNION SELECT id FROM session WHERE path_hash = this.path_hash)
                   WHERE this.id = $1 AND other.trainee_id <> this.trainee_id
                     AND coalesce(other.cut_of, other.id) <> coalesce(this.cut_of, this.id)
                     AND other.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))";

impl SessionStore<'_> {
    /// The same recording under other trainees. The caller sees the session `id`; of the others, the answer has those that
    /// the scope sees.
    pub async fn same_recordings(&self, scope: &Scope, id: SessionId) -> StoreResult<SameRecordings> {
        let seen = sqlx::query_as(SELECT_SAME_ELSEWHERE).bind_scope(scope).bind(id).bind(MAX_SHOWN);
        let exist = sqlx::query_scalar(SELECT_IS_ELSEWHERE).bind(id).fetch_one(self.0.readers()).await?;
        Ok(SameRecordings { seen: seen.fetch_all(self.0.readers()).await?, exist })
    }
}
