//! Sends changes of sessions, jobs and the queue as server-sent events.
//!
//! A stream checks each event against the watcher's scope, so it reveals nothing that a request would not. A slow
//! watcher misses events and receives `missed`: it has to read the lists again. All watchers receive `missed` if the
//! store fails while an event is prepared.
//!
//! One task prepares each event for all streams: it asks the database who may see it, and writes its text. So an event
//! costs one query, no matter how many browsers are open.

use std::convert::Infallible;
use std::future::ready;
use std::sync::Arc;
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
use crate::events::{Event, EventDelivery, EventSubscriber};
use crate::ids::{JobId, SessionId};
use crate::store::{SealedSubject, Store, StoreResult, TraineeAudience};

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
    /// The client was too slow, or the service could not read what an event needs: read the lists again.
    Missed {
        /// Number of missed events.
        missed: u64,
    },
}

impl EventData {
    /// The server-sent event; `None` if it cannot be written as JSON.
    fn line(&self) -> Option<Line> {
        let name = match self {
            Self::Session { .. } => "session",
            Self::Job { .. } => "job",
            Self::Queue { .. } => "queue",
            Self::Missed { .. } => "missed",
        };
        Line::default().event(name).json_data(self).ok()
    }
}

/// An event, prepared once for all streams.
#[derive(Clone, Debug)]
pub struct PreparedEvent {
    audience: EventAudience,
    line: Option<Line>,
}

/// The people who may see an event.
#[derive(Clone, Debug)]
enum EventAudience {
    Everyone,
    Staff,
    OfTrainee(TraineeAudience),
}

impl PreparedEvent {
    /// Reads what the streams need for this event.
    async fn read(store: &Store, heard: EventDelivery) -> StoreResult<Self> {
        let (audience, data) = match heard {
            EventDelivery::Missed(missed) => (EventAudience::Everyone, EventData::Missed { missed }),
            EventDelivery::Event(Event::Session { id, trainee, status, progress }) => {
                let audience =
                    EventAudience::OfTrainee(store.exams().audience(SealedSubject::Session(id), trainee).await?);
                (audience, EventData::Session { id, status, progress })
            }
            EventDelivery::Event(Event::Job { id, kind, state, progress, trainee }) => {
                let audience = match trainee {
                    Some(trainee) => {
                        EventAudience::OfTrainee(store.exams().audience(SealedSubject::Job(id), trainee).await?)
                    }
                    None => EventAudience::Staff,
                };
                (audience, EventData::Job { id, kind, state, progress })
            }
            EventDelivery::Event(Event::Queue) => {
                let counts = store.jobs().counts().await?;
                (EventAudience::Everyone, EventData::Queue { queued: counts.queued, running: counts.running })
            }
        };
        Ok(Self { audience, line: data.line() })
    }

    /// Like [`PreparedEvent::read`]; if the store fails, `missed` for everyone, so that pages read the lists again.
    async fn read_or_missed(store: &Store, heard: EventDelivery) -> Self {
        Self::read(store, heard).await.unwrap_or_else(|error| {
            tracing::warn!(%error, "event not sent to the open pages; they read the lists again");
            Self { audience: EventAudience::Everyone, line: EventData::Missed { missed: 1 }.line() }
        })
    }

    /// The server-sent event for a watcher with this scope; `None` if the watcher may not see it.
    fn line_for(&self, scope: &Scope) -> Option<Line> {
        let may_see = match &self.audience {
            EventAudience::Everyone => true,
            EventAudience::Staff => scope.is_staff(),
            EventAudience::OfTrainee(audience) => audience.includes(scope),
        };
        self.line.clone().filter(|_| may_see)
    }
}

impl App {
    /// Prepares these events for all streams until the service stops.
    pub async fn prepare_events(&self, mut events: EventSubscriber) {
        let preparing = async {
            while let Some(heard) = events.next().await {
                if !self.prepared_events.has_subscribers() {
                    continue;
                }
                let event = PreparedEvent::read_or_missed(&self.store, heard).await;
                self.prepared_events.publish(Arc::new(event));
            }
        };
        tokio::select! {
            () = preparing => {}
            () = self.shutdown.begun() => {}
        }
    }
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
    let watch = EventStream { events: app.prepared_events.subscribe(), scope: by.scope, _slot: place };
    // After the subscription, so that no change is missed. A store error costs only the length of the queue.
    let queue = PreparedEvent::read(&app.store, EventDelivery::Event(Event::Queue)).await;
    let queue = stream::iter(queue.ok().and_then(|event| event.line));
    let signed_in = app.clone();
    let signed_out = async move { SignedIn::wait_until_ended(&signed_in, &headers).await };
    let lines = queue.chain(watch.into_lines()).map(Ok::<_, Infallible>);
    let lines = lines.take_until(signed_out).take_until(app.shutdown.begun());
    // Asks proxies not to buffer the stream.
    let unbuffered = [(HeaderName::from_static("x-accel-buffering"), "no")];
    Ok((unbuffered, Sse::new(lines).keep_alive(KeepAlive::new().interval(KEEP_ALIVE))))
}

/// The event stream of one watcher.
struct EventStream {
    events: EventSubscriber<Arc<PreparedEvent>>,
    scope: Scope,
    _slot: ConnectionSlot,
}

impl EventStream {
    /// The events that the watcher may see.
    fn into_lines(self) -> impl Stream<Item = Line> + Send {
        let lines = stream::unfold(self, |mut watch| async {
            let line = match watch.events.next().await? {
                EventDelivery::Event(event) => event.line_for(&watch.scope),
                EventDelivery::Missed(missed) => EventData::Missed { missed }.line(),
            };
            Some((line, watch))
        });
        lines.filter_map(ready)
    }
}

#[cfg(test)]
mod tests {
    use axum::body::to_bytes;

    use super::*;
    use crate::domain::role::Role;
    use crate::events::EventBus;
    use crate::http::connection_slots::ConnectionSlots;
    use crate::ids::{PersonId, TraineeId};
    use crate::store::testing::TestCentre;

    /// The streams of an administrator, Ana's and Ben's instructors, Ana and Ben; with Ana's id.
    async fn people(centre: &TestCentre) -> (TraineeId, [Scope; 5]) {
        let (ana, ben) = (centre.trainee("Ana").await, centre.trainee("Ben").await);
        let (ina, ino) =
            (centre.person("ina", Role::Instructor, None).await, centre.person("ino", Role::Instructor, None).await);
        centre.group("A", &[&ina], &[&ana]).await;
        centre.group("B", &[&ino], &[&ben]).await;
        let of_trainee = async |login: &str, id| centre.person(login, Role::Trainee, Some(id)).await.scope();
        let trainees = (of_trainee("ana", ana.id).await, of_trainee("ben", ben.id).await);
        let administrator = Scope::administrator(PersonId::at(1));
        (ana.id, [administrator, ina.scope(), ino.scope(), trainees.0, trainees.1])
    }

    #[tokio::test]
    async fn an_event_is_read_once_and_each_stream_decides_without_a_query() {
        let centre = TestCentre::new().await;
        let (ana, scopes) = people(&centre).await;
        let job = |trainee| {
            let (id, kind, state) = (JobId::at(1), JobKind::Track, JobState::Running);
            Event::Job { id, kind, state, progress: 0.5, trainee }
        };
        let session = Event::Session { id: SessionId::at(1), trainee: ana, status: SessionStatus::Done, progress: 1.0 };
        let cases = [
            (session, [true, true, false, true, false]),
            (job(Some(ana)), [true, true, false, true, false]),
            (job(None), [true, true, true, false, false]),
            (Event::Queue, [true; 5]),
        ];
        let mut prepared = Vec::new();
        for (event, expected) in cases {
            let event = PreparedEvent::read(&centre.store, EventDelivery::Event(event)).await.unwrap();
            prepared.push((Arc::new(event), expected));
        }
        centre.store.close().await;
        let slots = ConnectionSlots::new(200, 200);
        for (event, expected) in prepared {
            let bus = EventBus::new();
            let streams = scopes.iter().cycle().take(100).map(|scope| {
                let (events, scope) = (bus.subscribe(), scope.clone());
                EventStream { events, _slot: slots.take(&scope).unwrap(), scope }
            });
            let streams: Vec<_> = streams.collect();
            bus.publish(event);
            drop(bus);
            for (stream, expected) in streams.into_iter().zip(expected.into_iter().cycle()) {
                let scope = stream.scope.clone();
                assert_eq!(stream.into_lines().count().await == 1, expected, "{scope:?}");
            }
        }
    }

    #[tokio::test]
    async fn all_watchers_receive_missed_if_the_store_fails() {
        let centre = TestCentre::new().await;
        let (trainee, scopes) = people(&centre).await;
        centre.store.close().await;
        let session = Event::Session { id: SessionId::at(1), trainee, status: SessionStatus::Done, progress: 1.0 };
        let slots = ConnectionSlots::new(200, 200);
        for event in [session, Event::Queue] {
            let bus = EventBus::new();
            let streams = scopes.clone().map(|scope| EventStream {
                events: bus.subscribe(),
                _slot: slots.take(&scope).unwrap(),
                scope,
            });
            let event = PreparedEvent::read_or_missed(&centre.store, EventDelivery::Event(event)).await;
            bus.publish(Arc::new(event));
            drop(bus);
            for stream in streams {
                let lines = stream.into_lines().map(Ok::<_, Infallible>);
                let text = to_bytes(Sse::new(lines).into_response().into_body(), 1000).await.unwrap();
                assert_eq!(text, "event: missed\ndata: {\"missed\":1}\n\n");
            }
        }
    }

    #[tokio::test]
    async fn an_event_of_a_trainee_who_does_not_exist_is_sent_to_no_person() {
        let centre = TestCentre::new().await;
        let (_, scopes) = people(&centre).await;
        let (id, trainee) = (SessionId::at(1), TraineeId::at(1));
        let event = Event::Session { id, trainee, status: SessionStatus::Done, progress: 1.0 };
        let event = PreparedEvent::read(&centre.store, EventDelivery::Event(event)).await.unwrap();
        assert!(scopes.iter().all(|scope| event.line_for(scope).is_none()));
    }
}
