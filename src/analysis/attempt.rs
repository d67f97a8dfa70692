//! One attempt at a piece of work: run a child, validate its records, classify how it ended.

use std::fs::File;

use super::child::{ChildEvent, ChildOutput};
use super::output_validator::OutputValidator;
use super::protocol::{self, ChildRequest, ChildWork};
use crate::domain::problem::Problem;
use crate::media::MediaLimits;
use crate::sandbox::{self, Budget, ChildOutcome, ChildSpec, Cost, Program, StopSwitch};

/// What one attempt needs.
pub struct ChildAttempt<'a> {
    /// The child's program: [`Program::this`] with the argument `child`.
    pub program: &'a Program,
    /// What the child is to do.
    pub request: ChildRequest,
    /// The child's input files, open for reading.
    pub inputs: Vec<File>,
    /// Limits of the child.
    pub budget: &'a Budget,
    /// Ends the child early.
    pub stop: &'a StopSwitch,
}

/// Why an attempt gave no result.
#[derive(Debug)]
pub enum AttemptFailure {
    /// The work cannot be done, however often it is tried.
    Impossible(Problem),
    /// The child crashed, sent invalid records or could not be run; another attempt may succeed.
    Crashed(String),
    /// The child reached a limit of time; the text says which.
    TimedOut(String),
    /// Ended on request.
    Stopped,
}

/// Runs a child to its end and passes each event in its output to `on_event`. Blocks: see [`sandbox::run`].
pub fn run_attempt(
    what: ChildAttempt<'_>,
    mut on_event: impl FnMut(ChildEvent),
) -> (Result<ChildOutput, AttemptFailure>, Cost) {
    let is_scoring =
        matches!(what.request.work, ChildWork::Score(_) | ChildWork::CheckEdit(_) | ChildWork::CheckTable(_));
    let mut validator = OutputValidator::new(&what.request.work, MediaLimits::default());
    let request = match protocol::encode(&what.request) {
        Ok(bytes) => bytes,
        Err(error) => {
            return (Err(AttemptFailure::Crashed(format!("the request cannot be encoded: {error}"))), Cost::default());
        }
    };
    let spec = ChildSpec { program: what.program, request, inputs: what.inputs };
    let ended = sandbox::run(spec, what.budget, what.stop, |record| {
        on_event(validator.validate(record)?);
        Ok(())
    });
    let output = validator.into_output();
    if output.landlock == Some(false) {
        warn_of_missing_landlock();
    }
    (classify_end(ended.outcome, &ended.stderr_tail, output, is_scoring), ended.cost)
}

fn classify_end(
    outcome: ChildOutcome,
    stderr_tail: &str,
    mut output: ChildOutput,
    is_scoring: bool,
) -> Result<ChildOutput, AttemptFailure> {
    match (outcome, output.problem.take()) {
        (ChildOutcome::Finished, Some(problem)) => Err(AttemptFailure::Impossible(problem)),
        (ChildOutcome::Finished, None) if output.done => Ok(output),
        (ChildOutcome::Finished, None) => Err(AttemptFailure::Crashed("ended without reporting a result".into())),
        (ChildOutcome::Stopped, _) => Err(AttemptFailure::Stopped),
        (ChildOutcome::OutOfMemory(known_by), _) => {
            let problem = if is_scoring { path_too_long_problem(known_by) } else { out_of_memory_problem(known_by) };
            Err(AttemptFailure::Impossible(problem))
        }
        (outcome, _) => {
            tracing::warn!(%outcome, stderr = stderr_tail, "child process failed");
            Err(match outcome {
                ChildOutcome::TimedOut(_) => AttemptFailure::TimedOut(outcome.to_string()),
                _ => AttemptFailure::Crashed(outcome.to_string()),
            })
        }
    }
}

fn out_of_memory_problem(known_by: &str) -> Problem {
    let detail = format!(
        "decoding and tracking this recording needs more memory than is allowed ({known_by}); \
         record at a lower resolution or for a shorter time"
    );
    Problem::new("too-much-memory", "The recording needs too much memory", detail)
}

fn path_too_long_problem(known_by: &str) -> Problem {
    let detail = format!(
        "scoring a path of this length needs more memory than is allowed ({known_by}); ask an administrator to raise \
         `scoring_memory_mib` in the settings, or send a shorter recording or table"
    );
    Problem::new("path-too-long", "The path is too long to be scored", detail)
}

fn warn_of_missing_landlock() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| {
        tracing::warn!(
            "this kernel does not enforce Landlock: child processes that decode recordings are confined by the system \
             call filter alone. Enable Landlock in the kernel, or require it in the settings to refuse recordings \
             instead."
        );
    });
}
