//! Files with the passwords that the program chose for an account at its first start.
//!
//! Such a password is needed once. A terminal or a pipe gets it; a file, the journal and the log of a container do not,
//! because they keep what they get. So a file has the password, and only its owner may read it. The file also has the
//! stored hash: once no account has it any more, the password was changed, and the file is deleted.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::{UpkeepError, UpkeepResult};
use crate::domain::secret::{Password, PasswordHash};
use crate::domain::text::Login;
use crate::store::Store;

/// Ending of the files' names; the login is before it.
const EXTENSION: &str = "password";
/// Beginning of the line with the hash.
const HASH_LINE: &str = "hash: ";
/// Time for making a file's account; it takes a second.
const ACCOUNT_FOLLOWS: Duration = Duration::from_secs(3_600);

/// Path of the file with an account's first password.
pub fn password_file(data: &Path, login: &str) -> PathBuf {
    data.join(login).with_added_extension(EXTENSION)
}

/// Writes the file of an account and replaces an earlier one; durable when this returns. Call it before the account is
/// made: then no crash leaves an account whose password is unknown.
pub fn write_password_file(
    data: &Path,
    login: &str,
    password: &Password,
    hash: &PasswordHash,
) -> UpkeepResult<PathBuf> {
    let path = password_file(data, login);
    let text = format!(
        "login: {login}\npassword: {}\n{HASH_LINE}{}\nThe service deletes this file once the password was changed.\n",
        password.reveal(),
        hash.0
    );
    let write = || {
        remove(&path)?; // an earlier one may have other permissions
        let mut file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(&path)?;
        file.write_all(text.as_bytes()).and_then(|()| file.sync_all())?;
        File::open(data)?.sync_all()
    };
    write().map_err(file_error(&path))?;
    Ok(path)
}

/// Deletes the files whose password is no account's any more. A new file whose account is still being made stays.
pub(super) async fn forget_changed_passwords(store: &Store, data: &Path) -> UpkeepResult<()> {
    let entries = fs::read_dir(data).map_err(file_error(data))?;
    for entry in entries {
        let path = entry.map_err(file_error(data))?.path();
        if path.extension().is_none_or(|extension| extension != EXTENSION) {
            continue;
        }
        let text = match fs::read_to_string(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => continue, // deleted by another process
            text => text.map_err(file_error(&path))?,
        };
        if is_new(&path) && !has_account(store, &path).await? {
            continue;
        }
        // Asked last: an account that exists by now has its password.
        let Some(hash) = text.lines().find_map(|line| line.strip_prefix(HASH_LINE)) else { continue };
        if !store.people().has_password(&PasswordHash(hash.to_owned())).await? {
            remove(&path).map_err(file_error(&path))?;
        }
    }
    Ok(())
}

fn is_new(path: &Path) -> bool {
    let modified = fs::metadata(path).and_then(|found| found.modified());
    modified.is_ok_and(|modified| modified.elapsed().is_ok_and(|age| age < ACCOUNT_FOLLOWS))
}

/// True if an account has the login that a file is named by.
async fn has_account(store: &Store, path: &Path) -> UpkeepResult<bool> {
    let name = path.file_stem().and_then(|name| name.to_str()).unwrap_or_default();
    let Ok(login) = name.parse::<Login>() else { return Ok(false) };
    Ok(store.people().by_login(&login).await?.is_some())
}

/// Removes a file; a missing file is no error.
fn remove(path: &Path) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

fn file_error(path: &Path) -> impl Fn(io::Error) -> UpkeepError {
    let path = path.to_owned();
    move |error| UpkeepError::PasswordFile { path: path.clone(), why: error.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::role::Role;
    use crate::upkeep::tests::UpkeepFixture;

    #[tokio::test]
    async fn a_file_stays_while_its_account_is_being_made_and_goes_with_another_password() {
        let bench = UpkeepFixture::new().await;
        let (store, data) = (&bench.centre.store, bench.vault.folder());
        let password = Password::random();
        let write = || write_password_file(data, "ina", &password, &password.hash()).unwrap();
        let file = write();
        forget_changed_passwords(store, data).await.unwrap();
        assert!(file.exists(), "its account follows");
        let long_ago = fs::metadata(&file).unwrap().modified().unwrap() - 2 * ACCOUNT_FOLLOWS;
        File::options().write(true).open(&file).unwrap().set_modified(long_ago).unwrap();
        forget_changed_passwords(store, data).await.unwrap();
        assert!(!file.exists(), "its account was never made");
        write();
        bench.centre.person("ina", Role::Instructor, None).await;
        forget_changed_passwords(store, data).await.unwrap();
        assert!(!file.exists(), "its account has another password");
    }
}
