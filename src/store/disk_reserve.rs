//! Reserve files that keep disk space free. On a full disk SQLite can neither delete rows nor open a database; deleting
//! or shortening a reserve file frees the space that it needs.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use super::error::{StoreError, StoreResult};

/// Space that opening the database takes at most, bytes: 32 KiB for the index of the write-ahead log, and the first
/// writes of a start. SQLite maps the index into memory. If the disk has no block for a page of it, the system kills
/// the process; this happens on file systems with blocks below 4 KiB.
const OPENING_BYTES: u64 = 512 << 10;
/// The part of the delete reserve that is freed to open the database, bytes. The rest stays for deletions.
const FREED_BYTES: u64 = 1 << 20;

/// A reserve file beside the database.
#[derive(Debug)]
pub(super) struct DiskReserve {
    path: PathBuf,
    bytes: u64,
}

impl DiskReserve {
    /// Reserve for deletions: enough for the write-ahead log of a large one.
    pub fn for_deletes(database: &Path) -> Self {
        Self { path: database.with_file_name("ballast"), bytes: 4 << 20 }
    }

    /// Reserve for signing in to delete something. It is a separate file because other users' writes may use up the
    /// space of the first.
    pub fn for_sign_in(database: &Path) -> Self {
        Self { path: database.with_file_name("ballast-sign-in"), bytes: 256 << 10 }
    }

    /// Deletes the reserve file; `false` if there was none or it could not be deleted.
    pub async fn release(&self) -> bool {
        let path = self.path.clone();
        let removed = tokio::task::spawn_blocking(move || fs::remove_file(path).is_ok());
        removed.await.unwrap_or(false)
    }

    /// Writes the reserve file again. If the disk is still full, this logs a warning and is no error.
    pub async fn restore(&self) {
        let (path, bytes) = (self.path.clone(), self.bytes);
        let written = tokio::task::spawn_blocking(move || write_zeros(&path, bytes)).await;
        if let Ok(Err(error)) = written {
            tracing::warn!(
                %error, file = %self.path.display(),
                "disk reserve not written; deleting on a full disk may fail"
            );
        }
    }

    /// Frees at most so many bytes of the reserve; `false` if there was none or it could not be shortened.
    fn shorten(&self, bytes: u64) -> bool {
        let shorten = || {
            let file = File::options().write(true).open(&self.path)?;
            let before = file.metadata()?.len();
            file.set_len(before.saturating_sub(bytes))?;
            file.sync_all()?; // some file systems give the space back only then
            io::Result::Ok(before > 0)
        };
        shorten().unwrap_or(false)
    }
}

/// Makes sure that the disk has the space that opening the database for writing takes. On a full disk, a part of the
/// delete reserve is freed for it, so that people can sign in and delete something.
///
/// # Errors
/// [`StoreError::NoSpaceToOpen`] if that is not enough, [`StoreError::Unusable`] if the folder cannot be written.
pub(super) async fn require_space(database: &Path) -> StoreResult<()> {
    let database = database.to_owned();
    let found = tokio::task::spawn_blocking(move || make_space(&database));
    found.await.unwrap_or(Err(StoreError::Closed))
}

fn make_space(database: &Path) -> StoreResult<()> {
    if has_space(database)? {
        return Ok(());
    }
    let folder = database.parent().unwrap_or(database).to_owned();
    if DiskReserve::for_deletes(database).shorten(FREED_BYTES) && has_space(database)? {
        tracing::warn!(
            folder = %folder.display(),
            "the disk is full; opening the database uses a part of the reserve for deletions; free some space"
        );
        return Ok(());
    }
    Err(StoreError::NoSpaceToOpen { folder, needed: OPENING_BYTES })
}

/// Writes a file of the size that opening the database takes, and deletes it. The free space that the system states
/// would be no proof: it knows no quotas.
fn has_space(database: &Path) -> StoreResult<bool> {
    let path = database.with_file_name("ballast-opening");
    let written = write_zeros(&path, OPENING_BYTES);
    match written.and(remove(&path)) {
        Ok(()) => Ok(true),
        Err(error) if matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded) => Ok(false),
        Err(error) => Err(StoreError::Unusable(format!("`{}`: {error}", path.display()))),
    }
}

/// Writes real zeros, since a sparse file reserves no space. A file that is too short is extended; if the disk is full,
/// it keeps its length.
fn write_zeros(path: &Path, bytes: u64) -> io::Result<()> {
    let mut file = File::options().append(true).create(true).open(path)?;
    let before = file.metadata()?.len();
    let missing = bytes.saturating_sub(before);
    if missing == 0 {
        return Ok(());
    }
    let written = file.write_all(&vec![0; missing as usize]).and_then(|()| file.sync_data());
    if written.is_err() {
        if before == 0 { remove(path)? } else { file.set_len(before)? }
    }
    written
}

/// Removes a file; a missing file is no error.
fn remove(path: &Path) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}
