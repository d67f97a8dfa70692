//! Lists of erasures beside the data and beside the backups. A backup that is restored later must not bring erased
//! people back, so the list has to outlive the data folder.
//!
//! The database holds all erasures of the installation ([`Store::erasures`]); the lists follow it.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use super::{Attempts, UpkeepError, UpkeepResult};
use crate::domain::erasure::{ErasedKind, Erasure};
use crate::ids::InstallationId;
use crate::store::Store;
use crate::time::to_rfc3339;

mod file;

pub(super) use file::{KnownUntil, ListContent, ListEnd, ListLine, append};
use file::{ListMark, list_error};

/// File name of a list.
pub const ERASURE_LIST: &str = "erasures";
/// Longest time between two marks of a list that is kept, ms. Shorter: the list grows faster. Longer: a restore has to
/// accept older lists ([`super::restore()`]).
const MARK_INTERVAL_MS: i64 = 6 * 3_600_000;
/// Erasures per query.
const ROUND: u32 = 1_000;

/// The lists that a running service keeps.
#[derive(Debug)]
pub struct ErasureLists {
    lists: Vec<ErasureList>,
    /// The folder of backups, as the database notes it.
    backups: Option<String>,
    /// True once the list of an earlier folder of backups has ended, if there was one.
    is_folder_noted: bool,
    state: ErasureListState,
}

/// Whether the lists are complete; clones share it.
#[derive(Clone, Debug, Default)]
pub struct ErasureListState(Arc<Mutex<Option<String>>>);

impl ErasureListState {
    /// Why a list is not complete; `None` if all are.
    pub fn error(&self) -> Option<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone() // whole at every moment
    }

    /// Notes and logs a change.
    fn note(&self, error: Option<String>) {
        let earlier = std::mem::replace(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner), error.clone());
        match error {
            Some(error) if earlier.as_ref() != Some(&error) => tracing::error!(
                %error,
                "erasures are not listed: a backup restored with this list would bring back people who are erased from \
                 now on; correct the cause, the service tries again with each round of upkeep"
            ),
            None if earlier.is_some() => tracing::info!("all erasures are listed again"),
            _ => {}
        }
    }
}

/// One list.
#[derive(Debug)]
struct ErasureList {
    path: PathBuf,
    /// Its state after this service wrote or read it; `None` if it must be read.
    seen: Option<SeenList>,
}

/// A list that holds all erasures.
#[derive(Debug)]
struct SeenList {
    /// Number of the last erasure.
    last: i64,
    /// Time of its last mark, epoch ms.
    marked_ms: i64,
    /// Length and time of the last change: another program may have changed or deleted the file.
    stamp: (u64, SystemTime),
}

impl ErasureLists {
    /// The list in the data folder, and the one in the folder of backups, if there is one.
    pub fn new(data: &Path, backups: Option<&Path>, state: ErasureListState) -> Self {
        let folders = [Some(data), backups].into_iter().flatten();
        Self {
            lists: folders.map(ErasureList::in_folder).collect(),
            backups: backups.map(|folder| folder.display().to_string()),
            is_folder_noted: false,
            state,
        }
    }

    /// Updates the lists, and notes a failure in their state.
    pub async fn keep(&mut self, store: &Store, now_ms: i64) {
        let updated = self.update(store, now_ms).await;
        self.state.note(updated.err().map(|error| error.to_string()));
    }

    /// Appends the erasures that the lists lack, and marks that say so; durable when this returns. A damaged list is
    /// written anew from the database if that holds all its erasures. The database gets those that only the list in the
    /// data folder has.
    ///
    /// # Errors
    /// The first failure. The other lists are written all the same.
    pub async fn update(&mut self, store: &Store, now_ms: i64) -> UpkeepResult<()> {
        let own = store.installation().id().await?;
        let mut attempts = Attempts::default();
        if let Some(data) = self.lists.first().filter(|data| data.seen.is_none()) {
            attempts.note(data.add_to_database(store).await);
        }
        attempts.note(self.note_folder(store, own, now_ms).await);
        for list in &mut self.lists {
            attempts.note(list.update(store, own, now_ms).await);
        }
        attempts.finish(())
    }

    /// Notes the folder of backups in the database. If it is another one than before, the list there ends.
    async fn note_folder(&mut self, store: &Store, own: InstallationId, now_ms: i64) -> UpkeepResult<()> {
        if self.is_folder_noted {
            return Ok(());
        }
        let earlier = store.installation().backup_folder().await?;
        if earlier != self.backups {
            if let Some(earlier) = earlier {
                self.end_list_in(&earlier, store, own, now_ms).await;
            }
            store.installation().set_backup_folder(self.backups.clone()).await?; // last: a crash repeats the end
        }
        self.is_folder_noted = true;
        Ok(())
    }

    /// Ends the list in an earlier folder of backups, if that is possible.
    async fn end_list_in(&self, earlier: &str, store: &Store, own: InstallationId, now_ms: i64) {
        let end = ListEnd { continued_in: self.backups.clone() };
        match ErasureList::in_folder(Path::new(earlier)).end(store, own, now_ms, end).await {
            Ok(()) => tracing::info!(folder = earlier, "folder of backups changed; list of erasures there ended"),
            Err(error) => tracing::warn!(
                %error,
                "folder of backups changed, but the list of erasures in the earlier one was not ended: it says until \
                 when it is complete"
            ),
        }
    }
}

impl ErasureList {
    fn in_folder(folder: &Path) -> Self {
        Self { path: folder.join(ERASURE_LIST), seen: None }
    }

    /// Adds the erasures of the list that the database lacks: an earlier version that restored a backup did not. A
    /// damaged list adds none.
    async fn add_to_database(&self, store: &Store) -> UpkeepResult<()> {
        let content = ListContent::read(&self.path)?;
        if content.damaged.is_some() {
            return Ok(());
        }
        let finals: Vec<Erasure> = content.erasures().filter(|erasure| erasure.is_final()).cloned().collect();
        let recorded: Vec<Erasure> = erasures_after(store, 0).await?.into_iter().map(|(_, erasure)| erasure).collect();
        let unknown: Vec<Erasure> = lacking(&finals, recorded.iter()).collect();
        if unknown.is_empty() { Ok(()) } else { Ok(store.erasures().add(unknown).await?) }
    }

    async fn update(&mut self, store: &Store, own: InstallationId, now_ms: i64) -> UpkeepResult<()> {
        let is_new = |marked_ms: i64| (0..MARK_INTERVAL_MS).contains(&(now_ms - marked_ms));
        let (last, stamp) = (store.erasures().last().await?, stamp_of(&self.path).ok());
        let is_seen = |seen: &SeenList| seen.last == last && Some(seen.stamp) == stamp && is_new(seen.marked_ms);
        if self.seen.as_ref().is_some_and(is_seen) {
            return Ok(());
        }
        self.seen = None;
        let recorded = erasures_after(store, 0).await?;
        let last = recorded.last().map_or(0, |(number, _)| *number);
        let recorded: Vec<Erasure> = recorded.into_iter().map(|(_, erasure)| erasure).collect();
        let content = self.read_or_repair(&recorded, now_ms)?;
        let mut new: Vec<ListLine> = unlisted(&recorded, &content).into_iter().map(ListLine::Erasure).collect();
        let mark = content.marks().get(&own).filter(|mark| mark.end.is_none()).map(|mark| mark.at_ms);
        let recent = mark.filter(|at_ms| new.is_empty() && is_new(*at_ms));
        if recent.is_none() {
            new.push(ListLine::Mark(ListMark { installation: own, at_ms: now_ms, end: None }));
            append(&self.path, &new)?;
        }
        self.seen = Some(SeenList { last, marked_ms: recent.unwrap_or(now_ms), stamp: stamp_of(&self.path)? });
        Ok(())
    }

    /// Completes the list and ends it.
    async fn end(
        &mut self,
        store: &Store,
        installation: InstallationId,
        now_ms: i64,
        end: ListEnd,
    ) -> UpkeepResult<()> {
        stamp_of(&self.path)?; // no list is begun
        self.update(store, installation, now_ms).await?;
        append(&self.path, &[ListLine::Mark(ListMark { installation, at_ms: now_ms, end: Some(end) })])
    }

    /// The content. A damaged list is put aside if the database holds all erasures that can still be read; the content
    /// is empty then.
    fn read_or_repair(&self, recorded: &[Erasure], now_ms: i64) -> UpkeepResult<ListContent> {
        let content = ListContent::read(&self.path)?;
        let Some(line) = content.damaged else { return Ok(content) };
        let listed: Vec<Erasure> = content.erasures().filter(|erasure| erasure.is_final()).cloned().collect();
        if lacking(&listed, recorded.iter()).next().is_some() {
            return Err(UpkeepError::List {
                path: self.path.clone(),
                why: format!(
                    "line {line} is damaged, and the list has erasures that the database lacks, so the service cannot \
                     write it anew: correct the line (kind, id and time; another copy of the list may have it), or \
                     delete it"
                ),
            });
        }
        let aside =
            self.path.with_file_name(format!("{ERASURE_LIST}.damaged-{}", to_rfc3339(now_ms).replace(':', "-")));
        fs::rename(&self.path, &aside).map_err(list_error(&self.path))?;
        tracing::warn!(
            list = %self.path.display(), line, kept = %aside.display(),
            "list of erasures was damaged; it was put aside and is written anew from the database"
        );
        Ok(ListContent::default())
    }
}

/// Length and time of the last change.
fn stamp_of(path: &Path) -> UpkeepResult<(u64, SystemTime)> {
    let read = || {
        let found = fs::metadata(path)?;
        Ok((found.len(), found.modified()?))
    };
    read().map_err(list_error(path))
}

/// The erasures that others lack, without repetitions.
pub(super) fn lacking<'a>(
    erasures: &'a [Erasure],
    others: impl Iterator<Item = &'a Erasure>,
) -> impl Iterator<Item = Erasure> {
    let mut known: HashSet<String> = others.map(Erasure::key).collect();
    erasures.iter().filter(move |erasure| known.insert(erasure.key())).cloned()
}

/// The erasures that a list lacks, without repetitions. A session that is listed with an earlier time than it was erased is
/// listed again: that entry may be refuted ([`super::restore()`]).
fn unlisted(erasures: &[Erasure], list: &ListContent) -> Vec<Erasure> {
    let mut listed: HashMap<String, i64> = HashMap::new();
    for erasure in list.erasures() {
        let latest_ms = listed.entry(erasure.key()).or_insert(erasure.at_ms);
        *latest_ms = erasure.at_ms.max(*latest_ms);
    }
    let mut is_unlisted = |erasure: &&Erasure| {
        let earlier_ms = listed.get(&erasure.key()).copied();
        let is_new = earlier_ms.is_none_or(|ms| erasure.kind == ErasedKind::Session && ms < erasure.at_ms);
        if is_new {
            listed.insert(erasure.key(), erasure.at_ms);
        }
        is_new
    };
    erasures.iter().filter(|erasure| is_unlisted(erasure)).cloned().collect()
}

/// All erasures after this number, with their numbers.
pub(super) async fn erasures_after(store: &Store, number: i64) -> UpkeepResult<Vec<(i64, Erasure)>> {
    let mut found: Vec<(i64, Erasure)> = Vec::new();
    loop {
        let last = found.last().map_or(number, |(number, _)| *number);
        let more = store.erasures().after(last, ROUND).await?;
        if more.is_empty() {
            return Ok(found);
        }
        found.extend(more);
    }
}
