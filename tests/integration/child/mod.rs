//! The confined child process from outside: its results for healthy and broken recordings, and its confinement.

mod attack;
mod calibrating;
pub mod clips;
mod confinement;
mod forge;
mod mutation;
mod recordings;
mod scoring;
pub mod tracking;
mod workers;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Duration;

use trocar::analysis::protocol::{ChildRequest, ChildWork, ProbeWork};
use trocar::analysis::{AttemptFailure, ChildAttempt, ChildOutput, run_attempt};
use trocar::media::{MediaLimits, VideoFile};
use trocar::sandbox::{Budget, Cost, Program, StopSwitch};

/// The child of the program under test.
fn program() -> Program {
    Program::at(env!("CARGO_BIN_EXE_trocar"), &["child"])
}

/// Generous for a loaded machine. No test waits for these limits: a child that reaches one fails the test.
fn budget() -> Budget {
    Budget { wall: Duration::from_secs(60), silence: Duration::from_secs(60), ..Budget::default() }
}

/// Decodes a file from end to end in a child.
fn probe(path: &Path) -> (Result<ChildOutput, AttemptFailure>, Cost) {
    probe_with(path, &budget())
}

fn probe_with(path: &Path, budget: &Budget) -> (Result<ChildOutput, AttemptFailure>, Cost) {
    let attempt = ChildAttempt {
        program: &program(),
        request: ChildRequest { threads: 2, work: ChildWork::Probe(ProbeWork) },
        inputs: vec![File::open(path).unwrap()],
        budget,
        stop: &StopSwitch::new().unwrap(),
    };
    run_attempt(attempt, |_| {})
}

/// The slug of the problem that refuses a file; any other outcome fails the test.
fn refusal(path: &Path) -> String {
    match probe(path).0 {
        Err(AttemptFailure::Impossible(problem)) => problem.slug,
        other => panic!("{}: expected a problem, got {other:?}", path.display()),
    }
}
