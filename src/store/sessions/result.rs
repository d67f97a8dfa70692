//! What came of sessions: results and features, one set per session and versions; the latest counts.

use serde_json::Value;
use sqlx::FromRow;
use sqlx::sqlite::SqliteRow;
use sqlx::types::Json;

use super::super::error::{StoreResult, not_found};
use super::super::visibility::{AskedBy, sees_trainee};
use super::Sessions;
use crate::domain::blob::BlobHash;
use crate::domain::files::quality::fulcrums_of;
use crate::domain::session::{FeatureError, FeatureRow, FeatureSpace, Versions, VideoFacts};
use crate::ids::{BoxId, CalibrationId, PaletteId, ResultId, SessionId};
use crate::pipeline::pose::fulcrum::Fulcrum;
use crate::store::Scope;

/// What one version of the program made of a session.
#[derive(Clone, Debug, PartialEq)]
pub struct SessionResult {
    /// Its id.
    pub id: ResultId,
    /// What it was made with.
    pub versions: Versions,
    /// With which state of the session's edits.
    pub edits: u64,
    /// What decoding the recording showed.
    pub video: VideoFacts,
    /// Names of the tools, in the trajectory's order.
    pub tools: Vec<String>,
    /// Counts and reasons per tool; an object.
    pub quality: Value,
    /// Place in a reference cohort, if a model scored it; an object.
    pub score: Option<Value>,
    /// Raw, filtered and smoothed paths: a file in the vault.
    pub trajectory: BlobHash,
    /// What the tracker saw on every frame: a file in the vault; `None` where it was not tracked here.
    pub diagnostics: Option<BlobHash>,
    /// A JPEG of one frame: a file in the vault.
    pub preview: Option<BlobHash>,
    /// When it was stored, epoch ms.
    pub created_at_ms: i64,
    /// Features, in the order in which people read them.
    pub features: Vec<FeatureRow>,
}

#[derive(FromRow)]
struct Row {
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
    #[sqlx(json)]
    tools: Vec<String>,
    #[sqlx(json)]
    quality: Value,
    #[sqlx(json(nullable))]
    score: Option<Value>,
    trajectory: BlobHash,
    diagnostics: Option<BlobHash>,
    preview: Option<BlobHash>,
    created_at_ms: i64,
}

/// A session's place in the order in which they came, by the clock of the service: when it was whole, epoch ms, and its id.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SessionPlace(pub i64, pub SessionId);

/// The sessions of box `$1` with calibration `$2` that came before `$3`, `$4` and know their trocars; in the order of the index
/// `session_box_order`, so that no more are read than are needed for the first `$5`.
macro_rules! fulcrums_before {
    () => {
        "SELECT session.created_at_ms, session.id, result.quality FROM session JOIN result ON result.id =
             (SELECT latest.id FROM result AS latest WHERE latest.session_id = session.id
              ORDER BY latest.created_at_ms DESC, latest.id DESC LIMIT 1)
         WHERE session.box_id = $1 AND result.calibration_id = $2 AND (session.created_at_ms, session.id) < ($3, $4)
           AND json_extract(result.quality, '$.verdict') <> 'refused'
           AND EXISTS (SELECT 1 FROM json_each(result.quality, '$.tools') AS tool
                       WHERE json_extract(tool.value, '$.fulcrum') IS NOT NULL)
           AND NOT EXISTS (SELECT 1 FROM json_each(result.quality, '$.reasons') AS reason
                           WHERE json_extract(reason.value, '$.name') IN ('camera_moved', 'port_moved'))
         ORDER BY session.created_at_ms, session.id LIMIT $5"
    };
}
#[cfg(test)]
pub(in crate::store) use fulcrums_before;

impl Sessions<'_> {
    /// The latest result of a session; `None` while there is none.
    pub async fn result(&self, scope: &Scope, id: SessionId) -> StoreResult<Option<SessionResult>> {
        let row = sqlx::query_as::<_, Row>(concat!(
            "SELECT result.* FROM result JOIN session ON session.id = session_id WHERE session_id = $3 AND ",
            sees_trainee!("session.trainee_id"),
            " ORDER BY result.created_at_ms DESC, result.id DESC LIMIT 1"
        ));
        match row.asked_by(scope).bind(id).fetch_optional(self.0.readers()).await? {
            None => self.get(scope, id).await.map(|_| None),
            Some(row) => {
                let features = self.features(row.id).await?;
                Ok(Some(row.with(features)))
            }
        }
    }

    /// One result of a session, whether it counts or not.
    pub async fn result_of(&self, scope: &Scope, id: SessionId, result: ResultId) -> StoreResult<SessionResult> {
        let row = sqlx::query_as::<_, Row>(concat!(
            "SELECT result.* FROM result JOIN session ON session.id = session_id WHERE session_id = $3 AND result.id = $4 AND ",
            sees_trainee!("session.trainee_id"),
        ));
        let row = row.asked_by(scope).bind(id).bind(result).fetch_optional(self.0.readers()).await?;
        let row = row.ok_or(not_found("result"))?;
        let features = self.features(row.id).await?;
        Ok(row.with(features))
    }

    /// All results of a session without their features, the one that counts first; at most so many.
    pub async fn results(&self, scope: &Scope, id: SessionId, most: u32) -> StoreResult<Vec<SessionResult>> {
        let rows = sqlx::query_as::<_, Row>(concat!(
            "SELECT result.* FROM result JOIN session ON session.id = session_id WHERE session_id = $3 AND ",
            sees_trainee!("session.trainee_id"),
            " ORDER BY result.created_at_ms DESC, result.id DESC LIMIT $4"
        ));
        let rows = rows.asked_by(scope).bind(id).bind(most).fetch_all(self.0.readers()).await?;
        if rows.is_empty() {
            self.get(scope, id).await?;
        }
        Ok(rows.into_iter().map(|row| row.with(Vec::new())).collect())
    }

    /// Where the trocars were in a box's sessions with this calibration, the first that came first: of those that know it and were not
    /// refused, and in which nothing had moved, so that what has moved stays so until the box is calibrated again.
    /// Of those that came before this place; at most so many, each with its own place.
    pub async fn fulcrums(
        &self,
        of: BoxId,
        calibration: CalibrationId,
        before: SessionPlace,
        most: usize,
    ) -> StoreResult<Vec<(SessionPlace, Vec<Fulcrum>)>> {
        let rows = sqlx::query_as::<_, (i64, SessionId, Json<Value>)>(fulcrums_before!());
        let SessionPlace(created_at_ms, session) = before;
        let rows = rows.bind(of).bind(calibration).bind(created_at_ms).bind(session).bind(most as i64);
        let found = rows.fetch_all(self.0.readers()).await?;
        let known =
            |(at_ms, id, quality): &(i64, SessionId, Json<Value>)| (SessionPlace(*at_ms, *id), fulcrums_of(quality));
        Ok(found.iter().map(known).collect())
    }

    /// Is a session of this box being tracked at this moment that came before this place? Not one that has a result and is only
    /// scored or tracked again: a long rescoring must not hold up what is new.
    pub async fn is_tracked_before(&self, of: BoxId, before: SessionPlace) -> StoreResult<bool> {
        let sql = "SELECT EXISTS (SELECT 1 FROM job JOIN session ON session.id = job.session_id
                   WHERE job.state = 'running' AND job.turn < 2 AND session.box_id = $1 AND (session.created_at_ms, session.id) < ($2, $3))";
        let SessionPlace(created_at_ms, session) = before;
        let found = sqlx::query_scalar(sql).bind(of).bind(created_at_ms).bind(session);
        Ok(found.fetch_one(self.0.readers()).await?)
    }

    async fn features(&self, result: ResultId) -> StoreResult<Vec<FeatureRow>> {
        let rows = sqlx::query_as(
            "SELECT name, title, unit, tool, space, value, not_enough, as_measured, sigma, low, high, no_error
             FROM feature WHERE result_id = $1 ORDER BY position",
        );
        Ok(rows.bind(result).fetch_all(self.0.readers()).await?)
    }
}

impl Row {
    fn with(self, features: Vec<FeatureRow>) -> SessionResult {
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
            },
            tools: self.tools,
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
            value: value.ok_or_else(|| not_enough.unwrap_or_default()), // the schema has exactly one of them
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
