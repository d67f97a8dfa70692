//! Files that hold a place free. On a full disk SQLite refuses even to delete; without the ballast there is room for that
//! again.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// A ballast file beside the database.
#[derive(Debug)]
pub(super) struct Ballast {
    path: PathBuf,
    bytes: usize,
}

impl Ballast {
    /// For who erases: enough for the write-ahead log of a large deletion.
    pub fn to_erase(database: &Path) -> Self {
        Self { path: database.with_file_name("ballast"), bytes: 4 << 20 }
    }

    /// For letting in who can erase: of its own, since what others write takes the space that erasing needs.
    pub fn to_let_in(database: &Path) -> Self {
        Self { path: database.with_file_name("ballast-sign-in"), bytes: 256 << 10 }
    }

    /// Gives the space free; `false` if it was free already, or could not be freed.
    pub async fn release(&self) -> bool {
        let path = self.path.clone();
        let removed = tokio::task::spawn_blocking(move || std::fs::remove_file(path).is_ok());
        removed.await.unwrap_or(false)
    }

    /// Takes the space again, if it is there: a disk that is still full is no error, only noted.
    pub async fn restore(&self) {
        let (path, bytes) = (self.path.clone(), self.bytes);
        let written = tokio::task::spawn_blocking(move || write(&path, bytes)).await;
        if let Ok(Err(error)) = written {
            tracing::warn!(%error, file = %self.path.display(), "no space for a ballast file: erasing on a full disk may fail");
        }
    }
}

/// Written, not only made longer: a file with holes holds no place. One that a sudden end left short is written anew.
fn write(path: &Path, bytes: usize) -> std::io::Result<()> {
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
