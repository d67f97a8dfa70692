//! Temporary files that another process writes, such as a child, and that become blobs afterwards.

use std::fs::File;
use std::path::PathBuf;

use super::Vault;
use super::blobs::{hash_of, link_blob};
use super::disk::{self, run_blocking};
use super::error::{VaultError, VaultResult, failed};
use super::pins::PinnedBlob;

/// An empty file to be written. If it is dropped before [`TemporaryFile::keep`], it is deleted, at the latest at the
/// next start.
#[derive(Debug)]
pub struct TemporaryFile {
    vault: Vault,
    path: PathBuf,
    file: File,
}

impl Vault {
    /// Checks that the disk has space for `bytes` bytes.
    ///
    /// # Errors
    /// [`VaultError::DiskFull`] if it has not.
    pub async fn require_space(&self, bytes: u64) -> VaultResult<()> {
        if self.free_bytes().await? < bytes { Err(VaultError::DiskFull) } else { Ok(()) }
    }

    /// Free bytes on the disk that the service may use.
    pub async fn free_bytes(&self) -> VaultResult<u64> {
        let folder = self.inner.data.join("incoming");
        run_blocking(move || {
            let disk = rustix::fs::statvfs(&folder).map_err(|error| failed("measuring", &folder)(error.into()))?;
            Ok(disk.f_bavail.saturating_mul(disk.f_frsize))
        })
        .await
    }

    /// Creates a file for another process to write.
    pub async fn create_temporary_file(&self) -> VaultResult<TemporaryFile> {
        let path = self.inner.data.join("incoming").join(format!("{:032x}", rand::random::<u128>()));
        let vault = self.clone();
        run_blocking(move || Ok(TemporaryFile { file: disk::create_to_read(&path)?, vault, path })).await
    }
}

impl TemporaryFile {
    /// The file, open for reading and writing.
    pub fn file(&self) -> VaultResult<File> {
        self.file.try_clone().map_err(failed("opening", &self.path))
    }

    /// Makes the file a blob: it is durable and has its name when this returns.
    pub async fn keep(self) -> VaultResult<PinnedBlob> {
        let path = self.path.clone();
        let blob = run_blocking(move || hash_of(disk::open(&path)?, &path)).await?;
        if blob.bytes == 0 {
            return Err(VaultError::NotFound);
        }
        let pin = self.vault.inner.pins.pin(blob.hash).await;
        let name = self.vault.blob_path(blob.hash);
        run_blocking(move || {
            disk::sync(&self.file, &self.path);
            link_blob(&name, || std::fs::hard_link(&self.path, &name))?;
            Ok(PinnedBlob::new(blob, pin))
        })
        .await
    }
}

impl Drop for TemporaryFile {
    fn drop(&mut self) {
        if disk::remove(&self.path).is_err() {
            tracing::warn!(
                path = %self.path.display(),
                "could not remove an unfinished file; the next start removes it"
            );
        }
    }
}
