//! Reports on rescoring orders: pages of sessions and of trainees, those whose judgement changed first.

use sqlx::FromRow;

use super::super::error::{StoreResult, not_found};
use super::super::page::{Page, PageRequest};
use super::super::visibility::require_administrator;
use super::RescoringStore;
use crate::domain::problem::Problem;
use crate::domain::rescoring::{RescoringItemState, RescoringSource};
use crate::domain::standard::SessionJudgement;
use crate::domain::text::{Code, Name};
use crate::ids::{RescoringId, ResultId, SessionId, TaskId, TraineeId};
use crate::store::Scope;

/// An order and its progress.
#[derive(Clone, Debug, PartialEq, FromRow)]
pub struct RescoringRecord {
    /// Its id.
    pub id: RescoringId,
    /// The task whose sessions are scored again.
    pub task_id: TaskId,
    /// The task's name.
    pub task_name: Name,
    /// The task's code.
    pub task_code: Code,
    /// What is scored again: the stored path or the recording.
    pub source: RescoringSource,
    /// True if only sessions with a result of another version are included.
    pub only_older: bool,
    /// Version of the program when it was ordered.
    pub pipeline: String,
    /// Version of the standard that judges old and new results.
    pub standard: Option<i64>,
    /// Name of the person who ordered it; `None` if a program did, or the account has been deleted.
    pub who: Option<String>,
    /// When it was ordered, epoch ms.
    pub created_at_ms: i64,
    /// When it was cancelled, epoch ms.
    pub cancelled_at_ms: Option<i64>,
    /// When its last session ended, epoch ms.
    pub ended_at_ms: Option<i64>,
    /// Number of sessions.
    pub sessions: i64,
    /// Sessions that wait.
    pub waiting: i64,
    /// Sessions with a queued or running job.
    pub working: i64,
    /// Sessions whose results are compared.
    pub done: i64,
    /// Sessions that failed.
    pub failed: i64,
    /// Sessions that were left out when it was cancelled.
    pub cancelled: i64,
    /// Sessions that passed before and do not pass now.
    pub no_longer_passed: i64,
    /// Sessions that did not pass before and pass now.
    pub now_passed: i64,
    /// Sessions with a feature whose error bars do not overlap.
    pub apart: i64,
    /// Sessions with a feature that differs by more than rounding.
    pub changed: i64,
}

/// One session of an order.
#[derive(Clone, Debug, PartialEq, FromRow)]
pub struct RescoringItem {
    /// The session.
    pub session_id: SessionId,
    /// The trainee.
    pub trainee_id: TraineeId,
    /// The trainee's name.
    pub trainee_name: Name,
    /// The trainee's code.
    pub trainee_code: Code,
    /// When it was recorded, epoch ms.
    pub recorded_at_ms: i64,
    /// Its state.
    pub state: RescoringItemState,
    /// Why it failed.
    #[sqlx(json(nullable))]
    pub problem: Option<Problem>,
    /// The result that was current when it was ordered.
    pub old_result_id: ResultId,
    /// The new result.
    pub new_result_id: Option<ResultId>,
    /// Judgement of the old result by the standard.
    pub judged_before: Option<SessionJudgement>,
    /// Judgement of the new result.
    pub judged_after: Option<SessionJudgement>,
    judgement_changed: bool,
    /// Features whose error bars do not overlap.
    pub features_apart: i64,
    /// Features that differ by more than rounding.
    pub features_changed: i64,
}

/// What an order changed for one trainee.
#[derive(Clone, Debug, PartialEq, FromRow)]
pub struct RescoringTrainee {
    /// The trainee.
    pub trainee_id: TraineeId,
    /// The trainee's name.
    pub trainee_name: Name,
    /// The trainee's code.
    pub trainee_code: Code,
    /// Their sessions in the order.
    pub sessions: i64,
    /// Those whose results are compared.
    pub done: i64,
    judgements: i64,
    /// Those that passed before and do not pass now.
    pub no_longer_passed: i64,
    /// Those that did not pass before and pass now.
    pub now_passed: i64,
    /// Those with a feature whose error bars do not overlap.
    pub apart: i64,
    /// Those with a feature that differs by more than rounding.
    pub changed: i64,
}

/// Selects at most `$2` orders before order `$1`, or order `$3` only; newest first.
const SELECT_RESCORINGS: &str = "
    SELECT rescoring.id, rescoring.task_id, task.name AS task_name, task.code AS task_code, rescoring.source,
           rescoring.only_older, rescoring.pipeline, standard.version AS standard, person.name AS who,
           rescoring.created_at_ms, rescoring.cancelled_at_ms, rescoring.ended_at_ms,
           count(item.session_id) AS sessions,
           coalesce(sum(item.state = 'waiting'), 0) AS waiting,
           coalesce(sum(item.state = 'working'), 0) AS working,
           coalesce(sum(item.state = 'done'), 0) AS done,
           coalesce(sum(item.state = 'failed'), 0) AS failed,
           coalesce(sum(item.state = 'cancelled'), 0) AS cancelled,
           coalesce(sum(item.judged_before = 'pass' AND item.judged_after <> 'pass'), 0) AS no_longer_passed,
           coalesce(sum(item.judged_before <> 'pass' AND item.judged_after = 'pass'), 0) AS now_passed,
           coalesce(sum(item.features_apart > 0), 0) AS apart,
           coalesce(sum(item.features_changed > 0), 0) AS changed
    FROM rescoring JOIN task ON task.id = rescoring.task_id
    LEFT JOIN standard ON standard.id = rescoring.standard_id
    LEFT JOIN person ON person.id = rescoring.person_id
    LEFT JOIN rescoring_item AS item ON item.rescoring_id = rescoring.id
    WHERE ($1 IS NULL OR rescoring.id < $1) AND ($3 IS NULL OR rescoring.id = $3)
    GROUP BY rescoring.id ORDER BY rescoring.id DESC LIMIT $2";

/// Selects at most `$6` items of order `$1` after the item with the sort key `$2` to `$5`.
const SELECT_ITEMS: &str = "
    SELECT item.session_id, session.trainee_id, trainee.name AS trainee_name, trainee.code AS trainee_code,
           session.recorded_at_ms, item.state, item.problem, item.old_result_id, item.new_result_id,
           item.judged_before, item.judged_after, item.judgement_changed, item.features_apart, item.features_changed
    FROM rescoring_item AS item
    JOIN session ON session.id = item.session_id
    JOIN trainee ON trainee.id = session.trainee_id
    WHERE item.rescoring_id = $1 AND session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee)
      AND ((item.judgement_changed, item.features_apart, item.features_changed) < ($2, $3, $4)
           OR ((item.judgement_changed, item.features_apart, item.features_changed) = ($2, $3, $4)
               AND item.session_id > $5))
    ORDER BY item.judgement_changed DESC, item.features_apart DESC, item.features_changed DESC, item.session_id
    LIMIT $6";

/// Selects at most `$5` trainees of order `$1` after the trainee with the sort key `$2` to `$4`.
const SELECT_TRAINEES: &str = "
    SELECT session.trainee_id, trainee.name AS trainee_name, trainee.code AS trainee_code,
           sum(item.judgement_changed) AS judgements,
           count(item.session_id) AS sessions,
           sum(item.state = 'done') AS done,
           coalesce(sum(item.judged_before = 'pass' AND item.judged_after <> 'pass'), 0) AS no_longer_passed,
           coalesce(sum(item.judged_before <> 'pass' AND item.judged_after = 'pass'), 0) AS now_passed,
           sum(item.features_apart > 0) AS apart,
           sum(item.features_changed > 0) AS changed
    FROM rescoring_item AS item
    JOIN session ON session.id = item.session_id
    JOIN trainee ON trainee.id = session.trainee_id
    WHERE item.rescoring_id = $1 AND session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee)
    GROUP BY session.trainee_id
    HAVING (sum(item.judgement_changed), sum(item.features_apart > 0)) < ($2, $3)
        OR ((sum(item.judgement_changed), sum(item.features_apart > 0)) = ($2, $3) AND session.trainee_id > $4)
    ORDER BY judgements DESC, apart DESC, session.trainee_id LIMIT $5";

impl RescoringStore<'_> {
    /// The orders, newest first.
    pub async fn list(&self, scope: &Scope, page: &PageRequest) -> StoreResult<Page<RescoringRecord>> {
        require_administrator(scope, "reading rescorings")?;
        let rows = sqlx::query_as(SELECT_RESCORINGS);
        let rows = rows
            .bind(page.after())
            .bind(page.row_limit())
            .bind(None::<RescoringId>)
            .fetch_all(self.0.readers())
            .await?;
        Ok(Page::from_rows(rows, page, |rescoring: &RescoringRecord| rescoring.id.to_string()))
    }

    /// One order.
    pub async fn get(&self, scope: &Scope, id: RescoringId) -> StoreResult<RescoringRecord> {
        require_administrator(scope, "reading rescorings")?;
        let row = sqlx::query_as(SELECT_RESCORINGS).bind(None::<&str>).bind(1).bind(id);
        row.fetch_optional(self.0.readers()).await?.ok_or(not_found("rescoring"))
    }

    /// The sessions of an order: first those whose judgement changed, then those with the most features whose error
    /// bars do not overlap.
    pub async fn items(&self, scope: &Scope, id: RescoringId, page: &PageRequest) -> StoreResult<Page<RescoringItem>> {
        self.get(scope, id).await?;
        let (numbers, last) = cursor::<3>(page);
        let rows = sqlx::query_as(SELECT_ITEMS);
        let rows = rows.bind(id).bind(numbers[0]).bind(numbers[1]).bind(numbers[2]).bind(last).bind(page.row_limit());
        let rows = rows.fetch_all(self.0.readers()).await?;
        Ok(Page::from_rows(rows, page, |item: &RescoringItem| {
            let changed = i64::from(item.judgement_changed);
            format!("{changed}.{}.{}.{}", item.features_apart, item.features_changed, item.session_id)
        }))
    }

    /// The trainees of an order, those with the most changed judgements first.
    pub async fn trainees(
        &self,
        scope: &Scope,
        id: RescoringId,
        page: &PageRequest,
    ) -> StoreResult<Page<RescoringTrainee>> {
        self.get(scope, id).await?;
        let (numbers, last) = cursor::<2>(page);
        let rows = sqlx::query_as(SELECT_TRAINEES);
        let rows = rows.bind(id).bind(numbers[0]).bind(numbers[1]).bind(last).bind(page.row_limit());
        let rows = rows.fetch_all(self.0.readers()).await?;
        Ok(Page::from_rows(rows, page, |one: &RescoringTrainee| {
            format!("{}.{}.{}", one.judgements, one.apart, one.trainee_id)
        }))
    }
}

/// The sort numbers and the id after which a page begins; without a cursor the page begins at the start.
fn cursor<const N: usize>(page: &PageRequest) -> ([i64; N], String) {
    let mut numbers = [i64::MAX; N];
    let mut parts = page.after().unwrap_or_default().splitn(N + 1, '.');
    for number in &mut numbers {
        *number = parts.next().and_then(|part| part.parse().ok()).unwrap_or(i64::MAX);
    }
    (numbers, parts.next().unwrap_or_default().to_owned())
}
