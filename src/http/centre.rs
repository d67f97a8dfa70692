//! The centre's name and logo: strangers read them on the sign-in page, administrators set them.

use std::sync::{Mutex, PoisonError};

use axum::body::Bytes;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use http_body_util::{BodyExt, Limited};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::auth::signed_in::Administrator;
use super::error::{HandlerResult, Refusal};
use super::read::{Json, Params, too_large, unreadable_body};
use super::state::App;
use crate::domain::centre::{Logo, LogoFormat, MAX_LOGO_BYTES};
use crate::domain::text::Name;
use crate::store::CentreRecord;

/// Digits of a logo's hash that its address has.
const VERSION_DIGITS: usize = 12;

/// `Cache-Control` of a logo whose address has its version.
const CACHE_FOREVER: &str = "public, max-age=31536000, immutable";

/// `Cache-Control` of a logo without the current version in its address.
const REVALIDATE: &str = "no-cache";

/// What a browser may do with the file if a person opens it by itself: show it, and nothing else.
const LOGO_POLICY: &str = "default-src 'none'; sandbox";

/// The centre, as everyone sees it.
#[derive(Debug, Serialize, ToSchema)]
pub struct CentreResponse {
    /// What people call it; `null`: not set yet.
    name: Option<Name>,
    /// Changes with the logo, for the query of `GET /centre/logo`; `null`: there is no logo.
    logo_version: Option<String>,
}

impl From<CentreRecord> for CentreResponse {
    fn from(CentreRecord { name, logo_hash }: CentreRecord) -> Self {
        Self { name, logo_version: logo_hash.map(|hash| version_of(&hash)) }
    }
}

fn version_of(hash: &str) -> String {
    hash.chars().take(VERSION_DIGITS).collect()
}

/// Read the centre's name
///
/// Needs no sign-in: the sign-in page shows it.
#[utoipa::path(get, path = "/centre", tag = "operation", security(()), responses((status = OK, body = CentreResponse)))]
pub async fn get(State(app): State<App>) -> HandlerResult<Json<CentreResponse>> {
    Ok(Json(app.store.centre().get().await?.into()))
}

/// The centre's new name.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CentreChange {
    /// What people call it, 1 to 120 characters; `null` removes it.
    #[serde(default)]
    name: Option<Name>,
}

/// Set the centre's name
#[utoipa::path(put, path = "/centre", tag = "operation", request_body = CentreChange,
    responses((status = OK, body = CentreResponse)))]
pub async fn set_name(
    State(app): State<App>,
    by: Administrator,
    Json(CentreChange { name }): Json<CentreChange>,
) -> HandlerResult<Json<CentreResponse>> {
    app.store.centre().set_name(&by.scope, name).await?;
    Ok(Json(app.store.centre().get().await?.into()))
}

/// Selects the version of the logo.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct LogoQuery {
    /// `logo_version` of `GET /centre`: with the current one, caches may keep the logo.
    version: Option<String>,
}

/// Read the centre's logo
///
/// Needs no sign-in: the sign-in page shows it.
#[utoipa::path(get, path = "/centre/logo", tag = "operation", params(LogoQuery), security(()),
    responses((status = OK, content((Vec<u8> = "image/png"), (Vec<u8> = "image/jpeg"))),
        (status = NO_CONTENT, description = "There is no logo")))]
pub async fn logo(
    State(app): State<App>,
    Params(LogoQuery { version }): Params<LogoQuery>,
    headers: HeaderMap,
) -> HandlerResult<Response> {
    let Some(hash) = app.store.centre().get().await?.logo_hash else {
        return Ok(StatusCode::NO_CONTENT.into_response());
    };
    let known = headers.get(header::IF_NONE_MATCH).and_then(|known| known.to_str().ok());
    if known.is_some_and(|known| known == etag(&hash)) {
        let own = [(header::ETAG, etag(&hash)), (header::CACHE_CONTROL, REVALIDATE.to_owned())];
        return Ok((StatusCode::NOT_MODIFIED, own).into_response());
    }
    let Some(SharedLogo { hash, format, bytes }) = shared_logo(&app, &hash).await? else {
        return Ok(StatusCode::NO_CONTENT.into_response()); // removed a moment ago
    };
    let is_current = version.is_some_and(|version| version == version_of(&hash));
    let own = [
        (header::CONTENT_TYPE, format.name()),
        (header::CONTENT_DISPOSITION, "inline"),
        (header::CONTENT_SECURITY_POLICY, LOGO_POLICY),
        (header::CACHE_CONTROL, if is_current { CACHE_FOREVER } else { REVALIDATE }),
    ];
    Ok((own, [(header::ETAG, etag(&hash))], bytes).into_response())
}

fn etag(hash: &str) -> String {
    format!("\"{hash}\"")
}

/// A logo in memory, once for all answers: strangers who read slowly would otherwise hold a copy each.
#[derive(Clone)]
struct SharedLogo {
    hash: String,
    format: LogoFormat,
    bytes: Bytes,
}

/// The logo that was sent last. Its hash says whether it is the present one.
static LAST_LOGO: Mutex<Option<SharedLogo>> = Mutex::new(None);

/// The present logo, which has this hash unless it is changed at this moment.
async fn shared_logo(app: &App, hash: &str) -> HandlerResult<Option<SharedLogo>> {
    let last = || LAST_LOGO.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = last().as_ref().filter(|known| known.hash == hash) {
        return Ok(Some(known.clone()));
    }
    let Some(logo) = app.store.centre().logo().await? else { return Ok(None) };
    let (hash, format) = (logo.hash(), logo.format);
    let read = SharedLogo { hash, format, bytes: logo.bytes.into() };
    *last() = Some(read.clone());
    Ok(Some(read))
}

/// Set the centre's logo
///
/// The body is the picture's file: PNG or JPEG, at most 512 KiB and 2048 pixels a side. It is stored and shown as it is.
#[utoipa::path(put, path = "/centre/logo", tag = "operation",
    request_body(content((Vec<u8> = "image/png"), (Vec<u8> = "image/jpeg"))),
    responses((status = OK, body = CentreResponse)))]
pub async fn set_logo(
    State(app): State<App>,
    by: Administrator,
    request: Request,
) -> HandlerResult<Json<CentreResponse>> {
    expect_picture(request.headers())?;
    let body = Limited::new(request.into_body(), MAX_LOGO_BYTES).collect().await;
    let bytes = body.map_err(|cause| unreadable_body(&*cause, MAX_LOGO_BYTES as u64))?.to_bytes();
    let logo = Logo::new(bytes.into())?;
    app.store.centre().set_logo(&by.scope, Some(logo)).await?;
    Ok(Json(app.store.centre().get().await?.into()))
}

/// Remove the centre's logo
#[utoipa::path(delete, path = "/centre/logo", tag = "operation", responses((status = NO_CONTENT)))]
pub async fn remove_logo(State(app): State<App>, by: Administrator) -> HandlerResult<StatusCode> {
    app.store.centre().set_logo(&by.scope, None).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Refuses a body that is no picture, before it is read.
fn expect_picture(headers: &HeaderMap) -> HandlerResult<()> {
    let sent = headers.get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    let is_known = LogoFormat::ALL.iter().any(|format| sent.trim().eq_ignore_ascii_case(format.name()));
    if !is_known {
        return Err(
            Refusal::UnsupportedMediaType.with("Send the picture itself as the body, as `image/png` or `image/jpeg`.")
        );
    }
    match super::read::content_length(headers) {
        Some(length) if length > MAX_LOGO_BYTES as u64 => Err(too_large(MAX_LOGO_BYTES as u64)),
        _ => Ok(()),
    }
}
