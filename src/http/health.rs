//! Monitoring of the service: liveness, readiness, metrics.

use std::net::{IpAddr, SocketAddr};

use axum::Extension;
use axum::extract::{ConnectInfo, FromRequestParts, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::IntoResponse;
use metrics::{counter, gauge};
use serde::Serialize;
use utoipa::ToSchema;

use super::auth::signed_in::Staff;
use super::compress::Uncompressed;
use super::error::{HandlerResult, ProblemResponse, busy};
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

/// Headers of a request that came through a proxy.
const FORWARDING_HEADERS: [&str; 6] =
    ["forwarded", "x-forwarded-for", "x-forwarded-host", "x-forwarded-proto", "x-real-ip", "via"];

/// A caller who may read the metrics: a program on this machine that is connected directly, or staff.
pub struct MetricsReader;

impl MetricsReader {
    /// Whether a program on this machine sent the request. A proxy on this machine sends those of others.
    fn is_local(peer: IpAddr, headers: &HeaderMap) -> bool {
        peer.to_canonical().is_loopback() && !FORWARDING_HEADERS.iter().any(|name| headers.contains_key(*name))
    }
}

impl FromRequestParts<App> for MetricsReader {
    type Rejection = ProblemResponse;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, ProblemResponse> {
        let peer = parts.extensions.get::<ConnectInfo<SocketAddr>>().map(|ConnectInfo(peer)| peer.ip());
        if peer.is_some_and(|peer| Self::is_local(peer, &parts.headers)) {
            return Ok(Self);
        }
        Staff::from_request_parts(parts, app).await.map(|_| Self)
    }
}

/// Read metrics in Prometheus' text format
///
/// A program on the machine of the service needs no sign-in. Others, also behind a proxy, need one of the staff.
#[utoipa::path(get, path = "/metrics", tag = "operation", security((), ("cookie" = []), ("token" = [])),
    responses((status = OK, body = String)))]
pub async fn metrics(State(app): State<App>, _: MetricsReader) -> HandlerResult<impl IntoResponse> {
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

#[cfg(test)]
mod tests {
    use axum::http::{HeaderName, HeaderValue};

    use super::*;

    #[test]
    fn a_request_through_a_proxy_is_not_local() {
        let is_local = |peer: &str, header: Option<&'static str>| {
            let header = header.map(|name| (HeaderName::from_static(name), HeaderValue::from_static("x")));
            MetricsReader::is_local(peer.parse().unwrap(), &HeaderMap::from_iter(header))
        };
        for peer in ["127.0.0.1", "127.1.2.3", "::1", "::ffff:127.0.0.1"] {
            assert!(is_local(peer, None) && is_local(peer, Some("user-agent")), "{peer}");
            assert!(FORWARDING_HEADERS.iter().all(|name| !is_local(peer, Some(*name))), "{peer}");
        }
        assert!(!is_local("192.0.2.7", None) && !is_local("2001:db8::7", None));
    }
}
