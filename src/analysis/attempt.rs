//! One attempt at a piece of work: run a child, validate its records, classify how it ended.

use std::fs::File;

use super::protocol::{self, Request};
use super::receipt::{Heard, News, Receipt};
use crate::domain::problem::Problem;
use crate::media::Limits;
use crate::sandbox::{self, Budget, Cost, Order, Outcome, Program, Stop};

/// What one attempt needs.
pub struct Attempt<'a> {
    /// The child's program: [`Program::this`] with the argument `child`.
    pub program: &'a Program,
    /// What the child is to do.
    pub request: Request,
    /// The child's input files, open for reading.
    pub inputs: Vec<File>,
    /// Limits of the child.
    pub budget: &'a Budget,
    /// Ends the child early.
    pub stop: &'a Stop,
}

/// Why an attempt gave no result.
#[derive(Debug)]
pub enum Failure {
    /// The work cannot be done, however often it is tried.
    Explained(Problem),
    /// The child crashed, timed out or sent invalid records; another attempt may succeed.
    Crashed(String),
    /// Ended on request.
    Stopped,
}

/// Runs a child to its end and passes each event in its output to `on_event`. Blocks: see [`sandbox::run`].
pub fn attempt(what: Attempt<'_>, mut on_event: impl FnMut(News)) -> (Result<Heard, Failure>, Cost) {
    let mut receipt = Receipt::new(&what.request.work, Limits::default());
    let request = match protocol::encode(&what.request) {
        Ok(bytes) => bytes,
        Err(error) => {
            return (Err(Failure::Crashed(format!("the request cannot be encoded: {error}"))), Cost::default());
        }
    };
    let order = Order { program: what.program, request, inputs: what.inputs };
    let ended = sandbox::run(order, what.budget, what.stop, |record| {
        on_event(receipt.take(record)?);
        Ok(())
    });
    let heard = receipt.into_heard();
    if heard.landlock == Some(false) {
        warn_of_missing_landlock();
    }
    (conclude(ended.outcome, &ended.stderr_tail, heard), ended.cost)
}

fn conclude(outcome: Outcome, stderr_tail: &str, mut heard: Heard) -> Result<Heard, Failure> {
    match (outcome, heard.problem.take()) {
        (Outcome::Finished, Some(problem)) => Err(Failure::Explained(problem)),
        (Outcome::Finished, None) if heard.done => Ok(heard),
        (Outcome::Finished, None) => Err(Failure::Crashed("ended without reporting a result".into())),
        (Outcome::Stopped, _) => Err(Failure::Stopped),
        (Outcome::OutOfMemory(known_by), _) => Err(Failure::Explained(out_of_memory(known_by))),
        (outcome, _) => {
            tracing::warn!(%outcome, stderr = stderr_tail, "child process failed");
            Err(Failure::Crashed(outcome.to_string()))
        }
    }
}

fn out_of_memory(known_by: &str) -> Problem {
    let detail = format!(
        "decoding and tracking this recording needs more memory than is allowed ({known_by}); \
         record at a lower resolution or for a shorter time"
    );
    Problem::new("too-much-memory", "The recording needs too much memory", detail)
}

fn warn_of_missing_landlock() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| {
        tracing::warn!(
            "this kernel does not enforce Landlock: child processes that decode recordings are confined by the system \
             call filter alone. Enable Landlock in the kernel, or require it in the settings to refuse recordings instead."
        );
    });
}
