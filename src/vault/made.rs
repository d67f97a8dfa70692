//! Temporary files that another process writes, such as a child, and that become blobs afterwards.

use std::fs::File;
use std::path::PathBuf;

use super::Vault;
use super::blobs::{give_name, hash_of};
use super::disk::{self, on_a_blocking_thread};
use super::error::{VaultError, VaultResult, failed};
use super::pins::Kept;

/// An empty file to be written. If it is dropped before [`TemporaryFile::keep`], it is deleted, at the latest at the
/// next start.
#[derive(Debug)]
pub struct Made {
    vault: Vault,
    path: PathBuf,
    file: File,
}

impl Vault {
    /// Checks that the disk has space for `bytes` bytes.
    ///
    /// # Errors
    /// [`VaultError::DiskFull`] if it has not.
    pub async fn has_room(&self, bytes: u64) -> VaultResult<()> {
        if self.free_bytes().await? < bytes { Err(VaultError::DiskFull) } else { Ok(()) }
    }

    /// Free bytes on the disk that the service may use.
    pub async fn free_bytes(&self) -> VaultResult<u64> {
        let folder = self.inner.data.join("incoming");
        on_a_blocking_thread(move || {
            let disk = rustix::fs::statvfs(&folder).map_err(|error| failed("measuring", &folder)(error.into()))?;
            Ok(disk.f_bavail.saturating_mul(disk.f_frsize))
        })
        .await
    }

    /// Creates a file for another process to write.
    pub async fn make_file(&self) -> VaultResult<Made> {
        let path = self.inner.data.join("incoming").join(format!("{:032x}", rand::random::<u128>()));
        let vault = self.clone();
        on_a_blocking_thread(move || Ok(Made { file: disk::create_to_read(&path)?, vault, path })).await
    }
}

impl Made {
    /// The file, open for reading and writing.
    pub fn file(&self) -> VaultResult<File> {
        self.file.try_clone().map_err(failed("opening", &self.path))
    }

    /// Makes the file a blob: it is durable and has its name when this returns.
    pub async fn keep(self) -> VaultResult<Kept> {
        let path = self.path.clone();
        let blob = on_a_blocking_thread(move || hash_of(disk::open(&path)?, &path)).await?;
        if blob.bytes == 0 {
            return Err(VaultError::NotFound);
        }
        let pin = self.vault.inner.pins.keep(blob.hash).await;
        let name = self.vault.blob_path(blob.hash);
        on_a_blocking_thread(move || {
            disk::sync(&self.file, &self.path);
            give_name(&name, || std::fs::hard_link(&self.path, &name))?;
            Ok(Kept::new(blob, pin))
        })
        .await
    }
}

impl Drop for Made {
    fn drop(&mut self) {
        if disk::remove(&self.path).is_err() {
            tracing::warn!(path = %self.path.display(), "could not remove an unfinished file; the next start removes it");
        }
    }
}
