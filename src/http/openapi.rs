//! The OpenAPI description: generated from the handlers, and completed with what is common to all of them.

use std::sync::{Arc, LazyLock};

use axum::Extension;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::IntoResponse;
use utoipa::openapi::path::Operation;
use utoipa::openapi::security::{ApiKey, ApiKeyValue, Http, HttpAuthScheme, SecurityRequirement, SecurityScheme};
use utoipa::openapi::{Content, OpenApi, PathItem, Ref, Response, ResponseBuilder, Server};
use utoipa::{OpenApi as _, ToSchema};

use super::auth::presented::sign_in_cookie_name;
use super::base_path::BasePath;
use super::compress::FixedText;
use super::error::{PROBLEM_JSON, ProblemDocument, REFUSALS};

/// Title, description, and the schemas that no handler names.
#[derive(utoipa::OpenApi)]
#[openapi(
    info(
        title = "Trocar",
        description = "Measures laparoscopic box training: send recordings, read instrument paths and features. \
        People sign in and use a cookie; programs send `Authorization: Bearer trc_…`. \
        Every `{id}` is an id or, if the resource has one, its code. \
        Long lists come in pages: to read the next page, pass `next` as `cursor`. \
        Refusals are problem documents (RFC 9457); programs should decide by their `type`."
    ),
    components(schemas(ProblemDocument))
)]
struct Base;

/// The description before the routes are added.
pub fn base() -> OpenApi {
    Base::openapi()
}

/// The finished description as JSON.
#[derive(Clone)]
pub struct OpenApiDocument(Arc<LazyLock<FixedText, Box<dyn FnOnce() -> FixedText + Send>>>);

impl OpenApiDocument {
    /// Serialises the description once, for all requests, and compresses it at the first one.
    pub fn new(document: &OpenApi) -> Self {
        let json = document.to_json().unwrap_or_default().into_bytes(); // text, numbers and lists always serialise
        let compress = || FixedText::new(HeaderValue::from_static("application/json"), json.into());
        Self(Arc::new(LazyLock::new(Box::new(compress))))
    }
}

/// Read this description
#[utoipa::path(get, path = "/openapi.json", tag = "operation", security(()),
    responses((status = OK, description = "OpenAPI 3.1", content_type = "application/json")))]
pub async fn document(
    Extension(OpenApiDocument(text)): Extension<OpenApiDocument>,
    headers: HeaderMap,
) -> impl IntoResponse {
    ([(header::CACHE_CONTROL, "no-cache")], text.answer(&headers))
}

/// Adds the path that the service lies under, and the ways to sign in and the possible refusals to every operation.
pub fn complete_operations(document: &mut OpenApi, base: &BasePath) {
    document.servers = (!base.is_root()).then(|| vec![Server::new(base.to_string())]);
    let components = document.components.get_or_insert_default();
    let cookie = ApiKeyValue::new(sign_in_cookie_name(base));
    components.add_security_scheme("cookie", SecurityScheme::ApiKey(ApiKey::Cookie(cookie)));
    components.add_security_scheme("token", SecurityScheme::Http(Http::new(HttpAuthScheme::Bearer)));
    for (path, item) in &mut document.paths.paths {
        for (method, operation) in operations(item) {
            if let Some(operation) = operation {
                operation.operation_id = Some(operation_id(method, path));
                complete_operation(operation, path);
            }
        }
    }
}

/// The operations of a path, with the methods in lower case.
fn operations(item: &mut PathItem) -> [(&'static str, Option<&mut Operation>); 7] {
    let PathItem { get, put, post, patch, delete, head, options, .. } = item;
    [
        ("get", get),
        ("put", put),
        ("post", post),
        ("patch", patch),
        ("delete", delete),
        ("head", head),
        ("options", options),
    ]
    .map(|(method, operation)| (method, operation.as_mut()))
}

/// The id that generators of clients make names of, such as `get_sessions_id_video`. Handlers of different
/// resources share their names; method and path identify an operation.
fn operation_id(method: &str, path: &str) -> String {
    let path = path.strip_prefix("/api/v1").unwrap_or(path);
    let words = path.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    std::iter::once(method).chain(words).collect::<Vec<_>>().join("_")
}

fn complete_operation(operation: &mut Operation, path: &str) {
    let mut refusals = vec![400, 403, 408, 422, 429, 500, 503];
    if operation.security.is_none() {
        let scopes: [&str; 0] = [];
        operation.security =
            Some(vec![SecurityRequirement::new("cookie", scopes), SecurityRequirement::new("token", scopes)]);
        refusals.push(401);
    }
    if path.contains('{') {
        refusals.extend([404, 409]);
    }
    if operation.request_body.is_some() {
        refusals.extend([409, 413, 415, 507]);
    }
    if path.contains("/uploads") {
        refusals.extend([410, 412, 423, 460]);
    }
    if path.contains("/single-sign-on/") || path == "/api/v1/me/identities" {
        refusals.extend([409, 410]); // not set up; expired
    }
    if path == "/metrics" {
        refusals.push(401); // unless the caller is on the machine of the service
    }
    if path.ends_with("/feed.ts") || path.ends_with("/password-links/open") || path.ends_with("/password-links/use") {
        refusals.push(410);
    }
    for status in refusals {
        operation.responses.responses.entry(status.to_string()).or_insert_with(|| problem(status).into());
    }
}

/// The description of a problem document with this status: its possible `type`s.
pub fn problem(status: u16) -> Response {
    let kinds: Vec<_> = REFUSALS.iter().filter(|row| row.3 == status).map(|row| format!("`{}`", row.1)).collect();
    ResponseBuilder::new()
        .description(format!("Refused: {}", kinds.join(", ")))
        .content(PROBLEM_JSON, Content::new(Some(Ref::from_schema_name(ProblemDocument::name()))))
        .build()
}
