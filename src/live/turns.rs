//! Turns at the processors: frames of all boxes are looked at one after the other, in the order in which they came.
//!
//! Where the kernel divides time between all children that have a frame, all of them are done late, and one with a key frame
//! last by far. So only as many as the processors need are told of frames at a time, and the others stand in line.
//! A child may be stuck, or rehearse a recording's beginning: after [`LONGEST`] nobody waits for it any more.
//!
//! There is no task between one turn and the next: whoever hears that a child is done tells the next one. Each awakening on the
//! way would leave a processor idle, or take it from a child.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How long others wait for a child: three times what a key frame of 8 Mbit/s takes.
pub(super) const LONGEST: Duration = Duration::from_millis(100);

/// Who stands in line.
pub(super) trait Stands: Send + Sync {
    /// Its turn has come. Begins what it stood for, and tells whether there was anything; then the turn lasts until it
    /// [is over](Turns::over).
    fn begin(&self, turn: Turn) -> bool;
}

/// A turn that was given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Turn(u64);

/// The line in which children stand.
pub struct Turns {
    at_a_time: usize,
    line: Mutex<Line>,
}

#[derive(Default)]
struct Line {
    /// Turns that are not over, and when each began.
    given: Vec<(Turn, Instant)>,
    /// How many there have been.
    count: u64,
    waiting: VecDeque<Arc<dyn Stands>>,
}

impl Turns {
    /// So many at a time.
    pub(super) fn new(at_a_time: usize) -> Self {
        Self { at_a_time, line: Mutex::default() }
    }

    /// Stands behind all others; where nobody waits its turn begins at once.
    pub(super) fn stand(&self, who: Arc<dyn Stands>) {
        self.line().waiting.push_back(who);
        self.go_on();
    }

    /// A turn is over, if it has not lasted too long before; the next begins.
    pub(super) fn over(&self, turn: Turn) {
        self.line().forget(turn);
        self.go_on();
    }

    /// Begins the turns that may. To be called now and then: nobody tells that a turn has lasted too long.
    pub(super) fn go_on(&self) {
        loop {
            let next = self.line().next(self.at_a_time); // not in the loop's head: the line would be locked in its body
            let Some((who, turn)) = next else { return };
            if !who.begin(turn) {
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
        let who = self.waiting.pop_front()?;
        self.count += 1;
        let turn = Turn(self.count);
        self.given.push((turn, now));
        Some((who, turn))
    }

    fn forget(&mut self, turn: Turn) {
        self.given.retain(|(given, _)| *given != turn);
    }
}

impl Default for Turns {
    /// As many as there are processors: with more, those with key frames are overtaken by all others and come last.
    fn default() -> Self {
        Self::new(std::thread::available_parallelism().map_or(1, usize::from))
    }
}

#[cfg(test)]
mod tests;
