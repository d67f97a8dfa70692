//! The accept loop: HTTP/1.1 connections that can neither be silent for ever nor be too many.
//!
//! `axum::serve` has no timeout for a request's head, and a silent client stays for good; hyper's builder with a timer
//! has one. An answer that nobody reads is ended by [`StallGuard`]; a body that dribbles by [`super::pace`].

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

use super::settings::HttpSettings;
use super::stall::StallGuard;

/// How long open requests may go on once the service stops, within the ten seconds that it has in all.
const LAST_REQUESTS: Duration = Duration::from_secs(6);
/// Pause after a failed accept (no descriptors left), so that the loop does not spin.
const ACCEPT_PAUSE: Duration = Duration::from_millis(50);

/// Serves until `stop`, then lets the open requests end.
pub async fn serve(listener: TcpListener, routes: Router, settings: &HttpSettings, stop: &Shutdown) {
    let places = Arc::new(Semaphore::new(settings.max_connections));
    let open = TaskTracker::new();
    while let Some((stream, peer, place)) = next_connection(&listener, &places, stop).await {
        let stream = StallGuard::new(stream, settings.write_timeout());
        let answer = answer_with(routes.clone(), peer);
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
                    connection.as_mut().graceful_shutdown(); // the open request, and no further one
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
    if tokio::time::timeout(LAST_REQUESTS, open.wait()).await.is_err() {
        tracing::warn!("some requests did not end in time and are cut");
    }
}

type Place = tokio::sync::OwnedSemaphorePermit;

/// The next connection once there is a place for it; `None` when the service stops.
async fn next_connection(
    listener: &TcpListener,
    places: &Arc<Semaphore>,
    stop: &Shutdown,
) -> Option<(TcpStream, SocketAddr, Place)> {
    loop {
        let accepted = tokio::select! {
            () = stop.begun() => return None,
            accepted = accept(listener, places) => accepted,
        };
        match accepted {
            Ok(connection) => return Some(connection),
            Err(error) => {
                tracing::warn!(%error, "cannot accept a connection");
                tokio::time::sleep(ACCEPT_PAUSE).await;
            }
        }
    }
}

async fn accept(listener: &TcpListener, places: &Arc<Semaphore>) -> std::io::Result<(TcpStream, SocketAddr, Place)> {
    let place = places.clone().acquire_owned().await.map_err(std::io::Error::other)?;
    let (stream, peer) = listener.accept().await?;
    stream.set_nodelay(true)?;
    Ok((stream, peer, place))
}

/// Hands a connection's requests to the router, with the client's address.
fn answer_with(
    routes: Router,
    peer: SocketAddr,
) -> impl Fn(hyper::Request<Incoming>) -> Answering + Clone + Send + 'static {
    move |request| {
        let mut request: Request = request.map(Body::new);
        request.extensions_mut().insert(ConnectInfo(peer));
        Box::pin(routes.clone().oneshot(request))
    }
}

type Answering = std::pin::Pin<Box<dyn Future<Output = Result<Response, Infallible>> + Send>>;
