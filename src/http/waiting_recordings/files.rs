//! The video of a recording that waits for a name, and a picture of it.

use axum::extract::State;
use axum::http::{HeaderMap, Method};
use axum::response::Response;

use crate::analysis::QuickAnalysisError;
use crate::domain::blob::BlobHash;
use crate::domain::problem::Problem;
use crate::domain::scope::Scope;
use crate::http::auth::signed_in::Staff;
use crate::http::error::{HandlerResult, ProblemDocument, ProblemResponse, Refusal};
use crate::http::file::{StoredFile, disposition};
use crate::http::read::PathKey;
use crate::http::state::App;
use crate::ids::WaitingRecordingId;

/// Play a recording that waits for a name: the whole file, or the part that `Range` names
#[utoipa::path(get, path = "/waiting-recordings/{id}/video", tag = "waiting recordings",
    params(("id" = String, Path, description = "id")),
    responses((status = OK, description = "The recording as it was sent", content_type = "video/*"),
        (status = PARTIAL_CONTENT, description = "The requested part", content_type = "video/*"),
        (status = 416, description = "Refused: `range-not-satisfiable`", content_type = "application/problem+json",
            body = ProblemDocument)))]
pub async fn video(
    State(app): State<App>,
    by: Staff,
    at: PathKey,
    method: Method,
    headers: HeaderMap,
) -> HandlerResult<Response> {
    let found = app.store.waiting_recordings().get(&by.scope, at.id()?).await?;
    let disposition = disposition("inline", found.filename.as_str());
    app.waiting_file(found.video, found.media_type, disposition).await?.answer(&method, &headers).await
}

/// Read a picture of a recording that waits for a name
///
/// Of a recording that was not looked at yet, the picture is made now. If none can be made, `unreadable` of the
/// recording says why.
#[utoipa::path(get, path = "/waiting-recordings/{id}/preview.jpg", tag = "waiting recordings",
    params(("id" = String, Path, description = "id")),
    responses((status = OK, description = "One frame", content_type = "image/jpeg")))]
pub async fn preview(
    State(app): State<App>,
    by: Staff,
    at: PathKey,
    method: Method,
    headers: HeaderMap,
) -> HandlerResult<Response> {
    let preview = app.preview_of(&by.scope, at.id()?).await?.ok_or_else(ProblemResponse::not_found)?;
    let disposition = disposition("inline", "preview.jpg");
    app.waiting_file(preview, "image/jpeg".to_owned(), disposition).await?.answer(&method, &headers).await
}

impl App {
    /// The picture of a recording, made if it is missing; `None` if none can be made.
    pub(super) async fn preview_of(&self, scope: &Scope, id: WaitingRecordingId) -> HandlerResult<Option<BlobHash>> {
        let found = self.store.waiting_recordings().get(scope, id).await?;
        if found.preview.is_some() || found.unreadable.is_some() {
            return Ok(found.preview);
        }
        let why = match self.quick_analysis.thumbnail(found.video).await {
            Ok(made) if !made.jpeg.is_empty() => {
                let kept = self.vault.put(&made.jpeg).await?;
                self.store.waiting_recordings().set_preview(id, Ok(kept.blob())).await?;
                return Ok(Some(kept.blob().hash));
            }
            Ok(_) => "No picture can be made of it.".to_owned(),
            Err(QuickAnalysisError::Problem(problem)) => sentence(&problem),
            Err(QuickAnalysisError::Crashed(_) | QuickAnalysisError::TimedOut(_)) => {
                "Its first pictures could not be decoded: the decoder crashed or took too long.".to_owned()
            }
            Err(error) => return Err(error.into()), // of this machine, not of the recording: try again later
        };
        self.store.waiting_recordings().set_preview(id, Err(why)).await?;
        Ok(None)
    }

    async fn waiting_file(&self, hash: BlobHash, media_type: String, disposition: String) -> HandlerResult<StoredFile> {
        let (file, length) = match self.vault.open_blob(hash).await {
            Ok(opened) => opened,
            Err(error) => return Err(self.lost_waiting_file(hash, error).await?),
        };
        let etag = format!("\"{hash}\"");
        Ok(StoredFile { file: tokio::fs::File::from_std(file), length, etag, media_type, disposition })
    }

    /// The problem for a file that cannot be opened: 404 if it was discarded meanwhile, 409 if it is lost.
    async fn lost_waiting_file(
        &self,
        hash: BlobHash,
        error: crate::vault::VaultError,
    ) -> HandlerResult<ProblemResponse> {
        let Some(loss) = error.loss() else { return Ok(error.into()) };
        if !self.store.blobs().has(hash).await? {
            return Ok(ProblemResponse::not_found());
        }
        tracing::error!(file = hash.file(), %loss, "stored file lost; answered with status 409");
        let loss = loss.name();
        Ok(Refusal::Conflict.with(format!(
            "The stored file of this recording is {loss}. Ask an administrator to restore it from a backup."
        )))
    }
}

/// A problem as sentences.
fn sentence(problem: &Problem) -> String {
    let mut letters = problem.detail.chars();
    let detail: String = letters.next().map(|first| first.to_uppercase().chain(letters).collect()).unwrap_or_default();
    format!("{}. {}.", problem.title, detail.trim_end_matches('.'))
}
