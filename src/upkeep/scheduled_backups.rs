//! Scheduled backups: one a day, made at a set time or as soon as the service runs after it. The last ones are kept,
//! and the last one without missing files.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use serde::Deserialize;

use super::unfinished_folder::{installation_of, reason};
use super::{BackupMark, BackupReport, UpkeepError, UpkeepResult, back_up};
use crate::domain::text::Invalid;
use crate::ids::InstallationId;
use crate::shutdown::Shutdown;
use crate::store::Store;
use crate::time::{SharedClock, from_rfc3339, to_rfc3339};
use crate::vault::Vault;

/// Beginning of the name of a complete backup; the time follows.
const PREFIX: &str = "trocar-";
/// Beginning of the name of a backup that is being made.
const PARTIAL_PREFIX: &str = "partial-";
/// Interval between two looks whether a backup is due.
const LOOK_INTERVAL: Duration = Duration::from_secs(60);
/// Pause after a backup that failed.
const RETRY_INTERVAL: Duration = Duration::from_secs(3600);
const DAY_MS: i64 = 86_400_000;

/// When and where backups are made.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BackupSettings {
    /// Folder of the backups, an absolute path on another disk or machine than the data. Without it none are made.
    pub target: Option<PathBuf>,
    /// Time of day in UTC, as `02:30`.
    pub at: TimeOfDay,
    /// How many backups of this installation are kept. Usually 14.
    pub keep: usize,
}

impl Default for BackupSettings {
    fn default() -> Self {
        Self { target: None, at: TimeOfDay { minutes: 150 }, keep: 14 }
    }
}

/// A time of day, to the minute. As text: `02:30`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct TimeOfDay {
    minutes: i64,
}

impl TryFrom<String> for TimeOfDay {
    type Error = Invalid;

    fn try_from(text: String) -> Result<Self, Invalid> {
        let number = |text: &str, most: i64| {
            let is_number = text.len() == 2 && text.bytes().all(|digit| digit.is_ascii_digit());
            text.parse::<i64>().ok().filter(|number| is_number && *number <= most)
        };
        let parts = text.split_once(':').and_then(|(hours, minutes)| Some((number(hours, 23)?, number(minutes, 59)?)));
        let (hours, minutes) = parts.ok_or_else(|| Invalid::new("time of day", "expected a time such as 02:30"))?;
        Ok(Self { minutes: 60 * hours + minutes })
    }
}

impl std::fmt::Display for TimeOfDay {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:02}:{:02}", self.minutes / 60, self.minutes % 60)
    }
}

impl TimeOfDay {
    /// The last moment with this time of day that is not after `now_ms`.
    fn last_before(self, now_ms: i64) -> i64 {
        let since_ms = (now_ms - self.minutes * 60_000).rem_euclid(DAY_MS);
        now_ms - since_ms
    }
}

/// The state of the scheduled backups; clones share it.
#[derive(Clone, Debug, Default)]
pub struct BackupState(Arc<Mutex<BackupProgress>>);

/// The newest backup, and the last failure.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BackupProgress {
    /// Time of the newest complete backup of this installation in the folder, epoch ms.
    pub newest_ms: Option<i64>,
    /// Number of backups in the folder that are of another installation, or name none. They are never deleted.
    pub others: usize,
    /// The files that the newest one lacks, each with the sessions and boxes that refer to it, without trainees.
    pub missing: Vec<String>,
    /// Why the last attempt failed; `None` if it succeeded.
    pub error: Option<String>,
}

impl BackupState {
    /// The state at this moment.
    pub fn now(&self) -> BackupProgress {
        self.lock().clone()
    }

    fn lock(&self) -> MutexGuard<'_, BackupProgress> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner) // whole at every moment
    }
}

/// Makes the backups until the service shuts down.
pub async fn run_backups(
    (store, vault): (&Store, &Vault),
    settings: &BackupSettings,
    database: &str,
    (clock, shutdown): (SharedClock, &Shutdown),
    state: &BackupState,
) {
    let Some(target) = &settings.target else { return };
    while !shutdown.is_begun() {
        let until = (clock.clone(), shutdown);
        let made = make_if_due((store, vault), (target, settings), database, until, state).await;
        let pause = match made {
            Ok(()) => LOOK_INTERVAL,
            Err(UpkeepError::Interrupted) => {
                let target = target.display();
                tracing::info!(%target, "scheduled backup interrupted by the stop; the next start makes it");
                return;
            }
            Err(error) => {
                tracing::error!(%error, target = %target.display(), "scheduled backup failed; tried again in an hour");
                state.lock().error = Some(error.to_string());
                RETRY_INTERVAL
            }
        };
        tokio::select! {
            () = shutdown.begun() => {}
            () = clock.sleep(pause) => {}
        }
    }
}

async fn make_if_due(
    (store, vault): (&Store, &Vault),
    (target, settings): (&Path, &BackupSettings),
    database: &str,
    (clock, shutdown): (SharedClock, &Shutdown),
    state: &BackupState,
) -> UpkeepResult<()> {
    let now_ms = clock.now_ms();
    let own = store.installation().id().await?;
    let complete = own_backups(target, own, state)?;
    note_newest(&complete, state)?;
    if complete.last().is_some_and(|(at_ms, _)| *at_ms >= settings.at.last_before(now_ms)) {
        state.lock().error = None; // the folder can be used again, or an old backup was not deleted a while ago
        return Ok(());
    }
    remove_partial(target, own)?;
    let stamp = to_rfc3339(now_ms).replace(':', "-");
    let (partial, made) = (target.join(format!("{PARTIAL_PREFIX}{stamp}")), target.join(format!("{PREFIX}{stamp}")));
    let BackupReport { files, missing } = back_up((store, vault), &partial, database, clock, shutdown).await?;
    let failed = target_error(target);
    fs::rename(&partial, &made).and_then(|()| File::open(target)?.sync_all()).map_err(&failed)?;
    let backup = made.display();
    if missing.is_empty() {
        tracing::info!(files, %backup, "scheduled backup complete");
    } else {
        let missing = missing.len();
        tracing::error!(files, missing, %backup, "scheduled backup lacks files; its file BACKUP names them");
    }
    state.lock().error = None;
    let complete = own_backups(target, own, state)?;
    note_newest(&complete, state)?;
    for old in surplus(&complete, settings.keep) {
        fs::remove_dir_all(old).map_err(&failed)?;
    }
    Ok(())
}

/// The complete backups of this installation, as [`complete_backups`]. Notes the others: the disk of the data may be
/// missing, or two services may have the same folder.
fn own_backups(target: &Path, own: InstallationId, state: &BackupState) -> UpkeepResult<Vec<(i64, PathBuf)>> {
    let is_own = |(_, path): &(i64, PathBuf)| installation_of(path).is_ok_and(|of| of == Some(own));
    let (complete, others): (Vec<_>, Vec<_>) = complete_backups(target)?.into_iter().partition(is_own);
    let known = std::mem::replace(&mut state.lock().others, others.len());
    if !others.is_empty() && known != others.len() {
        let others: Vec<String> = others.iter().map(|(_, path)| path.display().to_string()).collect();
        tracing::warn!(
            others = others.join(", "),
            "these backups are of another installation or of an earlier version; the service never deletes them; if \
             they should be its own, check whether it runs on the right data folder"
        );
    }
    Ok(complete)
}

/// Notes the newest backup in the state, with the files that it lacks.
fn note_newest(complete: &[(i64, PathBuf)], state: &BackupState) -> UpkeepResult<()> {
    let newest = complete.last();
    let newest_ms = newest.map(|(at_ms, _)| *at_ms);
    if state.lock().newest_ms == newest_ms {
        return Ok(());
    }
    let missing = newest.map_or(Ok(Vec::new()), |(_, path)| missing_in(path))?;
    let missing = missing.iter().map(|file| without_trainees(file)).collect();
    let mut progress = state.lock();
    (progress.newest_ms, progress.missing) = (newest_ms, missing);
    Ok(())
}

/// The text of a [`LostFile`](super::LostFile) without the codes of trainees, who may have been erased since the
/// backup.
fn without_trainees(file: &str) -> String {
    let mut parts = file.split("(trainee ");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |text, part| text + "(" + part.split_once(", ").map_or(part, |(_code, rest)| rest))
}

/// The backups to delete so that the last `keep` stay, and the last one that lacks no file.
fn surplus(complete: &[(i64, PathBuf)], keep: usize) -> Vec<&Path> {
    let lacks_nothing = |(_, path): &(i64, PathBuf)| missing_in(path).is_ok_and(|missing| missing.is_empty());
    let last = complete.iter().rposition(lacks_nothing);
    let old = complete.iter().take(complete.len().saturating_sub(keep)).enumerate();
    old.filter(|(number, _)| Some(*number) != last).map(|(_, (_, path))| path.as_path()).collect()
}

/// The files that a finished backup lacks, each with what refers to it.
fn missing_in(backup: &Path) -> UpkeepResult<Vec<String>> {
    match BackupMark::read(backup)? {
        Some(BackupMark::Backup { missing }) => Ok(missing),
        Some(BackupMark::Unfinished) | None => Ok(Vec::new()),
    }
}

/// The finished backups in a folder, oldest first: time in epoch ms, and path. Some of them may lack files.
pub fn complete_backups(target: &Path) -> UpkeepResult<Vec<(i64, PathBuf)>> {
    let mut found: Vec<(i64, PathBuf)> = entries(target)?
        .into_iter()
        .filter_map(|path| {
            let stamp = path.file_name()?.to_str()?.strip_prefix(PREFIX)?;
            let (day, time) = stamp.split_once('T')?;
            Some((from_rfc3339(&format!("{day}T{}", time.replace('-', ":")))?, path))
        })
        .collect();
    found.sort();
    Ok(found)
}

/// Removes what an interrupted backup left, but no backup that another installation is making.
///
/// # Errors
/// Also if the mark of one cannot be read: it may be of another installation.
fn remove_partial(target: &Path, own: InstallationId) -> UpkeepResult<()> {
    let is_partial = |path: &PathBuf| {
        path.file_name().and_then(|name| name.to_str()).is_some_and(|name| name.starts_with(PARTIAL_PREFIX))
    };
    for path in entries(target)?.into_iter().filter(is_partial) {
        if installation_of(&path)?.is_none_or(|of| of == own) {
            fs::remove_dir_all(path).map_err(target_error(target))?;
        }
    }
    Ok(())
}

fn entries(target: &Path) -> UpkeepResult<Vec<PathBuf>> {
    let listed = fs::read_dir(target).and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect());
    listed.map_err(target_error(target))
}

fn target_error(target: &Path) -> impl Fn(io::Error) -> UpkeepError {
    let folder = target.to_owned();
    move |error| UpkeepError::Target { why: reason(&folder, &error), folder: folder.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_state_names_no_trainee_of_a_lost_file() {
        let of =
            |trainee: &str| format!("path of session 1 ({trainee}task t, box b); path of session 2 ({trainee}task t)");
        assert_eq!(without_trainees(&of("trainee ada-novak, ")), of(""));
        let of_box = "missing file x: file of a palette job (box b)";
        assert_eq!(without_trainees(of_box), of_box);
    }

    #[test]
    fn a_backup_is_due_from_its_time_of_day_on() {
        let at = TimeOfDay::try_from("02:30".to_owned()).unwrap();
        let ms = |text: &str| from_rfc3339(text).unwrap();
        for (now, due) in [
            ("2026-11-28T02:30:00Z", "2026-11-28T02:30:00Z"),
            ("2026-11-28T02:29:59Z", "2026-11-27T02:30:00Z"),
            ("2026-11-28T23:59:59Z", "2026-11-28T02:30:00Z"),
        ] {
            assert_eq!(at.last_before(ms(now)), ms(due), "{now}");
        }
        assert_eq!(at.to_string(), "02:30");
        for wrong in ["2:30", "24:00", "02:60", "0230", "", "-1:00", "+2:30"] {
            assert!(TimeOfDay::try_from(wrong.to_owned()).is_err(), "{wrong}");
        }
    }
}
