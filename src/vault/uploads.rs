//! Uploads: one file each, appended to while a recording arrives.
//!
//! The order that makes every acknowledged byte durable: append → [`UploadFile::sync`] → offset in the row
//! (`store.uploads().advance`) → reply. Bytes after the recorded offset were never acknowledged. The first append cuts
//! them off, not the opening, since the offset may have been read before the upload was free and may be out of date.

use std::collections::HashSet;
use std::fs::File;
use std::future::Future;
use std::io::{Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use tokio::time::Instant;

use super::disk::{self, run_blocking};
use super::error::{VaultError, VaultResult, failed};
use super::write_buffer::WriteBuffer;
use super::{Removal, Vault};
use crate::ids::UploadId;

/// An upload's file, open for one sender at a time.
#[derive(Debug)]
pub struct UploadFile {
    appended: u64,
    buffer: WriteBuffer,
    file: Option<Box<OpenUploadFile>>,
}

/// The file behind an [`UploadFile`], moved to a blocking thread for each write. The claim moves with it, so that the
/// file cannot be opened again while a write for a sender that has gone away is still running.
#[derive(Debug)]
struct OpenUploadFile {
    path: PathBuf,
    file: File,
    /// Offset of the next append, bytes.
    written: u64,
    /// Has everything after this offset been cut off already?
    is_cut_off: bool,
    _claim: UploadClaim,
}

/// Which uploads are open.
#[derive(Clone, Debug, Default)]
pub(super) struct OpenUploads(Arc<Mutex<HashSet<UploadId>>>);

/// One sender's claim on an upload.
#[derive(Debug)]
struct UploadClaim {
    id: UploadId,
    open: OpenUploads,
}

impl Vault {
    /// Creates an upload's empty file durably and opens it. Keep it open until the upload's row is written: a file that
    /// is neither open nor in the database is deleted.
    pub async fn create_upload(&self, id: UploadId) -> VaultResult<UploadFile> {
        let claim = self.inner.open_uploads.claim(id)?;
        let path = path(&self.inner.data, id);
        let file = run_blocking(move || {
            let file = disk::create(&path)?;
            disk::sync(&file, &path);
            path.parent().into_iter().for_each(disk::sync_folder);
            Ok(Box::new(OpenUploadFile { path, file, written: 0, is_cut_off: true, _claim: claim }))
        });
        Ok(UploadFile { appended: 0, buffer: WriteBuffer::default(), file: Some(file.await?) })
    }

    /// Opens an upload to append after the `noted` bytes. [`VaultError::InUse`] while another sender has it open. Read
    /// the row again once it is open: from then on no other sender can advance it.
    pub async fn open_upload(&self, id: UploadId, noted: u64) -> VaultResult<UploadFile> {
        let claim = self.inner.open_uploads.claim(id)?;
        let path = path(&self.inner.data, id);
        let file = run_blocking(move || {
            let file = disk::open_to_write(&path)?;
            let found = file.metadata().map_err(failed("measuring", &path))?.len();
            if found < noted {
                return Err(VaultError::Lost { found, noted });
            }
            Ok(Box::new(OpenUploadFile { path, file, written: noted, is_cut_off: false, _claim: claim }))
        });
        Ok(UploadFile { appended: noted, buffer: WriteBuffer::default(), file: Some(file.await?) })
    }

    /// Length of an upload's file, bytes.
    pub async fn upload_length(&self, id: UploadId) -> VaultResult<u64> {
        let path = path(&self.inner.data, id);
        run_blocking(move || Ok(disk::open(&path)?.metadata().map_err(failed("measuring", &path))?.len())).await
    }

    /// Deletes an upload's file, after its row. A missing file is no error.
    pub async fn delete_upload(&self, id: UploadId) -> VaultResult<()> {
        let path = path(&self.inner.data, id);
        run_blocking(move || disk::remove(&path)).await
    }

    /// Deletes an upload's file if it is not open and not in the database. `is_free` must return true if the database
    /// does not know it; it runs while the file cannot be opened.
    pub async fn delete_upload_if<E: From<VaultError>>(
        &self,
        id: UploadId,
        is_free: impl Future<Output = Result<bool, E>>,
    ) -> Result<Removal, E> {
        let Ok(_claim) = self.inner.open_uploads.claim(id) else { return Ok(Removal::Needed) };
        if !is_free.await? {
            return Ok(Removal::Needed);
        }
        self.delete_upload(id).await?;
        Ok(Removal::Removed)
    }

    /// The uploads that have a file.
    pub async fn upload_files(&self) -> VaultResult<Vec<UploadId>> {
        let folder = self.inner.data.join("uploads");
        run_blocking(move || disk::ids_in(&folder)).await
    }
}

impl UploadFile {
    /// Appends bytes. They are durable only after [`UploadFile::sync`].
    pub async fn append(&mut self, bytes: &[u8]) -> VaultResult<()> {
        self.appended += bytes.len() as u64;
        if self.buffer.add(bytes, Instant::now()) { self.write(false).await } else { Ok(()) }
    }

    /// Syncs everything appended; returns how many bytes the upload now has. This also works after a write that failed
    /// for lack of space: the bytes written before that count.
    pub async fn sync(&mut self) -> VaultResult<u64> {
        self.write(true).await?;
        Ok(self.appended)
    }

    /// Bytes appended so far, durable or not.
    pub fn appended(&self) -> u64 {
        self.appended
    }

    async fn write(&mut self, sync: bool) -> VaultResult<()> {
        let mut open = self.file.take().ok_or(VaultError::NotFound)?;
        let bytes = self.buffer.take();
        let (open, bytes, outcome) = run_blocking(move || {
            let outcome = open.write(&bytes);
            if sync && outcome.is_ok() {
                disk::sync(&open.file, &open.path);
            }
            Ok((open, bytes, outcome))
        })
        .await?;
        self.appended = open.written;
        self.file = Some(open);
        self.buffer.reuse(bytes);
        outcome
    }
}

impl OpenUploadFile {
    /// Appends all bytes or, if the disk is full, none.
    fn write(&mut self, bytes: &[u8]) -> VaultResult<()> {
        if !self.is_cut_off {
            self.cut_off()?;
        }
        let written = disk::write(&self.file, bytes, &self.path);
        match &written {
            Ok(()) => self.written += bytes.len() as u64,
            Err(_) => self.cut_off()?,
        }
        written
    }

    /// Cuts off everything after the bytes that count.
    fn cut_off(&mut self) -> VaultResult<()> {
        self.file.set_len(self.written).map_err(failed("cutting", &self.path))?;
        self.file.seek(SeekFrom::Start(self.written)).map_err(failed("cutting", &self.path))?;
        self.is_cut_off = true;
        Ok(())
    }
}

impl OpenUploads {
    fn claim(&self, id: UploadId) -> VaultResult<UploadClaim> {
        let mut open = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if !open.insert(id) {
            return Err(VaultError::InUse("the upload".to_owned()));
        }
        Ok(UploadClaim { id, open: self.clone() })
    }
}

impl Drop for UploadClaim {
    fn drop(&mut self) {
        self.open.0.lock().unwrap_or_else(PoisonError::into_inner).remove(&self.id);
    }
}

/// The path of an upload's file.
pub(super) fn path(data: &Path, id: UploadId) -> PathBuf {
    data.join("uploads").join(id.to_string())
}
