//! The sockets that the service listens on: its own, and one for plain HTTP that is redirected to HTTPS.

use std::io;
use std::net::SocketAddr;

use tokio::net::TcpListener;
use tokio::task::JoinHandle;

use super::connection::{Site, Transport};
use super::state::App;
use super::tls::ServerCertificate;
use super::{redirect, router, server};

/// The sockets, bound and not yet served: clients that connect wait.
#[derive(Debug)]
pub struct Listeners {
    main: BoundListener,
    redirect: Option<BoundListener>,
}

#[derive(Debug)]
struct BoundListener {
    socket: TcpListener,
    address: SocketAddr,
}

/// An address that cannot be listened on.
#[derive(Debug, thiserror::Error)]
#[error("cannot listen on {address} ({})", advice(source))]
pub struct ListenError {
    /// The address.
    pub address: SocketAddr,
    /// Error of the operating system.
    pub source: io::Error,
}

/// What to do about an address that cannot be listened on.
fn advice(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::AddrInUse => {
            "stop the program that uses it, or choose another address with `--listen` or in the settings"
        }
        io::ErrorKind::PermissionDenied => "choose a port above 1023, or let a proxy listen on it",
        _ => "choose an address of this machine with `--listen` or in the settings",
    }
}

impl Listeners {
    /// Binds the service's address, and the one whose requests are redirected.
    pub async fn bind(listen: SocketAddr, redirect_listen: Option<SocketAddr>) -> Result<Self, ListenError> {
        let main = BoundListener::bind(listen).await?;
        let redirect = match redirect_listen {
            Some(address) => Some(BoundListener::bind(address).await?),
            None => None,
        };
        Ok(Self { main, redirect })
    }

    /// The service's address.
    pub fn address(&self) -> SocketAddr {
        self.main.address
    }

    /// The address whose requests are redirected.
    pub fn redirect_address(&self) -> Option<SocketAddr> {
        self.redirect.as_ref().map(|listener| listener.address)
    }

    /// Accepts connections until the shutdown: HTTPS with a certificate, else plain HTTP. The task ends when the open
    /// requests have ended.
    pub fn serve(self, certificate: Option<ServerCertificate>, app: App) -> Result<JoinHandle<()>, rustls::Error> {
        let transport = match &certificate {
            Some(certificate) => Transport::Tls(certificate.acceptor()?),
            None => Transport::Plain,
        };
        if let Some(certificate) = certificate {
            app.shutdown.spawn(certificate.keep_current(app.clock.clone(), app.shutdown.clone()));
        }
        if let Some(listener) = self.redirect {
            let (own, site) = (app.clone(), Site::from(redirect::routes(Some(self.main.address.port()))));
            app.shutdown.spawn(async move {
                server::serve(listener.socket, Transport::Plain, site, &own.settings, &own.shutdown).await;
            });
        }
        let site = Site { routes: router::routes(app.clone()), base_path: app.settings.base_path.clone() };
        Ok(tokio::spawn(async move {
            server::serve(self.main.socket, transport, site, &app.settings, &app.shutdown).await;
        }))
    }
}

impl BoundListener {
    async fn bind(to: SocketAddr) -> Result<Self, ListenError> {
        let failed = |source| ListenError { address: to, source };
        let socket = TcpListener::bind(to).await.map_err(failed)?;
        let address = socket.local_addr().map_err(failed)?;
        Ok(Self { socket, address })
    }
}
