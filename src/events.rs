//! What changed, told to whoever watches: the queue moving, sessions being tracked.
//!
//! An event is news, not truth: nobody waits for a watcher, a slow one misses some and is told so, and what counts is in
//! the store. So events may be told before or after the row is seen; a watcher reads the row when it needs to be sure.

use tokio::sync::broadcast;
use tokio::sync::broadcast::error::RecvError;

use crate::domain::job::{JobKind, JobState};
use crate::domain::session::SessionStatus;
use crate::ids::{JobId, SessionId, TraineeId};

/// Events that a watcher may be behind before it misses some.
const KEPT: usize = 1024;

/// Something changed.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// A session stands differently.
    Session {
        /// Which.
        id: SessionId,
        /// Whose: decides who is told.
        trainee: TraineeId,
        /// How it stands now.
        status: SessionStatus,
        /// How much of the recording is tracked, 0 to 1.
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
        /// How much is done, 0 to 1.
        progress: f64,
        /// Whose session it works on; without one it is about a box, which only staff see.
        trainee: Option<TraineeId>,
    },
    /// The queue is longer or shorter.
    Queue,
}

/// Where events are told and heard. Clones are the same place.
#[derive(Clone, Debug)]
pub struct Events(broadcast::Sender<Event>);

impl Events {
    /// A place where nobody listens yet.
    pub fn new() -> Self {
        Self(broadcast::Sender::new(KEPT))
    }

    /// Tells everybody who listens; without listeners nothing happens.
    pub fn tell(&self, event: Event) {
        let _ = self.0.send(event); // an error means only that nobody listens
    }

    /// Hears everything that is told from now on.
    pub fn listen(&self) -> Listener {
        Listener(self.0.subscribe())
    }
}

impl Default for Events {
    fn default() -> Self {
        Self::new()
    }
}

/// What a listener hears next.
#[derive(Clone, Debug, PartialEq)]
pub enum Heard {
    /// Something changed.
    Event(Event),
    /// The listener was too slow and this many events are lost to it: read the state anew.
    Missed(u64),
}

/// One listener.
#[derive(Debug)]
pub struct Listener(broadcast::Receiver<Event>);

impl Listener {
    /// The next event; `None` when nobody is left to tell any.
    pub async fn next(&mut self) -> Option<Heard> {
        match self.0.recv().await {
            Ok(event) => Some(Heard::Event(event)),
            Err(RecvError::Lagged(count)) => Some(Heard::Missed(count)),
            Err(RecvError::Closed) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_slow_listener_is_told_that_it_missed_some_and_goes_on() {
        let events = Events::new();
        let mut listener = events.listen();
        (0..KEPT + 3).for_each(|_| events.tell(Event::Queue));
        assert_eq!(listener.next().await, Some(Heard::Missed(3)));
        assert_eq!(listener.next().await, Some(Heard::Event(Event::Queue)));
    }

    #[test]
    fn telling_nobody_is_no_error() {
        Events::new().tell(Event::Queue);
    }
}
