//! The real service on port 0 with a data folder of its own, and clients that speak to it as browsers and programs do.

use std::io;
use std::net::SocketAddr;
use std::path::Path;
use std::sync::{Arc, Mutex, Once};
use std::time::Duration;

use reqwest::header::{self, HeaderMap, HeaderName, HeaderValue};
use reqwest::{Method, RequestBuilder, Response, StatusCode};
use serde_json::{Value, json};
use tempfile::TempDir;
use trocar::commands::serve::{self, RunningService};
use trocar::domain::secret::Password;
use trocar::sandbox::Program;
use trocar::settings::Settings;
use trocar::time::{ManualClock, SharedClock, SystemClock};

/// The administrator's password that every test service starts with.
pub const ADMINISTRATOR: (&str, &str) = ("administrator", "correct horse battery");
/// Maximum wait of a test for an expected event.
pub const PATIENCE: Duration = Duration::from_secs(120);
/// Pause between two looks of a test that polls.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Real time between two steps of a manual clock. Shorter, and leases would expire before their holders can renew them.
const CLOCK_INTERVAL: Duration = Duration::from_millis(50);

/// A running service. Dropping it stops it and deletes its data.
pub struct Service {
    running: RunningService,
    /// The path that it lies under; usually empty.
    base_path: String,
    pub data: TempDir,
}

impl Service {
    /// A service without workers: jobs stay in the queue.
    pub async fn start() -> Self {
        Self::start_with(|_| ()).await
    }

    /// The same with changed settings.
    pub async fn start_with(change: impl FnOnce(&mut Settings)) -> Self {
        Self::start_in(tempfile::tempdir().unwrap(), Arc::new(SystemClock), change).await
    }

    /// The same with another clock.
    pub async fn start_with_clock(clock: SharedClock) -> Self {
        Self::start_in(tempfile::tempdir().unwrap(), clock, |_| ()).await
    }

    /// A service on a data folder that may hold something already.
    pub async fn start_in(data: TempDir, clock: SharedClock, change: impl FnOnce(&mut Settings)) -> Self {
        let mut settings = Settings { data: data.path().to_owned(), ..Settings::default() };
        settings.listen = "127.0.0.1:0".parse().unwrap();
        change(&mut settings);
        let base_path = settings.http.base_path.to_string();
        let password = Password::new(ADMINISTRATOR.1).unwrap();
        let child = Program::at(env!("CARGO_BIN_EXE_trocar"), &["child"]);
        let running = serve::start(settings, clock, &password, child).await.expect("the service starts");
        Self { running, base_path, data }
    }

    /// Stops the service in order and returns its data folder, for another start.
    pub async fn stop(self) -> TempDir {
        self.running.shutdown.begin();
        self.running.ended().await;
        self.data
    }

    /// The address that the service listens on.
    pub fn address(&self) -> SocketAddr {
        self.running.address
    }

    /// The address whose requests are redirected to HTTPS.
    pub fn redirect_address(&self) -> Option<SocketAddr> {
        self.running.redirect_address
    }

    /// A client that has not signed in.
    pub fn stranger(&self) -> Client {
        Client::of(format!("http://{}{}", self.address(), self.base_path))
    }

    /// The first administrator, signed in.
    pub async fn administrator(&self) -> Client {
        self.sign_in(ADMINISTRATOR.0, ADMINISTRATOR.1).await
    }

    /// A client that is signed in by cookie.
    pub async fn sign_in(&self, login: &str, password: &str) -> Client {
        self.stranger().signed_in(login, password).await
    }
}

static LOG: Mutex<Vec<u8>> = Mutex::new(Vec::new());

/// Appends to [`LOG`].
struct LogWriter;

impl io::Write for LogWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        LOG.lock().unwrap().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Warnings and errors in the log of all threads of this process since the first call.
pub fn captured_log() -> String {
    static START: Once = Once::new();
    START.call_once(|| {
        let log = tracing_subscriber::fmt().with_max_level(tracing::Level::WARN).with_ansi(false);
        log.with_writer(|| LogWriter).init();
    });
    String::from_utf8_lossy(&LOG.lock().unwrap()).into_owned()
}

/// An HTTP client of the service.
#[derive(Clone)]
pub struct Client {
    http: reqwest::Client,
    base: String,
    headers: HeaderMap,
}

impl Client {
    /// A client of the service at this address, not signed in.
    pub fn of(base: String) -> Self {
        let http = reqwest::Client::builder().redirect(reqwest::redirect::Policy::none()).build().unwrap();
        Self { http, base, headers: HeaderMap::new() }
    }

    /// The same, signed in by cookie.
    pub async fn signed_in(self, login: &str, password: &str) -> Self {
        let answer = self.post("/api/v1/sign-in", json!({"login": login, "password": password})).await;
        assert_eq!(answer.status(), StatusCode::OK, "{login} signs in");
        self.with_cookie_of(&answer)
    }

    /// The same with the cookie of a sign-in that this answer sets.
    pub fn with_cookie_of(mut self, answer: &Response) -> Self {
        let cookie = answer.headers()[header::SET_COOKIE].to_str().unwrap();
        let pair = cookie.split(';').next().unwrap();
        self.headers.insert(header::COOKIE, HeaderValue::from_str(pair).unwrap());
        self
    }

    /// The same with another header in each request.
    pub fn with(mut self, name: &'static str, value: &str) -> Self {
        self.headers.insert(HeaderName::from_static(name), HeaderValue::from_str(value).unwrap());
        self
    }

    /// The same client, signed in by token instead of by cookie.
    pub fn with_token(mut self, token: &str) -> Self {
        self.headers.remove(header::COOKIE);
        self.with("authorization", &format!("Bearer {token}"))
    }

    /// The text of the sign-in cookie.
    pub fn cookie(&self) -> String {
        self.headers[header::COOKIE].to_str().unwrap().to_owned()
    }

    /// The headers of each request.
    pub fn headers(&self) -> &HeaderMap {
        &self.headers
    }

    /// A request that the caller completes. `path` may be a whole address, or begin with the path that the service lies
    /// under, as in `Location`.
    pub fn request(&self, method: Method, path: &str) -> RequestBuilder {
        let base: reqwest::Url = self.base.parse().unwrap();
        let below = path.strip_prefix(base.path().trim_end_matches('/')).filter(|rest| rest.starts_with('/'));
        let address = match path.starts_with("http") {
            true => path.to_owned(),
            false => format!("{}{}", self.base, below.unwrap_or(path)),
        };
        self.http.request(method, address).headers(self.headers.clone())
    }

    pub async fn get(&self, path: &str) -> Response {
        self.request(Method::GET, path).send().await.unwrap()
    }

    pub async fn head(&self, path: &str) -> Response {
        self.request(Method::HEAD, path).send().await.unwrap()
    }

    pub async fn delete(&self, path: &str) -> Response {
        self.request(Method::DELETE, path).send().await.unwrap()
    }

    pub async fn post(&self, path: &str, body: Value) -> Response {
        self.request(Method::POST, path).json(&body).send().await.unwrap()
    }

    pub async fn patch(&self, path: &str, body: Value) -> Response {
        self.request(Method::PATCH, path).json(&body).send().await.unwrap()
    }

    pub async fn put(&self, path: &str, body: Value) -> Response {
        self.request(Method::PUT, path).json(&body).send().await.unwrap()
    }

    /// Gets JSON; the status must be 200.
    pub async fn read(&self, path: &str) -> Value {
        read(self.get(path).await, StatusCode::OK).await
    }

    /// Polls until the JSON at this path is as wanted.
    pub async fn read_until(&self, path: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        poll_json(path, async || self.read(path).await, wanted).await
    }

    /// Posts JSON; the status must be 201. Returns the answer's JSON.
    pub async fn make(&self, path: &str, body: Value) -> Value {
        read(self.post(path, body).await, StatusCode::CREATED).await
    }
}

/// The JSON of an answer that must have this status.
pub async fn read(answer: Response, status: StatusCode) -> Value {
    let (address, actual) = (answer.url().clone(), answer.status());
    let text = answer.text().await.unwrap();
    assert_eq!(actual, status, "{address}: {text}");
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{address}: {e}: {text}"))
}

/// A problem document that must have this status and type.
pub async fn problem(answer: Response, status: u16, slug: &str) -> Value {
    let kind = answer.headers().get(header::CONTENT_TYPE).map(|v| v.to_str().unwrap().to_owned());
    let document = read(answer, StatusCode::from_u16(status).unwrap()).await;
    assert_eq!(kind.as_deref(), Some("application/problem+json"));
    assert_eq!(document["type"], format!("/problems/{slug}"), "{document}");
    assert_eq!(document["status"], status);
    assert!(document["detail"].as_str().unwrap().len() > 20, "the detail says what to do: {document}");
    assert!(document["errors"].is_array(), "{document}");
    document
}

/// Waits for a future that must end within [`PATIENCE`].
pub async fn soon<T>(what: &str, future: impl Future<Output = T>) -> T {
    tokio::time::timeout(PATIENCE, future).await.unwrap_or_else(|_| panic!("{what} did not happen in {PATIENCE:?}"))
}

/// Polls until `look` returns a value.
pub async fn poll<T>(what: &str, look: impl AsyncFnMut() -> Option<T>) -> T {
    poll_or_give_up(look).await.unwrap_or_else(|| panic!("{what} did not happen in {PATIENCE:?}"))
}

/// Polls until a condition holds.
pub async fn poll_until(what: &str, mut holds: impl FnMut() -> bool) {
    poll(what, async || holds().then_some(())).await;
}

/// Polls until the JSON that `read` returns is as wanted. A failure shows the last JSON.
pub async fn poll_json(what: &str, mut read: impl AsyncFnMut() -> Value, wanted: impl Fn(&Value) -> bool) -> Value {
    let mut last = Value::Null;
    let found = poll_or_give_up(async || {
        last = read().await;
        wanted(&last).then_some(())
    });
    assert!(found.await.is_some(), "{what} is still {last}");
    last
}

/// `None` if `look` returns nothing within [`PATIENCE`].
async fn poll_or_give_up<T>(mut look: impl AsyncFnMut() -> Option<T>) -> Option<T> {
    let poll = async {
        loop {
            if let Some(found) = look().await {
                return found;
            }
            tokio::time::sleep(POLL_INTERVAL).await;
        }
    };
    tokio::time::timeout(PATIENCE, poll).await.ok()
}

/// Runs a future to its end while a manual clock advances by `step` again and again.
pub async fn with_advancing_clock<T>(clock: &ManualClock, step: Duration, future: impl Future<Output = T>) -> T {
    let advance = async {
        loop {
            tokio::time::sleep(CLOCK_INTERVAL).await;
            clock.advance(step);
        }
    };
    tokio::select! {
        result = future => result,
        () = advance => unreachable!("the clock advances for ever"),
    }
}

/// Lets real time pass, for what cannot be polled: the random moment of a kill, the pace of a slow client or of a load,
/// the length of a measurement, and something that must not happen. All other tests poll.
pub async fn let_time_pass(time: Duration) {
    tokio::time::sleep(time).await;
}

#[test]
fn only_the_helpers_above_sleep() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/integration");
    let (mut folders, mut read, mut sleeping) = (vec![here.clone()], 0, Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                read += 1;
                if std::fs::read_to_string(&path).unwrap().contains("::sleep") {
                    sleeping.push(path.strip_prefix(&here).unwrap().to_owned());
                }
            }
        }
    }
    assert!(read > 50, "{read} files were read");
    assert_eq!(sleeping, [Path::new("support.rs")], "poll, or wait with `let_time_pass`");
}
