//! Feedback that is new to a trainee: comments and ratings on own sessions that they have not opened since.

use std::collections::HashSet;

use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::auth::signed_in::Member;
use super::error::HandlerResult;
use super::read::{Json, PathKey};
use super::show::{NamedReference, Time};
use super::state::App;
use crate::domain::scope::Scope;
use crate::domain::text::Invalid;
use crate::ids::SessionId;
use crate::store::FeedbackEntry;
use crate::time::from_rfc3339;

/// Most sessions in the answer.
const MAX_SESSIONS: usize = 20;

/// Feedback that is new to the calling trainee.
#[derive(Debug, Serialize, ToSchema)]
pub struct FeedbackResponse {
    /// The sessions with new feedback, the latest feedback first; at most 20.
    items: Vec<SessionFeedback>,
    /// Number of all sessions with new feedback, counted up to 500 comments and ratings.
    sessions: usize,
    /// Own sessions with a result of the last 14 days that the trainee has not seen, and with it the advice that comes from
    /// it; the latest result first, at most 20.
    new_results: Vec<SessionId>,
}

/// New feedback on one session.
#[derive(Debug, Serialize, ToSchema)]
pub struct SessionFeedback {
    session: SessionId,
    task: NamedReference,
    recorded_at: Time,
    /// Number of new comments.
    comments: usize,
    /// Number of new ratings; of each person and form, one.
    ratings: usize,
    /// Names of the people who gave it, the latest first; without people whose account was deleted.
    who: Vec<String>,
    /// When the latest of it was given.
    latest_at: Time,
}

/// Which feedback was seen.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SeenFeedback {
    /// The `latest_at` of the newest feedback that the person has seen: later feedback stays new.
    #[schema(format = "date-time")]
    until: String,
}

/// When a session was opened.
#[derive(Debug, Serialize, ToSchema)]
pub struct OpeningResponse {
    /// When the trainee opened it before this time; `null` if never.
    before: Option<Time>,
}

/// Read the feedback that is new to the calling trainee
///
/// Comments and ratings of other people on the trainee's own sessions, and results, are new until the trainee opens the
/// session (`PUT /sessions/{id}/opening`), on any device. Only trainees may ask.
#[utoipa::path(get, path = "/feedback", tag = "ratings", responses((status = OK, body = FeedbackResponse)))]
pub async fn feedback(State(app): State<App>, by: Member) -> HandlerResult<Json<FeedbackResponse>> {
    Ok(Json(app.feedback_for(&by.scope).await?))
}

/// Mark the feedback until a moment as seen
#[utoipa::path(post, path = "/feedback/seen", tag = "ratings", request_body = SeenFeedback,
    responses((status = OK, body = FeedbackResponse)))]
pub async fn mark_seen(
    State(app): State<App>,
    by: Member,
    Json(seen): Json<SeenFeedback>,
) -> HandlerResult<Json<FeedbackResponse>> {
    let why = || Invalid::new("until", "expected a time such as 2026-05-01T08:00:00Z");
    let until_ms = from_rfc3339(&seen.until).ok_or_else(why)?;
    app.store.feedback().mark_all_seen(&by.scope, until_ms).await?;
    Ok(Json(app.feedback_for(&by.scope).await?))
}

/// Say that the calling trainee opens the session now
///
/// Feedback until now is no longer new. Only the trainee reads this time; it is erased with the session and the account.
#[utoipa::path(put, path = "/sessions/{id}/opening", tag = "ratings",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = OpeningResponse)))]
pub async fn open_session(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<Json<OpeningResponse>> {
    let before = app.store.feedback().open(&by.scope, at.id()?).await?;
    Ok(Json(OpeningResponse { before: before.map(Time) }))
}

impl App {
    async fn feedback_for(&self, scope: &Scope) -> HandlerResult<FeedbackResponse> {
        let feedback = self.store.feedback();
        let new_results = feedback.new_results(scope, MAX_SESSIONS as u32).await?;
        Ok(FeedbackResponse::of(feedback.unseen(scope).await?, new_results))
    }
}

impl FeedbackResponse {
    /// `entries`: newest first.
    fn of(entries: Vec<FeedbackEntry>, new_results: Vec<SessionId>) -> Self {
        let mut items: Vec<SessionFeedback> = Vec::new();
        let mut rated = HashSet::new();
        for entry in entries {
            let known = items.iter().position(|item| item.session == entry.session_id);
            let at = known.unwrap_or_else(|| {
                items.push(SessionFeedback::new(&entry));
                items.len() - 1
            });
            let item = &mut items[at];
            match entry.form {
                None => item.comments += 1,
                Some(form) => {
                    item.ratings += usize::from(rated.insert((entry.session_id, entry.person_id, form)));
                }
            }
            if let Some(who) = entry.who.map(String::from)
                && !item.who.contains(&who)
            {
                item.who.push(who);
            }
        }
        let sessions = items.len();
        items.truncate(MAX_SESSIONS);
        Self { items, sessions, new_results }
    }
}

impl SessionFeedback {
    fn new(entry: &FeedbackEntry) -> Self {
        let task = NamedReference {
            id: entry.task_id.to_string(),
            name: entry.task_name.to_string(),
            code: entry.task_code.to_string(),
        };
        let (recorded_at, latest_at) = (Time(entry.recorded_at_ms), Time(entry.created_at_ms));
        Self { session: entry.session_id, task, recorded_at, comments: 0, ratings: 0, who: Vec::new(), latest_at }
    }
}
