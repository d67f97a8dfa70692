//! Redirects plain HTTP to HTTPS.

use axum::Router;
use axum::extract::Request;
use axum::http::uri::Authority;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};

/// The port of `https://` addresses without a port.
const HTTPS_PORT: u16 = 443;

/// Routes that redirect every request to the same path over HTTPS, on `port`. `None` keeps the port of the request, for
/// a client that speaks plain HTTP to the port of HTTPS.
pub fn routes(port: Option<u16>) -> Router {
    Router::new().fallback(async move |request: Request| {
        let path = request.uri().path_and_query().map_or("/", |path| path.as_str());
        match https_address(request.headers(), port, path) {
            // Keeps the method: a sign-in that arrives here must not become a GET.
            Some(address) => (StatusCode::PERMANENT_REDIRECT, [(header::LOCATION, address)]).into_response(),
            None => without_host(),
        }
    })
}

fn without_host() -> Response {
    (StatusCode::BAD_REQUEST, "This service is reached over https. The request names no host to redirect to.\n")
        .into_response()
}

fn https_address(headers: &HeaderMap, port: Option<u16>, path: &str) -> Option<String> {
    let host: Authority = headers.get(header::HOST)?.to_str().ok()?.parse().ok()?;
    let authority = match port {
        None => host.as_str().to_owned(),
        Some(HTTPS_PORT) => host.host().to_owned(),
        Some(port) => format!("{}:{port}", host.host()),
    };
    Some(format!("https://{authority}{path}"))
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    #[test]
    fn the_host_stays_and_the_port_becomes_that_of_https() {
        for (host, port, expected) in [
            ("skills.example", Some(443), "https://skills.example/a?b=c"),
            ("skills.example:8080", Some(8443), "https://skills.example:8443/a?b=c"),
            ("[2001:db8::1]:80", Some(443), "https://[2001:db8::1]/a?b=c"),
            ("skills.example:8443", None, "https://skills.example:8443/a?b=c"),
        ] {
            let headers = HeaderMap::from_iter([(header::HOST, HeaderValue::from_static(host))]);
            assert_eq!(https_address(&headers, port, "/a?b=c").as_deref(), Some(expected), "{host}");
        }
        assert_eq!(https_address(&HeaderMap::new(), Some(443), "/"), None);
    }
}
