//! Writes, reads, verifies and removes blobs.

use std::fs::File;
use std::future::Future;
use std::io::{ErrorKind, Read, SeekFrom};
use std::path::PathBuf;

use sha2::{Digest, Sha256};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncSeekExt};
use tokio::time::Instant;

use super::disk::{self, run_blocking};
use super::error::{FileLoss, VaultError, VaultResult, failed};
use super::pins::PinnedBlob;
use super::write_buffer::WriteBuffer;
use super::{Vault, uploads};
use crate::domain::blob::{Blob, BlobHash};
use crate::ids::UploadId;
use crate::shutdown::Shutdown;

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
        let path = self.incoming_path();
        let part = run_blocking(move || Ok(Box::new(IncomingFile::create(path)?)));
        Ok(Incoming { vault: self.clone(), most, bytes: 0, buffer: WriteBuffer::default(), file: Some(part.await?) })
    }

    /// Opens a blob for reading and returns its length. The content is not verified: see [`Vault::open_verified`],
    /// [`Vault::read`] and [`Vault::verify`].
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

    /// Reads a blob and compares it with its hash and length; `None`: it is intact.
    ///
    /// # Errors
    /// [`VaultError::ShuttingDown`] if `stop` begins before the end of the file.
    pub async fn verify(&self, blob: Blob, stop: &Shutdown) -> VaultResult<Option<FileLoss>> {
        let (path, stop) = (self.blob_path(blob.hash), stop.clone());
        run_blocking(move || {
            let read = disk::open(&path).and_then(|file| read_blocks(file, &path, &stop, |_| Ok(())));
            lost(read.and_then(|found| if found == blob { Ok(()) } else { Err(VaultError::Damaged) }))
        })
        .await
    }

    /// Copies a blob to another vault and verifies it meanwhile. Returns why it cannot be read; `None`: it is copied,
    /// and the copy is durable and has its name. In all other cases the other vault stays as it was.
    ///
    /// # Errors
    /// The copy cannot be written. [`VaultError::ShuttingDown`] if `stop` begins before the end of the file.
    pub async fn copy_blob(&self, blob: Blob, to: &Vault, stop: &Shutdown) -> VaultResult<Option<FileLoss>> {
        let (path, name, part) = (self.blob_path(blob.hash), to.blob_path(blob.hash), to.incoming_path());
        let stop = stop.clone();
        run_blocking(move || {
            let original = match disk::open(&path) {
                Ok(original) => original,
                error => return lost(error.map(drop)),
            };
            let mut part = IncomingFile::create(part)?;
            let mut written = Ok(());
            let read = read_blocks(original, &path, &stop, |block| {
                written = disk::write(&part.file, block, &part.path);
                written.clone()
            });
            written?; // a failure of the copy, which says nothing about the original
            match read {
                Ok(found) if found == blob => part.link(&name).map(|()| None),
                Ok(_) => Ok(Some(FileLoss::Damaged)),
                error => lost(error.map(drop)),
            }
        })
        .await
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
        self.inner.data.join(hash.file())
    }

    /// A new path for a blob that is being written.
    fn incoming_path(&self) -> PathBuf {
        self.inner.data.join("incoming").join(format!("{:032x}", rand::random::<u128>()))
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
            part.link(&name)?;
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
    fn create(path: PathBuf) -> VaultResult<Self> {
        let file = disk::create(&path)?;
        Ok(Self { path, file, hash: Sha256::new(), finished: false })
    }

    /// Gives the file its name among the blobs; durable when this returns.
    fn link(&mut self, name: &std::path::Path) -> VaultResult<()> {
        disk::sync(&self.file, &self.path);
        link_blob(name, || std::fs::hard_link(&self.path, name))?;
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

pub(super) fn hash_of(file: File, path: &std::path::Path) -> VaultResult<Blob> {
    read_blocks(file, path, &Shutdown::new(), |_| Ok(()))
}

/// Reads a file to its end, block by block, and returns the blob that it is. A stop ends it between two blocks.
fn read_blocks(
    mut file: File,
    path: &std::path::Path,
    stop: &Shutdown,
    mut take: impl FnMut(&[u8]) -> VaultResult<()>,
) -> VaultResult<Blob> {
    let (mut hash, mut bytes, mut buffer) = (Sha256::new(), 0, vec![0; BLOCK]);
    loop {
        if stop.is_begun() {
            return Err(VaultError::ShuttingDown);
        }
        match file.read(&mut buffer) {
            Ok(0) => return Ok(Blob { hash: BlobHash(hash.finalize().into()), bytes }),
            Ok(read) => {
                hash.update(&buffer[..read]);
                bytes += read as u64;
                take(&buffer[..read])?;
            }
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(failed("reading", path)(error)),
        }
    }
}

/// The loss that a failed read means; `None`: the read succeeded.
fn lost(read: VaultResult<()>) -> VaultResult<Option<FileLoss>> {
    match read {
        Ok(()) => Ok(None),
        Err(error) => error.loss().map_or(Err(error), |loss| Ok(Some(loss))),
    }
}
