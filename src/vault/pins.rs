//! Blobs that must not be collected right now.
//!
//! A blob is written before the row that refers to it; in between it looks like one that nothing refers to. The same
//! content may even be on its way out while it comes in again. So: who has put a blob holds a [`Kept`] until the row is
//! committed, the collector passes over kept blobs, and who puts a blob that is being removed waits until it is gone.
//!
//! The row may never come, because what it belongs to was erased meanwhile or the disk was full. So what was let go of is
//! remembered until the collector has looked for its row.

use std::collections::{HashMap, HashSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

use crate::domain::blob::{Blob, BlobHash};

/// A blob in the vault that will stay there at least as long as this value. Keep it until the row that refers to the blob
/// is committed.
#[derive(Debug)]
#[must_use = "drop it only after the row that refers to the blob is committed"]
pub struct Kept {
    blob: Blob,
    _pin: Pin,
}

impl Kept {
    pub(super) fn new(blob: Blob, pin: Pin) -> Self {
        Self { blob, _pin: pin }
    }

    /// The blob.
    pub fn blob(&self) -> Blob {
        self.blob
    }
}

/// Which blobs are kept, and which are being removed.
#[derive(Clone, Debug, Default)]
pub(super) struct Pins {
    shared: Arc<Shared>,
}

#[derive(Debug, Default)]
struct Shared {
    state: Mutex<State>,
    removed: Notify,
}

#[derive(Debug, Default)]
struct State {
    kept: HashMap<BlobHash, usize>,
    dying: HashSet<BlobHash>,
    /// Those that nobody keeps any more and for whose row nobody has looked since.
    released: HashSet<BlobHash>,
}

/// One holder's pin on a blob.
#[derive(Debug)]
pub(super) struct Pin {
    hash: BlobHash,
    pins: Pins,
}

/// The right to remove a blob: nobody keeps it, and nobody can until this is dropped.
#[derive(Debug)]
pub(super) struct Removing {
    hash: BlobHash,
    pins: Pins,
}

impl Pins {
    /// Keeps a blob; waits while it is being removed.
    pub async fn keep(&self, hash: BlobHash) -> Pin {
        loop {
            let removed = self.shared.removed.notified();
            if self.try_keep(hash) {
                return Pin { hash, pins: self.clone() };
            }
            removed.await;
        }
    }

    /// Begins to remove a blob; `None` if somebody keeps it or removes it already.
    pub fn remove(&self, hash: BlobHash) -> Option<Removing> {
        let mut state = self.state();
        let free = !state.kept.contains_key(&hash) && state.dying.insert(hash);
        free.then(|| Removing { hash, pins: self.clone() })
    }

    /// Blobs that were let go of, until [`Removing::settle`].
    pub fn released(&self) -> Vec<BlobHash> {
        self.state().released.iter().copied().collect()
    }

    fn try_keep(&self, hash: BlobHash) -> bool {
        let mut state = self.state();
        if state.dying.contains(&hash) {
            return false;
        }
        *state.kept.entry(hash).or_default() += 1;
        true
    }

    /// The maps are whole at any moment, so one who panicked while holding the lock did no harm.
    fn state(&self) -> MutexGuard<'_, State> {
        self.shared.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Removing {
    /// The blob has a row, or is gone: nobody need look for it again.
    pub fn settle(self) {
        self.pins.state().released.remove(&self.hash);
    }
}

impl Drop for Pin {
    fn drop(&mut self) {
        let mut state = self.pins.state();
        if let Some(holders) = state.kept.get_mut(&self.hash) {
            *holders -= 1;
            if *holders == 0 {
                state.kept.remove(&self.hash);
                state.released.insert(self.hash);
            }
        }
    }
}

impl Drop for Removing {
    fn drop(&mut self) {
        self.pins.state().dying.remove(&self.hash);
        self.pins.shared.removed.notify_waiters();
    }
}
