//! One connection: the TLS handshake, then HTTP/2 or HTTP/1.1 with their limits on time.

use std::convert::Infallible;
use std::error::Error;
use std::io;
use std::net::SocketAddr;
use std::pin::{Pin, pin};
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::extract::{ConnectInfo, Request};
use axum::http::{HeaderValue, Uri, Version, header};
use axum::response::{IntoResponse, Response};
use hyper::body::Incoming;
use hyper::server::conn::{http1, http2};
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio::time::{sleep, timeout};
use tokio_rustls::TlsAcceptor;
use tokio_rustls::server::TlsStream;
use tower::ServiceExt;

use super::base_path::BasePath;
use super::connection_places::PlaceHandle;
use super::error::Refusal;
use super::http2_streams::{MAX_STREAMS, MAX_UNSENT_BYTES, StreamExecutor, watch_answer};
use super::protect::set_security_headers;
use super::redirect;
use super::scheme::Encrypted;
use super::settings::HttpSettings;
use super::stall::StallGuard;
use super::tls::HTTP2;
use crate::shutdown::Shutdown;

/// First byte of a TLS connection: a record of the handshake. No HTTP request begins with it.
const TLS_HANDSHAKE: u8 = 0x16;

/// How clients reach a listener.
#[derive(Clone)]
pub enum Transport {
    /// Plain HTTP.
    Plain,
    /// HTTPS. A request in plain HTTP is redirected.
    Tls(TlsAcceptor),
}

/// The routes of a listener, and the path that they lie under.
#[derive(Clone)]
pub struct Site {
    /// The routes, without the path.
    pub routes: Router,
    /// The path, which is removed before a request reaches the routes.
    pub base_path: BasePath,
}

impl From<Router> for Site {
    fn from(routes: Router) -> Self {
        Self { routes, base_path: BasePath::default() }
    }
}

/// Limits on the time of a connection.
#[derive(Clone, Copy, Debug)]
pub struct ConnectionLimits {
    /// For the handshake, for the head of a request, and between two requests.
    pub head_timeout: Duration,
    /// For a client that reads nothing.
    pub write_timeout: Duration,
}

impl From<&HttpSettings> for ConnectionLimits {
    fn from(settings: &HttpSettings) -> Self {
        Self { head_timeout: settings.head_timeout(), write_timeout: settings.write_timeout() }
    }
}

/// How a connection ended.
pub type ConnectionResult = Result<(), Box<dyn Error + Send + Sync>>;

/// A connection that can carry requests.
enum OpenConnection {
    Plain(StallGuard<TcpStream>),
    /// Plain HTTP where HTTPS is expected.
    Misdirected(StallGuard<TcpStream>),
    Tls(Box<TlsStream<StallGuard<TcpStream>>>),
}

/// Serves the requests of one connection. Once `stop` begins, or a new connection takes its place, it finishes the open
/// ones and accepts no further ones.
pub async fn serve_connection(
    stream: TcpStream,
    peer: SocketAddr,
    place: PlaceHandle,
    transport: Transport,
    site: Site,
    limits: ConnectionLimits,
    stop: &Shutdown,
) -> ConnectionResult {
    let opening = timeout(limits.head_timeout, open(stream, transport, limits));
    let opened = tokio::select! {
        () = stop.begun() => return Ok(()),
        opened = opening => opened.map_err(|_| timed_out("the TLS handshake"))??,
    };
    let client = Client { peer, is_encrypted: matches!(opened, OpenConnection::Tls(_)), place };
    match opened {
        OpenConnection::Plain(stream) => run_http1(stream, client, site, limits, stop).await,
        OpenConnection::Misdirected(stream) => {
            run_http1(stream, client, Site::from(redirect::routes(None)), limits, stop).await
        }
        OpenConnection::Tls(stream) if stream.get_ref().1.alpn_protocol() == Some(HTTP2) => {
            run_http2(*stream, client, site, limits, stop).await
        }
        OpenConnection::Tls(stream) => run_http1(*stream, client, site, limits, stop).await,
    }
}

async fn open(stream: TcpStream, transport: Transport, limits: ConnectionLimits) -> io::Result<OpenConnection> {
    let Transport::Tls(acceptor) = transport else {
        return Ok(OpenConnection::Plain(StallGuard::new(stream, limits.write_timeout)));
    };
    let mut first = [0];
    let is_tls = stream.peek(&mut first).await? == 0 || first == [TLS_HANDSHAKE];
    let stream = StallGuard::new(stream, limits.write_timeout);
    if !is_tls {
        return Ok(OpenConnection::Misdirected(stream));
    }
    Ok(OpenConnection::Tls(Box::new(acceptor.accept(stream).await?)))
}

async fn run_http1<S: AsyncRead + AsyncWrite + Unpin + Send + 'static>(
    stream: S,
    client: Client,
    site: Site,
    limits: ConnectionLimits,
    stop: &Shutdown,
) -> ConnectionResult {
    let place = client.place.clone();
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(limits.head_timeout)
        .serve_connection(TokioIo::new(stream), service_fn(move |request| answer(site.clone(), &client, request)))
        .with_upgrades();
    let mut connection = pin!(connection);
    tokio::select! {
        ended = connection.as_mut() => return Ok(ended?),
        () = must_end(&place, stop) => {}
    }
    connection.as_mut().graceful_shutdown(); // finish the open request, accept no further one
    Ok(connection.await?)
}

async fn run_http2<S: AsyncRead + AsyncWrite + Unpin + Send + 'static>(
    stream: S,
    client: Client,
    site: Site,
    limits: ConnectionLimits,
    stop: &Shutdown,
) -> ConnectionResult {
    let place = client.place.clone();
    let streams = StreamExecutor::new(limits.write_timeout);
    let connection = http2::Builder::new(streams.clone())
        .max_concurrent_streams(MAX_STREAMS)
        .max_send_buf_size(MAX_UNSENT_BYTES)
        .serve_connection(TokioIo::new(stream), service_fn(move |request| answer(site.clone(), &client, request)));
    let mut connection = pin!(connection);
    let is_idle = tokio::select! {
        ended = connection.as_mut() => return Ok(ended?),
        () = streams.idle_for(limits.head_timeout) => true,
        () = must_end(&place, stop) => false,
    };
    connection.as_mut().graceful_shutdown(); // finish the open requests, accept no further ones
    if !is_idle {
        return Ok(connection.await?);
    }
    // A client may have sent requests before it learnt of the end. They are answered.
    let idle_again = async {
        sleep(limits.head_timeout).await;
        streams.idle_for(Duration::ZERO).await;
    };
    tokio::select! {
        ended = connection => Ok(ended?),
        () = idle_again => Err(timed_out("the end of the connection").into()),
    }
}

/// Resolves when the connection has to end in order.
async fn must_end(place: &PlaceHandle, stop: &Shutdown) {
    tokio::select! { () = stop.begun() => {}, () = place.replaced() => {} }
}

fn timed_out(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::TimedOut, format!("{what} took too long"))
}

/// The other end of a connection.
#[derive(Debug)]
struct Client {
    peer: SocketAddr,
    is_encrypted: bool,
    place: PlaceHandle,
}

type ResponseFuture = Pin<Box<dyn Future<Output = Result<Response, Infallible>> + Send>>;

/// Passes a request to the routes, with the client's address.
fn answer(site: Site, client: &Client, request: hyper::Request<Incoming>) -> ResponseFuture {
    let mut request: Request = request.map(Body::new);
    if !has_valid_host(&request) {
        return Box::pin(async { Ok(refuse_host()) });
    }
    if request.version() == Version::HTTP_2 {
        as_in_http1(&mut request);
    }
    let in_progress = client.place.begin_request();
    request.extensions_mut().insert(in_progress.clone());
    request.extensions_mut().insert(ConnectInfo(client.peer));
    if client.is_encrypted {
        request.extensions_mut().insert(Encrypted);
    }
    Box::pin(async move {
        match site.base_path.enter(request) {
            Ok(request) => site.routes.oneshot(request).await,
            Err(outside) => Ok(*outside),
        }
        .map(|answer| in_progress.answered_by(watch_answer(answer)))
    })
}

/// A request of HTTP/1.1 has one `Host`, an earlier one at most one (RFC 9112, section 3.2). In HTTP/2, `:authority`
/// names the host, and a `host` beside it is the same (RFC 9113, section 8.3.1). Of two, a proxy could use one and the
/// service the other.
fn has_valid_host(request: &Request) -> bool {
    let hosts = request.headers().get_all(header::HOST).iter().count();
    match request.version() {
        Version::HTTP_2 => {
            let stated = request.headers().get(header::HOST).map(HeaderValue::as_bytes);
            let authority = request.uri().authority().map(|authority| authority.as_str().as_bytes());
            let differ = stated.zip(authority).is_some_and(|(one, other)| !one.eq_ignore_ascii_case(other));
            hosts <= 1 && (hosts == 1 || authority.is_some()) && !differ
        }
        Version::HTTP_11 => hosts == 1,
        _ => hosts <= 1,
    }
}

fn refuse_host() -> Response {
    let refused = Refusal::BadRequest.with(
        "A request needs one Host header, with the name of this service. In HTTP/2 it is the same as `:authority`, or \
         absent.",
    );
    let mut response = refused.into_response();
    set_security_headers(&mut response);
    response
}

/// HTTP/2 has the host in the address (`:authority`). The handlers expect it in `Host`, as in HTTP/1.1.
fn as_in_http1(request: &mut Request) {
    let host = request.uri().authority().and_then(|authority| HeaderValue::from_str(authority.as_str()).ok());
    if let Some(host) = host {
        request.headers_mut().entry(header::HOST).or_insert(host);
    }
    if let Some(path) = request.uri().path_and_query().cloned() {
        *request.uri_mut() = Uri::from(path);
    }
}

#[cfg(test)]
mod tests {
    use axum::Extension;
    use axum::routing::get;
    use tokio::io::{AsyncReadExt, AsyncWriteExt};

    use super::*;
    use crate::domain::scope::Actor;
    use crate::http::connection_places::{ConnectionPlaces, RequestInProgress};
    use crate::ids::PersonId;

    #[tokio::test]
    async fn a_replaced_connection_sends_the_rest_of_its_answer() {
        const BODY: [u8; 4000] = [b'x'; 4000];
        let settings = HttpSettings { max_connections: 1, ..HttpSettings::default() };
        let (places, peer) = (ConnectionPlaces::new(&settings), SocketAddr::from(([192, 0, 2, 1], 4000)));
        let place = places.take(peer.ip()).await;
        let handle = place.handle();
        let serve = |Extension(request): Extension<RequestInProgress>| async move {
            request.caller_has_signed_in(Actor::Person(PersonId::at(0)));
            BODY.to_vec()
        };
        let site = Site::from(Router::new().route("/", get(serve)));
        let client = Client { peer, is_encrypted: false, place: handle.clone() };
        let (ours, mut theirs) = tokio::io::duplex(64);
        let served = tokio::spawn(async move {
            let ended = run_http1(ours, client, site, ConnectionLimits::from(&settings), &Shutdown::new()).await;
            drop(place);
            ended
        });
        theirs.write_all(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n").await.unwrap();
        let mut answer = vec![0; 12];
        theirs.read_exact(&mut answer).await.unwrap();
        let next = tokio::spawn(async move { places.take(peer.ip()).await });
        handle.replaced().await; // the client has not read the rest of the answer
        theirs.read_to_end(&mut answer).await.unwrap();
        assert!(answer.starts_with(b"HTTP/1.1 200") && answer.ends_with(&BODY), "{} bytes", answer.len());
        served.await.unwrap().unwrap();
        next.await.unwrap();
    }

    #[test]
    fn a_request_of_http2_names_one_host() {
        let is_valid = |address: &str, hosts: &[&str]| {
            let request = Request::builder().version(Version::HTTP_2).uri(address);
            let request = hosts.iter().fold(request, |request, host| request.header(header::HOST, *host));
            has_valid_host(&request.body(Body::empty()).unwrap())
        };
        assert!(is_valid("https://skills.example:8443/", &[]));
        assert!(is_valid("https://skills.example:8443/", &["Skills.example:8443"]));
        assert!(is_valid("/", &["skills.example"]));
        assert!(!is_valid("/", &[]));
        assert!(!is_valid("https://skills.example/", &["other.example"]));
        assert!(!is_valid("https://skills.example/", &["skills.example", "skills.example"]));
        assert!(!is_valid("/", &["skills.example", "other.example"]));
    }

    fn converted(address: &str, host: Option<&str>) -> (String, Option<String>) {
        let mut request = Request::builder().version(Version::HTTP_2).uri(address);
        if let Some(host) = host {
            request = request.header(header::HOST, host);
        }
        let mut request = request.body(Body::empty()).unwrap();
        as_in_http1(&mut request);
        let host = request.headers().get(header::HOST).map(|host| host.to_str().unwrap().to_owned());
        (request.uri().to_string(), host)
    }

    #[test]
    fn a_request_of_http2_looks_like_one_of_http1() {
        let whole = converted("https://skills.example:8443/api/v1/sessions?limit=1", None);
        assert_eq!(whole, ("/api/v1/sessions?limit=1".to_owned(), Some("skills.example:8443".to_owned())));
        let stated = converted("https://skills.example/", Some("skills.example"));
        assert_eq!(stated, ("/".to_owned(), Some("skills.example".to_owned())));
    }
}
