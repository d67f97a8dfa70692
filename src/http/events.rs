//! Sends changes of sessions, jobs and the queue as server-sent events.
//!
//! The stream checks each event against the watcher's scope, so it reveals nothing that a request would not. A slow
//! watcher misses events and receives `missed`: it has to read the lists again.

use std::convert::Infallible;
use std::time::Duration;

use axum::extract::State;
use axum::http::{HeaderMap, HeaderName};
use axum::response::IntoResponse;
use axum::response::sse::{Event as Line, KeepAlive, Sse};
use futures_util::{Stream, StreamExt, stream};
use serde::Serialize;
use utoipa::ToSchema;

use super::auth::signed_in::{Member, SignedIn};
use super::connection_slots::ConnectionSlot;
use super::error::{HandlerResult, busy};
use super::state::App;
use crate::domain::job::{JobKind, JobState};
use crate::domain::scope::Scope;
use crate::domain::session::SessionStatus;
use crate::domain::text::Key;
use crate::events::{Event, EventDelivery, EventSubscriber};
use crate::ids::{JobId, SessionId, TraineeId};

/// How often a quiet stream sends a comment, which also detects a closed connection.
const KEEP_ALIVE: Duration = Duration::from_secs(15);

/// The `data:` of the events `session`, `job`, `queue` and `missed`.
#[derive(Debug, Serialize, ToSchema)]
#[serde(untagged)]
pub enum EventData {
    /// The status or progress of a session changed.
    Session {
        /// The session's id.
        id: SessionId,
        /// The new status.
        status: SessionStatus,
        /// Share that is tracked, 0 to 1.
        progress: f64,
    },
    /// The state or progress of a job changed.
    Job {
        /// The job's id.
        id: JobId,
        /// What kind of work it does.
        kind: JobKind,
        /// The new state.
        state: JobState,
        /// Share done, 0 to 1.
        progress: f64,
    },
    /// Length of the queue; also sent when a stream begins.
    Queue {
        /// Jobs that wait.
        queued: i64,
        /// Jobs that run.
        running: i64,
    },
    /// The client was too slow and missed events: read the lists again.
    Missed {
        /// Number of missed events.
        missed: u64,
    },
}

/// Watch sessions, jobs and the queue
///
/// A stream of server-sent events, limited to what the caller may see. It ends when the sign-in ends.
#[utoipa::path(get, path = "/events", tag = "events",
    responses((status = OK, description = "`event: session|job|queue|missed`; `data:` is JSON of this schema",
            content_type = "text/event-stream", body = EventData)))]
pub async fn events(State(app): State<App>, by: Member, headers: HeaderMap) -> HandlerResult<impl IntoResponse> {
    let full = || busy("Too many pages are open. Close a page that you no longer need, then try again.");
    let place = app.watcher_slots.take(&by.scope).ok_or_else(full)?;
    let watch = EventStream { listener: app.events.subscribe(), scope: by.scope, app: app.clone(), _slot: place };
    let signed_in = app.clone();
    let signed_out = async move { SignedIn::wait_until_ended(&signed_in, &headers).await };
    let lines = watch.into_sse_stream().take_until(signed_out).take_until(app.shutdown.begun());
    // Asks proxies not to buffer the stream.
    let unbuffered = [(HeaderName::from_static("x-accel-buffering"), "no")];
    Ok((unbuffered, Sse::new(lines).keep_alive(KeepAlive::new().interval(KEEP_ALIVE))))
}

/// The event stream of one watcher.
struct EventStream {
    listener: EventSubscriber,
    scope: Scope,
    app: App,
    _slot: ConnectionSlot,
}

impl EventStream {
    /// The stream's events: the length of the queue first, then changes.
    fn into_sse_stream(self) -> impl Stream<Item = Result<Line, Infallible>> + Send {
        let lines = stream::unfold((self, Some(EventDelivery::Event(Event::Queue))), |(mut watch, first)| async {
            let heard = match first {
                Some(heard) => heard,
                None => watch.listener.next().await?,
            };
            let line = watch.sse_event(heard).await;
            Some((line, (watch, None)))
        });
        lines.filter_map(|line| async { line.map(Ok) })
    }

    /// The server-sent event for what the subscription delivered; `None` if the watcher may not see it.
    async fn sse_event(&self, heard: EventDelivery) -> Option<Line> {
        let (name, data) = match heard {
            EventDelivery::Missed(missed) => ("missed", EventData::Missed { missed }),
            EventDelivery::Event(Event::Session { id, trainee, status, progress }) => {
                self.may_see(Some(trainee)).await.then_some(("session", EventData::Session { id, status, progress }))?
            }
            EventDelivery::Event(Event::Job { id, kind, state, progress, trainee }) => {
                self.may_see(trainee).await.then_some(("job", EventData::Job { id, kind, state, progress }))?
            }
            EventDelivery::Event(Event::Queue) => {
                let counts = self.app.store.jobs().counts().await.ok()?;
                ("queue", EventData::Queue { queued: counts.queued, running: counts.running })
            }
        };
        Line::default().event(name).json_data(data).ok()
    }

    /// Whether the watcher may see this trainee. `None` means a job on a box, which only staff see.
    async fn may_see(&self, trainee: Option<TraineeId>) -> bool {
        match trainee {
            Some(trainee) => self.app.store.trainees().get(&self.scope, &Key::from(&trainee)).await.is_ok(),
            None => self.scope.is_staff(),
        }
    }
}
