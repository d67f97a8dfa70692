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
}

impl Default for UploadSettings {
    fn default() -> Self {
        Self { max_bytes: 8 << 30, expire_h: 48, max_unfinished: 200 }
    }
}
