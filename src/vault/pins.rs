//! Pins: they protect blobs from collection for a time.
//!
//! A blob is written before the row that refers to it; in between it looks unreferenced. The same content may even be
//! put again while it is being removed. Therefore the caller that has put a blob holds a [`PinnedBlob`] until the row
//! is committed, the collector skips pinned blobs, and putting a blob that is being removed waits until it is gone.
//!
//! The row may never be written, because the owner was erased meanwhile or the disk was full. Therefore released blobs
//! are remembered until the collector has looked for their rows.

use std::collections::{HashMap, HashSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

use crate::domain::blob::{Blob, BlobHash};

/// A blob that stays in the vault at least as long as this value exists. Hold it until the row that refers to the blob
/// is committed.
#[derive(Debug)]
#[must_use = "drop it only after the row that refers to the blob is committed"]
pub struct PinnedBlob {
    blob: Blob,
    _pin: Pin,
}

impl PinnedBlob {
    pub(super) fn new(blob: Blob, pin: Pin) -> Self {
        Self { blob, _pin: pin }
    }

    /// The blob's hash and length.
    pub fn blob(&self) -> Blob {
        self.blob
    }
}

/// Which blobs are pinned, and which are being removed.
#[derive(Clone, Debug, Default)]
pub(super) struct Pins {
    shared: Arc<SharedPins>,
}

#[derive(Debug, Default)]
struct SharedPins {
    state: Mutex<PinState>,
    removed: Notify,
}

#[derive(Debug, Default)]
struct PinState {
    pinned: HashMap<BlobHash, usize>,
    being_removed: HashSet<BlobHash>,
    /// Blobs whose last pin is gone and whose row the collector has not looked for since.
    released: HashSet<BlobHash>,
}

/// One holder's pin on a blob.
#[derive(Debug)]
pub(super) struct Pin {
    hash: BlobHash,
    pins: Pins,
}

/// The right to remove a blob: it is not pinned, and cannot be until this is dropped.
#[derive(Debug)]
pub(super) struct RemovalGuard {
    hash: BlobHash,
    pins: Pins,
}

impl Pins {
    /// Pins a blob; waits while it is being removed.
    pub async fn pin(&self, hash: BlobHash) -> Pin {
        loop {
            let removed = self.shared.removed.notified();
            if self.try_pin(hash) {
                return Pin { hash, pins: self.clone() };
            }
            removed.await;
        }
    }

    /// Begins to remove a blob; `None` if it is pinned or already being removed.
    pub fn begin_removal(&self, hash: BlobHash) -> Option<RemovalGuard> {
        let mut state = self.state();
        let free = !state.pinned.contains_key(&hash) && state.being_removed.insert(hash);
        free.then(|| RemovalGuard { hash, pins: self.clone() })
    }

    /// Released blobs, until [`RemovalGuard::settle`].
    pub fn released(&self) -> Vec<BlobHash> {
        self.state().released.iter().copied().collect()
    }

    fn try_pin(&self, hash: BlobHash) -> bool {
        let mut state = self.state();
        if state.being_removed.contains(&hash) {
            return false;
        }
        *state.pinned.entry(hash).or_default() += 1;
        true
    }

    /// Ignores a poisoned lock: the maps are consistent at every moment, so a thread that panicked while holding the
    /// lock did no harm.
    fn state(&self) -> MutexGuard<'_, PinState> {
        self.shared.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl RemovalGuard {
    /// The blob has a row or is gone: the collector need not look for it again.
    pub fn settle(self) {
        self.pins.state().released.remove(&self.hash);
    }
}

impl Drop for Pin {
    fn drop(&mut self) {
        let mut state = self.pins.state();
        if let Some(holders) = state.pinned.get_mut(&self.hash) {
            *holders -= 1;
            if *holders == 0 {
                state.pinned.remove(&self.hash);
                state.released.insert(self.hash);
            }
        }
    }
}

impl Drop for RemovalGuard {
    fn drop(&mut self) {
        self.pins.state().being_removed.remove(&self.hash);
        self.pins.shared.removed.notify_waiters();
    }
}
