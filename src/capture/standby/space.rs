//! Space for recordings without a name. They are sent only when they have ended, so a full spool would drop their own
//! beginning, or recordings that wait. One is not begun without space, and ends before there is none.

use std::time::Duration;

use tokio::time::{MissedTickBehavior, interval};

use super::Standby;
use super::refusal::BoxRefusal;
use crate::capture::spool::Spool;

/// How often it is looked at while such a recording runs.
const LOOK_INTERVAL: Duration = Duration::from_millis(250);
/// Space at which such a recording ends, bytes: three seconds at 36 Mbit/s, for what is still written then. A small spool
/// has less.
const END_BYTES: u64 = 16 << 20;
/// Share of a small spool at the most.
const END_SHARE: u64 = 8;
/// Such a recording begins if there is this much more than the space at which it ends.
const START_FACTOR: u64 = 4;

fn end_bytes(spool: &Spool) -> u64 {
    END_BYTES.min(spool.max_bytes() / END_SHARE)
}

/// True if there is no space for a recording of some seconds.
pub(super) fn is_short(spool: &Spool) -> bool {
    spool.room() < START_FACTOR * end_bytes(spool)
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

    /// Ends a recording without a name before its frames would be dropped.
    pub(super) async fn watch_space(self) {
        let mut looks = interval(LOOK_INTERVAL);
        looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            looks.tick().await;
            let is_unnamed = self.running().as_ref().is_some_and(|running| running.trainee.is_none());
            if !is_unnamed {
                continue;
            }
            let room = {
                let spool = self.parts().agent.spool();
                Some(spool.room()).filter(|room| *room < end_bytes(&spool))
            };
            if let Some(room) = room
                && self.stop().await.is_ok()
            {
                tracing::warn!(room, "the recording without a name has ended: there is no more space for it");
                self.facts().has_ended_for_space = true;
                self.note_change();
            }
        }
    }
}
