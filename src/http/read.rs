//! Extractors for requests: JSON body, query and path, with refusals that say what to do.

use std::error::Error;
use std::str::FromStr;

use axum::extract::{FromRequest, FromRequestParts, Path, Query, Request};
use axum::http::request::Parts;
use axum::http::{HeaderMap, header};
use http_body_util::{BodyExt, LengthLimitError, Limited};
use serde::de::DeserializeOwned;
use serde_json::error::Category;

use super::error::{ProblemResponse, Refusal, unknown_reference};
use super::pace::TooSlow;
use super::state::App;
use crate::domain::text::{Invalid, Key};
use crate::store::StoreError;

/// A JSON body, at most [`super::settings::HttpSettings::max_json_bytes`] long.
pub struct Json<T>(pub T);

impl<T: DeserializeOwned> FromRequest<App> for Json<T> {
    type Rejection = ProblemResponse;

    async fn from_request(request: Request, app: &App) -> Result<Self, ProblemResponse> {
        read_json(request, app.settings.max_json_bytes).await.map(Self)
    }
}

/// Largest JSON body of a request without a sign-in, bytes: logins, passwords and secrets, whose longest are 256 bytes.
const MAX_ANONYMOUS_BYTES: usize = 4096;

/// A JSON body of a request that needs no sign-in. It is short, since a stranger could send many at once.
pub struct AnonymousJson<T>(pub T);

impl<T: DeserializeOwned> FromRequest<App> for AnonymousJson<T> {
    type Rejection = ProblemResponse;

    async fn from_request(request: Request, app: &App) -> Result<Self, ProblemResponse> {
        read_json(request, app.settings.max_json_bytes.min(MAX_ANONYMOUS_BYTES)).await.map(Self)
    }
}

async fn read_json<T: DeserializeOwned>(request: Request, limit: usize) -> Result<T, ProblemResponse> {
    expect_json(request.headers())?;
    let body = Limited::new(request.into_body(), limit).collect().await;
    let bytes = body.map_err(|cause| unreadable_body(&*cause, limit as u64))?.to_bytes();
    parse_json(&bytes)
}

fn parse_json<T: DeserializeOwned>(text: &[u8]) -> Result<T, ProblemResponse> {
    let mut parser = serde_json::Deserializer::from_slice(text);
    let value = serde_path_to_error::deserialize(&mut parser).map_err(|error| {
        let field = error.path().to_string();
        json_problem(error.into_inner(), &field)
    })?;
    parser.end().map_err(|error| json_problem(error, BODY))?;
    Ok(value)
}

fn expect_json(headers: &HeaderMap) -> Result<(), ProblemResponse> {
    let sent = headers.get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok()).unwrap_or_default();
    let essence = sent.split(';').next().unwrap_or_default().trim();
    if essence.eq_ignore_ascii_case("application/json") {
        return Ok(());
    }
    Err(Refusal::UnsupportedMediaType.with("Send JSON with `Content-Type: application/json`."))
}

/// The field at fault if it is the whole body, or if the body lacks a field or has an unknown one.
const BODY: &str = "body";

/// `field` is the path to the value, such as `steps[0].task`; `.` and `?` are paths without a name.
fn json_problem(error: serde_json::Error, field: &str) -> ProblemResponse {
    match error.classify() {
        Category::Data => {
            let place = format!(" at line {} column {}", error.line(), error.column());
            let text = error.to_string();
            let reason = text.strip_suffix(&place).unwrap_or(&text);
            match field.contains(char::is_alphanumeric) {
                true => Refusal::Invalid.with(format!("{reason}.")).of_field(field),
                false => {
                    let problem = Refusal::Invalid.with(format!("The body does not fit this request: {reason}."));
                    problem.of_field(BODY).member("documentation", "/docs")
                }
            }
        }
        Category::Io | Category::Syntax | Category::Eof => {
            Refusal::BadRequest.with(format!("The body is not JSON: {error}.")).of_field(BODY)
        }
    }
}

/// The problem for a body that could not be read to its end.
pub fn unreadable_body(cause: &(dyn Error + 'static), limit: u64) -> ProblemResponse {
    if find_cause::<LengthLimitError>(cause).is_some() {
        return too_large(limit);
    }
    match find_cause::<TooSlow>(cause) {
        Some(slow) => Refusal::TooSlow.with(format!("{slow}. Try again over a better connection.")),
        None => Refusal::BadRequest.with("The connection ended before the whole body arrived. Send it again."),
    }
}

/// The first error of type `T` among an error and its causes.
pub fn find_cause<'e, T: Error + 'static>(error: &'e (dyn Error + 'static)) -> Option<&'e T> {
    error.downcast_ref().or_else(|| find_cause(error.source()?))
}

/// The problem for a body that is longer than `limit` bytes.
pub fn too_large(limit: u64) -> ProblemResponse {
    Refusal::TooLarge.with(format!("Send at most {limit} bytes here.")).member("limit_bytes", limit)
}

impl From<Invalid> for ProblemResponse {
    fn from(invalid: Invalid) -> Self {
        ProblemResponse::invalid(invalid.what, invalid.why)
    }
}

/// The query's parameters.
pub struct Params<T>(pub T);

impl<T: DeserializeOwned + Send> FromRequestParts<App> for Params<T> {
    type Rejection = ProblemResponse;

    async fn from_request_parts(parts: &mut Parts, _app: &App) -> Result<Self, ProblemResponse> {
        let query = Query::try_from_uri(&parts.uri);
        let refused = |error: axum::extract::rejection::QueryRejection| {
            let problem = Refusal::BadRequest.with(format!("{}.", error.body_text())).of_field("query");
            problem.member("documentation", "/docs")
        };
        query.map(|Query(params)| Self(params)).map_err(refused)
    }
}

/// The `{id}` of an address: an id or a code. Text that is neither gives 404.
pub struct PathKey(pub Key);

impl PathKey {
    /// The id of a resource without a code.
    pub fn id<T: FromStr>(&self) -> Result<T, ProblemResponse> {
        self.0.as_str().parse().map_err(|_| ProblemResponse::not_found())
    }
}

impl FromRequestParts<App> for PathKey {
    type Rejection = ProblemResponse;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, ProblemResponse> {
        let path = Path::<String>::from_request_parts(parts, app).await;
        path.map(|Path(text)| Self(Key::from(text.as_str()))).map_err(|_| ProblemResponse::not_found())
    }
}

/// The two variable parts of an address, such as `{id}` and `{version}`. Text that cannot be parsed gives 404.
pub struct PathPair<A, B>(pub A, pub B);

impl<A: FromStr, B: FromStr> FromRequestParts<App> for PathPair<A, B> {
    type Rejection = ProblemResponse;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, ProblemResponse> {
        let path = Path::<(String, String)>::from_request_parts(parts, app).await;
        let (first, second) = path.map(|Path(both)| both).map_err(|_| ProblemResponse::not_found())?;
        let both = first.parse().ok().zip(second.parse().ok());
        both.map(|(first, second)| Self(first, second)).ok_or_else(ProblemResponse::not_found)
    }
}

/// Maps a store error for a resource that `field` of the body or query names: if it is not found, the field is wrong
/// (422), not the address (404).
pub fn reference_problem(field: &'static str) -> impl FnOnce(StoreError) -> ProblemResponse {
    move |error| match error {
        StoreError::NotFound { what } => unknown_reference(field, what),
        other => other.into(),
    }
}

/// Like [`StoreError`] itself, except that a missing group is a mistake in the body's `groups` (422), not in the address
/// (404).
pub fn owners_problem(error: StoreError) -> ProblemResponse {
    match error {
        StoreError::NotFound { what: "groups" } => unknown_reference("groups", "group"),
        other => other.into(),
    }
}

/// The body's length, if the request states it.
pub fn content_length(headers: &HeaderMap) -> Option<u64> {
    headers.get(header::CONTENT_LENGTH)?.to_str().ok()?.parse().ok()
}
