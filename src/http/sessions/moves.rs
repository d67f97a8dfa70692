//! Moves of sessions to the right trainee, task or box.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use crate::domain::scope::Scope;
use crate::domain::session_move::{MovedPart, NewSessionMove};
use crate::http::auth::signed_in::{Member, Staff};
use crate::http::error::HandlerResult;
use crate::http::read::{Json, PathKey, reference_problem};
use crate::http::show::{Created, NamedReference, PageResponse, Time};
use crate::http::state::App;
use crate::ids::{MoveId, SessionId, TraineeId};
use crate::store::{FiledUnder, SessionDestination, SessionMoveRecord};

/// A move of a session.
#[derive(Debug, Serialize, ToSchema)]
pub struct MoveResponse {
    id: MoveId,
    /// What the move changed.
    changes: Vec<MoveChange>,
    /// The reason: plain text, never markup; `null` for trainees, because it may name other people.
    why: Option<String>,
    /// Name of the person; `null` if the person was deleted, or if the service moved it.
    who: Option<String>,
    created_at: Time,
}

/// One change of a move.
#[derive(Debug, Serialize, ToSchema)]
pub struct MoveChange {
    /// What was changed.
    part: MovedPart,
    /// What the session was filed under before; `null` if it was deleted since, or if the caller may not see it.
    from: Option<NamedReference>,
    /// What it was filed under afterwards; `null` likewise.
    to: Option<NamedReference>,
}

impl From<FiledUnder> for NamedReference {
    fn from(FiledUnder { id, name, code }: FiledUnder) -> Self {
        Self { id, name, code }
    }
}

impl MoveResponse {
    /// The move as this trainee may know it: without other trainees and without the reason, which may name them.
    pub(in crate::http) fn for_trainee(made: SessionMoveRecord, trainee: TraineeId) -> Self {
        let id = trainee.to_string();
        let own = |filed: Option<FiledUnder>| filed.filter(|filed| filed.id == id);
        let (from_trainee, to_trainee) = (own(made.from_trainee), own(made.to_trainee));
        Self { why: None, ..Self::from(SessionMoveRecord { from_trainee, to_trainee, ..made }) }
    }
}

impl From<SessionMoveRecord> for MoveResponse {
    fn from(made: SessionMoveRecord) -> Self {
        let changes = made.changes.iter().map(|part| {
            let (from, to) = match part {
                MovedPart::Trainee => (&made.from_trainee, &made.to_trainee),
                MovedPart::Task => (&made.from_task, &made.to_task),
                MovedPart::Box => (&made.from_box, &made.to_box),
            };
            let [from, to] = [from, to].map(|filed| filed.clone().map(NamedReference::from));
            MoveChange { part: *part, from, to }
        });
        let changes = changes.collect();
        let (who, created_at) = (made.who.map(String::from), Time(made.created_at_ms));
        Self { id: made.id, changes, why: Some(made.why.into()), who, created_at }
    }
}

/// List a session's moves to another trainee, task or box, oldest first
#[utoipa::path(get, path = "/sessions/{id}/moves", tag = "sessions",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = PageResponse<MoveResponse>)))]
pub async fn moves(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<Json<PageResponse<MoveResponse>>> {
    let session: SessionId = at.id()?;
    let moves = app.store.session_moves().of_session(&by.scope, session).await?;
    let trainee = app.store.sessions().get(&by.scope, session).await?.trainee_id;
    let shown = |made| match by.scope.is_staff() {
        true => MoveResponse::from(made),
        false => MoveResponse::for_trainee(made, trainee),
    };
    Ok(Json(PageResponse::whole(moves.into_iter().map(shown))))
}

/// Move a session to the right trainee, task or box
///
/// Name what is wrong; the rest stays. Progress, standards, courses, cohorts and exports read the session where it is
/// filed now. The session keeps its recording, ratings, comments and edits; comments of the trainee before are hidden
/// while it is filed under another one. To take a move back, move the session again.
///
/// In another box, the session is tracked with the camera and colours of that box. Results of the box before stay in
/// `GET /sessions/{id}/results`, and count again if the session is moved back. An answer to the `box_question` counts
/// for the box that it was given for.
///
/// The move is refused while the recording is arriving, and if that trainee, task and box have the same recording; to
/// another box also while the session is being tracked or scored, and if its video was deleted.
#[utoipa::path(post, path = "/sessions/{id}/moves", tag = "sessions",
    params(("id" = String, Path, description = "id")), request_body = NewSessionMove,
    responses((status = CREATED, body = MoveResponse)))]
pub async fn move_session(
    State(app): State<App>,
    by: Staff,
    at: PathKey,
    Json(new): Json<NewSessionMove>,
) -> HandlerResult<Created<MoveResponse>> {
    new.check()?;
    let session: SessionId = at.id()?;
    let before = app.store.sessions().get(&by.scope, session).await?;
    let to = app.destination(&by.scope, &new).await?;
    let made = app.store.session_moves().add(&by.scope, session, to, new.why).await?;
    let after = app.store.sessions().get(&by.scope, session).await?;
    if after.trainee_id != before.trainee_id {
        app.notify_session_changed(&before);
    }
    app.notify_session_changed(&after);
    Ok(Created { location: format!("/api/v1/sessions/{session}/moves"), made: made.into() })
}

impl App {
    /// The ids of what a move names.
    async fn destination(&self, scope: &Scope, new: &NewSessionMove) -> HandlerResult<SessionDestination> {
        let mut to = SessionDestination::default();
        if let Some(key) = &new.trainee {
            to.trainee = Some(self.store.trainees().get(scope, key).await.map_err(reference_problem("trainee"))?.id);
        }
        if let Some(key) = &new.task {
            to.task = Some(self.store.tasks().get(scope, key).await.map_err(reference_problem("task"))?.id);
        }
        if let Some(key) = &new.in_box {
            to.in_box = Some(self.store.boxes().get(scope, key).await.map_err(reference_problem("box"))?.id);
        }
        Ok(to)
    }
}
