//! The input of a child: positions of records that wait for its slot, and of records that it has not finished.

use std::collections::VecDeque;
use std::io::{PipeWriter, Write};
use std::time::{Duration, Instant};

use crate::analysis::protocol::Place;

/// Interval between pictures for watchers, 12.5 a second: enough for the eye.
const PICTURE_EVERY: Duration = Duration::from_millis(80);

/// The write end of the pipe to a child, if there is one, and the state of its records.
#[derive(Default)]
pub(super) struct Telling {
    places: Option<PipeWriter>,
    /// Records that wait for the child's slot.
    untold: VecDeque<Untold>,
    /// Arrival times of the records that were sent to the child and are not finished.
    behind: VecDeque<Instant>,
    picture_at: Option<Instant>,
}

struct Untold {
    offset: u64,
    bytes: u32,
    came: Instant,
}

impl Telling {
    /// Connects another child; the records of the earlier one are dropped.
    pub(super) fn begin(&mut self, places: PipeWriter) {
        (self.places, self.untold, self.behind) = (Some(places), VecDeque::new(), VecDeque::new());
    }

    /// True if the child can still receive records.
    pub(super) fn goes_on(&self) -> bool {
        self.places.is_some()
    }

    /// Queues a record of this offset and length until the child has a slot.
    pub(super) fn wait_for_turn(&mut self, (offset, bytes): (u64, u32)) {
        if self.goes_on() {
            self.untold.push_back(Untold { offset, bytes, came: Instant::now() });
        }
    }

    /// Number of records that were sent and are not finished.
    pub(super) fn told(&self) -> usize {
        self.behind.len()
    }

    /// Number of records that wait for a slot.
    pub(super) fn untold(&self) -> usize {
        self.untold.len()
    }

    /// Sends the records that have waited longest, at most `most` of them.
    pub(super) fn next(&mut self, most: usize, is_watched: bool) {
        let Some(places) = &mut self.places else { return };
        for Untold { offset, bytes, came } in self.untold.drain(..most.min(self.untold.len())) {
            let now = Instant::now();
            let wants_picture = is_watched && self.picture_at.is_none_or(|at| now.duration_since(at) >= PICTURE_EVERY);
            // The pipe holds far more positions than are ever in flight, so this does not block; a broken pipe means
            // that the child has ended.
            let place = Place::Record { offset, bytes, wants_picture };
            if places.write_all(&place.to_bytes()).is_ok() {
                self.behind.push_back(came);
                if wants_picture {
                    self.picture_at = Some(now);
                }
            }
        }
    }

    /// Sends all waiting records and closes the pipe.
    pub(super) fn end(&mut self) {
        self.next(usize::MAX, false);
        self.places = None;
    }

    /// The child has finished a record; returns when that record arrived.
    pub(super) fn done(&mut self) -> Option<Instant> {
        self.behind.pop_front()
    }

    /// Drops the records in flight: the child's replies to them do not matter any more.
    pub(super) fn forget(&mut self) {
        self.behind.clear();
    }

    /// Sends a heartbeat to a child that has nothing in flight.
    pub(super) fn beat(&mut self) {
        if self.behind.is_empty()
            && let Some(places) = &mut self.places
        {
            let _ = places.write_all(&Place::Beat.to_bytes()); // a broken pipe means that the child has ended
        }
    }
}
