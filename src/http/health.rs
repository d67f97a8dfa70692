//! Monitoring of the service: liveness, readiness, metrics.

use axum::Extension;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::IntoResponse;
use metrics::{counter, gauge};
use serde::Serialize;
use utoipa::ToSchema;

use super::compress::Uncompressed;
use super::error::{HandlerResult, busy};
use super::read::Json;
use super::state::App;
use crate::upkeep::BackupProgress;

/// Check that the process is alive
#[utoipa::path(get, path = "/healthz", tag = "operation", security(()), responses((status = OK, body = String)))]
pub async fn healthz() -> &'static str {
    "ok\n"
}

/// Whether requests can be served.
#[derive(Serialize, ToSchema)]
pub struct ReadyResponse {
    ready: bool,
    version: &'static str,
}

/// Check that requests can be served
///
/// Queries the database. Answers 503 as soon as the service begins to shut down.
#[utoipa::path(get, path = "/readyz", tag = "operation", security(()), responses((status = OK, body = ReadyResponse)))]
pub async fn readyz(State(app): State<App>) -> HandlerResult<Json<ReadyResponse>> {
    if app.shutdown.is_begun() {
        return Err(busy("The service is shutting down. Use another instance, or try again in a minute."));
    }
    app.store.people().count().await?;
    Ok(Json(ReadyResponse { ready: true, version: env!("CARGO_PKG_VERSION") }))
}

/// Read metrics in Prometheus' text format
#[utoipa::path(get, path = "/metrics", tag = "operation", security(()), responses((status = OK, body = String)))]
pub async fn metrics(State(app): State<App>) -> HandlerResult<impl IntoResponse> {
    let counts = app.store.jobs().counts().await?;
    gauge!("trocar_jobs", "state" => "queued").set(counts.queued as f64);
    gauge!("trocar_jobs", "state" => "running").set(counts.running as f64);
    gauge!("trocar_jobs", "state" => "quarantined").set(counts.quarantined as f64);
    counter!("trocar_jobs_failed_total").increment(0); // present before the first failure, so that an alert sees it
    if app.backup_settings.target.is_some() {
        let BackupProgress { newest_ms, missing, .. } = app.backup_state.now();
        gauge!("trocar_backup_last_success_timestamp_seconds").set(newest_ms.unwrap_or(0) as f64 / 1e3);
        gauge!("trocar_backup_missing_files").set(missing.len() as f64);
    }
    gauge!("trocar_event_streams").set(app.watcher_slots.taken() as f64);
    let headers = [(header::CONTENT_TYPE, "text/plain; version=0.0.4")];
    Ok((StatusCode::OK, headers, Extension(Uncompressed), app.metrics.render()))
}
