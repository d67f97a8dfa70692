//! How a child ended, and what it cost.

use std::fmt;
use std::io;
use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;
use std::time::Duration;

use super::record::RecordError;

/// Which limit of time was reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// The whole time on the wall.
    Wall(Duration),
    /// Time without a record.
    Silence(Duration),
    /// Processor time.
    Processor(Duration),
}

/// How a child ended.
#[derive(Debug)]
pub enum Outcome {
    /// It exited with status 0 after whole records.
    Finished,
    /// It exited with another status.
    Exited(i32),
    /// A signal that the parent did not send: a crash, or the system call filter.
    Killed(i32),
    /// Its memory limit refused an allocation; how that is known.
    OutOfMemory(&'static str),
    /// A limit of time was reached.
    TimedOut(Limit),
    /// It wrote what no honest child writes.
    Violated(RecordError),
    /// Ended on request.
    Stopped,
    /// It could not be started or watched.
    NotRun(io::Error),
}

/// What a child used.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cost {
    /// Time on the wall.
    pub wall: Duration,
    /// Processor time, all threads, kernel included.
    pub cpu: Duration,
    /// Most memory resident at a time, bytes, as last seen while it ran.
    pub peak_rss_bytes: u64,
    /// Bytes of records.
    pub output_bytes: u64,
}

/// The end of a child.
#[derive(Debug)]
pub struct Ended {
    /// How.
    pub outcome: Outcome,
    /// The last it wrote to its standard error, made printable; for logs, never for people's browsers.
    pub stderr_tail: String,
    /// What it used.
    pub cost: Cost,
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Outcome::Finished => write!(f, "ended normally"),
            Outcome::Exited(status) => write!(f, "ended with status {status}"),
            Outcome::Killed(signal) => write!(f, "was killed by signal {signal} ({})", signal_name(*signal)),
            Outcome::OutOfMemory(known_by) => write!(f, "needed more memory than it may use ({known_by})"),
            Outcome::TimedOut(Limit::Wall(limit)) => write!(f, "took longer than {} s", limit.as_secs()),
            Outcome::TimedOut(Limit::Silence(limit)) => write!(f, "made no progress for {} s", limit.as_secs()),
            Outcome::TimedOut(Limit::Processor(limit)) => {
                write!(f, "used more than {} s of processor time", limit.as_secs())
            }
            Outcome::Violated(what) => write!(f, "broke the protocol: {what}"),
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
        libc::SIGKILL => "killed from outside, perhaps by the kernel for want of memory",
        libc::SIGSEGV => "invalid memory access",
        libc::SIGSYS => "forbidden system call",
        libc::SIGTERM => "termination",
        _ => "unexpected",
    }
}

/// Reads a wait status, knowing what stood on standard error and the limit of processor time.
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
