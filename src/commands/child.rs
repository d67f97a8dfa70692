//! `trocar child`: the child process that the service starts for each recording. It reads and writes binary records;
//! people do not run it.

use super::CommandFailure;
use crate::analysis::child;

/// Arguments of `trocar child`.
#[derive(clap::Args)]
pub struct ChildArgs {}

/// Runs the command.
pub fn run(_args: ChildArgs) -> Result<(), CommandFailure> {
    child::run().map_err(|error| CommandFailure::Failed(error.into()))
}
