//! Writes a log line and a metrics sample for every request, with an id that the answer carries, too.

use std::time::Instant;

use axum::extract::{MatchedPath, Request};
use axum::http::{HeaderName, HeaderValue, Method};
use axum::middleware::Next;
use axum::response::Response;
use metrics::{counter, histogram};
use tracing::Instrument;
use uuid::Uuid;

/// Header that carries a request's id.
const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// Middleware: gives each request an id, measures its duration and counts it. It does not log the query, which may
/// contain names of people.
pub async fn observe(request: Request, next: Next) -> Response {
    let id = Uuid::new_v4().simple().to_string();
    let started = Instant::now();
    let method = request.method().clone();
    let route = request.extensions().get::<MatchedPath>().map_or("page", |path| path.as_str()).to_owned();
    let span = tracing::info_span!("request", id, %method, path = request.uri().path());
    let mut response = next.run(request).instrument(span.clone()).await;
    let (status, duration) = (response.status().as_u16(), started.elapsed());
    span.in_scope(|| tracing::debug!(status, duration_ms = duration.as_millis() as u64, "answered"));
    let labels = [("method", label(&method)), ("route", route), ("status", status.to_string())];
    counter!("trocar_http_requests_total", &labels).increment(1);
    histogram!("trocar_http_answer_seconds", &labels[..2]).record(duration.as_secs_f64());
    if let Ok(id) = HeaderValue::try_from(id) {
        response.headers_mut().insert(REQUEST_ID, id);
    }
    response
}

/// The method as a metrics label. Unknown methods share one label, because each label value stays in memory.
fn label(method: &Method) -> String {
    let known = [Method::GET, Method::HEAD, Method::POST, Method::PUT, Method::PATCH, Method::DELETE, Method::OPTIONS];
    if known.contains(method) { method.to_string() } else { "other".to_owned() }
}
