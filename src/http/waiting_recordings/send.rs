//! Receives a recording without a name in one request; the video is the body.

use axum::extract::{Request, State};
use futures_util::StreamExt;
use serde::Deserialize;
use utoipa::IntoParams;

use super::WaitingRecordingResponse;
use super::proposals::Proposer;
use crate::domain::scope::Scope;
use crate::http::auth::signed_in::StaffOrAgent;
use crate::http::error::{HandlerResult, ProblemResponse, Refusal};
use crate::http::read::{Params, content_length};
use crate::http::sessions::refuse_forms;
use crate::http::show::Created;
use crate::http::state::App;
use crate::ids::WaitingRecordingId;
use crate::intake::UnnamedDescription;
use crate::store::ArrivedRecording;

/// What is known of the recording.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct SendUnnamedQuery {
    /// The task, by id or code, if it is known.
    task: Option<String>,
    /// The box, by id or code, if it is known. The agent of a box sends from its own only, which is the default.
    #[serde(rename = "box")]
    #[param(rename = "box")]
    in_box: Option<String>,
    /// Name of the file, for people.
    filename: Option<String>,
    /// When it was recorded, RFC 3339; default: when it arrives.
    recorded_at: Option<String>,
    /// The true frame rate, Hz, where the file's time stamps are wrong. All times are scaled to it.
    #[param(value_type = Option<f64>)]
    true_frame_rate_hz: Option<String>,
    /// The true time from the first frame to the last, s: instead of the frame rate.
    #[param(value_type = Option<f64>)]
    true_duration_s: Option<String>,
}

/// Send a recording without a name in one request
///
/// For staff, and for the agent of a box. The recording is stored and waits until staff say whose it is; until then it
/// is not tracked. One that the service has already is refused with `duplicate-recording`: the problem names the
/// `waiting_recording`, or the `session` if the caller sees it. If the connection breaks, the recording has to be sent
/// again from the beginning.
#[utoipa::path(post, path = "/waiting-recordings", tag = "waiting recordings", params(SendUnnamedQuery),
    request_body(content = Vec<u8>, content_type = "application/octet-stream",
        description = "The video: MP4/MOV, Matroska/WebM, AVI or MPEG-TS"),
    responses((status = CREATED, body = WaitingRecordingResponse)))]
pub async fn send(
    State(app): State<App>,
    by: StaffOrAgent,
    Params(of): Params<SendUnnamedQuery>,
    request: Request,
) -> HandlerResult<Created<WaitingRecordingResponse>> {
    refuse_forms(&request)?;
    let SendUnnamedQuery { task, in_box, filename, recorded_at, true_frame_rate_hz, true_duration_s } = of;
    let about = UnnamedDescription { task, in_box, filename, recorded_at, true_frame_rate_hz, true_duration_s };
    let recording = app.intake.resolve_unnamed(&by.scope, about).await?;
    if let Some(length) = content_length(request.headers()) {
        app.intake.check_length(length)?;
    }
    let (intake, scope) = (app.intake.clone(), by.scope.clone());
    let bytes = request.into_body().into_data_stream().map(|bytes| bytes.map_err(Into::into));
    // In a separate task: a sender that closes right after its last byte must not cancel the intake.
    let taken = app.shutdown.spawn(async move { intake.take_unnamed(&scope, recording, bytes).await });
    let arrived = taken.await.map_err(|cause| ProblemResponse::internal("receiving a recording", cause))??;
    let id = match arrived {
        ArrivedRecording::New(id) => id,
        known => return Err(app.known_recording(&by.scope, known).await),
    };
    app.make_preview_later(id);
    let found = app.store.waiting_recordings().get(&Scope::service(), id).await?;
    let made = app.shown_waiting(found, &Proposer::default());
    Ok(Created { location: format!("/api/v1/waiting-recordings/{id}"), made })
}

impl App {
    /// The problem for a recording that the service has already. It names a session only to callers who see it.
    async fn known_recording(&self, scope: &Scope, known: ArrivedRecording) -> ProblemResponse {
        let problem = Refusal::DuplicateRecording.with(
            "The service has this recording already: it waits for a name, or it is a session. Do not send it again.",
        );
        match known {
            ArrivedRecording::Session(id) if scope.is_staff() && self.store.sessions().get(scope, id).await.is_ok() => {
                problem.member("session", format!("/api/v1/sessions/{id}"))
            }
            ArrivedRecording::Session(_) => problem,
            ArrivedRecording::New(id) | ArrivedRecording::Waiting(id) => {
                problem.member("waiting_recording", format!("/api/v1/waiting-recordings/{id}"))
            }
        }
    }

    /// Makes the picture of a recording without a name in the background.
    fn make_preview_later(&self, id: WaitingRecordingId) {
        let app = self.clone();
        self.shutdown.spawn(async move {
            if let Err(problem) = app.preview_of(&Scope::service(), id).await {
                tracing::debug!(%id, why = problem.detail(), "no picture of a recording yet; made when it is opened");
            }
        });
    }
}
