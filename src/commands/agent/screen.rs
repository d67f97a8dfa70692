//! The page for the box's own screen, served to this computer only: who trains, what runs, the last result, start and stop.
//!
//! It has no sign-in, because the person in front of the box is the one who may use it. So it listens on the loopback
//! address alone, answers only requests to that address (a page of the internet could otherwise reach it under a name that
//! it points here), and changes something only at the word of its own page.

use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

use axum::Router;
use axum::body::Bytes;
use axum::extract::{DefaultBodyLimit, Query, Request, State};
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use serde::Deserialize;
use serde_json::json;
use tokio::net::TcpListener;
use tokio::time::timeout;

use crate::capture::standby::Standby;
use crate::capture::standby::recording::StartPress;
use crate::capture::standby::refusal::{BoxRefusal, ShownRefusal};
use crate::http::dashboard::public_file;
use crate::shutdown::Shutdown;

/// The page, below `static/`.
const PAGE: &str = "box_screen/index.html";
/// Longest body of a request, bytes.
const MAX_BODY_BYTES: usize = 2048;
/// How long a request for the state waits for a change.
const WAIT_FOR_CHANGE: Duration = Duration::from_secs(5);
/// What the page may load: only what this server has.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Settings of the page.
#[derive(Clone, Debug)]
pub(super) struct ScreenSettings {
    /// The port.
    pub(super) port: u16,
    /// The key that starts and stops, as `KeyboardEvent.code` names it.
    pub(super) key: String,
    /// The language of the page; `None`: that of its browser.
    pub(super) language: Option<ScreenLanguage>,
}

/// A language of the page.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum ScreenLanguage {
    /// English.
    En,
    /// German.
    De,
}

impl ScreenLanguage {
    /// Its tag.
    pub(super) fn tag(self) -> &'static str {
        match self {
            Self::En => "en",
            Self::De => "de",
        }
    }
}

/// The page's server.
pub(super) struct Screen {
    listener: TcpListener,
    address: SocketAddr,
    settings: ScreenSettings,
}

#[derive(Clone)]
struct ScreenApp {
    standby: Standby,
    address: SocketAddr,
    key: String,
    language: Option<ScreenLanguage>,
}

impl Screen {
    /// Listens on the loopback address.
    pub(super) async fn bind(settings: ScreenSettings) -> std::io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, settings.port)).await?;
        let address = listener.local_addr()?;
        tracing::info!("the page of the box's screen: http://{address}/");
        Ok(Self { listener, address, settings })
    }

    /// Serves the page until the shutdown.
    pub(super) async fn serve(self, standby: Standby, shutdown: Shutdown) {
        let ScreenSettings { key, language, .. } = self.settings;
        let app = ScreenApp { standby, address: self.address, key, language };
        let routes = Router::new()
            .route("/state", get(state))
            .route("/start", post(start))
            .route("/stop", post(stop))
            .route("/check-in", post(check_in))
            .route("/check-out", post(check_out))
            .route("/task", post(choose_task))
            .fallback(get(file))
            .layer(DefaultBodyLimit::max(MAX_BODY_BYTES))
            .layer(from_fn_with_state(app.clone(), protect))
            .with_state(app);
        let served = axum::serve(self.listener, routes).with_graceful_shutdown(shutdown.begun());
        if let Err(error) = served.await {
            tracing::error!(%error, "the page of the box's screen is not served any more");
        }
    }
}

/// Refuses requests to another host, and changes that another page requests.
async fn protect(State(app): State<ScreenApp>, request: Request, next: Next) -> Response {
    let headers = request.headers();
    if !is_own_host(headers, app.address) || (request.method() != Method::GET && !is_own_page(headers)) {
        return (StatusCode::FORBIDDEN, "Open the page of the box on the box's own computer.\n").into_response();
    }
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
    ] {
        headers.insert(name, header::HeaderValue::from_static(value));
    }
    response
}

fn is_own_host(headers: &HeaderMap, address: SocketAddr) -> bool {
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
    [format!("127.0.0.1:{}", address.port()), format!("localhost:{}", address.port())].iter().any(|own| own == host)
}

/// JSON from a page of this server: another page cannot send it without asking first, and is refused then.
fn is_own_page(headers: &HeaderMap) -> bool {
    let text = |name| headers.get(name).and_then(|value: &header::HeaderValue| value.to_str().ok());
    let is_json = text(header::CONTENT_TYPE).is_some_and(|kind| kind.starts_with("application/json"));
    let host = text(header::HOST).unwrap_or_default();
    let is_same = text(header::ORIGIN).is_none_or(|origin| origin == format!("http://{host}"));
    is_json && is_same
}

/// What the page knows already.
#[derive(Deserialize)]
struct StateQuery {
    #[serde(default)]
    after: Option<u64>,
}

async fn state(State(app): State<ScreenApp>, Query(known): Query<StateQuery>) -> Response {
    if let Some(version) = known.after {
        let _ = timeout(WAIT_FOR_CHANGE, app.standby.changed_since(version)).await; // then the state as it is
    }
    let mut state = json!(app.standby.screen_state());
    state["key"] = json!(app.key);
    axum::Json(state).into_response()
}

/// Which button was pressed.
#[derive(Deserialize)]
struct PressedStart {
    /// True for the button that starts a recording without a name.
    #[serde(default)]
    without_name: bool,
    /// True to begin with the first movement in the picture.
    #[serde(default)]
    on_movement: bool,
}

async fn start(State(app): State<ScreenApp>, body: Bytes) -> Response {
    let press = match serde_json::from_slice(&body) {
        Ok(PressedStart { without_name: false, on_movement: false }) => StartPress::Start,
        Ok(PressedStart { without_name: false, on_movement: true }) => StartPress::OnMovement,
        Ok(PressedStart { without_name: true, on_movement: false }) => StartPress::WithoutName,
        Ok(_) | Err(_) => return StatusCode::BAD_REQUEST.into_response(),
    };
    answer(app.standby.start_at_box(press))
}

async fn stop(State(app): State<ScreenApp>) -> Response {
    answer(app.standby.stop().await)
}

/// Code and PIN, as typed.
#[derive(Deserialize)]
struct TypedPin {
    trainee: String,
    pin: String,
}

async fn check_in(State(app): State<ScreenApp>, body: Bytes) -> Response {
    let Ok(TypedPin { trainee, pin }) = serde_json::from_slice(&body) else {
        return StatusCode::BAD_REQUEST.into_response();
    };
    match app.standby.check_in(trainee, pin) {
        true => StatusCode::NO_CONTENT.into_response(),
        false => answer(Err(BoxRefusal::NotConnected)),
    }
}

async fn check_out(State(app): State<ScreenApp>) -> Response {
    app.standby.check_out();
    StatusCode::NO_CONTENT.into_response()
}

/// The chosen task.
#[derive(Deserialize)]
struct ChosenTask {
    task: String,
}

async fn choose_task(State(app): State<ScreenApp>, body: Bytes) -> Response {
    let Ok(ChosenTask { task }) = serde_json::from_slice(&body) else { return StatusCode::BAD_REQUEST.into_response() };
    if app.standby.choose_task(&task) { StatusCode::NO_CONTENT } else { StatusCode::CONFLICT }.into_response()
}

/// A refusal has a kind, which the page has a text for, and a technical detail if there is one.
fn answer(done: Result<(), BoxRefusal>) -> Response {
    match done {
        Ok(()) => StatusCode::NO_CONTENT.into_response(),
        Err(why) => (StatusCode::CONFLICT, axum::Json(ShownRefusal::from(&why))).into_response(),
    }
}

/// The page and the files that it loads: it shares texts and modules with the dashboard.
async fn file(State(app): State<ScreenApp>, request: Request) -> Response {
    let path = request.uri().path().trim_start_matches('/');
    let found = public_file(if path.is_empty() { PAGE } else { path });
    let Some((content, kind)) = found else { return StatusCode::NOT_FOUND.into_response() };
    if let Some(language) = app.language.filter(|_| path.is_empty()) {
        let page = String::from_utf8_lossy(&content);
        let page = page.replacen("<html ", &format!("<html data-language=\"{}\" ", language.tag()), 1);
        return ([(header::CONTENT_TYPE, kind)], page).into_response();
    }
    ([(header::CONTENT_TYPE, kind)], content.into_owned()).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_own_address_is_answered_and_only_the_own_page_changes_something() {
        let address: SocketAddr = "127.0.0.1:8090".parse().unwrap();
        let headers = |pairs: &[(&'static str, &'static str)]| -> HeaderMap {
            let pair = |(name, value): &(&'static str, &'static str)| (name.parse().unwrap(), value.parse().unwrap());
            pairs.iter().map(pair).collect()
        };
        for (host, is_own) in [
            ("127.0.0.1:8090", true),
            ("localhost:8090", true),
            ("evil.example:8090", false),
            ("127.0.0.1:80", false),
            ("127.0.0.1", false),
            ("", false),
        ] {
            assert_eq!(is_own_host(&headers(&[("host", host)]), address), is_own, "{host}");
        }
        let json = ("content-type", "application/json");
        let own = ("host", "127.0.0.1:8090");
        assert!(is_own_page(&headers(&[own, json, ("origin", "http://127.0.0.1:8090")])));
        assert!(is_own_page(&headers(&[own, json])));
        assert!(!is_own_page(&headers(&[own, json, ("origin", "http://evil.example")])));
        assert!(!is_own_page(&headers(&[own, json, ("origin", "null")])));
        assert!(!is_own_page(&headers(&[own, ("content-type", "text/plain")])));
    }
}
