//! Describe the supported tus protocol, and begin an upload.

use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::append::receive;
use super::headers::{
    TUS_VERSION, UPLOAD_LENGTH, UPLOAD_METADATA, checksum, header_number, header_problem, header_text, is_piece,
};
use super::progress_headers;
use crate::http::auth::signed_in::Member;
use crate::http::error::HandlerResult;
use crate::http::state::App;
use crate::intake::tus::{CHECKSUMS, EXTENSIONS, Metadata, VERSION};
use crate::intake::{RecordingDescription, UploadProgress};

/// Read the supported version and extensions of tus
#[utoipa::path(options, path = "/uploads", tag = "uploads",
    responses((status = NO_CONTENT,
            description = "`Tus-Version`, `Tus-Extension`, `Tus-Max-Size`, `Tus-Checksum-Algorithm`")))]
pub async fn describe(State(app): State<App>, _by: Member) -> Response {
    let headers = [
        (TUS_VERSION, HeaderValue::from_static(VERSION)),
        (HeaderName::from_static("tus-extension"), HeaderValue::from_static(EXTENSIONS)),
        (HeaderName::from_static("tus-checksum-algorithm"), HeaderValue::from_static(CHECKSUMS)),
        (HeaderName::from_static("tus-max-size"), HeaderValue::from(app.intake.max_bytes())),
    ];
    (StatusCode::NO_CONTENT, HeaderMap::from_iter(headers)).into_response()
}

/// Begin an upload, or send a short recording in one request
///
/// `Upload-Metadata` contains `trainee`, `task` and `box` by id or code (a trainee may leave `trainee` out), and
/// optionally `filename`, `recorded_at` (RFC 3339), and where the file's time stamps are wrong `true_frame_rate_hz` or
/// `true_duration_s` (decimal numbers). A body of `application/offset+octet-stream` is the first piece.
#[utoipa::path(post, path = "/uploads", tag = "uploads",
    params(("Tus-Resumable" = String, Header, description = "`1.0.0`"),
        ("Upload-Length" = u64, Header, description = "Total number of bytes"),
        ("Upload-Metadata" = String, Header, description = "`key base64, …`")),
    request_body(content = Vec<u8>, content_type = "application/offset+octet-stream",
        description = "The first piece, or an empty body"),
    responses((status = CREATED,
            description = "`Location`: address of the upload; `Upload-Offset`, `Upload-Expires`")))]
pub async fn create(State(app): State<App>, by: Member, request: Request) -> HandlerResult<Response> {
    let headers = request.headers();
    let metadata = header_text(headers, &UPLOAD_METADATA)?.unwrap_or_default();
    let about = Metadata::parse(&metadata)?;
    let (length, sum, has_piece) = (upload_length(headers)?, checksum(headers)?, is_piece(headers));
    let recording = app.intake.resolve(&by.scope, RecordingDescription::from(about)).await?;
    let upload = app.intake.begin(&by.scope, recording, metadata, length).await?;
    let mut received = UploadProgress { received: 0, expires_at_ms: upload.expires_at_ms, finished: None };
    if has_piece {
        received = receive(&app, by.scope, upload.id, 0, sum, request).await?;
    }
    let location = [(header::LOCATION, format!("/api/v1/uploads/{}", upload.id))];
    Ok((StatusCode::CREATED, progress_headers::progress_headers(&received), location).into_response())
}

fn upload_length(headers: &HeaderMap) -> HandlerResult<u64> {
    if headers.contains_key("upload-defer-length") {
        let detail = "Send `Upload-Length` now: deferred lengths are not supported.";
        return Err(header_problem(&UPLOAD_LENGTH, detail));
    }
    header_number(headers, &UPLOAD_LENGTH)
}

impl From<Metadata> for RecordingDescription {
    fn from(metadata: Metadata) -> Self {
        let Metadata { filename, trainee, task, box_, recorded_at, true_frame_rate_hz, true_duration_s } = metadata;
        Self { trainee, task, in_box: box_, filename, recorded_at, true_frame_rate_hz, true_duration_s }
    }
}
