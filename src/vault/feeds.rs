//! Logs of feeds: records one after the other in the order in which they came, a file each.
//!
//! The order that makes an acknowledged frame a durable one: append → [`FeedLog::sync`] → the answer. What lies behind the
//! last sync was never acknowledged: opening a log reads it through and cuts off whatever is no whole record.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use bytes::Bytes;

use super::Vault;
use super::disk::{self, on_a_blocking_thread};
use super::error::{VaultError, VaultResult, failed};
use crate::domain::feed::numbers::Numbers;
use crate::domain::feed::record::{MOST_BYTES, Record, read_all};
use crate::ids::FeedId;

/// Bytes that wait at most before they are written.
const MOST_WAITING: usize = 1 << 17;

/// Bytes that can have been written without ever being synced: what waits, and a record.
const LONGEST_TAIL: u64 = (MOST_WAITING + MOST_BYTES) as u64;

/// A feed's log, open to be appended to.
#[derive(Debug)]
pub struct FeedLog {
    open: Option<Box<Open>>,
    waiting: Vec<u8>,
}

/// The file behind a [`FeedLog`], moved to a blocking thread for each write.
#[derive(Debug)]
struct Open {
    path: PathBuf,
    file: File,
    written: u64,
}

impl Vault {
    /// Opens a feed's log, made if it is missing, and tells which frames and gaps it holds. One opener at a time: the
    /// service sees to that.
    pub async fn open_feed(&self, id: FeedId) -> VaultResult<(FeedLog, Numbers)> {
        let path = path(&self.inner.data, id);
        on_a_blocking_thread(move || {
            let mut file = match disk::open_to_write(&path) {
                Err(VaultError::NotFound) => disk::create(&path)?,
                found => found?,
            };
            let (written, numbers) = read_through(disk::open(&path)?, &path)?;
            file.set_len(written).map_err(failed("cutting", &path))?;
            file.seek(SeekFrom::Start(written)).map_err(failed("cutting", &path))?;
            // What was read may lie in the system's cache alone, left there by a process that was killed.
            disk::sync(&file, &path);
            path.parent().into_iter().for_each(disk::sync_folder);
            let open = Some(Box::new(Open { path, file, written }));
            Ok((FeedLog { open, waiting: Vec::new() }, numbers))
        })
        .await
    }

    /// A feed's log, to be read from its beginning, and its length.
    pub async fn read_feed(&self, id: FeedId) -> VaultResult<(File, u64)> {
        let path = path(&self.inner.data, id);
        on_a_blocking_thread(move || {
            let file = disk::open(&path)?;
            let bytes = file.metadata().map_err(failed("measuring", &path))?.len();
            Ok((file, bytes))
        })
        .await
    }

    /// Whether every record of a feed's log is whole. Of a tail that is none, nothing was acknowledged, and it may be growing
    /// at this moment; but a whole record cannot lie behind damage unless it was written after it.
    pub async fn is_feed_intact(&self, id: FeedId) -> VaultResult<bool> {
        let path = path(&self.inner.data, id);
        on_a_blocking_thread(move || is_intact(disk::open(&path)?).map_err(failed("reading", &path))).await
    }

    /// Forgets a feed's log, after its row. One that is gone already is as good.
    pub async fn delete_feed(&self, id: FeedId) -> VaultResult<()> {
        let path = path(&self.inner.data, id);
        on_a_blocking_thread(move || disk::remove(&path)).await
    }

    /// The feeds that have a log.
    pub async fn feed_logs(&self) -> VaultResult<Vec<FeedId>> {
        let folder = self.inner.data.join("feeds");
        on_a_blocking_thread(move || disk::ids_in(&folder)).await
    }
}

impl FeedLog {
    /// Appends a record; `at_once` where somebody reads it before the next sync. It is durable only after [`FeedLog::sync`].
    pub async fn append(&mut self, record: Bytes, at_once: bool) -> VaultResult<()> {
        if at_once || self.waiting.len() + record.len() > MOST_WAITING {
            return self.write(record, false).await; // as it is: a copy of the largest would take as much again
        }
        self.waiting.extend_from_slice(&record);
        Ok(())
    }

    /// Bytes appended so far, durable or not.
    pub fn bytes(&self) -> u64 {
        self.open.as_ref().map_or(0, |open| open.written) + self.waiting.len() as u64
    }

    /// Makes everything appended durable. After an error everything since the last sync may be lost: open it again.
    pub async fn sync(&mut self) -> VaultResult<()> {
        self.write(Bytes::new(), true).await
    }

    /// Writes what waits, and a record behind it.
    async fn write(&mut self, record: Bytes, sync: bool) -> VaultResult<()> {
        let mut open = self.open.take().ok_or(VaultError::NotFound)?;
        let mut bytes = std::mem::take(&mut self.waiting);
        let (open, bytes) = on_a_blocking_thread(move || {
            let mut write = |bytes: &[u8]| disk::write(&mut open.file, bytes, &open.path);
            if let Err(error) = write(&bytes).and_then(|()| write(&record)) {
                open.file.set_len(open.written).map_err(failed("cutting", &open.path))?;
                return Err(error);
            }
            open.written += (bytes.len() + record.len()) as u64;
            if sync {
                disk::sync(&open.file, &open.path);
            }
            bytes.clear();
            Ok((open, bytes))
        })
        .await?;
        (self.open, self.waiting) = (Some(open), bytes);
        Ok(())
    }
}

/// Where the last whole record ends, and the numbers that all of them speak of.
fn read_through(file: File, path: &Path) -> VaultResult<(u64, Numbers)> {
    let mut numbers = Numbers::default();
    let end = read_all(file, |_, record| {
        // More ranges than were ever accepted: what cannot be counted is as if it had not come.
        let _ = numbers.add(record.number, record.last());
        io::Result::Ok(())
    });
    Ok((end.map_err(failed("reading", path))?, numbers))
}

/// Are there no bytes before the last whole record that are none?
fn is_intact(mut log: File) -> io::Result<bool> {
    let mut whole = 0;
    let end = read_all(&log, |_, record| {
        whole += record.bytes() as u64;
        io::Result::Ok(())
    })?;
    let mut tail = Vec::new();
    log.seek(SeekFrom::Start(end))?;
    log.by_ref().take(LONGEST_TAIL).read_to_end(&mut tail)?;
    let is_short = (tail.len() as u64) < LONGEST_TAIL;
    let mut rest = &tail[..];
    while let Ok((_, behind)) = Record::read_first(rest) {
        rest = behind; // written since
    }
    Ok(whole == end && is_short && (0..rest.len()).all(|at| Record::read_first(&rest[at..]).is_err()))
}

fn path(data: &Path, id: FeedId) -> PathBuf {
    data.join("feeds").join(id.to_string())
}
