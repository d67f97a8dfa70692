//! Receives a live stream as the body of one request, while it is recorded (`docs/push.md`).

use std::time::Duration;

use axum::body::BodyDataStream;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, header};
use futures_util::StreamExt;
use serde::{Deserialize, Serialize};
use tokio::time::timeout;
use utoipa::{IntoParams, ToSchema};

use super::auth::signed_in::SignedIn;
use super::connection_slots::ConnectionSlot;
use super::error::{HandlerResult, ProblemResponse};
use super::read::{Params, PathKey, reference_problem};
use super::sessions::SessionResponse;
use super::show::Created;
use super::state::App;
use crate::domain::text::Key;
use crate::ids::SessionId;
use crate::live::{Push, PushFailure};
use crate::store::StoreError;

/// How long the body of a refused sender is still read. A sender whose connection is cut while it sends does not read
/// the answer.
const DRAIN_TIMEOUT: Duration = Duration::from_secs(2);

/// What the stream records.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct PushQuery {
    /// The trainee, by id or code; a trainee may leave it out.
    trainee: Option<String>,
    /// The task, by id or code.
    #[param(required)]
    task: Option<String>,
}

/// The session that the stream became; only its id for a box's agent, which may not read sessions.
#[derive(Serialize, ToSchema)]
#[serde(untagged)]
pub enum PushResponse {
    /// For people.
    Session(Box<SessionResponse>),
    /// For a box's agent.
    Id {
        /// The session's id.
        id: String,
    },
}

/// Push a live stream of a box
///
/// The body is MPEG-TS or Matroska of any length, sent while it is recorded, as `ffmpeg -f mpegts -method PUT`
/// does; `docs/push.md` describes it. The recording ends with the body. If the stream breaks off, the part that
/// was received becomes a session, and the problem names it as `session`. For the box's agent, and for people who
/// may send recordings.
#[utoipa::path(put, path = "/boxes/{id}/feed.ts", tag = "boxes",
    params(("id" = String, Path, description = "id or code"), PushQuery),
    request_body(content = Vec<u8>, content_type = "video/mp2t",
        description = "MPEG-TS or Matroska, while it is recorded"),
    responses((status = CREATED, body = PushResponse)))]
pub async fn push(
    State(app): State<App>,
    by: HandlerResult<SignedIn>,
    PathKey(in_box): PathKey,
    Params(of): Params<PushQuery>,
    request: Request,
) -> HandlerResult<Created<PushResponse>> {
    let name = in_box.as_str().to_owned();
    let (push, place) = admit(&app, by, in_box, of, request.headers()).await.inspect_err(|problem| {
        tracing::warn!(in_box = name, why = problem.detail(), "push refused"); // most senders do not show the answer
    })?;
    let scope = push.scope.clone();
    // In a separate task: senders close right after their last byte, which would cancel this handler.
    let taken = app.shutdown.spawn(receive(app.clone(), push, request, place));
    let session = taken.await.map_err(|cause| ProblemResponse::internal("receiving a stream", cause))??;
    let made = match app.store.sessions().get(&scope, session).await {
        Ok(session) => PushResponse::Session(Box::new(SessionResponse::of(session, None))),
        Err(StoreError::NotFound { .. }) => PushResponse::Id { id: session.to_string() },
        Err(error) => return Err(error.into()),
    };
    Ok(Created { location: format!("/api/v1/sessions/{session}"), made })
}

/// Checks everything that can be checked before the stream arrives, and takes a feed slot.
async fn admit(
    app: &App,
    by: HandlerResult<SignedIn>,
    in_box: Key,
    of: PushQuery,
    headers: &HeaderMap,
) -> HandlerResult<(Push, ConnectionSlot)> {
    let SignedIn { scope } = by?;
    let missing = |field| move || ProblemResponse::invalid(field, "is missing; give the id or the code");
    let trainee =
        of.trainee.or_else(|| scope.own_trainee().map(|own| own.to_string())).ok_or_else(missing("trainee"))?;
    let task = of.task.ok_or_else(missing("task"))?;
    let (store, sender_scope) = (&app.store, scope.upload_scope());
    let box_id = store.boxes().get(&scope, &in_box).await?.id;
    let found = store.trainees().get(&sender_scope, &Key::from(&trainee)).await;
    store.consents().require(&sender_scope, found.map_err(reference_problem("trainee"))?.id).await?;
    store.tasks().get(&sender_scope, &Key::from(&task)).await.map_err(reference_problem("task"))?;
    app.feeds.check_free(box_id).await?;
    let place = app.take_feed_slot(&scope)?;
    let sender = headers.get(header::USER_AGENT).and_then(|agent| agent.to_str().ok()).unwrap_or_default().to_owned();
    Ok((Push { scope, in_box, trainee, task, sender }, place))
}

async fn receive(app: App, push: Push, request: Request, place: ConnectionSlot) -> Result<SessionId, PushFailure> {
    let (name, headers) = (push.in_box.as_str().to_owned(), request.headers().clone());
    let mut body = request.into_body().into_data_stream();
    let bytes = (&mut body).map(|bytes| bytes.map_err(Into::into));
    let taken = app.feeds.push(push, bytes, SignedIn::wait_until_ended(&app, &headers)).await;
    drop(place);
    match &taken {
        Ok(session) => tracing::info!(in_box = name, %session, "push ended; recording complete"),
        Err(PushFailure { why, session }) => {
            let session = session.map(tracing::field::display);
            tracing::warn!(in_box = name, %why, session, "push broke off");
            tokio::spawn(drain_body(body));
        }
    }
    taken
}

/// Reads the rest of the body for up to [`DRAIN_TIMEOUT`], while the answer is sent.
async fn drain_body(mut body: BodyDataStream) {
    let _ = timeout(DRAIN_TIMEOUT, async { while let Some(Ok(_)) = body.next().await {} }).await; // a timeout is fine
}
