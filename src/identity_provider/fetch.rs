//! HTTP requests to the provider. They follow no redirect, go only to allowed addresses, and have a limit of time and
//! of size: the provider's documents name further addresses, and a wrong one must not make the service ask other
//! machines.
//!
//! Rejected: reqwest, since its TLS needs another library to build, and it brings much that this does not need.

use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use http_body_util::{BodyExt, Full, Limited};
use hyper::body::Incoming;
use hyper::client::conn::http1;
use hyper::header::{self, HeaderValue};
use hyper::{Request, Response, Uri};
use hyper_util::rt::TokioIo;
use openidconnect::AsyncHttpClient;
use rustls::crypto::ring;
use rustls::pki_types::{InvalidDnsNameError, ServerName};
use rustls::{ClientConfig, RootCertStore};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use url::Url;

use super::settings::is_allowed;

/// Time for a whole request, with connection and answer.
const TIMEOUT: Duration = Duration::from_secs(10);
/// Largest answer, bytes. The largest is the list of keys; it has a few KiB.
const MAX_ANSWER_BYTES: usize = 1 << 20;

/// A client for HTTP requests to the provider.
#[derive(Clone)]
pub struct ProviderHttp {
    tls: TlsConnector,
    timeout: Duration,
}

/// Why a request failed.
#[derive(Debug, thiserror::Error)]
pub enum FetchError {
    /// The address is not one that the service speaks to.
    #[error("`{0}` is not allowed: use https, or http on this machine")]
    Address(String),
    /// The host has no name that a certificate can have.
    #[error("the host has no valid name: {0}")]
    Name(#[from] InvalidDnsNameError),
    /// Nothing answered, or its certificate is not trusted.
    #[error("cannot connect to {host}: {source}")]
    Connect {
        /// Host and port.
        host: String,
        /// What failed.
        source: io::Error,
    },
    /// The connection broke, or the answer is not HTTP.
    #[error("the request failed: {0}")]
    Http(#[from] hyper::Error),
    /// The answer broke off, or is too large.
    #[error("the answer broke off, or has more than {MAX_ANSWER_BYTES} bytes: {0}")]
    Body(Box<dyn std::error::Error + Send + Sync>),
    /// The answer took too long.
    #[error("no answer within {} s", .0.as_secs())]
    Slow(Duration),
    /// The system's certificates cannot be read.
    #[error("cannot set up TLS: {0}")]
    Tls(#[from] rustls::Error),
}

impl ProviderHttp {
    /// A client that trusts the certificates of the system.
    pub fn new() -> Result<Self, FetchError> {
        let mut roots = RootCertStore::empty();
        let found = rustls_native_certs::load_native_certs();
        let (_, unusable) = roots.add_parsable_certificates(found.certs);
        if !found.errors.is_empty() || unusable > 0 || roots.is_empty() {
            let (errors, trusted) = (found.errors, roots.len());
            tracing::warn!(?errors, unusable, trusted, "some certificates of the system cannot be used");
        }
        let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()));
        let config = config.with_safe_default_protocol_versions()?.with_root_certificates(roots);
        Ok(Self { tls: TlsConnector::from(Arc::new(config.with_no_client_auth())), timeout: TIMEOUT })
    }

    /// The same with another limit of time, for tests.
    #[cfg(test)]
    pub fn with_timeout(self, timeout: Duration) -> Self {
        Self { timeout, ..self }
    }

    /// Sends one request, and reads the whole answer. A redirect is an answer like others.
    pub async fn send(&self, request: Request<Vec<u8>>) -> Result<Response<Vec<u8>>, FetchError> {
        let sent = tokio::time::timeout(self.timeout, self.send_in_time(request));
        sent.await.unwrap_or(Err(FetchError::Slow(self.timeout)))
    }

    async fn send_in_time(&self, request: Request<Vec<u8>>) -> Result<Response<Vec<u8>>, FetchError> {
        let address = request.uri().to_string();
        let url: Url = address.parse().map_err(|_| FetchError::Address(address.clone()))?;
        let (Some(host), Some(port)) = (url.host_str(), url.port_or_known_default()) else {
            return Err(FetchError::Address(address));
        };
        if !is_allowed(&url) {
            return Err(FetchError::Address(address));
        }
        let bare = host.trim_start_matches('[').trim_end_matches(']');
        let failed = |source| FetchError::Connect { host: format!("{host}:{port}"), source };
        let stream = TcpStream::connect((bare, port)).await.map_err(failed)?;
        if url.scheme() == "https" {
            let name = ServerName::try_from(bare.to_owned())?;
            return exchange(self.tls.connect(name, stream).await.map_err(failed)?, request, &url).await;
        }
        // `localhost` is a name, and names can be set to any address.
        if !stream.peer_addr().map_err(failed)?.ip().to_canonical().is_loopback() {
            return Err(FetchError::Address(address));
        }
        exchange(stream, request, &url).await
    }
}

impl<'c> AsyncHttpClient<'c> for ProviderHttp {
    type Error = FetchError;
    type Future = Pin<Box<dyn Future<Output = Result<Response<Vec<u8>>, FetchError>> + Send + 'c>>;

    fn call(&'c self, request: Request<Vec<u8>>) -> Self::Future {
        Box::pin(self.send(request))
    }
}

/// Sends the request over a connection of its own, and reads the answer.
async fn exchange(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    request: Request<Vec<u8>>,
    url: &Url,
) -> Result<Response<Vec<u8>>, FetchError> {
    let (mut sender, connection) = http1::handshake(TokioIo::new(stream)).await?;
    let (mut head, body) = request.into_parts();
    let path = &url[url::Position::BeforePath..url::Position::AfterQuery];
    head.uri = path.parse::<Uri>().map_err(|_| FetchError::Address(url.to_string()))?;
    let host = &url[url::Position::BeforeHost..url::Position::AfterPort];
    let host = HeaderValue::from_str(host).map_err(|_| FetchError::Address(url.to_string()))?;
    head.headers.insert(header::HOST, host);
    let answer = async {
        let body: Full<Bytes> = Full::new(Bytes::from(body));
        let (head, body) = sender.send_request(Request::from_parts(head, body)).await?.into_parts();
        let body: Limited<Incoming> = Limited::new(body, MAX_ANSWER_BYTES);
        let body = body.collect().await.map_err(FetchError::Body)?.to_bytes();
        Ok(Response::from_parts(head, body.to_vec()))
    };
    tokio::pin!(connection, answer);
    // The connection may end before the whole answer is read. If it broke, the answer says so: many servers end TLS
    // without `close_notify` after a whole answer, which is no error here.
    tokio::select! {
        answer = &mut answer => answer,
        _ = &mut connection => answer.await,
    }
}

#[cfg(test)]
mod tests {
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::TcpListener;

    use super::*;

    /// Answers one request with these bytes, `times` times, and returns the outcome.
    async fn answered(head: &'static str, piece: &'static [u8], times: usize) -> Result<Response<Vec<u8>>, FetchError> {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let server = tokio::spawn(async move {
            let (mut stream, _) = listener.accept().await.unwrap();
            let _ = stream.read(&mut [0; 4096]).await;
            let _ = stream.write_all(head.as_bytes()).await;
            for _ in 0..times {
                if stream.write_all(piece).await.is_err() {
                    return;
                }
            }
            if times == 0 {
                std::future::pending::<()>().await;
            }
        });
        let client = ProviderHttp::new().unwrap().with_timeout(Duration::from_millis(500));
        let request = Request::get(format!("http://{address}/a?b=c")).body(Vec::new()).unwrap();
        let answer = client.send(request).await;
        server.abort();
        answer
    }

    #[tokio::test]
    async fn a_plain_answer_is_read_and_a_redirect_is_not_followed() {
        let answer = answered("HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n", b"ok", 1).await.unwrap();
        assert_eq!(answer.body(), b"ok");
        let answer = answered("HTTP/1.1 200 OK\r\nConnection: close\r\n\r\n", b"ok", 3).await.unwrap();
        assert_eq!(answer.body(), b"okokok");
        let answer =
            answered("HTTP/1.1 302 Found\r\nLocation: http://127.0.0.1:1/\r\nContent-Length: 0\r\n\r\n", b"", 1);
        assert_eq!(answer.await.unwrap().status(), 302);
    }

    #[tokio::test]
    async fn huge_and_slow_answers_end() {
        let huge = answered("HTTP/1.1 200 OK\r\nConnection: close\r\n\r\n", &[b'x'; 65_536], 64).await;
        assert!(matches!(huge, Err(FetchError::Body(_))), "{huge:?}");
        let slow = answered("HTTP/1.1 200 OK\r\nContent-Length: 9\r\n\r\n", b"", 0).await;
        assert!(matches!(slow, Err(FetchError::Slow(_))), "{slow:?}");
        let silent = answered("", b"", 0).await;
        assert!(matches!(silent, Err(FetchError::Slow(_))), "{silent:?}");
        let garbage = answered("", b"\0\0\0\0\r\n\r\n", 1).await;
        assert!(matches!(garbage, Err(FetchError::Http(_))), "{garbage:?}");
    }

    #[tokio::test]
    async fn other_machines_are_asked_only_over_https() {
        for address in ["http://192.0.2.1/", "http://id.example/", "ftp://127.0.0.1/"] {
            let request = Request::get(address).body(Vec::new()).unwrap();
            let refused = ProviderHttp::new().unwrap().send(request).await;
            assert!(matches!(refused, Err(FetchError::Address(_))), "{address}: {refused:?}");
        }
    }
}
