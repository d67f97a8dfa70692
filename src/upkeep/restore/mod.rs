//! Restores a backup into a new data folder, and erases again what was erased since the backup.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use tokio::fs::{File, OpenOptions};

use super::backup::{copy_blobs, unless_stopped, verify_copy};
use super::erasure_list::{ERASURE_LIST, KnownUntil, ListContent, ListEnd, ListLine, append, erasures_after, lacking};
use super::unfinished_folder::{BackupMark, UnfinishedFolder, folder_error, installation_of, refuse_used};
use super::{LostFile, UpkeepError, UpkeepResult, is_readable, recover};
use crate::domain::blob::BlobHash;
use crate::domain::erasure::{ErasedKind, Erasure};
use crate::domain::scope::Scope;
use crate::shutdown::Shutdown;
use crate::store::{SchemaState, SessionRecord, Store, StoreError, StoreSettings};
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
    /// The people and recordings that were erased again, and when the list says that they were erased.
    pub erased_again: Vec<String>,
    /// Until when the erasures are known, epoch ms; `None` without a list.
    pub known_until_ms: Option<i64>,
    /// What was not erased again although the list names it, and why.
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
    let (missing, erased_again, kept) = (Vec::new(), Vec::new(), Vec::new());
    let mut restored = Restored { files: 0, missing, erased_again, known_until_ms: None, kept };
    if let Some((mut list, known_until_ms)) = list {
        let erasures: Vec<Erasure> = list.erasures().cloned().collect();
        let refuted = erase_again(&store, &erasures, &mut restored).await?;
        list.lines.retain(|line| !matches!(line, ListLine::Erasure(erasure) if refuted.contains(&erasure.id)));
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
/// erasures of the list, with their times. Returns the ids of sessions that were not
/// erased, although the list names them.
async fn erase_again(store: &Store, erasures: &[Erasure], restored: &mut Restored) -> UpkeepResult<HashSet<String>> {
    let last: Vec<Erasure> = last_entries(erasures).into_iter().cloned().collect();
    let (requested, last): (Vec<_>, Vec<_>) = last.into_iter().partition(|one| one.kind == ErasedKind::Pending);
    // Accounts last: those of trainees are deleted with them.
    let (people, others): (Vec<_>, Vec<_>) = last.into_iter().partition(|erasure| erasure.kind == ErasedKind::Person);
    let (mut repeated, mut refuted) = (Vec::new(), HashSet::new());
    for erasure in others.into_iter().chain(people) {
        let name = name_of(store, &erasure).await?;
        let listed = to_rfc3339(erasure.at_ms);
        if let Some(completed_ms) = store.erasures().completed_later(&erasure).await? {
            restored.kept.push(format!(
                "{name}: the list says that it was erased at {listed}, but its recording was completed after that, at \
                 {}. The backups of earlier versions lead to such an entry if a recording arrived while they were \
                 made. If the session is to be erased, erase it on its page",
                to_rfc3339(completed_ms)
            ));
            refuted.insert(erasure.id);
            continue;
        }
        match store.erasures().repeat(&erasure).await {
            Ok(existed) => {
                restored.erased_again.extend(existed.then(|| format!("{name}, listed as erased at {listed}")));
                repeated.push(erasure);
            }
            Err(StoreError::Refused { why }) => restored.kept.push(format!("{name}: {why}")),
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
    store.erasures().restore_times(repeated.clone()).await?;
    let recorded: Vec<Erasure> = erasures_after(store, 0).await?.into_iter().map(|(_, erasure)| erasure).collect();
    let unknown = lacking(&repeated, recorded.iter()).collect();
    store.erasures().add(unknown).await?;
    Ok(refuted)
}

/// What an erasure is of: kind and id, and of a session that exists its task and time. No person is named: the output
/// of a command may be kept for longer than their data.
async fn name_of(store: &Store, Erasure { kind, id, .. }: &Erasure) -> UpkeepResult<String> {
    let named = format!("{kind} {id}");
    let Some(session) = id.parse().ok().filter(|_| *kind == ErasedKind::Session) else { return Ok(named) };
    match store.sessions().get(&Scope::service(), session).await {
        Ok(SessionRecord { task_code, recorded_at_ms, .. }) => {
            Ok(format!("{named} (task {task_code}, recorded at {})", to_rfc3339(recorded_at_ms)))
        }
        Err(StoreError::NotFound { .. }) => Ok(named),
        Err(error) => Err(error.into()),
    }
}

/// Copies a file. Only its owner may read the copy, even if others may read the original.
async fn copy_private(from: &Path, to: &Path) -> std::io::Result<()> {
    let mut original = File::open(from).await?;
    let mut copy = OpenOptions::new().write(true).create_new(true).mode(0o600).open(to).await?;
    tokio::io::copy(&mut original, &mut copy).await?;
    copy.sync_all().await
}

/// The entries of a list without those that a later one replaces. Of the requests of a trainee, only the last says whether
/// they wait for an erasure. A session may be listed twice: by an entry that was refuted, and when it was erased.
fn last_entries(erasures: &[Erasure]) -> Vec<&Erasure> {
    let is_request = |erasure: &Erasure| matches!(erasure.kind, ErasedKind::Pending | ErasedKind::TakenBack);
    let mut last_requests: HashMap<&str, usize> = HashMap::new();
    let mut latest_ms: HashMap<&str, i64> = HashMap::new();
    for (number, entry) in erasures.iter().enumerate() {
        if is_request(entry) {
            last_requests.insert(&entry.id, number);
        } else {
            latest_ms.entry(&entry.id).and_modify(|at_ms| *at_ms = entry.at_ms.max(*at_ms)).or_insert(entry.at_ms);
        }
    }
    let is_last = |(number, entry): &(usize, &Erasure)| match is_request(entry) {
        true => last_requests.get(entry.id.as_str()) == Some(number),
        false => latest_ms.get(entry.id.as_str()) == Some(&entry.at_ms),
    };
    erasures.iter().enumerate().filter(is_last).map(|(_, entry)| entry).collect()
}

#[cfg(test)]
mod tests;
