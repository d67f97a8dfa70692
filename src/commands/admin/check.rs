//! `trocar admin check`: is everything that the database knows of really there?

use anyhow::{Context, anyhow};

use super::super::Failure;
use super::Centre;
use crate::upkeep;

/// Arguments of `trocar admin check`.
#[derive(clap::Args)]
pub struct Args {
    /// Read every file and verify its content, not only its length
    #[arg(long)]
    thorough: bool,
}

/// Prints one line per finding.
pub async fn run(centre: &Centre, args: &Args) -> Result<(), Failure> {
    let findings = upkeep::check(&centre.store, &centre.vault, args.thorough).await.context("checking")?;
    for finding in &findings {
        println!("{finding}");
    }
    match findings.iter().filter(|finding| finding.is_loss()).count() {
        0 => {
            println!("clean: database and files agree");
            Ok(())
        }
        lost => Err(Failure::Failed(anyhow!("{lost} findings: restore what is missing from a backup"))),
    }
}
