//! Restores a backup into a new data folder, and erases again what was erased since the backup.

use std::path::{Path, PathBuf};

use tokio::fs::{File, OpenOptions};

use super::backup::{copy_blobs, folder_error, installation_of, mark, refuse_used, unmark};
use super::erasure_list::{ERASURE_LIST, KnownUntil, ListContent, ListEnd, append, erasures_after, lacking};
use super::{Finding, UpkeepError, UpkeepResult, check, is_readable, recover};
use crate::domain::erasure::{ErasedKind, Erasure};
use crate::store::{SchemaState, Store, StoreError, StoreSettings};
use crate::time::{SharedClock, to_rfc3339};
use crate::vault::Vault;

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
    /// Number of files.
    pub files: u64,
    /// Number of people and recordings that were erased again.
    pub erased_again: usize,
    /// Until when the erasures are known, epoch ms; `None` without a list.
    pub known_until_ms: Option<i64>,
    /// Accounts that could not be deleted again, and why.
    pub kept: Vec<String>,
}

/// Restores `backup` into the folder `to`, which is empty or does not exist yet. `erasures` is the list of erasures since
/// the backup; `None` restores without one.
pub async fn restore(
    backup: &Path,
    to: &Path,
    erasures: Option<ErasureListChoice>,
    database: &str,
    clock: SharedClock,
) -> UpkeepResult<Restored> {
    refuse_used(to)?;
    if !is_readable(&backup.join(database))? {
        return Err(UpkeepError::NoBackup(backup.to_owned()));
    }
    let list = erasures.map(|choice| chosen_list(backup, choice, clock.now_ms())).transpose()?;
    let (from, files) = (Vault::open_existing(backup), Vault::open(to).await?);
    let path = to.join(database);
    mark(to, "This folder is being restored. If that was interrupted, delete it and restore again.\n")?;
    copy_private(&backup.join(database), &path).await.map_err(folder_error(to))?;
    if Store::found_schema(&path, &StoreSettings::default()).await? == SchemaState::Empty {
        return Err(UpkeepError::NoBackup(backup.to_owned()));
    }
    let store = Store::open(&path, &StoreSettings::default(), clock).await?;
    let copied = copy_blobs(&store, &from, &files).await?;
    if let Some(hash) = copied.missing {
        return Err(UpkeepError::Unsound(Finding::MissingFile(hash)));
    }
    let mut restored = Restored { files: 0, erased_again: 0, known_until_ms: None, kept: Vec::new() };
    if let Some((list, known_until_ms)) = list {
        let erasures: Vec<Erasure> = list.erasures().cloned().collect();
        erase_again(&store, &erasures, &mut restored).await?;
        append(&to.join(ERASURE_LIST), &list.lines)?;
        restored.known_until_ms = Some(known_until_ms);
    }
    store.installation().set_backup_folder(None).await?; // the list there may still be kept by the original
    recover(&store, &files).await?; // removes the files of what was erased
    store.purge_erased().await?;
    if let Some(finding) = check(&store, &files, true).await?.first() {
        return Err(UpkeepError::Unsound(finding.clone()));
    }
    (restored.files, _) = store.blobs().total().await?;
    store.close().await;
    unmark(to)?;
    Ok(restored)
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
    let Some(known) = list.known_until(installation_of(backup)) else { return Err(UpkeepError::ForeignList(path)) };
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
