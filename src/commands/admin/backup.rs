//! `trocar admin backup`: copies the data folder.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, anyhow};

use super::super::CommandFailure;
use super::{DataFolder, LOST_FILES, print_lost};
use crate::domain::text::count_of;
use crate::settings::DATABASE_FILE;
use crate::shutdown::Shutdown;
use crate::time::SystemClock;
use crate::upkeep::{self, BackupReport, UpkeepError};

/// Arguments of `trocar admin backup`.
#[derive(clap::Args)]
pub struct BackupArgs {
    /// Folder for the copy: a new one, which is created, an empty one, or one that an interrupted backup left
    #[arg(value_name = "FOLDER")]
    to: PathBuf,
}

/// Makes the backup and prints what it holds. Fails if it lacks files; it is made all the same.
pub async fn run(folder: &DataFolder, args: &BackupArgs) -> Result<(), CommandFailure> {
    let stop = Shutdown::new();
    stop.begin_on_signals().context("listening for signals")?;
    let (data, clock) = ((&folder.store, &folder.vault), Arc::new(SystemClock));
    let BackupReport { files, missing } = match upkeep::back_up(data, &args.to, DATABASE_FILE, clock, &stop).await {
        Err(used @ UpkeepError::Used(_)) => return Err(CommandFailure::input(used)),
        done => done.with_context(|| format!("backing up to `{}`", args.to.display()))?,
    };
    let shown = args.to.display();
    let state = if missing.is_empty() { "complete" } else { "with missing files" };
    println!("backup {state}: `{shown}` holds the database and {}, all verified", count_of(files, "file"));
    println!("to restore, run: trocar admin restore {shown} --data NEW-FOLDER");
    print_lost(&missing);
    if missing.is_empty() {
        return Ok(());
    }
    Err(CommandFailure::Failed(anyhow!(
        "the backup `{shown}` is made, but lacks the {} files above, which are lost in the data folder; its file \
         BACKUP names them, too. {LOST_FILES}",
        missing.len()
    )))
}
