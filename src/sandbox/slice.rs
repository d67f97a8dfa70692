//! How long a child computes at a time.
//!
//! A thread that wakes goes before one that computes only if its slices are shorter (Linux 6.12 and newer, `sched(7)`); else it
//! waits for the end of that one's slice. A frame on its way to a position wakes half a dozen threads of the service one
//! after the other: while decoders have every processor, each of them would wait behind one.

use std::mem::size_of;

use libc::{SYS_sched_getattr, SYS_sched_setattr, c_long, sched_attr, syscall};

/// Takes slices of this length, ns, in this thread and all it begins. An older kernel knows of none, and a container may forbid
/// it: then things take longer, and nothing else is different.
pub(super) fn take(ns: u64) {
    if let Some(mut now) = read() {
        now.sched_runtime = ns;
        // SAFETY: the kernel reads a structure of the size that is written in it, and keeps no pointer to it.
        let _: c_long = unsafe { syscall(SYS_sched_setattr, 0, &raw const now, 0) };
    }
}

/// How this thread shares the processors.
fn read() -> Option<sched_attr> {
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
    // SAFETY: the kernel fills a structure of the size that it is told.
    let failed = unsafe { syscall(SYS_sched_getattr, 0, &raw mut now, size_of::<sched_attr>(), 0) } != 0;
    (!failed).then_some(now)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_takes_the_slices_it_was_told_and_hands_them_on() {
        let own = || read().unwrap().sched_runtime;
        if own() == 0 {
            return eprintln!("SKIPPED: this kernel knows no slices (Linux 6.12 does)");
        }
        let (first, inherited) = std::thread::spawn(move || {
            take(20_000_000);
            (own(), std::thread::spawn(own).join().unwrap())
        })
        .join()
        .unwrap();
        assert_eq!([first, inherited], [20_000_000; 2]);
        assert!(own() < 20_000_000, "no other thread does");
    }
}
