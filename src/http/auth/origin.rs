//! Cross-site request protection: accepts unsafe methods from our own pages and from programs, not from other sites.
//!
//! Browsers send `Origin` and `Sec-Fetch-Site` with every such request; programs send neither. The scheme is not
//! compared: behind a proxy that ends TLS the service does not know it.

use axum::extract::Request;
use axum::http::uri::Authority;
use axum::http::{HeaderMap, Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::http::error::{HandlerResult, Refusal};

/// Middleware: refuses changes that a page of another site requests.
pub async fn check_origin(request: Request, next: Next) -> Response {
    let safe = matches!(*request.method(), Method::GET | Method::HEAD | Method::OPTIONS);
    if safe || is_ours(request.headers()) {
        return next.run(request).await;
    }
    Refusal::ForeignOrigin
        .with("Make changes from the service's own pages, or from a program with a token and without an Origin header.")
        .into_response()
}

/// Refuses a WebSocket that a page of another site opens. The browser would send the visitor's cookie with it, and its
/// method is GET, so [`check_origin`] lets it pass.
pub fn refuse_foreign(headers: &HeaderMap) -> HandlerResult<()> {
    if is_ours(headers) {
        return Ok(());
    }
    Err(Refusal::ForeignOrigin.with("Open the WebSocket from the service's own pages, or from a program with a token."))
}

/// Whether one of the service's pages sends this change, and not a program.
pub fn is_from_page(headers: &HeaderMap) -> bool {
    headers.contains_key(header::ORIGIN) || headers.contains_key("sec-fetch-site")
}

fn is_ours(headers: &HeaderMap) -> bool {
    match headers.get(header::ORIGIN) {
        Some(origin) => origin.to_str().is_ok_and(|origin| same_host(origin, headers)),
        None => headers.get("sec-fetch-site").is_none_or(|site| site == "same-origin" || site == "none"),
    }
}

fn same_host(origin: &str, headers: &HeaderMap) -> bool {
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok());
    let origin = origin.split_once("://").map(|(_, authority)| authority);
    match (origin.map(str::parse::<Authority>), host.map(str::parse::<Authority>)) {
        (Some(Ok(origin)), Some(Ok(host))) => origin == host,
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    fn ours(lines: &[(&'static str, &str)]) -> bool {
        let lines = lines.iter().map(|(name, value)| (name.parse().unwrap(), HeaderValue::from_str(value).unwrap()));
        is_ours(&HeaderMap::from_iter(lines))
    }

    #[test]
    fn our_pages_and_programs_may_change_things() {
        assert!(ours(&[("host", "box.local:8080"), ("origin", "http://box.local:8080")]));
        assert!(ours(&[("host", "box.local"), ("origin", "https://BOX.local")]), "a proxy ends TLS");
        assert!(ours(&[("host", "box.local")]));
        assert!(ours(&[("host", "box.local"), ("sec-fetch-site", "same-origin")]));
    }

    #[test]
    fn other_sites_may_not() {
        for origin in
            ["http://evil.example", "http://box.local:81", "null", "", "http://box.local@evil.example", "x://"]
        {
            assert!(!ours(&[("host", "box.local"), ("origin", origin)]), "{origin}");
        }
        assert!(!ours(&[("origin", "http://box.local")]), "no host at all");
        assert!(!ours(&[("host", "box.local"), ("sec-fetch-site", "cross-site")]));
        assert!(!ours(&[("host", "box.local"), ("sec-fetch-site", "same-site")]));
    }
}
