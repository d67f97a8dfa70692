//! A look at pictures while somebody waits: is a photo of the board good, what would marks take for tape? Nothing is stored.

use axum::extract::State;
use utoipa::ToSchema;

use super::form::{Form, Pictures};
use super::palette::{PaletteForm, read};
use crate::domain::calibration::BoardSize;
use crate::domain::palette::PalettePreview;
use crate::domain::photo_check::PhotoCheck;
use crate::http::auth::signed_in::Staff;
use crate::http::error::{Answer, Problem};
use crate::http::read::{At, Json};
use crate::http::state::App;

/// Most frames of one preview: somebody waits for it.
const MOST_FRAMES: usize = 8;

/// One photo of a checkerboard.
#[derive(ToSchema)]
#[expect(dead_code, reason = "describes the form; it is read part by part")]
pub struct PhotoForm {
    /// Inner corners as COLUMNSxROWS, such as `9x6`.
    board: String,
    /// The photo, JPEG or PNG.
    #[schema(value_type = String, format = Binary)]
    photo: Vec<u8>,
}

/// Look at one photo of a checkerboard, before it is sent for calibration: its corners, or why they are not found
#[utoipa::path(post, path = "/boxes/{id}/calibrations/check", tag = "boxes",
    params(("id" = String, Path, description = "id or code")),
    request_body(content = PhotoForm, content_type = "multipart/form-data"), responses((status = OK, body = PhotoCheck)))]
pub async fn check_photo(State(app): State<App>, by: Staff, At(key): At, mut form: Form) -> Answer<Json<PhotoCheck>> {
    app.store.boxes().get(&by.scope, &key).await?;
    let (mut board, mut pictures) = (None, Pictures::default());
    while let Some(part) = form.next().await? {
        match part.name.as_str() {
            "board" => board = Some(part.text().await?.trim().parse::<BoardSize>()?),
            "photo" => pictures.add_picture(part, None).await?,
            _ => return Err(part.unexpected("board and photo")),
        }
    }
    let board = board.ok_or_else(|| Problem::invalid("board", "is missing; say its inner corners, such as 9x6"))?;
    let [photo] = &pictures.files[..] else {
        return Err(Problem::invalid("photo", "must be there, once: one photo of the board"));
    };
    Ok(Json(app.glances.check_photo(board, photo).await?))
}

/// Look at what marks would take for tape on a few frames, marked or not, before the colours are learned
#[utoipa::path(post, path = "/boxes/{id}/palette/preview", tag = "boxes",
    params(("id" = String, Path, description = "id or code")),
    request_body(content = PaletteForm, content_type = "multipart/form-data",
        description = "As for learning, but pictures alone, at most 8; also of frames on which nothing is marked."),
    responses((status = OK, body = PalettePreview)))]
pub async fn preview_palette(
    State(app): State<App>,
    by: Staff,
    At(key): At,
    form: Form,
) -> Answer<Json<PalettePreview>> {
    app.store.boxes().get(&by.scope, &key).await?;
    let (annotations, pictures) = read(form).await?;
    if pictures.is_video {
        return Err(Problem::invalid("video", "takes too long for a look; send frame_<n> pictures"));
    }
    if pictures.files.len() > MOST_FRAMES {
        return Err(Problem::invalid("frame", format!("comes more than {MOST_FRAMES} times; send fewer pictures")));
    }
    Ok(Json(app.glances.preview(&annotations, &pictures.files, &pictures.frames).await?))
}
