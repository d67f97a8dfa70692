//! The state of an upload as response headers.

use axum::http::{HeaderMap, HeaderValue};

use super::headers::{TROCAR_DUPLICATE, TROCAR_SESSION, UPLOAD_EXPIRES, UPLOAD_OFFSET};
use crate::intake::UploadProgress;
use crate::time::to_http_date;

/// The headers with an upload's offset and expiry or, once it is complete, its session.
pub fn progress_headers(received: &UploadProgress) -> HeaderMap {
    let mut headers = HeaderMap::new();
    headers.insert(UPLOAD_OFFSET, HeaderValue::from(received.received));
    match received.finished {
        None => {
            let expires = HeaderValue::try_from(to_http_date(received.expires_at_ms));
            headers.extend(expires.ok().map(|expires| (UPLOAD_EXPIRES, expires)));
        }
        Some(finished) => {
            let session = HeaderValue::try_from(finished.session.to_string());
            headers.extend(session.ok().map(|session| (TROCAR_SESSION, session)));
            if finished.is_duplicate {
                headers.insert(TROCAR_DUPLICATE, HeaderValue::from_static("true"));
            }
        }
    }
    headers
}
