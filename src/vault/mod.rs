//! Files, and nothing but files: recordings and results by their content, uploads while they arrive.
//!
//! ```text
//! DATA/lock             held by the one service that uses the folder
//! DATA/incoming/…       blobs being written; whatever is here at a start is rubbish
//! DATA/uploads/ID       uploads being received: appended, synced, then noted in the database
//! DATA/feeds/ID         logs of feeds: appended, synced, then acknowledged
//! DATA/blobs/ab/abcd…   blobs, named by their SHA-256; never changed
//! ```
//!
//! A blob comes into being in this order: bytes written and hashed → `fdatasync` → its name → `fsync` of its folder →
//! (by the caller) the row that refers to it. It goes in the opposite order: row, then file. Between a blob's name and its
//! row a [`Kept`] protects it from the collection of blobs that nothing refers to; one whose row never comes is collected
//! soon after. A failed sync ends the process.
//!
//! | function | does |
//! |---|---|
//! | [`Vault::put`], [`Vault::incoming`] | a new blob from bytes, or piece by piece |
//! | [`Vault::open_blob`], [`Vault::open_range`], [`Vault::read`] | read it: as a file, in part, whole and verified |
//! | [`Vault::delete_if`], [`Vault::released`], [`Vault::blobs`], [`Vault::is_intact`] | collect, list, verify |
//! | [`Vault::create_upload`], [`Vault::open_upload`], [`UploadFile`] | receive a recording in pieces |
//! | [`Vault::keep_upload`], [`Vault::delete_upload`], [`Vault::delete_upload_if`] | make a whole upload a blob; forget one |
//! | [`Vault::open_feed`], [`FeedLog`], [`Vault::read_feed`], [`Vault::delete_feed`] | receive a recording frame by frame |
//! | [`Vault::make_file`], [`Made`] | a file that a child writes, made a blob |
//! | [`Vault::lock`], [`Vault::clear_incoming`] | start-up |

mod blobs;
mod disk;
mod error;
mod feeds;
mod gathered;
mod made;
mod pins;
mod uploads;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub use blobs::{Incoming, Removal};
pub use error::{VaultError, VaultResult};
pub use feeds::{FeedLog, Syncing};
pub use made::Made;
pub use pins::Kept;
pub use uploads::UploadFile;

use disk::on_a_blocking_thread;
use pins::Pins;
use uploads::OpenUploads;

/// The folder of files. Clones are the same vault.
#[derive(Clone, Debug)]
pub struct Vault {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    data: PathBuf,
    pins: Pins,
    open_uploads: OpenUploads,
}

/// Holds the data folder for one service; given back when dropped or when the process ends, however it ends.
#[derive(Debug)]
pub struct Lock {
    _file: File,
}

impl Vault {
    /// Opens the vault in this data folder, made if it is missing.
    pub async fn open(data: &Path) -> VaultResult<Self> {
        let data = data.to_owned();
        on_a_blocking_thread(move || {
            disk::make_folders(&data)?;
            Ok(Self { inner: Arc::new(Inner { data, pins: Pins::default(), open_uploads: OpenUploads::default() }) })
        })
        .await
    }

    /// Takes the data folder for this process alone, or says that another one has it.
    pub async fn lock(&self) -> VaultResult<Lock> {
        let path = self.inner.data.join("lock");
        on_a_blocking_thread(move || disk::lock(&path).map(|file| Lock { _file: file })).await
    }

    /// Removes what an earlier life of the service left half-written; returns how many files that was.
    pub async fn clear_incoming(&self) -> VaultResult<usize> {
        let folder = self.inner.data.join("incoming");
        on_a_blocking_thread(move || {
            let left = disk::list(&folder)?;
            left.iter().try_for_each(|(path, _)| disk::remove(path))?;
            Ok(left.len())
        })
        .await
    }
}

#[cfg(test)]
mod tests;
