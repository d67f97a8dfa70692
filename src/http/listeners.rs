//! The sockets that the service listens on: its own, and one for plain HTTP that is redirected to HTTPS.

use std::io;
use std::net::SocketAddr;

use anyhow::Context;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;

use super::connection::Transport;
use super::state::App;
use super::tls::ServerCertificate;
use super::{redirect, router, server};

/// The sockets, bound and not yet served: clients that connect wait.
#[derive(Debug)]
pub struct Listeners {
    main: TcpListener,
    redirect: Option<TcpListener>,
}

impl Listeners {
    /// Binds the service's address, and the one whose requests are redirected.
    pub async fn bind(listen: SocketAddr, redirect_listen: Option<SocketAddr>) -> anyhow::Result<Self> {
        let bind = async |to: SocketAddr| TcpListener::bind(to).await.with_context(|| format!("listening on {to}"));
        let main = bind(listen).await?;
        let redirect = match redirect_listen {
            Some(to) => Some(bind(to).await?),
            None => None,
        };
        Ok(Self { main, redirect })
    }

    /// The service's address.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.main.local_addr()
    }

    /// The address whose requests are redirected.
    pub fn redirect_address(&self) -> io::Result<Option<SocketAddr>> {
        self.redirect.as_ref().map(TcpListener::local_addr).transpose()
    }

    /// Accepts connections until the shutdown: HTTPS with a certificate, else plain HTTP. The task ends when the open
    /// requests have ended.
    pub fn serve(self, certificate: Option<ServerCertificate>, app: App) -> anyhow::Result<JoinHandle<()>> {
        let transport = match &certificate {
            Some(certificate) => Transport::Tls(certificate.acceptor()?),
            None => Transport::Plain,
        };
        if let Some(certificate) = certificate {
            app.shutdown.spawn(certificate.keep_current(app.clock.clone(), app.shutdown.clone()));
        }
        if let Some(listener) = self.redirect {
            let (own, routes) = (app.clone(), redirect::routes(Some(self.main.local_addr()?.port())));
            app.shutdown.spawn(async move {
                server::serve(listener, Transport::Plain, routes, &own.settings, &own.shutdown).await;
            });
        }
        let routes = router::routes(app.clone());
        Ok(tokio::spawn(async move {
            server::serve(self.main, transport, routes, &app.settings, &app.shutdown).await;
        }))
    }
}
