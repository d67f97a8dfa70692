//! The path that the service lies under, such as `/trocar` for `https://host.example/trocar/`.
//!
//! A proxy passes the path on unchanged. The accept loop removes it before a request reaches the routes, so that they
//! are the same under every path. Answers get it back: handlers state addresses from the root of the service, and
//! [`complete_addresses`] puts the path before them. Rejected: a proxy that removes the path. The service would not know
//! it, and could state no address that works in a browser.

use std::fmt;
use std::str::FromStr;

use axum::body::{Body, Bytes, to_bytes};
use axum::extract::{Request, State};
use axum::http::uri::PathAndQuery;
use axum::http::{HeaderValue, Uri, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Redirect, Response};
use serde::{Deserialize, Deserializer};
use serde_json::Value;

use super::error::{PROBLEM_JSON, ProblemResponse};
use super::protect::set_security_headers;

/// Addresses for probes on the service's own machine. They are answered without the path, too.
const PROBES: [&str; 3] = ["/healthz", "/readyz", "/metrics"];

/// Longest problem document, bytes. One of the service is far shorter.
const MAX_PROBLEM_BYTES: usize = 1 << 20;

/// The path, without a final slash; empty if the service has the host for itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BasePath(String);

/// The text is no path that the service can lie under.
#[derive(Debug, thiserror::Error)]
#[error("`{0}` is not a path; expected one such as /trocar, of letters, digits and - . _ ~")]
pub struct InvalidBasePath(String);

impl FromStr for BasePath {
    type Err = InvalidBasePath;

    fn from_str(text: &str) -> Result<Self, InvalidBasePath> {
        let path = text.strip_suffix('/').unwrap_or(text);
        let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '.' | '_' | '~');
        let is_name = |name: &str| !matches!(name, "" | "." | "..") && name.chars().all(plain);
        match path.strip_prefix('/') {
            None if path.is_empty() => Ok(Self::default()),
            Some(names) if names.split('/').all(is_name) => Ok(Self(path.to_owned())),
            _ => Err(InvalidBasePath(text.to_owned())),
        }
    }
}

impl<'de> Deserialize<'de> for BasePath {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        String::deserialize(from)?.parse().map_err(serde::de::Error::custom)
    }
}

impl fmt::Display for BasePath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl BasePath {
    /// Whether the service has the host for itself.
    pub fn is_root(&self) -> bool {
        self.0.is_empty()
    }

    /// Removes the path from a request's address.
    ///
    /// # Errors
    /// The answer to a request outside the path.
    pub fn enter(&self, mut request: Request) -> Result<Request, Box<Response>> {
        if self.is_root() || PROBES.contains(&request.uri().path()) {
            return Ok(request);
        }
        match self.inside(request.uri()) {
            Some(uri) => {
                *request.uri_mut() = uri;
                Ok(request)
            }
            None => Err(Box::new(self.answer_outside(request.uri().path()))),
        }
    }

    /// The same address without the path; `None` if it lies outside.
    fn inside(&self, uri: &Uri) -> Option<Uri> {
        let rest = uri.path().strip_prefix(&self.0)?;
        if !(rest.is_empty() || rest.starts_with('/')) {
            return None;
        }
        let path = if rest.is_empty() { "/" } else { rest };
        let query = uri.query().map(|query| format!("?{query}")).unwrap_or_default();
        let mut parts = uri.clone().into_parts();
        parts.path_and_query = Some(PathAndQuery::try_from(format!("{path}{query}")).ok()?);
        Uri::from_parts(parts).ok()
    }

    /// The root of the host leads to the service, for a person who opens it without the proxy.
    fn answer_outside(&self, path: &str) -> Response {
        let mut response = match path {
            "/" => Redirect::temporary(&format!("{self}/")).into_response(),
            _ => ProblemResponse::not_found().into_response(),
        };
        set_security_headers(&mut response);
        response
    }

    /// Puts the path before an address from the root of the service. Other addresses stay.
    fn complete(&self, address: &str) -> String {
        match address.starts_with('/') && !address.starts_with("//") {
            true => format!("{self}{address}"),
            false => address.to_owned(),
        }
    }

    /// The same in a `Link` header, which has the address between `<` and `>`.
    fn complete_link(&self, link: &str) -> String {
        link.strip_prefix('<').map_or_else(|| link.to_owned(), |address| format!("<{}", self.complete(address)))
    }

    /// The same for the session that a problem document names.
    fn complete_problem(&self, document: &Bytes) -> Option<Vec<u8>> {
        let mut document: Value = serde_json::from_slice(document).ok()?;
        let session = document.get_mut("session")?;
        *session = self.complete(session.as_str()?).into();
        serde_json::to_vec(&document).ok()
    }
}

/// Middleware: puts the path before each address in the head of an answer, and before the session of a problem.
pub async fn complete_addresses(State(base): State<BasePath>, request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    if base.is_root() {
        return response;
    }
    for (name, complete) in [
        (header::LOCATION, BasePath::complete as fn(&BasePath, &str) -> String),
        (header::LINK, BasePath::complete_link),
    ] {
        let address = response.headers().get(&name).and_then(|value| value.to_str().ok());
        if let Some(value) = address.and_then(|address| HeaderValue::try_from(complete(&base, address)).ok()) {
            response.headers_mut().insert(name, value);
        }
    }
    if response.headers().get(header::CONTENT_TYPE).is_some_and(|kind| kind == PROBLEM_JSON) {
        return complete_problem(&base, response).await;
    }
    response
}

async fn complete_problem(base: &BasePath, response: Response) -> Response {
    let (mut head, body) = response.into_parts();
    let document = to_bytes(body, MAX_PROBLEM_BYTES).await.unwrap_or_default(); // in memory already: never fails
    let Some(completed) = base.complete_problem(&document) else {
        return Response::from_parts(head, Body::from(document));
    };
    head.headers.remove(header::CONTENT_LENGTH);
    Response::from_parts(head, Body::from(completed))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_has_one_spelling() {
        for text in ["/trocar", "/trocar/"] {
            assert_eq!(text.parse::<BasePath>().unwrap().to_string(), "/trocar");
        }
        for text in ["", "/"] {
            assert!(text.parse::<BasePath>().unwrap().is_root());
        }
        assert_eq!("/a/b".parse::<BasePath>().unwrap().to_string(), "/a/b");
        for text in ["trocar", "//", "/a//b", "/a/../b", "/.", "/a b", "/a?b", "/<a>", "https://a.example/trocar"] {
            assert!(text.parse::<BasePath>().is_err(), "{text}");
        }
    }

    #[test]
    fn only_addresses_below_the_path_are_inside() {
        let base: BasePath = "/trocar".parse().unwrap();
        let inside = |address: &str| base.inside(&address.parse().unwrap()).map(|uri| uri.to_string());
        for (address, wanted) in [
            ("/trocar", Some("/")),
            ("/trocar?a=b", Some("/?a=b")),
            ("/trocar/", Some("/")),
            ("/trocar/api/v1/me?x=%2F", Some("/api/v1/me?x=%2F")),
            ("/trocar/trocar", Some("/trocar")),
            ("/trocars", None),
            ("/api/v1/me", None),
            ("/", None),
        ] {
            assert_eq!(inside(address).as_deref(), wanted, "{address}");
        }
    }

    #[test]
    fn addresses_of_other_hosts_stay() {
        let base: BasePath = "/trocar".parse().unwrap();
        assert_eq!(base.complete("/docs/"), "/trocar/docs/");
        assert_eq!(base.complete_link("</api/v1/x>; rel=\"y\""), "</trocar/api/v1/x>; rel=\"y\"");
        for other in ["https://a.example/b", "//a.example/b", "b"] {
            assert_eq!(base.complete(other), other);
        }
    }
}
