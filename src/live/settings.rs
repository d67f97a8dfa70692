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
    pub max_unfinished: usize,
    /// Milliseconds from a frame's arrival until it is made durable and acknowledged. Usually 100: less means more
    /// syncs.
    pub ack_ms: u64,
    /// Seconds of silence after which a connection is closed. Usually 20.
    pub silent_s: u64,
    /// Seconds without a connection after which an unended recording is ended with the frames that arrived. Usually
    /// 3600: an agent that lost its server for half an hour still finds its recording open.
    pub abandoned_s: u64,
}

impl Default for LiveSettings {
    fn default() -> Self {
        Self { max_feeds: 32, max_bytes: 32 << 30, max_unfinished: 16, ack_ms: 100, silent_s: 20, abandoned_s: 3600 }
    }
}

impl LiveSettings {
    /// Time from a frame's arrival to its acknowledgement.
    pub fn ack(&self) -> Duration {
        Duration::from_millis(self.ack_ms.max(1))
    }

    /// How long a connection may be silent.
    pub fn silent(&self) -> Duration {
        Duration::from_secs(self.silent_s.max(1))
    }

    /// How long a recording may be without a connection.
    pub fn abandoned(&self) -> Duration {
        Duration::from_secs(self.abandoned_s)
    }
}
