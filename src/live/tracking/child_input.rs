//! The input of a child: positions of records that wait for its slot, and of records that it has not finished.

use std::collections::VecDeque;
use std::io::{PipeWriter, Write};
use std::time::{Duration, Instant};

use super::arrived_frames::FramePosition;
use crate::analysis::protocol::LogPosition;

/// Interval between pictures for watchers, 12.5 a second: enough for the eye.
const PICTURE_INTERVAL: Duration = Duration::from_millis(80);

/// The write end of the pipe to a child, and the records that wait for the child's slot.
pub(super) struct ChildInput {
    pipe: PipeWriter,
    queued: VecDeque<QueuedRecord>,
}

struct QueuedRecord {
    position: FramePosition,
    arrived: Instant,
}

/// The records that were sent to a child and are not finished. They outlast the child's input.
#[derive(Default)]
pub(super) struct SentRecords {
    /// Arrival times.
    in_flight: VecDeque<Instant>,
    picture_at: Option<Instant>,
}

impl ChildInput {
    /// The input of a child that has received nothing.
    pub(super) fn new(pipe: PipeWriter) -> Self {
        Self { pipe, queued: VecDeque::new() }
    }

    /// Queues a record until the child has a slot.
    pub(super) fn enqueue(&mut self, position: FramePosition) {
        self.queued.push_back(QueuedRecord { position, arrived: Instant::now() });
    }

    /// Number of records that wait for a slot.
    pub(super) fn queued(&self) -> usize {
        self.queued.len()
    }

    /// Sends the records that have waited longest, at most `most` of them.
    pub(super) fn send_next(&mut self, most: usize, is_watched: bool, sent: &mut SentRecords) {
        for QueuedRecord { position, arrived } in self.queued.drain(..most.min(self.queued.len())) {
            let now = Instant::now();
            let wants_picture =
                is_watched && sent.picture_at.is_none_or(|at| now.duration_since(at) >= PICTURE_INTERVAL);
            // The pipe holds far more positions than are ever in flight, so this does not block; a broken pipe means
            // that the child has ended.
            let FramePosition { offset, bytes } = position;
            let place = LogPosition::Record { offset, bytes, wants_picture };
            if self.pipe.write_all(&place.to_bytes()).is_ok() {
                sent.in_flight.push_back(arrived);
                if wants_picture {
                    sent.picture_at = Some(now);
                }
            }
        }
    }

    /// Sends a heartbeat.
    pub(super) fn send_heartbeat(&mut self) {
        let _ = self.pipe.write_all(&LogPosition::Beat.to_bytes()); // a broken pipe means that the child has ended
    }
}

impl SentRecords {
    /// Number of records that were sent and are not finished.
    pub(super) fn in_flight(&self) -> usize {
        self.in_flight.len()
    }

    /// The child has finished a record; returns when that record arrived.
    pub(super) fn complete_next(&mut self) -> Option<Instant> {
        self.in_flight.pop_front()
    }

    /// Drops the records in flight: the child's replies to them do not matter any more.
    pub(super) fn clear_in_flight(&mut self) {
        self.in_flight.clear();
    }
}
