//! Sends a stored file: the whole file, a range, or only its headers; in chunks of bounded size.

use std::io::SeekFrom;

use axum::body::Body;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse, Response};
use tokio::fs::File;
use tokio::io::{AsyncReadExt, AsyncSeekExt};
use tokio_util::io::ReaderStream;

use super::error::{HandlerResult, ProblemResponse, Refusal};
use super::range::{RequestedRange, requested_range};

/// Bytes read from the disk at once, and so the memory that one slow download needs.
const CHUNK_BYTES: usize = 128 * 1024;

/// A file that never changes, and the headers that describe it.
pub struct StoredFile {
    /// Open for reading.
    pub file: File,
    /// Its length, bytes.
    pub length: u64,
    /// Its ETag: the content's hash in quotes.
    pub etag: String,
    /// Its media type.
    pub media_type: String,
    /// `Content-Disposition`.
    pub disposition: String,
}

impl StoredFile {
    /// Answers a GET or HEAD.
    pub async fn answer(mut self, method: &Method, headers: &HeaderMap) -> HandlerResult<Response> {
        if self.is_cached(headers) {
            return Ok(self.with_headers(StatusCode::NOT_MODIFIED.into_response()));
        }
        let (status, first, count) = match requested_range(headers, self.length, &self.etag) {
            RequestedRange::Whole => (StatusCode::OK, 0, self.length),
            RequestedRange::Part { first, last } => (StatusCode::PARTIAL_CONTENT, first, last - first + 1),
            RequestedRange::Outside => return Err(self.range_problem()),
        };
        let body = if *method == Method::HEAD { Body::empty() } else { self.part(first, count).await? };
        let mut response = self.with_headers((status, body).into_response());
        set_header(&mut response, header::CONTENT_LENGTH, &count.to_string());
        if status == StatusCode::PARTIAL_CONTENT {
            let range = format!("bytes {first}-{}/{}", first + count - 1, self.length);
            set_header(&mut response, header::CONTENT_RANGE, &range);
        }
        Ok(response)
    }

    async fn part(&mut self, first: u64, count: u64) -> HandlerResult<Body> {
        let unreadable = |cause| ProblemResponse::internal("reading a stored file", cause);
        self.file.seek(SeekFrom::Start(first)).await.map_err(unreadable)?;
        let file = self.file.try_clone().await.map_err(unreadable)?;
        Ok(Body::from_stream(ReaderStream::with_capacity(file.take(count), CHUNK_BYTES)))
    }

    fn is_cached(&self, headers: &HeaderMap) -> bool {
        let known = headers.get(header::IF_NONE_MATCH).and_then(|value| value.to_str().ok());
        known.is_some_and(|known| known.split(',').any(|tag| tag.trim().trim_start_matches("W/") == self.etag))
    }

    fn range_problem(&self) -> ProblemResponse {
        Refusal::RangeNotSatisfiable
            .with(format!("The file has {} bytes. Request a range inside the file.", self.length))
            .header(header::CONTENT_RANGE, format!("bytes */{}", self.length))
    }

    fn with_headers(&self, mut response: Response) -> Response {
        set_header(&mut response, header::CONTENT_TYPE, &self.media_type);
        set_header(&mut response, header::CONTENT_DISPOSITION, &self.disposition);
        set_header(&mut response, header::ETAG, &self.etag);
        set_header(&mut response, header::ACCEPT_RANGES, "bytes");
        // The file never changes, but the right to see it may end: the browser asks each time and gets a 304.
        set_header(&mut response, header::CACHE_CONTROL, "private, no-cache");
        response
    }
}

fn set_header(response: &mut Response, name: HeaderName, value: &str) {
    if let Ok(value) = HeaderValue::from_str(value) {
        response.headers_mut().insert(name, value);
    }
}

/// `Content-Disposition` for an untrusted file name (RFC 6266): a plain form with safe characters only, and the exact
/// name percent-encoded.
pub fn disposition(kind: &str, filename: &str) -> String {
    let harmless = |c: char| if c.is_ascii_alphanumeric() || " ._-()".contains(c) { c } else { '_' };
    let plain: String = filename.chars().map(harmless).collect();
    format!("{kind}; filename=\"{plain}\"; filename*=UTF-8''{}", percent_encoded(filename))
}

/// All but letters, digits and some marks as `%XX`.
pub fn percent_encoded(text: &str) -> String {
    let encoded = |byte: u8| match byte {
        b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'.' | b'_' | b'-' => char::from(byte).to_string(),
        _ => format!("%{byte:02X}"),
    };
    text.bytes().map(encoded).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_hostile_name_stays_inside_its_quotes() {
        let text = disposition("attachment", "a\"; filename=evil.html\r\nX: y/../ä.mp4");
        assert_eq!(
            text,
            "attachment; filename=\"a__ filename_evil.html__X_ y_..__.mp4\"; \
             filename*=UTF-8''a%22%3B%20filename%3Devil.html%0D%0AX%3A%20y%2F..%2F%C3%A4.mp4"
        );
    }

    proptest! {
        #[test]
        fn any_name_gives_a_header(name in "\\PC{0,300}|.{0,300}") {
            prop_assert!(HeaderValue::from_str(&disposition("inline", &name)).is_ok());
        }
    }
}
