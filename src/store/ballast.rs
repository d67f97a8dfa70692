//! A file of 4 MiB that holds a place free. On a full disk SQLite refuses even to delete; without the ballast there is
//! room for that again.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Enough for the write-ahead log of a large deletion.
const BYTES: usize = 4 << 20;

/// The ballast file beside the database.
#[derive(Debug)]
pub(super) struct Ballast {
    path: PathBuf,
}

impl Ballast {
    /// The ballast of this database.
    pub fn beside(database: &Path) -> Self {
        Self { path: database.with_file_name("ballast") }
    }

    /// Gives the space free; `false` if it was free already, or could not be freed.
    pub async fn release(&self) -> bool {
        let path = self.path.clone();
        let removed = tokio::task::spawn_blocking(move || std::fs::remove_file(path).is_ok());
        removed.await.unwrap_or(false)
    }

    /// Takes the space again, if it is there: a disk that is still full is no error, only noted.
    pub async fn restore(&self) {
        let path = self.path.clone();
        let written = tokio::task::spawn_blocking(move || write(&path)).await;
        if let Ok(Err(error)) = written {
            tracing::warn!(%error, "no space for the ballast file: erasing on a full disk may fail");
        }
    }
}

/// Written, not only made longer: a file with holes holds no place. One that a sudden end left short is written anew.
fn write(path: &Path) -> std::io::Result<()> {
    if std::fs::metadata(path).is_ok_and(|found| found.len() == BYTES as u64) {
        return Ok(());
    }
    let mut file = File::create(path)?;
    let written = file.write_all(&vec![0; BYTES]).and_then(|()| file.sync_data());
    if written.is_err() {
        std::fs::remove_file(path)?;
    }
    written
}
