//! Tests of the vault, each in its own folder.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use tempfile::TempDir;
use tokio::io::AsyncReadExt;

use super::{FileLoss, Removal, Vault, VaultError};
use crate::domain::blob::Blob;
use crate::ids::UploadId;
use crate::shutdown::Shutdown;

async fn vault() -> (Vault, TempDir) {
    let folder = tempfile::tempdir().unwrap();
    (Vault::open(folder.path()).await.unwrap(), folder)
}

fn files_in(folder: &TempDir, name: &str) -> usize {
    fs::read_dir(folder.path().join(name)).unwrap().count()
}

fn path_of(folder: &TempDir, blob: Blob) -> PathBuf {
    let hash = blob.hash.to_string();
    folder.path().join("blobs").join(&hash[..2]).join(hash)
}

async fn free() -> Result<bool, VaultError> {
    Ok(true)
}

#[tokio::test]
async fn a_blob_is_named_by_its_content_and_the_same_bytes_are_one_blob() {
    let (vault, folder) = vault().await;
    let content = vec![7; 700_000];
    let (first, second) = (vault.put(&content).await.unwrap(), vault.put(&content).await.unwrap());
    assert_eq!((first.blob(), second.blob()), (Blob::of(&content), Blob::of(&content)));
    assert_eq!(vault.read(first.blob().hash, 1 << 20).await.unwrap(), content);
    assert_eq!(files_in(&folder, "incoming"), 0);
}

#[tokio::test]
async fn a_range_is_part_of_the_blob() {
    let (vault, _folder) = vault().await;
    let kept = vault.put(b"0123456789").await.unwrap();
    for (start, length, expected) in [(0, 10, "0123456789"), (3, 4, "3456"), (8, 99, "89"), (10, 1, "")] {
        let mut part = String::new();
        let mut reader = vault.open_range(kept.blob().hash, start, length).await.unwrap();
        reader.read_to_string(&mut part).await.unwrap();
        assert_eq!(part, expected);
    }
}

#[tokio::test]
async fn a_blob_that_is_dropped_unfinished_leaves_nothing() {
    let (vault, folder) = vault().await;
    let mut incoming = vault.incoming(1 << 20).await.unwrap();
    incoming.write(&vec![1; 600_000]).await.unwrap();
    assert_eq!(files_in(&folder, "incoming"), 1);
    drop(incoming);
    assert_eq!(files_in(&folder, "incoming"), 0);
}

#[tokio::test]
async fn what_a_killed_process_left_half_written_is_cleared_at_the_next_start() {
    let (vault, folder) = vault().await;
    fs::write(folder.path().join("incoming").join("0123"), b"half").unwrap();
    assert_eq!(vault.clear_incoming().await.unwrap(), 1);
    assert_eq!(files_in(&folder, "incoming"), 0);
}

#[tokio::test]
async fn more_bytes_than_allowed_are_refused_with_the_limit() {
    let (vault, _folder) = vault().await;
    let mut incoming = vault.incoming(5).await.unwrap();
    incoming.write(b"12345").await.unwrap();
    assert!(matches!(incoming.write(b"6").await, Err(VaultError::TooLong { most: 5 })));
}

#[tokio::test]
async fn a_changed_byte_is_found() {
    let (vault, folder) = vault().await;
    let blob = vault.put(b"trajectory").await.unwrap().blob();
    let verify = async || vault.verify(blob, &Shutdown::new()).await.unwrap();
    assert_eq!(verify().await, None);
    fs::write(path_of(&folder, blob), b"trajectorx").unwrap();
    assert_eq!(verify().await, Some(FileLoss::Damaged));
    assert!(matches!(vault.read(blob.hash, 100).await, Err(VaultError::Damaged)));
    fs::remove_file(path_of(&folder, blob)).unwrap();
    assert_eq!(verify().await, Some(FileLoss::Missing));
}

#[tokio::test]
async fn a_copy_is_verified_and_a_lost_blob_leaves_nothing_in_the_other_vault() {
    let ((vault, folder), (copy, copied)) = (vault().await, vault().await);
    let put = async |byte: u8| vault.put(&vec![byte; 600_000]).await.unwrap().blob();
    let (good, damaged, missing) = (put(1).await, put(2).await, put(3).await);
    fs::write(path_of(&folder, damaged), vec![4; 600_000]).unwrap();
    fs::remove_file(path_of(&folder, missing)).unwrap();
    for (blob, loss) in [(good, None), (damaged, Some(FileLoss::Damaged)), (missing, Some(FileLoss::Missing))] {
        assert_eq!(vault.copy_blob(blob, &copy, &Shutdown::new()).await.unwrap(), loss);
        assert_eq!(path_of(&copied, blob).exists(), loss.is_none());
    }
    assert_eq!(copy.verify(good, &Shutdown::new()).await.unwrap(), None);
    fs::remove_dir(path_of(&copied, missing).parent().unwrap()).unwrap();
    fs::write(path_of(&folder, missing), vec![3; 600_000]).unwrap();
    let failed = vault.copy_blob(missing, &copy, &Shutdown::new()).await;
    assert!(failed.is_err(), "a copy that cannot be written is no loss: {failed:?}");
    assert_eq!((files_in(&copied, "incoming"), files_in(&folder, "incoming")), (0, 0));
}

#[tokio::test]
async fn a_stop_ends_copying_and_verifying_within_a_file() {
    let ((vault, folder), (copy, copied)) = (vault().await, vault().await);
    let blob = vault.put(b"replaced by a pipe").await.unwrap().blob();
    for copies in [true, false] {
        let (pipe, stop) = (path_of(&folder, blob), Shutdown::new());
        fs::remove_file(&pipe).unwrap();
        make_pipe(&pipe);
        let (begun, written) = (stop.clone(), pipe.clone());
        let writing = std::thread::spawn(move || feed_pipe(&written, || begun.begin()));
        let ended = match copies {
            true => vault.copy_blob(blob, &copy, &stop).await,
            false => vault.verify(blob, &stop).await,
        };
        assert!(matches!(ended, Err(VaultError::ShuttingDown)), "{ended:?}");
        writing.join().unwrap();
    }
    assert_eq!(files_in(&copied, "incoming"), 0);
}

/// Makes a pipe in the place of a file, so that a test decides when a reader gets its bytes.
pub(crate) fn make_pipe(path: &Path) {
    rustix::fs::mkfifoat(rustix::fs::CWD, path, rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR).unwrap();
}

/// Writes into a pipe until its reader closes it, and calls `begun` once the reader has opened it. The reader never
/// sees the end of the file.
pub(crate) fn feed_pipe(path: &Path, begun: impl FnOnce()) {
    let mut pipe = fs::OpenOptions::new().write(true).open(path).unwrap();
    pipe.write_all(&[7; 4096]).unwrap();
    begun();
    while pipe.write_all(&[7; 4096]).is_ok() {}
}

#[tokio::test]
async fn a_blob_that_is_being_put_is_not_removed() {
    let (vault, _folder) = vault().await;
    let kept = vault.put(b"video").await.unwrap();
    let hash = kept.blob().hash;
    assert_eq!(vault.delete_if(hash, free()).await.unwrap(), Removal::Needed);
    drop(kept);
    let needed = async { Ok::<_, VaultError>(false) };
    assert_eq!(vault.delete_if(hash, needed).await.unwrap(), Removal::Needed);
    assert_eq!(vault.delete_if(hash, free()).await.unwrap(), Removal::Removed);
    assert!(matches!(vault.open_blob(hash).await, Err(VaultError::NotFound)));
}

#[tokio::test]
async fn a_blob_that_is_put_during_its_removal_exists_afterwards() {
    let (vault, _folder) = vault().await;
    let hash = vault.put(b"video").await.unwrap().blob().hash;
    let (asked, answer) = (tokio::sync::Notify::new(), tokio::sync::Notify::new());
    let slow = async {
        asked.notify_one();
        answer.notified().await; // the row is being deleted
        Ok::<_, VaultError>(true)
    };
    let again = async {
        asked.notified().await;
        let mut putting = Box::pin(vault.put(b"video"));
        for _ in 0..1_000 {
            assert!(futures_util::poll!(&mut putting).is_pending()); // it waits for the removal
            tokio::task::yield_now().await;
        }
        answer.notify_one();
        putting.await.unwrap()
    };
    let (removal, kept) = tokio::join!(vault.delete_if(hash, slow), again);
    assert_eq!(removal.unwrap(), Removal::Removed);
    assert_eq!(vault.read(kept.blob().hash, 100).await.unwrap(), b"video");
}

#[tokio::test]
async fn an_upload_resumes_after_the_acknowledged_bytes_and_drops_later_ones() {
    let (vault, folder) = vault().await;
    let id = UploadId::at(1);
    let mut file = vault.create_upload(id).await.unwrap();
    file.append(b"acknowledged").await.unwrap();
    assert_eq!(file.sync().await.unwrap(), 12);
    file.append(b" lost in the crash").await.unwrap();
    file.sync().await.unwrap();
    drop(file);
    let mut file = vault.open_upload(id, 12).await.unwrap();
    file.append(b", and more").await.unwrap();
    assert_eq!(file.sync().await.unwrap(), 22);
    drop(file);
    let kept = vault.keep_upload(id).await.unwrap();
    vault.delete_upload(id).await.unwrap();
    assert_eq!(vault.read(kept.blob().hash, 100).await.unwrap(), b"acknowledged, and more");
    assert_eq!(files_in(&folder, "uploads"), 0);
}

#[tokio::test]
async fn opening_with_an_old_offset_takes_no_acknowledged_byte_away() {
    let (vault, _folder) = vault().await;
    let id = UploadId::at(1);
    let mut file = vault.create_upload(id).await.unwrap();
    file.append(b"acknowledged").await.unwrap();
    file.sync().await.unwrap();
    drop(file);
    drop(vault.open_upload(id, 3).await.unwrap()); // its offset was read too early; it notices and closes the file
    assert_eq!(vault.upload_length(id).await.unwrap(), 12);
}

#[tokio::test]
async fn an_upload_has_one_sender_at_a_time() {
    let (vault, _folder) = vault().await;
    let id = UploadId::at(1);
    let first = vault.create_upload(id).await.unwrap();
    assert!(matches!(vault.open_upload(id, 0).await, Err(VaultError::InUse(_))));
    drop(first);
    vault.open_upload(id, 0).await.unwrap();
}

#[tokio::test]
async fn an_upload_shorter_than_acknowledged_is_not_resumed() {
    let (vault, _folder) = vault().await;
    let id = UploadId::at(1);
    drop(vault.create_upload(id).await.unwrap());
    assert!(matches!(vault.open_upload(id, 3).await, Err(VaultError::Lost { found: 0, noted: 3 })));
}

#[tokio::test]
async fn two_services_cannot_share_a_folder() {
    let (vault, folder) = vault().await;
    let lock = vault.lock().await.unwrap();
    let other = Vault::open(folder.path()).await.unwrap();
    assert!(matches!(other.lock().await, Err(VaultError::InUse(_))));
    drop(lock);
    other.lock().await.unwrap();
}
