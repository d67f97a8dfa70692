//! A box's colours: learned from frames in which an instructor marked tools; and which tapes suit it, before any is wound.

use axum::extract::State;
use axum::http::StatusCode;
use axum::response::IntoResponse;
use serde::Serialize;
use utoipa::ToSchema;

use super::form::{Form, Pictures};
use crate::domain::boxes::BoxTool;
use crate::domain::files::annotations::AnnotationsFile;
use crate::domain::job::{AdviceInput, JobInput, PaletteInput};
use crate::domain::palette::{ColourVerdict, ConfusionRow, LabelCount, PaletteReport};
use crate::http::auth::signed_in::{Member, Staff};
use crate::http::error::{Answer, Problem};
use crate::http::jobs::Queued;
use crate::http::read::{At, Json};
use crate::http::show::{Page, Time};
use crate::http::state::App;
use crate::ids::PaletteId;
use crate::store;

/// A version of a box's colours.
#[derive(Debug, Serialize, ToSchema)]
pub struct Palette {
    id: PaletteId,
    /// 1, 2, … within the box; the highest is in use.
    version: i64,
    /// The tools, with their sizes.
    tools: Vec<BoxTool>,
    /// How many samples each label gave.
    counts: Vec<LabelCount>,
    /// What the marked pixels of each label are taken for when their own rectangle has no say; null where the colours were
    /// learned before that was asked, as are `verdicts` and `warnings`.
    confusion: Option<Vec<ConfusionRow>>,
    /// Each tool's colour: good, at risk or bad, and why.
    verdicts: Option<Vec<ColourVerdict>>,
    /// A line for each colour that is not good: what speaks against it.
    warnings: Option<Vec<String>>,
    /// What was marked.
    annotations: AnnotationsFile,
    created_at: Time,
}

impl From<store::Palette> for Palette {
    fn from(found: store::Palette) -> Self {
        let store::Palette { id, version, annotations, tools, counts, report, created_at_ms, .. } = found;
        let (confusion, verdicts, warnings) = match report {
            Some(PaletteReport { confusion, verdicts, warnings }) => (Some(confusion), Some(verdicts), Some(warnings)),
            None => (None, None, None),
        };
        let created_at = Time(created_at_ms);
        Self { id, version, tools, counts, confusion, verdicts, warnings, annotations, created_at }
    }
}

/// List the versions of a box's colours, newest first
#[utoipa::path(get, path = "/boxes/{id}/palette", tag = "boxes",
    params(("id" = String, Path, description = "id or code")), responses((status = OK, body = Page<Palette>)))]
pub async fn palette(State(app): State<App>, by: Member, At(key): At) -> Answer<Json<Page<Palette>>> {
    let of = app.store.boxes().get(&by.scope, &key).await?;
    let versions = app.store.palettes().list(&by.scope, of.id).await?;
    Ok(Json(Page::whole(versions.into_iter().map(Palette::from))))
}

/// Marked frames.
#[derive(ToSchema)]
#[expect(dead_code, reason = "describes the form; it is read part by part")]
pub struct PaletteForm {
    /// annotations.json.
    annotations: AnnotationsFile,
    /// The clip in which `frame` counts.
    #[schema(value_type = Option<String>, format = Binary)]
    video: Option<Vec<u8>>,
    /// Or a picture for each marked frame; the part's name tells its number: `frame_12`.
    #[schema(value_type = Option<String>, format = Binary)]
    frame_0: Option<Vec<u8>>,
}

/// Send marked frames: a job learns the box's next colours
#[utoipa::path(put, path = "/boxes/{id}/palette", tag = "boxes",
    params(("id" = String, Path, description = "id or code")),
    request_body(content = PaletteForm, content_type = "multipart/form-data"), responses((status = ACCEPTED, body = Queued)))]
pub async fn put_palette(State(app): State<App>, by: Staff, At(key): At, form: Form) -> Answer<impl IntoResponse> {
    let of = app.store.boxes().get(&by.scope, &key).await?;
    let (annotations, pictures) = read(form).await?;
    let Pictures { ref files, ref frames, is_video, .. } = pictures;
    let (files, frames) = (files.clone(), frames.clone());
    let input = PaletteInput { of: of.id, annotations, files, is_video, frames };
    let job = app.store.jobs().enqueue(&by.scope, JobInput::Palette(input)).await?;
    app.queue.work_arrived();
    Ok((StatusCode::ACCEPTED, Json(Queued { job: job.id })))
}

/// What a [`PaletteForm`] says.
pub(super) async fn read(mut form: Form) -> Answer<(AnnotationsFile, Pictures)> {
    let (mut annotations, mut pictures) = (None, Pictures::default());
    while let Some(part) = form.next().await? {
        match (part.name.as_str(), frame(&part.name)) {
            ("annotations", _) => annotations = Some(parse(&part.text().await?)?),
            ("video", _) => pictures.add_video(part).await?,
            (_, Some(frame)) => pictures.add_picture(part, Some(frame)).await?,
            _ => return Err(part.unexpected("annotations, and video or frame_0, frame_1, …")),
        }
    }
    let annotations =
        annotations.ok_or_else(|| Problem::invalid("annotations", "is missing; send annotations.json"))?;
    check_frames(&annotations, &pictures)?;
    Ok((annotations, pictures))
}

fn parse(text: &str) -> Answer<AnnotationsFile> {
    AnnotationsFile::parse(text).map_err(|error| Problem::invalid("annotations", error))
}

/// The frame that a part of this name shows.
fn frame(name: &str) -> Option<u64> {
    name.strip_prefix("frame_")?.parse().ok()
}

/// Every marked frame must be there.
fn check_frames(annotations: &AnnotationsFile, pictures: &Pictures) -> Answer<()> {
    if pictures.files.is_empty() {
        return Err(Problem::invalid(
            "video",
            "is missing; send the clip in which `frame` counts, or frame_<n> pictures",
        ));
    }
    let missing = annotations.labels.iter().find(|label| !pictures.is_video && !pictures.frames.contains(&label.frame));
    match missing {
        Some(label) => {
            Err(Problem::invalid(&format!("frame_{}", label.frame), "is marked, but its picture is missing"))
        }
        None => Ok(()),
    }
}

/// A picture of the box without tools.
#[derive(ToSchema)]
#[expect(dead_code, reason = "describes the form; it is read part by part")]
pub struct AdviceForm {
    /// A photo, or a recording that begins with such a picture.
    #[schema(value_type = String, format = Binary)]
    picture: Vec<u8>,
}

/// Ask which tapes suit the box, by a picture of it without tools: a job ranks them, and has them as `advice` once it is done
#[utoipa::path(post, path = "/boxes/{id}/palette/advice", tag = "boxes",
    params(("id" = String, Path, description = "id or code")),
    request_body(content = AdviceForm, content_type = "multipart/form-data"), responses((status = ACCEPTED, body = Queued)))]
pub async fn advise(State(app): State<App>, by: Staff, At(key): At, mut form: Form) -> Answer<impl IntoResponse> {
    let of = app.store.boxes().get(&by.scope, &key).await?;
    let mut pictures = Pictures::default();
    while let Some(part) = form.next().await? {
        match part.name.as_str() {
            "picture" => pictures.add_picture(part, None).await?,
            _ => return Err(part.unexpected("picture")),
        }
    }
    let [picture] = &pictures.files[..] else {
        return Err(Problem::invalid(
            "picture",
            "must be there, once: a photo of the box without tools, or a recording",
        ));
    };
    let input = AdviceInput { of: of.id, picture: picture.clone() };
    let job = app.store.jobs().enqueue(&by.scope, JobInput::Advice(input)).await?;
    app.queue.work_arrived();
    Ok((StatusCode::ACCEPTED, Json(Queued { job: job.id })))
}
