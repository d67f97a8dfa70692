//! The recordings that are open in this service, and the phases of one.
//!
//! ```text
//!         finish                session stored
//! Open ────────────▶ Finishing ──────────────▶ Ended
//!  ▲                  │  │  │
//!  └─ not assembled ──┘  │  └─ no frame ──┐
//!                        └─ erased ───────┴──▶ Removed ◀── erased ── Open
//! ```
//! [`FeedPhase`] holds the phases before the end and is read without waiting. [`FeedState`] holds what can be appended
//! to, or the session; its lock is held while the recording is assembled.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU32, Ordering};
use std::sync::{Arc, PoisonError, Weak};

use tokio::sync::{Mutex, OwnedMutexGuard, watch};

use super::settings::LastContact;
use super::tracking::TrackingSupervisor;
use crate::domain::feed::close_reason::{CloseCode, CloseReason};
use crate::domain::feed::numbers::FrameNumbers;
use crate::domain::feed::{MAX_DURATION_S, TimeBase};
use crate::ids::{FeedId, SessionId};
use crate::store;
use crate::vault::FeedLog;

/// The recordings that are open in a service and not ended.
#[derive(Default)]
pub struct OpenFeeds {
    pub(super) all: Mutex<HashMap<FeedId, Arc<OpenFeed>>>,
    /// A lock per recording, held while the recording is opened or removed, so that reading one log does not delay the
    /// others. These locks are taken before `all`.
    locks: std::sync::Mutex<HashMap<FeedId, Weak<Mutex<()>>>>,
}

impl OpenFeeds {
    /// Locks the opening and removal of this recording.
    pub(super) async fn lock_feed(&self, id: FeedId) -> OwnedMutexGuard<()> {
        let lock = {
            let mut locks = self.locks.lock().unwrap_or_else(PoisonError::into_inner);
            locks.retain(|_, lock| lock.strong_count() > 0);
            let lock = locks.get(&id).and_then(Weak::upgrade).unwrap_or_default();
            locks.insert(id, Arc::downgrade(&lock));
            lock
        };
        lock.lock_owned().await
    }
}

/// A recording that is arriving.
pub(super) struct OpenFeed {
    pub(super) row: store::FeedRow,
    pub(super) time_base: TimeBase,
    /// The epoch that may send now.
    pub(super) epoch: watch::Sender<u32>,
    pub(super) connections: AtomicU32,
    /// Last contact with its sender, by [`Clock::monotonic_ms`](crate::time::Clock::monotonic_ms).
    pub(super) last_contact_ms: AtomicI64,
    /// True if its sender closed the last connection.
    pub(super) was_closed: AtomicBool,
    /// True if a frame has arrived.
    pub(super) has_frames: AtomicBool,
    /// Time of its latest frame, ticks; negative if no frame has arrived since the log was opened.
    pub(super) latest_ticks: AtomicI64,
    pub(super) state: Mutex<FeedState>,
    phase: std::sync::Mutex<FeedPhase>,
    /// Failed attempts to assemble it that were not its own fault.
    pub(super) failures: AtomicU32,
    pub(super) tracking: TrackingSupervisor,
}

/// What can happen to a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FeedPhase {
    /// Frames may arrive, unless it has ended.
    Open,
    /// It is being assembled.
    Finishing,
    /// Its session was erased, or it was discarded: nothing more may arrive.
    Removed,
}

/// The log of a recording, or the session that it has become.
pub(super) enum FeedState {
    /// Records can be appended.
    Receiving(ReceivedRecords),
    /// The recording is complete and is this session.
    Ended(SessionId),
}

/// The records of a recording that arrived.
pub(super) struct ReceivedRecords {
    pub(super) log: FeedLog,
    /// Frames and gaps in the log.
    pub(super) numbers: FrameNumbers,
    /// Bytes of the log that are known to be durable.
    pub(super) synced: u64,
}

impl FeedState {
    /// The records, to add more.
    pub(super) fn records(&mut self) -> Result<&mut ReceivedRecords, CloseReason> {
        match self {
            Self::Receiving(records) => Ok(records),
            Self::Ended(_) => Err(CloseReason::new(CloseCode::Done, "the recording has ended")),
        }
    }
}

impl OpenFeed {
    /// A recording without a connection, whose sender was in contact now.
    pub(super) fn new(
        row: store::FeedRow,
        time_base: TimeBase,
        (log, numbers): (FeedLog, FrameNumbers),
        tracking: TrackingSupervisor,
        now_ms: i64,
    ) -> Self {
        Self {
            epoch: watch::Sender::new(row.epoch),
            time_base,
            connections: AtomicU32::new(0),
            last_contact_ms: AtomicI64::new(now_ms),
            was_closed: AtomicBool::new(false),
            has_frames: AtomicBool::new(!numbers.ranges().is_empty()),
            latest_ticks: AtomicI64::new(-1),
            state: Mutex::new(FeedState::Receiving(ReceivedRecords { synced: log.bytes(), log, numbers })),
            phase: std::sync::Mutex::new(FeedPhase::Open),
            failures: AtomicU32::new(0),
            tracking,
            row,
        }
    }

    /// The phase at this moment.
    pub(super) fn phase(&self) -> FeedPhase {
        *self.phase.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the phase; a removed recording remains removed.
    pub(super) fn set_phase(&self, phase: FeedPhase) {
        let mut now = self.phase.lock().unwrap_or_else(PoisonError::into_inner);
        if *now != FeedPhase::Removed {
            *now = phase;
        }
    }

    pub(super) fn has_sender(&self) -> bool {
        self.connections.load(Ordering::Acquire) > 0
    }

    pub(super) fn is_abandoned(&self, long_ago_ms: i64) -> bool {
        !self.has_sender() && self.last_contact_ms.load(Ordering::Acquire) < long_ago_ms
    }

    pub(super) fn last_contact(&self) -> LastContact {
        LastContact {
            was_closed: self.was_closed.load(Ordering::Acquire),
            has_frames: self.has_frames.load(Ordering::Acquire),
        }
    }

    /// Notes that a frame with this time arrived.
    pub(super) fn note_frame(&self, ticks: i64) {
        self.has_frames.store(true, Ordering::Release);
        self.latest_ticks.fetch_max(ticks, Ordering::AcqRel);
    }

    /// Time of the latest frame, s, if one has arrived since the log was opened.
    pub(super) fn recorded_s(&self) -> Option<f64> {
        let ticks = self.latest_ticks.load(Ordering::Acquire);
        (ticks >= 0).then(|| self.time_base.seconds(ticks))
    }

    /// Length of the longest recording, ticks: no frame has a later time.
    pub(super) fn max_ticks(&self) -> i64 {
        let (num, den) = self.time_base.fraction();
        (MAX_DURATION_S * f64::from(den) / f64::from(num)) as i64
    }
}

impl Drop for OpenFeed {
    fn drop(&mut self) {
        self.tracking.stop();
    }
}
