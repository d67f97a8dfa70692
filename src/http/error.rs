//! The one table from what went wrong to a status and a problem document (RFC 9457).
//!
//! A handler returns `Result<_, Problem>`; every error of the layers below becomes a [`Problem`] here and nowhere else.
//! `type` is stable (`/problems/<slug>`): programs decide by it. `detail` is for people and says what to do. What one
//! may not see and what does not exist give the same bytes, so the not-found problem carries nothing of the request.

use std::any::Any;
use std::fmt::{Debug, Display};

use axum::Json;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::{Map, Value};

use crate::analysis::Unseen;
use crate::cohorts::{CohortsError, NoSkillModel};
use crate::domain::feed::farewell::{Code, Farewell};
use crate::intake::IntakeError;
use crate::live::{Broken, PushError};
use crate::store::StoreError;
use crate::vault::VaultError;

/// Media type of every refusal.
pub const PROBLEM_JSON: &str = "application/problem+json";

/// What a handler answers.
pub type Answer<T> = Result<T, Problem>;

/// Why a request was refused. Each is one row of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The request's syntax is wrong.
    BadRequest,
    /// Neither cookie nor token, or one that has ended.
    NotSignedIn,
    /// Unknown login or wrong password; which of the two is not told.
    WrongCredentials,
    /// The role does not do this.
    Forbidden,
    /// A page of another site asked for a change.
    ForeignOrigin,
    /// It does not exist, or may not be seen.
    NotFound,
    /// The route has no such method.
    MethodNotAllowed,
    /// The body came too slowly.
    TooSlow,
    /// The state does not allow it.
    Conflict,
    /// The name, code or login is taken.
    Taken,
    /// The same recording was already sent for the same trainee, task and box.
    DuplicateRecording,
    /// Something else still refers to it.
    InUse,
    /// It existed and has ended.
    Gone,
    /// A length must be told beforehand.
    LengthRequired,
    /// A precondition of the protocol, e.g. the tus version.
    PreconditionFailed,
    /// More bytes than the limit.
    TooLarge,
    /// A body of another media type is expected.
    UnsupportedMediaType,
    /// The byte range lies outside the file.
    RangeNotSatisfiable,
    /// Well-formed, but the values cannot be used.
    Invalid,
    /// It names a trainee, task or box that is not there.
    UnknownReference,
    /// Another request is writing to this upload.
    Locked,
    /// Too many attempts or requests.
    TooMany,
    /// The bytes differ from their checksum.
    ChecksumMismatch,
    /// Our fault.
    Internal,
    /// At a limit now; later it will work.
    Busy,
    /// No space left on the disk.
    DiskFull,
}

/// Every refusal: slug of its `type`, title, status.
pub const TABLE: [(Refusal, &str, &str, u16); 26] = [
    (Refusal::BadRequest, "bad-request", "The request cannot be read", 400),
    (Refusal::NotSignedIn, "not-signed-in", "Sign in first", 401),
    (Refusal::WrongCredentials, "wrong-credentials", "Login or password is wrong", 401),
    (Refusal::Forbidden, "forbidden", "Your role does not allow this", 403),
    (Refusal::ForeignOrigin, "foreign-origin", "The request comes from another site's page", 403),
    (Refusal::NotFound, "not-found", "Not found", 404),
    (Refusal::MethodNotAllowed, "method-not-allowed", "This address has no such method", 405),
    (Refusal::TooSlow, "too-slow", "The body arrived too slowly", 408),
    (Refusal::Conflict, "conflict", "This cannot be done in the present state", 409),
    (Refusal::Taken, "taken", "The name is taken", 409),
    (Refusal::DuplicateRecording, "duplicate-recording", "This recording was sent before", 409),
    (Refusal::InUse, "in-use", "Something still refers to it", 409),
    (Refusal::Gone, "gone", "It has ended", 410),
    (Refusal::LengthRequired, "length-required", "The length must be told beforehand", 411),
    (Refusal::PreconditionFailed, "precondition-failed", "A precondition does not hold", 412),
    (Refusal::TooLarge, "too-large", "More bytes than accepted", 413),
    (Refusal::UnsupportedMediaType, "unsupported-media-type", "Another media type is expected", 415),
    (Refusal::RangeNotSatisfiable, "range-not-satisfiable", "The range lies outside the file", 416),
    (Refusal::Invalid, "invalid", "Some values cannot be used", 422),
    (Refusal::UnknownReference, "unknown-reference", "It names something that is not there", 422),
    (Refusal::Locked, "locked", "Another request is writing to it", 423),
    (Refusal::TooMany, "too-many", "Too many attempts", 429),
    (Refusal::ChecksumMismatch, "checksum-mismatch", "The bytes differ from their checksum", 460),
    (Refusal::Internal, "internal", "The service failed", 500),
    (Refusal::Busy, "busy", "The service is at a limit", 503),
    (Refusal::DiskFull, "disk-full", "No space left", 507),
];

impl Refusal {
    /// Slug, title and status of this refusal.
    pub fn row(self) -> (&'static str, &'static str, StatusCode) {
        // Every variant has a row (tested), and every row a status that exists (tested).
        let row = TABLE.iter().find(|row| row.0 == self).unwrap_or(&TABLE[23]);
        (row.1, row.2, StatusCode::from_u16(row.3).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR))
    }

    /// The refusal with what happened and what to do, in one or two sentences for people.
    pub fn with(self, detail: impl Into<String>) -> Problem {
        Problem { refusal: self, detail: detail.into(), members: Map::new(), headers: Vec::new() }
    }
}

/// A refused request, as it is told to the client.
#[derive(Debug)]
pub struct Problem {
    /// The row of the table.
    pub refusal: Refusal,
    detail: String,
    members: Map<String, Value>,
    headers: Vec<(header::HeaderName, HeaderValue)>,
}

impl Problem {
    /// The one not-found problem: the same bytes for what is missing and for what may not be seen.
    pub fn not_found() -> Self {
        Refusal::NotFound
            .with("There is nothing at this address that you may see. Check the id, or look in the list above it.")
    }

    /// Our fault: the cause goes to the log, not to the client.
    pub fn internal(doing: &'static str, cause: impl Debug) -> Self {
        tracing::error!(doing, cause = ?cause, "request failed");
        Refusal::Internal.with("The cause is in the service's log under this answer's x-request-id.")
    }

    /// A value that cannot be used, with the field's name.
    pub fn invalid(field: &str, message: impl Display) -> Self {
        let error = serde_json::json!({ "field": field, "message": message.to_string() });
        Refusal::Invalid.with(format!("`{field}`: {message}.")).member("errors", vec![error])
    }

    /// A member besides the standard ones, e.g. a limit or a link.
    pub fn member(mut self, name: &str, value: impl Into<Value>) -> Self {
        self.members.insert(name.to_owned(), value.into());
        self
    }

    /// A header of the answer; one that cannot be written is left out.
    pub fn header(mut self, name: header::HeaderName, value: impl Display) -> Self {
        if let Ok(value) = HeaderValue::try_from(value.to_string()) {
            self.headers.push((name, value));
        }
        self
    }

    /// What is told to people.
    pub fn detail(&self) -> &str {
        &self.detail
    }

    /// The document.
    pub fn document(&self) -> Value {
        let (slug, title, status) = self.refusal.row();
        let mut document = self.members.clone();
        document.insert("type".to_owned(), format!("/problems/{slug}").into());
        document.insert("title".to_owned(), title.into());
        document.insert("status".to_owned(), status.as_u16().into());
        document.insert("detail".to_owned(), self.detail.as_str().into());
        Value::Object(document)
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let (_, _, status) = self.refusal.row();
        let mut response = (status, Json(self.document())).into_response();
        response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(PROBLEM_JSON));
        response.headers_mut().extend(self.headers);
        response
    }
}

/// The one table from the store's errors to refusals.
impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::NotFound { .. } => Problem::not_found(),
            StoreError::Forbidden { .. } => Refusal::Forbidden.with(format!("{}. Ask one of them.", sentence(&error))),
            StoreError::Taken { what, .. } => Refusal::Taken.with(format!("This {what} is taken. Choose another.")),
            StoreError::InUse { .. } => {
                Refusal::InUse.with(format!("{}. Delete what refers to it first.", sentence(&error)))
            }
            StoreError::Refused { .. } => Refusal::Conflict.with(format!("{}.", sentence(&error))),
            StoreError::LeaseLost => Refusal::Conflict.with("Somebody else works on this job now. Read it again."),
            StoreError::DiskFull => disk_full(),
            StoreError::Busy => busy("The database has more to do than it can. Try again in a moment."),
            StoreError::Closed => busy("The service is ending. Try again in a minute."),
            StoreError::Unusable(_) | StoreError::Database(_) => Problem::internal("asking the store", error),
        }
    }
}

/// The one table from the vault's errors to refusals.
impl From<VaultError> for Problem {
    fn from(error: VaultError) -> Self {
        match error {
            VaultError::DiskFull => disk_full(),
            VaultError::TooLong { most } => super::read::too_large(most),
            VaultError::InUse(_) => Refusal::Locked
                .with("Another request is writing here. Wait until it has ended, then ask how far it came."),
            VaultError::NotFound | VaultError::Damaged | VaultError::Lost { .. } | VaultError::Io { .. } => {
                Problem::internal("handling a file", error)
            }
        }
    }
}

/// The one table from what a glance failed at to refusals.
impl From<Unseen> for Problem {
    fn from(error: Unseen) -> Self {
        match error {
            Unseen::Problem(problem) => Refusal::Invalid.with(format!("{}: {}.", problem.title, problem.detail)),
            Unseen::Crashed(why) => {
                tracing::warn!(why, "a glance did not end well");
                Refusal::Invalid
                    .with("It cannot be looked at: the process that did so did not survive it, or took too long. Send another or a smaller picture.")
            }
            Unseen::Failed(why) => Problem::internal("looking at a picture", why),
            Unseen::Busy => busy("Others look at pictures now. Try again in a moment."),
            Unseen::Vault(error) => error.into(),
        }
    }
}

/// The one table from intake's errors to refusals.
impl From<IntakeError> for Problem {
    fn from(error: IntakeError) -> Self {
        match error {
            IntakeError::Missing(field) => Problem::invalid(field, "is missing; give the id or the code"),
            IntakeError::Unknown(what) => unknown(what, what),
            IntakeError::Invalid { field, why } => Problem::invalid(field, why),
            IntakeError::TooLong { most } => super::read::too_large(most),
            IntakeError::Empty => Problem::invalid("recording", "is empty; send the video's bytes"),
            IntakeError::TooMany { most } => Refusal::TooMany
                .with(format!("{most} uploads are unfinished. Finish or delete one, or wait until they expire."))
                .member("limit", most),
            IntakeError::Offset { received } => Refusal::Conflict
                .with(format!("The upload has {received} bytes: ask with HEAD, and go on from there."))
                .member("upload_offset", received),
            IntakeError::Expired => {
                Refusal::Gone.with("The upload waited too long for its next byte. Begin a new one.")
            }
            IntakeError::Mismatch => Refusal::ChecksumMismatch.with("The bytes were dropped. Send this piece again."),
            IntakeError::Cut(cause) => super::read::unreadable(&*cause, u64::MAX),
            IntakeError::Resumed => {
                Refusal::Conflict.with("The upload goes on with another request. What came is safe.")
            }
            IntakeError::Ending => busy("The service is ending. What came is safe: go on in a minute."),
            IntakeError::Known { session } => Refusal::DuplicateRecording
                .with("The same recording of the same trainee, task and box is a session already; see `session`.")
                .member("session", format!("/api/v1/sessions/{session}")),
            IntakeError::Table(problem) => Problem::invalid("table", problem),
            IntakeError::Importing { most } => busy(&format!("{most} tables are being read. Try again in a moment.")),
            IntakeError::Broken(cause) => Problem::internal("reading a table", cause),
            IntakeError::Store(error) => error.into(),
            IntakeError::Vault(error) => error.into(),
        }
    }
}

/// The one table from why something was not calculated to refusals.
impl From<CohortsError> for Problem {
    fn from(error: CohortsError) -> Self {
        match error {
            CohortsError::Invalid(invalid) => invalid.into(),
            CohortsError::Unknown { field, what } => unknown(field, what),
            CohortsError::NoModel(NoSkillModel { reason, missing, ref detail }) => {
                let missing: Option<Map<String, Value>> =
                    missing.map(|of| of.into_iter().map(|(level, people)| (level.to_owned(), people.into())).collect());
                Refusal::Conflict
                    .with(format!("{}.", sentence(detail)))
                    .member("reason", reason)
                    .member("missing", missing)
            }
            CohortsError::Training => busy("Another model of skill is being made. Try again in some minutes."),
            CohortsError::Store(error) => error.into(),
            CohortsError::Broken => Problem::internal("calculating", error),
        }
    }
}

/// The one table from why a feed was closed to refusals, for those that come in a request.
impl From<Farewell> for Problem {
    fn from(Farewell { code, why }: Farewell) -> Self {
        let refusal = match code {
            Code::Ending => return busy(&sentence(&format!("{why}."))),
            Code::SignedOut => Refusal::NotSignedIn,
            Code::Unknown => Refusal::Gone,
            Code::Busy | Code::Superseded => Refusal::Conflict,
            Code::TooMuch => Refusal::TooLarge,
            Code::Silent => Refusal::TooSlow,
            Code::Done | Code::NotUnderstood | Code::DoesNotBelong => Refusal::Invalid,
            Code::Failed => Refusal::Internal,
        };
        refusal.with(format!("{}.", sentence(&why)))
    }
}

/// The one table from how a push broke off to refusals. What came up to then is a session, if it can be shown.
impl From<Broken> for Problem {
    fn from(Broken { why, session }: Broken) -> Self {
        let problem: Problem = match why {
            PushError::Cut(cause) => super::read::unreadable(&*cause, u64::MAX),
            PushError::Stream(problem) => Refusal::Invalid.with(format!("{}.", sentence(&problem.detail))),
            PushError::Told(farewell) => farewell.into(),
        };
        match session {
            Some(session) => problem.member("session", format!("/api/v1/sessions/{session}")),
            None => problem,
        }
    }
}

/// A request names something that is not there: its own mistake, not that of its address.
pub fn unknown(field: &str, what: &str) -> Problem {
    Refusal::UnknownReference
        .with(format!("`{field}` names no {what} that you may see. Give the id or the code of one that exists."))
        .member("field", field)
}

/// No space: what is there stays readable, and what was sent can go on later.
pub fn disk_full() -> Problem {
    Refusal::DiskFull.with("Nothing is lost. Ask an administrator to make space, then go on.")
}

/// At a limit that passes.
pub fn busy(detail: &str) -> Problem {
    Refusal::Busy.with(detail).header(header::RETRY_AFTER, 1)
}

/// The error's text as the beginning of a sentence.
fn sentence(error: &impl Display) -> String {
    let text = error.to_string();
    let mut letters = text.chars();
    letters.next().map(|first| first.to_uppercase().chain(letters).collect()).unwrap_or_default()
}

/// Answers a method that an address does not have.
pub async fn method_not_allowed() -> Problem {
    Refusal::MethodNotAllowed.with("See `Allow` for the methods of this address, and /docs for what they do.")
}

/// Answers a request whose handler panicked: a mistake of ours, and only this request's end.
pub fn panicked(cause: Box<dyn Any + Send>) -> Response {
    let text = cause.downcast_ref::<String>().map(String::as_str).or(cause.downcast_ref::<&str>().copied());
    Problem::internal("answering", text.unwrap_or("a panic without words")).into_response()
}

/// A problem document as OpenAPI shows it.
#[derive(Debug, serde::Serialize, utoipa::ToSchema)]
#[schema(as = Problem, title = "Problem", description = "RFC 9457 problem document; further members depend on `type`")]
pub struct ProblemDocument {
    /// Stable name of the kind of problem; programs decide by it.
    #[serde(rename = "type")]
    #[schema(example = "/problems/not-found")]
    pub kind: String,
    /// The kind, for people.
    pub title: String,
    /// The answer's status.
    pub status: u16,
    /// What happened and what to do.
    pub detail: String,
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn every_row_is_an_error_with_a_slug_of_its_own() {
        let slugs: HashSet<_> = TABLE.iter().map(|row| row.1).collect();
        assert_eq!(slugs.len(), TABLE.len());
        for (refusal, slug, _, status) in TABLE {
            assert_eq!(refusal.row().0, slug, "{refusal:?} finds its own row");
            let status = StatusCode::from_u16(status).unwrap();
            assert!(status.is_client_error() || status.is_server_error());
        }
        assert_eq!(TABLE[Refusal::Internal as usize].0, Refusal::Internal);
    }

    #[test]
    fn members_never_replace_the_standard_ones() {
        let document = Refusal::Taken.with("x").member("status", 200).member("code", "a").document();
        assert_eq!(document["status"], 409);
        assert_eq!(document["type"], "/problems/taken");
        assert_eq!(document["code"], "a");
    }
}
