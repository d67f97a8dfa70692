//! Compresses pages and JSON with gzip, if the client accepts it, for slow connections.
//!
//! Compressing an answer takes about 0.3 MB until the client has read it, and HTTP/2 lets a client leave many answers
//! unread. So what a client without a sign-in may request is a [`FixedText`], which is compressed once, or plain.

use std::borrow::Cow;
use std::io::Write;

use axum::body::{Body, Bytes, HttpBody};
use axum::http::{HeaderMap, HeaderValue, Response, header};
use flate2::Compression;
use flate2::write::GzEncoder;
use tower_http::CompressionLevel;
use tower_http::compression::CompressionLayer;
use tower_http::compression::predicate::Predicate;

/// A smaller answer fits into one or two packets uncompressed.
const MIN_BYTES: u64 = 1024;

/// A larger answer is a download for a program; compressing it would take CPU time from tracking.
pub const MAX_COMPRESSED_BYTES: u64 = 2 << 20;

/// Marks an answer that the middleware leaves as it is.
#[derive(Clone, Copy, Debug)]
pub struct Uncompressed;

/// Middleware: compresses text of a known, moderate size. Pictures and video are compressed already, and events must
/// not wait in a buffer.
pub fn compress() -> CompressionLayer<impl Predicate> {
    CompressionLayer::new().quality(CompressionLevel::Fastest).compress_when(ModerateText)
}

/// A text of the program, the same for all clients, with its compressed form. Clones share the bytes.
#[derive(Clone, Debug)]
pub struct FixedText {
    media_type: HeaderValue,
    plain: Bytes,
    /// `None` if compressing is not worth while.
    gzip: Option<Bytes>,
}

impl FixedText {
    /// Compresses the text, at a higher level than answers that are sent once: an eighth smaller.
    pub fn new(media_type: HeaderValue, plain: Cow<'static, [u8]>) -> Self {
        let plain = match plain {
            Cow::Borrowed(plain) => Bytes::from_static(plain),
            Cow::Owned(plain) => Bytes::from(plain),
        };
        let kind = media_type.to_str().unwrap_or_default();
        let gzip = is_worthwhile(kind, plain.len() as u64).then(|| gzip(&plain)).flatten();
        Self { media_type, plain, gzip }
    }

    /// The text as an answer, in the form that the client accepts.
    pub fn answer(&self, request: &HeaderMap) -> Response<Body> {
        let gzip = self.gzip.as_ref().filter(|_| accepts_gzip(request));
        let mut response = Response::new(Body::from(gzip.unwrap_or(&self.plain).clone()));
        response.extensions_mut().insert(Uncompressed);
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, self.media_type.clone());
        if gzip.is_some() {
            headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
        }
        if self.gzip.is_some() {
            headers.insert(header::VARY, HeaderValue::from_static("accept-encoding"));
        }
        response
    }
}

fn gzip(plain: &[u8]) -> Option<Bytes> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(plain).ok()?; // in memory: never fails
    encoder.finish().ok().map(Bytes::from)
}

/// Whether `Accept-Encoding` lists gzip, unless with the weight 0.
fn accepts_gzip(request: &HeaderMap) -> bool {
    let lists = request.get_all(header::ACCEPT_ENCODING).iter().filter_map(|list| list.to_str().ok());
    lists.flat_map(|list| list.split(',')).any(|entry| {
        let mut parts = entry.split(';').map(str::trim);
        let is_gzip =
            parts.next().is_some_and(|name| ["gzip", "x-gzip"].iter().any(|gzip| name.eq_ignore_ascii_case(gzip)));
        let weight = parts.find_map(|part| part.strip_prefix("q=").or_else(|| part.strip_prefix("Q=")));
        is_gzip && weight.is_none_or(|weight| weight.parse::<f32>().is_ok_and(|weight| weight > 0.0))
    })
}

#[derive(Clone, Copy)]
struct ModerateText;

impl Predicate for ModerateText {
    fn should_compress<B: HttpBody>(&self, response: &Response<B>) -> bool {
        let kind = response.headers().get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
        let bytes = response.body().size_hint().exact();
        let is_marked = response.extensions().get::<Uncompressed>().is_some();
        !is_marked && bytes.is_some_and(|bytes| is_worthwhile(kind, bytes))
    }
}

fn is_worthwhile(media_type: &str, bytes: u64) -> bool {
    is_text(media_type) && (MIN_BYTES..=MAX_COMPRESSED_BYTES).contains(&bytes)
}

/// Whether the media type is text other than an event stream, which is never complete.
fn is_text(media_type: &str) -> bool {
    let kind = media_type.split(';').next().unwrap_or_default().trim();
    (kind.starts_with("text/") && kind != "text/event-stream")
        || ["application/json", "application/javascript", "image/svg+xml"].contains(&kind)
        || (kind.starts_with("application/") && kind.ends_with("+json"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_compressed(kind: &str, bytes: usize) -> bool {
        let response =
            Response::builder().header(header::CONTENT_TYPE, kind).body(Body::from(vec![b'a'; bytes])).unwrap();
        ModerateText.should_compress(&response)
    }

    #[test]
    fn only_text_of_moderate_size_is_compressed() {
        for kind in [
            "text/html; charset=utf-8",
            "text/javascript",
            "text/csv",
            "application/json",
            "application/problem+json",
            "image/svg+xml",
        ] {
            assert!(is_compressed(kind, 4096), "{kind}");
            assert!(!is_compressed(kind, 100) && !is_compressed(kind, 3 << 20), "{kind}");
        }
        for kind in [
            "video/mp4",
            "image/jpeg",
            "text/event-stream",
            "application/octet-stream",
            "application/vnd.apache.parquet",
            "",
        ] {
            assert!(!is_compressed(kind, 4096), "{kind}");
        }
    }

    #[test]
    fn a_fixed_text_is_compressed_for_clients_that_accept_it_and_never_twice() {
        let text = FixedText::new(HeaderValue::from_static("text/html"), vec![b'a'; 4096].into());
        for (accepted, is_gzip) in [
            ("", false),
            ("deflate, br", false),
            ("gzip;q=0", false),
            ("gzip", true),
            ("br, GZIP ; q=0.5", true),
            ("x-gzip", true),
        ] {
            let request = HeaderMap::from_iter([(header::ACCEPT_ENCODING, HeaderValue::from_static(accepted))]);
            let response = text.answer(&request);
            assert_eq!(response.headers().contains_key(header::CONTENT_ENCODING), is_gzip, "{accepted}");
            assert_eq!(response.body().size_hint().exact().is_some_and(|bytes| bytes < 4096), is_gzip, "{accepted}");
            assert!(!ModerateText.should_compress(&response), "{accepted}");
        }
    }

    #[test]
    fn a_body_of_unknown_length_is_not_compressed() {
        let stream = Body::from_stream(futures_util::stream::once(async { Ok::<_, std::io::Error>("text") }));
        let response = Response::builder().header(header::CONTENT_TYPE, "text/csv").body(stream).unwrap();
        assert!(!ModerateText.should_compress(&response));
    }
}
