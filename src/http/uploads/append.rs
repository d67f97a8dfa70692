//! Continue an upload, read its offset, or delete it.

use axum::extract::{Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt;

use super::headers::{UPLOAD_LENGTH, UPLOAD_METADATA, UPLOAD_OFFSET, checksum, expect_piece, header_number};
use super::progress_headers;
use crate::domain::scope::Scope;
use crate::http::auth::signed_in::Member;
use crate::http::error::{HandlerResult, ProblemResponse};
use crate::http::read::{PathKey, content_length};
use crate::http::state::App;
use crate::ids::UploadId;
use crate::intake::tus::Checksum;
use crate::intake::{Piece, UploadProgress};

/// Read an upload's offset
#[utoipa::path(head, path = "/uploads/{id}", tag = "uploads",
    params(("id" = String, Path, description = "id"), ("Tus-Resumable" = String, Header, description = "`1.0.0`")),
    responses((status = OK,
            description = "`Upload-Offset`, `Upload-Length`; once the upload is complete, `Trocar-Session`, and \
                           `Trocar-Duplicate: true` if that session existed before this upload")))]
pub async fn progress(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<Response> {
    let id = at.id()?;
    let received = app.intake.resume(&by.scope, id).await?;
    let upload = app.intake.upload(&by.scope, id).await?;
    let mut headers = progress_headers::progress_headers(&received);
    headers.insert(UPLOAD_LENGTH, HeaderValue::from(upload.length));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.extend(HeaderValue::try_from(upload.metadata).ok().map(|metadata| (UPLOAD_METADATA, metadata)));
    Ok((StatusCode::OK, headers).into_response())
}

/// Send the next piece
///
/// `Upload-Offset` of the answer counts only bytes that are stored on disk. If the connection breaks, the bytes that
/// arrived are stored; read the offset and continue from there.
#[utoipa::path(patch, path = "/uploads/{id}", tag = "uploads",
    params(("id" = String, Path, description = "id"), ("Tus-Resumable" = String, Header, description = "`1.0.0`"),
        ("Upload-Offset" = u64, Header, description = "Offset of the piece, bytes"),
        ("Upload-Checksum" = Option<String>, Header, description = "`sha1 BASE64` or `sha256 BASE64` of the piece")),
    request_body(content = Vec<u8>, content_type = "application/offset+octet-stream"),
    responses((status = NO_CONTENT,
            description = "`Upload-Offset`; once the upload is complete, `Trocar-Session`, and `Trocar-Duplicate: \
                           true` if that session existed before")))]
pub async fn append(State(app): State<App>, by: Member, at: PathKey, request: Request) -> HandlerResult<Response> {
    expect_piece(request.headers())?;
    let (offset, sum) = (header_number(request.headers(), &UPLOAD_OFFSET)?, checksum(request.headers())?);
    let received = receive(&app, by.scope, at.id()?, offset, sum, request).await?;
    Ok((StatusCode::NO_CONTENT, progress_headers::progress_headers(&received)).into_response())
}

/// Delete an unfinished upload and its bytes
#[utoipa::path(delete, path = "/uploads/{id}", tag = "uploads",
    params(("id" = String, Path, description = "id"), ("Tus-Resumable" = String, Header, description = "`1.0.0`")),
    responses((status = NO_CONTENT)))]
pub async fn terminate(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<StatusCode> {
    app.intake.terminate(&by.scope, at.id()?).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Receives a request's body in a separate task. hyper drops the handler when the connection closes, but the bytes that
/// arrived must still be made durable.
pub(super) async fn receive(
    app: &App,
    scope: Scope,
    id: UploadId,
    offset: u64,
    checksum: Option<Checksum>,
    request: Request,
) -> HandlerResult<UploadProgress> {
    let length = content_length(request.headers());
    let bytes = request.into_body().into_data_stream().map(|bytes| bytes.map_err(Into::into));
    let piece = Piece { offset, length, checksum, bytes };
    let intake = app.intake.clone();
    let taken = app.shutdown.spawn(async move { intake.append(&scope, id, piece).await });
    Ok(taken.await.map_err(|cause| ProblemResponse::internal("receiving a piece", cause))??)
}
