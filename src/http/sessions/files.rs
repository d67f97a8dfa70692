//! The files of a session: the recording, a picture of it, what the tracker saw.

use axum::extract::State;
use axum::http::{HeaderMap, Method, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::IntoParams;

use super::trajectory::MOST;
use crate::analysis::diagnostics;
use crate::analysis::edits::Swaps;
use crate::analysis::paths::Paths;
use crate::domain::blob::BlobHash;
use crate::domain::edit::Change;
use crate::domain::scope::Scope;
use crate::domain::text::TrackerName;
use crate::http::auth::signed_in::Member;
use crate::http::error::{Answer, Problem, ProblemDocument, Refusal};
use crate::http::file::{StoredFile, disposition};
use crate::http::read::{At, Params};
use crate::http::state::App;
use crate::ids::SessionId;
use crate::store::SessionResult;

/// Play the recording: whole, or the part that `Range` names
#[utoipa::path(get, path = "/sessions/{id}/video", tag = "sessions", params(("id" = String, Path, description = "id")),
    responses((status = OK, description = "The recording as it was sent", content_type = "video/*"),
        (status = PARTIAL_CONTENT, description = "The part that was asked for", content_type = "video/*"),
        (status = 416, description = "Refused: `range-not-satisfiable`", content_type = "application/problem+json", body = ProblemDocument)))]
pub async fn video(State(app): State<App>, by: Member, at: At, method: Method, headers: HeaderMap) -> Answer<Response> {
    let session = app.store.sessions().get(&by.scope, at.id()?).await?;
    if let Some(tracker) = session.tracker {
        return Err(no_picture(&tracker));
    }
    let disposition = disposition("inline", session.filename.as_str());
    let video = session.video.ok_or_else(Problem::not_found)?;
    app.stored(video, session.media_type, disposition).await?.answer(&method, &headers).await
}

/// A picture of the recording
#[utoipa::path(get, path = "/sessions/{id}/preview.jpg", tag = "sessions",
    params(("id" = String, Path, description = "id")),
    responses((status = OK, description = "One frame", content_type = "image/jpeg")))]
pub async fn preview(
    State(app): State<App>,
    by: Member,
    at: At,
    method: Method,
    headers: HeaderMap,
) -> Answer<Response> {
    let result = app.result(&by.scope, at.id()?).await?;
    let preview = result.preview.ok_or_else(Problem::not_found)?;
    let disposition = disposition("inline", "preview.jpg");
    app.stored(preview, "image/jpeg".to_owned(), disposition).await?.answer(&method, &headers).await
}

/// Which frames.
#[derive(Clone, Copy, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct Frames {
    /// Only from this frame on.
    from_frame: Option<u64>,
    /// Only before this frame.
    to_frame: Option<u64>,
}

/// What the tracker saw on every frame, and why it dropped what it dropped
///
/// Tools go by the names that they have by the session's edits. What was trimmed off was seen all the same, and is in it.
#[utoipa::path(get, path = "/sessions/{id}/diagnostics", tag = "sessions",
    params(("id" = String, Path, description = "id"), Frames),
    responses((status = OK, description = "Columns: borders and tips in pixels of the recorded frame, reasons", body = Object)))]
pub async fn diagnostics(
    State(app): State<App>,
    by: Member,
    at: At,
    Params(frames): Params<Frames>,
    method: Method,
    headers: HeaderMap,
) -> Answer<Response> {
    let id = at.id()?;
    let result = app.result(&by.scope, id).await?;
    let stored = result.diagnostics.ok_or_else(Problem::not_found)?;
    let disposition = disposition("inline", "diagnostics.json");
    let mut swaps = app.store.edits().in_force(id).await?.changes;
    swaps.retain(|change| matches!(change, Change::Swap(..)));
    if frames.from_frame.or(frames.to_frame).is_some() || !swaps.is_empty() {
        let files = (app.vault.read(stored, MOST).await?, app.vault.read(result.trajectory, MOST).await?);
        // A long session takes a moment to read: not on a thread that serves others.
        let written = tokio::task::spawn_blocking(move || part(&files, frames, &swaps));
        let part = written.await.map_err(|cause| Problem::internal("reading diagnostics", cause))??;
        return Ok(([(header::CONTENT_TYPE, "application/json")], part).into_response());
    }
    app.stored(stored, "application/json".to_owned(), disposition).await?.answer(&method, &headers).await
}

/// Some frames of diagnostics and trajectory, with names exchanged.
fn part((seen, path): &(Vec<u8>, Vec<u8>), frames: Frames, swaps: &[Change]) -> Answer<Vec<u8>> {
    let failed = |cause: String| Problem::internal("reading diagnostics", cause);
    let frames = frames.from_frame.unwrap_or(0)..frames.to_frame.unwrap_or(u64::MAX);
    if swaps.is_empty() {
        return diagnostics::part(seen, frames, |_, tool| tool).map_err(|cause| failed(cause.to_string()));
    }
    let paths = Paths::from_bytes(path).map_err(|cause| failed(cause.to_string()))?;
    let swaps = Swaps::of(&paths, swaps);
    let time_of = |frame: u64| paths.frame_times_s.get(frame as usize).copied();
    let name_at = |frame, tool| time_of(frame).map_or(tool, |time_s| swaps.name_at(tool, time_s));
    diagnostics::part(seen, frames, name_at).map_err(|cause| failed(cause.to_string()))
}

/// A session of another tracker's rows has no recording.
fn no_picture(tracker: &TrackerName) -> Problem {
    Refusal::Conflict.with(format!(
        "The session was imported from {tracker} and has no video. Its path is at `trajectory`, its features are in the session."
    ))
}

impl App {
    /// The latest result of a session; a session without one is told apart from one that is not there.
    pub(super) async fn result(&self, scope: &Scope, id: SessionId) -> Answer<SessionResult> {
        let result = self.store.sessions().result(scope, id).await?;
        result.ok_or_else(|| {
            Refusal::Conflict.with(
                "The session is not tracked yet. Wait until its status is `done`; its `error` says why if it is not.",
            )
        })
    }

    /// A file of the vault, to be sent.
    async fn stored(&self, hash: BlobHash, media_type: String, disposition: String) -> Answer<StoredFile> {
        let (file, length) = self.vault.open_blob(hash).await?;
        let etag = format!("\"{hash}\"");
        Ok(StoredFile { file: tokio::fs::File::from_std(file), length, etag, media_type, disposition })
    }
}
