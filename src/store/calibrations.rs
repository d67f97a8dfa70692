//! Versions of the boxes' cameras: added, never changed, except for the date since which they are valid. A recording is
//! tracked with the version that was valid when it was recorded ([`super::box_versions`]).

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::audit::note;
use super::error::{StoreResult, missing, not_found};
use super::jobs::enqueue_waiting_sessions;
use super::visibility::BindScope;
use super::{Scope, Store};
use crate::domain::calibration::{CalibrationSource, NewCalibration};
use crate::domain::files::camera::CameraFile;
use crate::domain::text::Key;
use crate::ids::{BoxId, CalibrationId};

/// Access to the boxes' cameras.
pub struct CalibrationStore<'s>(pub(super) &'s Store);

/// A version of a box's camera.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct CalibrationRecord {
    /// Its id.
    pub id: CalibrationId,
    /// Its box.
    pub box_id: BoxId,
    /// 1, 2, … within the box.
    pub version: i64,
    /// How it was made.
    pub source: CalibrationSource,
    /// The camera, with the calibration's own figures of quality.
    #[sqlx(json)]
    pub camera: CameraFile,
    /// Reprojection error, pixels, if known.
    pub rms_px: Option<f64>,
    /// When it was stored, epoch ms.
    pub created_at_ms: i64,
    /// Recordings from then on are tracked with it, epoch ms: when it was stored, unless staff stated another time.
    pub valid_from_ms: i64,
}

/// `$4`: now.
const SELECT_IN_USE: &str = "
    SELECT id, box_id, version, source, camera, rms_px, created_at_ms,
           coalesce(valid_from_ms, created_at_ms) AS valid_from_ms FROM calibration
    WHERE box_id = $3 AND ($1 <> 'agent' OR $2 = box_id)
    ORDER BY coalesce(valid_from_ms, created_at_ms) <= $4 DESC,
             abs($4 - coalesce(valid_from_ms, created_at_ms)), version DESC LIMIT 1";

const SELECT_CALIBRATION: &str = "
    SELECT id, box_id, version, source, camera, rms_px, created_at_ms,
           coalesce(valid_from_ms, created_at_ms) AS valid_from_ms FROM calibration
    WHERE id = $3 AND ($1 <> 'agent' OR $2 = box_id)";

const SELECT_CALIBRATIONS: &str = "
    SELECT id, box_id, version, source, camera, rms_px, created_at_ms,
           coalesce(valid_from_ms, created_at_ms) AS valid_from_ms FROM calibration
    WHERE box_id = $3 AND ($1 <> 'agent' OR $2 = box_id) ORDER BY created_at_ms DESC, version DESC LIMIT 100";

const INSERT_CALIBRATION: &str = "
    INSERT INTO calibration (id, box_id, version, source, camera, width, height, rms_px, created_at_ms, valid_from_ms)
    SELECT $1, $2, coalesce(max(version), 0) + 1, $3, $4, $5, $6, $7, $8, $9 FROM calibration
    WHERE box_id = $2
    RETURNING id, box_id, version, source, camera, rms_px, created_at_ms,
              coalesce(valid_from_ms, created_at_ms) AS valid_from_ms";

impl CalibrationStore<'_> {
    /// Stores an uploaded camera as the box's next version and queues the sessions that waited for one.
    pub async fn add(&self, scope: &Scope, of: BoxId, new: NewCalibration) -> StoreResult<CalibrationRecord> {
        self.0.boxes().changeable(scope, &Key::from(&of)).await?;
        let (scope, now_ms, attempts) = (scope.clone(), self.0.now_ms(), self.0.max_attempts());
        self.0
            .write(async move |tx| {
                let calibration = insert(tx, of, new, now_ms).await?;
                enqueue_waiting_sessions(tx, of, now_ms, attempts).await?;
                note(tx, &scope, now_ms, ("calibrate", "box"), of).await?;
                Ok(calibration)
            })
            .await
    }

    /// The version in use, if the box has one.
    pub async fn in_use(&self, scope: &Scope, of: BoxId) -> StoreResult<Option<CalibrationRecord>> {
        let row = sqlx::query_as(SELECT_IN_USE).bind_scope(scope).bind(of).bind(self.0.now_ms());
        Ok(row.fetch_optional(self.0.readers()).await?)
    }

    /// One version.
    pub async fn get(&self, scope: &Scope, id: CalibrationId) -> StoreResult<CalibrationRecord> {
        let row = sqlx::query_as(SELECT_CALIBRATION);
        let row = row.bind_scope(scope).bind(id).fetch_optional(self.0.readers()).await?;
        row.ok_or(not_found("calibration"))
    }

    /// The last hundred versions, newest first.
    pub async fn list(&self, scope: &Scope, of: BoxId) -> StoreResult<Vec<CalibrationRecord>> {
        let rows = sqlx::query_as(SELECT_CALIBRATIONS);
        Ok(rows.bind_scope(scope).bind(of).fetch_all(self.0.readers()).await?)
    }
}

/// Inserts the box's next version.
pub(super) async fn insert(
    tx: &mut SqliteConnection,
    of: BoxId,
    new: NewCalibration,
    now_ms: i64,
) -> StoreResult<CalibrationRecord> {
    let row = sqlx::query_as(INSERT_CALIBRATION);
    let rms_px = new.camera.rms_px();
    let (width, height) = (new.camera.width, new.camera.height);
    let row = row.bind(CalibrationId::at(now_ms)).bind(of).bind(new.source).bind(Json(new.camera));
    let row = row.bind(width).bind(height).bind(rms_px).bind(now_ms).bind(new.valid_from_ms);
    row.fetch_one(tx).await.map_err(missing("box"))
}
