//! The parent's side: starts a child, moves its data, enforces the time limits, classifies its end.

use std::fs::File;
use std::io::{self, IoSlice, Read};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::ExitStatusExt;
use std::path::PathBuf;
use std::process::{ChildStderr, ChildStdout, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::net::{SendAncillaryBuffer, SendAncillaryMessage, SendFlags, sendmsg};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};

use super::admission::{MAX_INPUTS, Preamble};
use super::budget::Budget;
use super::confinement::Confinement;
use super::footprint;
use super::outcome::{self, ChildEnd, ChildOutcome, Cost, TimeLimit};
use super::record::{RecordError, Splitter};
use super::stop::StopSwitch;

/// Bytes read from the child at a time.
const READ_BYTES: usize = 1 << 16;

/// Interval between samples of a child's memory once it is older than [`YOUNG_AGE`]: a sample takes several system
/// calls, and the peak only grows.
const MEMORY_SAMPLE_INTERVAL: Duration = Duration::from_millis(200);

/// A younger child is sampled with each record, because it may send no later one.
const YOUNG_AGE: Duration = Duration::from_secs(1);

/// Bytes kept of the end of standard error.
const STDERR_TAIL_BYTES: usize = 4096;

/// The program that a child runs.
#[derive(Clone, Debug)]
pub struct Program {
    path: PathBuf,
    arguments: Vec<String>,
}

impl Program {
    /// This program, even if its file has been replaced since it was started.
    pub fn this(arguments: &[&str]) -> Self {
        Self::at("/proc/self/exe", arguments)
    }

    /// Another program.
    pub fn at(path: impl Into<PathBuf>, arguments: &[&str]) -> Self {
        Self { path: path.into(), arguments: arguments.iter().map(|&a| a.to_owned()).collect() }
    }

    /// The file that it is started from; `None` if that was deleted or replaced.
    pub fn file(&self) -> Option<PathBuf> {
        self.path.canonicalize().ok().filter(|path| path.is_file())
    }
}

/// What one child is to do.
pub struct ChildSpec<'a> {
    /// The program to start.
    pub program: &'a Program,
    /// The request; the child receives it after confinement.
    pub request: Vec<u8>,
    /// Its inputs; open them for reading only.
    pub inputs: Vec<File>,
}

/// Runs one child to its end. Every record goes to `on_record`; if that returns an error, the child is killed for
/// violating the protocol.
///
/// Blocks until the child has ended. It has to: the kernel kills the child when the *thread* that started it ends.
pub fn run(
    spec: ChildSpec<'_>,
    budget: &Budget,
    stop: &StopSwitch,
    on_record: impl FnMut(&[u8]) -> Result<(), String>,
) -> ChildEnd {
    let started = Instant::now();
    match RunningChild::start(spec, budget, started) {
        Ok(mut running) => running.supervise(stop, on_record),
        Err(error) => {
            let cost = Cost { wall: started.elapsed(), ..Cost::default() };
            ChildEnd { outcome: ChildOutcome::NotRun(error), stderr_tail: String::new(), cost }
        }
    }
}

/// A child that was started and not yet reaped.
struct RunningChild {
    budget: Budget,
    pid: Pid,
    pidfd: OwnedFd,
    reaped: bool,
    request: Option<OutgoingRequest>,
    stdout: Option<ChildStdout>,
    stderr: Option<ChildStderr>,
    buffer: Box<[u8]>,
    splitter: Splitter,
    tail: Vec<u8>,
    output_bytes: u64,
    peak_rss_bytes: u64,
    memory_sampled: Option<Instant>,
    started: Instant,
    last_record: Instant,
}

/// Which descriptors are ready.
#[derive(Clone, Copy, Default)]
struct ReadyStreams {
    request: bool,
    stdout: bool,
    stderr: bool,
    exit: bool,
    stop: bool,
}

impl RunningChild {
    fn start(spec: ChildSpec<'_>, budget: &Budget, started: Instant) -> io::Result<Self> {
        if spec.inputs.len() > MAX_INPUTS {
            return Err(io::Error::other(format!("more than {MAX_INPUTS} inputs for one child")));
        }
        let (ours, theirs) = UnixStream::pair()?;
        ours.set_nonblocking(true)?;
        let mut child = Command::new(&spec.program.path)
            .args(&spec.program.arguments)
            .env_clear()
            .current_dir("/")
            .stdin(Stdio::from(OwnedFd::from(theirs)))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()?;
        let pid = Pid::from_child(&child);
        Ok(Self {
            budget: *budget,
            pid,
            pidfd: pidfd_open(pid, PidfdFlags::empty())?,
            reaped: false,
            request: Some(OutgoingRequest::new(ours, spec.request, spec.inputs, budget)),
            stdout: child.stdout.take(),
            stderr: child.stderr.take(),
            buffer: vec![0; READ_BYTES].into(),
            splitter: Splitter::new(budget.record_bytes, budget.output_bytes),
            tail: Vec::new(),
            output_bytes: 0,
            peak_rss_bytes: 0,
            memory_sampled: None,
            started,
            last_record: started,
        })
    }

    fn supervise(&mut self, stop: &StopSwitch, on_record: impl FnMut(&[u8]) -> Result<(), String>) -> ChildEnd {
        let early = self.pump(stop, on_record).err();
        if early.is_some() {
            self.kill();
        }
        let stderr_tail = printable(&self.tail);
        let (outcome, cost) = match self.reap() {
            Ok((status, cost)) => (early.unwrap_or_else(|| self.outcome(status, &stderr_tail)), cost),
            Err(error) => (ChildOutcome::NotRun(error), Cost::default()),
        };
        let (output_bytes, peak_rss_bytes) = (self.output_bytes, self.peak_rss_bytes);
        let cost = Cost { wall: self.started.elapsed(), output_bytes, peak_rss_bytes, ..cost };
        ChildEnd { outcome, stderr_tail, cost }
    }

    /// A crash also truncates a record; then the crash is the reason to report.
    fn outcome(&self, status: ExitStatus, stderr_tail: &str) -> ChildOutcome {
        match (outcome::outcome_of_status(status, stderr_tail, self.budget.cpu), self.splitter.finish()) {
            (ChildOutcome::Finished, Err(torn)) => ChildOutcome::ProtocolViolation(torn),
            (outcome, _) => outcome,
        }
    }

    /// Moves data until the streams are closed and the child has exited. An error is a reason to kill it.
    fn pump(
        &mut self,
        stop: &StopSwitch,
        mut on_record: impl FnMut(&[u8]) -> Result<(), String>,
    ) -> Result<(), ChildOutcome> {
        loop {
            let ready = self.wait(stop)?;
            self.sample_memory();
            if ready.stop {
                return Err(ChildOutcome::Stopped);
            }
            if ready.request {
                self.send_request();
            }
            if ready.stdout {
                self.read_records(&mut on_record).map_err(ChildOutcome::ProtocolViolation)?;
            }
            if ready.stderr {
                self.read_stderr();
            }
            if ready.exit && self.stdout.is_none() && self.stderr.is_none() {
                return Ok(());
            }
        }
    }

    fn wait(&self, stop: &StopSwitch) -> Result<ReadyStreams, ChildOutcome> {
        let until = self.next_limit()?;
        let timeout = Timespec { tv_sec: until.as_secs().min(3600) as i64, tv_nsec: until.subsec_nanos().into() };
        let streams_open = self.stdout.is_some() || self.stderr.is_some();
        let watched = [
            self.request.as_ref().map(|r| (r.socket.as_fd(), PollFlags::OUT)),
            self.stdout.as_ref().map(|s| (s.as_fd(), PollFlags::IN)),
            self.stderr.as_ref().map(|s| (s.as_fd(), PollFlags::IN)),
            // The exit stays ready for ever: wait for it only after the streams are closed.
            (!streams_open).then(|| (self.pidfd.as_fd(), PollFlags::IN)),
            Some((stop.as_fd(), PollFlags::IN)),
        ];
        let [request, stdout, stderr, exit, stop] = poll_ready(watched, &timeout).map_err(ChildOutcome::NotRun)?;
        Ok(ReadyStreams { request, stdout, stderr, exit, stop })
    }

    /// Time until the next time limit, or the limit that has been reached.
    fn next_limit(&self) -> Result<Duration, ChildOutcome> {
        let wall = self.budget.wall.checked_sub(self.started.elapsed());
        let silence = self.budget.silence.checked_sub(self.last_record.elapsed());
        match (wall, silence) {
            (None, _) => Err(ChildOutcome::TimedOut(TimeLimit::Wall(self.budget.wall))),
            (_, None) => Err(ChildOutcome::TimedOut(TimeLimit::Silence(self.budget.silence))),
            (Some(wall), Some(silence)) => Ok(wall.min(silence)),
        }
    }

    /// Samples the child's own memory peak. The kernel's resource usage at the end names the *parent's* peak if that is
    /// higher (it is carried over `exec`), so the child is sampled while it lives; at its last record it has not exited
    /// yet.
    fn sample_memory(&mut self) {
        let is_young = self.started.elapsed() < YOUNG_AGE;
        if !is_young && self.memory_sampled.is_some_and(|looked| looked.elapsed() < MEMORY_SAMPLE_INTERVAL) {
            return;
        }
        self.memory_sampled = Some(Instant::now());
        let seen = footprint::memory_field(&self.pid.to_string(), "VmHWM").unwrap_or(0);
        self.peak_rss_bytes = self.peak_rss_bytes.max(seen);
    }

    fn send_request(&mut self) {
        let done = self.request.as_mut().is_none_or(|r| r.send().unwrap_or(true)); // broken socket: it has ended
        if done {
            self.request = None;
        }
    }

    fn read_records(&mut self, on_record: &mut impl FnMut(&[u8]) -> Result<(), String>) -> Result<(), RecordError> {
        match self.stdout.as_mut().map_or(Ok(0), |s| s.read(&mut self.buffer)) {
            Ok(0) | Err(_) => {
                self.stdout = None;
                Ok(())
            }
            Ok(n) => {
                self.output_bytes += n as u64;
                if self.splitter.push(&self.buffer[..n], on_record)? > 0 {
                    self.last_record = Instant::now();
                }
                Ok(())
            }
        }
    }

    fn read_stderr(&mut self) {
        let mut buffer = [0; STDERR_TAIL_BYTES];
        match self.stderr.as_mut().map_or(Ok(0), |s| s.read(&mut buffer)) {
            Ok(0) | Err(_) => self.stderr = None,
            Ok(n) => {
                self.tail.extend_from_slice(&buffer[..n]);
                let surplus = self.tail.len().saturating_sub(STDERR_TAIL_BYTES);
                self.tail.drain(..surplus);
            }
        }
    }

    fn kill(&self) {
        // The child may have exited meanwhile.
        let _ = pidfd_send_signal(&self.pidfd, Signal::KILL);
    }

    /// Waits for the exit, once, and reads the resource usage.
    fn reap(&mut self) -> io::Result<(ExitStatus, Cost)> {
        let mut status = 0;
        // SAFETY: `rusage` consists of plain numbers, for which zero is a valid value.
        let mut usage: libc::rusage = unsafe { std::mem::zeroed() };
        loop {
            // SAFETY: both pointers are to live, writable variables of the right types; the process is our child.
            let pid = unsafe { libc::wait4(self.pid.as_raw_nonzero().get(), &mut status, 0, &mut usage) };
            if pid > 0 {
                break;
            }
            let error = io::Error::last_os_error();
            if error.kind() != io::ErrorKind::Interrupted {
                return Err(error);
            }
        }
        self.reaped = true;
        let cpu = duration(usage.ru_utime) + duration(usage.ru_stime);
        Ok((ExitStatus::from_raw(status), Cost { cpu, ..Cost::default() }))
    }
}

impl Drop for RunningChild {
    /// Kills the child if a panic in the caller's record handler left it running.
    fn drop(&mut self) {
        if !self.reaped {
            self.kill();
            let _ = self.reap();
        }
    }
}

/// The request on its way to the child; the descriptors travel with its first bytes.
struct OutgoingRequest {
    socket: UnixStream,
    bytes: Vec<u8>,
    sent: usize,
    inputs: Vec<File>,
}

impl OutgoingRequest {
    fn new(socket: UnixStream, request: Vec<u8>, inputs: Vec<File>, budget: &Budget) -> Self {
        let confinement = Confinement {
            slice_ns: budget.slice.as_nanos() as u64, // fits: a fraction of a second
            parent: std::process::id(),
            memory_bytes: budget.memory_bytes,
            cpu_s: budget.cpu.as_secs().max(1),
            file_bytes: budget.file_bytes,
            landlock: budget.landlock,
        };
        let mut bytes = Preamble { confinement, request_bytes: request.len() as u64 }.to_bytes();
        bytes.extend(request);
        Self { socket, bytes, sent: 0, inputs }
    }

    /// Sends as much as the socket takes; returns true when everything is sent.
    fn send(&mut self) -> io::Result<bool> {
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(MAX_INPUTS))];
        let mut control = SendAncillaryBuffer::new(&mut space);
        let descriptors: Vec<BorrowedFd<'_>> = self.inputs.iter().map(|f| f.as_fd()).collect();
        if !descriptors.is_empty() {
            control.push(SendAncillaryMessage::ScmRights(&descriptors));
        }
        let rest = [IoSlice::new(&self.bytes[self.sent..])];
        match sendmsg(&self.socket, &rest, &mut control, SendFlags::NOSIGNAL) {
            Ok(n) => {
                self.sent += n;
                self.inputs.clear();
                Ok(self.sent == self.bytes.len())
            }
            Err(rustix::io::Errno::AGAIN | rustix::io::Errno::INTR) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }
}

/// Polls the descriptors; the answers are at the same indices.
fn poll_ready<const N: usize>(
    watched: [Option<(BorrowedFd<'_>, PollFlags)>; N],
    timeout: &Timespec,
) -> io::Result<[bool; N]> {
    let mut polled: Vec<PollFd<'_>> =
        watched.iter().flatten().map(|&(fd, flags)| PollFd::from_borrowed_fd(fd, flags)).collect();
    match poll(&mut polled, Some(timeout)) {
        Ok(_) => {}
        Err(rustix::io::Errno::INTR) => return Ok([false; N]),
        Err(error) => return Err(error.into()),
    }
    let mut answers = polled.iter().map(|p| !p.revents().is_empty());
    Ok(watched.map(|w| w.is_some() && answers.next().unwrap_or(false)))
}

fn duration(time: libc::timeval) -> Duration {
    Duration::new(time.tv_sec.unsigned_abs(), time.tv_usec as u32 * 1000)
}

/// Text without control characters, so that log viewers do not interpret it.
fn printable(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(bytes);
    text.trim().chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}
