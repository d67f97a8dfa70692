//! Cuts of recordings with two attempts.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use crate::domain::edit::EditChange;
use crate::domain::session_cut::NewSessionCut;
use crate::http::auth::signed_in::{Member, Staff};
use crate::http::error::{HandlerResult, ProblemResponse};
use crate::http::read::{Json, PathKey, PathPair};
use crate::http::show::{Created, PageResponse, Time};
use crate::http::state::App;
use crate::ids::{CutId, SessionId};
use crate::store::{EditBasis, SessionCutRecord};

/// A cut of a recording into two sessions.
#[derive(Debug, Serialize, ToSchema)]
pub struct CutResponse {
    id: CutId,
    /// The session with the part before the cut; `null` if it was erased, or if the caller may not see it.
    first: Option<SessionId>,
    /// The session with the part after the cut; `null` likewise, and after the parts were joined.
    second: Option<SessionId>,
    /// Where it was cut, seconds of the recording.
    at_s: f64,
    /// The reason: plain text, never markup; `null` for trainees, because it may name other people.
    why: Option<String>,
    /// Name of the person; `null` if the person was deleted, or if the service cut it.
    who: Option<String>,
    created_at: Time,
    /// When the parts were joined again; `null`: it is cut.
    joined_at: Option<Time>,
}

impl From<SessionCutRecord> for CutResponse {
    fn from(cut: SessionCutRecord) -> Self {
        Self {
            id: cut.id,
            first: cut.first_id,
            second: cut.second_id,
            at_s: cut.at_s,
            why: Some(cut.why.into()),
            who: cut.who.map(String::from),
            created_at: Time(cut.created_at_ms),
            joined_at: cut.joined_at_ms.map(Time),
        }
    }
}

impl CutResponse {
    /// The cut as a trainee may know it: without the reason, which may name others.
    pub(in crate::http) fn for_trainee(cut: SessionCutRecord) -> Self {
        Self { why: None, ..Self::from(cut) }
    }
}

/// List the cuts that a session is a part of, oldest first
#[utoipa::path(get, path = "/sessions/{id}/cuts", tag = "sessions",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = PageResponse<CutResponse>)))]
pub async fn cuts(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<Json<PageResponse<CutResponse>>> {
    let cuts = app.store.session_cuts().of_session(&by.scope, at.id()?).await?;
    let shown = |cut| match by.scope.is_staff() {
        true => CutResponse::from(cut),
        false => CutResponse::for_trainee(cut),
    };
    Ok(Json(PageResponse::whole(cuts.into_iter().map(shown))))
}

/// Cut a recording with two attempts into two sessions
///
/// The session keeps the part before `at_s`; a second session is made for the rest. Both have the same video, which is
/// stored once. A trim limits each to its part: the first is scored again, and the second one is tracked and scored anew,
/// with the trims, swaps and time corrections in force. Ratings, comments and error sheets stay with the first session. Each
/// can be moved alone. Both count in the order of the recording, with the arrival of the recording.
///
/// The cut is refused if too little would be left of a part, before the session is scored, and if the video was
/// deleted.
#[utoipa::path(post, path = "/sessions/{id}/cuts", tag = "sessions",
    params(("id" = String, Path, description = "id")), request_body = NewSessionCut,
    responses((status = CREATED, body = CutResponse)))]
pub async fn cut(
    State(app): State<App>,
    by: Staff,
    at: PathKey,
    Json(new): Json<NewSessionCut>,
) -> HandlerResult<Created<CutResponse>> {
    new.check()?;
    let session: SessionId = at.id()?;
    app.store.sessions().get(&by.scope, session).await?;
    let (result, _) = app.result_with_edits(&by.scope, session).await?;
    let end_s = result.video.duration_s;
    if new.at_s >= end_s {
        let why = format!("is {}; expected a second of the recording, which has {end_s:.1} s", new.at_s);
        return Err(ProblemResponse::invalid("at_s", why));
    }
    let mut basis = EditBasis::default();
    for part in [[new.at_s, end_s], [0.0, new.at_s]] {
        basis = app.check_change(&by.scope, session, EditChange::Trim(part)).await?.1;
    }
    let made = app.store.session_cuts().add(&by.scope, session, ([new.at_s, end_s], new.why), basis).await?;
    for part in [made.first_id, made.second_id].into_iter().flatten() {
        app.notify_edited(&by.scope, part).await?;
    }
    Ok(Created { location: format!("/api/v1/sessions/{session}/cuts"), made: made.into() })
}

/// Join the parts of a cut again
///
/// The second session is erased, and the first one has the whole recording again. Refused once the second one has ratings,
/// comments, error sheets, edits, moves or cuts of its own, and while the parts are filed under different trainees, tasks or
/// boxes.
#[utoipa::path(post, path = "/sessions/{id}/cuts/{cut}/undo", tag = "sessions",
    params(("id" = String, Path, description = "id of one of the parts"), ("cut" = String, Path, description = "id of the cut")),
    responses((status = OK, body = CutResponse)))]
pub async fn join(
    State(app): State<App>,
    by: Staff,
    PathPair(session, cut): PathPair<SessionId, CutId>,
) -> HandlerResult<Json<CutResponse>> {
    let joined = app.store.session_cuts().join(&by.scope, session, cut).await?;
    if let Some(first) = joined.first_id {
        app.notify_edited(&by.scope, first).await?;
    }
    Ok(Json(joined.into()))
}
