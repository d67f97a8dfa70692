//! Certificates: staff issue and review them, administrators withdraw them, trainees see their own. [`public`] has what
//! anyone may read.

mod public;

use axum::extract::State;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
pub use public::*;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::auth::signed_in::{Administrator, Member, Staff};
use super::error::{HandlerResult, ProblemResponse, Refusal};
use super::file::disposition;
use super::read::{Json, Params, PathKey, reference_problem};
use super::show::{Created, PageResponse, Paging, Time};
use super::state::App;
use crate::certificates::IssueError;
use crate::domain::certificate::{
    CertificateContent, CertificateEventKind, CertificateReason, CertificateState, NewCertificate,
};
use crate::domain::scope::Scope;
use crate::domain::text::{Key, Name, Remark};
use crate::ids::{CertificateId, TaskId, TraineeId};
use crate::store::{CertificateEvent, CertificateFilter, CertificateRecord};

/// Media type of a certificate.
const PDF: &str = "application/pdf";

/// A certificate.
#[derive(Debug, Serialize, ToSchema)]
pub struct CertificateResponse {
    id: CertificateId,
    /// The trainee.
    trainee: TraineeId,
    /// The task; `null` if it was deleted.
    task: Option<TaskId>,
    /// What it says. It never changes.
    content: CertificateContent,
    issued_at: Time,
    state: CertificateState,
    /// Since when.
    state_at: Time,
    /// Why it was withdrawn: plain text, never markup, and public; `null`: it is not withdrawn.
    #[schema(value_type = Option<String>)]
    reason: Option<Remark>,
}

impl From<CertificateRecord> for CertificateResponse {
    fn from(record: CertificateRecord) -> Self {
        let CertificateRecord { id, trainee_id, task_id, content, issued_at_ms, state, state_at_ms, reason } = record;
        let (issued_at, state_at) = (Time(issued_at_ms), Time(state_at_ms));
        Self { id, trainee: trainee_id, task: task_id, content, issued_at, state, state_at, reason }
    }
}

/// A certificate with its history.
#[derive(Debug, Serialize, ToSchema)]
pub struct CertificateHistory {
    #[serde(flatten)]
    certificate: CertificateResponse,
    /// What happened to it, oldest first.
    events: Vec<CertificateEventResponse>,
}

/// Something that happened to a certificate.
#[derive(Debug, Serialize, ToSchema)]
pub struct CertificateEventResponse {
    /// What happened.
    event: CertificateEventKind,
    /// Number of the session on the certificate; `null`: it is about the certificate.
    session: Option<i64>,
    /// Name of the person; `null` if deleted, if the service did it, and for trainees.
    #[schema(value_type = Option<String>)]
    who: Option<Name>,
    /// The reason: plain text, never markup; for trainees only that of a withdrawal, because others may name people.
    #[schema(value_type = Option<String>)]
    reason: Option<Remark>,
    at: Time,
}

impl CertificateHistory {
    /// A certificate with its history, as this scope may see it.
    pub fn new(certificate: CertificateRecord, events: Vec<CertificateEvent>, scope: &Scope) -> Self {
        let events = events.into_iter().map(|event| CertificateEventResponse::new(event, scope.is_staff()));
        Self { certificate: certificate.into(), events: events.collect() }
    }
}

impl CertificateEventResponse {
    fn new(event: CertificateEvent, is_staff: bool) -> Self {
        let CertificateEvent { kind, session_number, who, reason, at_ms } = event;
        let is_public = is_staff || kind == CertificateEventKind::Withdrawn;
        let (who, reason) = (who.filter(|_| is_staff), reason.filter(|_| is_public));
        Self { event: kind, session: session_number, who, reason, at: Time(at_ms) }
    }
}

/// Selects certificates.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct CertificateQuery {
    /// Only those in this state.
    state: Option<CertificateState>,
    /// Only those of this trainee, by id or code.
    #[param(value_type = Option<String>)]
    trainee: Option<Key>,
    /// Most items on the page, 1 to 200.
    #[param(minimum = 1, maximum = 200)]
    limit: Option<u32>,
    /// `next` of the previous page.
    cursor: Option<String>,
}

/// List the certificates that the caller may see, the newest first
///
/// Trainees see their own. Those of people who were erased are in no list.
#[utoipa::path(get, path = "/certificates", tag = "certificates", params(CertificateQuery),
    responses((status = OK, body = PageResponse<CertificateResponse>)))]
pub async fn list(
    State(app): State<App>,
    by: Member,
    Params(CertificateQuery { state, trainee, limit, cursor }): Params<CertificateQuery>,
) -> HandlerResult<Json<PageResponse<CertificateResponse>>> {
    let page = Paging::new(limit, cursor).request("certificates", app.settings.page_items)?;
    let trainee = match trainee {
        Some(key) => Some(app.store.trainees().get(&by.scope, &key).await.map_err(reference_problem("trainee"))?.id),
        None => None,
    };
    let found = app.store.certificates().list(&by.scope, CertificateFilter { trainee, state }, &page).await?;
    Ok(Json(PageResponse::of(found, CertificateResponse::from)))
}

/// Issue a certificate to a trainee
///
/// The trainee's progress must meet the task's standard (`passed` of `GET /trainees/{id}/progress`). The certificate holds
/// all that it says, and its PDF is signed; neither changes later. The same certificate is issued once, unless it was
/// withdrawn. A name that the sheet cannot show is refused: it has the Latin, Greek, Cyrillic, Armenian and Georgian
/// scripts. If `public_url`, or the address of the request where that is not set, can be opened only on the service's computer
/// or in its network, it is refused with that address as `local_address`, unless `accept_local_address` is true.
#[utoipa::path(post, path = "/trainees/{id}/certificates", tag = "certificates",
    params(("id" = String, Path, description = "id or code")), request_body = NewCertificate,
    responses((status = CREATED, body = CertificateResponse)))]
pub async fn issue(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    headers: HeaderMap,
    Json(new): Json<NewCertificate>,
) -> HandlerResult<Created<CertificateResponse>> {
    app.store.trainees().get(&by.scope, &key).await?;
    let base = app.lasting_base_url(&headers, new.accept_local_address)?;
    let made = app.certificates.issue(&by.scope, &key, new, &base).await?;
    Ok(Created { location: format!("/api/v1/certificates/{}", made.id), made: made.into() })
}

/// Read a certificate and what happened to it
#[utoipa::path(get, path = "/certificates/{id}", tag = "certificates", params(("id" = String, Path, description = "id")),
    responses((status = OK, body = CertificateHistory)))]
pub async fn get(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<Json<CertificateHistory>> {
    history(&app, &by.scope, at.id()?).await
}

/// Download a certificate
///
/// The signed PDF as it was issued. `trocar verify` and `POST /certificate-checks` verify it.
#[utoipa::path(get, path = "/certificates/{id}/pdf", tag = "certificates",
    params(("id" = String, Path, description = "id")), responses((status = OK, content_type = "application/pdf")))]
pub async fn pdf(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<Response> {
    let id: CertificateId = at.id()?;
    let content = app.store.certificates().get(&by.scope, id).await?.content;
    let file = app.store.certificates().pdf(&by.scope, id).await?;
    let name = format!("{} - {} - {}.pdf", content.trainee, content.task, content.issued_on);
    let headers = [
        (header::CONTENT_TYPE, PDF.to_owned()),
        (header::CONTENT_DISPOSITION, disposition("attachment", &name)),
        (header::CACHE_CONTROL, "private, no-store".to_owned()),
    ];
    Ok((headers, file).into_response())
}

/// Decide that a certificate under review stays valid
///
/// A certificate is under review since a session that it relied on was moved, erased or changed.
#[utoipa::path(post, path = "/certificates/{id}/keep", tag = "certificates",
    params(("id" = String, Path, description = "id")), request_body = CertificateReason,
    responses((status = OK, body = CertificateHistory)))]
pub async fn keep(
    State(app): State<App>,
    by: Staff,
    at: PathKey,
    Json(CertificateReason { reason }): Json<CertificateReason>,
) -> HandlerResult<Json<CertificateHistory>> {
    let made = app.store.certificates().keep(&by.scope, at.id()?, reason).await?;
    history(&app, &by.scope, made.id).await
}

/// Withdraw a certificate
///
/// Its public page and `trocar verify` then say so, with the reason.
#[utoipa::path(post, path = "/certificates/{id}/withdraw", tag = "certificates",
    params(("id" = String, Path, description = "id")), request_body = CertificateReason,
    responses((status = OK, body = CertificateHistory)))]
pub async fn withdraw(
    State(app): State<App>,
    by: Administrator,
    at: PathKey,
    Json(CertificateReason { reason }): Json<CertificateReason>,
) -> HandlerResult<Json<CertificateHistory>> {
    let made = app.store.certificates().withdraw(&by.scope, at.id()?, reason).await?;
    history(&app, &by.scope, made.id).await
}

/// Make a withdrawn certificate valid again
#[utoipa::path(post, path = "/certificates/{id}/reinstate", tag = "certificates",
    params(("id" = String, Path, description = "id")), request_body = CertificateReason,
    responses((status = OK, body = CertificateHistory)))]
pub async fn reinstate(
    State(app): State<App>,
    by: Administrator,
    at: PathKey,
    Json(CertificateReason { reason }): Json<CertificateReason>,
) -> HandlerResult<Json<CertificateHistory>> {
    let made = app.store.certificates().reinstate(&by.scope, at.id()?, reason).await?;
    history(&app, &by.scope, made.id).await
}

async fn history(app: &App, scope: &Scope, id: CertificateId) -> HandlerResult<Json<CertificateHistory>> {
    let certificate = app.store.certificates().get(scope, id).await?;
    let events = app.store.certificates().events(scope, id).await?;
    Ok(Json(CertificateHistory::new(certificate, events, scope)))
}

/// Maps the reasons why no certificate was issued to refusals.
impl From<IssueError> for ProblemResponse {
    fn from(error: IssueError) -> Self {
        match error {
            IssueError::NotMet(_) | IssueError::TooLong => {
                Refusal::Conflict.with(format!("{}.", super::error::capitalised(&error)))
            }
            IssueError::Unprintable { .. } => {
                Refusal::Invalid.with(format!("{}.", super::error::capitalised(&error))).of_field("trainee")
            }
            IssueError::Progress(error) => error.into(),
            IssueError::Store(error) => error.into(),
            IssueError::Font(_) | IssueError::Sheet(_) | IssueError::Interrupted => {
                ProblemResponse::internal("making a certificate", error)
            }
        }
    }
}
