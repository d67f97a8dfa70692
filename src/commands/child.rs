//! `trocar child`: what the service runs for each recording. It speaks records, not text; people have no use for it.

use super::Failure;
use crate::analysis::child;

/// Arguments of `trocar child`.
#[derive(clap::Args)]
pub struct Args {}

/// Runs the command.
pub fn run(_args: Args) -> Result<(), Failure> {
    child::run().map_err(|error| Failure::Failed(error.into()))
}
