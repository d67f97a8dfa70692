//! `/docs`: the API documentation (Swagger UI), served from files inside the program; needs no internet.

use std::collections::HashMap;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use axum::extract::rejection::PathRejection;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::{Redirect, Response};
use utoipa_swagger_ui::{Config, SwaggerFile};

use super::base_path::BasePath;
use super::compress::FixedText;
use super::error::{HandlerResult, ProblemResponse};
use super::state::App;

/// Address of the API description.
pub const OPENAPI_PATH: &str = "/api/v1/openapi.json";

/// Redirects `/docs` to `/docs/`, because the viewer's files are relative to it.
pub async fn entry() -> Redirect {
    Redirect::permanent("/docs/")
}

/// The first page.
pub async fn index(State(app): State<App>, headers: HeaderMap) -> HandlerResult<Response> {
    file("index.html", &app.settings.base_path, &headers)
}

/// One of the viewer's files.
pub async fn asset(
    State(app): State<App>,
    headers: HeaderMap,
    path: Result<Path<String>, PathRejection>,
) -> HandlerResult<Response> {
    let Path(path) = path.map_err(|_| ProblemResponse::not_found())?;
    file(&path, &app.settings.base_path, &headers)
}

/// Answers with a file, which is compressed at its first request.
fn file(path: &str, base: &BasePath, headers: &HeaderMap) -> HandlerResult<Response> {
    static COMPRESSED: LazyLock<Mutex<HashMap<(String, String), FixedText>>> = LazyLock::new(Mutex::default);
    let known = || COMPRESSED.lock().unwrap_or_else(PoisonError::into_inner);
    let description = format!("{base}{OPENAPI_PATH}");
    let key = (path.to_owned(), description);
    let text = known().get(&key).cloned();
    let text = match text {
        Some(text) => text,
        None => {
            let found = utoipa_swagger_ui::serve(path, Arc::new(Config::from(key.1.clone())));
            let found = found.map_err(|cause| ProblemResponse::internal("showing the docs", cause.to_string()))?;
            let file = found.ok_or_else(ProblemResponse::not_found)?;
            known().entry(key).or_insert(fixed_text(file)).clone()
        }
    };
    let mut response = text.answer(headers);
    response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("no-cache"));
    Ok(response)
}

fn fixed_text(file: SwaggerFile<'static>) -> FixedText {
    let media_type = HeaderValue::from_str(&file.content_type);
    let media_type = media_type.unwrap_or(HeaderValue::from_static("application/octet-stream"));
    FixedText::new(media_type, file.bytes)
}
