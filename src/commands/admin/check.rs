//! `trocar admin check`: checks that every file in the database is present and undamaged.

use anyhow::{Context, anyhow};

use super::super::CommandFailure;
use super::{DataFolder, LOST_FILES, store_failure};
use crate::upkeep;

/// Arguments of `trocar admin check`.
#[derive(clap::Args)]
pub struct CheckArgs {
    /// Also read every file and verify its content, not only its length
    #[arg(long)]
    thorough: bool,
}

/// Prints one line per finding. Fails if data is lost.
pub async fn run(folder: &DataFolder, args: &CheckArgs) -> Result<(), CommandFailure> {
    let findings = upkeep::check(&folder.store, &folder.vault, args.thorough).await;
    folder.store.require_unchanged().map_err(store_failure)?; // else the findings, or the error, mean nothing
    let findings = findings.context("checking")?;
    for finding in &findings {
        println!("{finding}");
    }
    match findings.iter().filter(|finding| finding.is_loss()).count() {
        0 => {
            println!("no data is lost: database and files agree");
            Ok(())
        }
        lost => {
            let why = anyhow!("data is lost ({lost} findings above). {LOST_FILES}. For other losses, restore a backup");
            Err(CommandFailure::Failed(why))
        }
    }
}
