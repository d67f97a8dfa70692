//! A switch that kills running children from another thread.

use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::Arc;

use rustix::event::{EventfdFlags, eventfd};

/// Kills every child that was started with it; clones are the same switch.
#[derive(Clone, Debug)]
pub struct StopSwitch(Arc<OwnedFd>);

impl StopSwitch {
    /// Creates a switch.
    pub fn new() -> io::Result<Self> {
        Ok(Self(Arc::new(eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK)?)))
    }

    /// Kills the children that run with it, and those that will be started with it.
    pub fn pull(&self) {
        // The write fails only if the counter is at its maximum, and then the switch has been pulled.
        let _ = rustix::io::write(&self.0, &1u64.to_ne_bytes());
    }
}

impl AsFd for StopSwitch {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}
