//! Backup: a copy of database and files, made while the service runs.
//!
//! A backup is a data folder with a mark: the service does not run on it, and [`restore`](super::restore()) makes a data
//! folder of it. Every blob is verified while it is copied, and the finished backup is checked. A blob that cannot be
//! read stops no backup: the mark names it and what refers to it. Unfinished uploads and feeds are left out, since their
//! senders continue with the original, and so are signed-in browsers.

use std::collections::HashMap;
use std::future::Future;
use std::path::Path;

use super::check::check_until;
use super::collect::collect;
use super::unfinished_folder::UnfinishedFolder;
use super::{Finding, LostFile, UpkeepError, UpkeepResult, delete_orphans};
use crate::domain::blob::BlobHash;
use crate::domain::scope::Scope;
use crate::shutdown::Shutdown;
use crate::store::{Store, StoreSettings};
use crate::time::SharedClock;
use crate::vault::{FileLoss, Vault};

/// Maximum number of database snapshots until all files of one could be copied. Another snapshot is needed only if a
/// recording is erased between the snapshot and the copying of its file. Each later round copies only files that are
/// new since the one before, so failing this often takes as many erasures, each within milliseconds.
const MAX_SNAPSHOTS: u32 = 100;
/// Rows to read per query.
const ROUND: u32 = 1_000;

/// A backup that was made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BackupReport {
    /// Number of files in it, all verified.
    pub files: u64,
    /// The files that it lacks, because they are lost in the original.
    pub missing: Vec<LostFile>,
}

/// Copies everything into a folder that is empty, does not exist yet, or was left by an interrupted backup; `database`
/// is the file name of the database. A stop ends it at once.
///
/// # Errors
/// Also [`UpkeepError::Interrupted`]. What was written into the folder is removed.
pub async fn back_up(
    (store, vault): (&Store, &Vault),
    to: &Path,
    database: &str,
    clock: SharedClock,
    stop: &Shutdown,
) -> UpkeepResult<BackupReport> {
    let folder = UnfinishedFolder::begin(to, Some(store.installation().id().await?)).await?;
    let made = match copy_all((store, vault), (to, database), clock, stop).await {
        Ok(report) => folder.mark_as_backup(&report.missing).map(|()| report),
        failed => failed,
    };
    let report = folder.end(made, stop)?;
    if let Err(error) = store.audit().record_backup(report.files).await {
        tracing::warn!(%error, "backup complete, but not recorded in the audit trail");
    }
    Ok(report)
}

/// Writes the database and its files into the folder.
async fn copy_all(
    (store, vault): (&Store, &Vault),
    (to, database): (&Path, &str),
    clock: SharedClock,
    stop: &Shutdown,
) -> UpkeepResult<BackupReport> {
    let (files, path) = (Vault::open(to).await?, to.join(database));
    // Copies most bytes before the snapshot, so that fewer files can be erased between the snapshot and their copying.
    copy_blobs(store, vault, &files, stop).await?;
    let mut lost_before = HashMap::new();
    for _ in 0..MAX_SNAPSHOTS {
        unless_stopped(stop, store.snapshot(&path)).await?;
        let copy = Store::open(&path, &StoreSettings::default(), clock.clone()).await?;
        let lost = copy_blobs(&copy, vault, &files, stop).await?;
        // Rows are deleted before their files, so the next snapshot has no row of a file that was erased meanwhile. If
        // it still has the row, the file is lost.
        if lost.keys().all(|hash| lost_before.contains_key(hash)) {
            let missing = complete(&copy, &files, &lost, stop).await?;
            let (wanted, _) = copy.blobs().total().await?;
            copy.close().await; // leaves one file without a write-ahead log
            return Ok(BackupReport { files: wanted - missing.len() as u64, missing });
        }
        copy.close().await;
        lost_before = lost;
    }
    Err(UpkeepError::Unsettled)
}

/// Copies the blobs that the database refers to and the folder lacks. Returns those that cannot be read; some of them
/// may have been erased meanwhile.
pub(super) async fn copy_blobs(
    store: &Store,
    from: &Vault,
    to: &Vault,
    stop: &Shutdown,
) -> UpkeepResult<HashMap<BlobHash, FileLoss>> {
    let (mut after, mut lost) = (None, HashMap::new());
    loop {
        let blobs = store.blobs().all(after, ROUND).await?;
        for blob in &blobs {
            if stop.is_begun() {
                return Err(UpkeepError::Interrupted);
            }
            if to.open_blob(blob.hash).await.is_err() {
                lost.extend(from.copy_blob(*blob, to, stop).await?.map(|loss| (blob.hash, loss)));
            }
        }
        after = blobs.last().map(|blob| blob.hash);
        if after.is_none() {
            return Ok(lost);
        }
    }
}

/// Makes the copy a data folder in its own right and verifies it. Returns the lost files that it refers to.
async fn complete(
    copy: &Store,
    files: &Vault,
    lost: &HashMap<BlobHash, FileLoss>,
    stop: &Shutdown,
) -> UpkeepResult<Vec<LostFile>> {
    for upload in copy.uploads().unfinished().await? {
        copy.uploads().delete(&Scope::service(), upload.id).await?;
    }
    copy.feeds().forget_unfinished().await?;
    copy.cookies().forget_all().await?;
    collect(copy, files).await?;
    delete_orphans(copy, files).await?; // files that were erased between copying and snapshot, even if there are many
    copy.purge_erased().await?;
    verify_copy(copy, files, lost, stop).await
}

/// Checks a finished copy. Returns the files that it lacks because they are lost in the original.
///
/// # Errors
/// The check finds anything else.
pub(super) async fn verify_copy(
    copy: &Store,
    files: &Vault,
    lost: &HashMap<BlobHash, FileLoss>,
    stop: &Shutdown,
) -> UpkeepResult<Vec<LostFile>> {
    let mut missing = Vec::new();
    for finding in check_until((copy, files), true, stop).await? {
        match finding {
            Finding::LostFile(LostFile { hash, loss: FileLoss::Missing, uses }) if lost.contains_key(&hash) => {
                missing.push(LostFile { hash, loss: lost[&hash].clone(), uses });
            }
            Finding::LostFile(mut file) => {
                for one in &mut file.uses {
                    one.trainee = None; // the error is logged
                }
                return Err(UpkeepError::Unsound(Finding::LostFile(file)));
            }
            other => return Err(UpkeepError::Unsound(other)),
        }
    }
    Ok(missing)
}

/// Waits for work of the database, but not after a stop: SQLite's thread ends with the process.
pub(super) async fn unless_stopped<T, E: Into<UpkeepError>>(
    stop: &Shutdown,
    work: impl Future<Output = Result<T, E>>,
) -> UpkeepResult<T> {
    tokio::select! {
        biased;
        () = stop.begun() => Err(UpkeepError::Interrupted),
        done = work => done.map_err(Into::into),
    }
}
