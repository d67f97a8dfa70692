//! From when a version of a box's camera or colours is valid: which recordings are tracked with it.

use axum::extract::State;
use serde::Deserialize;
use utoipa::ToSchema;

use super::{CalibrationResponse, PaletteResponse};
use crate::domain::text::Key;
use crate::http::auth::signed_in::Staff;
use crate::http::error::{HandlerResult, ProblemResponse};
use crate::http::read::{Json, PathPair};
use crate::http::show::PageResponse;
use crate::http::state::App;
use crate::ids::{CalibrationId, PaletteId};
use crate::time::from_rfc3339;

/// Since when a version is valid.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ValidFromChange {
    /// RFC 3339; not in the future. `null`: since the version was stored.
    #[serde(deserialize_with = "Option::deserialize")]
    #[schema(required = true)]
    valid_from: Option<String>,
}

/// Set from when a version of the calibration is valid
///
/// A recording is tracked with the version that became valid last before it was recorded, and with the first one if it is
/// older than all of them. For a calibration that replaces a wrong one, give the time of the wrong one: of two versions
/// with the same time the later one counts. Sessions keep their results until they are tracked again
/// (`POST sessions/{id}/retry`, or a rescoring from the recordings); `setup` of a session says which versions it was
/// tracked with. The answer has all versions.
#[utoipa::path(patch, path = "/boxes/{id}/calibrations/{calibration}", tag = "boxes",
    params(("id" = String, Path, description = "id or code"),
        ("calibration" = String, Path, description = "id of the version")),
    request_body = ValidFromChange, responses((status = OK, body = PageResponse<CalibrationResponse>)))]
pub async fn date_calibration(
    State(app): State<App>,
    by: Staff,
    PathPair(key, id): PathPair<String, CalibrationId>,
    Json(change): Json<ValidFromChange>,
) -> HandlerResult<Json<PageResponse<CalibrationResponse>>> {
    let of = app.store.boxes().changeable(&by.scope, &Key::from(key.as_str())).await?.id;
    let at_ms = change.at_ms(app.clock.now_ms())?;
    app.store.box_versions().set_calibration_valid_from(&by.scope, (of, id), at_ms).await?;
    Ok(Json(PageResponse::whole(app.calibrations_of(&by.scope, of).await?)))
}

/// Set from when a version of the colours is valid
///
/// The same rule as for calibrations.
#[utoipa::path(patch, path = "/boxes/{id}/palettes/{palette}", tag = "boxes",
    params(("id" = String, Path, description = "id or code"),
        ("palette" = String, Path, description = "id of the version")),
    request_body = ValidFromChange, responses((status = OK, body = PageResponse<PaletteResponse>)))]
pub async fn date_palette(
    State(app): State<App>,
    by: Staff,
    PathPair(key, id): PathPair<String, PaletteId>,
    Json(change): Json<ValidFromChange>,
) -> HandlerResult<Json<PageResponse<PaletteResponse>>> {
    let of = app.store.boxes().changeable(&by.scope, &Key::from(key.as_str())).await?.id;
    let at_ms = change.at_ms(app.clock.now_ms())?;
    app.store.box_versions().set_palette_valid_from(&by.scope, (of, id), at_ms).await?;
    Ok(Json(PageResponse::whole(app.palettes_of(&by.scope, of).await?)))
}

impl ValidFromChange {
    fn at_ms(&self, now_ms: i64) -> HandlerResult<Option<i64>> {
        self.valid_from.as_deref().map(|text| parse_valid_from(text, now_ms)).transpose()
    }
}

/// Since when a version is valid.
pub(super) fn parse_valid_from(text: &str, now_ms: i64) -> HandlerResult<i64> {
    match from_rfc3339(text) {
        None => Err(ProblemResponse::invalid("valid_from", "expected an RFC 3339 time such as 2026-11-21T20:14:00Z")),
        Some(at_ms) if at_ms < 0 => Err(ProblemResponse::invalid("valid_from", "is before 1970")),
        Some(at_ms) if at_ms > now_ms => Err(ProblemResponse::invalid("valid_from", "is in the future")),
        Some(at_ms) => Ok(at_ms),
    }
}
