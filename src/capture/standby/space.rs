//! Space for recordings without a name, on the disk and in one file. They are sent only when they have ended, so a full
//! spool would drop their own beginning, or recordings that wait. One is not begun without space, and ends before there is
//! none, or before its file would be longer than one that the server takes.

use std::time::Duration;

use tokio::time::{MissedTickBehavior, interval};

use super::Standby;
use super::refusal::BoxRefusal;
use crate::capture::spool::Spool;

/// How often it is looked at while such a recording runs.
const LOOK_INTERVAL: Duration = Duration::from_millis(250);
/// Space at which such a recording ends, of the disk, the spool and the file that the server takes, bytes: three seconds at
/// 36 Mbit/s, for what is still written then. An MP4 file has some 20 bytes more for each frame than the records, 4 MB in
/// half an hour. A small limit has less.
const END_BYTES: u64 = 16 << 20;
/// Share of a small limit at the most.
const END_SHARE: u64 = 8;
/// Such a recording begins if there is this much more than the space at which it ends.
const START_FACTOR: u64 = 4;
/// Longest file that a server takes which has not said so, bytes: the default of `uploads.max_bytes`.
const MAX_FILE_BYTES: u64 = 8 << 30;

/// The limit that a recording without a name reached: it was ended there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum UnnamedLimit {
    /// The space on the disk, or of the spool.
    Space,
    /// The longest file that the server takes.
    FileSize,
}

fn end_bytes(max_bytes: u64) -> u64 {
    END_BYTES.min(max_bytes / END_SHARE)
}

/// The limit that the recording that runs has reached.
fn reached_limit(spool: &Spool, max_file_bytes: u64) -> Option<UnnamedLimit> {
    if spool.room() < end_bytes(spool.max_bytes()) {
        return Some(UnnamedLimit::Space);
    }
    let recorded = spool.get(spool.live()?)?.record_bytes();
    (recorded > max_file_bytes - end_bytes(max_file_bytes)).then_some(UnnamedLimit::FileSize)
}

/// True if there is no space for a recording of some seconds.
pub(super) fn is_short(spool: &Spool) -> bool {
    spool.room() < START_FACTOR * end_bytes(spool.max_bytes())
}

impl Standby {
    /// Refuses a recording without a name if the box makes none, or has no space for it.
    pub(super) fn check_unnamed_start(&self) -> Result<(), BoxRefusal> {
        if self.parts().requires_check_in {
            return Err(BoxRefusal::NeedsCheckIn);
        }
        let spool = self.parts().agent.spool();
        match is_short(&spool) {
            true => Err(BoxRefusal::NoSpace(format!("{} MB are left", spool.room() / 1_000_000))),
            false => Ok(()),
        }
    }

    /// Ends a recording without a name before its frames would be dropped, or its file too long for the server.
    pub(super) async fn watch_space(self) {
        let mut looks = interval(LOOK_INTERVAL);
        looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            looks.tick().await;
            let is_unnamed = self.running().as_ref().is_some_and(|running| running.trainee.is_none());
            if !is_unnamed {
                continue;
            }
            let max_file_bytes = self.facts().max_file_bytes.unwrap_or(MAX_FILE_BYTES);
            let limit = reached_limit(&self.parts().agent.spool(), max_file_bytes);
            if limit.is_some() && self.stop().await.is_ok() {
                tracing::warn!(?limit, max_file_bytes, "the recording without a name has ended early");
                self.facts().reached_limit = limit;
                self.note_change();
            }
        }
    }
}
