//! The files of a session: the recording, a preview picture, the tracker's diagnostics.

use axum::extract::State;
use axum::http::{HeaderMap, Method, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::IntoParams;

use crate::analysis::edits::Swaps;
use crate::analysis::stored_rows::{NameAt, StoredDiagnostics, StoredPaths, StoredRowsError};
use crate::domain::access::AccessedPart;
use crate::domain::blob::BlobHash;
use crate::domain::edit::{EditChange, EditsInForce};
use crate::domain::scope::Scope;
use crate::domain::text::TrackerName;
use crate::http::auth::signed_in::Member;
use crate::http::error::{HandlerResult, ProblemDocument, ProblemResponse, Refusal};
use crate::http::file::{StoredFile, disposition};
use crate::http::heavy::{HeavySlot, Pieces};
use crate::http::read::{Params, PathKey};
use crate::http::state::App;
use crate::ids::SessionId;
use crate::store::SessionResult;
use crate::vault::FileLoss;

/// Play the recording: the whole file, or the part that `Range` names
#[utoipa::path(get, path = "/sessions/{id}/video", tag = "sessions", params(("id" = String, Path, description = "id")),
    responses((status = OK, description = "The recording as it was sent", content_type = "video/*"),
        (status = PARTIAL_CONTENT, description = "The requested part", content_type = "video/*"),
        (status = 410, description = "Refused: `gone`, because the video was deleted", content_type = "application/problem+json",
            body = ProblemDocument),
        (status = 416, description = "Refused: `range-not-satisfiable`", content_type = "application/problem+json",
            body = ProblemDocument)))]
pub async fn video(
    State(app): State<App>,
    by: Member,
    at: PathKey,
    method: Method,
    headers: HeaderMap,
) -> HandlerResult<Response> {
    let session = app.store.sessions().get(&by.scope, at.id()?).await?;
    if let Some(tracker) = session.tracker {
        return Err(no_video(&tracker));
    }
    if let Some(deleted) = session.video_deleted() {
        return Err(Refusal::Gone.with(sentence(&deleted)));
    }
    let disposition = disposition("inline", session.filename.as_str());
    let video = session.video.ok_or_else(ProblemResponse::not_found)?;
    let of = FileOwner { scope: &by.scope, session: session.id };
    app.note_access(of.scope, of.session, AccessedPart::Video);
    app.stored_file(of, video, session.media_type, disposition).await?.answer(&method, &headers).await
}

/// Read a picture of the recording
#[utoipa::path(get, path = "/sessions/{id}/preview.jpg", tag = "sessions",
    params(("id" = String, Path, description = "id")),
    responses((status = OK, description = "One frame", content_type = "image/jpeg")))]
pub async fn preview(
    State(app): State<App>,
    by: Member,
    at: PathKey,
    method: Method,
    headers: HeaderMap,
) -> HandlerResult<Response> {
    let of = FileOwner { scope: &by.scope, session: at.id()? };
    let result = app.result(of.scope, of.session).await?;
    let preview = result.preview.ok_or_else(ProblemResponse::not_found)?;
    let disposition = disposition("inline", "preview.jpg");
    app.note_access(of.scope, of.session, AccessedPart::Video);
    app.stored_file(of, preview, "image/jpeg".to_owned(), disposition).await?.answer(&method, &headers).await
}

/// Selects frames.
#[derive(Clone, Copy, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct FrameRangeQuery {
    /// Only this frame and later ones.
    from_frame: Option<u64>,
    /// Only frames before this one.
    to_frame: Option<u64>,
}

/// Read what the tracker saw on every frame
///
/// Includes the reasons for rejected measurements. The names of the tools follow the session's edits. Frames that were
/// trimmed off are included.
#[utoipa::path(get, path = "/sessions/{id}/diagnostics", tag = "sessions",
    params(("id" = String, Path, description = "id"), FrameRangeQuery),
    responses((status = OK, description = "Columns: borders and tips in pixels of the recorded frame, reasons",
            body = Object)))]
pub async fn diagnostics(
    State(app): State<App>,
    by: Member,
    at: PathKey,
    Params(frames): Params<FrameRangeQuery>,
    method: Method,
    headers: HeaderMap,
) -> HandlerResult<Response> {
    let id = at.id()?;
    let of = FileOwner { scope: &by.scope, session: id };
    let (stored, _, swaps) = app.diagnostics_with_swaps(&by.scope, id).await?;
    app.note_access(of.scope, of.session, AccessedPart::Path);
    if frames.from_frame.or(frames.to_frame).is_some() || !swaps.is_empty() {
        let slot = app.heavy_answers.take(&by.scope).await?;
        // Again: during the wait the session may have been tracked again, or the caller may have lost access.
        let (stored, path, swaps) = app.diagnostics_with_swaps(&by.scope, id).await?;
        let seen = app.stored_diagnostics(&slot, of, stored).await?;
        let names: NameAt = if swaps.is_empty() {
            Box::new(|_, tool| Ok(tool))
        } else {
            swapped_names(&app.stored_paths(&slot, of, path).await?, &swaps)
        };
        let frames = frames.from_frame.unwrap_or(0)..frames.to_frame.unwrap_or(u64::MAX);
        let part: Pieces = Box::new(seen.select_frames(frames, names));
        let body = slot.body(|| Ok(part)).await?;
        return Ok(([(header::CONTENT_TYPE, "application/json")], body).into_response());
    }
    let disposition = disposition("inline", "diagnostics.json");
    app.stored_file(of, stored, "application/json".to_owned(), disposition).await?.answer(&method, &headers).await
}

/// The session that a stored file belongs to, and the caller who reads it.
#[derive(Clone, Copy)]
pub(super) struct FileOwner<'a> {
    /// The caller's scope.
    pub(super) scope: &'a Scope,
    /// The session.
    pub(super) session: SessionId,
}

/// The names of tools on each frame, with these swaps.
fn swapped_names(path: &StoredPaths, swaps: &[EditChange]) -> NameAt {
    let (mut times, swaps) = (path.frame_times(), Swaps::of(path.tools(), swaps));
    Box::new(move |frame, tool| Ok(times.at(frame)?.map_or(tool, |time_s| swaps.name_at(tool, time_s))))
}

/// The reason as a sentence: with a capital and a full stop.
fn sentence(reason: &str) -> String {
    let (first, rest) = reason.split_at(reason.chars().next().map_or(0, char::len_utf8));
    format!("{}{rest}.", first.to_uppercase())
}

/// The problem for a session that was imported from another tracker: it has no recording.
fn no_video(tracker: &TrackerName) -> ProblemResponse {
    Refusal::Conflict.with(format!(
        "The session was imported from {tracker} and has no video. Read its path at `trajectory`; the session holds \
         its features."
    ))
}

fn not_tracked() -> ProblemResponse {
    Refusal::Conflict.with(
        "The session is not tracked yet. Wait until its status is `done`. If tracking failed, `error` of the session \
         gives the reason.",
    )
}

impl App {
    /// The latest result of a session. A session without a result gives 409, a missing session 404.
    pub(super) async fn result(&self, scope: &Scope, id: SessionId) -> HandlerResult<SessionResult> {
        self.store.sessions().result(scope, id).await?.ok_or_else(not_tracked)
    }

    /// The latest result with the edits in force at the same moment; refuses like [`Self::result`].
    pub(super) async fn result_with_edits(
        &self,
        scope: &Scope,
        id: SessionId,
    ) -> HandlerResult<(SessionResult, EditsInForce)> {
        self.store.sessions().result_with_edits(scope, id).await?.ok_or_else(not_tracked)
    }

    /// A session's diagnostics, its path, and the swaps of tools in force.
    async fn diagnostics_with_swaps(
        &self,
        scope: &Scope,
        id: SessionId,
    ) -> HandlerResult<(BlobHash, BlobHash, Vec<EditChange>)> {
        let (result, mut edits) = self.result_with_edits(scope, id).await?;
        edits.changes.retain(|change| matches!(change, EditChange::Swap(..)));
        let diagnostics = result.diagnostics.ok_or_else(ProblemResponse::not_found)?;
        Ok((diagnostics, result.trajectory, edits.changes))
    }

    /// Opens a session's paths for reading by rows.
    pub(super) async fn stored_paths(
        &self,
        slot: &HeavySlot,
        of: FileOwner<'_>,
        hash: BlobHash,
    ) -> HandlerResult<StoredPaths> {
        let app = self.clone();
        let opened = slot.complete(async move { app.stored_indexes.open_paths(&app.vault, hash).await }).await?;
        self.unless_lost(of, hash, opened).await
    }

    /// Opens a session's diagnostics for reading by frames.
    async fn stored_diagnostics(
        &self,
        slot: &HeavySlot,
        of: FileOwner<'_>,
        hash: BlobHash,
    ) -> HandlerResult<StoredDiagnostics> {
        let app = self.clone();
        let opened = slot.complete(async move { app.stored_indexes.open_diagnostics(&app.vault, hash).await }).await?;
        self.unless_lost(of, hash, opened).await
    }

    /// Opens a file of the vault for sending.
    async fn stored_file(
        &self,
        of: FileOwner<'_>,
        hash: BlobHash,
        media_type: String,
        disposition: String,
    ) -> HandlerResult<StoredFile> {
        let opened = self.vault.open_blob(hash).await.map_err(StoredRowsError::from);
        let (file, length) = self.unless_lost(of, hash, opened).await?;
        let etag = format!("\"{hash}\"");
        Ok(StoredFile { file: tokio::fs::File::from_std(file), length, etag, media_type, disposition })
    }

    /// A stored file that was opened.
    ///
    /// # Errors
    /// If it is lost: 409, which names it for administrators, as the log does. 404 if the session was erased meanwhile.
    async fn unless_lost<T>(
        &self,
        FileOwner { scope, session }: FileOwner<'_>,
        hash: BlobHash,
        opened: Result<T, StoredRowsError>,
    ) -> HandlerResult<T> {
        let Err(StoredRowsError::Vault(error)) = opened else { return Ok(opened?) };
        let Some(loss) = error.loss() else { return Err(error.into()) };
        if !self.store.blobs().has(hash).await? {
            return Err(ProblemResponse::not_found());
        }
        tracing::error!(%session, file = hash.file(), %loss, "stored file lost; answered with status 409");
        Err(lost(scope, hash, &loss))
    }
}

/// The problem for a stored file that is missing or damaged.
fn lost(scope: &Scope, hash: BlobHash, loss: &FileLoss) -> ProblemResponse {
    let (loss, file) = (loss.name(), hash.file());
    if !scope.is_administrator() {
        let detail =
            format!("A stored file of this session is {loss}. Ask an administrator to restore it from a backup.");
        return Refusal::Conflict.with(detail);
    }
    let detail = format!(
        "The stored file `{file}` of this session is {loss}. Copy it from a backup that has it to the same place in \
         the data folder, while the service runs or not."
    );
    Refusal::Conflict.with(detail).member("stored_file", file)
}
