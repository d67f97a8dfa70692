//! Erasures that can be taken back, and what an erasure deletes.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::TraineeResponse;
use crate::domain::text::{Code, Name};
use crate::http::auth::signed_in::Staff;
use crate::http::error::HandlerResult;
use crate::http::read::{Json, PathKey};
use crate::http::show::{PageResponse, Time};
use crate::http::state::App;
use crate::ids::{SessionId, TraineeId};
use crate::store::{ErasureExtent, PendingErasure, StayingRecording};

/// Limit of sessions that are named one by one.
const MAX_STAYING: usize = 50;

/// What erasing a trainee deletes.
#[derive(Debug, Serialize, ToSchema)]
pub struct ErasureExtentResponse {
    /// Number of sessions, with their results, ratings and comments.
    sessions: usize,
    /// Number of hidden copies that are deleted with them: the same recordings in records that were merged into those of
    /// other people.
    hidden_copies: usize,
    /// Size of the recordings that are deleted, bytes.
    bytes: i64,
    /// The trainee's sessions whose whole recording stays, since it was cut and another person has another part: oldest
    /// first, at most 50. Erase that part as well to delete the recording.
    staying: Vec<StayingRecordingResponse>,
    /// Number of these sessions.
    staying_count: usize,
    /// Days for taking the erasure back, if it is requested so; 0: it cannot.
    days: u32,
}

/// A session of the trainee whose whole recording stays with another person.
#[derive(Debug, Serialize, ToSchema)]
pub struct StayingRecordingResponse {
    /// Id of the trainee's own session.
    session: SessionId,
    recorded_at: Time,
    /// Name of its task.
    task: String,
}

impl From<StayingRecording> for StayingRecordingResponse {
    fn from(StayingRecording { session_id, recorded_at_ms, task }: StayingRecording) -> Self {
        Self { session: session_id, recorded_at: Time(recorded_at_ms), task: task.into() }
    }
}

/// A trainee who waits for their erasure.
#[derive(Debug, Serialize, ToSchema)]
pub struct PendingErasureResponse {
    /// Id of the trainee.
    id: TraineeId,
    code: Code,
    name: Name,
    /// Number of sessions that are erased with them.
    sessions: i64,
    /// Name of the person who requested it; `null` if the person was deleted.
    who: Option<String>,
    requested_at: Time,
    /// When they are erased for good.
    erased_at: Time,
}

impl From<PendingErasure> for PendingErasureResponse {
    fn from(pending: PendingErasure) -> Self {
        let PendingErasure { trainee_id, code, name, sessions, who, requested_at_ms, due_at_ms } = pending;
        let (requested_at, erased_at) = (Time(requested_at_ms), Time(due_at_ms));
        Self { id: trainee_id, code, name, sessions, who: who.map(String::from), requested_at, erased_at }
    }
}

/// Read what erasing a trainee would delete
#[utoipa::path(get, path = "/trainees/{id}/erasure", tag = "trainees",
    params(("id" = String, Path, description = "id or code")), responses((status = OK, body = ErasureExtentResponse)))]
pub async fn erasure_extent(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
) -> HandlerResult<Json<ErasureExtentResponse>> {
    let ErasureExtent { sessions, hidden_copies, bytes, staying } =
        app.store.pending_erasures().extent(&by.scope, &key).await?;
    let (days, staying_count) = (app.retention.erase_days, staying.len());
    let staying = staying.into_iter().take(MAX_STAYING).map(StayingRecordingResponse::from).collect();
    Ok(Json(ErasureExtentResponse { sessions, hidden_copies, bytes, staying, staying_count, days }))
}

/// List the trainees who wait for their erasure, the next due first
///
/// They are in no other list, and their sessions count nowhere. Instructors see those of their groups.
#[utoipa::path(get, path = "/pending-erasures", tag = "trainees",
    responses((status = OK, body = PageResponse<PendingErasureResponse>)))]
pub async fn pending_erasures(
    State(app): State<App>,
    by: Staff,
) -> HandlerResult<Json<PageResponse<PendingErasureResponse>>> {
    let pending = app.store.pending_erasures().list(&by.scope).await?;
    Ok(Json(PageResponse::whole(pending.into_iter().map(PendingErasureResponse::from))))
}

/// Take the erasure of a trainee back
///
/// Account, recordings and results are as before. A trainee who waits for no erasure gives 404.
#[utoipa::path(post, path = "/trainees/{id}/restore", tag = "trainees",
    params(("id" = String, Path, description = "id or code")), responses((status = OK, body = TraineeResponse)))]
pub async fn restore(State(app): State<App>, by: Staff, PathKey(key): PathKey) -> HandlerResult<Json<TraineeResponse>> {
    let trainee = app.store.pending_erasures().take_back(&by.scope, &key).await?;
    Ok(Json(TraineeResponse::new(trainee, &by.scope)))
}
