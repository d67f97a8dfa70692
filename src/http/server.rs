//! The accept loop: limits the number of connections and the time that they may be idle.
//!
//! `axum::serve` has no timeout for a request's head, so a silent client would stay connected for ever; hyper's builder
//! with a timer has one. [`super::connection`] has the limits on time, [`super::stall`] ends an answer that the client
//! does not read, [`super::pace`] a body that arrives too slowly.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio_util::task::TaskTracker;

use super::connection::{ConnectionLimits, Site, Transport, serve_connection};
use super::settings::HttpSettings;
use crate::shutdown::Shutdown;

/// How long open requests may continue once the service stops, within the 10 s that shutdown may take in all.
const DRAIN_TIMEOUT: Duration = Duration::from_secs(6);
/// Pause after a failed accept (no descriptors left), so that the loop does not spin.
const ACCEPT_PAUSE: Duration = Duration::from_millis(50);

/// Serves until `stop`, then waits up to `DRAIN_TIMEOUT` for the open requests.
pub async fn serve(listener: TcpListener, transport: Transport, site: Site, settings: &HttpSettings, stop: &Shutdown) {
    let places = Arc::new(Semaphore::new(settings.max_connections));
    let (open, limits) = (TaskTracker::new(), ConnectionLimits::from(settings));
    while let Some((stream, peer, place)) = next_connection(&listener, &places, stop).await {
        let (transport, site, stop) = (transport.clone(), site.clone(), stop.clone());
        open.spawn(async move {
            if let Err(error) = serve_connection(stream, peer, transport, site, limits, &stop).await {
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
