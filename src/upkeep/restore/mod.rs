//! Restores a backup into a new data folder, and erases again what was erased since the backup.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use tokio::fs::{File, OpenOptions};

use super::backup::{copy_blobs, unless_stopped, verify_copy};
use super::erasure_list::{ERASURE_LIST, KnownUntil, ListContent, ListEnd, append, erasures_after, lacking};
use super::unfinished_folder::{BackupMark, UnfinishedFolder, folder_error, installation_of, refuse_used};
use super::{LostFile, UpkeepError, UpkeepResult, is_readable, recover};
use crate::domain::blob::BlobHash;
use crate::domain::erasure::{ErasedKind, Erasure};
use crate::shutdown::Shutdown;
use crate::store::{SchemaState, Store, StoreError, StoreSettings};
use crate::time::{SharedClock, to_rfc3339};
use crate::vault::{FileLoss, Vault};

/// Age of a list that is taken for complete without a question, ms: the service marks a list every few hours, so a service
/// that ran within the last day has marked it since.
const MAX_LIST_AGE_MS: i64 = 86_400_000;

/// The list of erasures that a restore uses.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ErasureListChoice {
    /// Its file; `None` for the one beside the backup.
    pub file: Option<PathBuf>,
    /// Until when it has to be complete, epoch ms; `None`: it must be one that the service still keeps, and at most a day
    /// old.
    pub until_ms: Option<i64>,
}

/// What a restored folder holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Restored {
    /// Number of files, all verified.
    pub files: u64,
    /// The files that the backup lacks, or that are damaged in it.
    pub missing: Vec<LostFile>,
    /// Number of people and recordings that were erased again.
    pub erased_again: usize,
    /// Until when the erasures are known, epoch ms; `None` without a list.
    pub known_until_ms: Option<i64>,
    /// Accounts that could not be deleted again, and why.
    pub kept: Vec<String>,
}

/// Restores `backup` into the folder `to`, which is empty, does not exist yet, or was left by an interrupted restore.
/// `erasures` is the list of erasures since the backup; `None` restores without one. A
/// file that the backup lacks stops nothing. A stop ends it at once.
///
/// # Errors
/// Also [`UpkeepError::Interrupted`]; no file of the backup can be read. What was written into the folder is removed.
pub async fn restore(
    backup: &Path,
    to: &Path,
    erasures: Option<ErasureListChoice>,
    database: &str,
    clock: SharedClock,
    stop: &Shutdown,
) -> UpkeepResult<Restored> {
    refuse_used(to)?;
    if !is_readable(&backup.join(database))? {
        return Err(UpkeepError::NoBackup(backup.to_owned()));
    }
    if BackupMark::read(backup)? == Some(BackupMark::Unfinished) {
        return Err(UpkeepError::UnfinishedBackup(backup.to_owned()));
    }
    let list = erasures.map(|choice| chosen_list(backup, choice, clock.now_ms())).transpose()?;
    let folder = UnfinishedFolder::begin(to, None).await?;
    let restored = match restore_into(to, backup, list, database, clock, stop).await {
        Ok(restored) => folder.unmark().map(|()| restored),
        failed => failed,
    };
    folder.end(restored, stop)
}

/// Writes the database and its files into the folder, without what the list names.
async fn restore_into(
    to: &Path,
    backup: &Path,
    list: Option<(ListContent, i64)>,
    database: &str,
    clock: SharedClock,
    stop: &Shutdown,
) -> UpkeepResult<Restored> {
    let (from, files) = (Vault::open_existing(backup), Vault::open(to).await?);
    let path = to.join(database);
    let copying = async { copy_private(&backup.join(database), &path).await.map_err(folder_error(to)) };
    unless_stopped(stop, copying).await?;
    if Store::found_schema(&path, &StoreSettings::default()).await? == SchemaState::Empty {
        return Err(UpkeepError::NoBackup(backup.to_owned()));
    }
    let store = Store::open(&path, &StoreSettings::default(), clock).await?;
    let lost = copy_blobs(&store, &from, &files, stop).await?;
    refuse_unreadable(backup, &lost, store.blobs().total().await?.0)?;
    let (missing, kept) = (Vec::new(), Vec::new());
    let mut restored = Restored { files: 0, missing, erased_again: 0, known_until_ms: None, kept };
    if let Some((list, known_until_ms)) = list {
        let erasures: Vec<Erasure> = list.erasures().cloned().collect();
        erase_again(&store, &erasures, &mut restored).await?;
        append(&to.join(ERASURE_LIST), &list.lines)?;
        restored.known_until_ms = Some(known_until_ms);
    }
    store.installation().set_backup_folder(None).await?; // the list there may still be kept by the original
    recover(&store, &files).await?; // removes the files of what was erased
    store.purge_erased().await?;
    restored.missing = verify_copy(&store, &files, &lost, stop).await?;
    let (wanted, _) = store.blobs().total().await?;
    restored.files = wanted - restored.missing.len() as u64;
    store.close().await;
    Ok(restored)
}

/// Refuses a backup if no file of it could be copied and the system cannot read some of them: the disk fails, or the
/// files belong to another user.
fn refuse_unreadable(backup: &Path, lost: &HashMap<BlobHash, FileLoss>, all: u64) -> UpkeepResult<()> {
    let reason = lost.values().find_map(|loss| match loss {
        FileLoss::Unreadable(why) => Some(why),
        FileLoss::Missing | FileLoss::Damaged => None,
    });
    let Some(reason) = reason.filter(|_| lost.len() as u64 == all) else { return Ok(()) };
    let why = format!(
        "none of its {all} files could be read ({reason}): check its disk, and whether this user may read its files. \
         If they are lost, delete them from a copy of the backup and restore that: the restore names them"
    );
    Err(UpkeepError::Unreadable { path: backup.to_owned(), why })
}

/// Reads the list of erasures, and until when it is complete.
///
/// # Errors
/// There is no such list, it is damaged, or it may lack erasures.
fn chosen_list(backup: &Path, choice: ErasureListChoice, now_ms: i64) -> UpkeepResult<(ListContent, i64)> {
    let path = choice.file.unwrap_or_else(|| backup.parent().unwrap_or(backup).join(ERASURE_LIST));
    if !is_readable(&path)? {
        return Err(UpkeepError::NoList(path));
    }
    let list = ListContent::read(&path)?;
    if let Some(line) = list.damaged {
        let why = format!(
            "line {line} is damaged: name another copy with --erasures (one is in the data folder), or correct the line \
             (kind, id and time)"
        );
        return Err(UpkeepError::List { path, why });
    }
    let Some(known) = list.known_until(installation_of(backup)?) else { return Err(UpkeepError::ForeignList(path)) };
    let is_enough = match choice.until_ms {
        Some(until_ms) => known.at_ms >= until_ms,
        None => known.end.is_none() && now_ms - known.at_ms <= MAX_LIST_AGE_MS,
    };
    if is_enough { Ok((list, known.at_ms)) } else { Err(short_list(path, known)) }
}

/// The refusal of a list that may lack erasures.
fn short_list(path: PathBuf, KnownUntil { at_ms, end }: KnownUntil) -> UpkeepError {
    let why = match end {
        None => "and the service has not updated it since".to_owned(),
        Some(ListEnd { continued_in: None }) => "when the settings no longer named this folder for backups".to_owned(),
        Some(ListEnd { continued_in: Some(folder) }) => {
            format!("when the service continued it in `{}`", Path::new(&folder).join(ERASURE_LIST).display())
        }
    };
    UpkeepError::ShortList { path, until: to_rfc3339(at_ms), why }
}

/// Erases what a list names, and adds to the database the erasures of what it does not hold: the database then has all
/// erasures of the list.
async fn erase_again(store: &Store, erasures: &[Erasure], restored: &mut Restored) -> UpkeepResult<()> {
    let last: Vec<Erasure> = last_requests(erasures).into_iter().cloned().collect();
    let (requested, last): (Vec<_>, Vec<_>) = last.into_iter().partition(|one| one.kind == ErasedKind::Pending);
    // Accounts last: those of trainees are deleted with them.
    let (people, others): (Vec<_>, Vec<_>) = last.into_iter().partition(|erasure| erasure.kind == ErasedKind::Person);
    let mut repeated = Vec::new();
    for erasure in others.into_iter().chain(people) {
        match store.erasures().repeat(&erasure).await {
            Ok(existed) => {
                restored.erased_again += usize::from(existed);
                repeated.push(erasure);
            }
            Err(StoreError::Refused { why }) => restored.kept.push(format!("{} {}: {why}", erasure.kind, erasure.id)),
            Err(error) => return Err(error.into()),
        }
    }
    for erasure in &requested {
        match store.erasures().wait_again(erasure, &requested).await {
            Ok(()) => repeated.push(erasure.clone()),
            Err(StoreError::Refused { why }) => restored.kept.push(format!("{} {}: {why}", erasure.kind, erasure.id)),
            Err(error) => return Err(error.into()),
        }
    }
    let recorded: Vec<Erasure> = erasures_after(store, 0).await?.into_iter().map(|(_, erasure)| erasure).collect();
    let unknown = lacking(&repeated, recorded.iter()).collect();
    Ok(store.erasures().add(unknown).await?)
}

/// Copies a file. Only its owner may read the copy, even if others may read the original.
async fn copy_private(from: &Path, to: &Path) -> std::io::Result<()> {
    let mut original = File::open(from).await?;
    let mut copy = OpenOptions::new().write(true).create_new(true).mode(0o600).open(to).await?;
    tokio::io::copy(&mut original, &mut copy).await?;
    copy.sync_all().await
}

/// The entries of a list without the requests that a later one of the same trainee replaces: only the last says whether the
/// trainee waits for an erasure.
fn last_requests(erasures: &[Erasure]) -> Vec<&Erasure> {
    let is_request = |erasure: &Erasure| matches!(erasure.kind, ErasedKind::Pending | ErasedKind::TakenBack);
    let is_replaced = |number: usize, erasure: &Erasure| {
        erasures[number + 1..].iter().any(|later| is_request(later) && later.id == erasure.id)
    };
    let entries = erasures.iter().enumerate();
    entries
        .filter(|(number, entry)| !is_request(entry) || !is_replaced(*number, entry))
        .map(|(_, entry)| entry)
        .collect()
}

#[cfg(test)]
mod tests;
