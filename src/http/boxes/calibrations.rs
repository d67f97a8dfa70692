//! A box's camera calibration: sent as camera.json, or computed from pictures of a checkerboard.

use axum::extract::State;
use axum::http::StatusCode;
use axum::response::IntoResponse;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::{IntoParams, ToSchema};

use super::form::{FormPictures, MultipartForm};
use super::valid_from::parse_valid_from;
use crate::domain::calibration::{BoardSize, CalibrationSource, NewCalibration};
use crate::domain::camera_warning::{CameraWarning, camera_warnings};
use crate::domain::files::camera::CameraFile;
use crate::domain::job::{CalibrateInput, JobInput};
use crate::domain::scope::Scope;
use crate::http::auth::signed_in::{Member, Staff};
use crate::http::error::{HandlerResult, ProblemResponse};
use crate::http::jobs::QueuedJobResponse;
use crate::http::read::{Json, Params, PathKey};
use crate::http::show::{PageResponse, Time};
use crate::http::state::App;
use crate::ids::{BoxId, CalibrationId};
use crate::store;

/// A version of a box's camera calibration.
#[derive(Debug, Serialize, ToSchema)]
pub struct CalibrationResponse {
    id: CalibrationId,
    /// 1, 2, … within the box.
    version: i64,
    source: CalibrationSource,
    /// Picture width, pixels.
    width: u32,
    /// Picture height, pixels.
    height: u32,
    /// Reprojection error (RMS), pixels; `null` if camera.json did not contain it.
    rms_px: Option<f64>,
    /// Which photos were used, and why the others were not; `null` unless this service computed the calibration.
    photos: Option<Value>,
    /// What makes the camera doubtful, with figure and limit. A camera.json of another program is judged by its numbers
    /// alone.
    warnings: Vec<CameraWarning>,
    created_at: Time,
    /// Recordings that were made from then on are tracked with this version, until the next one is valid: `created_at`,
    /// unless staff stated another time.
    valid_from: Time,
    /// True for the version that recordings made now are tracked with.
    in_use: bool,
}

impl CalibrationResponse {
    /// The version, and whether it is in use.
    pub(super) fn new(mut found: store::CalibrationRecord, in_use: bool) -> Self {
        Self {
            in_use,
            valid_from: Time(found.valid_from_ms),
            id: found.id,
            version: found.version,
            source: found.source,
            width: found.camera.width,
            height: found.camera.height,
            rms_px: found.rms_px,
            warnings: camera_warnings(&found.camera),
            photos: found.camera.more.remove("photos"),
            created_at: Time(found.created_at_ms),
        }
    }
}

/// Read the calibration in use, as camera.json
#[utoipa::path(get, path = "/boxes/{id}/camera", tag = "boxes",
    params(("id" = String, Path, description = "id or code")),
    responses((status = OK, description = "camera.json in OpenCV's convention", body = Object)))]
pub async fn camera(State(app): State<App>, by: Member, PathKey(key): PathKey) -> HandlerResult<Json<CameraFile>> {
    let of = app.store.boxes().get(&by.scope, &key).await?;
    let in_use = app.store.calibrations().in_use(&by.scope, of.id).await?;
    in_use.map(|found| Json(found.camera)).ok_or_else(ProblemResponse::not_found)
}

/// Since when a camera.json is valid.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct CameraQuery {
    /// Recordings that were made from then on are tracked with it, RFC 3339; default: now. For the calibration of an
    /// earlier day, which must not replace the one in use.
    valid_from: Option<String>,
}

/// Set the box's calibration from a camera.json
///
/// It becomes the next version. Recordings that are made from now on, or from `valid_from` on, are tracked with it.
#[utoipa::path(put, path = "/boxes/{id}/camera", tag = "boxes",
    params(("id" = String, Path, description = "id or code"), CameraQuery),
    request_body(content = Object, description = "camera.json: width, height, fx, fy, cx, cy, k1, k2, p1, p2, k3"),
    responses((status = OK, body = CalibrationResponse)))]
pub async fn put_camera(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    Params(CameraQuery { valid_from }): Params<CameraQuery>,
    Json(camera): Json<CameraFile>,
) -> HandlerResult<Json<CalibrationResponse>> {
    let of = app.store.boxes().changeable(&by.scope, &key).await?;
    let camera = CameraFile::parse(&camera.to_json()).map_err(|error| ProblemResponse::invalid("camera", error))?;
    let valid_from_ms = valid_from.as_deref().map(|text| parse_valid_from(text, app.clock.now_ms())).transpose()?;
    let new = NewCalibration { camera, source: CalibrationSource::File, valid_from_ms };
    let added = app.store.calibrations().add(&by.scope, of.id, new).await?;
    app.queue.work_arrived();
    let in_use = app.store.calibrations().in_use(&by.scope, of.id).await?;
    let is_in_use = in_use.is_some_and(|in_use| in_use.id == added.id);
    Ok(Json(CalibrationResponse::new(added, is_in_use)))
}

/// List the versions of a box's calibration, newest first
#[utoipa::path(get, path = "/boxes/{id}/calibrations", tag = "boxes",
    params(("id" = String, Path, description = "id or code")),
    responses((status = OK, body = PageResponse<CalibrationResponse>)))]
pub async fn calibrations(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
) -> HandlerResult<Json<PageResponse<CalibrationResponse>>> {
    let of = app.store.boxes().get(&by.scope, &key).await?;
    Ok(Json(PageResponse::whole(app.calibrations_of(&by.scope, of.id).await?)))
}

impl App {
    /// The versions of a box's calibration, newest first.
    pub(super) async fn calibrations_of(&self, scope: &Scope, of: BoxId) -> HandlerResult<Vec<CalibrationResponse>> {
        let versions = self.store.calibrations().list(scope, of).await?;
        let in_use = self.store.calibrations().in_use(scope, of).await?.map(|in_use| in_use.id);
        let shown = |found: store::CalibrationRecord| {
            let is_in_use = in_use == Some(found.id);
            CalibrationResponse::new(found, is_in_use)
        };
        Ok(versions.into_iter().map(shown).collect())
    }
}

/// Pictures of a checkerboard.
#[derive(ToSchema)]
#[expect(dead_code, reason = "describes the form; it is read part by part")]
pub struct BoardForm {
    /// Inner corners as COLUMNSxROWS, such as `9x6`.
    board: String,
    /// Side of a square, mm.
    square_mm: f64,
    /// Photos, JPEG, PNG or BMP: 3 to 100. Photos of another size than most, and files that are no photos, are left out.
    #[schema(value_type = Vec<String>, format = Binary)]
    photo: Vec<Vec<u8>>,
    /// A video of the board, instead of photos.
    #[schema(value_type = Option<String>, format = Binary)]
    video: Option<Vec<u8>>,
}

/// Calibrate the camera from pictures of a checkerboard
///
/// A job computes the next version of the calibration.
#[utoipa::path(post, path = "/boxes/{id}/calibrations", tag = "boxes",
    params(("id" = String, Path, description = "id or code")),
    request_body(content = BoardForm, content_type = "multipart/form-data"),
    responses((status = ACCEPTED, body = QueuedJobResponse)))]
pub async fn calibrate(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    form: MultipartForm,
) -> HandlerResult<impl IntoResponse> {
    let of = app.store.boxes().changeable(&by.scope, &key).await?;
    let BoardRequest { board, square_mm, pictures } = BoardRequest::read(form).await?;
    let FormPictures { ref files, is_video, .. } = pictures;
    let input = CalibrateInput { of: of.id, board, square_mm, files: files.clone(), is_video };
    let job = app.store.jobs().enqueue(&by.scope, JobInput::Calibrate(input)).await?;
    app.queue.work_arrived();
    Ok((StatusCode::ACCEPTED, Json(QueuedJobResponse { job: job.id })))
}

/// The content of a [`BoardForm`].
struct BoardRequest {
    board: BoardSize,
    square_mm: f64,
    pictures: FormPictures,
}

impl BoardRequest {
    async fn read(mut form: MultipartForm) -> HandlerResult<Self> {
        let (mut board, mut square_mm, mut pictures) = (None, None, FormPictures::default());
        while let Some(part) = form.next().await? {
            match part.name.as_str() {
                "board" => board = Some(part.text().await?.trim().parse()?),
                "square_mm" => square_mm = Some(parse_square_mm(&part.text().await?)?),
                "photo" => pictures.add_picture(part, None).await?,
                "video" => pictures.add_video(part).await?,
                _ => return Err(part.unexpected("board, square_mm, and photo (several) or video")),
            }
        }
        if pictures.files.is_empty() {
            return Err(ProblemResponse::invalid(
                "photo",
                "is missing; send photos of the board from several sides, or a video",
            ));
        }
        let board = board
            .ok_or_else(|| ProblemResponse::invalid("board", "is missing; give its inner corners, such as 9x6"))?;
        let square_mm = square_mm
            .ok_or_else(|| ProblemResponse::invalid("square_mm", "is missing; give the side of a square in mm"))?;
        Ok(Self { board, square_mm, pictures })
    }
}

pub(super) fn parse_square_mm(text: &str) -> HandlerResult<f64> {
    let side: Option<f64> = text.trim().parse().ok();
    let possible = side.filter(|side| side.is_finite() && *side > 0.0 && *side <= 1000.0);
    possible.ok_or_else(|| ProblemResponse::invalid("square_mm", "expected a number of mm above 0 and at most 1000"))
}
