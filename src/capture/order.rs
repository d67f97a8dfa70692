//! The order of sending on a connection: live frames first; older frames with the remaining bandwidth.
//!
//! Live frames are sent in order. If the agent is more than [`MAX_LAG_FRAMES`] frames behind, as after an outage, it
//! continues with the newest key frame and sends the skipped frames later, oldest first. Only a limited amount of those
//! is in flight at a time, so that a live frame does not wait long behind them in a buffer.

use std::collections::{BTreeMap, VecDeque};

use super::spool::{Entry, Recording};
use crate::domain::feed::numbers::Numbers;

/// Frames that sending may lag behind before it skips some: five seconds at 25 Hz.
const MOST_LAG: u64 = 125;
/// Most unacknowledged bytes in flight while older frames are sent. With an acknowledgement every 100 ms this allows 20
/// MB a second, and it is half a second at 32 Mbit/s.
const MOST_UNDER_WAY: usize = 2 << 20;
/// Most ranges of acknowledged numbers for frames to be skipped once more; the protocol allows 4096.
const MOST_PIECES: usize = 512;

/// What to send next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// A record of the spool.
    Record(Entry),
    /// A gap: the server lacks these numbers, and so does the spool.
    Lost([u64; 2]),
}

/// What was sent on one connection.
#[derive(Debug, Default)]
pub struct Order {
    /// The next live number.
    live: u64,
    /// The next number of the older frames.
    rest: u64,
    /// The numbers that the server reported as missing.
    asked: VecDeque<[u64; 2]>,
    sent: Numbers,
    /// Length of each record that was sent and not acknowledged, bytes, by number.
    under_way: BTreeMap<u64, usize>,
}

impl Order {
    /// Nothing has been sent yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// What to send next, if anything may be sent now.
    pub fn next(&mut self, recording: &Recording, is_live: bool) -> Option<Next> {
        if let Some(next) = self.next_asked(recording) {
            return Some(next);
        }
        self.live =
            self.live.max(recording.durable.missing_below(recording.end).first().map_or(0, |[first, _]| *first));
        let lag = recording.end.saturating_sub(self.live);
        if is_live && lag > MOST_LAG && recording.durable.ranges().len() < MOST_PIECES {
            self.live = self.live.max(recording.newest_key().unwrap_or(0));
        }
        while let Some(entry) = recording.at_or_after(self.live) {
            self.live = entry.last + 1;
            if !entry.is_in(&recording.durable) {
                return Some(self.sending(entry));
            }
        }
        if self.under_way.values().sum::<usize>() >= MOST_UNDER_WAY {
            return None;
        }
        while let Some(entry) = recording.at_or_after(self.rest).filter(|entry| entry.number < self.live) {
            self.rest = entry.last + 1;
            if !entry.is_in(&recording.durable) && !entry.is_in(&self.sent) {
                return Some(self.sending(entry));
            }
        }
        None
    }

    /// True if everything in the spool has been sent. The spool may lack the last numbers; the server asks for those.
    pub fn is_done(&self, recording: &Recording) -> bool {
        let behind = recording.at_or_after(self.rest).is_some_and(|entry| entry.number < self.live);
        self.asked.is_empty() && recording.at_or_after(self.live).is_none() && !behind
    }

    /// The server has these numbers.
    pub fn acknowledged(&mut self, durable: &Numbers) {
        self.under_way.retain(|number, _| !durable.contains(*number));
    }

    /// The server lacks these numbers: they are sent again, or reported as gaps.
    pub fn asked(&mut self, missing: Vec<[u64; 2]>) {
        self.asked = missing.into();
    }

    fn next_asked(&mut self, recording: &Recording) -> Option<Next> {
        let [first, last] = self.asked.pop_front()?;
        let entry = recording.at_or_after(first).filter(|entry| entry.number <= last);
        let lost_until = entry.map_or(last + 1, |entry| entry.number);
        let (next, done) = match entry {
            Some(entry) if entry.number <= first => (self.sending(entry), entry.last),
            _ => (Next::Lost([first, lost_until - 1]), lost_until - 1),
        };
        if done < last {
            self.asked.push_front([done + 1, last]);
        }
        Some(next)
    }

    fn sending(&mut self, entry: Entry) -> Next {
        // Too many ranges to remember: at worst a frame is sent twice, and the server ignores it.
        let _ = self.sent.add(entry.number, entry.last);
        self.under_way.insert(entry.number, entry.bytes);
        Next::Record(entry)
    }
}

#[cfg(test)]
mod tests;
