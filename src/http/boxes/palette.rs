//! A box's tool colours, learned from frames that an instructor marked; and advice on tape colours that suit the box.

use axum::extract::State;
use axum::http::StatusCode;
use axum::response::IntoResponse;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::form::{FormPictures, MultipartForm};
use crate::domain::boxes::BoxTool;
use crate::domain::files::annotations::{AnnotationsFile, ToolSize};
use crate::domain::job::{AdviseInput, JobInput, NamedBlob, PaletteInput};
use crate::domain::palette::{ColourVerdict, ConfusionRow, LabelCount, PaletteReport};
use crate::domain::scope::Scope;
use crate::http::auth::signed_in::{Member, Staff};
use crate::http::error::{HandlerResult, ProblemResponse};
use crate::http::jobs::QueuedJobResponse;
use crate::http::read::{Json, PathKey};
use crate::http::show::{PageResponse, Time};
use crate::http::state::App;
use crate::ids::{BoxId, PaletteId};
use crate::store;

/// A version of a box's colours.
#[derive(Debug, Serialize, ToSchema)]
pub struct PaletteResponse {
    id: PaletteId,
    /// 1, 2, … within the box.
    version: i64,
    /// The tools, with their sizes.
    tools: Vec<BoxTool>,
    /// Number of samples of each label.
    counts: Vec<LabelCount>,
    /// How the marked pixels of each label are classified when their own rectangle is left out of the learning. `null`
    /// for versions learned before this was computed; `verdicts` and `warnings` are `null` then, too.
    confusion: Option<Vec<ConfusionRow>>,
    /// Each tool's colour: good, at risk or bad, and why.
    verdicts: Option<Vec<ColourVerdict>>,
    /// One sentence for each colour that is not good, with the reason.
    warnings: Option<Vec<String>>,
    /// The marks that the colours were learned from.
    annotations: AnnotationsFile,
    created_at: Time,
    /// Recordings that were made from then on are tracked with this version, until the next one is valid: `created_at`,
    /// unless staff stated another time.
    valid_from: Time,
    /// True for the version that recordings made now are tracked with.
    in_use: bool,
}

impl PaletteResponse {
    fn new(found: store::PaletteRecord, in_use: bool) -> Self {
        let store::PaletteRecord { id, version, annotations, tools, counts, report, .. } = found;
        let (confusion, verdicts, warnings) = match report {
            Some(PaletteReport { confusion, verdicts, warnings }) => (Some(confusion), Some(verdicts), Some(warnings)),
            None => (None, None, None),
        };
        let (created_at, valid_from) = (Time(found.created_at_ms), Time(found.valid_from_ms));
        Self { id, version, tools, counts, confusion, verdicts, warnings, annotations, created_at, valid_from, in_use }
    }
}

impl App {
    /// The versions of a box's colours, newest first.
    pub(super) async fn palettes_of(&self, scope: &Scope, of: BoxId) -> HandlerResult<Vec<PaletteResponse>> {
        let versions = self.store.palettes().list(scope, of).await?;
        let in_use = self.store.palettes().in_use(scope, of).await?.map(|in_use| in_use.id);
        let shown = |found: store::PaletteRecord| {
            let is_in_use = in_use == Some(found.id);
            PaletteResponse::new(found, is_in_use)
        };
        Ok(versions.into_iter().map(shown).collect())
    }
}

/// List the versions of a box's colours, newest first
#[utoipa::path(get, path = "/boxes/{id}/palettes", tag = "boxes",
    params(("id" = String, Path, description = "id or code")),
    responses((status = OK, body = PageResponse<PaletteResponse>)))]
pub async fn palettes(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
) -> HandlerResult<Json<PageResponse<PaletteResponse>>> {
    let of = app.store.boxes().get(&by.scope, &key).await?;
    Ok(Json(PageResponse::whole(app.palettes_of(&by.scope, of.id).await?)))
}

/// Marked frames.
#[derive(ToSchema)]
#[expect(dead_code, reason = "describes the form; it is read part by part")]
pub struct PaletteForm {
    /// The content of annotations.json.
    annotations: AnnotationsFile,
    /// The clip that the `frame` numbers refer to.
    #[schema(value_type = Option<String>, format = Binary)]
    video: Option<Vec<u8>>,
    /// Instead of the clip, one picture for each marked frame. The part's name contains the frame number: `frame_12`.
    #[schema(value_type = Option<String>, format = Binary)]
    frame_0: Option<Vec<u8>>,
    /// A photo of the box without tools, of the marked frames' size, for tools without tape. It replaces the file that
    /// `empty_box` in the annotations names. A preview does not need it.
    #[schema(value_type = Option<String>, format = Binary)]
    empty_box: Option<Vec<u8>>,
    /// Without a part `empty_box`: `true` keeps the photo that the box has, `false` removes it. Absent: `true`.
    keep_empty_box: Option<bool>,
}

/// The content of a [`PaletteForm`].
pub(super) struct PaletteFormContent {
    pub(super) annotations: AnnotationsFile,
    /// The clip, or the marked frames.
    pub(super) pictures: FormPictures,
    empty_box: FormPictures,
    keeps_empty_box: bool,
}

/// Learn the box's colours from marked frames
///
/// A job learns the next version of the colours. A photo of the empty box is kept with this version. The next version
/// with tools without tape has the same photo, unless another one is sent or `keep_empty_box` is `false`. In the
/// annotations of a version, `empty_box` is the SHA-256 of its photo.
#[utoipa::path(post, path = "/boxes/{id}/palettes", tag = "boxes",
    params(("id" = String, Path, description = "id or code")),
    request_body(content = PaletteForm, content_type = "multipart/form-data"),
    responses((status = ACCEPTED, body = QueuedJobResponse)))]
pub async fn learn_palette(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    form: MultipartForm,
) -> HandlerResult<impl IntoResponse> {
    let of = app.store.boxes().changeable(&by.scope, &key).await?;
    let PaletteFormContent { mut annotations, pictures, empty_box, keeps_empty_box } = read_palette_form(form).await?;
    let kept = match keeps_empty_box && annotations.has_bare_tools() {
        true => app.store.palettes().empty_box(&by.scope, of.id).await?,
        false => None,
    };
    let kept = kept.map(|blob| NamedBlob { name: "empty_box".to_owned(), blob });
    let is_sent = !empty_box.files.is_empty();
    let photo = empty_box.files.first().cloned().or(kept);
    let hash = photo.as_ref().map(|photo| photo.blob.hash.to_string());
    if !is_sent && annotations.empty_box.is_some() && annotations.empty_box != hash {
        return Err(ProblemResponse::invalid(
            "empty_box",
            "is named in the annotations, but was not sent; send the photo of the empty box in a part `empty_box`",
        ));
    }
    annotations.empty_box = hash;
    let FormPictures { ref files, ref frames, is_video, .. } = pictures;
    let (files, frames) = (files.clone(), frames.clone());
    let input = PaletteInput { of: of.id, annotations, files, is_video, frames, empty_box: photo };
    let job = app.store.jobs().enqueue(&by.scope, JobInput::Palette(input)).await?;
    app.queue.work_arrived();
    Ok((StatusCode::ACCEPTED, Json(QueuedJobResponse { job: job.id })))
}

/// Corrected sizes of a box's tools.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewToolSizes {
    /// One for each tool of the box.
    tools: Vec<ToolSize>,
}

/// Correct the sizes of a box's tools
///
/// Makes the next version of the colours, with the marks and samples of the one in use: nothing has to be marked again.
/// New recordings are measured with these sizes. To track earlier ones again with them, date the new version back.
#[utoipa::path(put, path = "/boxes/{id}/tool-sizes", tag = "boxes",
    params(("id" = String, Path, description = "id or code")), request_body = NewToolSizes,
    responses((status = OK, body = PaletteResponse)))]
pub async fn resize_tools(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    Json(new): Json<NewToolSizes>,
) -> HandlerResult<Json<PaletteResponse>> {
    let of = app.store.boxes().changeable(&by.scope, &key).await?;
    let now = app.store.palettes().in_use(&by.scope, of.id).await?;
    if let Some(palette) = now {
        let checked = palette.annotations.with_sizes(new.tools.clone());
        checked.map_err(|error| ProblemResponse::invalid("tools", error))?;
    }
    let made = app.store.palettes().resize(&by.scope, of.id, new.tools).await?;
    Ok(Json(PaletteResponse::new(made, true)))
}

/// Reads a [`PaletteForm`].
pub(super) async fn read_palette_form(mut form: MultipartForm) -> HandlerResult<PaletteFormContent> {
    let (mut annotations, mut pictures, mut empty_box) = (None, FormPictures::default(), FormPictures::default());
    let mut keeps_empty_box = true;
    while let Some(part) = form.next().await? {
        match (part.name.as_str(), frame_number(&part.name)) {
            ("annotations", _) => annotations = Some(parse_annotations(&part.text().await?)?),
            ("video", _) => pictures.add_video(part).await?,
            ("empty_box", _) if empty_box.files.is_empty() => empty_box.add_picture(part, None).await?,
            ("empty_box", _) => return Err(ProblemResponse::invalid("empty_box", "was sent twice; send one photo")),
            ("keep_empty_box", _) => keeps_empty_box = parse_choice(&part.text().await?)?,
            (_, Some(frame)) => pictures.add_picture(part, Some(frame)).await?,
            _ => return Err(part.unexpected("annotations, video or frame_0, frame_1, …, empty_box, keep_empty_box")),
        }
    }
    let annotations = annotations
        .ok_or_else(|| ProblemResponse::invalid("annotations", "is missing: send the tools and their marks"))?;
    check_frames(&annotations, &pictures)?;
    Ok(PaletteFormContent { annotations, pictures, empty_box, keeps_empty_box })
}

fn parse_annotations(text: &str) -> HandlerResult<AnnotationsFile> {
    AnnotationsFile::parse(text).map_err(|error| ProblemResponse::invalid("annotations", error))
}

fn parse_choice(text: &str) -> HandlerResult<bool> {
    let refusal = |_| ProblemResponse::invalid("keep_empty_box", "must be `true` or `false`");
    text.trim().parse().map_err(refusal)
}

/// The frame number in a part's name such as `frame_12`.
fn frame_number(name: &str) -> Option<u64> {
    name.strip_prefix("frame_")?.parse().ok()
}

/// Refuses a form that lacks the picture of a marked frame.
fn check_frames(annotations: &AnnotationsFile, pictures: &FormPictures) -> HandlerResult<()> {
    if pictures.files.is_empty() {
        return Err(ProblemResponse::invalid(
            "video",
            "is missing; send the clip that the `frame` numbers refer to, or frame_<n> pictures",
        ));
    }
    let missing = annotations.labels.iter().find(|label| !pictures.is_video && !pictures.frames.contains(&label.frame));
    match missing {
        Some(label) => {
            Err(ProblemResponse::invalid(&format!("frame_{}", label.frame), "is marked, but its picture is missing"))
        }
        None => Ok(()),
    }
}

/// A picture of the box without tools.
#[derive(ToSchema)]
#[expect(dead_code, reason = "describes the form; it is read part by part")]
pub struct AdviceForm {
    /// A photo, or a recording whose first frame shows the box without tools.
    #[schema(value_type = String, format = Binary)]
    picture: Vec<u8>,
}

/// Ask which tape colours suit the box
///
/// Takes a picture of the box without tools. A job ranks the tapes; read the job once it is done: its `advice` holds
/// the ranking.
#[utoipa::path(post, path = "/boxes/{id}/palettes/advice", tag = "boxes",
    params(("id" = String, Path, description = "id or code")),
    request_body(content = AdviceForm, content_type = "multipart/form-data"),
    responses((status = ACCEPTED, body = QueuedJobResponse)))]
pub async fn advise(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    mut form: MultipartForm,
) -> HandlerResult<impl IntoResponse> {
    let of = app.store.boxes().get(&by.scope, &key).await?;
    let mut pictures = FormPictures::default();
    while let Some(part) = form.next().await? {
        match part.name.as_str() {
            "picture" => pictures.add_picture(part, None).await?,
            _ => return Err(part.unexpected("picture")),
        }
    }
    let [picture] = &pictures.files[..] else {
        return Err(ProblemResponse::invalid(
            "picture",
            "must be sent exactly once: a photo of the box without tools, or a recording",
        ));
    };
    let input = AdviseInput { of: of.id, picture: picture.clone() };
    let job = app.store.jobs().enqueue(&by.scope, JobInput::Advise(input)).await?;
    app.queue.work_arrived();
    Ok((StatusCode::ACCEPTED, Json(QueuedJobResponse { job: job.id })))
}
