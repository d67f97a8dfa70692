//! What changes, as server-sent events: sessions, jobs, the queue.
//!
//! Each event is looked at with the watcher's own scope before it is sent, so a stream tells nothing that a request
//! would not. Who is slow misses some and is told `missed`: read the lists anew.

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
use super::error::{Answer, busy};
use super::places::Place;
use super::state::App;
use crate::domain::job::{JobKind, JobState};
use crate::domain::scope::Scope;
use crate::domain::session::SessionStatus;
use crate::domain::text::Key;
use crate::events::{Event, Heard, Listener};
use crate::ids::{JobId, SessionId, TraineeId};

/// A quiet stream sends a comment so often, which also shows whether the watcher is still there.
const KEEP_ALIVE: Duration = Duration::from_secs(15);
/// A stream looks so often whether its sign-in still counts.
const STILL_SIGNED_IN: Duration = Duration::from_secs(5);

/// What the lines of `event:` `session`, `job` and `queue` hold in `data:`.
#[derive(Debug, Serialize, ToSchema)]
#[serde(untagged)]
pub enum Told {
    /// A session stands differently.
    Session {
        /// Which.
        id: SessionId,
        /// How it stands now.
        status: SessionStatus,
        /// Share that is tracked, 0 to 1.
        progress: f64,
    },
    /// A job stands differently.
    Job {
        /// Which.
        id: JobId,
        /// What kind of work.
        kind: JobKind,
        /// How it stands now.
        state: JobState,
        /// Share done, 0 to 1.
        progress: f64,
    },
    /// How much work there is; also sent when a stream begins.
    Queue {
        /// Jobs that wait.
        queued: i64,
        /// Jobs that run.
        running: i64,
    },
    /// The watcher was too slow: read the lists anew.
    Missed {
        /// Events that it did not get.
        missed: u64,
    },
}

/// Watch sessions, jobs and the queue
#[utoipa::path(get, path = "/events", tag = "events",
    responses((status = OK, description = "`event: session|job|queue|missed`, `data:` as described", content_type = "text/event-stream", body = Told)))]
pub async fn events(State(app): State<App>, by: Member, headers: HeaderMap) -> Answer<impl IntoResponse> {
    let full = || busy("Too many event streams are open. Close a page that you no longer need, then try again.");
    let place = app.streams.take(&by.scope).ok_or_else(full)?;
    let watch = Watch { listener: app.events.listen(), scope: by.scope, headers, app: app.clone(), _place: place };
    let lines = watch.lines().take_until(app.shutdown.begun());
    // Proxies that collect answers before they pass them on are asked not to.
    let unbuffered = [(HeaderName::from_static("x-accel-buffering"), "no")];
    Ok((unbuffered, Sse::new(lines).keep_alive(KeepAlive::new().interval(KEEP_ALIVE))))
}

/// One watcher.
struct Watch {
    listener: Listener,
    scope: Scope,
    headers: HeaderMap,
    app: App,
    _place: Place,
}

impl Watch {
    /// What this watcher is told: first how the queue stands, then what changes, until the sign-in ends.
    fn lines(self) -> impl Stream<Item = Result<Line, Infallible>> + Send {
        let told = stream::unfold((self, Some(Heard::Event(Event::Queue))), |(mut watch, first)| async {
            let heard = match first {
                Some(heard) => heard,
                None => watch.next().await?,
            };
            let line = watch.line(heard).await;
            Some((line, (watch, None)))
        });
        told.filter_map(|line| async { line.map(Ok) })
    }

    /// The next event; `None` once the sign-in has ended.
    async fn next(&mut self) -> Option<Heard> {
        let asked = self.app.clock.sleep(STILL_SIGNED_IN);
        tokio::pin!(asked);
        loop {
            tokio::select! {
                heard = self.listener.next() => return heard,
                () = &mut asked => {
                    if !SignedIn::still(&self.app, &self.headers).await {
                        return None;
                    }
                    asked.set(self.app.clock.sleep(STILL_SIGNED_IN));
                }
            }
        }
    }

    /// The line for something heard, if this watcher may know of it.
    async fn line(&self, heard: Heard) -> Option<Line> {
        let (name, told) = match heard {
            Heard::Missed(missed) => ("missed", Told::Missed { missed }),
            Heard::Event(Event::Session { id, trainee, status, progress }) => {
                self.sees(Some(trainee)).await.then_some(("session", Told::Session { id, status, progress }))?
            }
            Heard::Event(Event::Job { id, kind, state, progress, trainee }) => {
                self.sees(trainee).await.then_some(("job", Told::Job { id, kind, state, progress }))?
            }
            Heard::Event(Event::Queue) => {
                let counts = self.app.store.jobs().counts().await.ok()?;
                ("queue", Told::Queue { queued: counts.queued, running: counts.running })
            }
        };
        Line::default().event(name).json_data(told).ok()
    }

    /// Whether the watcher sees this trainee; without one it is about a box, which staff work on.
    async fn sees(&self, trainee: Option<TraineeId>) -> bool {
        match trainee {
            Some(trainee) => self.app.store.trainees().get(&self.scope, &Key::from(&trainee)).await.is_ok(),
            None => self.scope.is_staff(),
        }
    }
}
