//! The file operations that durability depends on. All of them block.

use std::fs::{self, DirBuilder, File, OpenOptions, TryLockError};
use std::io::{self, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;

use super::error::{VaultError, VaultResult, failed};
use crate::shutdown;

/// Runs file work on a thread that may block.
pub(super) async fn run_blocking<T: Send + 'static>(
    work: impl FnOnce() -> VaultResult<T> + Send + 'static,
) -> VaultResult<T> {
    match tokio::task::spawn_blocking(work).await {
        Ok(result) => result,
        Err(error) if error.is_panic() => std::panic::resume_unwind(error.into_panic()),
        Err(_) => Err(VaultError::ShuttingDown),
    }
}

/// Creates the vault's folders, readable only by the service's user. The 256 blob folders are created at once, so that
/// no later write has to create and sync one.
pub(super) fn make_folders(data: &Path) -> VaultResult<()> {
    make_folder(data)?;
    for folder in ["incoming", "uploads", "feeds", "blobs"] {
        make_folder(&data.join(folder))?;
    }
    let blobs = data.join("blobs");
    for first in 0..=u8::MAX {
        make_folder(&blobs.join(format!("{first:02x}")))?;
    }
    sync_folder(&blobs);
    sync_folder(data);
    Ok(())
}

fn make_folder(path: &Path) -> VaultResult<()> {
    const MAKING: &str = "making the folder";
    DirBuilder::new().recursive(true).mode(0o700).create(path).map_err(|error| match error.kind() {
        // It is the place of the data folder that does not exist, no file in the vault.
        io::ErrorKind::NotFound => VaultError::Io { doing: MAKING, path: path.to_owned(), source: Arc::new(error) },
        _ => failed(MAKING, path)(error),
    })
}

/// Creates a file for writing, readable only by the service's user.
pub(super) fn create(path: &Path) -> VaultResult<File> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true).mode(0o600);
    options.open(path).map_err(failed("making", path))
}

/// Like [`create`], for reading as well.
pub(super) fn create_to_read(path: &Path) -> VaultResult<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create_new(true).mode(0o600);
    options.open(path).map_err(failed("making", path))
}

/// Opens an existing file for reading.
pub(super) fn open(path: &Path) -> VaultResult<File> {
    File::open(path).map_err(failed("opening", path))
}

/// Opens an existing file for writing.
pub(super) fn open_to_write(path: &Path) -> VaultResult<File> {
    OpenOptions::new().write(true).open(path).map_err(failed("opening", path))
}

pub(super) fn write(mut file: &File, bytes: &[u8], path: &Path) -> VaultResult<()> {
    file.write_all(bytes).map_err(failed("writing", path))
}

/// Syncs the file's bytes to the disk; aborts the process if that fails.
pub(super) fn sync(file: &File, path: &Path) {
    if let Err(error) = file.sync_data() {
        shutdown::abort_process(&format!("syncing `{}` failed: {error}", path.display()));
    }
}

/// Syncs the folder's entries to the disk; aborts the process if that fails.
pub(super) fn sync_folder(path: &Path) {
    if let Err(error) = File::open(path).and_then(|folder| folder.sync_all()) {
        shutdown::abort_process(&format!("syncing the folder `{}` failed: {error}", path.display()));
    }
}

/// Removes a file; a missing file is no error.
pub(super) fn remove(path: &Path) -> VaultResult<()> {
    match fs::remove_file(path).map_err(failed("removing", path)) {
        Err(VaultError::NotFound) => Ok(()),
        result => result,
    }
}

/// The files of a folder with their lengths, bytes.
pub(super) fn list(folder: &Path) -> VaultResult<Vec<(PathBuf, u64)>> {
    let describe = |entry: std::io::Result<fs::DirEntry>| {
        let entry = entry?;
        Ok((entry.path(), entry.metadata()?.len()))
    };
    let entries = fs::read_dir(folder).map_err(failed("listing", folder))?;
    entries.map(describe).collect::<std::io::Result<_>>().map_err(failed("listing", folder))
}

/// The ids that are names of files in a folder; other names are ignored.
pub(super) fn ids_in<T: FromStr>(folder: &Path) -> VaultResult<Vec<T>> {
    let named = |path: &Path| path.file_name()?.to_str()?.parse().ok();
    Ok(list(folder)?.iter().filter_map(|(path, _)| named(path)).collect())
}

/// Takes an exclusive lock that ends with the process.
pub(super) fn lock(path: &Path) -> VaultResult<File> {
    let mut options = OpenOptions::new();
    options.write(true).create(true).truncate(false).mode(0o600);
    let file = options.open(path).map_err(failed("opening", path))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(VaultError::InUse("the data folder".to_owned())),
        Err(TryLockError::Error(error)) => Err(failed("locking", path)(error)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_that_a_stopped_runtime_does_not_begin_reports_the_shutdown() {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).build().unwrap();
        let stopped = runtime.handle().clone();
        runtime.shutdown_background();
        let result: VaultResult<()> = stopped.block_on(run_blocking(|| panic!("must not begin")));
        assert!(matches!(result, Err(VaultError::ShuttingDown)), "{result:?}");
    }
}
