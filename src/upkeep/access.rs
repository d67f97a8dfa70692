//! What this user may do with a data folder or a backup. It is found before the database is opened, since SQLite's
//! errors do not name the cause.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use rustix::fs::{Access, access};
use rustix::io::Errno;

use super::{UpkeepError, UpkeepResult};

/// True if there is such a file.
///
/// # Errors
/// [`UpkeepError::Denied`] if this user may not read it.
pub fn is_readable(file: &Path) -> UpkeepResult<bool> {
    match access(file, Access::READ_OK) {
        Err(Errno::NOENT | Errno::NOTDIR) => Ok(false),
        result => result.map(|()| true).map_err(|error| access_error(file, error)),
    }
}

/// Refuses a folder that this user may not change.
///
/// # Errors
/// [`UpkeepError::ReadOnly`], [`UpkeepError::Denied`].
pub fn require_writable(folder: &Path) -> UpkeepResult<()> {
    access(folder, Access::WRITE_OK).map_err(|error| access_error(folder, error))
}

fn access_error(path: &Path, error: Errno) -> UpkeepError {
    let path = path.to_owned();
    match error {
        Errno::ROFS => UpkeepError::ReadOnly(path),
        Errno::ACCESS | Errno::PERM => UpkeepError::Denied { owner: owner_of(&path), path },
        other => UpkeepError::Unreadable { path, why: std::io::Error::from(other).to_string() },
    }
}

/// The owner of a path, as `sudo -u` takes it. If the path cannot be seen, its folder has the owner.
fn owner_of(path: &Path) -> String {
    let uid = path.ancestors().find_map(|part| fs::metadata(part).ok()).map_or(0, |found| found.uid()).to_string();
    let users = fs::read_to_string("/etc/passwd").unwrap_or_default();
    let named = users.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)? == uid).then(|| name.to_owned())
    });
    named.unwrap_or_else(|| format!("'#{uid}'"))
}
