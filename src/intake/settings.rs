//! Limits of arriving recordings.

use serde::Deserialize;

/// Limits of uploads.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct UploadSettings {
    /// Longest recording, bytes. Larger ones are refused before a byte is sent. Usually 8 GiB.
    pub max_bytes: u64,
    /// Hours without a new byte after which an unfinished upload is forgotten. Usually 48.
    pub expire_h: u64,
    /// Uploads that may be unfinished at a time, of all senders. Each holds its bytes on the disk. Usually 200.
    pub max_unfinished: u64,
    /// Longest table of another tracker, bytes. Tables are read whole: more takes as much memory for a moment. Usually 64 MiB.
    pub import_bytes: usize,
    /// Most rows of such a table. An hour of two tools at 60 frames a second is 432,000. Usually 500,000.
    pub import_rows: usize,
}

impl Default for UploadSettings {
    fn default() -> Self {
        Self { max_bytes: 8 << 30, expire_h: 48, max_unfinished: 200, import_bytes: 64 << 20, import_rows: 500_000 }
    }
}
