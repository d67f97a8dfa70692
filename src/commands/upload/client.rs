//! A client of the service's REST API: one connection for each request, with the token of the caller.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use futures_util::TryStreamExt;
use http_body_util::combinators::BoxBody;
use http_body_util::{BodyExt, Empty, Limited, StreamBody};
use hyper::body::Frame;
use hyper::http::{HeaderMap, HeaderValue, Method, Request, StatusCode, Uri, header};
use hyper_util::rt::TokioIo;
use rustls::pki_types::ServerName;
use rustls::{ClientConfig, RootCertStore};
use serde::Deserialize;
use serde_json::Value;
use tokio::fs::File;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite};
use tokio::net::TcpStream;
use tokio::sync::watch;
use tokio::time::timeout;
use tokio_rustls::TlsConnector;
use tokio_util::io::ReaderStream;
use tokio_util::task::AbortOnDropHandle;

/// Longest time to establish a connection.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);
/// Longest wait for an answer after the last byte was sent. The service hashes a recording before it answers: a minute is
/// enough for 20 GB, and a retry finds the session.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(300);
/// Longest answer, bytes: a page of 200 sessions has less.
const MAX_ANSWER_BYTES: usize = 16 << 20;
/// Bytes of a file that are read at a time.
const READ_BYTES: usize = 256 << 10;

/// The service, and the token that is sent to it.
pub struct ServiceClient {
    scheme: Scheme,
    host: String,
    port: u16,
    /// The path that the service lies under; usually empty.
    base_path: String,
    /// `None`: the requests are those of a stranger.
    token: Option<HeaderValue>,
    tls: Option<TlsConnector>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scheme {
    Http,
    Https,
}

/// How long the sending of a file may wait.
#[derive(Clone, Copy, Debug)]
pub struct FileLimits {
    /// Longest time during which the network takes no byte. A connection that was cut without a word ends like this.
    pub stall: Duration,
    /// Longest wait for the answer after the last byte.
    pub answer: Duration,
}

/// An answer of the service.
pub struct Answer {
    pub status: StatusCode,
    pub headers: HeaderMap,
    pub body: Bytes,
}

/// Why a request has no answer that can be used.
#[derive(Debug, thiserror::Error)]
pub enum RequestError {
    /// The service was not reached, or the connection broke: the request can be sent again.
    #[error("{0}")]
    Connection(String),
    /// The service refused the request.
    #[error("{title}: {detail}")]
    Refused { status: StatusCode, kind: String, title: String, detail: String, wait: Option<Duration> },
}

/// The parts of a problem document that are shown and acted on.
#[derive(Default, Deserialize)]
#[serde(default)]
struct ProblemParts {
    #[serde(rename = "type")]
    kind: String,
    title: String,
    detail: String,
    wait_s: Option<f64>,
}

type RequestBody = BoxBody<Bytes, io::Error>;

impl RequestError {
    /// True if the same request may succeed later.
    pub fn is_passing(&self) -> bool {
        match self {
            Self::Connection(_) => true,
            Self::Refused { status, .. } => {
                status.is_server_error() || matches!(status.as_u16(), 408 | 409 | 423 | 429 | 460)
            }
        }
    }
}

impl ServiceClient {
    /// A client of the service at an address such as `https://trocar.example:8443`.
    ///
    /// # Errors
    /// The address is invalid, the token cannot be read, or the system trusts no certificates; the text is for users.
    pub fn new(address: &str, token_file: &Path) -> Result<Self, String> {
        let shown = token_file.display();
        let token = std::fs::read_to_string(token_file)
            .map_err(|error| format!("the token cannot be read from {shown}: {error}"))?;
        let token = HeaderValue::from_str(&format!("Bearer {}", token.trim()))
            .map_err(|_| format!("{shown} contains no valid token"))?;
        Ok(Self { token: Some(token), ..Self::anonymous(address)? })
    }

    /// A client without a token, for what the service answers to anyone.
    ///
    /// # Errors
    /// As [`ServiceClient::new`].
    pub fn anonymous(address: &str) -> Result<Self, String> {
        let expected =
            || format!("`{address}` is not a server address; expected http://HOST[:PORT] or https://HOST[:PORT]");
        let uri: Uri = address.parse().map_err(|_| expected())?;
        let scheme = match uri.scheme_str() {
            Some("http") => Scheme::Http,
            Some("https") => Scheme::Https,
            _ => return Err(expected()),
        };
        let authority = uri.authority().filter(|host| !host.as_str().contains('@')).ok_or_else(expected)?;
        let port = authority.port_u16().unwrap_or(if scheme == Scheme::Https { 443 } else { 80 });
        Ok(Self {
            scheme,
            host: authority.host().to_owned(),
            port,
            base_path: uri.path().trim_end_matches('/').to_owned(),
            token: None,
            tls: if scheme == Scheme::Https { Some(tls_connector()?) } else { None },
        })
    }

    /// True if the token travels unencrypted over a network.
    pub fn is_unencrypted(&self) -> bool {
        let is_near = self.host.starts_with("127.") || ["localhost", "[::1]"].contains(&self.host.as_str());
        self.scheme == Scheme::Http && !is_near
    }

    /// The address as uploads name it.
    pub fn address(&self) -> String {
        let scheme = if self.scheme == Scheme::Https { "https" } else { "http" };
        format!("{scheme}://{}:{}{}", self.host, self.port, self.base_path)
    }

    /// Reads a JSON resource. `path` begins behind `/api/v1`.
    pub async fn read(&self, path: &str) -> Result<Value, RequestError> {
        let answer = self.send(Method::GET, path, HeaderMap::new(), empty()).await?;
        serde_json::from_slice(&answer.body)
            .map_err(|_| RequestError::Connection("the answer is no JSON: is this the address of the service?".into()))
    }

    /// Reads all items of a list.
    pub async fn read_all(&self, path: &str) -> Result<Vec<Value>, RequestError> {
        let (mut items, mut cursor) = (Vec::new(), None::<String>);
        loop {
            let joint = if path.contains('?') { '&' } else { '?' };
            let next = cursor.map(|cursor| format!("&cursor={cursor}")).unwrap_or_default();
            let mut page = self.read(&format!("{path}{joint}limit=200{next}")).await?;
            if let Value::Array(more) = page["items"].take() {
                items.extend(more);
            }
            match page["next"].as_str() {
                Some(next) => cursor = Some(next.to_owned()),
                None => return Ok(items),
            }
        }
    }

    /// Sends a request without a body.
    pub async fn request(&self, method: Method, path: &str, headers: HeaderMap) -> Result<Answer, RequestError> {
        self.send(method, path, headers, empty()).await
    }

    /// Sends the next `bytes` bytes of a file as the body.
    pub async fn send_file(
        &self,
        path: &str,
        headers: HeaderMap,
        file: File,
        bytes: u64,
    ) -> Result<Answer, RequestError> {
        let pieces = ReaderStream::with_capacity(file.take(bytes), READ_BYTES).map_ok(Frame::data);
        self.send(Method::PATCH, path, headers, BodyExt::boxed(StreamBody::new(pieces))).await
    }

    /// Sends a file of this many bytes as the body of a new resource.
    ///
    /// # Errors
    /// [`RequestError`]; also if the network takes no byte, or no answer comes, for longer than the limits say.
    pub async fn post_file(
        &self,
        path: &str,
        headers: HeaderMap,
        (file, bytes): (impl AsyncRead + Send + Sync + 'static, u64),
        limits: FileLimits,
    ) -> Result<Answer, RequestError> {
        let progress = Arc::new(watch::Sender::new(0_u64));
        let sent = progress.clone();
        let pieces = ReaderStream::with_capacity(file.take(bytes), READ_BYTES).map_ok(move |piece| {
            sent.send_modify(|taken| *taken += piece.len() as u64);
            Frame::data(piece)
        });
        let stall = async {
            let mut taken = progress.subscribe();
            loop {
                let is_complete = *taken.borrow_and_update() >= bytes;
                let limit = if is_complete { limits.answer } else { limits.stall };
                if timeout(limit, taken.changed()).await.is_err() {
                    return match is_complete {
                        true => silent(limit),
                        false => RequestError::Connection(format!("the network took nothing for {limit:?}")),
                    };
                }
            }
        };
        tokio::select! {
            answer = self.send(Method::POST, path, headers, BodyExt::boxed(StreamBody::new(pieces))) => answer,
            stalled = stall => Err(stalled),
        }
    }

    async fn send(
        &self,
        method: Method,
        path: &str,
        mut headers: HeaderMap,
        body: RequestBody,
    ) -> Result<Answer, RequestError> {
        let host = HeaderValue::from_str(&format!("{}:{}", self.host, self.port)).map_err(broken)?;
        headers.insert(header::HOST, host);
        if let Some(token) = &self.token {
            headers.insert(header::AUTHORIZATION, token.clone());
        }
        let path = if path.starts_with(&format!("{}/api/v1/", self.base_path)) {
            path.to_owned()
        } else {
            format!("{}/api/v1{path}", self.base_path)
        };
        let mut request = Request::builder().method(method).uri(path).body(body).map_err(broken)?;
        request.headers_mut().extend(headers);
        let tcp = timeout(CONNECT_TIMEOUT, TcpStream::connect((self.host.trim_matches(['[', ']']), self.port)));
        let tcp = tcp.await.map_err(|_| silent(CONNECT_TIMEOUT))?.map_err(broken)?;
        let _ = tcp.set_nodelay(true); // only a delay
        match &self.tls {
            None => exchange(tcp, request).await,
            Some(tls) => {
                let name = ServerName::try_from(self.host.trim_matches(['[', ']']).to_owned()).map_err(broken)?;
                let stream = timeout(CONNECT_TIMEOUT, tls.connect(name, tcp)).await;
                exchange(stream.map_err(|_| silent(CONNECT_TIMEOUT))?.map_err(broken)?, request).await
            }
        }
    }
}

/// Sends a request over a new connection and reads the whole answer.
async fn exchange<S>(stream: S, request: Request<RequestBody>) -> Result<Answer, RequestError>
where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let (mut sender, connection) = hyper::client::conn::http1::handshake(TokioIo::new(stream)).await.map_err(broken)?;
    // Ends with the request, also if the caller gives it up.
    let _driver = AbortOnDropHandle::new(tokio::spawn(connection));
    let answer = async {
        let answer = sender.send_request(request).await.map_err(broken)?;
        let (parts, body) = answer.into_parts();
        let body = Limited::new(body, MAX_ANSWER_BYTES).collect();
        let body = timeout(ANSWER_TIMEOUT, body).await.map_err(|_| silent(ANSWER_TIMEOUT))?;
        let body = body.map_err(|error| RequestError::Connection(error.to_string()))?.to_bytes();
        Ok(Answer { status: parts.status, headers: parts.headers, body })
    };
    let answer = answer.await?;
    if answer.status.is_success() { Ok(answer) } else { Err(refusal(&answer)) }
}

fn refusal(answer: &Answer) -> RequestError {
    let parts: ProblemParts = serde_json::from_slice(&answer.body).unwrap_or_default();
    let title = if parts.title.is_empty() { format!("the service answers {}", answer.status) } else { parts.title };
    let wait = parts.wait_s.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    // The last part of the address of the problem's description.
    let kind = parts.kind.rsplit('/').next().unwrap_or_default().to_owned();
    RequestError::Refused { status: answer.status, kind, title, detail: parts.detail, wait }
}

/// TLS that trusts what the system trusts: a centre with its own certificate authority installs it once.
fn tls_connector() -> Result<TlsConnector, String> {
    let mut roots = RootCertStore::empty();
    let found = rustls_native_certs::load_native_certs();
    roots.add_parsable_certificates(found.certs);
    if roots.is_empty() {
        return Err("this machine trusts no certificate authority: install the package ca-certificates".to_owned());
    }
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .map_err(|error| format!("starting TLS: {error}"))?
        .with_root_certificates(roots)
        .with_no_client_auth();
    Ok(TlsConnector::from(Arc::new(config)))
}

fn empty() -> RequestBody {
    Empty::new().map_err(|never| match never {}).boxed()
}

fn broken(error: impl std::error::Error) -> RequestError {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(inner) = cause {
        let shown = inner.to_string();
        if !text.contains(&shown) {
            text += &format!(": {shown}");
        }
        cause = inner.source();
    }
    RequestError::Connection(text)
}

fn silent(limit: Duration) -> RequestError {
    RequestError::Connection(format!("no answer within {limit:?}"))
}
