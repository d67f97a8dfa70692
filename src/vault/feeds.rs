//! Logs of feeds: records one after the other in the order in which they came, a file each.
//!
//! The order that makes an acknowledged frame a durable one: append → [`FeedLog::begin_sync`] → [`Syncing::end`] → the answer;
//! more is appended meanwhile. What lies behind the last sync was never acknowledged: opening a log reads it through and cuts off the tail in which no whole record lies. How far
//! the last sync reached is not written down: of damage with whole records behind it nobody can tell here whether it was
//! acknowledged, and the sender, who knows, sends again what was not.

use std::fs::File;
use std::io::{self, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytes::Bytes;

use super::Vault;
use super::disk::{self, on_a_blocking_thread};
use super::error::{VaultError, VaultResult, failed};
use crate::domain::feed::numbers::Numbers;
use crate::domain::feed::record::read_all;
use crate::ids::FeedId;

/// Bytes that wait at most before they are written: some frames of 1080p, as JPEGs too.
const MOST_WAITING: usize = 1 << 19;

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
    file: Arc<File>,
    written: u64,
}

/// What was written of a feed's log before this was made, on its way to the disk.
#[derive(Debug)]
#[must_use = "nothing is durable before its end"]
pub struct Syncing {
    path: PathBuf,
    file: Arc<File>,
}

impl Syncing {
    /// Resolves once it is durable; the process ends where it cannot be.
    pub async fn end(self) -> VaultResult<()> {
        on_a_blocking_thread(move || {
            disk::sync(&self.file, &self.path);
            Ok(())
        })
        .await
    }
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
            let open = Some(Box::new(Open { path, file: Arc::new(file), written }));
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

    /// The frames that damaged records of a feed's log have held, as far as they are not in others: sent again, they are.
    /// Of a tail that is no whole record nothing was acknowledged, and it may be growing at this moment.
    pub async fn feed_damage(&self, id: FeedId) -> VaultResult<Vec<[u64; 2]>> {
        let path = path(&self.inner.data, id);
        on_a_blocking_thread(move || damage(disk::open(&path)?).map_err(failed("reading", &path))).await
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
    /// Appends a record. Others can read it only after [`FeedLog::write_waiting`], and it is durable only after a sync.
    pub async fn append(&mut self, record: Bytes) -> VaultResult<()> {
        if self.waiting.len() + record.len() > MOST_WAITING {
            return self.write(record).await; // as it is: a copy of the largest would take as much again
        }
        self.waiting.extend_from_slice(&record);
        Ok(())
    }

    /// Bytes appended so far, durable or not.
    pub fn bytes(&self) -> u64 {
        self.written() + self.waiting.len() as u64
    }

    /// How many of them can be read by others.
    pub fn written(&self) -> u64 {
        self.open.as_ref().map_or(0, |open| open.written)
    }

    /// Writes what waits, all in one visit to a blocking thread, so that others can read it.
    pub async fn write_waiting(&mut self) -> VaultResult<()> {
        if self.waiting.is_empty() { Ok(()) } else { self.write(Bytes::new()).await }
    }

    /// Begins to make everything appended so far durable; more may be appended meanwhile. After an error everything since the
    /// last sync may be lost: open it again.
    pub async fn begin_sync(&mut self) -> VaultResult<Syncing> {
        self.write_waiting().await?;
        let open = self.open.as_ref().ok_or(VaultError::NotFound)?;
        Ok(Syncing { path: open.path.clone(), file: open.file.clone() })
    }

    /// Makes everything appended durable.
    pub async fn sync(&mut self) -> VaultResult<()> {
        self.begin_sync().await?.end().await
    }

    /// Writes what waits, and a record behind it.
    async fn write(&mut self, record: Bytes) -> VaultResult<()> {
        let mut open = self.open.take().ok_or(VaultError::NotFound)?;
        let mut bytes = std::mem::take(&mut self.waiting);
        let (open, bytes) = on_a_blocking_thread(move || {
            let write = |bytes: &[u8]| disk::write(&open.file, bytes, &open.path);
            if let Err(error) = write(&bytes).and_then(|()| write(&record)) {
                open.file.set_len(open.written).map_err(failed("cutting", &open.path))?;
                return Err(error);
            }
            open.written += (bytes.len() + record.len()) as u64;
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

/// The numbers that are missing, if there are bytes before the end of the last whole record that are none.
fn damage(log: File) -> io::Result<Vec<[u64; 2]>> {
    let (mut whole, mut numbers) = (0, Numbers::default());
    let end = read_all(log, |_, record| {
        whole += record.bytes() as u64;
        let _ = numbers.add(record.number, record.last()); // as when it is read through
        io::Result::Ok(())
    })?;
    Ok(if whole == end { Vec::new() } else { numbers.missing_below(numbers.end()) })
}

fn path(data: &Path, id: FeedId) -> PathBuf {
    data.join("feeds").join(id.to_string())
}
