//! How much one child may use.

use std::time::Duration;

/// What to do on a kernel without Landlock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum LandlockPolicy {
    /// Go on behind seccomp alone; the parent says so once, loudly.
    #[default]
    IfAvailable,
    /// Refuse to look at any recording.
    Required,
}

/// Limits of one child. Beyond one it is killed, and [`super::Outcome`] names which.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Memory it may map beyond what the program itself takes, bytes. The default lets 4096×2304 H.264 through with two
    /// decoder threads, refuses 16384×8704, and keeps the whole process under 512 MiB.
    pub memory_bytes: u64,
    /// Processor time of all its threads together.
    pub cpu: Duration,
    /// How long it computes at a time. Whoever wakes and takes shorter slices goes before it, on Linux 6.12 and newer: the service
    /// always, whose threads take what the system gives, a few milliseconds; a child for whom somebody waits before one
    /// for whom nobody does.
    pub slice: Duration,
    /// Time on the wall from start to end.
    pub wall: Duration,
    /// Time on the wall without a single record: a child that still works says so more often.
    pub silence: Duration,
    /// Longest record, bytes.
    pub record_bytes: usize,
    /// All records together, bytes.
    pub output_bytes: u64,
    /// Length that its output file may grow to, bytes; 0 where it has none.
    pub file_bytes: u64,
    /// What to do without Landlock.
    pub landlock: LandlockPolicy,
}

impl Budget {
    /// A [`Budget::slice`] for a child for whom somebody waits: what a frame takes.
    pub const SHORT_SLICE: Duration = Duration::from_millis(20);
}

impl Default for Budget {
    fn default() -> Self {
        Self {
            memory_bytes: 448 << 20,
            cpu: Duration::from_secs(4 * 3600),
            slice: Duration::from_millis(100),
            wall: Duration::from_secs(4 * 3600),
            silence: Duration::from_secs(60),
            record_bytes: 4 << 20,
            output_bytes: 512 << 20,
            file_bytes: 0,
            landlock: LandlockPolicy::default(),
        }
    }
}
