//! `trocar admin backup`: copies the data folder.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Context;

use super::super::CommandFailure;
use super::DataFolder;
use crate::settings::DATABASE_FILE;
use crate::time::SystemClock;
use crate::upkeep::{self, UpkeepError};

/// Arguments of `trocar admin backup`.
#[derive(clap::Args)]
pub struct BackupArgs {
    /// Folder for the copy: a new one, which is created, or an empty one
    to: PathBuf,
}

/// Makes the backup and prints what it holds.
pub async fn run(folder: &DataFolder, args: &BackupArgs) -> Result<(), CommandFailure> {
    let done = upkeep::back_up((&folder.store, &folder.vault), &args.to, DATABASE_FILE, Arc::new(SystemClock)).await;
    let files = match done {
        Err(used @ UpkeepError::Used(_)) => return Err(CommandFailure::input(used)),
        done => done.with_context(|| format!("backing up to `{}`", args.to.display()))?,
    };
    println!("backup complete: `{}` holds the database and {files} files, all verified", args.to.display());
    println!("to restore, run: trocar admin restore {} --data NEW-FOLDER", args.to.display());
    Ok(())
}
