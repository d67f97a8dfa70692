//! `trocar child`: the child process that the service starts for each recording. It reads and writes binary records;
//! people do not run it.

use super::Failure;
use crate::analysis::child;

/// Arguments of `trocar child`.
#[derive(clap::Args)]
pub struct Args {}

/// Runs the command.
pub fn run(_args: Args) -> Result<(), Failure> {
    child::run().map_err(|error| Failure::Failed(error.into()))
}
