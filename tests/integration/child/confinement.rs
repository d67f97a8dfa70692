//! The confinement itself: this test binary runs as a child, confines itself as every child does, and then tries
//! forbidden acts. It prints the result of each act on stderr; the parent sees how it ended.

use std::io::Write;
use std::os::fd::OwnedFd;
use std::process::{Command, Stdio};

use trocar::analysis::protocol::encode;
use trocar::sandbox::{ChildEnd, ChildOutcome, ChildSpec, TimeLimit, run};

use super::*;

/// Runs one act in a confined copy of this binary.
fn confined(act: &str) -> ChildEnd {
    confined_within(act, &budget())
}

fn confined_within(act: &str, budget: &Budget) -> ChildEnd {
    let arguments = ["--exact", "child::confinement::the_confined_act", "--ignored", "--nocapture", "--test-threads=1"];
    let program = Program::this(&arguments);
    // The test harness prints to stdout. Read as the length of a record, its text stays below this limit.
    let budget = Budget { record_bytes: usize::MAX, ..*budget };
    let order =
        ChildSpec { program: &program, request: act.into(), inputs: vec![File::open("/proc/self/exe").unwrap()] };
    run(order, &budget, &StopSwitch::new().unwrap(), |_| Ok(()))
}

#[test]
#[ignore = "not a test: what the confined copy of this binary runs"]
fn the_confined_act() {
    let admission = trocar::sandbox::admit().unwrap();
    let act = String::from_utf8(admission.request).unwrap();
    let result = acts::perform(&act);
    eprintln!("[{act}: {result}]");
}

mod acts {
    use std::fs;
    use std::io::{self, Read};

    /// The result of an act that did not end the process.
    pub fn perform(act: &str) -> String {
        match act {
            "nothing" => "done".into(),
            "open a file" => outcome(fs::File::open("/etc/passwd")),
            "open the program" => outcome(fs::File::open("/proc/self/exe")),
            "list a folder" => outcome(fs::read_dir("/")),
            "look at a file" => outcome(fs::metadata("/etc/passwd")),
            "write a file" => outcome(fs::write("/tmp/trocar-escaped", "x")),
            "read the environment" => format!("{} variables", std::env::vars_os().count()),
            "start threads" => {
                let threads: Vec<_> = (0..4).map(|i| std::thread::spawn(move || i)).collect();
                threads.into_iter().map(|t| t.join().unwrap()).sum::<i32>().to_string()
            }
            "remove a file" => outcome(fs::remove_file("/tmp/trocar-none")),
            "make a socket" => outcome(std::net::TcpStream::connect("127.0.0.1:1")),
            "run a program" => outcome(std::process::Command::new("/bin/true").status()),
            "take much memory" => {
                let blocks: Vec<Vec<u8>> = (0..64).map(|_| vec![1; 64 << 20]).collect();
                blocks.len().to_string()
            }
            "wait for ever" => outcome(io::stdin().read(&mut [0])),
            "compute for ever" => loop {
                std::hint::black_box(0);
            },
            "abort" => std::process::abort(),
            "panic" => panic!("as asked"),
            other => raw(other),
        }
    }

    fn raw(act: &str) -> String {
        // SAFETY: the filter stops these calls; without it they would affect only this process.
        let result = unsafe {
            match act {
                "fork" => i64::from(libc::fork()),
                "trace" => libc::ptrace(libc::PTRACE_TRACEME, 0, 0, 0),
                "kill the parent" => i64::from(libc::kill(libc::getppid(), 0)),
                "map executable memory" => libc::mmap(
                    std::ptr::null_mut(),
                    4096,
                    libc::PROT_READ | libc::PROT_EXEC,
                    libc::MAP_PRIVATE | libc::MAP_ANONYMOUS,
                    -1,
                    0,
                ) as i64,
                "raise a limit" => {
                    i64::from(libc::setrlimit(libc::RLIMIT_CORE, &libc::rlimit { rlim_cur: 1, rlim_max: 1 }))
                }
                "make a user namespace" => i64::from(libc::unshare(libc::CLONE_NEWUSER)),
                "duplicate a descriptor" => i64::from(libc::dup(0)),
                "load a filter" => libc::syscall(libc::SYS_seccomp, 0, 0, 0),
                "set up an io_uring" => libc::syscall(libc::SYS_io_uring_setup, 1, 0),
                _ => return format!("no such act: {act}"),
            }
        };
        if result < 0 { io::Error::last_os_error().kind().to_string() } else { format!("SUCCEEDED with {result}") }
    }

    fn outcome<T>(result: io::Result<T>) -> String {
        result.map_or_else(|e| e.kind().to_string(), |_| "SUCCEEDED".into())
    }
}

#[test]
fn a_confined_process_works_and_has_no_environment() {
    for (act, result) in [("nothing", "done"), ("read the environment", "0 variables"), ("start threads", "6")] {
        let ended = confined(act);
        assert!(ended.stderr_tail.contains(&format!("[{act}: {result}]")), "{ended:?}");
    }
}

#[test]
fn no_file_can_be_opened_or_looked_at() {
    for act in ["open a file", "open the program", "list a folder", "look at a file", "write a file"] {
        let ended = confined(act);
        assert!(ended.stderr_tail.contains(&format!("[{act}: permission denied]")), "{ended:?}");
    }
}

#[test]
fn any_other_act_kills_the_child() {
    let acts = [
        "remove a file",
        "make a socket",
        "run a program",
        "fork",
        "trace",
        "kill the parent",
        "map executable memory",
        "make a user namespace",
        "duplicate a descriptor",
        "load a filter",
        "set up an io_uring",
    ];
    for act in acts {
        let ended = confined(act);
        assert!(matches!(ended.outcome, ChildOutcome::Killed(libc::SIGSYS)), "{act}: {ended:?}");
    }
}

#[test]
fn limits_cannot_be_raised() {
    let ended = confined("raise a limit");
    assert!(ended.stderr_tail.contains("[raise a limit: permission denied]"), "{ended:?}");
}

#[test]
fn memory_beyond_the_budget_is_named_as_the_reason() {
    let ended = confined("take much memory");
    assert!(matches!(ended.outcome, ChildOutcome::OutOfMemory(_)), "{ended:?}");
    assert!(ended.cost.peak_rss_bytes < 1 << 30, "{ended:?}");
}

#[test]
fn a_crash_and_a_panic_are_distinguished() {
    assert!(matches!(confined("abort").outcome, ChildOutcome::Killed(libc::SIGABRT)));
    let ended = confined("panic");
    assert!(matches!(ended.outcome, ChildOutcome::Exited(101)), "{ended:?}");
    assert!(ended.stderr_tail.contains("as asked"), "{ended:?}");
}

#[test]
fn endless_computing_ends_at_the_processors_limit() {
    let limit = Duration::from_secs(1);
    let ended = confined_within("compute for ever", &Budget { cpu: limit, ..budget() });
    assert!(matches!(ended.outcome, ChildOutcome::TimedOut(TimeLimit::Processor(_))), "{ended:?}");
}

#[test]
fn endless_silence_ends_at_its_limit() {
    let limit = Duration::from_millis(300);
    let ended = confined_within("compute for ever", &Budget { silence: limit, ..budget() });
    assert!(matches!(ended.outcome, ChildOutcome::TimedOut(TimeLimit::Silence(_))), "{ended:?}");
    let ended = confined_within("compute for ever", &Budget { wall: limit, ..budget() });
    assert!(matches!(ended.outcome, ChildOutcome::TimedOut(TimeLimit::Wall(_))), "{ended:?}");
}

/// A real child whose recording never arrives: it waits, confined, until it is stopped.
fn waiting_child(stop: &StopSwitch, on_first_record: impl Fn()) -> (ChildEnd, OwnedFd) {
    let (recording, writer) = rustix::pipe::pipe().unwrap();
    let request = encode(&ChildRequest { threads: 1, work: ChildWork::Probe(ProbeWork) }).unwrap();
    let order = ChildSpec { program: &program(), request, inputs: vec![File::from(recording)] };
    let ended = run(order, &budget(), stop, |_| {
        on_first_record();
        Ok(())
    });
    (ended, writer)
}

#[test]
fn a_child_is_ended_on_request() {
    let stop = StopSwitch::new().unwrap();
    let (ended, _writer) = waiting_child(&stop, || stop.pull());
    assert!(matches!(ended.outcome, ChildOutcome::Stopped), "{ended:?}");
}

#[test]
fn a_record_that_the_parent_refuses_ends_the_child() {
    let request = encode(&ChildRequest { threads: 1, work: ChildWork::Probe(ProbeWork) }).unwrap();
    let (recording, _writer) = rustix::pipe::pipe().unwrap();
    let order = ChildSpec { program: &program(), request, inputs: vec![File::from(recording)] };
    let ended = run(order, &budget(), &StopSwitch::new().unwrap(), |_| Err("not believed".into()));
    assert!(
        matches!(&ended.outcome, ChildOutcome::ProtocolViolation(what) if what.to_string() == "not believed"),
        "{ended:?}"
    );
}

#[test]
#[ignore = "not a test: a parent that is killed while its child works"]
fn the_doomed_parent() {
    let (ended, _writer) = waiting_child(&StopSwitch::new().unwrap(), || {
        eprintln!("\nthe child is confined");
        std::io::stderr().flush().unwrap();
    });
    panic!("{ended:?}");
}

#[test]
fn a_child_does_not_survive_its_parent() {
    let mut parent = Command::new("/proc/self/exe")
        .args(["--exact", "child::confinement::the_doomed_parent", "--ignored", "--nocapture"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = std::io::BufRead::lines(std::io::BufReader::new(parent.stderr.take().unwrap()));
    assert!(lines.any(|line| line.unwrap().contains("the child is confined")));
    let children = children_of(parent.id());
    assert_eq!(children.len(), 1, "{children:?}");
    let child = rustix::process::Pid::from_raw(children[0] as i32).unwrap();
    let child = rustix::process::pidfd_open(child, rustix::process::PidfdFlags::empty()).unwrap();
    parent.kill().unwrap();
    parent.wait().unwrap();
    let mut ended = [rustix::event::PollFd::new(&child, rustix::event::PollFlags::IN)];
    let patience = rustix::event::Timespec { tv_sec: 10, tv_nsec: 0 };
    assert_eq!(rustix::event::poll(&mut ended, Some(&patience)).unwrap(), 1, "the child outlives its parent");
}

/// Child processes of this process.
fn children_of(parent: u32) -> Vec<u32> {
    let processes = std::fs::read_dir("/proc").unwrap();
    let pids = processes.filter_map(|entry| entry.unwrap().file_name().to_str()?.parse().ok());
    let is_child = |pid: &u32| {
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        let after_name = stat.rsplit(')').next().unwrap_or_default().to_owned();
        after_name.split_whitespace().nth(1).is_some_and(|ppid| ppid == parent.to_string())
    };
    pids.filter(is_child).collect()
}
