//! Reserve files that keep disk space free. On a full disk SQLite cannot even delete rows; deleting a reserve file
//! frees the space that it needs.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// A reserve file beside the database.
#[derive(Debug)]
pub(super) struct DiskReserve {
    path: PathBuf,
    bytes: usize,
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
        let removed = tokio::task::spawn_blocking(move || std::fs::remove_file(path).is_ok());
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
}

/// Writes real zeros, since a sparse file reserves no space. A file that a crash left short is written anew.
fn write_zeros(path: &Path, bytes: usize) -> std::io::Result<()> {
    if std::fs::metadata(path).is_ok_and(|found| found.len() == bytes as u64) {
        return Ok(());
    }
    let mut file = File::create(path)?;
    let written = file.write_all(&vec![0; bytes]).and_then(|()| file.sync_data());
    if written.is_err() {
        std::fs::remove_file(path)?;
    }
    written
}
