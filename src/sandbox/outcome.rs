//! How a child ended, and what it used.

use std::fmt;
use std::io;
use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;
use std::time::Duration;

use super::record::RecordError;

/// The time limit that was reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// Wall-clock time.
    Wall(Duration),
    /// Wall-clock time without a record.
    Silence(Duration),
    /// CPU time.
    Processor(Duration),
}

/// How a child ended.
#[derive(Debug)]
pub enum Outcome {
    /// It exited with status 0 after complete records.
    Finished,
    /// It exited with another status.
    Exited(i32),
    /// It was killed by a signal that the parent did not send: a crash, or the system call filter.
    Killed(i32),
    /// Its memory limit refused an allocation; the text says how this is known.
    OutOfMemory(&'static str),
    /// A time limit was reached.
    TimedOut(Limit),
    /// Its output violated the protocol.
    Violated(RecordError),
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
pub struct Ended {
    /// How it ended.
    pub outcome: Outcome,
    /// The end of its standard error, made printable; for logs, never for browsers.
    pub stderr_tail: String,
    /// Resources used.
    pub cost: Cost,
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Outcome::Finished => write!(f, "ended normally"),
            Outcome::Exited(status) => write!(f, "exited with status {status}"),
            Outcome::Killed(signal) => write!(f, "was killed by signal {signal} ({})", signal_name(*signal)),
            Outcome::OutOfMemory(known_by) => write!(f, "needed more memory than it may use ({known_by})"),
            Outcome::TimedOut(Limit::Wall(limit)) => write!(f, "took longer than {} s", limit.as_secs()),
            Outcome::TimedOut(Limit::Silence(limit)) => write!(f, "made no progress for {} s", limit.as_secs()),
            Outcome::TimedOut(Limit::Processor(limit)) => {
                write!(f, "used more than {} s of CPU time", limit.as_secs())
            }
            Outcome::Violated(what) => write!(f, "sent invalid output: {what}"),
            Outcome::Stopped => write!(f, "was stopped"),
            Outcome::NotRun(error) => write!(f, "could not be run: {error}"),
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
pub(super) fn of_status(status: ExitStatus, stderr_tail: &str, cpu: Duration) -> Outcome {
    match (status.code(), status.signal()) {
        (Some(0), _) => Outcome::Finished,
        (Some(status), _) => Outcome::Exited(status),
        (_, Some(libc::SIGXCPU)) => Outcome::TimedOut(Limit::Processor(cpu)),
        (_, Some(libc::SIGABRT)) if stderr_tail.contains("memory allocation of") => {
            Outcome::OutOfMemory("an allocation failed")
        }
        (_, Some(signal)) => Outcome::Killed(signal),
        (None, None) => Outcome::Exited(-1),
    }
}
