//! Checks pictures while the user waits: one photo of the checkerboard, or what the marked colours would detect as
//! tape or as bare shaft. Nothing is stored.

use axum::extract::State;
use utoipa::ToSchema;

use super::form::{FormPictures, MultipartForm};
use super::palette::{PaletteForm, PaletteFormContent, read_palette_form};
use crate::domain::calibration::BoardSize;
use crate::domain::palette::PalettePreview;
use crate::domain::photo_check::PhotoCheck;
use crate::http::auth::signed_in::Staff;
use crate::http::error::{HandlerResult, ProblemResponse};
use crate::http::read::{Json, PathKey};
use crate::http::state::App;

/// Most frames of one preview, because the user waits for it.
const MAX_FRAMES: usize = 8;

/// One photo of a checkerboard.
#[derive(ToSchema)]
#[expect(dead_code, reason = "describes the form; it is read part by part")]
pub struct PhotoForm {
    /// Inner corners as COLUMNSxROWS, such as `9x6`.
    board: String,
    /// The photo: JPEG, PNG or BMP.
    #[schema(value_type = String, format = Binary)]
    photo: Vec<u8>,
}

/// Check one photo of a checkerboard before calibration
///
/// Answers with the board's corners, or with the reason why they were not found. Nothing is stored.
#[utoipa::path(post, path = "/boxes/{id}/calibrations/check", tag = "boxes",
    params(("id" = String, Path, description = "id or code")),
    request_body(content = PhotoForm, content_type = "multipart/form-data"),
    responses((status = OK, body = PhotoCheck)))]
pub async fn check_photo(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    mut form: MultipartForm,
) -> HandlerResult<Json<PhotoCheck>> {
    app.store.boxes().get(&by.scope, &key).await?;
    let (mut board, mut pictures) = (None, FormPictures::default());
    while let Some(part) = form.next().await? {
        match part.name.as_str() {
            "board" => board = Some(part.text().await?.trim().parse::<BoardSize>()?),
            "photo" => pictures.add_picture(part, None).await?,
            _ => return Err(part.unexpected("board and photo")),
        }
    }
    let board =
        board.ok_or_else(|| ProblemResponse::invalid("board", "is missing; give its inner corners, such as 9x6"))?;
    let [photo] = &pictures.files[..] else {
        return Err(ProblemResponse::invalid("photo", "must be sent exactly once: one photo of the board"));
    };
    Ok(Json(app.quick_analysis.check_photo(board, photo).await?))
}

/// Preview what the marked colours would detect as tape or as bare shaft
///
/// Takes a few frames, with or without marks. Nothing is learned or stored.
#[utoipa::path(post, path = "/boxes/{id}/palettes/preview", tag = "boxes",
    params(("id" = String, Path, description = "id or code")),
    request_body(content = PaletteForm, content_type = "multipart/form-data",
        description = "The same form as for learning the colours, but with pictures only, at most 8. Frames without \
                       marks may be included."),
    responses((status = OK, body = PalettePreview)))]
pub async fn preview_palette(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    form: MultipartForm,
) -> HandlerResult<Json<PalettePreview>> {
    app.store.boxes().get(&by.scope, &key).await?;
    let PaletteFormContent { annotations, pictures, .. } = read_palette_form(form).await?;
    if pictures.is_video {
        return Err(ProblemResponse::invalid("video", "takes too long for a preview; send frame_<n> pictures"));
    }
    if pictures.files.len() > MAX_FRAMES {
        return Err(ProblemResponse::invalid(
            "frame",
            format!("was sent more than {MAX_FRAMES} times; send fewer pictures"),
        ));
    }
    Ok(Json(app.quick_analysis.preview(&annotations, &pictures.files, &pictures.frames).await?))
}
