//! Backup: a copy of database and files, made while the service runs.
//!
//! A backup is a data folder with a mark: the service does not run on it, and [`restore`](super::restore()) makes a data
//! folder of it. Every blob is verified while it is copied, and the finished backup is checked. Unfinished uploads and
//! feeds are left out, since their senders continue with the original, and so are signed-in browsers.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

use tokio::io::AsyncReadExt;

use super::collect::collect;
use super::{Finding, UpkeepError, UpkeepResult, check, delete_orphans};
use crate::domain::blob::{Blob, BlobHash};
use crate::domain::scope::Scope;
use crate::ids::InstallationId;
use crate::store::{Store, StoreSettings};
use crate::time::SharedClock;
use crate::vault::{Vault, VaultError};

/// File that marks a folder as a backup, or as one that is being restored.
pub const BACKUP_MARK: &str = "BACKUP";

/// Beginning of the line of the mark that has the installation's id.
const INSTALLATION: &str = "installation: ";

/// Maximum number of database snapshots until all files of one could be copied. Another snapshot is needed only if a
/// recording is erased between the snapshot and the copying of its file. Each later round copies only files that are
/// new since the one before, so failing this often takes as many erasures, each within milliseconds.
const MAX_SNAPSHOTS: u32 = 100;
/// Rows to read per query.
const ROUND: u32 = 1_000;
/// Bytes to copy at a time.
const COPY_BYTES: usize = 256 * 1024;

/// Copies everything into a folder that is empty or does not exist yet; `database` is the file name of the database.
/// Returns the number of files in the backup.
pub async fn back_up(
    (store, vault): (&Store, &Vault),
    to: &Path,
    database: &str,
    clock: SharedClock,
) -> UpkeepResult<u64> {
    refuse_used(to)?;
    let installation = store.installation().id().await?;
    let files = Vault::open(to).await?;
    let text = "This folder is a backup. `trocar admin restore` makes a data folder of it.";
    mark(to, &format!("{text}\n{INSTALLATION}{installation}\n"))?;
    let path = to.join(database);
    // Copies most bytes before the snapshot, so that fewer files can be erased between the snapshot and their copying.
    copy_blobs(store, vault, &files).await?;
    let mut gone_before = None;
    for _ in 0..MAX_SNAPSHOTS {
        store.snapshot(&path).await?;
        let copy = Store::open(&path, &StoreSettings::default(), clock.clone()).await?;
        let Copied { wanted, missing: gone } = copy_blobs(&copy, vault, &files).await?;
        let Some(hash) = gone else {
            complete(&copy, &files).await?;
            copy.close().await; // leaves one file without a write-ahead log
            if let Err(error) = store.audit().record_backup(wanted).await {
                tracing::warn!(%error, "backup complete, but not recorded in the audit trail");
            }
            return Ok(wanted);
        };
        copy.close().await;
        // Rows are deleted before their files, so the next snapshot has no row of a file that was erased meanwhile. If
        // it still has the row, the file is lost.
        if gone_before.replace(hash) == Some(hash) {
            return Err(UpkeepError::Unsound(Finding::MissingFile(hash)));
        }
    }
    Err(UpkeepError::Unsettled)
}

/// Marks a folder that the service must not run on, before anything else is written: a backup, or a folder that is being
/// restored.
pub(super) fn mark(folder: &Path, text: &str) -> UpkeepResult<()> {
    let written = File::create(folder.join(BACKUP_MARK)).and_then(|mut file| {
        file.write_all(text.as_bytes())?;
        file.sync_all()
    });
    written.and_then(|()| sync(folder)).map_err(folder_error(folder))
}

/// The installation that a backup is of; `None` if its mark does not say so, as in earlier versions.
pub(super) fn installation_of(backup: &Path) -> Option<InstallationId> {
    let mark = std::fs::read_to_string(backup.join(BACKUP_MARK)).ok()?;
    mark.lines().find_map(|line| line.strip_prefix(INSTALLATION))?.parse().ok()
}

/// Removes the mark of a folder that is complete.
pub(super) fn unmark(folder: &Path) -> UpkeepResult<()> {
    std::fs::remove_file(folder.join(BACKUP_MARK)).and_then(|()| sync(folder)).map_err(folder_error(folder))
}

fn sync(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

/// A failure of this folder.
pub(super) fn folder_error(folder: &Path) -> impl Fn(io::Error) -> UpkeepError {
    move |error| UpkeepError::Target { folder: folder.to_owned(), why: error.to_string() }
}

/// Refuses a folder that is not empty.
pub(super) fn refuse_used(to: &Path) -> UpkeepResult<()> {
    let is_used = std::fs::read_dir(to).is_ok_and(|mut entries| entries.next().is_some());
    if is_used { Err(UpkeepError::Used(to.to_owned())) } else { Ok(()) }
}

/// The result of one round of copying.
pub(super) struct Copied {
    /// Number of files that the database refers to.
    pub(super) wanted: u64,
    /// The first of them that is missing from the vault.
    pub(super) missing: Option<BlobHash>,
}

/// Copies the blobs that the database refers to and the folder lacks. Blobs that are erased meanwhile are skipped.
pub(super) async fn copy_blobs(store: &Store, from: &Vault, to: &Vault) -> UpkeepResult<Copied> {
    let (mut after, mut copied) = (None, Copied { wanted: 0, missing: None });
    loop {
        let blobs = store.blobs().all(after, ROUND).await?;
        for blob in &blobs {
            copied.wanted += 1;
            if to.open_blob(blob.hash).await.is_ok() {
                continue;
            }
            match copy_blob(*blob, from, to).await {
                Err(UpkeepError::Vault(VaultError::NotFound)) => copied.missing = copied.missing.or(Some(blob.hash)),
                done => done?,
            }
        }
        after = blobs.last().map(|blob| blob.hash);
        if after.is_none() {
            return Ok(copied);
        }
    }
}

async fn copy_blob(blob: Blob, from: &Vault, to: &Vault) -> UpkeepResult<()> {
    let mut reader = from.open_range(blob.hash, 0, blob.bytes).await?;
    let mut copy = to.incoming(blob.bytes).await?;
    let mut piece = vec![0; COPY_BYTES];
    loop {
        match reader.read(&mut piece).await.map_err(|_| VaultError::Damaged)? {
            0 => break,
            read => copy.write(&piece[..read]).await?,
        }
    }
    let kept = copy.finish().await?;
    if kept.blob() == blob { Ok(()) } else { Err(VaultError::Damaged.into()) }
}

/// Makes the copy a data folder in its own right and verifies it.
async fn complete(copy: &Store, files: &Vault) -> UpkeepResult<()> {
    for upload in copy.uploads().unfinished().await? {
        copy.uploads().delete(&Scope::service(), upload.id).await?;
    }
    copy.feeds().forget_unfinished().await?;
    copy.cookies().forget_all().await?;
    collect(copy, files).await?;
    delete_orphans(copy, files).await?; // files that were erased between copying and snapshot, even if there are many
    copy.purge_erased().await?;
    match check(copy, files, true).await?.first() {
        None => Ok(()),
        Some(finding) => Err(UpkeepError::Unsound(finding.clone())),
    }
}
