//! Limits for receiving recordings.

use std::time::Duration;

use serde::Deserialize;

/// Limits of uploads.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct UploadSettings {
    /// Maximum length of a recording, bytes. Longer ones are refused before a byte is sent. Usually 8 GiB.
    pub max_bytes: u64,
    /// Hours without a new byte after which an unfinished upload is deleted. Usually 48.
    pub expire_h: u64,
    /// Minutes after which an upload without any byte is deleted. Usually 10.
    pub empty_min: u64,
    /// Maximum number of unfinished uploads at a time, of all senders. Each occupies disk space. Usually 200. The limits
    /// of one sender are `store.senders`.
    pub max_unfinished: u64,
    /// Maximum number of recordings that wait for a name at a time. More are refused until staff have assigned or
    /// discarded some. Usually 2000.
    pub max_waiting: u64,
    /// Maximum size of a table of another tracker, bytes. Usually 64 MiB.
    pub import_bytes: usize,
    /// Maximum number of rows of such a table. An hour of two tools at 60 frames a second is 432,000. Usually 500,000.
    pub import_rows: usize,
}

impl Default for UploadSettings {
    fn default() -> Self {
        Self {
            max_bytes: 8 << 30,
            expire_h: 48,
            empty_min: 10,
            max_unfinished: 200,
            max_waiting: 2_000,
            import_bytes: 64 << 20,
            import_rows: 500_000,
        }
    }
}

impl UploadSettings {
    /// How long an upload may wait for its first byte.
    pub fn empty(&self) -> Duration {
        Duration::from_secs(self.empty_min.saturating_mul(60))
    }
}
