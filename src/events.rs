//! Publishes changes of sessions, jobs and the queue to subscribers inside this process.
//!
//! Events are hints, the store holds the truth. Publishing never waits for a subscriber: a slow one misses events and
//! learns how many. An event may be published before or after its row is visible, so a subscriber that has to be sure
//! reads the row.

use tokio::sync::broadcast;
use tokio::sync::broadcast::error::RecvError;

use crate::domain::job::{JobKind, JobState};
use crate::domain::session::SessionStatus;
use crate::ids::{JobId, SessionId, TraineeId};

/// How many events a subscriber may lag behind before it misses some.
const MAX_BACKLOG: usize = 1024;

/// Something changed.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// The status or progress of a session changed.
    Session {
        /// The session.
        id: SessionId,
        /// The session's trainee; decides who may receive the event.
        trainee: TraineeId,
        /// The new status.
        status: SessionStatus,
        /// Share of the recording that is tracked, 0 to 1.
        progress: f64,
    },
    /// The state or progress of a job changed.
    Job {
        /// The job.
        id: JobId,
        /// What kind of work it does.
        kind: JobKind,
        /// The new state.
        state: JobState,
        /// Share done, 0 to 1.
        progress: f64,
        /// The trainee of the job's session; `None` for a job on a box, which only staff see.
        trainee: Option<TraineeId>,
    },
    /// The number of queued or running jobs may have changed.
    Queue,
}

/// Broadcasts events, or what is prepared from them, to all subscribers. Clones share one channel.
#[derive(Clone, Debug)]
pub struct EventBus<T = Event>(broadcast::Sender<T>);

impl<T: Clone> EventBus<T> {
    /// A bus without subscribers.
    pub fn new() -> Self {
        Self(broadcast::Sender::new(MAX_BACKLOG))
    }

    /// Sends an event to all subscribers; does nothing if there are none.
    pub fn publish(&self, event: T) {
        let _ = self.0.send(event); // the only error is that there are no subscribers
    }

    /// Subscribes to all events from now on.
    pub fn subscribe(&self) -> EventSubscriber<T> {
        EventSubscriber(self.0.subscribe())
    }

    /// True if an event that is published now has a subscriber.
    pub fn has_subscribers(&self) -> bool {
        self.0.receiver_count() > 0
    }
}

impl<T: Clone> Default for EventBus<T> {
    fn default() -> Self {
        Self::new()
    }
}

/// What a subscriber receives.
#[derive(Clone, Debug, PartialEq)]
pub enum EventDelivery<T = Event> {
    /// Something changed.
    Event(T),
    /// The subscriber was too slow and missed this many events: it has to read the state again.
    Missed(u64),
}

/// One subscriber's end of the channel.
#[derive(Debug)]
pub struct EventSubscriber<T = Event>(broadcast::Receiver<T>);

impl<T: Clone> EventSubscriber<T> {
    /// The next event; `None` once every [`EventBus`] clone is dropped.
    pub async fn next(&mut self) -> Option<EventDelivery<T>> {
        match self.0.recv().await {
            Ok(event) => Some(EventDelivery::Event(event)),
            Err(RecvError::Lagged(count)) => Some(EventDelivery::Missed(count)),
            Err(RecvError::Closed) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_slow_subscriber_learns_how_many_events_it_missed_and_continues() {
        let events = EventBus::new();
        let mut listener = events.subscribe();
        (0..MAX_BACKLOG + 3).for_each(|_| events.publish(Event::Queue));
        assert_eq!(listener.next().await, Some(EventDelivery::Missed(3)));
        assert_eq!(listener.next().await, Some(EventDelivery::Event(Event::Queue)));
    }

    #[test]
    fn publishing_without_subscribers_is_no_error() {
        EventBus::new().publish(Event::Queue);
    }
}
