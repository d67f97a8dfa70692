//! Security headers of every answer: no inline code, no framing by other sites, no guessed media types, and the camera
//! for our own pages only.

use axum::extract::Request;
use axum::http::{HeaderName, HeaderValue, header};
use axum::middleware::Next;
use axum::response::Response;

/// What a page may load: files of this service; nothing inline, nothing from other sites. Pictures from `blob:` and
/// `data:` are frames and icons that our own scripts draw; they cannot contain running code.
pub const CONTENT_SECURITY_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; \
    img-src 'self' data: blob:; media-src 'self' blob:; font-src 'self'; connect-src 'self'; manifest-src 'self'; \
    worker-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'";

/// Device features that pages may use: our own pages may use the camera to record and keep the screen awake meanwhile.
/// Features that they never need are disabled for all pages.
const PERMISSIONS_POLICY: &str = "camera=(self), screen-wake-lock=(self), microphone=(), geolocation=(), \
    display-capture=(), usb=(), serial=(), payment=()";

const HEADERS: [(HeaderName, &str); 7] = [
    (header::CONTENT_SECURITY_POLICY, CONTENT_SECURITY_POLICY),
    (HeaderName::from_static("permissions-policy"), PERMISSIONS_POLICY),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::X_FRAME_OPTIONS, "DENY"),
    (header::REFERRER_POLICY, "same-origin"),
    (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];

/// Middleware: sets the security headers, and forbids caching of answers that set no `Cache-Control`.
pub async fn protect(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    set_security_headers(&mut response);
    response
}

/// Sets the headers that an answer does not have yet.
pub fn set_security_headers(response: &mut Response) {
    for (name, value) in HEADERS {
        response.headers_mut().entry(name).or_insert(HeaderValue::from_static(value));
    }
    response.headers_mut().entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("private, no-store"));
}
