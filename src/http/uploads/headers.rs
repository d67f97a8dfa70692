//! The headers of the tus protocol in requests and answers.

use std::str::FromStr;

use axum::extract::Request;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::http::error::{HandlerResult, ProblemResponse, Refusal};
use crate::intake::tus::{Checksum, HeaderProblem, VERSION};

/// The protocol's version, in every request and answer.
pub const TUS_RESUMABLE: HeaderName = HeaderName::from_static("tus-resumable");
/// Protocol versions that the service supports.
pub const TUS_VERSION: HeaderName = HeaderName::from_static("tus-version");
/// Number of bytes received so far.
pub const UPLOAD_OFFSET: HeaderName = HeaderName::from_static("upload-offset");
/// Total number of bytes.
pub const UPLOAD_LENGTH: HeaderName = HeaderName::from_static("upload-length");
/// The sender's metadata on the recording.
pub const UPLOAD_METADATA: HeaderName = HeaderName::from_static("upload-metadata");
/// Checksum of the bytes in the request.
pub const UPLOAD_CHECKSUM: HeaderName = HeaderName::from_static("upload-checksum");
/// When the upload is deleted unless it continues.
pub const UPLOAD_EXPIRES: HeaderName = HeaderName::from_static("upload-expires");
/// The session that the upload became.
pub const TROCAR_SESSION: HeaderName = HeaderName::from_static("trocar-session");
/// `true` if that session existed before.
pub const TROCAR_DUPLICATE: HeaderName = HeaderName::from_static("trocar-duplicate");

/// Media type of a piece.
const PIECE: &str = "application/offset+octet-stream";

/// Middleware: refuses other versions of the protocol, and adds the supported version to every answer.
pub async fn check_tus_version(request: Request, next: Next) -> Response {
    let version = request.headers().get(&TUS_RESUMABLE);
    let understood = request.method() == Method::OPTIONS || version.is_some_and(|version| version == VERSION);
    let mut response = if understood { next.run(request).await } else { other_version().into_response() };
    response.headers_mut().insert(TUS_RESUMABLE, HeaderValue::from_static(VERSION));
    response
}

fn other_version() -> ProblemResponse {
    Refusal::PreconditionFailed
        .with(format!("Send `Tus-Resumable: {VERSION}`; other versions of tus are not supported."))
        .header(TUS_VERSION, VERSION)
}

/// A header's text.
pub fn header_text(headers: &HeaderMap, name: &HeaderName) -> HandlerResult<Option<String>> {
    let Some(value) = headers.get(name) else { return Ok(None) };
    let text = value
        .to_str()
        .map_err(|_| header_problem(name, format!("`{name}` may contain only visible ASCII characters.")))?;
    Ok(Some(text.to_owned()))
}

/// The number in a required header.
pub fn header_number(headers: &HeaderMap, name: &HeaderName) -> HandlerResult<u64> {
    let value = header_text(headers, name)?.filter(|text| !text.starts_with('+'));
    let number = value.as_deref().map(u64::from_str);
    match number {
        Some(Ok(number)) => Ok(number),
        _ => Err(header_problem(name, format!("`{name}` must be a number of bytes, 0 or more."))),
    }
}

/// The problem for a header that cannot be used.
pub fn header_problem(name: &HeaderName, detail: impl Into<String>) -> ProblemResponse {
    Refusal::BadRequest.with(detail).of_field(name.as_str())
}

/// Whether the body is a piece of a recording.
pub fn is_piece(headers: &HeaderMap) -> bool {
    headers.get(header::CONTENT_TYPE).is_some_and(|kind| kind == PIECE)
}

/// Refuses a body that is not a piece.
pub fn expect_piece(headers: &HeaderMap) -> HandlerResult<()> {
    if is_piece(headers) {
        return Ok(());
    }
    Err(Refusal::UnsupportedMediaType.with(format!("Send the bytes with `Content-Type: {PIECE}`.")))
}

/// The body's checksum, if the request states one.
pub fn checksum(headers: &HeaderMap) -> HandlerResult<Option<Checksum>> {
    let value = header_text(headers, &UPLOAD_CHECKSUM)?;
    Ok(value.as_deref().map(Checksum::parse).transpose()?)
}

impl From<HeaderProblem> for ProblemResponse {
    fn from(problem: HeaderProblem) -> Self {
        let name = match problem {
            HeaderProblem::Metadata(_) => &UPLOAD_METADATA,
            HeaderProblem::Checksum => &UPLOAD_CHECKSUM,
        };
        header_problem(name, format!("{problem}."))
    }
}
