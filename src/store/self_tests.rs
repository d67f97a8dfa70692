//! Self-tests of boxes, each with its traffic light: added, never changed.

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::error::{StoreResult, missing};
use super::page::{Page, PageRequest};
use super::visibility::BindScope;
use super::{Scope, Store};
use crate::domain::self_test::{NewSelfTest, SelfTestReport, TrafficLight};
use crate::ids::{BoxId, CalibrationId, PaletteId, SelfTestId};
use crate::motion::PIPELINE_VERSION;

/// Access to the boxes' self-tests. New ones come from a job ([`super::JobStore::finish_self_test`]).
pub struct SelfTestStore<'s>(pub(super) &'s Store);

/// A self-test of a box.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct SelfTestRecord {
    /// Its id.
    pub id: SelfTestId,
    /// Its box.
    pub box_id: BoxId,
    /// The version of the camera that was tested.
    pub calibration_id: CalibrationId,
    /// The version of the colours that were tested.
    pub palette_id: PaletteId,
    /// Name of the person who ran it; `None` if a program did, or the account has been deleted.
    pub who: Option<String>,
    /// The worst of its parts.
    pub light: TrafficLight,
    /// The full report.
    #[sqlx(json)]
    pub report: SelfTestReport,
    /// When it was stored, epoch ms.
    pub created_at_ms: i64,
}

/// The light of a self-test, without its figures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct SelfTestLight {
    /// The self-test's id.
    pub id: SelfTestId,
    /// The worst of its parts.
    pub light: TrafficLight,
    /// When it was stored, epoch ms.
    pub created_at_ms: i64,
}

const SELECT_SELF_TESTS: &str = "
    SELECT self_test.id, box_id, calibration_id, palette_id, person.name AS who, light, report,
           self_test.created_at_ms
    FROM self_test
    LEFT JOIN person ON person.id = self_test.person_id
    WHERE box_id = $3 AND ($1 <> 'agent' OR $2 = box_id) AND ($4 IS NULL OR self_test.id < $4)
    ORDER BY self_test.id DESC LIMIT $5";

const SELECT_LATEST_LIGHT: &str = "
    SELECT id, light, created_at_ms FROM self_test
    WHERE box_id = $3 AND ($1 <> 'agent' OR $2 = box_id) ORDER BY id DESC LIMIT 1";

const SELECT_LAST_PASSED: &str = "
    SELECT id, light, created_at_ms FROM self_test
    WHERE box_id = $3 AND ($1 <> 'agent' OR $2 = box_id) AND light IN ('green', 'yellow') ORDER BY id DESC LIMIT 1";

/// Whether a counted result since `$4` says that the camera has moved. A self-test and a calibration answer it.
const SELECT_CAMERA_MOVED: &str = "
    SELECT EXISTS (
        SELECT 1 FROM session JOIN current_result AS result ON result.session_id = session.id
        WHERE session.box_id = $3 AND ($1 <> 'agent' OR $2 = session.box_id) AND session.created_at_ms >= $4
          AND session.trainee_id NOT IN (SELECT trainee_id FROM pending_erasure)
          AND session.id NOT IN (SELECT session_id FROM set_aside_session)
          AND ($1 <> 'trainee' OR session.id NOT IN (SELECT session_id FROM sealed_session))
          AND EXISTS (SELECT 1 FROM json_each(result.quality, '$.reasons') AS reason
                      WHERE reason.value ->> '$.cause' IN ('camera_moved', 'camera_moved_during')))";

const INSERT_SELF_TEST: &str = "
    INSERT INTO self_test (id, box_id, calibration_id, palette_id, person_id, pipeline, light, report,
        created_at_ms)
    VALUES ($1, $2, $3, $4, (SELECT id FROM person WHERE id = $5), $6, $7, $8, $9)";

impl SelfTestStore<'_> {
    /// A box's self-tests, newest first.
    pub async fn list(&self, scope: &Scope, of: BoxId, page: &PageRequest) -> StoreResult<Page<SelfTestRecord>> {
        let rows = sqlx::query_as(SELECT_SELF_TESTS);
        let rows = rows.bind_scope(scope).bind(of).bind(page.after()).bind(page.row_limit());
        let rows = rows.fetch_all(self.0.readers()).await?;
        Ok(Page::from_rows(rows, page, |test: &SelfTestRecord| test.id.to_string()))
    }

    /// The light of the latest self-test, if it was made since `since_ms`, epoch ms.
    pub async fn light_since(&self, scope: &Scope, of: BoxId, since_ms: i64) -> StoreResult<Option<SelfTestLight>> {
        let row = sqlx::query_as(SELECT_LATEST_LIGHT);
        let last: Option<SelfTestLight> = row.bind_scope(scope).bind(of).fetch_optional(self.0.readers()).await?;
        Ok(last.filter(|test| test.created_at_ms >= since_ms))
    }

    /// The latest self-test of a box that was neither red nor without a result.
    pub async fn last_passed(&self, scope: &Scope, of: BoxId) -> StoreResult<Option<SelfTestLight>> {
        let row = sqlx::query_as(SELECT_LAST_PASSED);
        Ok(row.bind_scope(scope).bind(of).fetch_optional(self.0.readers()).await?)
    }

    /// True if a session of a box that arrived since `since_ms` says that the camera has moved.
    pub async fn camera_has_moved(&self, scope: &Scope, of: BoxId, since_ms: i64) -> StoreResult<bool> {
        let row = sqlx::query_scalar(SELECT_CAMERA_MOVED).bind_scope(scope).bind(of).bind(since_ms);
        Ok(row.fetch_one(self.0.readers()).await?)
    }
}

/// Inserts a box's next self-test.
pub(super) async fn insert(tx: &mut SqliteConnection, of: BoxId, new: NewSelfTest, now_ms: i64) -> StoreResult<()> {
    let insert = sqlx::query(INSERT_SELF_TEST);
    let insert = insert.bind(SelfTestId::at(now_ms)).bind(of).bind(new.calibration).bind(new.palette).bind(new.person);
    let insert = insert.bind(PIPELINE_VERSION).bind(new.report.light).bind(Json(new.report)).bind(now_ms);
    insert.execute(tx).await.map_err(missing("box")).map(drop)
}
