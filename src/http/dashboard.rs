//! The dashboard's files under `static/`, embedded in the program. Each has an ETag, a weak one because answers are
//! also sent compressed.
//!
//! The index page refers to its files under `kept/VERSION/`, with one version for all files together: a browser caches
//! them and requests none again until the program changes. Modules import each other by relative paths, which stay
//! below that prefix.
//!
//! Each file is compressed once ([`FixedText`]), at its first request.
//!
//! Debug builds read the files from the source tree at each request, so that a page's author sees a change at once.

use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::{LazyLock, Mutex, PoisonError};

use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use rust_embed::RustEmbed;
use sha2::{Digest, Sha256};

use super::base_path::BasePath;
use super::compress::FixedText;
use super::error::{ProblemResponse, Refusal};
use super::state::App;

#[derive(RustEmbed)]
#[folder = "static/"]
struct Pages;

/// The index page of the dashboard; its script selects the view by the address.
const INDEX: &str = "index.html";

/// Path prefix of versioned files.
const VERSIONED_PREFIX: &str = "kept/";

/// The placeholder for the version in the index page.
const VERSION_PLACEHOLDER: &str = "kept/VERSION/";

/// The placeholder in the index page for the path that the service lies under. All addresses in the page begin with it,
/// and scripts read it from the root element.
const BASE_PATH_PLACEHOLDER: &str = "BASE_PATH";

/// `Cache-Control` of a file whose address contains the current version.
const CACHE_FOREVER: &str = "public, max-age=31536000, immutable";

/// `Cache-Control` of other files: the browser asks each time. Most answers are 304, and a new version of the program
/// shows at once.
const REVALIDATE: &str = "no-cache";

/// Fallback for every address without a route: a file, or the index page for an address of the dashboard.
pub async fn page(State(app): State<App>, method: Method, uri: Uri, headers: HeaderMap) -> Response {
    let base = &app.settings.base_path;
    let path = uri.path().trim_start_matches('/');
    if is_reserved(path) {
        return ProblemResponse::not_found().into_response();
    }
    if method != Method::GET && method != Method::HEAD {
        return Refusal::MethodNotAllowed.with("Pages can only be read: use GET.").into_response();
    }
    if let Some((of, path)) = path.strip_prefix(VERSIONED_PREFIX).and_then(|rest| rest.split_once('/')) {
        let Some(file) = StaticFile::at(path, base) else { return ProblemResponse::not_found().into_response() };
        return file.answer(&headers, if of == version() { CACHE_FOREVER } else { REVALIDATE });
    }
    let path = if path.is_empty() { INDEX } else { path };
    match StaticFile::at(path, base).or_else(|| is_view(path).then(|| StaticFile::at(INDEX, base)).flatten()) {
        Some(file) => file.answer(&headers, REVALIDATE),
        None => ProblemResponse::not_found().into_response(),
    }
}

/// Whether the address belongs to the API, where the answer to a missing resource is a problem document, never a page.
fn is_reserved(path: &str) -> bool {
    ["api", "docs", "problems"].contains(&path.split('/').next().unwrap_or_default())
}

/// Whether this is an address of the dashboard, such as `sessions/42`, rather than a missing file, such as `chart.js`.
fn is_view(path: &str) -> bool {
    !path.rsplit('/').next().unwrap_or_default().contains('.')
}

/// A file below `static/` and its media type, for the page of a box's own screen.
pub fn public_file(path: &str) -> Option<(Cow<'static, [u8]>, HeaderValue)> {
    let file = Pages::get(path)?;
    let kind = media_type(path, file.metadata.mimetype());
    Some((file.data, kind))
}

/// A file of the dashboard with its headers.
struct StaticFile {
    bytes: Cow<'static, [u8]>,
    hash: ContentHash,
    media_type: HeaderValue,
}

impl StaticFile {
    /// The file at a path below `static/`; in the index page the version and the base path replace their placeholders.
    fn at(path: &str, base: &BasePath) -> Option<Self> {
        let file = Pages::get(path)?;
        let media_type = media_type(path, file.metadata.mimetype());
        let (bytes, hash) = (file.data, file.metadata.sha256_hash());
        if path != INDEX {
            return Some(Self { bytes, hash, media_type });
        }
        let page = String::from_utf8_lossy(&bytes)
            .replace(VERSION_PLACEHOLDER, &format!("{VERSIONED_PREFIX}{}/", version()))
            .replace(BASE_PATH_PLACEHOLDER, &base.to_string());
        Some(Self { hash: Sha256::digest(&page).into(), bytes: page.into_bytes().into(), media_type })
    }

    /// The content, compressed at the first call.
    fn text(self) -> FixedText {
        static COMPRESSED: LazyLock<Mutex<TextsOfFiles>> = LazyLock::new(Mutex::default);
        let known = || COMPRESSED.lock().unwrap_or_else(PoisonError::into_inner);
        let key = (self.hash, self.media_type.as_bytes().to_owned());
        if let Some(text) = known().get(&key).cloned() {
            return text;
        }
        let text = FixedText::new(self.media_type, self.bytes);
        known().entry(key).or_insert(text).clone()
    }

    fn answer(self, headers: &HeaderMap, lifetime: &'static str) -> Response {
        let etag = format!("W/\"{}\"", short_hash(&self.hash));
        let known = headers.get(header::IF_NONE_MATCH).and_then(|v| v.to_str().ok()).is_some_and(|v| v.contains(&etag));
        let mut response = if known { StatusCode::NOT_MODIFIED.into_response() } else { self.text().answer(headers) };
        response.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static(lifetime));
        if let Ok(etag) = HeaderValue::try_from(etag) {
            response.headers_mut().insert(header::ETAG, etag);
        }
        response
    }
}

/// Compressed files, by content and media type.
type TextsOfFiles = HashMap<(ContentHash, Vec<u8>), FixedText>;

/// Hash of a file's content.
type ContentHash = [u8; 32];

/// Hash of all files together: changes with any of them.
fn version() -> Cow<'static, str> {
    static EMBEDDED: LazyLock<String> = LazyLock::new(compute_version);
    if cfg!(debug_assertions) { compute_version().into() } else { EMBEDDED.as_str().into() }
}

fn compute_version() -> String {
    let mut paths: Vec<_> = Pages::iter().collect();
    paths.sort();
    let mut all = Sha256::new();
    for file in paths.iter().filter_map(|path| Pages::get(path)) {
        all.update(file.metadata.sha256_hash());
    }
    short_hash(&all.finalize())
}

fn short_hash(hash: &[u8]) -> String {
    URL_SAFE_NO_PAD.encode(&hash[..16])
}

fn media_type(path: &str, guessed: &str) -> HeaderValue {
    let text =
        guessed.starts_with("text/") || path.ends_with(".js") || path.ends_with(".mjs") || path.ends_with(".json");
    let value = if text { format!("{guessed}; charset=utf-8") } else { guessed.to_owned() };
    HeaderValue::try_from(value).unwrap_or(HeaderValue::from_static("application/octet-stream"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::quality::QualityCause;

    #[test]
    fn a_view_differs_from_a_missing_file() {
        assert!(is_view("sessions/0193"));
        assert!(!is_view("vendor/chart.js"));
        assert!(is_reserved("api/v2/x") && is_reserved("docs/none") && !is_reserved("apiary"));
    }

    #[test]
    fn pages_warn_at_the_limits_of_the_verdict() {
        let [coverage, rate] = [QualityCause::Coverage, QualityCause::FrameRate].map(QualityCause::limits);
        let care = |cause: QualityCause| cause.limits().care;
        for (script, name, limit) in [
            ("parts/live/light.js", "MAX_EXPOSURE", care(QualityCause::Exposure)),
            ("parts/live/light.js", "MAX_WHITE_BALANCE", care(QualityCause::WhiteBalance)),
            ("parts/live/seen_level.js", "MIN_SEEN_GOOD", coverage.care),
            ("parts/live/seen_level.js", "MIN_SEEN_USABLE", coverage.refuse),
            ("parts/recording/record_notices.js", "MIN_FRAME_RATE", rate.care),
            ("setup/steps.js", "MAX_RMS_PX", care(QualityCause::Calibration)),
        ] {
            let (text, limit) = (Pages::get(script).unwrap().data, limit.unwrap());
            let text = str::from_utf8(&text).unwrap();
            assert!(text.contains(&format!("const {name} = {limit};")), "{script}: {name} is {limit}");
        }
    }
}
