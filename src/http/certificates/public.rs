//! What anyone may read about certificates without signing in: whether one is valid, by its code or its file, and the
//! public keys.

use axum::extract::{Request, State};
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use http_body_util::{BodyExt, Limited};
use serde::Serialize;
use utoipa::ToSchema;

use super::PDF;
use crate::domain::certificate::key::{CertificateKeyId, CertificatePublicKey};
use crate::domain::certificate::signed_file::{self, MAX_FILE_BYTES, SignatureVerdict};
use crate::domain::certificate::{CertificateCode, CertificateContent, CertificateEventKind, CertificateState};
use crate::domain::named;
use crate::domain::text::Remark;
use crate::http::auth::sign_in::too_many_attempts;
use crate::http::auth::signed_in::{Administrator, BySignIn};
use crate::http::client_address::ClientAddress;
use crate::http::error::{HandlerResult, ProblemResponse, Refusal};
use crate::http::file::disposition;
use crate::http::read::{Json, PathKey, content_length, too_large, unreadable_body};
use crate::http::show::{Created, PageResponse, Time};
use crate::http::state::App;
use crate::store::{CertificateKeyRecord, PublicCertificate};

/// Whether a certificate is valid, and what it says.
#[derive(Debug, Serialize, ToSchema)]
pub struct CertificateCheck {
    state: CertificateState,
    /// Since when.
    state_at: Time,
    /// Why it was withdrawn: plain text, never markup; `null`: it is not withdrawn.
    #[schema(value_type = Option<String>)]
    reason: Option<Remark>,
    /// What it says, and no more than that; `null`: the person's data were erased.
    content: Option<CertificateContent>,
    /// What happened to sessions that it relied on, if it is under review.
    marks: Vec<CertificateMark>,
}

/// What happened to a session that a certificate relied on.
#[derive(Debug, Serialize, ToSchema)]
pub struct CertificateMark {
    /// What happened.
    event: CertificateEventKind,
    /// Number of the session on the certificate.
    session: Option<i64>,
    at: Time,
}

impl From<PublicCertificate> for CertificateCheck {
    fn from(PublicCertificate { state, state_at_ms, reason, content, marks }: PublicCertificate) -> Self {
        let marks = marks.into_iter().map(|(event, session, at)| CertificateMark { event, session, at: Time(at) });
        Self { state, state_at: Time(state_at_ms), reason, content, marks: marks.collect() }
    }
}

named! {
    /// What the signature of a file says.
    SignatureState: "signature" {
        /// This centre signed exactly this file.
        Genuine = "genuine",
        /// It is or was a certificate, and was changed.
        Changed = "changed",
        /// It was signed with a key that is none of this centre's.
        UnknownKey = "unknown_key",
        /// It is no certificate of this program.
        NotACertificate = "not_a_certificate",
    }
}

/// What a file is.
#[derive(Debug, Serialize, ToSchema)]
pub struct FileCheck {
    signature: SignatureState,
    /// Id of the key that the file names; `null` if it names none.
    #[schema(value_type = Option<String>)]
    key: Option<CertificateKeyId>,
    /// Whether the certificate is valid, and what it says; `null` unless the signature is genuine and the centre has it.
    certificate: Option<CertificateCheck>,
}

/// See whether a certificate is valid
///
/// Needs no sign-in: the code is on the certificate. An unknown code counts as a failed sign-in of the client's network
/// address.
#[utoipa::path(get, path = "/certificate-checks/{code}", tag = "certificates",
    params(("code" = String, Path, description = "code of the certificate")), security(()),
    responses((status = OK, body = CertificateCheck)))]
pub async fn check(
    State(app): State<App>,
    ClientAddress(address): ClientAddress,
    PathKey(code): PathKey,
) -> HandlerResult<Json<CertificateCheck>> {
    let found = match code.as_str().parse::<CertificateCode>() {
        Ok(code) => app.store.certificates().published(&code).await?,
        Err(_) => None,
    };
    let Some(found) = found else {
        app.throttle.attempt_without_login(address).map_err(too_many_attempts)?;
        return Err(ProblemResponse::not_found());
    };
    Ok(Json(found.into()))
}

/// See whether a file is a certificate of this centre, and valid
///
/// Needs no sign-in. The body is the file, at most 2 MiB; it is not stored. A file that is not genuine counts as a failed
/// sign-in of the client's network address.
#[utoipa::path(post, path = "/certificate-checks", tag = "certificates", security(()),
    request_body(content((Vec<u8> = "application/pdf"))), responses((status = OK, body = FileCheck)))]
pub async fn check_file(
    State(app): State<App>,
    ClientAddress(address): ClientAddress,
    request: Request,
) -> HandlerResult<Json<FileCheck>> {
    expect_pdf(request.headers())?;
    let body = Limited::new(request.into_body(), MAX_FILE_BYTES).collect().await;
    let file = body.map_err(|cause| unreadable_body(&*cause, MAX_FILE_BYTES as u64))?.to_bytes();
    let keys: Vec<CertificatePublicKey> =
        app.store.certificates().keys().await?.into_iter().map(|key| key.public).collect();
    let verdict = signed_file::verify(&file, &keys);
    if !matches!(verdict, SignatureVerdict::Genuine { .. }) {
        app.throttle.attempt_without_login(address).map_err(too_many_attempts)?;
    }
    let (signature, key, content) = match verdict {
        SignatureVerdict::Genuine { content, key } => (SignatureState::Genuine, Some(key), Some(content)),
        SignatureVerdict::UnknownKey { key } => (SignatureState::UnknownKey, Some(key), None),
        SignatureVerdict::Changed => (SignatureState::Changed, None, None),
        SignatureVerdict::NotACertificate => (SignatureState::NotACertificate, None, None),
    };
    let certificate = match content {
        // A person with the key, as of a stolen backup, could sign another name under a code that the centre knows.
        Some(content) => app
            .store
            .certificates()
            .published(&content.code)
            .await?
            .filter(|issued| issued.content.as_ref().is_none_or(|own| *own == *content)),
        None => None,
    };
    Ok(Json(FileCheck { signature, key, certificate: certificate.map(CertificateCheck::from) }))
}

/// Refuses a body that is no PDF, before it is read.
fn expect_pdf(headers: &HeaderMap) -> HandlerResult<()> {
    let sent = headers.get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    if !sent.trim().eq_ignore_ascii_case(PDF) {
        return Err(Refusal::UnsupportedMediaType.with("Send the file itself as the body, as `application/pdf`."));
    }
    match content_length(headers) {
        Some(length) if length > MAX_FILE_BYTES as u64 => Err(too_large(MAX_FILE_BYTES as u64)),
        _ => Ok(()),
    }
}

/// A key of the centre.
#[derive(Debug, Serialize, ToSchema)]
pub struct CertificateKeyResponse {
    /// Its id.
    #[schema(value_type = String)]
    id: CertificateKeyId,
    /// The public key as a PEM file.
    pem: String,
    created_at: Time,
    /// When another key replaced it; `null`: it signs.
    retired_at: Option<Time>,
}

impl From<CertificateKeyRecord> for CertificateKeyResponse {
    fn from(CertificateKeyRecord { id, public, created_at_ms, retired_at_ms }: CertificateKeyRecord) -> Self {
        let (created_at, retired_at) = (Time(created_at_ms), retired_at_ms.map(Time));
        Self { id, pem: public.to_pem(), created_at, retired_at }
    }
}

/// List the centre's public keys, the newest first
///
/// Needs no sign-in. Certificates stay valid when another key replaces theirs.
#[utoipa::path(get, path = "/certificate-keys", tag = "certificates", security(()),
    responses((status = OK, body = PageResponse<CertificateKeyResponse>)))]
pub async fn keys(State(app): State<App>) -> HandlerResult<Json<PageResponse<CertificateKeyResponse>>> {
    let keys = app.store.certificates().keys().await?;
    Ok(Json(PageResponse::whole(keys.into_iter().map(CertificateKeyResponse::from))))
}

/// Download a public key as a PEM file
///
/// Needs no sign-in. `trocar verify --key` reads it.
#[utoipa::path(get, path = "/certificate-keys/{id}", tag = "certificates",
    params(("id" = String, Path, description = "id of the key")), security(()),
    responses((status = OK, content_type = "application/x-pem-file")))]
pub async fn key(State(app): State<App>, PathKey(id): PathKey) -> HandlerResult<Response> {
    let keys = app.store.certificates().keys().await?;
    let key = keys.into_iter().find(|key| key.id.to_string() == id.as_str()).ok_or_else(ProblemResponse::not_found)?;
    let headers = [
        (header::CONTENT_TYPE, "application/x-pem-file".to_owned()),
        (header::CONTENT_DISPOSITION, disposition("attachment", &format!("certificate-key-{}.pem", key.id))),
    ];
    Ok((headers, key.public.to_pem()).into_response())
}

/// Replace the key that signs certificates
///
/// The secret part of the key before is deleted. What it signed stays valid. A token does not suffice.
#[utoipa::path(post, path = "/certificate-keys", tag = "certificates",
    responses((status = CREATED, body = CertificateKeyResponse)))]
pub async fn replace_key(
    State(app): State<App>,
    BySignIn(by): BySignIn<Administrator>,
) -> HandlerResult<Created<CertificateKeyResponse>> {
    let id = app.store.certificates().replace_key(&by.scope).await?;
    let keys = app.store.certificates().keys().await?;
    let made = keys.into_iter().find(|key| key.id == id).ok_or_else(ProblemResponse::not_found)?;
    Ok(Created { location: format!("/api/v1/certificate-keys/{id}"), made: made.into() })
}
