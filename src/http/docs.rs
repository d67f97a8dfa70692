//! `/docs`: the API documentation (Swagger UI), served from files inside the program; needs no internet.

use std::sync::Arc;

use axum::extract::rejection::PathRejection;
use axum::extract::{Path, State};
use axum::http::{HeaderName, HeaderValue, header};
use axum::response::{IntoResponse, Redirect, Response};
use utoipa_swagger_ui::{Config, SwaggerFile};

use super::base_path::BasePath;
use super::error::{HandlerResult, ProblemResponse};
use super::state::App;

/// Address of the API description.
pub const OPENAPI_PATH: &str = "/api/v1/openapi.json";

/// Redirects `/docs` to `/docs/`, because the viewer's files are relative to it.
pub async fn entry() -> Redirect {
    Redirect::permanent("/docs/")
}

/// The first page.
pub async fn index(State(app): State<App>) -> HandlerResult<Response> {
    file("index.html", &app.settings.base_path)
}

/// One of the viewer's files.
pub async fn asset(State(app): State<App>, path: Result<Path<String>, PathRejection>) -> HandlerResult<Response> {
    let Path(path) = path.map_err(|_| ProblemResponse::not_found())?;
    file(&path, &app.settings.base_path)
}

fn file(path: &str, base: &BasePath) -> HandlerResult<Response> {
    let description = format!("{base}{OPENAPI_PATH}");
    let found = utoipa_swagger_ui::serve(path, Arc::new(Config::from(description)));
    let file = found.map_err(|cause| ProblemResponse::internal("showing the docs", cause.to_string()))?;
    file.map(answer).ok_or_else(ProblemResponse::not_found)
}

fn answer(file: SwaggerFile<'static>) -> Response {
    let header = |name: HeaderName, value: &str| Some((name, HeaderValue::from_str(value).ok()?));
    let encoding = if file.gzpipped { header(header::CONTENT_ENCODING, "gzip") } else { None };
    let headers =
        [header(header::CONTENT_TYPE, &file.content_type), header(header::CACHE_CONTROL, "no-cache"), encoding];
    let mut response = file.bytes.into_owned().into_response();
    headers.into_iter().flatten().for_each(|(name, value)| {
        response.headers_mut().insert(name, value);
    });
    response
}
