//! Rescoring orders for the sessions of a task: created by administrators, executed by [`crate::rescoring`], kept as a
//! record.

use sqlx::types::Json;

use super::audit::note;
use super::columns::integer;
use super::error::{StoreError, StoreResult, not_found};
use super::jobs::{enqueue_rescore, enqueue_track_with_priority};
use super::visibility::require_administrator;
use super::{Scope, Store};
use crate::domain::job::{JobPriority, JobState};
use crate::domain::problem::Problem;
use crate::domain::rescoring::{NewRescoring, RescoringSelection, RescoringSource};
use crate::domain::standard::SessionJudgement;
use crate::ids::{RescoringId, ResultId, SessionId, StandardId, TaskId};
use crate::motion::PIPELINE_VERSION;

mod report;

pub use report::{RescoringItem, RescoringRecord, RescoringTrainee};

/// Access to the rescoring orders.
pub struct RescoringStore<'s>(pub(super) &'s Store);

/// A session of an order whose job has ended.
#[derive(Clone, Debug, PartialEq)]
pub struct EndedItem {
    /// The order.
    pub rescoring: RescoringId,
    /// The session.
    pub session: SessionId,
    /// The result that was current before.
    pub old_result: ResultId,
    /// The result that is current now, or the job's problem; `None` if the job no longer exists.
    pub new_result: Result<ResultId, Option<Problem>>,
    /// The standard to judge both results by.
    pub standard: Option<StandardId>,
}

/// The comparison of a session's old and new results.
#[derive(Clone, Debug, PartialEq)]
pub struct ResultComparison {
    /// The new result.
    pub new_result: ResultId,
    /// The judgements of the old and the new result by the standard; `None` if there is no standard.
    pub judged: Option<[SessionJudgement; 2]>,
    /// Number of features whose error bars do not overlap.
    pub apart: u64,
    /// Number of features that differ by more than rounding, including those.
    pub changed: u64,
}

/// Inserts the sessions of task `$2` for order `$1`: those that have a result and, if `$5`, one of another version than
/// `$3`. `$4` is true if they are tracked anew, which needs their videos.
const INSERT_ITEMS: &str = "
    INSERT INTO rescoring_item (rescoring_id, session_id, old_result_id, state)
    SELECT $1, session.id, result.id, 'waiting' FROM session
    JOIN current_result AS result ON result.session_id = session.id
    JOIN tracking_job AS job ON job.session_id = session.id
    WHERE session.task_id = $2 AND job.state = 'done' AND (NOT $4 OR session.tracker IS NULL)
      AND (NOT $4 OR EXISTS (SELECT 1 FROM blob WHERE blob.hash = session.video AND blob.dropped_at_ms IS NULL))
      AND (NOT $5 OR CASE WHEN $4 THEN coalesce(result.tracked_with, result.pipeline) ELSE result.pipeline END
                     <> CASE WHEN session.tracker IS NULL THEN $3 ELSE $3 || ' on rows by ' || session.tracker END)";

/// Selects at most `$1` waiting sessions, those of the oldest order first.
const SELECT_WAITING: &str = "
    SELECT item.rescoring_id, item.session_id, rescoring.source
    FROM rescoring JOIN rescoring_item AS item ON item.rescoring_id = rescoring.id AND item.state = 'waiting'
    WHERE rescoring.ended_at_ms IS NULL ORDER BY rescoring.id, item.session_id LIMIT $1";

/// Selects at most `$1` sessions whose job has ended, with the result that is current now.
const SELECT_ENDED: &str = "
    SELECT item.rescoring_id, item.session_id, item.old_result_id,
           coalesce(item.new_result_id, (SELECT id FROM current_result WHERE session_id = item.session_id)),
           job.state, job.problem, rescoring.standard_id
    FROM rescoring JOIN rescoring_item AS item ON item.rescoring_id = rescoring.id AND item.state = 'working'
    LEFT JOIN job ON job.id = item.job_id
    WHERE rescoring.ended_at_ms IS NULL AND (job.id IS NULL OR job.state IN ('done', 'failed', 'quarantined'))
    LIMIT $1";

const SELECT_COMPLETED: &str = "SELECT id FROM completed_rescoring";

const END_COMPLETED: &str = "
    UPDATE rescoring SET ended_at_ms = $1 WHERE id IN (SELECT id FROM completed_rescoring)";

type EndedRow =
    (RescoringId, SessionId, ResultId, Option<ResultId>, Option<JobState>, Option<Json<Problem>>, Option<StandardId>);

const SELECT_IS_OPEN: &str = "SELECT EXISTS (SELECT 1 FROM rescoring WHERE task_id = $1 AND ended_at_ms IS NULL)";

const INSERT_RESCORING: &str = "
    INSERT INTO rescoring (id, task_id, source, only_older, pipeline, standard_id, person_id, created_at_ms)
    VALUES ($1, $2, $3, $4, $5,
            (SELECT id FROM standard WHERE task_id = $2 ORDER BY version DESC LIMIT 1), $6, $7)";

const CANCEL_RESCORING: &str = "UPDATE rescoring SET cancelled_at_ms = $2 WHERE id = $1 AND ended_at_ms IS NULL";

const SELECT_RESCORING: &str = "SELECT 1 FROM rescoring WHERE id = $1";

const CANCEL_WAITING: &str = "
    UPDATE rescoring_item SET state = 'cancelled' WHERE rescoring_id = $1 AND state = 'waiting'";

const CANCEL_QUEUED: &str = "
    UPDATE rescoring_item
    SET state = 'cancelled'
    WHERE rescoring_id = $1 AND state = 'working'
      AND job_id IN (SELECT id FROM job WHERE state = 'queued' AND turn = 2)";

const DELETE_CANCELLED_JOBS: &str = "
    DELETE FROM job
    WHERE state = 'queued' AND turn = 2
      AND id IN (SELECT job_id FROM rescoring_item WHERE rescoring_id = $1 AND state = 'cancelled')";

const COUNT_WORKING: &str = "
    SELECT count(*) FROM rescoring_item
    JOIN rescoring ON rescoring.id = rescoring_id
    WHERE rescoring.ended_at_ms IS NULL AND rescoring_item.state = 'working'";

const START_ITEM: &str = "
    UPDATE rescoring_item SET state = 'working', job_id = $3 WHERE rescoring_id = $1 AND session_id = $2";

const FAIL_ITEM: &str = "
    UPDATE rescoring_item
    SET state = 'failed', problem = $3
    WHERE rescoring_id = $1 AND session_id = $2 AND state = 'working'";

const FINISH_ITEM: &str = "
    UPDATE rescoring_item
    SET state = 'done', new_result_id = $3, judged_before = $4, judged_after = $5, judgement_changed = $6,
        features_apart = $7, features_changed = $8
    WHERE rescoring_id = $1 AND session_id = $2 AND state = 'working'";

impl RescoringStore<'_> {
    /// Creates an order to score a task's sessions again. A task can have only one open order.
    pub async fn create(&self, scope: &Scope, task: TaskId, new: NewRescoring) -> StoreResult<RescoringId> {
        require_administrator(scope, "ordering rescorings")?;
        let (by, now_ms, id) = (scope.clone(), self.0.now_ms(), RescoringId::at(self.0.now_ms()));
        self.0
            .write(async move |tx| {
                if sqlx::query_scalar(SELECT_IS_OPEN).bind(task).fetch_one(&mut *tx).await? {
                    return Err(StoreError::refused(
                        "a rescoring of this task is running: wait until it ends, or cancel it",
                    ));
                }
                let from_recording = new.from == RescoringSource::Recording;
                let insert = sqlx::query(INSERT_RESCORING);
                let insert =
                    insert.bind(id).bind(task).bind(new.from.name()).bind(new.which == RescoringSelection::Older);
                insert.bind(PIPELINE_VERSION).bind(by.person()).bind(now_ms).execute(&mut *tx).await?;
                let items = sqlx::query(INSERT_ITEMS).bind(id).bind(task).bind(PIPELINE_VERSION).bind(from_recording);
                if items.bind(new.which == RescoringSelection::Older).execute(&mut *tx).await?.rows_affected() == 0 {
                    return Err(StoreError::refused("no session of this task needs to be scored again"));
                }
                note(tx, &by, now_ms, ("create", "rescoring"), id).await
            })
            .await?;
        Ok(id)
    }

    /// Cancels an order: sessions that wait or are queued are left as they are, running ones run to their end.
    pub async fn cancel(&self, scope: &Scope, id: RescoringId) -> StoreResult<()> {
        require_administrator(scope, "cancelling rescorings")?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                if sqlx::query(CANCEL_RESCORING).bind(id).bind(now_ms).execute(&mut *tx).await?.rows_affected() == 0 {
                    let found: Option<i64> =
                        sqlx::query_scalar(SELECT_RESCORING).bind(id).fetch_optional(&mut *tx).await?;
                    return found.map(drop).ok_or(not_found("rescoring")); // it has ended: nothing to cancel
                }
                for statement in [CANCEL_WAITING, CANCEL_QUEUED, DELETE_CANCELLED_JOBS] {
                    sqlx::query(statement).bind(id).execute(&mut *tx).await?;
                }
                note(tx, &by, now_ms, ("cancel", "rescoring"), id).await
            })
            .await
    }

    /// Queues jobs for waiting sessions so that at most `open` are in the queue; returns how many were queued.
    pub async fn queue_waiting(&self, open: u32) -> StoreResult<usize> {
        let (now_ms, attempts) = (self.0.now_ms(), self.0.max_attempts());
        if self.waiting(1).await?.is_empty() {
            return Ok(0); // checked with a reader first, since every write costs a commit
        }
        self.0
            .write(async move |tx| {
                let working: i64 = sqlx::query_scalar(COUNT_WORKING).fetch_one(&mut *tx).await?;
                let room = i64::from(open) - working;
                let waiting: Vec<(RescoringId, SessionId, String)> =
                    sqlx::query_as(SELECT_WAITING).bind(room.max(0)).fetch_all(&mut *tx).await?;
                for (rescoring, session, source) in &waiting {
                    let job = match source == RescoringSource::Recording.name() {
                        true => {
                            enqueue_track_with_priority(tx, *session, JobPriority::Rescore, now_ms, attempts).await?
                        }
                        false => enqueue_rescore(tx, *session, now_ms, attempts).await?,
                    };
                    // Without a job the item is settled as having lost its job: the box has no camera or colours any
                    // more.
                    let update = sqlx::query(START_ITEM);
                    update.bind(rescoring).bind(session).bind(job).execute(&mut *tx).await?;
                }
                Ok(waiting.len())
            })
            .await
    }

    async fn waiting(&self, most: i64) -> StoreResult<Vec<(RescoringId, SessionId, String)>> {
        Ok(sqlx::query_as(SELECT_WAITING).bind(most).fetch_all(self.0.readers()).await?)
    }

    /// Sessions whose job has ended but that are not settled yet.
    pub async fn ended(&self, most: u32) -> StoreResult<Vec<EndedItem>> {
        let rows = sqlx::query_as::<_, EndedRow>(SELECT_ENDED);
        let rows = rows.bind(most).fetch_all(self.0.readers()).await?;
        let item = |(rescoring, session, old_result, latest, state, problem, standard): EndedRow| {
            let new_result = match (state, latest) {
                (Some(JobState::Done), Some(latest)) => Ok(latest),
                _ => Err(problem.map(|Json(problem)| problem)),
            };
            EndedItem { rescoring, session, old_result, new_result, standard }
        };
        Ok(rows.into_iter().map(item).collect())
    }

    /// Records the outcome of a session.
    pub async fn settle(&self, item: &EndedItem, outcome: Result<ResultComparison, Problem>) -> StoreResult<()> {
        let (rescoring, session) = (item.rescoring, item.session);
        self.0
            .write(async move |tx| {
                let update = match outcome {
                    Err(problem) => sqlx::query(FAIL_ITEM).bind(rescoring).bind(session).bind(Json(problem)),
                    Ok(ResultComparison { new_result, judged, apart, changed }) => {
                        let [before, after] = judged.map_or([None; 2], |judged| judged.map(Some));
                        sqlx::query(FINISH_ITEM)
                            .bind(rescoring)
                            .bind(session)
                            .bind(new_result)
                            .bind(before)
                            .bind(after)
                            .bind(before != after)
                            .bind(integer(apart))
                            .bind(integer(changed))
                    }
                };
                update.execute(tx).await?;
                Ok(())
            })
            .await
    }

    /// Ends the orders without waiting or running sessions.
    pub async fn end_completed(&self) -> StoreResult<()> {
        let open: Vec<RescoringId> = sqlx::query_scalar(SELECT_COMPLETED).fetch_all(self.0.readers()).await?;
        if open.is_empty() {
            return Ok(());
        }
        let now_ms = self.0.now_ms();
        self.0
            .write(async move |tx| {
                sqlx::query(END_COMPLETED).bind(now_ms).execute(tx).await?;
                Ok(())
            })
            .await
    }
}
