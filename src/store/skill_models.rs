//! Versions of the tasks' skill models, and the sessions that they are trained on. A version is never changed. It is
//! withdrawn, and its content erased, when the first person or session among its training data is erased, or moved to
//! another person or task.

use std::collections::HashMap;

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::audit::note;
use super::error::{StoreError, StoreResult, not_found};
use super::visibility::{BindScope, require_administrator};
use super::{Scope, Store};
use crate::domain::session::FeatureSpace;
use crate::domain::skill::{ModelDefinition, ModelReport, Reading};
use crate::domain::trainee::Level;
use crate::ids::{ModelId, ResultId, SessionId, TaskId, TraineeId};
use crate::motion::features;

/// Access to the tasks' skill models.
pub struct SkillModelStore<'s>(pub(super) &'s Store);

/// A version of a task's skill model.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct SkillModelRecord {
    /// Its id.
    pub id: ModelId,
    /// Its task.
    pub task_id: TaskId,
    /// 1, 2, … within the task.
    pub version: i64,
    /// Version of the program that measured its sessions.
    pub pipeline: String,
    /// SHA-256 of its training values.
    pub fingerprint: String,
    /// The model itself; `None` once it is withdrawn.
    #[sqlx(json(nullable))]
    pub definition: Option<ModelDefinition>,
    /// Its performance on people who were left out of training.
    #[sqlx(json)]
    pub report: ModelReport,
    /// Name of the person who made it; `None` if a program did, or the account has been deleted.
    pub who: Option<String>,
    /// When it was made, epoch ms.
    pub created_at_ms: i64,
    /// When it was withdrawn, epoch ms.
    pub withdrawn_at_ms: Option<i64>,
}

/// A model to store.
#[derive(Clone, Debug, PartialEq)]
pub struct NewSkillModel {
    /// Version of the program that measured its sessions.
    pub pipeline: String,
    /// SHA-256 of its training values.
    pub fingerprint: String,
    /// The model itself.
    pub definition: ModelDefinition,
    /// Its performance on people who were left out of training.
    pub report: ModelReport,
    /// The trainees among its training data.
    pub trainees: Vec<TraineeId>,
}

/// A session of a trainee with a declared level.
#[derive(Clone, Debug, PartialEq)]
pub struct DeclaredSession {
    /// The trainee.
    pub trainee: TraineeId,
    /// Their declared level.
    pub level: Level,
    /// How many tools were tracked.
    pub tools: usize,
    /// Its features in three dimensions.
    pub readings: Vec<Reading>,
}

/// Selects the last `$5` versions of the model of task `$3`, or version `$4` only.
const SELECT_MODELS: &str = "
    SELECT skill_model.id, task_id, version, pipeline, fingerprint, definition, report, person.name AS who,
           skill_model.created_at_ms, withdrawn_at_ms
    FROM skill_model LEFT JOIN person ON person.id = skill_model.person_id
    WHERE task_id = $3 AND $1 <> 'agent' AND ($4 IS NULL OR version = $4) ORDER BY version DESC LIMIT $5";

/// Selects usable sessions of task `$1` by people of a declared level, measured by version `$2`: the last `$3` of each
/// person, for the `$4` people of each level who practised last.
const SELECT_DECLARED: &str = "
    WITH usable AS (
        SELECT trainee.id AS trainee_id, trainee.level, session.result_id, json_array_length(session.tools) AS tools,
               row_number() OVER (PARTITION BY trainee.id
                   ORDER BY session.recorded_at_ms DESC, session.id DESC) AS back,
               max(session.recorded_at_ms) OVER (PARTITION BY trainee.id) AS last_ms
        FROM assessed_session AS session JOIN trainee ON trainee.id = session.trainee_id
        WHERE session.task_id = $1 AND trainee.level IS NOT NULL AND session.pipeline = $2
          AND coalesce(session.verdict, '') <> 'refused'),
    ranked AS (
        SELECT *, dense_rank() OVER (PARTITION BY level ORDER BY last_ms DESC, trainee_id) AS place
        FROM usable WHERE back <= $3)
    SELECT trainee_id, level, tools, result_id FROM ranked WHERE place <= $4 ORDER BY trainee_id, back";

type DeclaredFeatureRow = (ResultId, String, Option<String>, FeatureSpace, Option<f64>, Option<f64>, Option<f64>);

const INSERT_MODEL: &str = "
    INSERT INTO skill_model (id, task_id, version, pipeline, fingerprint, definition, report, person_id,
        created_at_ms)
    SELECT $1, $2, coalesce(max(version), 0) + 1, $3, $4, $5, $6, $7, $8 FROM skill_model
    WHERE task_id = $2";

const INSERT_MODEL_TRAINEE: &str = "INSERT INTO skill_model_trainee (model_id, trainee_id) VALUES ($1, $2)";

const SELECT_IS_TRAINED_ON: &str = "
    SELECT EXISTS (SELECT 1 FROM skill_model_trainee WHERE model_id = $1 AND trainee_id = $2)";

const SELECT_READINGS: &str = "
    SELECT result_id, name, tool, space, value, low, high FROM feature
    WHERE result_id IN (SELECT value FROM json_each($1)) AND space = '3d' ORDER BY result_id, position";

const WITHDRAW_MODELS_OF_TRAINEE: &str = "
    UPDATE skill_model
    SET definition = NULL, withdrawn_at_ms = $2
    WHERE definition IS NOT NULL AND id IN (SELECT model_id FROM skill_model_trainee WHERE trainee_id = $1)";

const WITHDRAW_MODELS_OF_SESSION: &str = "
    UPDATE skill_model
    SET definition = NULL, withdrawn_at_ms = $2
    WHERE definition IS NOT NULL AND task_id = (SELECT task_id FROM session WHERE id = $1)
      AND id IN (SELECT model_id FROM skill_model_trainee
                 WHERE trainee_id = (SELECT trainee_id FROM session WHERE id = $1))";

impl SkillModelStore<'_> {
    /// Adds a task's next version. If the version in use is identical, that one is returned.
    pub async fn add(&self, scope: &Scope, of: TaskId, new: NewSkillModel) -> StoreResult<SkillModelRecord> {
        require_administrator(scope, "making skill models")?;
        let is_same = |last: &SkillModelRecord| {
            last.fingerprint == new.fingerprint && last.definition.as_ref() == Some(&new.definition)
        };
        if let Some(same) = self.in_use(scope, of).await?.filter(is_same) {
            return Ok(same);
        }
        let (by, now_ms, id) = (scope.clone(), self.0.now_ms(), ModelId::at(self.0.now_ms()));
        self.0
            .write(async move |tx| {
                let insert = sqlx::query(INSERT_MODEL);
                let insert =
                    insert.bind(id).bind(of).bind(new.pipeline).bind(new.fingerprint).bind(Json(new.definition));
                let insert = insert.bind(Json(new.report)).bind(by.person()).bind(now_ms);
                insert.execute(&mut *tx).await.map_err(super::error::missing("task"))?;
                for trainee in new.trainees {
                    let link = sqlx::query(INSERT_MODEL_TRAINEE);
                    link.bind(id).bind(trainee).execute(&mut *tx).await.map_err(erased_meanwhile)?;
                }
                note(tx, &by, now_ms, ("create", "skill_model"), id).await
            })
            .await?;
        self.in_use(scope, of).await?.ok_or(not_found("model"))
    }

    /// The version in use, if the task has one; it may be withdrawn.
    pub async fn in_use(&self, scope: &Scope, of: TaskId) -> StoreResult<Option<SkillModelRecord>> {
        let row = sqlx::query_as(SELECT_MODELS).bind_scope(scope).bind(of).bind(None::<i64>).bind(1);
        Ok(row.fetch_optional(self.0.readers()).await?)
    }

    /// One version.
    pub async fn get(&self, scope: &Scope, of: TaskId, version: i64) -> StoreResult<SkillModelRecord> {
        let row = sqlx::query_as(SELECT_MODELS).bind_scope(scope).bind(of).bind(version).bind(1);
        row.fetch_optional(self.0.readers()).await?.ok_or(not_found("model"))
    }

    /// True if this trainee's sessions are among its training data.
    pub async fn is_trained_on(&self, model: ModelId, trainee: TraineeId) -> StoreResult<bool> {
        Ok(sqlx::query_scalar(SELECT_IS_TRAINED_ON).bind(model).bind(trainee).fetch_one(self.0.readers()).await?)
    }

    /// The last hundred versions, newest first.
    pub async fn list(&self, scope: &Scope, of: TaskId) -> StoreResult<Vec<SkillModelRecord>> {
        let rows = sqlx::query_as(SELECT_MODELS).bind_scope(scope).bind(of).bind(None::<i64>).bind(100);
        Ok(rows.fetch_all(self.0.readers()).await?)
    }

    /// Usable sessions of people of a declared level, measured by this version of the program: the last ones of each
    /// person, for the people of each level who practised last, with a limit on both. For training models only: the
    /// query is not limited to a scope.
    pub async fn declared(
        &self,
        of: TaskId,
        pipeline: &str,
        sessions_each: usize,
        most_per_level: usize,
    ) -> StoreResult<Vec<DeclaredSession>> {
        let rows = sqlx::query_as::<_, (TraineeId, Level, i64, ResultId)>(SELECT_DECLARED);
        let rows = rows.bind(of).bind(pipeline).bind(sessions_each as i64).bind(most_per_level as i64);
        let rows = rows.fetch_all(self.0.readers()).await?;
        let results: Vec<ResultId> = rows.iter().map(|row| row.3).collect();
        let values = sqlx::query_as::<_, DeclaredFeatureRow>(SELECT_READINGS);
        let mut readings: HashMap<ResultId, Vec<Reading>> = HashMap::new();
        for (result, name, tool, space, value, low, high) in
            values.bind(Json(results)).fetch_all(self.0.readers()).await?
        {
            let Ok(feature) = features::find(&name) else { continue }; // measured by an earlier version only
            let bar = low.zip(high).map(|(low, high)| [low, high]);
            let value = value.filter(|_| low.is_none() || high.is_some()); // no lower bound
            readings.entry(result).or_default().push(Reading { feature, tool, space, value, bar });
        }
        let session = |(trainee, level, tools, result): (TraineeId, Level, i64, ResultId)| DeclaredSession {
            trainee,
            level,
            tools: tools.unsigned_abs() as usize,
            readings: readings.remove(&result).unwrap_or_default(),
        };
        Ok(rows.into_iter().map(session).collect())
    }
}

/// Withdraws the models with this person's sessions among their training data, before the person is erased.
pub(super) async fn withdraw(tx: &mut SqliteConnection, trainee: TraineeId, now_ms: i64) -> StoreResult<()> {
    sqlx::query(WITHDRAW_MODELS_OF_TRAINEE).bind(trainee).bind(now_ms).execute(tx).await?;
    Ok(())
}

/// Like [`withdraw`], before a session is erased, or moved to another trainee or task: for the models of its task that were
/// trained on this trainee's sessions, since they may include this one.
pub(super) async fn withdraw_of_session(tx: &mut SqliteConnection, session: SessionId, now_ms: i64) -> StoreResult<()> {
    sqlx::query(WITHDRAW_MODELS_OF_SESSION).bind(session).bind(now_ms).execute(tx).await?;
    Ok(())
}

fn erased_meanwhile(error: sqlx::Error) -> StoreError {
    match error.as_database_error() {
        Some(e) if e.is_foreign_key_violation() => {
            StoreError::refused("a trainee in this model's data was erased meanwhile: make the model again")
        }
        _ => error.into(),
    }
}
