//! Slots for the processors: children of all boxes track their frames one after the other, first come, first served.
//!
//! If the kernel divides the time among all children that have a frame, all of them finish late, and the one with a key
//! frame is by far the last. So only as many children as there are processors receive frames at a time; the others wait
//! in a queue. A child may be stuck, or warm up at the start of a recording: after [`MAX_SLOT_TIME`] its slot is given
//! to the next one.
//!
//! No task runs between two slots: the thread that reads the reply of a child starts the next one. Each extra wake-up
//! would leave a processor idle, or take it from a child.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Longest time that a child holds a slot: three times the time for a key frame at 8 Mbit/s.
pub(super) const MAX_SLOT_TIME: Duration = Duration::from_millis(100);

/// Waits in the queue for a slot.
pub(super) trait Waiter: Send + Sync {
    /// Called when the slot is granted. Starts the work and returns true if there was any; the slot is then held until
    /// [`CpuSlots::release`].
    fn start(&self, slot: SlotId) -> bool;
}

/// Identifies a granted slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SlotId(u64);

/// The slots and the queue of children that wait for one.
pub struct CpuSlots {
    max_slots: usize,
    queue: Mutex<SlotQueue>,
}

#[derive(Default)]
struct SlotQueue {
    /// Slots in use, and when each was granted.
    in_use: Vec<(SlotId, Instant)>,
    /// Number of slots granted so far.
    granted: u64,
    waiting: VecDeque<Arc<dyn Waiter>>,
}

impl CpuSlots {
    /// With this number of slots.
    pub(super) fn new(max_slots: usize) -> Self {
        Self { max_slots, queue: Mutex::default() }
    }

    /// Adds a waiter at the end of the queue; it starts at once if a slot is free.
    pub(super) fn enqueue(&self, waiter: Arc<dyn Waiter>) {
        self.lock_queue().waiting.push_back(waiter);
        self.start_next();
    }

    /// Releases a slot, unless its time had already run out, and starts the next waiter.
    pub(super) fn release(&self, slot: SlotId) {
        self.lock_queue().free(slot);
        self.start_next();
    }

    /// Starts as many waiters as there are free slots. Call it from time to time: no event announces that a slot has
    /// timed out.
    pub(super) fn start_next(&self) {
        loop {
            // In the loop's head, the lock would last through its body.
            let next = self.lock_queue().grant_next(self.max_slots);
            let Some((waiter, slot)) = next else { return };
            if !waiter.start(slot) {
                self.lock_queue().free(slot);
            }
        }
    }

    fn lock_queue(&self) -> MutexGuard<'_, SlotQueue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl SlotQueue {
    fn grant_next(&mut self, at_a_time: usize) -> Option<(Arc<dyn Waiter>, SlotId)> {
        let now = Instant::now();
        self.in_use.retain(|(_, began)| now.duration_since(*began) < MAX_SLOT_TIME);
        if self.in_use.len() >= at_a_time {
            return None;
        }
        let waiter = self.waiting.pop_front()?;
        self.granted += 1;
        let slot = SlotId(self.granted);
        self.in_use.push((slot, now));
        Some((waiter, slot))
    }

    fn free(&mut self, slot: SlotId) {
        self.in_use.retain(|(given, _)| *given != slot);
    }
}

impl Default for CpuSlots {
    /// One slot per processor: with more, children with key frames are overtaken by all others and finish last.
    fn default() -> Self {
        Self::new(std::thread::available_parallelism().map_or(1, usize::from))
    }
}

#[cfg(test)]
mod tests;
