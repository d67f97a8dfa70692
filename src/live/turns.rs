//! Slots for the processors: children of all boxes track their frames one after the other, first come, first served.
//!
//! If the kernel divides the time among all children that have a frame, all of them finish late, and the one with a key
//! frame is by far the last. So only as many children as there are processors receive frames at a time; the others wait
//! in a queue. A child may be stuck, or rehearse the start of a recording: after [`MAX_SLOT_TIME`] its slot is given to
//! the next one.
//!
//! No task runs between two slots: the thread that reads the reply of a child starts the next one. Each extra wake-up
//! would leave a processor idle, or take it from a child.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Longest time that a child holds a slot: three times the time for a key frame at 8 Mbit/s.
pub(super) const LONGEST: Duration = Duration::from_millis(100);

/// Waits in the queue for a slot.
pub(super) trait Stands: Send + Sync {
    /// Called when the slot is granted. Starts the work and returns true if there was any; the slot is then held until
    /// [`CpuSlots::release`].
    fn begin(&self, turn: Turn) -> bool;
}

/// Identifies a granted slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Turn(u64);

/// The slots and the queue of children that wait for one.
pub struct Turns {
    at_a_time: usize,
    line: Mutex<Line>,
}

#[derive(Default)]
struct Line {
    /// Slots in use, and when each was granted.
    given: Vec<(Turn, Instant)>,
    /// Number of slots granted so far.
    count: u64,
    waiting: VecDeque<Arc<dyn Stands>>,
}

impl Turns {
    /// With this number of slots.
    pub(super) fn new(at_a_time: usize) -> Self {
        Self { at_a_time, line: Mutex::default() }
    }

    /// Adds a waiter at the end of the queue; it starts at once if a slot is free.
    pub(super) fn stand(&self, waiter: Arc<dyn Stands>) {
        self.line().waiting.push_back(waiter);
        self.go_on();
    }

    /// Releases a slot, unless its time had already run out, and starts the next waiter.
    pub(super) fn over(&self, turn: Turn) {
        self.line().forget(turn);
        self.go_on();
    }

    /// Starts as many waiters as there are free slots. Call it from time to time: no event announces that a slot has
    /// timed out.
    pub(super) fn go_on(&self) {
        loop {
            let next = self.line().next(self.at_a_time); // in the loop's head, the lock would last through its body
            let Some((waiter, turn)) = next else { return };
            if !waiter.begin(turn) {
                self.line().forget(turn);
            }
        }
    }

    fn line(&self) -> MutexGuard<'_, Line> {
        self.line.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Line {
    fn next(&mut self, at_a_time: usize) -> Option<(Arc<dyn Stands>, Turn)> {
        let now = Instant::now();
        self.given.retain(|(_, began)| now.duration_since(*began) < LONGEST);
        if self.given.len() >= at_a_time {
            return None;
        }
        let waiter = self.waiting.pop_front()?;
        self.count += 1;
        let turn = Turn(self.count);
        self.given.push((turn, now));
        Some((waiter, turn))
    }

    fn forget(&mut self, turn: Turn) {
        self.given.retain(|(given, _)| *given != turn);
    }
}

impl Default for Turns {
    /// One slot per processor: with more, children with key frames are overtaken by all others and finish last.
    fn default() -> Self {
        Self::new(std::thread::available_parallelism().map_or(1, usize::from))
    }
}

#[cfg(test)]
mod tests;
