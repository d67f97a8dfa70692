//! A trainee's sessions of one task over time, with the features of their latest results. One query reads the sessions
//! and one the features. Attempts of an exam are among them once it is closed, for all callers.

use std::collections::HashMap;

use serde::Serialize;
use sqlx::types::Json;

use super::super::columns::FeatureColumn;
use super::super::error::StoreResult;
use super::super::visibility::BindScope;
use super::SessionStore;
use crate::domain::feature::FeatureKey;
use crate::domain::hand::ToolHands;
use crate::domain::job::JobState;
use crate::domain::session::{BoxQuestion, FeatureSpace, RecordedAtSource, SessionStatus, Supervision};
use crate::domain::text::Key;
use crate::ids::{CalibrationId, ResultId, SessionId, TaskId, TraineeId};
use crate::motion::features::Feature;
use crate::store::Scope;

/// A trainee's practice of one task.
#[derive(Clone, Debug, PartialEq)]
pub struct Practice {
    /// Number of earlier sessions that are left out.
    pub earlier: usize,
    /// The sessions, in the order of recording.
    pub sessions: Vec<PracticeSession>,
}

/// A trainee and a task that they practise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
pub struct TraineeTask {
    /// The trainee.
    pub trainee: TraineeId,
    /// The task.
    pub task: TaskId,
}

/// One session of a practice.
#[derive(Clone, Debug, PartialEq)]
pub struct PracticeSession {
    /// Its id.
    pub id: SessionId,
    /// When it was recorded, epoch ms.
    pub recorded_at_ms: i64,
    /// Who says so.
    pub recorded_at_source: RecordedAtSource,
    /// False if that time rests only on a trainee's word or file.
    pub date_known: bool,
    /// Whether a member of staff saw the attempt; `None`: from before this was recorded.
    pub supervision: Option<Supervision>,
    /// When it had arrived completely, epoch ms.
    pub created_at_ms: i64,
    /// Its place in the order of arrival.
    pub arrival: i64,
    /// Its status.
    pub status: SessionStatus,
    /// Does it count nowhere: set aside, asked about, or of another box?
    pub is_uncounted: bool,
    /// True if staff set it aside.
    pub is_set_aside: bool,
    /// True if it is an attempt of an exam that was voided.
    pub is_voided: bool,
    /// Whether it shows its box, if that was asked.
    pub box_question: Option<BoxQuestion>,
    /// Its latest result.
    pub result: Option<PracticeResult>,
    /// The values of the requested features in that result.
    pub measured: Vec<PracticeMeasurement>,
}

/// A result, without its features.
#[derive(Clone, Debug, PartialEq)]
pub struct PracticeResult {
    /// Version of the program that made it.
    pub pipeline: String,
    /// The camera that it was made with; `None` if the session was measured by another program.
    pub calibration: Option<CalibrationId>,
    /// True if the quality gate refused it.
    pub refused: bool,
    /// The tools in the trainee's hands.
    pub hands: ToolHands,
}

/// A value of one feature.
#[derive(Clone, Debug, PartialEq)]
pub struct PracticeMeasurement {
    /// The feature.
    pub of: FeatureKey,
    /// The value, in the feature's unit; `None` if too little was seen.
    pub value: Option<f64>,
    /// The 95 % interval of the true value; `None` if it is not known.
    pub bar: Option<[f64; 2]>,
    /// True if the true value is at least this one.
    pub is_lower_bound: bool,
}

#[derive(sqlx::FromRow)]
struct PracticeRow {
    id: SessionId,
    recorded_at_ms: i64,
    recorded_at_source: RecordedAtSource,
    date_known: bool,
    supervision: Option<Supervision>,
    created_at_ms: i64,
    arrival: i64,
    is_whole: bool,
    counts: bool,
    is_set_aside: bool,
    is_voided: bool,
    box_question: Option<BoxQuestion>,
    job_state: Option<JobState>,
    result_id: Option<ResultId>,
    pipeline: Option<String>,
    calibration_id: Option<CalibrationId>,
    refused: Option<bool>,
    left_tool: Option<String>,
    right_tool: Option<String>,
    in_all: i64,
}

/// A [`PracticeRow`] with its trainee and task.
#[derive(sqlx::FromRow)]
struct PracticeRowOfPair {
    trainee_id: TraineeId,
    task_id: TaskId,
    #[sqlx(flatten)]
    of: PracticeRow,
}

type PracticeFeatureRow =
    (ResultId, FeatureColumn, Option<String>, FeatureSpace, Option<f64>, Option<f64>, Option<f64>);

/// Selects the last `$5` sessions of trainee `$3` at task `$4`, newest first.
pub(in crate::store) const SELECT_PRACTICE: &str = "
    SELECT session.*,
           (SELECT stored.recorded_at_source FROM session AS stored WHERE stored.id = session.id) AS recorded_at_source,
           (SELECT stored.date_known FROM session AS stored WHERE stored.id = session.id) AS date_known,
           (SELECT stored.supervision FROM session AS stored WHERE stored.id = session.id) AS supervision,
           (SELECT stored.created_at_ms FROM session AS stored WHERE stored.id = session.id) AS created_at_ms,
           EXISTS (SELECT 1 FROM set_aside_session WHERE set_aside_session.session_id = session.id) AS is_set_aside,
           (SELECT left_tool FROM result WHERE result.id = session.result_id) AS left_tool,
           (SELECT right_tool FROM result WHERE result.id = session.result_id) AS right_tool,
           EXISTS (SELECT 1 FROM voided_session WHERE voided_session.session_id = session.id) AS is_voided,
           (SELECT count(*) FROM session WHERE trainee_id = $3 AND task_id = $4
            AND id NOT IN (SELECT session_id FROM sealed_session)) AS in_all
    FROM practised_session AS session
    WHERE session.trainee_id = $3 AND session.task_id = $4
      AND ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND session.id NOT IN (SELECT session_id FROM sealed_session)
    ORDER BY session.recorded_at_ms DESC, session.id DESC LIMIT $5";

/// Selects the last `$4` sessions of each pair of a trainee and a task in `$3` (a JSON array), newest first.
pub(in crate::store) const SELECT_PRACTICE_OF_MANY: &str = "
    WITH pair AS MATERIALIZED
        (SELECT value ->> 'trainee' AS trainee, value ->> 'task' AS task,
                (SELECT count(*) FROM session AS every WHERE every.trainee_id = wanted.value ->> 'trainee'
                 AND every.task_id = wanted.value ->> 'task'
                 AND every.id NOT IN (SELECT session_id FROM sealed_session)) AS in_all
         FROM json_each($3) AS wanted)
    SELECT session.*,
           (SELECT stored.recorded_at_source FROM session AS stored WHERE stored.id = session.id) AS recorded_at_source,
           (SELECT stored.date_known FROM session AS stored WHERE stored.id = session.id) AS date_known,
           (SELECT stored.supervision FROM session AS stored WHERE stored.id = session.id) AS supervision,
           (SELECT stored.created_at_ms FROM session AS stored WHERE stored.id = session.id) AS created_at_ms,
           EXISTS (SELECT 1 FROM set_aside_session WHERE set_aside_session.session_id = session.id) AS is_set_aside,
           (SELECT left_tool FROM result WHERE result.id = session.result_id) AS left_tool,
           (SELECT right_tool FROM result WHERE result.id = session.result_id) AS right_tool,
           EXISTS (SELECT 1 FROM voided_session WHERE voided_session.session_id = session.id) AS is_voided, pair.in_all
    FROM pair
    CROSS JOIN practised_session AS session ON session.id IN
        (SELECT recent.id FROM session AS recent WHERE recent.trainee_id = pair.trainee AND recent.task_id = pair.task
         AND recent.id NOT IN (SELECT session_id FROM sealed_session)
         ORDER BY recent.recorded_at_ms DESC, recent.id DESC LIMIT $4)
    WHERE ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND session.id NOT IN (SELECT session_id FROM sealed_session)
    ORDER BY session.recorded_at_ms DESC, session.id DESC";

/// Selects the features named in `$2` of the results `$1`, both JSON arrays. By default, SQLite would read all features
/// of each result.
pub(in crate::store) const SELECT_MEASURED: &str = "
    SELECT result_id, name, tool, space, value, low, high FROM feature INDEXED BY feature_named
    WHERE result_id IN (SELECT value FROM json_each($1)) AND name IN (SELECT value FROM json_each($2))";

const SELECT_TRAINEE_TASKS: &str = "
    SELECT trainee_id, task_id, count(*) FROM session
    WHERE recorded_at_ms >= $3 AND task_id IN (SELECT standard.task_id FROM standard)
      AND ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND session.id NOT IN (SELECT session_id FROM sealed_session)
    GROUP BY trainee_id, task_id ORDER BY max(recorded_at_ms) DESC LIMIT $4";

const SELECT_TRAINEES_OF_TASK: &str = "
    SELECT trainee_id, count(*) FROM session
    WHERE task_id = $3
      AND ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND session.id NOT IN (SELECT session_id FROM sealed_session)
    GROUP BY trainee_id ORDER BY max(recorded_at_ms) DESC LIMIT $4";

const SELECT_LAST_TASK: &str = "
    SELECT task_id FROM session
    WHERE trainee_id = $3
      AND ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND session.id NOT IN (SELECT session_id FROM sealed_session)
    ORDER BY recorded_at_ms DESC, id DESC LIMIT 1";

impl SessionStore<'_> {
    /// A trainee's last sessions of a task, at most `most`, with these features of their latest results.
    pub async fn practice(
        &self,
        scope: &Scope,
        trainee: TraineeId,
        task: TaskId,
        features: &[&'static Feature],
        most: u32,
    ) -> StoreResult<Practice> {
        let rows =
            sqlx::query_as::<_, PracticeRow>(SELECT_PRACTICE).bind_scope(scope).bind(trainee).bind(task).bind(most);
        let rows = rows.fetch_all(self.0.readers()).await?;
        if rows.is_empty() {
            self.0.trainees().get(scope, &Key::from(&trainee)).await?;
        }
        let results: Vec<ResultId> = rows.iter().filter_map(|row| row.result_id).collect();
        let mut measured = self.measured(results, features).await?;
        Ok(practice(rows, &mut measured))
    }

    /// Like [`SessionStore::practice`], for many pairs of a trainee and a task. Limited to trainees in the scope; pairs
    /// without sessions are left out.
    pub async fn practice_of_many(
        &self,
        scope: &Scope,
        pairs: &[TraineeTask],
        features: &[&'static Feature],
        most: u32,
    ) -> StoreResult<HashMap<TraineeTask, Practice>> {
        let rows = sqlx::query_as::<_, PracticeRowOfPair>(SELECT_PRACTICE_OF_MANY)
            .bind_scope(scope)
            .bind(Json(pairs))
            .bind(most);
        let rows = rows.fetch_all(self.0.readers()).await?;
        let results: Vec<ResultId> = rows.iter().filter_map(|row| row.of.result_id).collect();
        let mut measured = self.measured(results, features).await?;
        let mut of_each: HashMap<TraineeTask, Vec<PracticeRow>> = HashMap::with_capacity(pairs.len());
        for PracticeRowOfPair { trainee_id, task_id, of } in rows {
            of_each.entry(TraineeTask { trainee: trainee_id, task: task_id }).or_default().push(of);
        }
        Ok(of_each.into_iter().map(|(of, rows)| (of, practice(rows, &mut measured))).collect())
    }

    /// Trainees and the tasks with a standard that they practised since `since_ms`, with the number of sessions.
    /// Limited to trainees in the scope; latest first, at most `most`.
    pub async fn trainee_tasks(
        &self,
        scope: &Scope,
        since_ms: i64,
        most: u32,
    ) -> StoreResult<Vec<(TraineeTask, usize)>> {
        let rows = sqlx::query_as::<_, (TraineeId, TaskId, i64)>(SELECT_TRAINEE_TASKS);
        let rows = rows.bind_scope(scope).bind(since_ms).bind(most).fetch_all(self.0.readers()).await?;
        Ok(rows
            .into_iter()
            .map(|(trainee, task, of)| (TraineeTask { trainee, task }, of.unsigned_abs() as usize))
            .collect())
    }

    /// The trainees in the scope who practised a task, with the number of their sessions; latest first, at most `most`.
    pub async fn trainees_of_task(
        &self,
        scope: &Scope,
        task: TaskId,
        most: u32,
    ) -> StoreResult<Vec<(TraineeId, usize)>> {
        let rows = sqlx::query_as::<_, (TraineeId, i64)>(SELECT_TRAINEES_OF_TASK);
        let rows = rows.bind_scope(scope).bind(task).bind(most).fetch_all(self.0.readers()).await?;
        Ok(rows.into_iter().map(|(trainee, of)| (trainee, of.unsigned_abs() as usize)).collect())
    }

    /// The values of these features in these results.
    async fn measured(
        &self,
        results: Vec<ResultId>,
        features: &[&'static Feature],
    ) -> StoreResult<HashMap<ResultId, Vec<PracticeMeasurement>>> {
        let mut measured: HashMap<ResultId, Vec<PracticeMeasurement>> = HashMap::with_capacity(results.len());
        let found = sqlx::query_as::<_, PracticeFeatureRow>(SELECT_MEASURED).bind(Json(results)).bind(Json(features));
        for (result, FeatureColumn(feature), tool, space, value, low, high) in found.fetch_all(self.0.readers()).await?
        {
            let bar = low.zip(high).map(|(low, high)| [low, high]);
            let is_lower_bound = low.is_some() && high.is_none();
            let measurement =
                PracticeMeasurement { of: FeatureKey::of_tool(feature, tool, space), value, bar, is_lower_bound };
            measured.entry(result).or_default().push(measurement);
        }
        Ok(measured)
    }

    /// The task of a trainee's latest session, if there is one.
    pub async fn last_task(&self, scope: &Scope, trainee: TraineeId) -> StoreResult<Option<TaskId>> {
        let row = sqlx::query_scalar(SELECT_LAST_TASK);
        Ok(row.bind_scope(scope).bind(trainee).fetch_optional(self.0.readers()).await?)
    }
}

/// Makes a [`Practice`] of rows in the order of newest first.
fn practice(mut rows: Vec<PracticeRow>, measured: &mut HashMap<ResultId, Vec<PracticeMeasurement>>) -> Practice {
    rows.reverse();
    let earlier = rows.first().map_or(0, |row| (row.in_all.unsigned_abs() as usize).saturating_sub(rows.len()));
    Practice { earlier, sessions: rows.into_iter().map(|row| row.with_measured(measured)).collect() }
}

impl PracticeRow {
    fn with_measured(self, measured: &mut HashMap<ResultId, Vec<PracticeMeasurement>>) -> PracticeSession {
        let (calibration, refused) = (self.calibration_id, self.refused == Some(true));
        let hands = ToolHands { left: self.left_tool, right: self.right_tool };
        PracticeSession {
            id: self.id,
            recorded_at_ms: self.recorded_at_ms,
            recorded_at_source: self.recorded_at_source,
            date_known: self.date_known,
            supervision: self.supervision,
            created_at_ms: self.created_at_ms,
            arrival: self.arrival,
            status: if self.is_whole { self.job_state.into() } else { SessionStatus::Receiving },
            is_uncounted: !self.counts,
            is_set_aside: self.is_set_aside,
            is_voided: self.is_voided,
            box_question: self.box_question,
            measured: self.result_id.and_then(|result| measured.remove(&result)).unwrap_or_default(),
            result: self.pipeline.map(|pipeline| PracticeResult { pipeline, calibration, refused, hands }),
        }
    }
}
