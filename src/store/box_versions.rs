//! Which version of a box's camera and colours a recording is tracked with, and since when each
//! version is valid.
//!
//! A version is valid from the time at which it was stored, unless staff state another time. A recording is tracked with
//! the version that became valid last before it was recorded. If two became valid at the same moment, the later version
//! counts. A recording that is older than all versions is tracked with the one that became valid first. The views
//! `session_time` and `valid_setup` (`migrations/0043_valid_from.sql`) have this rule.

use super::audit::note;
use super::error::{StoreResult, not_found};
use super::{Scope, Store};
use crate::domain::text::Key;
use crate::ids::{BoxId, CalibrationId, PaletteId, SessionId};

/// Access to the validity of the versions.
pub struct BoxVersionStore<'s>(pub(super) &'s Store);

/// A version of a box's camera or colours that a session was tracked with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct UsedVersion {
    /// 1, 2, … within the box.
    pub version: i64,
    /// When it was stored, epoch ms.
    pub created_at_ms: i64,
    /// Recordings from then on are tracked with it, epoch ms.
    pub valid_from_ms: i64,
    /// True if the box had no version when the recording was made, nor within [`SET_UP_MS`] after it.
    pub is_later: bool,
    /// The version that the recording would be tracked with now, if it is another one.
    pub valid_version: Option<i64>,
}

/// The versions that a session was tracked with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SessionSetup {
    /// Of the camera's calibration.
    pub calibration: UsedVersion,
    /// Of the colours.
    pub palette: UsedVersion,
}

/// How long after a recording the first set-up of its box may be made and count as that of the recording, ms. The clip on
/// which the tools are marked is recorded before the set-up, which takes hours at most.
const SET_UP_MS: i64 = 24 * 3_600_000;

const SELECT_USED_CALIBRATION: &str = "
    SELECT used.version, used.created_at_ms, coalesce(used.valid_from_ms, used.created_at_ms) AS valid_from_ms,
           coalesce(used.valid_from_ms, used.created_at_ms) > setup.made_at_ms + $2 AS is_later,
           nullif((SELECT version FROM calibration WHERE id = setup.calibration_id), used.version) AS valid_version
    FROM session JOIN current_result AS result ON result.session_id = session.id
    JOIN valid_setup AS setup ON setup.session_id = session.id
    JOIN calibration AS used ON used.id = result.calibration_id
    WHERE session.id = $1";

const SELECT_USED_PALETTE: &str = "
    SELECT used.version, used.created_at_ms, coalesce(used.valid_from_ms, used.created_at_ms) AS valid_from_ms,
           coalesce(used.valid_from_ms, used.created_at_ms) > setup.made_at_ms + $2 AS is_later,
           nullif((SELECT version FROM palette WHERE id = setup.palette_id), used.version) AS valid_version
    FROM session JOIN current_result AS result ON result.session_id = session.id
    JOIN valid_setup AS setup ON setup.session_id = session.id
    JOIN palette AS used ON used.id = result.palette_id
    WHERE session.id = $1";

const SET_CALIBRATION_VALID_FROM: &str = "UPDATE calibration SET valid_from_ms = $3 WHERE id = $1 AND box_id = $2";

const SET_PALETTE_VALID_FROM: &str = "UPDATE palette SET valid_from_ms = $3 WHERE id = $1 AND box_id = $2";

impl BoxVersionStore<'_> {
    /// The versions that the current result of a session was tracked with; `None` if there is none, or if another program
    /// measured it.
    pub async fn of_session(&self, scope: &Scope, session: SessionId) -> StoreResult<Option<SessionSetup>> {
        self.0.sessions().get(scope, session).await?;
        let mut snapshot = self.0.readers().begin().await?;
        let calibration = sqlx::query_as(SELECT_USED_CALIBRATION)
            .bind(session)
            .bind(SET_UP_MS)
            .fetch_optional(&mut *snapshot)
            .await?;
        let palette =
            sqlx::query_as(SELECT_USED_PALETTE).bind(session).bind(SET_UP_MS).fetch_optional(&mut *snapshot).await?;
        snapshot.rollback().await?;
        Ok(calibration.zip(palette).map(|(calibration, palette)| SessionSetup { calibration, palette }))
    }

    /// Sets from when a version of the box's camera is valid; `None`: from when it was stored. Sessions keep their results
    /// until they are tracked again.
    pub async fn set_calibration_valid_from(
        &self,
        scope: &Scope,
        (of, id): (BoxId, CalibrationId),
        at_ms: Option<i64>,
    ) -> StoreResult<()> {
        self.set(scope, of, (SET_CALIBRATION_VALID_FROM, "calibration", id.to_string()), at_ms).await
    }

    /// The same for a version of the box's colours.
    pub async fn set_palette_valid_from(
        &self,
        scope: &Scope,
        (of, id): (BoxId, PaletteId),
        at_ms: Option<i64>,
    ) -> StoreResult<()> {
        self.set(scope, of, (SET_PALETTE_VALID_FROM, "palette", id.to_string()), at_ms).await
    }

    async fn set(
        &self,
        scope: &Scope,
        of: BoxId,
        (statement, noun, id): (&'static str, &'static str, String),
        at_ms: Option<i64>,
    ) -> StoreResult<()> {
        self.0.boxes().changeable(scope, &Key::from(&of)).await?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let set = sqlx::query(statement).bind(&id).bind(of).bind(at_ms).execute(&mut *tx).await?;
                if set.rows_affected() == 0 {
                    return Err(not_found(noun));
                }
                note(tx, &by, now_ms, ("change", noun), id).await
            })
            .await
    }
}
