//! Compresses pages and JSON with gzip, if the client accepts it, for slow connections.

use axum::body::HttpBody;
use axum::http::{Response, header};
use tower_http::CompressionLevel;
use tower_http::compression::CompressionLayer;
use tower_http::compression::predicate::Predicate;

/// A smaller answer fits into one or two packets uncompressed.
const MIN_BYTES: u64 = 1024;

/// A larger answer is a download for a program; compressing it would take CPU time from tracking.
pub const MAX_COMPRESSED_BYTES: u64 = 2 << 20;

/// Middleware: compresses text of a known, moderate size. Pictures and video are compressed already, and events must
/// not wait in a buffer.
pub fn compress() -> CompressionLayer<impl Predicate> {
    compression_layer(CompressionLevel::Fastest)
}

/// The same at a higher level, for files that browsers cache: an eighth smaller, for a few milliseconds once per
/// browser and version.
pub fn compress_static_files() -> CompressionLayer<impl Predicate> {
    compression_layer(CompressionLevel::Default)
}

fn compression_layer(level: CompressionLevel) -> CompressionLayer<impl Predicate> {
    CompressionLayer::new().quality(level).compress_when(ModerateText)
}

#[derive(Clone, Copy)]
struct ModerateText;

impl Predicate for ModerateText {
    fn should_compress<B: HttpBody>(&self, response: &Response<B>) -> bool {
        let kind = response.headers().get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
        let bytes = response.body().size_hint().exact();
        is_text(kind) && bytes.is_some_and(|bytes| (MIN_BYTES..=MAX_COMPRESSED_BYTES).contains(&bytes))
    }
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
    use axum::body::Body;

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
    fn a_body_of_unknown_length_is_not_compressed() {
        let stream = Body::from_stream(futures_util::stream::once(async { Ok::<_, std::io::Error>("text") }));
        let response = Response::builder().header(header::CONTENT_TYPE, "text/csv").body(stream).unwrap();
        assert!(!ModerateText.should_compress(&response));
    }
}
