//! The input of a child: positions of records that wait for its slot, and of records that it has not finished.

use std::collections::VecDeque;
use std::io::{PipeWriter, Write};
use std::time::{Duration, Instant};

use crate::analysis::protocol::LogPosition;

/// Interval between pictures for watchers, 12.5 a second: enough for the eye.
const PICTURE_INTERVAL: Duration = Duration::from_millis(80);

/// The write end of the pipe to a child, if there is one, and the state of its records.
#[derive(Default)]
pub(super) struct ChildFeed {
    pipe: Option<PipeWriter>,
    /// Records that wait for the child's slot.
    queued: VecDeque<QueuedRecord>,
    /// Arrival times of the records that were sent to the child and are not finished.
    in_flight: VecDeque<Instant>,
    picture_at: Option<Instant>,
}

struct QueuedRecord {
    offset: u64,
    bytes: u32,
    arrived: Instant,
}

impl ChildFeed {
    /// Connects another child; the records of the earlier one are dropped.
    pub(super) fn attach(&mut self, places: PipeWriter) {
        (self.pipe, self.queued, self.in_flight) = (Some(places), VecDeque::new(), VecDeque::new());
    }

    /// True if the child can still receive records.
    pub(super) fn is_open(&self) -> bool {
        self.pipe.is_some()
    }

    /// Queues a record of this offset and length until the child has a slot.
    pub(super) fn enqueue(&mut self, (offset, bytes): (u64, u32)) {
        if self.is_open() {
            self.queued.push_back(QueuedRecord { offset, bytes, arrived: Instant::now() });
        }
    }

    /// Number of records that were sent and are not finished.
    pub(super) fn in_flight(&self) -> usize {
        self.in_flight.len()
    }

    /// Number of records that wait for a slot.
    pub(super) fn queued(&self) -> usize {
        self.queued.len()
    }

    /// Sends the records that have waited longest, at most `most` of them.
    pub(super) fn send_next(&mut self, most: usize, is_watched: bool) {
        let Some(places) = &mut self.pipe else { return };
        for QueuedRecord { offset, bytes, arrived: came } in self.queued.drain(..most.min(self.queued.len())) {
            let now = Instant::now();
            let wants_picture =
                is_watched && self.picture_at.is_none_or(|at| now.duration_since(at) >= PICTURE_INTERVAL);
            // The pipe holds far more positions than are ever in flight, so this does not block; a broken pipe means
            // that the child has ended.
            let place = LogPosition::Record { offset, bytes, wants_picture };
            if places.write_all(&place.to_bytes()).is_ok() {
                self.in_flight.push_back(came);
                if wants_picture {
                    self.picture_at = Some(now);
                }
            }
        }
    }

    /// Sends all waiting records and closes the pipe.
    pub(super) fn close(&mut self) {
        self.send_next(usize::MAX, false);
        self.pipe = None;
    }

    /// The child has finished a record; returns when that record arrived.
    pub(super) fn complete_next(&mut self) -> Option<Instant> {
        self.in_flight.pop_front()
    }

    /// Drops the records in flight: the child's replies to them do not matter any more.
    pub(super) fn clear_in_flight(&mut self) {
        self.in_flight.clear();
    }

    /// Sends a heartbeat to a child that has nothing in flight.
    pub(super) fn send_heartbeat(&mut self) {
        if self.in_flight.is_empty()
            && let Some(places) = &mut self.pipe
        {
            let _ = places.write_all(&LogPosition::Beat.to_bytes()); // a broken pipe means that the child has ended
        }
    }
}
