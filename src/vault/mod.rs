//! The files of a centre: recordings and results, named by their content, and uploads while they arrive.
//!
//! ```text
//! DATA/lock             held by the one service that uses the folder
//! DATA/incoming/…       blobs being written; files found here at a start are deleted
//! DATA/uploads/ID       uploads being received: appended, synced, then recorded in the database
//! DATA/feeds/ID         logs of feeds: appended, synced, then acknowledged
//! DATA/blobs/ab/abcd…   blobs, named by their SHA-256; never changed
//! ```
//!
//! A blob is created in this order: write and hash the bytes → `fdatasync` → link its name → `fsync` of its folder →
//! (by the caller) write the row that refers to it. It is deleted in the opposite order: row, then file. Until the row
//! is written, a [`PinnedBlob`] protects the blob from the collection of unreferenced blobs; a blob that never gets a
//! row is collected soon after. A failed sync aborts the process.
//!
//! | function | does |
//! |---|---|
//! | [`Vault::put`], [`Vault::incoming`] | create a blob from bytes, or piece by piece |
//! | [`Vault::open_blob`], [`Vault::open_verified`], [`Vault::open_range`], [`Vault::read`] | read a blob: as a file, as a verified file, in part, or whole and verified |
//! | [`Vault::delete_if`], [`Vault::released`], [`Vault::blobs`], [`Vault::verify`], [`Vault::copy_blob`] | collect, list, verify, copy |
//! | [`Vault::create_upload`], [`Vault::open_upload`], [`UploadFile`] | receive a recording in pieces |
//! | [`Vault::keep_upload`], [`Vault::delete_upload`], [`Vault::delete_upload_if`] | make an upload a blob; delete an upload |
//! | [`Vault::open_feed`], [`FeedLog`], [`Vault::read_feed`], [`Vault::delete_feed`] | receive a recording frame by frame |
//! | [`Vault::create_temporary_file`], [`TemporaryFile`] | make a file that a child process writes a blob |
//! | [`Vault::open`], [`Vault::open_existing`], [`Vault::lock`], [`Vault::clear_incoming`] | start-up |

mod blobs;
mod disk;
mod error;
mod feeds;
mod pins;
mod temporary_file;
mod uploads;
mod write_buffer;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub use blobs::{Incoming, Removal};
pub use error::{FileLoss, VaultError, VaultResult};
pub use feeds::{FeedLog, FeedSync};
pub use pins::PinnedBlob;
pub use temporary_file::TemporaryFile;
pub use uploads::UploadFile;

use disk::run_blocking;
use pins::Pins;
use uploads::OpenUploads;

/// The folder of files. Clones share one vault.
#[derive(Clone, Debug)]
pub struct Vault {
    inner: Arc<VaultInner>,
}

#[derive(Debug)]
struct VaultInner {
    data: PathBuf,
    pins: Pins,
    open_uploads: OpenUploads,
}

/// The lock of the data folder for one service. It is released when dropped and when the process ends in any way.
#[derive(Debug)]
pub struct DataFolderLock {
    _file: File,
}

impl Vault {
    /// Opens the vault in this data folder and creates the folder if it is missing.
    pub async fn open(data: &Path) -> VaultResult<Self> {
        let data = data.to_owned();
        run_blocking(move || {
            disk::make_folders(&data)?;
            Ok(Self::open_existing(&data))
        })
        .await
    }

    /// The vault in a data folder that exists; creates and changes nothing.
    pub fn open_existing(data: &Path) -> Self {
        let (data, pins, open_uploads) = (data.to_owned(), Pins::default(), OpenUploads::default());
        Self { inner: Arc::new(VaultInner { data, pins, open_uploads }) }
    }

    /// The data folder.
    pub fn folder(&self) -> &Path {
        &self.inner.data
    }

    /// Locks the data folder for this process; fails if another process has it.
    pub async fn lock(&self) -> VaultResult<DataFolderLock> {
        let path = self.inner.data.join("lock");
        run_blocking(move || disk::lock(&path).map(|file| DataFolderLock { _file: file })).await
    }

    /// Removes the unfinished files that an earlier process left; returns their number.
    pub async fn clear_incoming(&self) -> VaultResult<usize> {
        let folder = self.inner.data.join("incoming");
        run_blocking(move || {
            let left = disk::list(&folder)?;
            left.iter().try_for_each(|(path, _)| disk::remove(path))?;
            Ok(left.len())
        })
        .await
    }
}

#[cfg(test)]
pub(crate) mod tests;
