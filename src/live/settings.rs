//! Limits of feeds.

use std::time::Duration;

use serde::Deserialize;

/// Limits of feeds.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LiveSettings {
    /// Connections that may send at the same time, over all boxes. Usually 32.
    pub max_feeds: usize,
    /// Longest recording, bytes. Usually 32 GiB: four hours at 19 Mbit/s.
    pub max_bytes: u64,
    /// Recordings of one box that may be unfinished at a time. Usually 16: an agent begins a new one only when it must.
    pub max_unfinished: u64,
    /// Milliseconds from a frame's arrival until it is made durable and acknowledged. Usually 100: less means more
    /// syncs.
    pub ack_ms: u64,
    /// Seconds of silence after which a connection is closed. Usually 20.
    pub silent_s: u64,
    /// Seconds without a connection after which an unended recording is ended with the frames that arrived. Usually
    /// 3600: an agent that lost its server for half an hour still finds its recording open.
    pub abandoned_s: u64,
    /// The same for a recording whose sender cannot continue it later, such as a page of a browser. Usually 600: a
    /// tablet that lost its network for some minutes still finds its recording open.
    pub lost_s: u64,
    /// The same if that sender's connection was closed, not lost. Usually 90: time to load the page again.
    pub closed_s: u64,
    /// The same for a recording without any frame. Usually 120.
    pub empty_s: u64,
}

impl Default for LiveSettings {
    fn default() -> Self {
        Self {
            max_feeds: 32,
            max_bytes: 32 << 30,
            max_unfinished: 16,
            ack_ms: 100,
            silent_s: 20,
            abandoned_s: 3600,
            lost_s: 600,
            closed_s: 90,
            empty_s: 120,
        }
    }
}

impl LiveSettings {
    /// Time from a frame's arrival to its acknowledgement.
    pub fn ack(&self) -> Duration {
        Duration::from_millis(self.ack_ms)
    }

    /// How long a connection may be silent.
    pub fn silent(&self) -> Duration {
        Duration::from_secs(self.silent_s)
    }

    /// How long a recording may be without a connection.
    pub(super) fn patience(&self, resumes: bool, end: LastContact) -> Duration {
        let usual = match (resumes, end) {
            (true, _) => self.abandoned_s,
            (false, LastContact { was_closed: true, .. }) => self.closed_s.min(self.lost_s),
            (false, LastContact { was_closed: false, .. }) => self.lost_s,
        };
        Duration::from_secs(if end.has_frames { usual } else { usual.min(self.empty_s) })
    }
}

/// What is known of a recording since its last connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LastContact {
    /// True if the sender closed the connection; false if it fell silent.
    pub was_closed: bool,
    /// True if any frame has arrived, or if that is not known.
    pub has_frames: bool,
}

impl LastContact {
    /// Of a recording that no connection has named since the service started.
    pub const UNKNOWN: Self = Self { was_closed: false, has_frames: true };
}
