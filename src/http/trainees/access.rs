//! Who looked at the recordings of a trainee.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use crate::domain::access::AccessedPart;
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::http::auth::signed_in::Member;
use crate::http::error::{HandlerResult, Refusal};
use crate::http::read::{Json, Params, PathKey};
use crate::http::show::{PageResponse, Paging, Time};
use crate::http::state::App;
use crate::ids::{SessionId, TraineeId};
use crate::store::{AccessEntry, AccessedRecordings};

/// A person opened a session of a trainee, or exported their recordings: one entry for each person, session and hour.
#[derive(Debug, Serialize, ToSchema)]
pub struct AccessEntryResponse {
    /// The first time in the hour.
    at: Time,
    /// Name of the person; `null` if the person was deleted.
    who: Option<String>,
    /// The role that it was opened with.
    role: Role,
    /// Name of the token, if a program opened it on behalf of the person; otherwise `null`.
    program: Option<String>,
    /// The session; `null` for an export of all recordings, and if the session was erased.
    session: Option<SessionId>,
    /// Name of the session's task.
    task: Option<String>,
    /// When the session was recorded.
    recorded_at: Option<Time>,
    /// What was opened.
    parts: Vec<AccessedPart>,
}

impl From<AccessEntry> for AccessEntryResponse {
    fn from(entry: AccessEntry) -> Self {
        let AccessEntry { id: _, session, task, recorded_at_ms, who, role, program, at_ms, parts } = entry;
        let (task, who, recorded_at) = (task.map(String::from), who.map(String::from), recorded_at_ms.map(Time));
        Self { at: Time(at_ms), who, role, program, session, task, recorded_at, parts }
    }
}

/// List who looked at the recordings of a trainee, newest first
///
/// For the trainee and for administrators: the names may be of staff of other groups. Lists of sessions and the progress of
/// a trainee are not in it. An entry appears within a second or two.
#[utoipa::path(get, path = "/trainees/{id}/access-entries", tag = "consent",
    params(("id" = String, Path, description = "id or code"), Paging),
    responses((status = OK, body = PageResponse<AccessEntryResponse>)))]
pub async fn access_entries(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
    Params(paging): Params<Paging>,
) -> HandlerResult<Json<PageResponse<AccessEntryResponse>>> {
    if by.scope.is_staff() && !by.scope.is_administrator() {
        return Err(Refusal::Forbidden.with("Only the trainee and administrators may read this. Ask one of them."));
    }
    let trainee = app.store.trainees().get(&by.scope, &key).await?.id;
    let page = paging.request(format!("access-entries/{trainee}"), app.settings.page_items)?;
    let entries = app.store.access_log().of_trainee(&by.scope, trainee, &page).await?;
    Ok(Json(PageResponse::of(entries, AccessEntryResponse::from)))
}

impl App {
    /// Notes for the trainee that the caller opened a part of a session.
    pub(in crate::http) fn note_access(&self, scope: &Scope, session: SessionId, part: AccessedPart) {
        self.access_log.note(scope, AccessedRecordings::Session(session), part);
    }

    /// Notes for the trainee that the caller exported all of their recordings.
    pub(in crate::http) fn note_export(&self, scope: &Scope, trainee: TraineeId) {
        self.access_log.note(scope, AccessedRecordings::Trainee(trainee), AccessedPart::Export);
    }
}
