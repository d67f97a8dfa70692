//! What goes out next on a connection: live frames first, the rest behind them with what bandwidth is left.
//!
//! Live frames go in their order. Who has fallen behind by more than [`MOST_LAG`] frames, as after an outage, goes on with
//! the newest key frame and fills in what was left out, oldest first. Of that only so much is under way at a time that a
//! live frame does not wait long behind it in some buffer.

use std::collections::{BTreeMap, VecDeque};

use super::spool::{Entry, Recording};
use crate::domain::feed::numbers::Numbers;

/// Frames that live may fall behind before it leaves some out: five seconds at 25 Hz.
const MOST_LAG: u64 = 125;
/// Bytes that may be under way, unacknowledged, for more of the rest to be sent. With an acknowledgement every 100 ms this
/// is 20 MB a second at most, and half a second of 32 Mbit/s.
const MOST_UNDER_WAY: usize = 2 << 20;
/// Pieces that the acknowledged numbers may lie in for live to leave some out once more; the protocol allows 4096.
const MOST_PIECES: usize = 512;

/// What is to be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// A record of the spool.
    Record(Entry),
    /// A gap: the spool does not have these, and the server misses them.
    Lost([u64; 2]),
}

/// What has been sent on one connection.
#[derive(Debug, Default)]
pub struct Order {
    /// The next live number.
    live: u64,
    /// The next number of the rest.
    rest: u64,
    /// What the server said it misses.
    asked: VecDeque<[u64; 2]>,
    sent: Numbers,
    /// Bytes of what was sent and not acknowledged, by number.
    under_way: BTreeMap<u64, usize>,
}

impl Order {
    /// Nothing was sent yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// What is to be sent next, if anything is to be sent now.
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

    /// Has everything been sent that the spool has? Of the last numbers it may have nothing: the server asks for those.
    pub fn is_done(&self, recording: &Recording) -> bool {
        let behind = recording.at_or_after(self.rest).is_some_and(|entry| entry.number < self.live);
        self.asked.is_empty() && recording.at_or_after(self.live).is_none() && !behind
    }

    /// The server has these.
    pub fn acknowledged(&mut self, durable: &Numbers) {
        self.under_way.retain(|number, _| !durable.contains(*number));
    }

    /// The server misses these: they are sent (again), or told as gaps.
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
        // Too many pieces to remember: at worst one is sent twice, and ignored.
        let _ = self.sent.add(entry.number, entry.last);
        self.under_way.insert(entry.number, entry.bytes);
        Next::Record(entry)
    }
}

#[cfg(test)]
mod tests;
