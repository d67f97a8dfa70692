//! The accept loop: limits the number of connections and the time that they may be idle.
//!
//! [`super::connection_places`] decides which connection is closed for a new one when all places are taken.
//! `axum::serve` has no timeout for a request's head, so a silent client would stay connected for ever; hyper's builder
//! with a timer has one. [`super::connection`] has the limits on time, [`super::stall`] ends an answer that the client
//! does not read, [`super::pace`] a body that arrives too slowly.

use std::net::SocketAddr;
use std::time::Duration;

use tokio::net::{TcpListener, TcpStream};
use tokio_util::task::TaskTracker;

use super::connection::{ConnectionLimits, Site, Transport, serve_connection};
use super::connection_places::{ConnectionPlace, ConnectionPlaces};
use super::settings::HttpSettings;
use crate::shutdown::Shutdown;

/// How long open requests may continue once the service stops, within the 10 s that shutdown may take in all.
const DRAIN_TIMEOUT: Duration = Duration::from_secs(6);
/// Pause after a failed accept (no descriptors left), so that the loop does not spin.
const ACCEPT_PAUSE: Duration = Duration::from_millis(50);

/// Serves until `stop`, then waits up to `DRAIN_TIMEOUT` for the open requests.
pub async fn serve(listener: TcpListener, transport: Transport, site: Site, settings: &HttpSettings, stop: &Shutdown) {
    let (places, open, limits) =
        (ConnectionPlaces::new(settings), TaskTracker::new(), ConnectionLimits::from(settings));
    while let Some((stream, peer, place)) = next_connection(&listener, &places, stop).await {
        let (transport, site, stop) = (transport.clone(), site.clone(), stop.clone());
        open.spawn(async move {
            let served = serve_connection(stream, peer, place.handle(), transport, site, limits, &stop);
            tokio::select! {
                () = place.must_close() => tracing::debug!(%peer, "connection closed: a new one takes its place"),
                ended = served => if let Err(error) = ended {
                    tracing::debug!(%peer, %error, "connection ended early");
                },
            }
        });
    }
    drop(listener);
    open.close();
    if tokio::time::timeout(DRAIN_TIMEOUT, open.wait()).await.is_err() {
        tracing::warn!("some requests did not end in time; connections closed");
    }
}

/// The next connection, once it has a place; `None` when the service stops.
async fn next_connection(
    listener: &TcpListener,
    places: &ConnectionPlaces,
    stop: &Shutdown,
) -> Option<(TcpStream, SocketAddr, ConnectionPlace)> {
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
    places: &ConnectionPlaces,
) -> std::io::Result<(TcpStream, SocketAddr, ConnectionPlace)> {
    let (stream, peer) = listener.accept().await?;
    stream.set_nodelay(true)?;
    let place = places.take(peer.ip()).await;
    Ok((stream, peer, place))
}
