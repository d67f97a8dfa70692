//! The confined child from outside: what it says of healthy and of broken recordings, and that nothing gets past it.

mod attack;
mod calibrating;
mod clips;
mod confinement;
mod forge;
mod mutation;
mod recordings;
mod tracking;
mod workers;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Duration;

use trocar::analysis::protocol::{Request, Work};
use trocar::analysis::{Attempt, Failure, Heard, attempt};
use trocar::media::{Limits, VideoFile};
use trocar::sandbox::{Budget, Cost, Program, Stop};

/// The child of the program under test.
fn program() -> Program {
    Program::at(env!("CARGO_BIN_EXE_trocar"), &["child"])
}

/// Generous for a loaded machine, but no test waits for it: a child that reaches it has failed the test.
fn budget() -> Budget {
    Budget { wall: Duration::from_secs(60), silence: Duration::from_secs(60), ..Budget::default() }
}

/// Decodes a file from end to end in a child.
fn probe(path: &Path) -> (Result<Heard, Failure>, Cost) {
    probe_with(path, &budget())
}

fn probe_with(path: &Path, budget: &Budget) -> (Result<Heard, Failure>, Cost) {
    let attempt_at = Attempt {
        program: &program(),
        request: Request { threads: 2, work: Work::Probe },
        inputs: vec![File::open(path).unwrap()],
        budget,
        stop: &Stop::new().unwrap(),
    };
    attempt(attempt_at, |_| {})
}

/// The name of the problem with which a file is refused; anything else fails the test.
fn refusal(path: &Path) -> String {
    match probe(path).0 {
        Err(Failure::Explained(problem)) => problem.slug,
        other => panic!("{}: expected a problem, got {other:?}", path.display()),
    }
}
