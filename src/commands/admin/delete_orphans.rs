//! `trocar admin delete-orphans`: deletes the stored files that the database does not name.

use anyhow::{Context, anyhow};

use super::super::CommandFailure;
use super::DataFolder;
use crate::domain::text::count_of;
use crate::upkeep;
use crate::vault::VaultError;

/// Deletes the files and prints their number. A running service stores each file before its row, so it must be stopped.
pub async fn run(folder: &DataFolder) -> Result<(), CommandFailure> {
    let _lock = match folder.vault.lock().await {
        Err(VaultError::InUse(_)) => {
            return Err(CommandFailure::input(anyhow!(
                "the service is running and may be storing files: stop it first"
            )));
        }
        locked => locked.context("locking the data folder")?,
    };
    let deleted = upkeep::delete_orphans(&folder.store, &folder.vault).await.context("deleting files")?;
    println!("deleted: {} that the database does not need", count_of(deleted as u64, "file"));
    Ok(())
}
