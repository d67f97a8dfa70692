//! How a child ended, and what it used.

use std::fmt;
use std::io;
use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;
use std::time::Duration;

use super::record::RecordError;

/// The time limit that was reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimeLimit {
    /// Wall-clock time.
    Wall(Duration),
    /// Wall-clock time without a record.
    Silence(Duration),
    /// CPU time.
    Processor(Duration),
}

/// How a child ended.
#[derive(Debug)]
pub enum ChildOutcome {
    /// It exited with status 0 after complete records.
    Finished,
    /// It exited with another status.
    Exited(i32),
    /// It was killed by a signal that the parent did not send: a crash, or the system call filter.
    Killed(i32),
    /// Its memory limit refused an allocation; the text says how this is known.
    OutOfMemory(&'static str),
    /// A time limit was reached.
    TimedOut(TimeLimit),
    /// Its output violated the protocol.
    ProtocolViolation(RecordError),
    /// It was stopped on request.
    Stopped,
    /// It could not be started or watched.
    NotRun(io::Error),
}

/// Resources that a child used.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cost {
    /// Wall-clock time.
    pub wall: Duration,
    /// CPU time of all threads, kernel included.
    pub cpu: Duration,
    /// Largest resident memory, bytes, at the last sample while it ran.
    pub peak_rss_bytes: u64,
    /// Length of its records, bytes.
    pub output_bytes: u64,
}

/// The result of running a child.
#[derive(Debug)]
pub struct ChildEnd {
    /// How it ended.
    pub outcome: ChildOutcome,
    /// The end of its standard error, made printable; for logs, never for browsers.
    pub stderr_tail: String,
    /// Resources used.
    pub cost: Cost,
}

impl fmt::Display for ChildOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ChildOutcome::Finished => write!(f, "ended normally"),
            ChildOutcome::Exited(status) => write!(f, "exited with status {status}"),
            ChildOutcome::Killed(signal) => write!(f, "was killed by signal {signal} ({})", signal_name(*signal)),
            ChildOutcome::OutOfMemory(known_by) => write!(f, "needed more memory than it may use ({known_by})"),
            ChildOutcome::TimedOut(TimeLimit::Wall(limit)) => write!(f, "took longer than {} s", limit.as_secs()),
            ChildOutcome::TimedOut(TimeLimit::Silence(limit)) => {
                write!(f, "made no progress for {} s", limit.as_secs())
            }
            ChildOutcome::TimedOut(TimeLimit::Processor(limit)) => {
                write!(f, "used more than {} s of CPU time", limit.as_secs())
            }
            ChildOutcome::ProtocolViolation(what) => write!(f, "sent invalid output: {what}"),
            ChildOutcome::Stopped => write!(f, "was stopped"),
            ChildOutcome::NotRun(error) => write!(f, "could not be run: {error}"),
        }
    }
}

fn signal_name(signal: i32) -> &'static str {
    match signal {
        libc::SIGABRT => "abort",
        libc::SIGBUS => "bus error",
        libc::SIGFPE => "arithmetic fault",
        libc::SIGILL => "illegal instruction",
        libc::SIGKILL => "killed from outside, perhaps by the kernel because memory was low",
        libc::SIGSEGV => "invalid memory access",
        libc::SIGSYS => "forbidden system call",
        libc::SIGTERM => "termination",
        _ => "unexpected",
    }
}

/// Interprets a wait status with the help of standard error and the limit of CPU time.
pub(super) fn outcome_of_status(status: ExitStatus, stderr_tail: &str, cpu: Duration) -> ChildOutcome {
    match (status.code(), status.signal()) {
        (Some(0), _) => ChildOutcome::Finished,
        (Some(status), _) => ChildOutcome::Exited(status),
        (_, Some(libc::SIGXCPU)) => ChildOutcome::TimedOut(TimeLimit::Processor(cpu)),
        (_, Some(libc::SIGABRT)) if stderr_tail.contains("memory allocation of") => {
            ChildOutcome::OutOfMemory("an allocation failed")
        }
        (_, Some(signal)) => ChildOutcome::Killed(signal),
        (None, None) => ChildOutcome::Exited(-1),
    }
}
