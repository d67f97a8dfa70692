//! Length of CPU time slices: short ones for the service, long ones for its child processes.
//!
//! A thread that wakes up runs before a computing thread only if its slices are shorter (Linux 6.12 and newer,
//! `sched(7)`); otherwise it waits until the other's slice ends. A frame on its way to a position wakes half a dozen
//! threads of the service one after the other. While decoders use every processor, each of these threads would wait for
//! one slice.

use std::mem::size_of;

use libc::{SYS_sched_getattr, SYS_sched_setattr, c_long, sched_attr, syscall};

/// Slice length of the service's threads, ns: an answer passes through several of them, and each may wait for one slice.
/// Well below the system's, a few milliseconds; the kernel accepts no less than 0.1 ms.
const SERVICE_NS: u64 = 300_000;

/// Lets this thread and those that it starts later run soon after they wake up, while others compute.
pub fn run_soon_after_waking() {
    set_length(SERVICE_NS);
}

/// Sets the slice length, ns, of this thread and of all threads that it starts later. An older kernel does not know
/// slices, and a container may forbid the call: then work takes longer, but nothing else changes.
pub(super) fn set_length(ns: u64) {
    if let Some(mut now) = scheduling_attributes() {
        now.sched_runtime = ns;
        // SAFETY: the kernel reads a structure of the size that is written in it, and keeps no pointer to it.
        let _: c_long = unsafe { syscall(SYS_sched_setattr, 0, &raw const now, 0) };
    }
}

/// Scheduling attributes of this thread.
fn scheduling_attributes() -> Option<sched_attr> {
    let mut now = sched_attr {
        size: 0,
        sched_policy: 0,
        sched_flags: 0,
        sched_nice: 0,
        sched_priority: 0,
        sched_runtime: 0,
        sched_deadline: 0,
        sched_period: 0,
    };
    // SAFETY: the kernel fills a structure of the size that is passed to it.
    let failed = unsafe { syscall(SYS_sched_getattr, 0, &raw mut now, size_of::<sched_attr>(), 0) } != 0;
    (!failed).then_some(now)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_uses_its_slice_length_and_passes_it_to_new_threads() {
        let own = || scheduling_attributes().unwrap().sched_runtime;
        if own() == 0 {
            return crate::resources::skip("slices of this kernel (Linux 6.12 has them)");
        }
        let (first, inherited) = std::thread::spawn(move || {
            set_length(20_000_000);
            (own(), std::thread::spawn(own).join().unwrap())
        })
        .join()
        .unwrap();
        assert_eq!([first, inherited], [20_000_000; 2]);
        assert!(own() < 20_000_000, "the other threads are unchanged");
    }
}
