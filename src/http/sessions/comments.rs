//! Comments on moments and stretches of sessions.

use axum::extract::State;
use axum::http::StatusCode;
use serde::Serialize;
use utoipa::ToSchema;

use crate::domain::access::AccessedPart;
use crate::domain::comment::NewComment;
use crate::domain::scope::Scope;
use crate::http::auth::signed_in::Member;
use crate::http::error::HandlerResult;
use crate::http::read::{Json, PathKey, PathPair};
use crate::http::show::{Created, Time};
use crate::http::state::App;
use crate::ids::{CommentId, SessionId};
use crate::store;

/// A comment on a moment or a stretch of a session.
#[derive(Debug, Serialize, ToSchema)]
pub struct CommentResponse {
    id: CommentId,
    /// Name of the author; `null` if the person was deleted.
    who: Option<String>,
    /// True if it is the caller's own comment.
    own: bool,
    /// True if the caller may delete it: the author, and staff if the author is a trainee or was deleted.
    may_delete: bool,
    /// Beginning of the stretch, seconds of the recording.
    from_s: f64,
    /// End of the stretch, seconds; equal to `from_s` for a single moment.
    to_s: f64,
    /// The comment: plain text, never markup.
    text: String,
    created_at: Time,
}

/// A session's comments.
#[derive(Debug, Serialize, ToSchema)]
pub struct CommentsResponse {
    /// The comments in order of time; at most 500.
    items: Vec<CommentResponse>,
    /// Number of hidden comments by other staff. They are shown after the caller has rated the session, so that ratings
    /// stay independent.
    hidden: i64,
}

impl CommentResponse {
    fn new(comment: store::CommentRecord, scope: &Scope) -> Self {
        let may_delete = comment.may_be_deleted_by(scope);
        let store::CommentRecord { id, person_id, who, from_s, to_s, text, created_at_ms, .. } = comment;
        let own = person_id.is_some() && person_id == scope.person();
        let (who, text, created_at) = (who.map(String::from), text.into(), Time(created_at_ms));
        Self { id, who, own, may_delete, from_s, to_s, text, created_at }
    }
}

/// List a session's comments, in order of time
#[utoipa::path(get, path = "/sessions/{id}/comments", tag = "ratings",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = CommentsResponse)))]
pub async fn comments(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<Json<CommentsResponse>> {
    let session = at.id()?;
    let comments = app.comments_of(&by.scope, session).await?;
    app.note_access(&by.scope, session, AccessedPart::Remarks);
    Ok(Json(comments))
}

impl App {
    /// The comments on a session that the scope may read.
    pub(in crate::http) async fn comments_of(
        &self,
        scope: &Scope,
        session: SessionId,
    ) -> HandlerResult<CommentsResponse> {
        let seen = self.store.comments().of_session(scope, session).await?;
        let items = seen.items.into_iter().map(|comment| CommentResponse::new(comment, scope)).collect();
        Ok(CommentsResponse { items, hidden: seen.hidden })
    }
}

/// Comment on a moment or a stretch of a session
///
/// A session takes at most 500 comments, 100 of them by its trainee.
#[utoipa::path(post, path = "/sessions/{id}/comments", tag = "ratings",
    params(("id" = String, Path, description = "id")), request_body = NewComment,
    responses((status = CREATED, body = CommentResponse)))]
pub async fn comment(
    State(app): State<App>,
    by: Member,
    at: PathKey,
    Json(new): Json<NewComment>,
) -> HandlerResult<Created<CommentResponse>> {
    let session: SessionId = at.id()?;
    let span = new.span()?;
    let comment = app.store.comments().add(&by.scope, session, new, span).await?;
    app.notify_session_changed(&app.store.sessions().get(&by.scope, session).await?);
    let location = format!("/api/v1/sessions/{session}/comments/{}", comment.id);
    Ok(Created { location, made: CommentResponse::new(comment, &by.scope) })
}

/// Withdraw an own comment, or delete one of a trainee
///
/// Administrators and the trainee's instructors delete the trainee's comments.
#[utoipa::path(delete, path = "/sessions/{id}/comments/{comment}", tag = "ratings",
    params(("id" = String, Path, description = "id"), ("comment" = String, Path, description = "id of the comment")),
    responses((status = NO_CONTENT)))]
pub async fn withdraw_comment(
    State(app): State<App>,
    by: Member,
    PathPair(session, comment): PathPair<SessionId, CommentId>,
) -> HandlerResult<StatusCode> {
    app.store.comments().withdraw(&by.scope, session, comment).await?;
    Ok(StatusCode::NO_CONTENT)
}
