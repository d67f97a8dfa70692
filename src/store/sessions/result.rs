//! Results and features of sessions: one result per session and set of versions. The latest is the current one.

use serde_json::Value;
use sqlx::FromRow;
use sqlx::sqlite::{SqliteConnection, SqliteRow};
use sqlx::types::Json;

use super::super::edits;
use super::super::error::{StoreResult, not_found};
use super::super::visibility::BindScope;
use super::SessionStore;
use crate::domain::blob::BlobHash;
use crate::domain::edit::EditsInForce;
use crate::domain::files::quality::stored_fulcrums;
use crate::domain::hand::ToolHands;
use crate::domain::session::{FeatureError, FeatureRow, FeatureSpace, ResultClock, Versions, VideoFacts};
use crate::ids::{BoxId, CalibrationId, PaletteId, ResultId, SessionId};
use crate::store::Scope;
use crate::vision::pose::fulcrum::Fulcrum;

/// The result of a session by one set of versions.
#[derive(Clone, Debug, PartialEq)]
pub struct SessionResult {
    /// Its id.
    pub id: ResultId,
    /// The versions that it was made with.
    pub versions: Versions,
    /// The revision of the session's edits that it was made with.
    pub edits: u64,
    /// Facts from decoding the recording.
    pub video: VideoFacts,
    /// Names of the tools, in the trajectory's order.
    pub tools: Vec<String>,
    /// The tools in the trainee's hands.
    pub hands: ToolHands,
    /// Counts and reasons for each tool; a JSON object.
    pub quality: Value,
    /// Always empty: reserved for a rank in a reference cohort.
    pub score: Option<Value>,
    /// Raw, filtered and smoothed paths: a file in the vault.
    pub trajectory: BlobHash,
    /// The tracker's diagnostics of every frame: a file in the vault; `None` if the session was not tracked here.
    pub diagnostics: Option<BlobHash>,
    /// A JPEG of one frame: a file in the vault.
    pub preview: Option<BlobHash>,
    /// When it was stored, epoch ms.
    pub created_at_ms: i64,
    /// Features, in the order of display.
    pub features: Vec<FeatureRow>,
}

#[derive(FromRow)]
struct SessionResultRow {
    id: ResultId,
    pipeline: String,
    tracked_with: Option<String>,
    calibration_id: Option<CalibrationId>,
    palette_id: Option<PaletteId>,
    model: Option<String>,
    #[sqlx(try_from = "i64")]
    edits: u64,
    width: Option<u32>,
    height: Option<u32>,
    #[sqlx(try_from = "i64")]
    frames: u64,
    duration_s: f64,
    #[sqlx(json(nullable))]
    clock: Option<ResultClock>,
    #[sqlx(json)]
    tools: Vec<String>,
    left_tool: Option<String>,
    right_tool: Option<String>,
    #[sqlx(json)]
    quality: Value,
    #[sqlx(json(nullable))]
    score: Option<Value>,
    trajectory: BlobHash,
    diagnostics: Option<BlobHash>,
    preview: Option<BlobHash>,
    created_at_ms: i64,
}

/// Sort key for the order of arrival: when the session had arrived completely by the clock of the service, epoch ms,
/// and its id.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SessionOrderKey(pub i64, pub SessionId);

/// Selects the sessions of box `$1` with calibration `$2` that arrived before (`$3`, `$4`) and have trocar positions.
/// The order is that of the index `session_box_order`, so that only the first `$5` are read.
pub(in crate::store) const SELECT_FULCRUMS_BEFORE: &str = "
    SELECT session.created_at_ms, session.id, result.quality
    FROM session JOIN current_result AS result ON result.session_id = session.id
    WHERE session.box_id = $1 AND result.calibration_id = $2 AND (session.created_at_ms, session.id) < ($3, $4)
      AND result.verdict <> 'refused'
      AND session.box_question IS NOT 'asked' AND session.box_question IS NOT 'other_box'
      AND EXISTS (SELECT 1 FROM json_each(result.quality, '$.tools') AS tool
                  WHERE json_extract(tool.value, '$.fulcrum') IS NOT NULL)
      AND NOT EXISTS (SELECT 1 FROM json_each(result.quality, '$.reasons') AS reason
                      WHERE json_extract(reason.value, '$.name')
                            IN ('camera_moved_during', 'camera_moved', 'port_moved'))
    ORDER BY session.created_at_ms, session.id LIMIT $5";

const SELECT_SESSION_RESULT: &str = "
    SELECT result.* FROM current_result AS result JOIN session ON session.id = result.session_id
    WHERE result.session_id = $3
      AND ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($1 <> 'trainee' OR session.id NOT IN (SELECT session_id FROM sealed_session))";

const SELECT_RESULT: &str = "
    SELECT result.* FROM result JOIN session ON session.id = result.session_id
    WHERE result.session_id = $3 AND result.id = $4
      AND ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($1 <> 'trainee' OR session.id NOT IN (SELECT session_id FROM sealed_session))";

const SELECT_RESULTS: &str = "
    SELECT result.* FROM result JOIN session ON session.id = result.session_id
    WHERE result.session_id = $3
      AND ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($1 <> 'trainee' OR session.id NOT IN (SELECT session_id FROM sealed_session))
    ORDER BY result.id = (SELECT current.id FROM current_result AS current WHERE current.session_id = $3) DESC,
             result.rowid DESC LIMIT $4";

const SELECT_HAS_EARLIER_RUNNING: &str = "
    SELECT EXISTS (SELECT 1 FROM job JOIN session ON session.id = job.session_id
                   WHERE job.state = 'running' AND job.turn < 2 AND session.box_id = $1
                   AND (session.created_at_ms, session.id) < ($2, $3))";

const SELECT_FEATURES: &str = "
    SELECT name, title, unit, tool, space, value, not_enough, as_measured, sigma, low, high, no_error
    FROM feature
    WHERE result_id = $1 ORDER BY position";

impl SessionStore<'_> {
    /// The latest result of a session; `None` if there is none.
    pub async fn result(&self, scope: &Scope, id: SessionId) -> StoreResult<Option<SessionResult>> {
        let row = sqlx::query_as::<_, SessionResultRow>(SELECT_SESSION_RESULT);
        match row.bind_scope(scope).bind(id).fetch_optional(self.0.readers()).await? {
            None => self.get(scope, id).await.map(|_| None),
            Some(row) => {
                let features = self.features(row.id).await?;
                Ok(Some(row.with_features(features)))
            }
        }
    }

    /// The latest result of a session with the edits in force at the same moment; `None` if there is no result. The
    /// times of these edits are those of the result's path.
    pub async fn result_with_edits(
        &self,
        scope: &Scope,
        id: SessionId,
    ) -> StoreResult<Option<(SessionResult, EditsInForce)>> {
        let mut snapshot = self.0.readers().begin().await?;
        let row = sqlx::query_as::<_, SessionResultRow>(SELECT_SESSION_RESULT);
        let row = row.bind_scope(scope).bind(id).fetch_optional(&mut *snapshot).await?;
        let edits = edits::in_force(&mut snapshot, id).await?;
        snapshot.rollback().await?;
        match row {
            None => self.get(scope, id).await.map(|_| None),
            Some(row) => {
                let features = self.features(row.id).await?;
                Ok(Some((row.with_features(features), edits)))
            }
        }
    }

    /// One result of a session, current or not.
    pub async fn result_of(&self, scope: &Scope, id: SessionId, result: ResultId) -> StoreResult<SessionResult> {
        let row = sqlx::query_as::<_, SessionResultRow>(SELECT_RESULT);
        let row = row.bind_scope(scope).bind(id).bind(result).fetch_optional(self.0.readers()).await?;
        let row = row.ok_or(not_found("result"))?;
        let features = self.features(row.id).await?;
        Ok(row.with_features(features))
    }

    /// The results of a session without their features, the current one first; at most `most`.
    pub async fn results(&self, scope: &Scope, id: SessionId, most: u32) -> StoreResult<Vec<SessionResult>> {
        let rows = sqlx::query_as::<_, SessionResultRow>(SELECT_RESULTS);
        let rows = rows.bind_scope(scope).bind(id).bind(most).fetch_all(self.0.readers()).await?;
        if rows.is_empty() {
            self.get(scope, id).await?;
        }
        Ok(rows.into_iter().map(|row| row.with_features(Vec::new())).collect())
    }

    /// Trocar positions in a box's earliest sessions with this calibration, before the session `before`; at most
    /// `most`, each with its sort key. Sessions that were refused, whose camera or trocars had moved, or that may show
    /// another box, do not count.
    /// A shift is therefore reported until the box is calibrated again.
    pub async fn fulcrums(
        &self,
        of: BoxId,
        calibration: CalibrationId,
        before: SessionOrderKey,
        most: usize,
    ) -> StoreResult<Vec<(SessionOrderKey, Vec<Fulcrum>)>> {
        let rows = sqlx::query_as::<_, (i64, SessionId, Json<Value>)>(SELECT_FULCRUMS_BEFORE);
        let SessionOrderKey(created_at_ms, session) = before;
        let rows = rows.bind(of).bind(calibration).bind(created_at_ms).bind(session).bind(most as i64);
        let found = rows.fetch_all(self.0.readers()).await?;
        let known = |(at_ms, id, quality): &(i64, SessionId, Json<Value>)| {
            (SessionOrderKey(*at_ms, *id), stored_fulcrums(quality))
        };
        Ok(found.iter().map(known).collect())
    }

    /// True if an earlier session of this box is being tracked at present. Sessions that already have a result and are
    /// only scored or tracked again do not count, so that a long rescoring does not delay new sessions.
    pub async fn has_earlier_running(&self, of: BoxId, before: SessionOrderKey) -> StoreResult<bool> {
        let SessionOrderKey(created_at_ms, session) = before;
        let found = sqlx::query_scalar(SELECT_HAS_EARLIER_RUNNING).bind(of).bind(created_at_ms).bind(session);
        Ok(found.fetch_one(self.0.readers()).await?)
    }

    async fn features(&self, result: ResultId) -> StoreResult<Vec<FeatureRow>> {
        let rows = sqlx::query_as(SELECT_FEATURES);
        Ok(rows.bind(result).fetch_all(self.0.readers()).await?)
    }
}

/// The features of a result, in the order of display.
pub(in crate::store) async fn features_of(tx: &mut SqliteConnection, result: ResultId) -> StoreResult<Vec<FeatureRow>> {
    Ok(sqlx::query_as(SELECT_FEATURES).bind(result).fetch_all(tx).await?)
}

impl SessionResultRow {
    fn with_features(self, features: Vec<FeatureRow>) -> SessionResult {
        SessionResult {
            id: self.id,
            versions: Versions {
                pipeline: self.pipeline,
                tracked_with: self.tracked_with,
                calibration: self.calibration_id,
                palette: self.palette_id,
                model: self.model,
            },
            edits: self.edits,
            video: VideoFacts {
                width: self.width,
                height: self.height,
                frames: self.frames,
                duration_s: self.duration_s,
                clock: self.clock,
            },
            tools: self.tools,
            hands: ToolHands { left: self.left_tool, right: self.right_tool },
            quality: self.quality,
            score: self.score,
            trajectory: self.trajectory,
            diagnostics: self.diagnostics,
            preview: self.preview,
            created_at_ms: self.created_at_ms,
            features,
        }
    }
}

impl FromRow<'_, SqliteRow> for FeatureRow {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        use sqlx::Row;
        let value: Option<f64> = row.try_get("value")?;
        let not_enough: Option<String> = row.try_get("not_enough")?;
        Ok(Self {
            name: row.try_get("name")?,
            title: row.try_get("title")?,
            unit: row.try_get("unit")?,
            tool: row.try_get("tool")?,
            space: row.try_get::<FeatureSpace, _>("space")?,
            value: value.ok_or_else(|| not_enough.unwrap_or_default()), // the schema requires exactly one of them
            error: error_of(row)?,
        })
    }
}

fn error_of(row: &SqliteRow) -> Result<Option<Result<FeatureError, String>>, sqlx::Error> {
    use sqlx::Row;
    let of = |column| row.try_get::<Option<f64>, _>(column);
    if let (Some(as_measured), Some(sigma), Some(low), Some(high)) =
        (of("as_measured")?, of("sigma")?, of("low")?, of("high")?)
    {
        return Ok(Some(Ok(FeatureError { as_measured, sigma, low, high })));
    }
    Ok(row.try_get::<Option<String>, _>("no_error")?.map(Err))
}
