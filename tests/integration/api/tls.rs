//! HTTPS of the service itself: HTTP/2, WebSockets, limits on time, a new certificate, redirects.

use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use http_body_util::{BodyExt, Full};
use hyper::body::{Bytes, Incoming};
use hyper::client::conn::{http1, http2};
use hyper_util::rt::{TokioExecutor, TokioIo};
use reqwest::{Method, StatusCode, header};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, ServerName};
use serde_json::{Value, json};
use tempfile::TempDir;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use trocar::settings::Settings;
use trocar::time::{ManualClock, SharedClock, SystemClock};

use crate::process::Process;
use crate::support::{
    ADMINISTRATOR, Client, Service, captured_log, let_time_pass, poll, poll_until, soon, with_advancing_clock,
};

/// Timeouts of a service whose test waits for them.
const SHORT: Duration = Duration::from_millis(300);
/// The connection's protocol, as the handshake names it.
const HTTP1: &[u8] = b"http/1.1";
const HTTP2: &[u8] = b"h2";
/// Interval at which the service looks at its certificate, and more.
const CHECK_INTERVAL: Duration = Duration::from_secs(11);

type Request = hyper::Request<Full<Bytes>>;

/// The administrator's password after the first sign-in.
const OWN_PASSWORD: &str = "a password of one's own";

/// A service with a certificate for `localhost`.
struct SecureService {
    service: Service,
    files: TempDir,
}

impl SecureService {
    /// `None` without the program that makes certificates; the test is then reported as skipped.
    async fn start(clock: SharedClock, change: impl FnOnce(&mut Settings)) -> Option<Self> {
        if !has_openssl() {
            return None;
        }
        let files = tempfile::tempdir().unwrap();
        make_certificate(files.path(), "current");
        let (certificate, key) = pair(files.path(), "current");
        let with_certificate = |settings: &mut Settings| {
            settings.tls.certificate = Some(certificate);
            settings.tls.key = Some(key);
            change(settings);
        };
        let service = Service::start_in(tempfile::tempdir().unwrap(), clock, with_certificate).await;
        let secure = Self { service, files };
        secure.choose_a_password().await;
        Some(secure)
    }

    /// Browsers may do nothing else before it.
    async fn choose_a_password(&self) {
        let mut sender = self.http2(65_535).await;
        let host = format!("https://{}", self.host());
        let cookie = cookie_of(&sender.send_request(self.sign_in_with(ADMINISTRATOR.1, &host)).await.unwrap());
        let change = json!({"old": ADMINISTRATOR.1, "new": OWN_PASSWORD});
        let change = self.request(Method::POST, "/api/v1/me/password", Some(&cookie), Some(change));
        assert_eq!(sender.send_request(change).await.unwrap().status(), StatusCode::NO_CONTENT);
    }

    fn host(&self) -> String {
        format!("localhost:{}", self.service.address().port())
    }

    /// Connects, and trusts only the certificate of this name.
    async fn connect(&self, trusted: &str, protocol: &[u8]) -> io::Result<TlsStream<TcpStream>> {
        connect(self.service.address(), &pair(self.files.path(), trusted).0, protocol).await
    }

    async fn http2(&self, window: u32) -> http2::SendRequest<Full<Bytes>> {
        begin_http2(self.connect("current", HTTP2).await.unwrap(), window).await
    }

    fn request(&self, method: Method, path: &str, cookie: Option<&str>, body: Option<Value>) -> Request {
        let mut request = hyper::Request::builder().method(method).uri(format!("https://{}{path}", self.host()));
        if let Some(cookie) = cookie {
            request = request.header(header::COOKIE, cookie);
        }
        let body = body.map(|body| body.to_string()).unwrap_or_default();
        request.header(header::CONTENT_TYPE, "application/json").body(Full::from(body)).unwrap()
    }

    fn sign_in(&self, origin: &str) -> Request {
        self.sign_in_with(OWN_PASSWORD, origin)
    }

    fn sign_in_with(&self, password: &str, origin: &str) -> Request {
        let body = json!({"login": ADMINISTRATOR.0, "password": password});
        let mut request = self.request(Method::POST, "/api/v1/sign-in", None, Some(body));
        request.headers_mut().insert(header::ORIGIN, origin.parse().unwrap());
        request
    }
}

/// Whether certificates can be made. Otherwise the test is reported as skipped.
fn has_openssl() -> bool {
    let is_there = Command::new("openssl").arg("version").output().is_ok();
    if !is_there {
        crate::resources::skip("openssl; `make test` installs it");
    }
    is_there
}

/// Connects, and trusts only this certificate.
async fn connect(address: SocketAddr, trusted: &Path, protocol: &[u8]) -> io::Result<TlsStream<TcpStream>> {
    let mut roots = rustls::RootCertStore::empty();
    roots.add(CertificateDer::from_pem_file(trusted).unwrap()).unwrap();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let client = rustls::ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions().unwrap();
    let mut client = client.with_root_certificates(roots).with_no_client_auth();
    client.alpn_protocols = vec![protocol.to_vec()];
    let wire = TcpStream::connect(address).await?;
    TlsConnector::from(Arc::new(client)).connect(ServerName::try_from("localhost").unwrap(), wire).await
}

/// Begins HTTP/2. The service may send `window` bytes of each answer before the client has read some of it.
async fn begin_http2(stream: TlsStream<TcpStream>, window: u32) -> http2::SendRequest<Full<Bytes>> {
    assert_eq!(stream.get_ref().1.alpn_protocol(), Some(HTTP2));
    let mut builder = http2::Builder::new(TokioExecutor::new());
    builder.initial_stream_window_size(window);
    let (sender, connection) = builder.handshake(TokioIo::new(stream)).await.unwrap();
    tokio::spawn(connection);
    sender
}

fn pair(folder: &Path, name: &str) -> (PathBuf, PathBuf) {
    (folder.join(format!("{name}.pem")), folder.join(format!("{name}.key")))
}

/// Makes a certificate for `localhost` that is its own issuer.
fn make_certificate(folder: &Path, name: &str) {
    let (certificate, key) = pair(folder, name);
    let config = folder.join("openssl.cnf");
    let extensions = "basicConstraints = CA:FALSE\nsubjectAltName = DNS:localhost\n";
    std::fs::write(
        &config,
        format!("[req]\ndistinguished_name = name\nx509_extensions = extensions\n[name]\n[extensions]\n{extensions}"),
    )
    .unwrap();
    let made = Command::new("openssl")
        .args(["req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2"])
        .args(["-subj", &format!("/CN={name}"), "-config"])
        .args([&config, Path::new("-out"), &certificate, Path::new("-keyout"), &key])
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
}

fn cookie_of(answer: &hyper::Response<Incoming>) -> String {
    answer.headers()[header::SET_COOKIE].to_str().unwrap().split(';').next().unwrap().to_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn http2_carries_requests_beside_an_event_stream_until_the_service_stops() {
    let Some(secure) = SecureService::start(Arc::new(SystemClock), |_| ()).await else { return };
    let mut sender = secure.http2(65_535).await;
    let foreign = sender.send_request(secure.sign_in("https://evil.example")).await.unwrap();
    assert_eq!(foreign.status(), StatusCode::FORBIDDEN);
    let own = sender.send_request(secure.sign_in(&format!("https://{}", secure.host()))).await.unwrap();
    assert_eq!((own.status(), own.version()), (StatusCode::OK, hyper::Version::HTTP_2));
    assert_eq!(own.headers()[header::STRICT_TRANSPORT_SECURITY], "max-age=31536000");
    let cookie = cookie_of(&own);
    let asked = secure.request(Method::GET, "/api/v1/events", Some(&cookie), None);
    let mut events = sender.send_request(asked).await.unwrap();
    let first = soon("the first event", events.frame()).await.unwrap().unwrap().into_data().unwrap();
    assert!(first.starts_with(b"event: queue"), "{first:?}");
    let beside = secure.request(Method::GET, "/api/v1/me", Some(&cookie), None);
    assert_eq!(sender.send_request(beside).await.unwrap().status(), StatusCode::OK);
    let ((), _) = tokio::join!(
        async { while let Some(Ok(_)) = soon("the end of the stream", events.frame()).await {} },
        soon("the end of the service", secure.service.stop()),
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn http1_and_websockets_work_over_tls() {
    let Some(secure) = SecureService::start(Arc::new(SystemClock), |_| ()).await else { return };
    let stream = secure.connect("current", HTTP1).await.unwrap();
    let (mut sender, connection) = http1::handshake(TokioIo::new(stream)).await.unwrap();
    tokio::spawn(connection);
    let mut request = secure.sign_in(&format!("https://{}", secure.host()));
    request.headers_mut().insert(header::HOST, secure.host().parse().unwrap());
    *request.uri_mut() = "/api/v1/sign-in".parse().unwrap();
    let signed_in = sender.send_request(request).await.unwrap();
    assert_eq!((signed_in.status(), signed_in.version()), (StatusCode::OK, hyper::Version::HTTP_11));
    let cookie = cookie_of(&signed_in);
    let mut h2 = secure.http2(65_535).await;
    let made = secure.request(Method::POST, "/api/v1/boxes", Some(&cookie), Some(json!({"name": "Box 1"})));
    assert_eq!(h2.send_request(made).await.unwrap().status(), StatusCode::CREATED);

    let mut upgrade = format!("wss://{}/api/v1/boxes/box-1/feed", secure.host()).into_client_request().unwrap();
    upgrade.headers_mut().insert(header::COOKIE, cookie.parse().unwrap());
    let stream = secure.connect("current", HTTP1).await.unwrap();
    let (_, answer) = tokio_tungstenite::client_async(upgrade, stream).await.expect("the feed is a WebSocket");
    assert_eq!(answer.status(), StatusCode::SWITCHING_PROTOCOLS);
}

#[tokio::test(flavor = "multi_thread")]
async fn silent_clients_are_disconnected() {
    let short = |settings: &mut Settings| settings.http.head_timeout_s = SHORT.as_secs_f64();
    let Some(secure) = SecureService::start(Arc::new(SystemClock), short).await else { return };
    let mut silent = TcpStream::connect(secure.service.address()).await.unwrap();
    let mut begun = TcpStream::connect(secure.service.address()).await.unwrap();
    begun.write_all(&[0x16, 3, 1]).await.unwrap();
    let mut plain = TcpStream::connect(secure.service.address()).await.unwrap();
    plain.write_all(b"GET /").await.unwrap();
    let mut http1 = secure.connect("current", HTTP1).await.unwrap();
    let mut http2 = secure.connect("current", HTTP2).await.unwrap();
    for wire in [&mut silent, &mut begun, &mut plain] {
        // The end, or a reset: the service has not read all that arrived.
        let _ = soon("the end of a handshake", wire.read_to_end(&mut Vec::new())).await;
    }
    for wire in [&mut http1, &mut http2] {
        let _ = soon("the end of a connection", wire.read_to_end(&mut Vec::new())).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn silent_and_idle_clients_leave_places_for_others() {
    let few = |settings: &mut Settings| settings.http.max_connections = 8;
    let Some(secure) = SecureService::start(Arc::new(SystemClock), few).await else { return };
    let mut watching = secure.http2(65_535).await;
    let signed_in = watching.send_request(secure.sign_in(&format!("https://{}", secure.host()))).await.unwrap();
    let cookie = cookie_of(&signed_in);
    let asked = secure.request(Method::GET, "/api/v1/events", Some(&cookie), None);
    let events = watching.send_request(asked).await.unwrap();
    let (mut silent, mut idle) = (Vec::new(), Vec::new());
    for _ in 0..20 {
        silent.push(TcpStream::connect(secure.service.address()).await.unwrap());
        idle.push(secure.http2(65_535).await);
    }
    let me = || secure.request(Method::GET, "/api/v1/me", Some(&cookie), None);
    let other = async { secure.http2(65_535).await.send_request(me()).await.unwrap().status() };
    let status = tokio::time::timeout(Duration::from_secs(1), other).await.expect("an answer within a second");
    assert_eq!(status, StatusCode::OK);
    let beside = watching.send_request(me()).await.unwrap().status();
    assert_eq!(beside, StatusCode::OK, "the connection with an event stream was not closed");
    drop((events, silent, idle));
}

/// A frame of HTTP/2.
fn frame(kind: u8, flags: u8, stream: u8, payload: &[u8]) -> Vec<u8> {
    let length = u32::try_from(payload.len()).unwrap().to_be_bytes();
    [&length[1..], &[kind, flags, 0, 0, 0, stream], payload].concat()
}

/// Reads frames of HTTP/2 until one of this kind.
async fn read_frame(wire: &mut TlsStream<TcpStream>, kind: u8) {
    let mut head = [0; 9];
    while head[3] != kind {
        wire.read_exact(&mut head).await.unwrap();
        let length = u32::from_be_bytes([0, head[0], head[1], head[2]]);
        wire.read_exact(&mut vec![0; length as usize]).await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_request_that_crosses_the_end_of_an_idle_connection_is_answered() {
    const DATA: u8 = 0;
    const HEADERS: u8 = 1;
    const SETTINGS: u8 = 4;
    const GOAWAY: u8 = 7;
    let short = |settings: &mut Settings| settings.http.head_timeout_s = SHORT.as_secs_f64();
    let Some(secure) = SecureService::start(Arc::new(SystemClock), short).await else { return };
    let mut wire = secure.connect("current", HTTP2).await.unwrap();
    let begin = [b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".as_slice(), &frame(SETTINGS, 0, 0, &[])].concat();
    wire.write_all(&begin).await.unwrap();
    soon("the end of an idle connection", read_frame(&mut wire, GOAWAY)).await;
    let (post, https) = (0x83, 0x87); // the table of RFC 7541, appendix A
    let mut head = vec![post, https];
    let (path, authority, content_type): (&[u8], &[u8], &[u8]) = (&[0x04], &[0x01], &[0x0f, 0x10]);
    let host = secure.host();
    for (name, value) in [(path, "/api/v1/sign-in"), (authority, host.as_str()), (content_type, "application/json")] {
        head.extend([name, &[value.len() as u8], value.as_bytes()].concat());
    }
    wire.write_all(&frame(HEADERS, 0x4, 1, &head)).await.unwrap(); // the end of the head
    let_time_pass(2 * SHORT).await;
    wire.write_all(&frame(DATA, 0x1, 1, b"{}")).await.unwrap(); // the end of the body
    soon("the answer", read_frame(&mut wire, HEADERS)).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_answer_that_nothing_reads_is_reset_and_other_requests_go_on() {
    let short = |settings: &mut Settings| settings.http.write_timeout_s = SHORT.as_secs_f64();
    let Some(secure) = SecureService::start(Arc::new(SystemClock), short).await else { return };
    let mut sender = secure.http2(1024).await;
    let document = || secure.request(Method::GET, "/api/v1/openapi.json", None, None);
    let read = sender.send_request(document()).await.unwrap().into_body().collect().await.unwrap().to_bytes();
    assert!(read.len() > 128 << 10, "longer than what waits in buffers: {} bytes", read.len());
    let unread = sender.send_request(document()).await.unwrap();
    let_time_pass(2 * SHORT).await;
    // hyper's client takes the reset of a stream for the end of its body.
    let received = unread.into_body().collect().await.map_or(0, |body| body.to_bytes().len());
    assert!(received < read.len(), "the stream was reset");
    let again = sender.send_request(document()).await.unwrap().into_body().collect().await.unwrap().to_bytes();
    assert_eq!(again, read);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_new_certificate_is_used_once_its_key_is_there() {
    let clock = ManualClock::at(1_795_000_000_000);
    let Some(secure) = SecureService::start(clock.clone(), |_| ()).await else { return };
    let mut open = secure.http2(65_535).await;
    let folder = secure.files.path();
    for name in ["old", "new"] {
        make_certificate(folder, name);
    }
    let ((current, current_key), (old, _), (new, new_key)) =
        (pair(folder, "current"), pair(folder, "old"), pair(folder, "new"));
    std::fs::copy(&current, &old).unwrap();
    std::fs::copy(&new, &current).unwrap();
    with_advancing_clock(&clock, CHECK_INTERVAL, let_time_pass(SHORT)).await;
    secure.connect("old", HTTP1).await.expect("the earlier certificate stays in use");
    std::fs::copy(&new_key, &current_key).unwrap();
    let renewed = poll("the new certificate", async || secure.connect("new", HTTP1).await.ok());
    with_advancing_clock(&clock, CHECK_INTERVAL, renewed).await;
    let request = secure.request(Method::GET, "/readyz", None, None);
    assert_eq!(open.send_request(request).await.unwrap().status(), StatusCode::OK, "open connections stay");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_log_warns_of_a_certificate_that_expires_soon() {
    captured_log();
    let Some(secure) = SecureService::start(Arc::new(SystemClock), |_| ()).await else { return };
    let certificate = secure.files.path().display().to_string();
    let is_warning = |line: &str| line.contains(&certificate) && line.contains("expires in less than 14 days");
    poll_until("the warning", || captured_log().lines().any(is_warning)).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn plain_http_is_redirected() {
    let redirect = |settings: &mut Settings| settings.tls.redirect_listen = "127.0.0.1:0".parse().ok();
    let Some(secure) = SecureService::start(Arc::new(SystemClock), redirect).await else { return };
    let other = secure.service.redirect_address().unwrap();
    for address in [secure.service.address(), other] {
        let answer = Client::of(format!("http://{address}")).get("/sessions?limit=1").await;
        assert_eq!(answer.status(), StatusCode::PERMANENT_REDIRECT);
        let expected = format!("https://{}/sessions?limit=1", secure.service.address());
        assert_eq!(answer.headers()[header::LOCATION], expected.as_str());
        assert!(!answer.headers().contains_key(header::STRICT_TRANSPORT_SECURITY));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn strangers_who_read_no_answer_take_little_memory() {
    const CONNECTIONS: usize = 20;
    const STREAMS: usize = 32;
    const MAX_GROWTH_KIB: u64 = 64 << 10; // with a compressor for each answer it would be 190 MiB
    if !has_openssl() {
        return;
    }
    let files = tempfile::tempdir().unwrap();
    make_certificate(files.path(), "current");
    let (certificate, key) = pair(files.path(), "current");
    let service = Process::launch(&files.path().join("data"), |command| {
        command.env("TROCAR_TLS__CERTIFICATE", &certificate).env("TROCAR_TLS__KEY", &key);
    });
    let (_, port) = service.address.rsplit_once(':').unwrap();
    let address = SocketAddr::from(([127, 0, 0, 1], port.parse().unwrap()));
    let resident_kib = || service.status("VmRSS").parse::<u64>().unwrap();
    let (mut senders, mut unread, mut before) = (Vec::new(), Vec::new(), 0);
    for connection in 0..=CONNECTIONS {
        let mut sender = begin_http2(connect(address, &certificate, HTTP2).await.unwrap(), 0).await;
        for stream in 0..STREAMS {
            let path = ["api/v1/openapi.json", "app.js", "docs/swagger-ui.css"][stream % 3];
            let request = hyper::Request::get(format!("https://localhost:{port}/{path}"));
            let request = request.header(header::ACCEPT_ENCODING, "gzip").body(Full::default()).unwrap();
            sender.ready().await.unwrap();
            let answer = soon("the head of an answer", sender.send_request(request)).await.unwrap();
            assert_eq!(
                (answer.status(), answer.headers()[header::CONTENT_ENCODING].as_bytes()),
                (StatusCode::OK, &b"gzip"[..])
            );
            unread.push(answer);
        }
        senders.push(sender);
        if connection == 0 {
            before = resident_kib();
        }
    }
    let grown = resident_kib().saturating_sub(before);
    assert!(grown <= MAX_GROWTH_KIB, "{} unread answers took {grown} KiB", unread.len());
}
