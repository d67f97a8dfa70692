//! Collects who opened whose recordings, and writes it off the way of the request: a video is played with hundreds of
//! requests, and the store has one writer.
//!
//! [`AccessLog::note`] never waits. An entry is one viewer, session and hour; what is known in this hour is not written
//! again. [`AccessLog::run`] writes the others together, within [`DELAY`].

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::Notify;

use crate::domain::access::AccessedPart;
use crate::domain::scope::Scope;
use crate::shutdown::Shutdown;
use crate::store::{AccessKey, AccessedRecordings, HOUR_MS, NewAccess, Store, StoreError};
use crate::time::SharedClock;

/// Time for further entries to join the first one, in one transaction.
const DELAY: Duration = Duration::from_millis(250);
/// Time until entries that could not be written are tried again.
const RETRY: Duration = Duration::from_secs(5);
/// Most entries that are remembered; about 100 bytes each. Beyond it, what is known is written once more.
const MAX_KNOWN: usize = 20_000;
/// Most entries that wait to be written.
const MAX_WAITING: usize = 5_000;

/// The log. Clones share it.
#[derive(Clone)]
pub struct AccessLog(Arc<AccessLogParts>);

struct AccessLogParts {
    clock: SharedClock,
    entries: Mutex<CollectedEntries>,
    arrived: Notify,
}

#[derive(Default)]
struct CollectedEntries {
    /// The hour of what is known.
    hour: i64,
    /// The parts of each entry that are written or wait.
    known: HashMap<AccessKey, i64>,
    waiting: Vec<NewAccess>,
    /// Entries that found no place since the last write.
    lost: usize,
}

impl CollectedEntries {
    /// Adds an entry. True if there is something to write.
    fn add(&mut self, new: NewAccess) -> bool {
        if self.hour != new.key.hour || self.known.len() >= MAX_KNOWN {
            self.known.clear();
            self.hour = new.key.hour;
        }
        let known = self.known.entry(new.key).or_default();
        if *known | new.parts == *known {
            return false;
        }
        *known |= new.parts;
        if self.waiting.len() >= MAX_WAITING {
            self.known.remove(&new.key); // its next request tries again
            self.lost += 1;
            return false;
        }
        self.waiting.push(new);
        true
    }
}

impl AccessLog {
    /// An empty log.
    pub fn new(clock: SharedClock) -> Self {
        Self(Arc::new(AccessLogParts { clock, entries: Mutex::default(), arrived: Notify::new() }))
    }

    /// Notes that the caller opened a part of these recordings. Only staff see recordings of others.
    pub fn note(&self, scope: &Scope, opened: AccessedRecordings, part: AccessedPart) {
        let Some(person) = scope.person().filter(|_| scope.is_staff()) else { return };
        let at_ms = self.0.clock.now_ms();
        let (role, token, hour) = (scope.role(), scope.token().map(|token| token.id), at_ms / HOUR_MS);
        let key = AccessKey { opened, person, role, token, hour };
        let has_news = self.entries().add(NewAccess { key, at_ms, parts: part.bit() });
        if has_news {
            self.0.arrived.notify_one();
        }
    }

    /// Writes the entries until the service ends, and those of its last moment.
    pub async fn run(&self, store: &Store, shutdown: &Shutdown) {
        while !shutdown.is_begun() {
            tokio::select! {
                () = self.0.arrived.notified() => {}
                () = shutdown.begun() => break,
            }
            self.pause(DELAY, shutdown).await;
            if let Err(error) = self.write(store).await {
                tracing::warn!(%error, "entries of the access log not written; retrying in 5 s");
                self.pause(RETRY, shutdown).await;
                self.0.arrived.notify_one();
            }
        }
        if let Err(error) = self.write(store).await {
            tracing::error!(%error, "last entries of the access log not written; they are lost");
        }
    }

    async fn pause(&self, time: Duration, shutdown: &Shutdown) {
        tokio::select! {
            () = self.0.clock.sleep(time) => {}
            () = shutdown.begun() => {}
        }
    }

    /// Writes what waits. After a failure it waits again.
    async fn write(&self, store: &Store) -> Result<(), StoreError> {
        let (waiting, lost) = {
            let mut entries = self.entries();
            (std::mem::take(&mut entries.waiting), std::mem::take(&mut entries.lost))
        };
        if lost > 0 {
            tracing::error!(lost, "entries of the access log lost: too many waited for the database");
        }
        if waiting.is_empty() {
            return Ok(());
        }
        let written = store.access_log().write(waiting.clone()).await;
        if written.is_err() {
            let mut entries = self.entries();
            let newer = std::mem::replace(&mut entries.waiting, waiting);
            entries.waiting.extend(newer);
        }
        written
    }

    fn entries(&self) -> std::sync::MutexGuard<'_, CollectedEntries> {
        self.0.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ids::{PersonId, SessionId};
    use crate::time::ManualClock;

    #[test]
    fn many_requests_for_one_video_are_one_entry_in_each_hour() {
        let clock = ManualClock::at(7 * HOUR_MS);
        let log = AccessLog::new(clock.clone());
        let viewer = Scope::instructor(PersonId::at(1));
        let session = AccessedRecordings::Session(SessionId::at(1));
        for _ in 0..500 {
            log.note(&viewer, session, AccessedPart::Video);
        }
        assert_eq!(log.entries().waiting.len(), 1);
        log.note(&viewer, session, AccessedPart::Result);
        log.note(&viewer, session, AccessedPart::Video);
        assert_eq!(log.entries().waiting.len(), 2, "another part joins the entry");
        clock.advance(Duration::from_secs(3600));
        log.note(&viewer, session, AccessedPart::Video);
        assert_eq!(log.entries().waiting.len(), 3);
        log.note(&Scope::service(), session, AccessedPart::Video);
        let own = Scope::trainee(PersonId::at(2), crate::ids::TraineeId::at(1));
        log.note(&own, session, AccessedPart::Video);
        assert_eq!(log.entries().waiting.len(), 3, "neither the service nor the trainee is a viewer");
    }

    #[test]
    fn what_waits_has_a_limit_and_comes_back_with_the_next_request() {
        let log = AccessLog::new(ManualClock::at(0));
        let viewer = Scope::administrator(PersonId::at(1));
        let sessions: Vec<_> =
            (0..MAX_WAITING as i64 + 1).map(|at| AccessedRecordings::Session(SessionId::at(at))).collect();
        for session in &sessions {
            log.note(&viewer, *session, AccessedPart::Video);
        }
        assert_eq!(log.entries().waiting.len(), MAX_WAITING);
        assert_eq!(log.entries().lost, 1);
        log.entries().waiting.clear();
        log.note(&viewer, sessions[MAX_WAITING], AccessedPart::Video);
        assert_eq!(log.entries().waiting.len(), 1);
    }
}
