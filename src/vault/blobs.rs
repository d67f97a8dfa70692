//! Writes, reads, verifies and removes blobs.

use std::fs::File;
use std::future::Future;
use std::io::{Read, SeekFrom};
use std::path::PathBuf;

use sha2::{Digest, Sha256};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncSeekExt};
use tokio::time::Instant;

use super::disk::{self, run_blocking};
use super::error::{VaultError, VaultResult, failed};
use super::pins::PinnedBlob;
use super::write_buffer::WriteBuffer;
use super::{Vault, uploads};
use crate::domain::blob::{Blob, BlobHash};
use crate::ids::UploadId;

/// The outcome of removing a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Removal {
    /// The file is removed.
    Removed,
    /// The file stays: it is needed or is just being written.
    Needed,
}

/// A blob that is being written. If it is dropped before [`Incoming::finish`], it is deleted, at the latest at the next
/// start.
#[derive(Debug)]
pub struct Incoming {
    vault: Vault,
    most: u64,
    bytes: u64,
    buffer: WriteBuffer,
    file: Option<Box<IncomingFile>>,
}

/// The file behind an [`Incoming`], moved to a blocking thread for each write.
#[derive(Debug)]
struct IncomingFile {
    path: PathBuf,
    file: File,
    hash: Sha256,
    finished: bool,
}

/// Bytes per read.
const BLOCK: usize = 256 * 1024;

impl Vault {
    /// Stores these bytes as a blob. The same bytes stored twice are one blob.
    pub async fn put(&self, bytes: &[u8]) -> VaultResult<PinnedBlob> {
        let mut incoming = self.incoming(bytes.len() as u64).await?;
        incoming.write(bytes).await?;
        incoming.finish().await
    }

    /// Begins a blob of at most `most` bytes.
    pub async fn incoming(&self, most: u64) -> VaultResult<Incoming> {
        let path = self.inner.data.join("incoming").join(format!("{:032x}", rand::random::<u128>()));
        let part = run_blocking(move || {
            let file = disk::create(&path)?;
            Ok(Box::new(IncomingFile { path, file, hash: Sha256::new(), finished: false }))
        });
        Ok(Incoming { vault: self.clone(), most, bytes: 0, buffer: WriteBuffer::default(), file: Some(part.await?) })
    }

    /// Opens a blob for reading and returns its length. The content is not verified: see [`Vault::open_verified`],
    /// [`Vault::read`] and [`Vault::is_intact`].
    pub async fn open_blob(&self, hash: BlobHash) -> VaultResult<(File, u64)> {
        let path = self.blob_path(hash);
        run_blocking(move || {
            let file = disk::open(&path)?;
            let bytes = file.metadata().map_err(failed("measuring", &path))?.len();
            Ok((file, bytes))
        })
        .await
    }

    /// Opens a blob for reading and verifies its content, in the memory of one block.
    pub async fn open_verified(&self, hash: BlobHash) -> VaultResult<File> {
        let path = self.blob_path(hash);
        run_blocking(move || {
            let found = hash_of(disk::open(&path)?, &path)?;
            if found.hash == hash { disk::open(&path) } else { Err(VaultError::Damaged) }
        })
        .await
    }

    /// Opens a part of a blob: `length` bytes from byte `start`, or fewer if it ends before.
    pub async fn open_range(
        &self,
        hash: BlobHash,
        start: u64,
        length: u64,
    ) -> VaultResult<impl AsyncRead + Send + Unpin + use<>> {
        let (file, _) = self.open_blob(hash).await?;
        let mut file = tokio::fs::File::from_std(file);
        file.seek(SeekFrom::Start(start)).await.map_err(failed("reading", &self.blob_path(hash)))?;
        Ok(file.take(length))
    }

    /// Reads and verifies a whole blob. For results and other blobs that fit into memory; a blob of more than `most`
    /// bytes is refused.
    pub async fn read(&self, hash: BlobHash, most: u64) -> VaultResult<Vec<u8>> {
        let path = self.blob_path(hash);
        run_blocking(move || {
            let mut content = Vec::new();
            let file = disk::open(&path)?;
            file.take(most + 1).read_to_end(&mut content).map_err(failed("reading", &path))?;
            if content.len() as u64 > most {
                return Err(VaultError::TooLong { most });
            }
            if Blob::of(&content).hash == hash { Ok(content) } else { Err(VaultError::Damaged) }
        })
        .await
    }

    /// True if the file's content still matches the hash in its name.
    pub async fn is_intact(&self, hash: BlobHash) -> VaultResult<bool> {
        let path = self.blob_path(hash);
        run_blocking(move || Ok(hash_of(disk::open(&path)?, &path)?.hash == hash)).await
    }

    /// Removes a blob unless it is being put or is needed. `is_free` must return true if nothing refers to the blob; it
    /// runs while nothing can put the blob.
    pub async fn delete_if<E: From<VaultError>>(
        &self,
        hash: BlobHash,
        is_free: impl Future<Output = Result<bool, E>>,
    ) -> Result<Removal, E> {
        let Some(removing) = self.inner.pins.begin_removal(hash) else { return Ok(Removal::Needed) };
        if !is_free.await? {
            removing.settle();
            return Ok(Removal::Needed);
        }
        let path = self.blob_path(hash);
        let removed = run_blocking(move || {
            disk::remove(&path)?;
            removing.settle(); // from here on it may be put again
            Ok(())
        });
        removed.await?;
        Ok(Removal::Removed)
    }

    /// Blobs that were put and whose [`PinnedBlob`] was dropped, until [`Vault::delete_if`] has checked them. The vault
    /// does not know whether they ever got a row.
    pub fn released(&self) -> Vec<BlobHash> {
        self.inner.pins.released()
    }

    /// The blobs whose hash begins with this byte, with their lengths; files with other names are ignored.
    pub async fn blobs(&self, first: u8) -> VaultResult<Vec<Blob>> {
        let folder = self.inner.data.join("blobs").join(format!("{first:02x}"));
        run_blocking(move || {
            let named = |(path, bytes): (PathBuf, u64)| {
                let hash = path.file_name()?.to_str()?.parse().ok()?;
                Some(Blob { hash, bytes })
            };
            Ok(disk::list(&folder)?.into_iter().filter_map(named).collect())
        })
        .await
    }

    /// Makes a complete upload a blob with a second name. The upload's own file stays until [`Vault::delete_upload`],
    /// so that nothing is lost if the process ends before the session's row is written.
    pub async fn keep_upload(&self, id: UploadId) -> VaultResult<PinnedBlob> {
        let path = uploads::path(&self.inner.data, id);
        let hashed = path.clone();
        let blob = run_blocking(move || hash_of(disk::open(&hashed)?, &hashed)).await?;
        let pin = self.inner.pins.pin(blob.hash).await;
        let name = self.blob_path(blob.hash);
        run_blocking(move || {
            disk::sync(&disk::open(&path)?, &path);
            link_blob(&name, || std::fs::hard_link(&path, &name))?;
            Ok(PinnedBlob::new(blob, pin))
        })
        .await
    }

    pub(super) fn blob_path(&self, hash: BlobHash) -> PathBuf {
        self.inner.data.join("blobs").join(format!("{:02x}", hash.0[0])).join(hash.to_string())
    }
}

impl Incoming {
    /// Adds bytes.
    pub async fn write(&mut self, bytes: &[u8]) -> VaultResult<()> {
        self.bytes += bytes.len() as u64;
        if self.bytes > self.most {
            return Err(VaultError::TooLong { most: self.most });
        }
        if self.buffer.add(bytes, Instant::now()) { self.flush().await } else { Ok(()) }
    }

    /// Finishes the blob: it is durable and has its name when this returns.
    pub async fn finish(mut self) -> VaultResult<PinnedBlob> {
        self.flush().await?;
        let mut part = self.take_file()?;
        let blob = Blob { hash: BlobHash(part.hash.clone().finalize().into()), bytes: self.bytes };
        let pin = self.vault.inner.pins.pin(blob.hash).await;
        let name = self.vault.blob_path(blob.hash);
        run_blocking(move || {
            disk::sync(&part.file, &part.path);
            link_blob(&name, || std::fs::hard_link(&part.path, &name))?;
            part.finish()?;
            Ok(PinnedBlob::new(blob, pin))
        })
        .await
    }

    async fn flush(&mut self) -> VaultResult<()> {
        let mut part = self.take_file()?;
        let bytes = self.buffer.take();
        let (part, bytes) = run_blocking(move || {
            part.hash.update(&bytes);
            disk::write(&part.file, &bytes, &part.path)?;
            Ok((part, bytes))
        })
        .await?;
        self.buffer.reuse(bytes);
        self.file = Some(part);
        Ok(())
    }

    /// The file; an error if an earlier write failed or was cancelled.
    fn take_file(&mut self) -> VaultResult<Box<IncomingFile>> {
        self.file.take().ok_or(VaultError::NotFound)
    }
}

impl IncomingFile {
    fn finish(&mut self) -> VaultResult<()> {
        self.finished = true;
        disk::remove(&self.path)
    }
}

impl Drop for IncomingFile {
    fn drop(&mut self) {
        if !self.finished && disk::remove(&self.path).is_err() {
            tracing::warn!(
                path = %self.path.display(),
                "could not remove an unfinished file; the next start removes it"
            );
        }
    }
}

/// Links a synced file under its name among the blobs. A blob of this name may exist already; its folder is synced all
/// the same, since the other writer may not have done so yet.
pub(super) fn link_blob(name: &std::path::Path, link: impl FnOnce() -> std::io::Result<()>) -> VaultResult<()> {
    match link() {
        Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {}
        linked => linked.map_err(failed("naming", name))?,
    }
    if let Some(folder) = name.parent() {
        disk::sync_folder(folder);
    }
    Ok(())
}

pub(super) fn hash_of(mut file: File, path: &std::path::Path) -> VaultResult<Blob> {
    let mut hash = Sha256::new();
    let mut buffer = vec![0; BLOCK];
    let mut bytes = 0;
    loop {
        match file.read(&mut buffer).map_err(failed("reading", path))? {
            0 => return Ok(Blob { hash: BlobHash(hash.finalize().into()), bytes }),
            n => {
                hash.update(&buffer[..n]);
                bytes += n as u64;
            }
        }
    }
}
