//! Turns at the processors: frames of all boxes are looked at one after the other, in the order in which they came.
//!
//! Where the kernel divides time between all children that have a frame, all of them are done late, and one with a key frame
//! last by far. So only as many as the processors need are told of frames at a time, and the others wait in line.
//! A child may be stuck, or rehearse a recording's beginning: after [`LONGEST`] nobody waits for it any more.

use std::future::Future;
use std::time::Duration;

use tokio::sync::Semaphore;
use tokio::time::timeout;

/// How long others wait for a child: three times what a key frame of 8 Mbit/s takes.
const LONGEST: Duration = Duration::from_millis(100);

/// The line in which children wait.
pub struct Turns(Semaphore);

impl Turns {
    /// So many at a time.
    pub(super) fn new(at_a_time: usize) -> Self {
        Self(Semaphore::new(at_a_time))
    }

    /// Waits in line, begins something, and keeps the turn until it is done, but no longer than any may.
    pub(super) async fn take<F: Future<Output = ()>>(&self, begin: impl FnOnce() -> F) {
        let _turn = self.0.acquire().await; // an error is a line that was closed, and nobody closes it
        let _ = timeout(LONGEST, begin()).await;
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
