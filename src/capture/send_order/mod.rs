//! The order of sending on a connection: live frames first; older frames with the remaining bandwidth.
//!
//! Live frames are sent in order. If the agent is more than [`MAX_LAG_FRAMES`] frames behind, as after an outage, it
//! continues with the newest key frame and sends the skipped frames later, oldest first. Only a limited amount of those
//! is in flight at a time, so that a live frame does not wait long behind them in a buffer.

use std::collections::{BTreeMap, VecDeque};

use super::spool::{RecordEntry, SpooledRecording};
use crate::domain::feed::numbers::FrameNumbers;

/// Frames that sending may lag behind before it skips some: five seconds at 25 Hz.
const MAX_LAG_FRAMES: u64 = 125;
/// Most unacknowledged bytes in flight while older frames are sent. With an acknowledgement every 100 ms this allows 20
/// MB a second, and it is half a second at 32 Mbit/s.
const MAX_IN_FLIGHT_BYTES: usize = 2 << 20;
/// Most ranges of acknowledged numbers for frames to be skipped once more; the protocol allows 4096.
const MAX_RANGES: usize = 512;

/// What to send next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NextSend {
    /// A record of the spool.
    Record(RecordEntry),
    /// A gap: the server lacks these numbers, and so does the spool.
    Lost([u64; 2]),
}

/// What was sent on one connection.
#[derive(Debug, Default)]
pub struct SendOrder {
    /// The next live number.
    live: u64,
    /// The next number of the older frames.
    rest: u64,
    /// The numbers that the server reported as missing.
    requested: VecDeque<[u64; 2]>,
    sent: FrameNumbers,
    /// Length of each record that was sent and not acknowledged, bytes, by number.
    in_flight: BTreeMap<u64, usize>,
}

impl SendOrder {
    /// What to send next, if anything may be sent now.
    pub fn next(&mut self, recording: &SpooledRecording, is_live: bool) -> Option<NextSend> {
        if let Some(next) = self.next_requested(recording) {
            return Some(next);
        }
        self.live =
            self.live.max(recording.durable.missing_below(recording.end).first().map_or(0, |[first, _]| *first));
        let lag = recording.end.saturating_sub(self.live);
        if is_live && lag > MAX_LAG_FRAMES && recording.durable.ranges().len() < MAX_RANGES {
            self.live = self.live.max(recording.newest_key().unwrap_or(0));
        }
        while let Some(entry) = recording.at_or_after(self.live) {
            self.live = entry.last + 1;
            if !entry.is_in(&recording.durable) {
                return Some(self.mark_sent(entry));
            }
        }
        if self.in_flight.values().sum::<usize>() >= MAX_IN_FLIGHT_BYTES {
            return None;
        }
        while let Some(entry) = recording.at_or_after(self.rest).filter(|entry| entry.number < self.live) {
            self.rest = entry.last + 1;
            if !entry.is_in(&recording.durable) && !entry.is_in(&self.sent) {
                return Some(self.mark_sent(entry));
            }
        }
        None
    }

    /// True if everything in the spool has been sent. The spool may lack the last numbers; the server asks for those.
    pub fn is_done(&self, recording: &SpooledRecording) -> bool {
        let behind = recording.at_or_after(self.rest).is_some_and(|entry| entry.number < self.live);
        self.requested.is_empty() && recording.at_or_after(self.live).is_none() && !behind
    }

    /// The server has these numbers.
    pub fn apply_ack(&mut self, durable: &FrameNumbers) {
        self.in_flight.retain(|number, _| !durable.contains(*number));
    }

    /// The server lacks these numbers: they are sent again, or reported as gaps.
    pub fn request_missing(&mut self, missing: Vec<[u64; 2]>) {
        self.requested = missing.into();
    }

    fn next_requested(&mut self, recording: &SpooledRecording) -> Option<NextSend> {
        let [first, last] = self.requested.pop_front()?;
        let entry = recording.at_or_after(first).filter(|entry| entry.number <= last);
        let lost_until = entry.map_or(last + 1, |entry| entry.number);
        let (next, done) = match entry {
            Some(entry) if entry.number <= first => (self.mark_sent(entry), entry.last),
            _ => (NextSend::Lost([first, lost_until - 1]), lost_until - 1),
        };
        if done < last {
            self.requested.push_front([done + 1, last]);
        }
        Some(next)
    }

    fn mark_sent(&mut self, entry: RecordEntry) -> NextSend {
        // Too many ranges to remember: at worst a frame is sent twice, and the server ignores it.
        let _ = self.sent.add(entry.number, entry.last);
        self.in_flight.insert(entry.number, entry.bytes);
        NextSend::Record(entry)
    }
}

#[cfg(test)]
mod tests;
