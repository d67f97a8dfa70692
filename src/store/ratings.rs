//! Ratings of sessions. Rows are added and never changed; each rater's latest rating on a form counts.
//!
//! **Blind rating.** Staff see other raters' ratings on a form, and their comments, only after a rating of their own;
//! the session's trainee sees all. Each row records whether it was blind: a rater who rates again after others did, on
//! this or another form, could have read theirs.

use std::collections::HashSet;

use sqlx::types::Json;

use super::audit::note;
use super::error::{StoreError, StoreResult, missing, not_found};
use super::visibility::{BindScope, require_staff};
use super::{Scope, Store};
use crate::domain::feature::FeatureKey;
use crate::domain::rating::{CheckedRating, ItemMark, RatingForm};
use crate::domain::session::FeatureSpace;
use crate::domain::text::{Name, Remark};
use crate::domain::trainee::Handedness;
use crate::ids::{CalibrationId, PersonId, RatingId, ResultId, SessionId, TaskId, TraineeId};
use crate::motion::features;

/// Access to the ratings.
pub struct RatingStore<'s>(pub(super) &'s Store);

/// Maximum number of ratings of one session by one person.
pub const MAX_PER_RATER: i64 = 20;

/// Maximum number of ratings of a session that are read, newest first.
const MAX_READ: i64 = 1_000;

/// Maximum number of ratings of a task for agreement and correlations, newest first.
const MAX_RATINGS: i64 = 4_000;

/// A rating.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct RatingRecord {
    /// Its id.
    pub id: RatingId,
    /// The rater; `None` if the account has been deleted.
    pub person_id: Option<PersonId>,
    /// The rater's name.
    pub who: Option<Name>,
    /// The form.
    pub form: RatingForm,
    /// The version of the form's wording.
    pub form_version: i64,
    /// The marks, in the form's order.
    #[sqlx(json)]
    pub items: Vec<ItemMark>,
    /// The remark on the whole session.
    pub remark: Option<Remark>,
    /// True if it was given before the rater could see other people's ratings or comments.
    pub is_blind: bool,
    /// When, epoch ms.
    pub created_at_ms: i64,
}

/// The ratings of a session that the caller may see.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VisibleRatings {
    /// The latest rating of each rater on each form, newest first.
    pub items: Vec<RatingRecord>,
    /// The number of raters on each form, including the caller.
    pub raters: Vec<(RatingForm, usize)>,
}

/// A blind rating of a session of a task, with the session's trainee.
#[derive(Clone, Debug, PartialEq)]
pub struct GivenRating {
    /// The session.
    pub session: SessionId,
    /// When the session was recorded, epoch ms.
    pub recorded_at_ms: i64,
    /// The session's trainee.
    pub trainee: TraineeId,
    /// The rater.
    pub rater: PersonId,
    /// The marks, in the form's order.
    pub items: Vec<ItemMark>,
}

/// The value of a feature in a session's latest result.
#[derive(Clone, Debug, PartialEq)]
pub struct SessionValue {
    /// The session.
    pub session: SessionId,
    /// The trainee's preferred hand, if known.
    pub handedness: Option<Handedness>,
    /// Version of the program that measured it.
    pub pipeline: String,
    /// The camera that it was measured with.
    pub calibration: CalibrationId,
    /// The feature.
    pub of: FeatureKey,
    /// The value, in the feature's unit.
    pub value: f64,
}

type GivenRow = (SessionId, i64, TraineeId, PersonId, Json<Vec<ItemMark>>);
type RatedResultRow = (ResultId, SessionId, Option<Handedness>, String, CalibrationId);
type RatedValueRow = (ResultId, String, Option<String>, FeatureSpace, f64);

/// Selects the latest blind rating on form `$4` by each rater of each session of task `$3` that counts;
/// newest sessions first, at most `$5`.
const SELECT_BLIND_RATINGS: &str = "
    SELECT session.id, session.recorded_at_ms, session.trainee_id, rating.person_id, rating.items
    FROM session CROSS JOIN rating ON rating.session_id = session.id AND rating.form = $4
    WHERE session.task_id = $3 AND rating.is_blind = 1 AND rating.person_id IS NOT NULL
      AND NOT EXISTS (SELECT 1 FROM uncounted_session WHERE uncounted_session.session_id = session.id)
      AND ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND rating.form_version = (SELECT max(form_version) FROM rating AS any WHERE any.form = $4)
      AND NOT EXISTS (SELECT 1 FROM rating AS later
                      WHERE later.session_id = rating.session_id AND later.form = rating.form
                      AND later.person_id = rating.person_id AND later.is_blind = 1
                      AND (later.created_at_ms, later.rowid) > (rating.created_at_ms, rating.rowid))
    ORDER BY session.recorded_at_ms DESC, session.id DESC, rating.id LIMIT $5";

/// Selects the current results of those of the sessions `$3` (a JSON array) that count, were tracked here and were not
/// refused.
const SELECT_RATED_RESULTS: &str = "
    SELECT session.result_id, session.id, trainee.handedness, session.pipeline, session.calibration_id
    FROM assessed_session AS session JOIN trainee ON trainee.id = session.trainee_id
    WHERE session.id IN (SELECT value FROM json_each($3))
      AND session.verdict IS NOT 'refused' AND session.calibration_id IS NOT NULL
      AND ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))";

/// Adds rating `$1` of session `$2` by person `$3`, unless they have given `$8`. It is blind unless the rater could
/// have read another person's rating on a form that both used, or, having rated before, another staff member's comment.
const INSERT_RATING: &str = "
    INSERT INTO rating (id, session_id, person_id, form, form_version, items, remark, is_blind, created_at_ms)
    SELECT $1, $2, $3, $4, $5, $6, $9,
           NOT EXISTS (SELECT 1 FROM rating AS own
                       JOIN rating AS other ON other.session_id = own.session_id AND other.form = own.form
                            AND other.person_id IS NOT own.person_id
                       WHERE own.session_id = $2 AND own.person_id = $3)
           AND NOT (EXISTS (SELECT 1 FROM rating WHERE session_id = $2 AND person_id = $3)
                    AND EXISTS (SELECT 1 FROM comment LEFT JOIN person ON person.id = comment.person_id
                                WHERE session_id = $2 AND person_id IS NOT $3
                                      AND coalesce(person.role, 'instructor') <> 'trainee')),
           $7
    WHERE (SELECT count(*) FROM rating WHERE session_id = $2 AND person_id = $3) < $8";

const SELECT_RATINGS: &str = "
    SELECT rating.id, rating.person_id, person.name AS who, form, form_version, items, remark, is_blind,
           rating.created_at_ms
    FROM rating LEFT JOIN person ON person.id = rating.person_id
    WHERE $1 <> 'agent' AND session_id = $3 ORDER BY rating.created_at_ms DESC, rating.rowid DESC LIMIT $4";

const SELECT_HAS_RATED: &str = "SELECT EXISTS (SELECT 1 FROM rating WHERE session_id = $1 AND person_id = $2)";

const SELECT_VALUES: &str = "
    SELECT result_id, name, tool, space, value FROM feature
    WHERE result_id IN (SELECT value FROM json_each($1)) AND value IS NOT NULL
      AND (low IS NULL OR high IS NOT NULL)";

impl RatingStore<'_> {
    /// Adds a rating to a session. An earlier one by the same rater on the same form is kept but no longer counts.
    pub async fn give(&self, scope: &Scope, session: SessionId, new: CheckedRating) -> StoreResult<RatingRecord> {
        self.0.sessions().get(scope, session).await?;
        require_staff(scope, "rating sessions")?;
        let person = scope.person().ok_or(StoreError::Forbidden { what: "rating sessions", whom: "people" })?;
        let (by, now_ms, id) = (scope.clone(), self.0.now_ms(), RatingId::at(self.0.now_ms()));
        self.0
            .write(async move |tx| {
                let insert = sqlx::query(INSERT_RATING);
                let insert = insert.bind(id).bind(session).bind(person).bind(new.form).bind(new.version);
                let insert = insert.bind(Json(new.items)).bind(now_ms).bind(MAX_PER_RATER).bind(new.remark);
                let inserted = insert.execute(&mut *tx).await.map_err(missing("session"))?;
                if inserted.rows_affected() == 0 {
                    let why = format!(
                        "you have rated this session {MAX_PER_RATER} times, which is the limit; your last rating \
                         counts"
                    );
                    return Err(StoreError::refused(why));
                }
                note(tx, &by, now_ms, ("create", "rating"), id).await
            })
            .await?;
        let all = self.of_session(scope, session).await?.items;
        all.into_iter().find(|rating| rating.id == id).ok_or(not_found("rating"))
    }

    /// The ratings of a session that the caller may see.
    pub async fn of_session(&self, scope: &Scope, session: SessionId) -> StoreResult<VisibleRatings> {
        self.0.sessions().get(scope, session).await?;
        let rows = sqlx::query_as(SELECT_RATINGS);
        let rows = rows.bind_scope(scope).bind(session).bind(MAX_READ);
        let mut rows: Vec<RatingRecord> = rows.fetch_all(self.0.readers()).await?;
        let mut met = HashSet::new();
        rows.retain(|rating| rating.person_id.is_none_or(|person| met.insert((person, rating.form))));
        let raters =
            RatingForm::ALL.iter().map(|form| (*form, rows.iter().filter(|row| row.form == *form).count())).collect();
        let own: HashSet<RatingForm> = rows.iter().filter(|row| is_own(row, scope)).map(|row| row.form).collect();
        rows.retain(|row| !scope.is_staff() || own.contains(&row.form));
        Ok(VisibleRatings { items: rows, raters })
    }

    /// True if the caller has rated this session on any form.
    pub async fn has_rated(&self, scope: &Scope, session: SessionId) -> StoreResult<bool> {
        Ok(sqlx::query_scalar(SELECT_HAS_RATED).bind(session).bind(scope.person()).fetch_one(self.0.readers()).await?)
    }

    /// The blind ratings on a form of the task's sessions in the scope: the latest of each rater, newest sessions
    /// first.
    pub async fn given(&self, scope: &Scope, task: TaskId, form: RatingForm) -> StoreResult<Vec<GivenRating>> {
        require_staff(scope, "the agreement of raters")?;
        let rows = sqlx::query_as::<_, GivenRow>(SELECT_BLIND_RATINGS);
        let rows = rows.bind_scope(scope).bind(task).bind(form).bind(MAX_RATINGS).fetch_all(self.0.readers()).await?;
        let given = |(session, recorded_at_ms, trainee, rater, Json(items))| GivenRating {
            session,
            recorded_at_ms,
            trainee,
            rater,
            items,
        };
        Ok(rows.into_iter().map(given).collect())
    }

    /// The features in the latest results of those of these sessions that are in the scope; sessions that were refused
    /// or measured by another program are left out, and so are features that this version does not measure.
    pub async fn values(&self, scope: &Scope, sessions: &[SessionId]) -> StoreResult<Vec<SessionValue>> {
        require_staff(scope, "the correlation of ratings with features")?;
        let results = sqlx::query_as::<_, RatedResultRow>(SELECT_RATED_RESULTS);
        let results = results.bind_scope(scope).bind(Json(sessions)).fetch_all(self.0.readers()).await?;
        let ids: Vec<ResultId> = results.iter().map(|row| row.0).collect();
        let rows = sqlx::query_as::<_, RatedValueRow>(SELECT_VALUES);
        let rows = rows.bind(Json(ids)).fetch_all(self.0.readers()).await?;
        let results: std::collections::HashMap<ResultId, RatedResultRow> =
            results.into_iter().map(|row| (row.0, row)).collect();
        let value = |(result, name, tool, space, value): RatedValueRow| {
            let (_, session, handedness, pipeline, calibration) = results.get(&result)?.clone();
            Some(SessionValue {
                session,
                handedness,
                pipeline,
                calibration,
                of: FeatureKey::of_tool(features::find(&name).ok()?, tool, space),
                value,
            })
        };
        Ok(rows.into_iter().filter_map(value).collect())
    }
}

fn is_own(rating: &RatingRecord, scope: &Scope) -> bool {
    rating.person_id.is_some() && rating.person_id == scope.person()
}
