//! A data folder without its database: no new one is made there. It would name none of the files, and the recovery
//! takes files without a row for leftovers of a crash.

use std::fs;
use std::path::{Path, PathBuf};

use super::update_copy::has_update_copy;
use super::{ERASURE_LIST, UpkeepError, UpkeepResult};
use crate::vault::{Vault, VaultError, VaultResult};

/// Refuses a folder that holds something of an earlier database; call it if the database is missing or has no tables. A
/// first start that was interrupted leaves only empty folders and perhaps a database without tables.
///
/// # Errors
/// [`UpkeepError::LostDatabase`] says what was found and what to do.
pub async fn refuse_lost_database(vault: &Vault, database: &Path) -> UpkeepResult<()> {
    let remains = [
        ("stored files", has_blob(vault).await?),
        ("uploads", has_any(vault.upload_files().await)?),
        ("live recordings", has_any(vault.feed_logs().await)?),
        ("a list of erasures", vault.folder().join(ERASURE_LIST).exists()),
        ("a copy from before an update", has_update_copy(vault)?),
        ("a write-ahead log", has_log_alone(database)),
    ];
    let found: Vec<&str> = remains.into_iter().filter(|(_, is_there)| *is_there).map(|(what, _)| what).collect();
    if found.is_empty() {
        return Ok(());
    }
    Err(UpkeepError::LostDatabase { database: database.to_owned(), remains: found.join(", ") })
}

async fn has_blob(vault: &Vault) -> UpkeepResult<bool> {
    for first in 0..=u8::MAX {
        if has_any(vault.blobs(first).await)? {
            return Ok(true);
        }
    }
    Ok(false)
}

/// True if a folder of the vault has entries; it may be missing.
fn has_any<T>(listed: VaultResult<Vec<T>>) -> UpkeepResult<bool> {
    match listed {
        Err(VaultError::NotFound) => Ok(false),
        listed => Ok(!listed?.is_empty()),
    }
}

/// True if a log has bytes although its database has none: SQLite writes to the database first.
fn has_log_alone(database: &Path) -> bool {
    let has_bytes = |path: &Path| fs::metadata(path).is_ok_and(|found| found.len() > 0);
    let mut log = database.as_os_str().to_owned();
    log.push("-wal");
    !has_bytes(database) && has_bytes(&PathBuf::from(log))
}
