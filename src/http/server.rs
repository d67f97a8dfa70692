//! The accept loop for HTTP/1.1: limits the number of connections and the time that they may be idle.
//!
//! `axum::serve` has no timeout for a request's head, so a silent client would stay connected for ever; hyper's builder
//! with a timer has one. [`StallGuard`] ends an answer that the client does not read, [`super::pace`] a body that
//! arrives too slowly.

use std::convert::Infallible;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use crate::shutdown::Shutdown;
use axum::Router;
use axum::body::Body;
use axum::extract::{ConnectInfo, Request};
use axum::response::Response;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio_util::task::TaskTracker;
use tower::ServiceExt;

use super::base_path::BasePath;
use super::settings::HttpSettings;
use super::stall::StallGuard;

/// How long open requests may continue once the service stops, within the 10 s that shutdown may take in all.
const DRAIN_TIMEOUT: Duration = Duration::from_secs(6);
/// Pause after a failed accept (no descriptors left), so that the loop does not spin.
const ACCEPT_PAUSE: Duration = Duration::from_millis(50);

/// Serves until `stop`, then waits up to `DRAIN_TIMEOUT` for the open requests.
pub async fn serve(listener: TcpListener, routes: Router, settings: &HttpSettings, stop: &Shutdown) {
    let places = Arc::new(Semaphore::new(settings.max_connections));
    let open = TaskTracker::new();
    while let Some((stream, peer, place)) = next_connection(&listener, &places, stop).await {
        let stream = StallGuard::new(stream, settings.write_timeout());
        let answer = connection_service(routes.clone(), peer, settings.base_path.clone());
        let connection = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(settings.head_timeout())
            .serve_connection(TokioIo::new(stream), service_fn(answer))
            .with_upgrades();
        let ending = stop.begun();
        open.spawn(async move {
            let mut connection = pin!(connection);
            let ended = tokio::select! {
                ended = connection.as_mut() => ended,
                () = ending => {
                    connection.as_mut().graceful_shutdown(); // finish the open request, accept no further one
                    connection.await
                }
            };
            if let Err(error) = ended {
                tracing::debug!(%peer, %error, "connection ended early");
            }
            drop(place);
        });
    }
    drop(listener);
    open.close();
    if tokio::time::timeout(DRAIN_TIMEOUT, open.wait()).await.is_err() {
        tracing::warn!("some requests did not end in time; connections closed");
    }
}

type ConnectionPermit = tokio::sync::OwnedSemaphorePermit;

/// The next connection, once a permit is free; `None` when the service stops.
async fn next_connection(
    listener: &TcpListener,
    places: &Arc<Semaphore>,
    stop: &Shutdown,
) -> Option<(TcpStream, SocketAddr, ConnectionPermit)> {
    loop {
        let accepted = tokio::select! {
            () = stop.begun() => return None,
            accepted = accept(listener, places) => accepted,
        };
        match accepted {
            Ok(connection) => return Some(connection),
            Err(error) => {
                tracing::warn!(%error, "accepting a connection failed; retrying in 50 ms");
                tokio::time::sleep(ACCEPT_PAUSE).await;
            }
        }
    }
}

async fn accept(
    listener: &TcpListener,
    places: &Arc<Semaphore>,
) -> std::io::Result<(TcpStream, SocketAddr, ConnectionPermit)> {
    let place = places.clone().acquire_owned().await.map_err(std::io::Error::other)?;
    let (stream, peer) = listener.accept().await?;
    stream.set_nodelay(true)?;
    Ok((stream, peer, place))
}

/// The service of one connection: passes requests below the service's path to the router, with the client's address.
fn connection_service(
    routes: Router,
    peer: SocketAddr,
    base: BasePath,
) -> impl Fn(hyper::Request<Incoming>) -> ResponseFuture + Clone + Send + 'static {
    move |request| {
        let mut request: Request = request.map(Body::new);
        request.extensions_mut().insert(ConnectInfo(peer));
        match base.enter(request) {
            Ok(request) => Box::pin(routes.clone().oneshot(request)),
            Err(answer) => Box::pin(std::future::ready(Ok(*answer))),
        }
    }
}

type ResponseFuture = std::pin::Pin<Box<dyn Future<Output = Result<Response, Infallible>> + Send>>;
