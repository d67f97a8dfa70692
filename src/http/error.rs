//! Maps every error to a status and a problem document (RFC 9457).
//!
//! A handler returns `Result<_, ProblemResponse>`; every error of the layers below becomes a [`ProblemResponse`] here
//! and nowhere else. `type` is stable (`/problems/<slug>`): programs decide by it. `detail` is for people and says what
//! to do. A resource that the caller may not see and one that does not exist give the same bytes, so the not-found
//! problem contains nothing of the request.

use std::any::Any;
use std::fmt::{Debug, Display};

use axum::Json;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::{Map, Value};

use crate::analysis::QuickAnalysisError;
use crate::analysis::stored_rows::StoredRowsError;
use crate::cohorts::{CohortsError, NoSkillModel};
use crate::domain::feed::close_reason::{CloseCode, CloseReason};
use crate::intake::IntakeError;
use crate::live::{PushError, PushFailure};
use crate::store::StoreError;
use crate::vault::VaultError;

/// Media type of problem documents.
pub const PROBLEM_JSON: &str = "application/problem+json";

/// Result of a handler.
pub type HandlerResult<T> = Result<T, ProblemResponse>;

/// Why a request was refused. Each variant is one row of [`REFUSALS`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The request's syntax is wrong.
    BadRequest,
    /// Neither a cookie nor a token, or one that is no longer valid.
    NotSignedIn,
    /// Unknown login or wrong password; the answer does not reveal which.
    WrongCredentials,
    /// The caller may not do this: their role, or their groups, do not allow it.
    Forbidden,
    /// The provider of single sign-on, or the person's groups there, do not let the person sign in.
    SingleSignOn,
    /// The caller must choose another password before anything else.
    PasswordChangeRequired,
    /// The trainee does not consent to new recordings.
    ConsentMissing,
    /// A page of another site requested a change.
    ForeignOrigin,
    /// The resource does not exist, or the caller may not see it.
    NotFound,
    /// The route has no such method.
    MethodNotAllowed,
    /// The body arrived too slowly.
    TooSlow,
    /// The present state does not allow it.
    Conflict,
    /// The session is an attempt of an exam, which is never edited.
    ExamSession,
    /// The name, code or login is taken.
    Taken,
    /// The same recording was already sent for the same trainee, task and box.
    DuplicateRecording,
    /// Something else still refers to the resource.
    InUse,
    /// The resource existed and has ended.
    Gone,
    /// The request must state its length.
    LengthRequired,
    /// A precondition of the protocol does not hold, e.g. the tus version.
    PreconditionFailed,
    /// The body has more bytes than the limit.
    TooLarge,
    /// The body has the wrong media type.
    UnsupportedMediaType,
    /// The byte range lies outside the file.
    RangeNotSatisfiable,
    /// The request is well-formed, but some of its values cannot be used.
    Invalid,
    /// The request names a trainee, task or box that does not exist or that the caller may not see.
    UnknownReference,
    /// Another request is writing to this upload.
    Locked,
    /// Too many attempts or requests.
    TooMany,
    /// The bytes differ from their checksum.
    ChecksumMismatch,
    /// A fault of the service.
    Internal,
    /// A limit is reached for the moment; a later attempt can succeed.
    Busy,
    /// No space left on the disk.
    DiskFull,
}

/// Every refusal with the slug of its `type`, its title and its status.
pub const REFUSALS: [(Refusal, &str, &str, u16); 30] = [
    (Refusal::BadRequest, "bad-request", "The request cannot be read", 400),
    (Refusal::NotSignedIn, "not-signed-in", "Sign in first", 401),
    (Refusal::WrongCredentials, "wrong-credentials", "Login or password is wrong", 401),
    (Refusal::Forbidden, "forbidden", "You may not do this", 403),
    (Refusal::SingleSignOn, "single-sign-on", "Signing in with the provider did not work", 403),
    (Refusal::PasswordChangeRequired, "password-change-required", "Choose a password of your own first", 403),
    (Refusal::ConsentMissing, "consent-missing", "The trainee does not consent to recordings", 403),
    (Refusal::ForeignOrigin, "foreign-origin", "The request comes from another site's page", 403),
    (Refusal::NotFound, "not-found", "Not found", 404),
    (Refusal::MethodNotAllowed, "method-not-allowed", "This address has no such method", 405),
    (Refusal::TooSlow, "too-slow", "The body arrived too slowly", 408),
    (Refusal::Conflict, "conflict", "This is not possible in the present state", 409),
    (Refusal::ExamSession, "exam-session", "An attempt of an exam is never edited", 409),
    (Refusal::Taken, "taken", "The name is taken", 409),
    (Refusal::DuplicateRecording, "duplicate-recording", "This recording was sent before", 409),
    (Refusal::InUse, "in-use", "This is still in use", 409),
    (Refusal::Gone, "gone", "This no longer exists", 410),
    (Refusal::LengthRequired, "length-required", "The request must state its length", 411),
    (Refusal::PreconditionFailed, "precondition-failed", "A precondition does not hold", 412),
    (Refusal::TooLarge, "too-large", "The request is too large", 413),
    (Refusal::UnsupportedMediaType, "unsupported-media-type", "The body has the wrong media type", 415),
    (Refusal::RangeNotSatisfiable, "range-not-satisfiable", "The range lies outside the file", 416),
    (Refusal::Invalid, "invalid", "Some values cannot be used", 422),
    (Refusal::UnknownReference, "unknown-reference", "The request names something that does not exist", 422),
    (Refusal::Locked, "locked", "Another request is writing to this upload", 423),
    (Refusal::TooMany, "too-many", "Too many attempts", 429),
    (Refusal::ChecksumMismatch, "checksum-mismatch", "The bytes differ from their checksum", 460),
    (Refusal::Internal, "internal", "The service failed", 500),
    (Refusal::Busy, "busy", "The service is busy", 503),
    (Refusal::DiskFull, "disk-full", "The service's disk is full", 507),
];

impl Refusal {
    /// Slug, title and status of this refusal.
    pub fn row(self) -> (&'static str, &'static str, StatusCode) {
        // Tests check that every variant has a row, and every row a valid status.
        let row = REFUSALS.iter().find(|row| row.0 == self).unwrap_or(&REFUSALS[27]);
        (row.1, row.2, StatusCode::from_u16(row.3).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR))
    }

    /// The problem with this detail: what happened and what to do, in one or two sentences for people.
    pub fn with(self, detail: impl Into<String>) -> ProblemResponse {
        let (errors, members, headers) = (Vec::new(), Map::new(), Vec::new());
        ProblemResponse { refusal: self, detail: detail.into(), errors, members, headers }
    }
}

/// The answer to a refused request.
#[derive(Debug)]
pub struct ProblemResponse {
    /// The kind of refusal.
    pub refusal: Refusal,
    detail: String,
    errors: Vec<FieldError>,
    members: Map<String, Value>,
    headers: Vec<(header::HeaderName, HeaderValue)>,
}

impl ProblemResponse {
    /// The one not-found problem: the same bytes for a missing resource and for one that the caller may not see.
    pub fn not_found() -> Self {
        Refusal::NotFound
            .with("Nothing exists at this address, or you may not see it. Check the id, or look in the list.")
    }

    /// A fault of the service: the cause goes to the log, not to the client.
    pub fn internal(doing: &'static str, cause: impl Debug) -> Self {
        tracing::error!(doing, cause = ?cause, "request failed; answered with status 500");
        Refusal::Internal
            .with("An administrator finds the cause in the service's log under this answer's x-request-id.")
    }

    /// A field whose value cannot be used. `message` continues the field's name and says what to do.
    pub fn invalid(field: &str, message: impl Display) -> Self {
        let error = FieldError { field: field.to_owned(), message: message.to_string() };
        Refusal::Invalid.with(format!("`{field}`: {message}.")).errors([error])
    }

    /// Names the field that the detail is about, in `errors`.
    pub fn of_field(self, field: &str) -> Self {
        let error = FieldError { field: field.to_owned(), message: self.detail.clone() };
        self.errors([error])
    }

    /// Adds fields that cannot be used.
    pub fn errors(mut self, errors: impl IntoIterator<Item = FieldError>) -> Self {
        self.errors.extend(errors);
        self
    }

    /// Adds a member besides the standard ones, e.g. a limit or a link.
    pub fn member(mut self, name: &str, value: impl Into<Value>) -> Self {
        self.members.insert(name.to_owned(), value.into());
        self
    }

    /// Adds a header to the answer; an invalid value is left out.
    pub fn header(mut self, name: header::HeaderName, value: impl Display) -> Self {
        if let Ok(value) = HeaderValue::try_from(value.to_string()) {
            self.headers.push((name, value));
        }
        self
    }

    /// The detail, for people.
    pub fn detail(&self) -> &str {
        &self.detail
    }

    /// The problem document.
    pub fn document(&self) -> Value {
        let (slug, title, status) = self.refusal.row();
        let mut document = self.members.clone();
        document.insert("type".to_owned(), format!("/problems/{slug}").into());
        document.insert("title".to_owned(), title.into());
        document.insert("status".to_owned(), status.as_u16().into());
        document.insert("detail".to_owned(), self.detail.as_str().into());
        document.insert("errors".to_owned(), serde_json::json!(self.errors));
        Value::Object(document)
    }
}

impl IntoResponse for ProblemResponse {
    fn into_response(self) -> Response {
        let (_, _, status) = self.refusal.row();
        let mut response = (status, Json(self.document())).into_response();
        response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(PROBLEM_JSON));
        response.headers_mut().extend(self.headers);
        response
    }
}

/// Maps the store's errors to refusals.
impl From<StoreError> for ProblemResponse {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::NotFound { .. } => ProblemResponse::not_found(),
            StoreError::Forbidden { .. } => {
                Refusal::Forbidden.with(format!("{}. Ask one of them.", capitalised(&error)))
            }
            StoreError::Taken { what: "recording", existing: Some(session) } => duplicate_recording(&session),
            StoreError::Taken { what, .. } => Refusal::Taken.with(format!("This {what} is taken. Choose another.")),
            StoreError::InUse { .. } => {
                Refusal::InUse.with(format!("{}. Delete what refers to it first.", capitalised(&error)))
            }
            StoreError::ExamSession => Refusal::ExamSession.with(format!("{}.", capitalised(&error))),
            StoreError::ConsentMissing { state } => {
                Refusal::ConsentMissing.with(format!("{}.", capitalised(&error))).member("consent", state.name())
            }
            StoreError::Refused { .. } => Refusal::Conflict.with(format!("{}.", capitalised(&error))),
            StoreError::LimitReached { why, most } => {
                Refusal::TooMany.with(format!("{}.", capitalised(&why.trim_end_matches('.')))).member("limit", most)
            }
            StoreError::LeaseLost => Refusal::Conflict.with("Another worker has taken over this job. Read it again."),
            StoreError::DiskFull => disk_full(),
            StoreError::Busy => busy("The database is overloaded. Try again in a moment."),
            StoreError::Closed => busy("The service is shutting down. Try again in a minute."),
            StoreError::NoSpaceToOpen { .. }
            | StoreError::Unusable(_)
            | StoreError::OlderSchema
            | StoreError::NoSchema
            | StoreError::Database(_) => ProblemResponse::internal("querying the store", error),
        }
    }
}

/// Maps the vault's errors to refusals.
impl From<VaultError> for ProblemResponse {
    fn from(error: VaultError) -> Self {
        match error {
            VaultError::DiskFull => disk_full(),
            VaultError::TooLong { most } => super::read::too_large(most),
            VaultError::InUse(_) => Refusal::Locked
                .with("Another request is writing to this upload. Wait until it has ended, then ask for the offset."),
            VaultError::ShuttingDown => busy("The service is shutting down. Try again in a minute."),
            VaultError::NotFound | VaultError::Damaged | VaultError::Lost { .. } | VaultError::Io { .. } => {
                ProblemResponse::internal("handling a file", error)
            }
        }
    }
}

/// Maps the errors of reading stored files by rows to refusals.
impl From<StoredRowsError> for ProblemResponse {
    fn from(error: StoredRowsError) -> Self {
        match error {
            StoredRowsError::Vault(error) => error.into(),
            error => ProblemResponse::internal("reading a stored file", error),
        }
    }
}

/// Maps the errors of a quick analysis to refusals.
impl From<QuickAnalysisError> for ProblemResponse {
    fn from(error: QuickAnalysisError) -> Self {
        match error {
            QuickAnalysisError::Problem(problem) => {
                Refusal::Invalid.with(format!("{}: {}.", problem.title, problem.detail))
            }
            QuickAnalysisError::Crashed(why) => {
                tracing::warn!(why, "quick analysis crashed; picture refused");
                Refusal::Invalid.with(
                    "The picture could not be analysed: the analysis crashed. Send another picture, or a smaller one.",
                )
            }
            QuickAnalysisError::TimedOut(limit_s) => Refusal::Invalid.with(format!(
                "The check took longer than {limit_s} s and was stopped. Try again when the service has less to do, or \
                 with a smaller picture or table. If that does not help, ask an administrator to raise `glance_s` in \
                 the settings."
            )),
            QuickAnalysisError::Failed(why) => ProblemResponse::internal("starting an analysis", why),
            QuickAnalysisError::Busy => {
                busy("Other pictures, edits or tables are being checked. Try again in a moment.")
            }
            QuickAnalysisError::Vault(error) => error.into(),
        }
    }
}

/// Maps intake's errors to refusals.
impl From<IntakeError> for ProblemResponse {
    fn from(error: IntakeError) -> Self {
        match error {
            IntakeError::Missing(field) => ProblemResponse::invalid(field, "is missing; give the id or the code"),
            IntakeError::Unknown(what) => unknown_reference(what, what),
            IntakeError::Invalid { field, why } => ProblemResponse::invalid(field, why),
            IntakeError::TooLong { most } => super::read::too_large(most),
            IntakeError::Empty => ProblemResponse::invalid("recording", "is empty; send the video's bytes"),
            IntakeError::Offset { received } => Refusal::Conflict
                .with(format!(
                    "The upload has {received} bytes. Ask for the offset with HEAD, and continue from there."
                ))
                .member("upload_offset", received),
            IntakeError::Expired => {
                Refusal::Gone.with("The upload waited too long for its next bytes and has expired. Begin a new upload.")
            }
            IntakeError::ChecksumMismatch => {
                Refusal::ChecksumMismatch.with("These bytes were discarded. Send this piece again.")
            }
            IntakeError::ConnectionLost(cause) => super::read::unreadable_body(&*cause, u64::MAX),
            IntakeError::Resumed => {
                Refusal::Conflict.with("Another request continues this upload. The bytes received so far are stored.")
            }
            IntakeError::Ending => {
                busy("The service is shutting down. The bytes received so far are stored: continue in a minute.")
            }
            IntakeError::EndingUnsaved => {
                busy("The service is shutting down. Nothing of the request is stored: send it again in a minute.")
            }
            IntakeError::AlreadyExists { session } => duplicate_recording(&session),
            IntakeError::Store(error) => error.into(),
            IntakeError::Vault(error) => error.into(),
        }
    }
}

/// The recording exists already, as this session.
fn duplicate_recording(session: &str) -> ProblemResponse {
    Refusal::DuplicateRecording
        .with("A session with the same recording of this trainee and task exists already; see `session`.")
        .member("session", format!("/api/v1/sessions/{session}"))
}

/// Maps the errors of calculations on cohorts to refusals.
impl From<CohortsError> for ProblemResponse {
    fn from(error: CohortsError) -> Self {
        match error {
            CohortsError::Invalid(invalid) => invalid.into(),
            CohortsError::Unknown { field, what } => unknown_reference(field, what),
            CohortsError::NoModel(NoSkillModel { reason, missing, ref detail }) => {
                let missing: Option<Map<String, Value>> =
                    missing.map(|by| by.into_iter().map(|(level, people)| (level.to_owned(), people.into())).collect());
                Refusal::Conflict
                    .with(format!("{}.", capitalised(detail)))
                    .member("reason", reason)
                    .member("missing", missing)
            }
            CohortsError::Training => busy("Another model of skill is being trained. Try again in a few minutes."),
            CohortsError::Store(error) => error.into(),
            CohortsError::Interrupted => ProblemResponse::internal("calculating", error),
        }
    }
}

/// Maps the reason why a feed was closed to a refusal, for feeds sent as an HTTP request.
impl From<CloseReason> for ProblemResponse {
    fn from(CloseReason { code, why }: CloseReason) -> Self {
        let refusal = match code {
            CloseCode::ServiceStopping => return busy(&capitalised(&format!("{why}."))),
            CloseCode::SignedOut => Refusal::NotSignedIn,
            CloseCode::Unknown => Refusal::Gone,
            CloseCode::Busy | CloseCode::Superseded => Refusal::Conflict,
            CloseCode::TooLarge => Refusal::TooLarge,
            CloseCode::Silent => Refusal::TooSlow,
            CloseCode::Done | CloseCode::NotUnderstood | CloseCode::OutOfPlace => Refusal::Invalid,
            CloseCode::Failed => Refusal::Internal,
        };
        refusal.with(format!("{}.", capitalised(&why)))
    }
}

/// Maps the failure of a push to a refusal. The part received until then is a session; the problem names it, if there
/// is one.
impl From<PushFailure> for ProblemResponse {
    fn from(PushFailure { why, session }: PushFailure) -> Self {
        let problem: ProblemResponse = match why {
            PushError::Cut(cause) => super::read::unreadable_body(&*cause, u64::MAX),
            PushError::Stream(problem) => {
                Refusal::Invalid.with(format!("{}.", capitalised(&problem.detail))).of_field("body")
            }
            PushError::Closed(reason) => reason.into(),
        };
        match session {
            Some(session) => problem.member("session", format!("/api/v1/sessions/{session}")),
            None => problem,
        }
    }
}

/// The problem for a body or query that names something unknown: 422, because 404 would blame the address.
pub fn unknown_reference(field: &str, what: &str) -> ProblemResponse {
    Refusal::UnknownReference
        .with(format!("`{field}` names no {what} that exists and that you may see. Give its id or code."))
        .of_field(field)
        .member("field", field)
}

/// The disk is full: stored data stays readable, and an upload can continue later.
pub fn disk_full() -> ProblemResponse {
    Refusal::DiskFull.with("Nothing stored is lost. Ask an administrator to free disk space, then continue.")
}

/// A limit is reached for the moment.
pub fn busy(detail: &str) -> ProblemResponse {
    Refusal::Busy.with(detail).header(header::RETRY_AFTER, 1)
}

/// The error's text with a capital first letter.
pub(in crate::http) fn capitalised(error: &impl Display) -> String {
    let text = error.to_string();
    let mut letters = text.chars();
    letters.next().map(|first| first.to_uppercase().chain(letters).collect()).unwrap_or_default()
}

/// Answers a method that the address does not have.
pub async fn method_not_allowed() -> ProblemResponse {
    Refusal::MethodNotAllowed.with("The `Allow` header lists the methods of this address; /docs describes them.")
}

/// Answers a request whose handler panicked. Other requests are not affected.
pub fn panic_response(cause: Box<dyn Any + Send>) -> Response {
    let text = cause.downcast_ref::<String>().map(String::as_str).or(cause.downcast_ref::<&str>().copied());
    ProblemResponse::internal("answering", text.unwrap_or("a panic without a message")).into_response()
}

/// A problem document as OpenAPI describes it.
#[derive(Debug, serde::Serialize, utoipa::ToSchema)]
#[schema(as = Problem, title = "Problem", description = "RFC 9457 problem document; further members depend on `type`")]
pub struct ProblemDocument {
    /// Stable name of the kind of problem; programs should decide by it.
    #[serde(rename = "type")]
    #[schema(example = "/problems/not-found")]
    pub kind: String,
    /// The kind of problem, for people.
    pub title: String,
    /// HTTP status of the answer.
    pub status: u16,
    /// What happened and what to do, for people.
    pub detail: String,
    /// The fields that cannot be used; empty if the problem is not about a field.
    pub errors: Vec<FieldError>,
}

/// A field of the request that cannot be used.
#[derive(Clone, Debug, serde::Serialize, utoipa::ToSchema)]
pub struct FieldError {
    /// Name of the field, parameter, header or form part; `body`, `query` or `form` if the whole of it cannot
    /// be read.
    pub field: String,
    /// What is wrong, and what is expected.
    pub message: String,
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn every_row_is_an_error_with_a_slug_of_its_own() {
        let slugs: HashSet<_> = REFUSALS.iter().map(|row| row.1).collect();
        assert_eq!(slugs.len(), REFUSALS.len());
        for (refusal, slug, _, status) in REFUSALS {
            assert_eq!(refusal.row().0, slug, "{refusal:?} finds its own row");
            let status = StatusCode::from_u16(status).unwrap();
            assert!(status.is_client_error() || status.is_server_error());
        }
        assert_eq!(REFUSALS[Refusal::Internal as usize].0, Refusal::Internal);
    }

    #[test]
    fn members_never_replace_the_standard_ones() {
        let document =
            Refusal::Taken.with("x").member("status", 200).member("errors", "none").member("code", "a").document();
        assert_eq!(document["status"], 409);
        assert_eq!(document["type"], "/problems/taken");
        assert_eq!(document["errors"], serde_json::json!([]));
        assert_eq!(document["code"], "a");
    }

    #[test]
    fn errors_is_a_list_in_every_problem_and_names_the_field_if_there_is_one() {
        for (refusal, ..) in REFUSALS {
            assert_eq!(refusal.with("x").document()["errors"], serde_json::json!([]), "{refusal:?}");
        }
        let message = serde_json::json!([{ "field": "name", "message": "is empty" }]);
        assert_eq!(ProblemResponse::invalid("name", "is empty").document()["errors"], message);
        assert_eq!(unknown_reference("task", "task").document()["errors"][0]["field"], "task");
    }

    #[tokio::test]
    async fn the_answer_after_a_panic_has_errors_too() {
        let answer = panic_response(Box::new("out of range"));
        assert_eq!(answer.status(), StatusCode::INTERNAL_SERVER_ERROR);
        let body = axum::body::to_bytes(answer.into_body(), 4096).await.unwrap();
        let document: Value = serde_json::from_slice(&body).unwrap();
        assert_eq!((&document["type"], &document["errors"]), (&"/problems/internal".into(), &Value::Array(Vec::new())));
    }
}
