//! A folder while a backup or a restored data folder is written into it, and the mark that says what a folder is.
//!
//! The mark is the file [`BACKUP_MARK`]. The service runs on no folder that has one. It is there before anything else
//! is written, says until the end that the folder is not finished, and is then replaced, or removed by a restore. After
//! a failure or a stop the folder is removed; one that a crash left is replaced by the next attempt.

use std::fs::{self, DirBuilder, File};
use std::io::{self, Write};
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};

use super::{LostFile, UpkeepError, UpkeepResult};
use crate::ids::InstallationId;
use crate::shutdown::Shutdown;
use crate::vault::{DataFolderLock, Vault, VaultError};

/// File that marks a folder as a backup, or as one that is not finished.
pub const BACKUP_MARK: &str = "BACKUP";
/// The mark while it is written.
const NEW_MARK: &str = "BACKUP.new";
/// The file of [`Vault::lock`].
const LOCK: &str = "lock";

/// First line of a backup's mark.
const COMPLETE: &str = "This folder is a backup. `trocar admin restore` makes a data folder of it.";
/// First line of the mark of a backup that lacks files.
const WITH_MISSING_FILES: &str =
    "This folder is a backup with missing files. `trocar admin restore` makes a data folder of the others.";
/// Line before the files that a backup lacks, one a line.
const MISSING_HEADING: &str = "These files were lost when the backup was made:";
/// First line of the mark of a folder that is not finished.
const UNFINISHED: &str =
    "This folder is not finished. If no backup or restore is writing it, delete it, or repeat the command.";
/// Beginning of the line that has the id of the installation that a backup is of.
const INSTALLATION: &str = "installation: ";
/// First line of the mark that earlier versions wrote while they restored.
const RESTORING: &str = "This folder is being restored. If that was interrupted, delete it and restore again.";

/// What the mark of a folder says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BackupMark {
    /// A finished backup.
    Backup {
        /// The files that it lacks, each with what refers to it; empty: it is complete.
        missing: Vec<String>,
    },
    /// A backup or a restored folder that is being written, or whose writing was interrupted.
    Unfinished,
}

impl BackupMark {
    /// Reads a folder's mark; `None`: it has none.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn read(folder: &Path) -> UpkeepResult<Option<Self>> {
        let text = match fs::read_to_string(folder.join(BACKUP_MARK)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            text => text.map_err(folder_error(folder))?,
        };
        let mut lines = text.lines();
        Ok(Some(match lines.next() {
            Some(UNFINISHED | RESTORING) => Self::Unfinished,
            Some(WITH_MISSING_FILES) => {
                let missing = lines.skip_while(|line| *line != MISSING_HEADING).skip(1);
                Self::Backup { missing: missing.map(str::to_owned).collect() }
            }
            _ => Self::Backup { missing: Vec::new() },
        }))
    }
}

/// The installation that a backup is of; `None` if it has no mark, or one that does not say so, as in earlier versions.
///
/// # Errors
/// The mark cannot be read.
pub(super) fn installation_of(backup: &Path) -> UpkeepResult<Option<InstallationId>> {
    let mark = match fs::read_to_string(backup.join(BACKUP_MARK)) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        mark => mark.map_err(folder_error(backup))?,
    };
    Ok(mark.lines().find_map(|line| line.strip_prefix(INSTALLATION)?.parse().ok()))
}

/// A folder that is being written. Other commands cannot use it meanwhile.
#[derive(Debug)]
pub(super) struct UnfinishedFolder {
    folder: PathBuf,
    /// Did the folder exist before? Then it stays after a failure, empty: the system's administrator may have made it.
    existed: bool,
    /// The installation that a backup is of; `None` for a restored folder.
    installation: Option<InstallationId>,
    /// `None`: the file system has no locks.
    _lock: Option<DataFolderLock>,
}

impl UnfinishedFolder {
    /// Begins to write a folder that is missing, empty, or left by an interrupted attempt, and marks it.
    ///
    /// # Errors
    /// The folder holds something else, or another command is writing it. Nothing was changed.
    pub(super) async fn begin(folder: &Path, installation: Option<InstallationId>) -> UpkeepResult<Self> {
        refuse_used(folder)?;
        let failed = folder_error(folder);
        let existed = folder.is_dir();
        DirBuilder::new().recursive(true).mode(0o700).create(folder).map_err(&failed)?;
        let lock = match Vault::open_existing(folder).lock().await {
            Err(VaultError::InUse(_)) => {
                let why = "it is in use: another command is writing it, or a service runs on it".to_owned();
                return Err(UpkeepError::Target { folder: folder.to_owned(), why });
            }
            lock => lock.ok(),
        };
        refuse_used(folder)?; // again: another command may have finished meanwhile
        empty(folder, &[LOCK]).map_err(&failed)?;
        let begun = Self { folder: folder.to_owned(), existed, installation, _lock: lock };
        match begun.mark(UNFINISHED, "") {
            Ok(()) => Ok(begun),
            Err(error) => begun.end(Err(error), &Shutdown::new()),
        }
    }

    /// Marks the folder as a finished backup that lacks these files.
    pub(super) fn mark_as_backup(&self, missing: &[LostFile]) -> UpkeepResult<()> {
        if missing.is_empty() {
            self.mark(COMPLETE, "")?;
        } else {
            let files: String = missing.iter().map(|file| format!("{file}\n")).collect();
            self.mark(WITH_MISSING_FILES, &format!("{MISSING_HEADING}\n{files}"))?;
        }
        fs::remove_file(self.folder.join(LOCK)).or_else(unless_missing).map_err(folder_error(&self.folder))
    }

    /// Removes the mark of a restored folder: the service may run on it.
    pub(super) fn unmark(&self) -> UpkeepResult<()> {
        let removed = fs::remove_file(self.folder.join(BACKUP_MARK));
        removed.and_then(|()| sync(&self.folder)).map_err(folder_error(&self.folder))
    }

    /// Ends the writing. After a failure all that was written is removed. A failure after the beginning of the stop is
    /// reported as [`UpkeepError::Interrupted`].
    pub(super) fn end<T>(self, written: UpkeepResult<T>, stop: &Shutdown) -> UpkeepResult<T> {
        if written.is_err()
            && let Err(error) = self.remove()
        {
            let folder = self.folder.display();
            tracing::warn!(%error, %folder, "unfinished folder not removed; delete it, or repeat the command");
        }
        written.map_err(|error| if stop.is_begun() { UpkeepError::Interrupted } else { error })
    }

    /// Removes all that was written, the mark last.
    fn remove(&self) -> io::Result<()> {
        empty(&self.folder, &[BACKUP_MARK, LOCK])?;
        empty(&self.folder, &[])?;
        if self.existed { Ok(()) } else { fs::remove_dir(&self.folder) }
    }

    /// Replaces the mark; durable when this returns.
    fn mark(&self, first_line: &str, rest: &str) -> UpkeepResult<()> {
        let installation = self.installation.map_or_else(String::new, |id| format!("{INSTALLATION}{id}\n"));
        let text = format!("{first_line}\n{installation}{rest}");
        let write = || {
            let new = self.folder.join(NEW_MARK);
            let mut file = File::create(&new)?;
            file.write_all(text.as_bytes())?;
            file.sync_all()?;
            fs::rename(new, self.folder.join(BACKUP_MARK))?;
            sync(&self.folder)
        };
        write().map_err(folder_error(&self.folder))
    }
}

/// Refuses a folder that holds anything but an unfinished attempt.
pub(super) fn refuse_used(folder: &Path) -> UpkeepResult<()> {
    let is_used = || {
        let mut entries = fs::read_dir(folder)?.map(|entry| Ok(entry?.file_name()));
        entries.try_fold(false, |used, name: io::Result<_>| {
            let name = name?;
            Ok::<_, io::Error>(used || (name != LOCK && name != NEW_MARK))
        })
    };
    if !folder.exists() || !is_used().map_err(folder_error(folder))? {
        return Ok(());
    }
    match BackupMark::read(folder)? {
        Some(BackupMark::Unfinished) => Ok(()),
        _ => Err(UpkeepError::Used(folder.to_owned())),
    }
}

/// Removes what a folder holds, except these files.
fn empty(folder: &Path, keep: &[&str]) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if keep.iter().any(|kept| entry.file_name() == *kept) {
            continue;
        }
        let removed =
            if entry.file_type()?.is_dir() { fs::remove_dir_all(entry.path()) } else { fs::remove_file(entry.path()) };
        removed.or_else(unless_missing)?;
    }
    Ok(())
}

fn unless_missing(error: io::Error) -> io::Result<()> {
    if error.kind() == io::ErrorKind::NotFound { Ok(()) } else { Err(error) }
}

fn sync(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

/// A failure of this folder.
pub(super) fn folder_error(folder: &Path) -> impl Fn(io::Error) -> UpkeepError + use<> {
    let folder = folder.to_owned();
    move |error| UpkeepError::Target { why: reason(&folder, &error), folder: folder.clone() }
}

/// The reason of a failure, and what to do about it if systemd makes the disk read-only: the unit of the service lets it
/// write only to its data folder.
pub(super) fn reason(folder: &Path, error: &io::Error) -> String {
    if error.kind() != io::ErrorKind::ReadOnlyFilesystem {
        return error.to_string();
    }
    // A scheduled backup is written into a folder of the one that the settings name, which does not exist yet.
    let target = folder.ancestors().find(|part| part.is_dir()).unwrap_or(folder).display();
    format!(
        "{error}. If systemd runs the service, its unit must allow it to write there: `sudo systemctl edit trocar`, \
         with the lines `[Service]` and `ReadWritePaths={target}`, and then `sudo systemctl restart trocar`. Otherwise \
         make the disk writable"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_systemd_makes_read_only_is_named_with_what_to_do() {
        let target = tempfile::tempdir().unwrap();
        let read_only = io::Error::from_raw_os_error(rustix::io::Errno::ROFS.raw_os_error());
        let failed = folder_error(&target.path().join("partial-2026-11-28T02-30-00.12Z"))(read_only).to_string();
        let lines = format!("`[Service]` and `ReadWritePaths={}`", target.path().display());
        assert!(failed.contains("Read-only file system") && failed.contains(&lines), "{failed}");
        assert!(failed.contains("systemctl edit trocar") && failed.contains("systemctl restart trocar"), "{failed}");
        let denied = folder_error(target.path())(io::ErrorKind::PermissionDenied.into()).to_string();
        assert!(!denied.contains("systemctl"), "{denied}");
    }
}
