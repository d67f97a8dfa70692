//! Assigns recordings that wait for a name.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use crate::domain::scope::Scope;
use crate::domain::waiting_recording::{RecordingAssignment, RecordingAssignments};
use crate::http::auth::signed_in::Staff;
use crate::http::error::{HandlerResult, ProblemDocument, ProblemResponse};
use crate::http::read::Json;
use crate::http::state::App;
use crate::ids::{SessionId, WaitingRecordingId};

/// The result of each recording, in the order of the request.
#[derive(Debug, Serialize, ToSchema)]
pub struct AssignmentResults {
    results: Vec<AssignmentResult>,
}

/// The result of one recording.
#[derive(Debug, Serialize, ToSchema)]
pub struct AssignmentResult {
    id: WaitingRecordingId,
    /// The session that it became; `null` if it waits on.
    session: Option<SessionId>,
    /// True if the session is tracked only when its box has a camera and colours.
    waits_for_box: bool,
    /// Why it waits on; `null` if it became a session. `consent-missing`: the trainee does not consent to recordings.
    /// `duplicate-recording`: the trainee has this recording already, as `session`. `not-found`: it was assigned or
    /// discarded meanwhile.
    #[schema(value_type = Option<ProblemDocument>)]
    problem: Option<serde_json::Value>,
}

/// Assign recordings to trainees
///
/// Each recording is assigned on its own: `results` has its result, in the order of the request. It becomes a
/// session with the same id, and is tracked. Its arrival stays the time at which it arrived here. It counts as
/// supervised only if the caller says so.
#[utoipa::path(post, path = "/waiting-recordings/assign", tag = "waiting recordings",
    request_body = RecordingAssignments, responses((status = OK, body = AssignmentResults)))]
pub async fn assign(
    State(app): State<App>,
    by: Staff,
    Json(new): Json<RecordingAssignments>,
) -> HandlerResult<Json<AssignmentResults>> {
    new.check()?;
    let mut results = Vec::with_capacity(new.items.len());
    for one in new.items {
        results.push(app.assign_one(&by.scope, one).await?);
    }
    Ok(Json(AssignmentResults { results }))
}

impl App {
    /// Assigns one recording.
    ///
    /// # Errors
    /// A fault of the service, which would meet the other recordings as well.
    async fn assign_one(&self, scope: &Scope, one: RecordingAssignment) -> HandlerResult<AssignmentResult> {
        let id = one.id;
        match self.intake.assign(scope, one).await {
            Ok(done) => Ok(AssignmentResult {
                id,
                session: Some(done.session),
                waits_for_box: done.waits_for_box,
                problem: None,
            }),
            Err(error) => {
                let problem = ProblemResponse::from(error);
                if problem.refusal.row().2.is_server_error() {
                    return Err(problem);
                }
                Ok(AssignmentResult { id, session: None, waits_for_box: false, problem: Some(problem.document()) })
            }
        }
    }
}
