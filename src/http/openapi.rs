//! The description of the interface, made from the handlers, and completed with what holds for all of them.

use axum::Extension;
use axum::body::Bytes;
use axum::http::header;
use axum::response::IntoResponse;
use utoipa::openapi::path::Operation;
use utoipa::openapi::security::{ApiKey, ApiKeyValue, Http, HttpAuthScheme, SecurityRequirement, SecurityScheme};
use utoipa::openapi::{Content, OpenApi, PathItem, Ref, Response, ResponseBuilder};
use utoipa::{OpenApi as _, ToSchema};

use super::auth::presented::COOKIE;
use super::error::{PROBLEM_JSON, ProblemDocument, TABLE};

/// Title, words and schemas that no handler names.
#[derive(utoipa::OpenApi)]
#[openapi(
    info(
        title = "Trocar",
        description = "Recordings of laparoscopic box training in, paths and features out. \
        Sign in with a cookie (people) or send `Authorization: Bearer trc_…` (programs). \
        Every `{id}` is an id or, where the thing has one, its code. Lists are paged: pass `next` as `cursor`. \
        Refusals are problem documents (RFC 9457); programs decide by their `type`."
    ),
    components(schemas(ProblemDocument))
)]
struct Base;

/// What the routes are added to.
pub fn base() -> OpenApi {
    Base::openapi()
}

/// The finished description, as it is sent.
#[derive(Clone)]
pub struct Document(Bytes);

impl Document {
    /// Writes the description down once.
    pub fn new(document: &OpenApi) -> Self {
        Self(document.to_json().unwrap_or_default().into()) // text, numbers and lists always serialise
    }
}

/// This description
#[utoipa::path(get, path = "/openapi.json", tag = "operation", security(()),
    responses((status = OK, description = "OpenAPI 3.1", content_type = "application/json")))]
pub async fn document(Extension(Document(bytes)): Extension<Document>) -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "application/json"), (header::CACHE_CONTROL, "no-cache")], bytes)
}

/// Adds to every operation how to sign in and what it may refuse.
pub fn complete(document: &mut OpenApi) {
    let components = document.components.get_or_insert_default();
    components.add_security_scheme("cookie", SecurityScheme::ApiKey(ApiKey::Cookie(ApiKeyValue::new(COOKIE))));
    components.add_security_scheme("token", SecurityScheme::Http(Http::new(HttpAuthScheme::Bearer)));
    for (path, item) in &mut document.paths.paths {
        operations(item).into_iter().flatten().for_each(|operation| complete_operation(operation, path));
    }
}

fn operations(item: &mut PathItem) -> [Option<&mut Operation>; 7] {
    let PathItem { get, put, post, patch, delete, head, options, .. } = item;
    [get, put, post, patch, delete, head, options].map(Option::as_mut)
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
    if path.ends_with("/feed.ts") {
        refusals.push(410);
    }
    for status in refusals {
        operation.responses.responses.entry(status.to_string()).or_insert_with(|| problem(status).into());
    }
}

/// A problem document for this status, with the kinds that it may have.
pub fn problem(status: u16) -> Response {
    let kinds: Vec<_> = TABLE.iter().filter(|row| row.3 == status).map(|row| format!("`{}`", row.1)).collect();
    ResponseBuilder::new()
        .description(format!("Refused: {}", kinds.join(", ")))
        .content(PROBLEM_JSON, Content::new(Some(Ref::from_schema_name(ProblemDocument::name()))))
        .build()
}
