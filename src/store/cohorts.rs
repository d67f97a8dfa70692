//! Cohorts: reference groups and their members' values. Only administrators make them, since a cohort may hold any
//! trainee of the centre. People may see that a cohort exists; of its members they see only trainees in their scope.

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::audit::note;
use super::error::{StoreResult, missing, not_found, taken};
use super::page::{Page, PageRequest};
use super::visibility::{BindScope, require_administrator};
use super::{Scope, Store, codes};
use crate::domain::cohort::NewCohort;
use crate::domain::feature::FeatureKey;
use crate::domain::text::{Code, Key, Name};
use crate::domain::trainee::{Handedness, Level};
use crate::ids::{CalibrationId, CohortId, GroupId, TaskId, TraineeId};

/// Access to the cohorts.
pub struct CohortStore<'s>(pub(super) &'s Store);

/// Maximum number of people to compare with: those who were enrolled last.
const MAX_COMPARED: i64 = 2_000;

/// A reference group.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct CohortRecord {
    /// Its id.
    pub id: CohortId,
    /// Its short unique name.
    pub code: Code,
    /// What people call it.
    pub name: Name,
    /// True if its members are listed. Otherwise the next three fields select them.
    pub is_list: bool,
    /// Only people of this level.
    pub level: Option<Level>,
    /// Only people who prefer this hand.
    pub handedness: Option<Handedness>,
    /// Only people of this training group.
    pub group_id: Option<GroupId>,
    /// How many people are in it.
    pub people: i64,
    /// When it was made, epoch ms.
    pub created_at_ms: i64,
}

/// One value of a cohort member, from one of their last sessions.
#[derive(Clone, Debug, PartialEq)]
pub struct CohortValue {
    /// The trainee.
    pub trainee: TraineeId,
    /// The trainee's preferred hand, if known.
    pub handedness: Option<Handedness>,
    /// The camera that it was measured with.
    pub calibration: CalibrationId,
    /// Version of the program that measured it.
    pub pipeline: String,
    /// The feature.
    pub of: FeatureKey,
    /// The value, in the feature's unit.
    pub value: f64,
}

type CohortValueRow = (TraineeId, Option<Handedness>, CalibrationId, String, Json<FeatureKey>, Json<Vec<f64>>);

const SELECT_COHORTS: &str = "
    SELECT cohort.*, (SELECT count(*) FROM cohort_person WHERE cohort_id = cohort.id
                      AND trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee)) AS people FROM cohort
    WHERE $1 <> 'agent' AND ($3 IS NULL OR code > $3) ORDER BY code LIMIT $4";

const SELECT_COHORT: &str = "
    SELECT cohort.*, (SELECT count(*) FROM cohort_person WHERE cohort_id = cohort.id
                      AND trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee)) AS people FROM cohort
    WHERE $1 <> 'agent' AND $3 IN (id, code)";

const SELECT_MEMBERS: &str = "
    SELECT trainee_id FROM cohort_person
    WHERE cohort_id = $3 AND ($4 IS NULL OR trainee_id > $4)
      AND ($1 = 'administrator'
           OR trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee)
    ORDER BY trainee_id LIMIT $5";

/// Selects values of at most `$7` people at task `$4`, from their last `$5` sessions that were not refused, for the
/// features `$6` (a JSON array of keys), without lower bounds. The people are those of cohort `$3` in the scope; if
/// `$3` is NULL, all in the scope. It goes from each person to their sessions and to each session's current result,
/// along indices only. Each person is one row, because returning rows from SQLite costs more than building them there.
/// Sessions that were measured by another program or do not count are left out. For a key of a hand, each session's
/// value is that of the tool that was in the hand; sessions whose hands are unknown are left out.
pub(super) const SELECT_VALUES: &str = "
    SELECT member.id, member.handedness, result.calibration_id, result.pipeline,
           wanted.value, json_group_array(feature.value)
    FROM (SELECT trainee.id, trainee.handedness FROM trainee
          WHERE ($3 IS NULL OR EXISTS (SELECT 1 FROM cohort_person WHERE cohort_id = $3 AND trainee_id = trainee.id))
            AND ($1 = 'administrator'
                 OR trainee.id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
            AND trainee.id NOT IN (SELECT trainee_id FROM hidden_trainee)
          ORDER BY trainee.id DESC LIMIT $7) AS member
    CROSS JOIN session ON session.id IN
        (SELECT recent.id FROM session AS recent WHERE recent.trainee_id = member.id AND recent.task_id = $4
         AND NOT EXISTS (SELECT 1 FROM uncounted_session WHERE uncounted_session.session_id = recent.id)
         AND EXISTS (SELECT 1 FROM current_result AS counted WHERE counted.session_id = recent.id
                     AND counted.calibration_id IS NOT NULL AND counted.verdict IS NOT 'refused')
         ORDER BY recent.recorded_at_ms DESC, recent.id DESC LIMIT $5)
    CROSS JOIN current_result AS result ON result.session_id = session.id
    CROSS JOIN json_each($6) AS wanted
    CROSS JOIN feature INDEXED BY feature_named
        ON feature.name = wanted.value ->> 'feature' AND feature.result_id = result.id
        AND feature.space = wanted.value ->> 'space'
        AND iif(wanted.value ->> 'in_hand' IS NULL, feature.tool IS wanted.value ->> 'tool',
                feature.tool = CASE wanted.value ->> 'in_hand'
                    WHEN 'left' THEN result.left_tool WHEN 'right' THEN result.right_tool
                    WHEN 'dominant' THEN CASE member.handedness WHEN 'left' THEN result.left_tool
                                                                WHEN 'right' THEN result.right_tool END
                    WHEN 'other' THEN CASE member.handedness WHEN 'left' THEN result.right_tool
                                                             WHEN 'right' THEN result.left_tool END END)
    WHERE feature.value IS NOT NULL AND (feature.low IS NULL OR feature.high IS NOT NULL)
      AND result.calibration_id IS NOT NULL
    GROUP BY member.id, result.calibration_id, result.pipeline, wanted.key";

const SELECT_CODE: &str = "SELECT 1 FROM cohort WHERE code = $1";

const INSERT_COHORT: &str = "
    INSERT INTO cohort (id, code, name, is_list, level, handedness, group_id, created_at_ms)
    VALUES ($1, $2, $3, $4, $5, $6, $7, $8)";

const UPDATE_COHORT: &str = "
    UPDATE cohort
    SET code = coalesce($2, code), name = $3, is_list = $4, level = $5, handedness = $6, group_id = $7
    WHERE id = $1";

/// People who wait for their erasure stay members, since the erasure can be taken back.
const DELETE_MEMBERS: &str = "
    DELETE FROM cohort_member
    WHERE cohort_id = $1 AND trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee)";

const DELETE_COHORT: &str = "DELETE FROM cohort WHERE id = $1";

const INSERT_MEMBER: &str = "
    INSERT INTO cohort_member (cohort_id, trainee_id)
    VALUES ($1, coalesce((SELECT kept_id FROM merged_trainee WHERE trainee_id = $2), $2)) ON CONFLICT DO NOTHING";

impl CohortStore<'_> {
    /// Creates a cohort.
    pub async fn create(&self, scope: &Scope, new: NewCohort) -> StoreResult<CohortRecord> {
        require_administrator(scope, "making cohorts")?;
        let (by, now_ms, id) = (scope.clone(), self.0.now_ms(), CohortId::at(self.0.now_ms()));
        self.0
            .write(async move |tx| {
                let code = codes::choose(tx, SELECT_CODE, new.code.clone(), &new.name, "cohort").await?;
                let insert = sqlx::query(INSERT_COHORT);
                let insert = insert.bind(id).bind(code).bind(&new.name).bind(new.members.is_some()).bind(new.level);
                let insert = insert.bind(new.handedness).bind(new.group).bind(now_ms).execute(&mut *tx).await;
                insert.map_err(|error| taken_or_missing(error, "group"))?;
                list_members(tx, id, new.members.unwrap_or_default()).await?;
                note(tx, &by, now_ms, ("create", "cohort"), id).await
            })
            .await?;
        self.get(scope, &Key::from(&id)).await
    }

    /// All cohorts, by code.
    pub async fn list(&self, scope: &Scope, page: &PageRequest) -> StoreResult<Page<CohortRecord>> {
        let rows = sqlx::query_as(SELECT_COHORTS);
        let rows = rows.bind_scope(scope).bind(page.after()).bind(page.row_limit()).fetch_all(self.0.readers()).await?;
        Ok(Page::from_rows(rows, page, |cohort: &CohortRecord| cohort.code.to_string()))
    }

    /// One cohort, by id or code.
    pub async fn get(&self, scope: &Scope, key: &Key) -> StoreResult<CohortRecord> {
        let row = sqlx::query_as(SELECT_COHORT);
        let row = row.bind_scope(scope).bind(key).fetch_optional(self.0.readers()).await?;
        row.ok_or(not_found("cohort"))
    }

    /// Its members that the scope sees, in the order of enrolment.
    pub async fn members(&self, scope: &Scope, key: &Key, page: &PageRequest) -> StoreResult<Page<TraineeId>> {
        let id = self.get(scope, key).await?.id;
        let rows = sqlx::query_scalar(SELECT_MEMBERS);
        let rows =
            rows.bind_scope(scope).bind(id).bind(page.after()).bind(page.row_limit()).fetch_all(self.0.readers());
        Ok(Page::from_rows(rows.await?, page, TraineeId::to_string))
    }

    /// Replaces its name and its members.
    pub async fn replace(&self, scope: &Scope, id: CohortId, new: NewCohort) -> StoreResult<CohortRecord> {
        require_administrator(scope, "changing cohorts")?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let update = sqlx::query(UPDATE_COHORT);
                let update = update.bind(id).bind(&new.code).bind(&new.name).bind(new.members.is_some());
                let update = update.bind(new.level).bind(new.handedness).bind(new.group).execute(&mut *tx).await;
                if update.map_err(|error| taken_or_missing(error, "group"))?.rows_affected() == 0 {
                    return Err(not_found("cohort"));
                }
                sqlx::query(DELETE_MEMBERS).bind(id).execute(&mut *tx).await?;
                list_members(tx, id, new.members.unwrap_or_default()).await?;
                note(tx, &by, now_ms, ("change", "cohort"), id).await
            })
            .await?;
        self.get(scope, &Key::from(&id)).await
    }

    /// Deletes a cohort; its members stay, and so do standards that were made from it.
    pub async fn delete(&self, scope: &Scope, key: &Key) -> StoreResult<()> {
        let id = self.get(scope, key).await?.id;
        require_administrator(scope, "deleting cohorts")?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                sqlx::query(DELETE_COHORT).bind(id).execute(&mut *tx).await?;
                note(tx, &by, now_ms, ("delete", "cohort"), id).await
            })
            .await
    }

    /// Values of its members at a task: these features in the last `sessions` sessions of each. For aggregates only:
    /// the query is not limited to a scope, and trainee ids are returned only so that each person counts once.
    pub async fn values(
        &self,
        id: CohortId,
        task: TaskId,
        sessions: u32,
        features: &[FeatureKey],
    ) -> StoreResult<Vec<CohortValue>> {
        self.values_seen(&Scope::service(), Some(id), task, sessions, features).await
    }

    /// Like [`CohortStore::values`], limited to trainees in the scope: of a cohort, or all of them.
    pub async fn values_seen(
        &self,
        scope: &Scope,
        cohort: Option<CohortId>,
        task: TaskId,
        sessions: u32,
        features: &[FeatureKey],
    ) -> StoreResult<Vec<CohortValue>> {
        let rows = sqlx::query_as::<_, CohortValueRow>(SELECT_VALUES).bind_scope(scope).bind(cohort).bind(task);
        let rows = rows.bind(sessions).bind(Json(features)).bind(MAX_COMPARED);
        let mut found = Vec::new();
        for (trainee, handedness, calibration, pipeline, Json(of), Json(values)) in
            rows.fetch_all(self.0.readers()).await?
        {
            let row = |value| CohortValue {
                trainee,
                handedness,
                calibration,
                pipeline: pipeline.clone(),
                of: of.clone(),
                value,
            };
            found.extend(values.into_iter().map(row));
        }
        Ok(found)
    }
}

async fn list_members(tx: &mut SqliteConnection, id: CohortId, members: Vec<TraineeId>) -> StoreResult<()> {
    for member in members {
        let insert = sqlx::query(INSERT_MEMBER).bind(id).bind(member);
        insert.execute(&mut *tx).await.map_err(missing("trainee"))?;
    }
    Ok(())
}

/// Maps a taken code and a missing group.
fn taken_or_missing(error: sqlx::Error, what: &'static str) -> super::StoreError {
    match error.as_database_error() {
        Some(e) if e.is_foreign_key_violation() => missing(what)(error),
        _ => taken("code")(error),
    }
}
