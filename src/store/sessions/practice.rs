//! A trainee's sessions of one task over time, with what their latest results measured: one query for the sessions, one for the
//! features.

use std::collections::HashMap;

use sqlx::types::Json;

use super::super::error::StoreResult;
use super::super::visibility::{AskedBy, sees_trainee};
use super::{Sessions, counts};
use crate::domain::feature::FeatureKey;
use crate::domain::job::JobState;
use crate::domain::session::{FeatureSpace, SessionStatus};
use crate::domain::text::Key;
use crate::ids::{CalibrationId, ResultId, SessionId, TaskId, TraineeId};
use crate::store::Scope;

/// A trainee's practice of one task.
#[derive(Clone, Debug, PartialEq)]
pub struct Practice {
    /// How many sessions lie before the first one here.
    pub earlier: usize,
    /// The sessions, in the order in which they were recorded.
    pub sessions: Vec<Practised>,
}

/// One session of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Practised {
    /// Its id.
    pub id: SessionId,
    /// When it was recorded, epoch ms.
    pub recorded_at_ms: i64,
    /// How it stands.
    pub status: SessionStatus,
    /// Has somebody set it aside?
    pub is_set_aside: bool,
    /// Its latest result.
    pub result: Option<Outcome>,
    /// What that measured of the features that were asked for.
    pub measured: Vec<Measurement>,
}

/// A result, without its numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Version of the program that made it.
    pub pipeline: String,
    /// The camera that it was made with; `None` where it was not measured here.
    pub calibration: Option<CalibrationId>,
    /// Did the quality gate refuse it?
    pub refused: bool,
}

/// A value of one feature.
#[derive(Clone, Debug, PartialEq)]
pub struct Measurement {
    /// Of which feature.
    pub of: FeatureKey,
    /// The value, in the feature's unit; `None` where too little was seen.
    pub value: Option<f64>,
    /// Where the true value lies with 95 %; `None` where that is not known.
    pub bar: Option<[f64; 2]>,
}

#[derive(sqlx::FromRow)]
struct Row {
    id: SessionId,
    recorded_at_ms: i64,
    is_whole: bool,
    counts: bool,
    job_state: Option<JobState>,
    result_id: Option<ResultId>,
    pipeline: Option<String>,
    calibration_id: Option<CalibrationId>,
    refused: Option<bool>,
    in_all: i64,
}

type FeatureRow = (ResultId, String, Option<String>, FeatureSpace, Option<f64>, Option<f64>, Option<f64>);

/// The last `$5` sessions of trainee `$3` at task `$4`, the newest first.
macro_rules! practised {
    () => {
        concat!(
            "SELECT session.id, session.recorded_at_ms, session.video IS NOT NULL AS is_whole, job.state AS job_state,
                    result.id AS result_id, result.pipeline, result.calibration_id, ",
            counts!(),
            " AS counts,
                    json_extract(result.quality, '$.verdict') = 'refused' AS refused, count(*) OVER () AS in_all
             FROM session
             LEFT JOIN job ON job.id = (SELECT latest.id FROM job AS latest
                                    WHERE latest.session_id = session.id AND latest.turn < 2
                                        ORDER BY latest.created_at_ms DESC, latest.id DESC LIMIT 1)
             LEFT JOIN result ON result.id =
                 (SELECT latest.id FROM result AS latest WHERE latest.session_id = session.id
                  ORDER BY latest.created_at_ms DESC, latest.id DESC LIMIT 1)
             WHERE session.trainee_id = $3 AND session.task_id = $4 AND ",
            sees_trainee!("session.trainee_id"),
            " ORDER BY session.recorded_at_ms DESC, session.id DESC LIMIT $5"
        )
    };
}

/// The features named in `$2` of the results `$1`, both JSON arrays. Left alone, SQLite would read all features of each.
macro_rules! measured {
    () => {
        "SELECT result_id, name, tool, space, value, low, high FROM feature INDEXED BY feature_named
         WHERE result_id IN (SELECT value FROM json_each($1)) AND name IN (SELECT value FROM json_each($2))"
    };
}
#[cfg(test)]
pub(in crate::store) use {measured, practised}; // for the test of their plans

impl Sessions<'_> {
    /// A trainee's last sessions of a task, at most so many, with these features of their latest results.
    pub async fn practice(
        &self,
        scope: &Scope,
        trainee: TraineeId,
        task: TaskId,
        features: &[&str],
        most: u32,
    ) -> StoreResult<Practice> {
        let rows = sqlx::query_as::<_, Row>(practised!()).asked_by(scope).bind(trainee).bind(task).bind(most);
        let mut rows = rows.fetch_all(self.0.readers()).await?;
        if rows.is_empty() {
            self.0.trainees().get(scope, &Key::from(&trainee)).await?;
        }
        rows.reverse();
        let results: Vec<ResultId> = rows.iter().filter_map(|row| row.result_id).collect();
        let mut measured: HashMap<ResultId, Vec<Measurement>> = HashMap::with_capacity(results.len());
        let found = sqlx::query_as::<_, FeatureRow>(measured!()).bind(Json(results)).bind(Json(features));
        for (result, feature, tool, space, value, low, high) in found.fetch_all(self.0.readers()).await? {
            let bar = low.zip(high).map(|(low, high)| [low, high]);
            let measurement = Measurement { of: FeatureKey { feature, tool, space }, value, bar };
            measured.entry(result).or_default().push(measurement);
        }
        let earlier = rows.first().map_or(0, |row| row.in_all.unsigned_abs() as usize - rows.len());
        let of = |row: Row| row.with(&mut measured);
        Ok(Practice { earlier, sessions: rows.into_iter().map(of).collect() })
    }

    /// The task of a trainee's newest session, if there is one.
    pub async fn last_task(&self, scope: &Scope, trainee: TraineeId) -> StoreResult<Option<TaskId>> {
        let row = sqlx::query_scalar(concat!(
            "SELECT task_id FROM session WHERE trainee_id = $3 AND ",
            sees_trainee!("session.trainee_id"),
            " ORDER BY recorded_at_ms DESC, id DESC LIMIT 1"
        ));
        Ok(row.asked_by(scope).bind(trainee).fetch_optional(self.0.readers()).await?)
    }
}

impl Row {
    fn with(self, measured: &mut HashMap<ResultId, Vec<Measurement>>) -> Practised {
        let (calibration, refused) = (self.calibration_id, self.refused == Some(true));
        Practised {
            id: self.id,
            recorded_at_ms: self.recorded_at_ms,
            status: if self.is_whole { self.job_state.into() } else { SessionStatus::Receiving },
            is_set_aside: !self.counts,
            measured: self.result_id.and_then(|result| measured.remove(&result)).unwrap_or_default(),
            result: self.pipeline.map(|pipeline| Outcome { pipeline, calibration, refused }),
        }
    }
}
