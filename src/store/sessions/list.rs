//! Lists of sessions: filters, two orders, and how many a filter shows.

use serde::Serialize;
use sqlx::types::Json;

use super::super::error::{StoreError, StoreResult};
use super::super::page::{Page, PageRequest};
use super::super::visibility::BindScope;
use super::{SessionRecord, SessionStore};
use crate::domain::blob::BlobHash;
use crate::domain::session::{SessionOrder, SessionOutcome, SessionStatus};
use crate::domain::text::{Key, SearchWords};
use crate::ids::SessionId;
use crate::store::Scope;

/// A filter for lists of sessions.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SessionFilter {
    /// Only of this trainee, by id or code.
    pub trainee: Option<Key>,
    /// Only of this task, by id or code.
    pub task: Option<Key>,
    /// Only in this box, by id or code.
    pub in_box: Option<Key>,
    /// Only sessions with this status.
    pub status: Option<SessionStatus>,
    /// Only sessions that count: neither set aside, nor of a box that is asked about.
    pub only_counting: bool,
    /// Only sessions with this outcome.
    pub outcome: Option<SessionOutcome>,
    /// Only sessions whose trainee, task, box or file has each of these words in its name or code.
    pub search: Option<SearchWords>,
    /// Only sessions recorded then or later, epoch ms.
    pub recorded_from_ms: Option<i64>,
    /// Only sessions recorded before this moment, epoch ms.
    pub recorded_before_ms: Option<i64>,
    /// Only sessions with this recording.
    pub recording: Option<BlobHash>,
}

/// How many sessions a filter shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, utoipa::ToSchema, sqlx::FromRow)]
pub struct SessionCount {
    /// Number of sessions that match.
    pub matching: i64,
    /// Number of all sessions that the caller sees.
    pub all: i64,
}

const SELECT_BY_ARRIVAL: &str = "
    SELECT session_record.*, (SELECT dropped_at_ms FROM blob WHERE hash = video) AS video_dropped_at_ms, background.*
    FROM session_record JOIN session_background AS background ON background.session_id = session_record.id
    WHERE ($1 = 'administrator'
           OR trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($1 <> 'trainee' OR session_record.id NOT IN (SELECT session_id FROM sealed_session))
      AND ($3 IS NULL OR $3 IN (trainee_id, trainee_code))
      AND ($4 IS NULL OR $4 IN (task_id, task_code))
      AND ($5 IS NULL OR $5 IN (box_id, box_code))
      AND ($6 IS NULL OR $6 = CASE WHEN video IS NULL THEN 'receiving'
                              WHEN job_state = 'running' THEN 'tracking' WHEN job_state = 'done' THEN 'done'
                              WHEN job_state IN ('failed', 'quarantined') THEN 'failed'
                              WHEN job_state IS NULL AND EXISTS (SELECT 1 FROM blob WHERE hash = video
                                                                 AND dropped_at_ms IS NOT NULL) THEN 'failed'
                              ELSE 'queued' END)
      AND (NOT $7
           OR NOT EXISTS (SELECT 1 FROM uncounted_session WHERE uncounted_session.session_id = session_record.id))
      AND ($8 IS NULL OR EXISTS (SELECT 1 FROM session_outcome AS came WHERE came.session_id = session_record.id
                                 AND (came.outcome = $8 OR (came.verdict = $8 AND came.outcome
                                      IN ('passed', 'missed', 'undecided', 'done')))))
      AND ($9 IS NULL OR NOT EXISTS (SELECT 1 FROM json_each($9) AS word WHERE NOT EXISTS
           (SELECT 1 FROM json_each(word.value) AS variant
            WHERE instr(lower(concat_ws(char(10), trainee_name, trainee_code, task_name, task_code, box_name, box_code,
                                        filename)), lower(variant.value)) > 0)))
      AND ($10 IS NULL OR recorded_at_ms >= $10)
      AND ($11 IS NULL OR recorded_at_ms < $11)
      AND ($12 IS NULL OR id IN (SELECT same.id FROM session AS same WHERE same.video = $12))
      AND ($13 IS NULL OR id < $13)
    ORDER BY id DESC LIMIT $14";

pub(in crate::store) const SELECT_BY_RECORDING: &str = "
    SELECT session_record.*, (SELECT dropped_at_ms FROM blob WHERE hash = video) AS video_dropped_at_ms, background.*
    FROM session_record JOIN session_background AS background ON background.session_id = session_record.id
    WHERE ($1 = 'administrator'
           OR trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($1 <> 'trainee' OR session_record.id NOT IN (SELECT session_id FROM sealed_session))
      AND ($3 IS NULL OR $3 IN (trainee_id, trainee_code))
      AND ($4 IS NULL OR $4 IN (task_id, task_code))
      AND ($5 IS NULL OR $5 IN (box_id, box_code))
      AND ($6 IS NULL OR $6 = CASE WHEN video IS NULL THEN 'receiving'
                              WHEN job_state = 'running' THEN 'tracking' WHEN job_state = 'done' THEN 'done'
                              WHEN job_state IN ('failed', 'quarantined') THEN 'failed'
                              WHEN job_state IS NULL AND EXISTS (SELECT 1 FROM blob WHERE hash = video
                                                                 AND dropped_at_ms IS NOT NULL) THEN 'failed'
                              ELSE 'queued' END)
      AND (NOT $7
           OR NOT EXISTS (SELECT 1 FROM uncounted_session WHERE uncounted_session.session_id = session_record.id))
      AND ($8 IS NULL OR EXISTS (SELECT 1 FROM session_outcome AS came WHERE came.session_id = session_record.id
                                 AND (came.outcome = $8 OR (came.verdict = $8 AND came.outcome
                                      IN ('passed', 'missed', 'undecided', 'done')))))
      AND ($9 IS NULL OR NOT EXISTS (SELECT 1 FROM json_each($9) AS word WHERE NOT EXISTS
           (SELECT 1 FROM json_each(word.value) AS variant
            WHERE instr(lower(concat_ws(char(10), trainee_name, trainee_code, task_name, task_code, box_name, box_code,
                                        filename)), lower(variant.value)) > 0)))
      AND recorded_at_ms >= coalesce($10, -9223372036854775807)
      AND recorded_at_ms < coalesce($11, 9223372036854775807)
      AND ($12 IS NULL OR id IN (SELECT same.id FROM session AS same WHERE same.video = $12))
      AND (recorded_at_ms, id) < (coalesce($13, 9223372036854775807), coalesce($14, '~'))
    ORDER BY recorded_at_ms DESC, id DESC LIMIT $15";

const COUNT_SESSIONS: &str = "
    WITH seen AS
        (SELECT session.*, trainee.name || char(10) || trainee.code AS trainee_words, trainee.code AS trainee_code,
                task.name || char(10) || task.code AS task_words, task.code AS task_code,
                training_box.name || char(10) || training_box.code AS box_words, training_box.code AS box_code
         FROM session JOIN trainee ON trainee.id = trainee_id JOIN task ON task.id = task_id
         JOIN training_box ON training_box.id = box_id
         WHERE ($1 = 'administrator'
                OR trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
           AND ($2 IS 'service' OR trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
           AND ($1 <> 'trainee' OR session.id NOT IN (SELECT session_id FROM sealed_session)))
    SELECT (SELECT count(*) FROM seen) AS \"all\",
           (SELECT count(*) FROM seen
            WHERE ($3 IS NULL OR $3 IN (trainee_id, trainee_code))
              AND ($4 IS NULL OR $4 IN (task_id, task_code))
              AND ($5 IS NULL OR $5 IN (box_id, box_code))
              AND ($6 IS NULL OR EXISTS (SELECT 1 FROM session_outcome AS came WHERE came.session_id = seen.id
                                         AND $6 = CASE WHEN came.outcome IN ('receiving', 'queued', 'tracking', 'failed')
                                                            THEN came.outcome
                                                       WHEN came.outcome = 'quarantined' THEN 'failed'
                                                       ELSE 'done' END))
              AND (NOT $7 OR NOT EXISTS (SELECT 1 FROM uncounted_session WHERE uncounted_session.session_id = seen.id))
              AND ($8 IS NULL OR EXISTS (SELECT 1 FROM session_outcome AS came WHERE came.session_id = seen.id
                                         AND (came.outcome = $8 OR (came.verdict = $8 AND came.outcome
                                              IN ('passed', 'missed', 'undecided', 'done')))))
              AND ($9 IS NULL OR NOT EXISTS (SELECT 1 FROM json_each($9) AS word WHERE NOT EXISTS
                   (SELECT 1 FROM json_each(word.value) AS variant
                    WHERE instr(lower(concat_ws(char(10), trainee_words, task_words, box_words, filename)),
                                lower(variant.value)) > 0)))
              AND ($10 IS NULL OR recorded_at_ms >= $10)
              AND ($11 IS NULL OR recorded_at_ms < $11)
              AND ($12 IS NULL OR video = $12)) AS matching";

/// Binds a filter as `$3` to `$12`, after the scope.
macro_rules! bind_filter {
    ($query:expr, $scope:expr, $which:expr) => {{
        let (query, which) = ($query.bind_scope($scope), $which);
        let query = query.bind(&which.trainee).bind(&which.task).bind(&which.in_box);
        let query = query.bind(which.status.map(SessionStatus::name)).bind(which.only_counting).bind(which.outcome);
        let query = query.bind(which.search.as_ref().map(|words| Json(words.variants())));
        query.bind(which.recorded_from_ms).bind(which.recorded_before_ms).bind(which.recording)
    }};
}

impl SessionStore<'_> {
    /// The sessions that the scope sees, the last to arrive first.
    pub async fn list(
        &self,
        scope: &Scope,
        which: &SessionFilter,
        page: &PageRequest,
    ) -> StoreResult<Page<SessionRecord>> {
        self.list_ordered(scope, which, SessionOrder::Arrival, page).await
    }

    /// The sessions that the scope sees, in this order. The sort key of arrival is the id, which holds the time.
    pub async fn list_ordered(
        &self,
        scope: &Scope,
        which: &SessionFilter,
        order: SessionOrder,
        page: &PageRequest,
    ) -> StoreResult<Page<SessionRecord>> {
        let mut rows: Vec<SessionRecord> = match order {
            SessionOrder::Arrival => {
                let rows = bind_filter!(sqlx::query_as(SELECT_BY_ARRIVAL), scope, which);
                rows.bind(page.after()).bind(page.row_limit()).fetch_all(self.0.readers()).await?
            }
            SessionOrder::Recorded => {
                let (recorded_at_ms, id) = page.after().map(recording_key).transpose()?.unzip();
                let rows = bind_filter!(sqlx::query_as(SELECT_BY_RECORDING), scope, which);
                let rows = rows.bind(recorded_at_ms).bind(id).bind(page.row_limit());
                rows.fetch_all(self.0.readers()).await?
            }
        };
        self.fill_queue_positions(&mut rows).await?;
        Ok(Page::from_rows(rows, page, |session: &SessionRecord| match order {
            SessionOrder::Arrival => session.id.to_string(),
            SessionOrder::Recorded => format!("{} {}", session.recorded_at_ms, session.id),
        }))
    }

    /// How many sessions match, and how many there are for this scope.
    pub async fn count(&self, scope: &Scope, which: &SessionFilter) -> StoreResult<SessionCount> {
        Ok(bind_filter!(sqlx::query_as(COUNT_SESSIONS), scope, which).fetch_one(self.0.readers()).await?)
    }
}

/// The sort key of a list by recording time: time and id.
fn recording_key(key: &str) -> StoreResult<(i64, SessionId)> {
    let parts = key.split_once(' ').and_then(|(at_ms, id)| at_ms.parse().ok().zip(id.parse().ok()));
    parts.ok_or_else(|| StoreError::refused("this cursor is of another list: begin with the first page"))
}
