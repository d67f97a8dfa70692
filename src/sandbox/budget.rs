//! Limits of one child.

use std::time::Duration;

/// What to do on a kernel without Landlock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum LandlockPolicy {
    /// Continue with seccomp alone; the parent logs one warning.
    #[default]
    IfAvailable,
    /// Refuse every recording.
    Required,
}

/// Limits of one child. If it exceeds one, it is killed, and [`super::ChildOutcome`] names the limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Memory that it may map beyond the program's own, bytes. The default allows 4096×2304 H.264 with two decoder
    /// threads, refuses 16384×8704, and keeps the whole process under 512 MiB.
    pub memory_bytes: u64,
    /// CPU time of all its threads together.
    pub cpu: Duration,
    /// Length of its CPU time slices. On Linux 6.12 and newer, a thread that wakes up runs before threads with longer
    /// slices. The service's threads have shorter ones than all children, so they run first; a child that works for a
    /// waiting user runs before one that does not.
    pub slice: Duration,
    /// Wall-clock time from start to end.
    pub wall: Duration,
    /// Wall-clock time without a record: a working child reports more often.
    pub silence: Duration,
    /// Longest record, bytes.
    pub record_bytes: usize,
    /// All records together, bytes.
    pub output_bytes: u64,
    /// Largest length of its output file, bytes; 0 without an output file.
    pub file_bytes: u64,
    /// What to do without Landlock.
    pub landlock: LandlockPolicy,
}

impl Budget {
    /// The [`Budget::slice`] of a child that works for a waiting user: about the time for one frame.
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
