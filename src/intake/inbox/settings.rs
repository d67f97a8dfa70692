//! Settings of the watched folder.

use std::path::PathBuf;
use std::time::Duration;

use serde::Deserialize;

/// The watched folder of the server: recordings that other programs put there are taken.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InboxSettings {
    /// The folder, or none. The service moves and deletes files in it, so no other program may need them there.
    pub folder: Option<PathBuf>,
    /// Interval between two looks into the folder, s. More: less load on a network share; fewer: recordings appear
    /// sooner. Usually 5.
    pub poll_s: u64,
    /// How long a file must not change before it is taken, s. More: slow copies that pause are safe; fewer: recordings
    /// appear sooner. Usually 10.
    pub settle_s: u64,
    /// True: a file is deleted once it is taken; false: it is moved to the folder `taken`.
    pub delete_taken: bool,
}

impl Default for InboxSettings {
    fn default() -> Self {
        Self { folder: None, poll_s: 5, settle_s: 10, delete_taken: false }
    }
}

impl InboxSettings {
    pub(super) fn poll(&self) -> Duration {
        Duration::from_secs(self.poll_s)
    }

    pub(super) fn settle_ms(&self) -> i64 {
        i64::try_from(self.settle_s.saturating_mul(1000)).unwrap_or(i64::MAX)
    }
}
