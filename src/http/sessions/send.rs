//! Receives a whole recording in one request; the video is the body.

use axum::extract::{Request, State};
use axum::http::header;
use futures_util::StreamExt;
use serde::Deserialize;
use utoipa::IntoParams;

use super::show::SessionResponse;
use crate::http::auth::signed_in::Member;
use crate::http::error::{HandlerResult, ProblemResponse, Refusal};
use crate::http::read::{Params, content_length};
use crate::http::show::Created;
use crate::http::state::App;
use crate::intake::RecordingDescription;

/// What the recording belongs to.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct SendQuery {
    /// The trainee, by id or code; a trainee may leave it out.
    trainee: Option<String>,
    /// The task, by id or code.
    #[param(required)]
    task: Option<String>,
    /// The box, by id or code.
    #[serde(rename = "box")]
    #[param(rename = "box", required)]
    in_box: Option<String>,
    /// Name of the file, for people.
    filename: Option<String>,
    /// When it was recorded, RFC 3339; default: now.
    recorded_at: Option<String>,
    /// The true frame rate, Hz, where the file's time stamps are wrong. All times are scaled to it.
    #[param(value_type = Option<f64>)]
    true_frame_rate_hz: Option<String>,
    /// The true time from the first frame to the last, s: instead of the frame rate.
    #[param(value_type = Option<f64>)]
    true_duration_s: Option<String>,
}

/// Send a recording in one request
///
/// A recording that was sent before for the same trainee, task and box is refused with `duplicate-recording`, and the
/// problem names its `session`. If the connection breaks, the recording has to be sent again from the beginning: over
/// poor connections use `/uploads`, which resumes.
#[utoipa::path(post, path = "/sessions", tag = "sessions", params(SendQuery),
    request_body(content = Vec<u8>, content_type = "application/octet-stream",
        description = "The video: MP4/MOV, Matroska/WebM, AVI or MPEG-TS"),
    responses((status = CREATED, body = SessionResponse)))]
pub async fn send(
    State(app): State<App>,
    by: Member,
    Params(of): Params<SendQuery>,
    request: Request,
) -> HandlerResult<Created<SessionResponse>> {
    refuse_forms(&request)?;
    let SendQuery { trainee, task, in_box, filename, recorded_at, true_frame_rate_hz, true_duration_s } = of;
    let about =
        RecordingDescription { trainee, task, in_box, filename, recorded_at, true_frame_rate_hz, true_duration_s };
    let recording = app.intake.resolve(&by.scope, about).await?;
    if let Some(length) = content_length(request.headers()) {
        app.intake.check_length(length)?;
    }
    let (intake, scope) = (app.intake.clone(), by.scope);
    let bytes = request.into_body().into_data_stream().map(|bytes| bytes.map_err(Into::into));
    // In a separate task: a sender that closes right after its last byte must not cancel the intake.
    let taken = app.shutdown.spawn(async move { intake.take_whole(&scope, recording, bytes).await });
    let session = taken.await.map_err(|cause| ProblemResponse::internal("receiving a recording", cause))??;
    Ok(Created { location: format!("/api/v1/sessions/{}", session.id), made: SessionResponse::of(session, None) })
}

/// Refuses a multipart form, which would be stored as if it were the video.
pub(in crate::http) fn refuse_forms(request: &Request) -> HandlerResult<()> {
    let kind = request.headers().get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    if !kind.starts_with("multipart/") {
        return Ok(());
    }
    Err(Refusal::UnsupportedMediaType
        .with("Send the video itself as the body: `curl --data-binary @clip.mp4`, not -F."))
}
