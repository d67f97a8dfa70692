//! Logs of feeds: one file per feed, with its records in the order of arrival.
//!
//! The order that makes every acknowledged frame durable: append → [`FeedLog::begin_sync`] → [`FeedSync::end`] → reply.
//! More may be appended meanwhile. Bytes after the last sync were never acknowledged: opening a log reads it through
//! and cuts off a tail without a whole record. The log does not record how far the last sync reached. If damage is
//! followed by whole records, it is unknown here whether the damaged part was acknowledged; the sender knows and sends
//! again what was not.

use std::fs::File;
use std::io::{self, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytes::Bytes;

use super::Vault;
use super::disk::{self, run_blocking};
use super::error::{VaultError, VaultResult, failed};
use crate::domain::feed::numbers::FrameNumbers;
use crate::domain::feed::record::read_all;
use crate::ids::FeedId;

/// Maximum number of buffered bytes before they are written: some frames of 1080p, even as JPEGs.
const MAX_WAITING: usize = 1 << 19;

/// A feed's log, open for appending.
#[derive(Debug)]
pub struct FeedLog {
    open: Option<Box<OpenLog>>,
    waiting: Vec<u8>,
}

/// The file behind a [`FeedLog`], moved to a blocking thread for each write.
#[derive(Debug)]
struct OpenLog {
    path: PathBuf,
    file: Arc<File>,
    written: u64,
}

/// A sync in progress of all bytes that were written to a feed's log before it began.
#[derive(Debug)]
#[must_use = "nothing is durable before `end` returns"]
pub struct FeedSync {
    path: PathBuf,
    file: Arc<File>,
}

impl FeedSync {
    /// Returns once the bytes are durable; aborts the process if the sync fails.
    pub async fn end(self) -> VaultResult<()> {
        run_blocking(move || {
            disk::sync(&self.file, &self.path);
            Ok(())
        })
        .await
    }
}

impl Vault {
    /// Opens a feed's log, creates it if it is missing, and returns which frames and gaps it holds. The caller must
    /// ensure that it is opened only once at a time.
    pub async fn open_feed(&self, id: FeedId) -> VaultResult<(FeedLog, FrameNumbers)> {
        let path = path(&self.inner.data, id);
        run_blocking(move || {
            let mut file = match disk::open_to_write(&path) {
                Err(VaultError::NotFound) => disk::create(&path)?,
                found => found?,
            };
            let (written, numbers) = read_through(disk::open(&path)?, &path)?;
            file.set_len(written).map_err(failed("cutting", &path))?;
            file.seek(SeekFrom::Start(written)).map_err(failed("cutting", &path))?;
            // The bytes just read may be only in the system's cache, left there by a process that was killed.
            disk::sync(&file, &path);
            path.parent().into_iter().for_each(disk::sync_folder);
            let open = Some(Box::new(OpenLog { path, file: Arc::new(file), written }));
            Ok((FeedLog { open, waiting: Vec::new() }, numbers))
        })
        .await
    }

    /// Opens a feed's log for reading and returns its length.
    pub async fn read_feed(&self, id: FeedId) -> VaultResult<(File, u64)> {
        let path = path(&self.inner.data, id);
        run_blocking(move || {
            let file = disk::open(&path)?;
            let bytes = file.metadata().map_err(failed("measuring", &path))?.len();
            Ok((file, bytes))
        })
        .await
    }

    /// The frames that are lost in damaged records of a feed's log. Frames that were sent again are in later records
    /// and are not included. An incomplete record at the end is no damage: it was never acknowledged and may still be
    /// growing.
    pub async fn feed_damage(&self, id: FeedId) -> VaultResult<Vec<[u64; 2]>> {
        let path = path(&self.inner.data, id);
        run_blocking(move || missing_frames(disk::open(&path)?).map_err(failed("reading", &path))).await
    }

    /// Deletes a feed's log, after its row. A missing log is no error.
    pub async fn delete_feed(&self, id: FeedId) -> VaultResult<()> {
        let path = path(&self.inner.data, id);
        run_blocking(move || disk::remove(&path)).await
    }

    /// The feeds that have a log.
    pub async fn feed_logs(&self) -> VaultResult<Vec<FeedId>> {
        let folder = self.inner.data.join("feeds");
        run_blocking(move || disk::ids_in(&folder)).await
    }
}

impl FeedLog {
    /// Appends a record. Readers see it only after [`FeedLog::write_waiting`], and it is durable only after a sync.
    pub async fn append(&mut self, record: Bytes) -> VaultResult<()> {
        if self.waiting.len() + record.len() > MAX_WAITING {
            return self.write(record).await; // without copying it: the largest record would take its size twice
        }
        self.waiting.extend_from_slice(&record);
        Ok(())
    }

    /// Bytes appended so far, durable or not.
    pub fn bytes(&self) -> u64 {
        self.written() + self.waiting.len() as u64
    }

    /// Number of these bytes that readers can see.
    pub fn written(&self) -> u64 {
        self.open.as_ref().map_or(0, |open| open.written)
    }

    /// Writes all buffered bytes in one call on a blocking thread, so that readers can see them.
    pub async fn write_waiting(&mut self) -> VaultResult<()> {
        if self.waiting.is_empty() { Ok(()) } else { self.write(Bytes::new()).await }
    }

    /// Begins to sync everything appended so far; more may be appended meanwhile. After an error, everything since the
    /// last sync may be lost: open the log again.
    pub async fn begin_sync(&mut self) -> VaultResult<FeedSync> {
        self.write_waiting().await?;
        let open = self.open.as_ref().ok_or(VaultError::NotFound)?;
        Ok(FeedSync { path: open.path.clone(), file: open.file.clone() })
    }

    /// Makes everything appended durable.
    pub async fn sync(&mut self) -> VaultResult<()> {
        self.begin_sync().await?.end().await
    }

    /// Writes the buffered bytes, then a record.
    async fn write(&mut self, record: Bytes) -> VaultResult<()> {
        let mut open = self.open.take().ok_or(VaultError::NotFound)?;
        let mut bytes = std::mem::take(&mut self.waiting);
        let (open, bytes) = run_blocking(move || {
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

/// The end of the last whole record, and the frame numbers of all records.
fn read_through(file: File, path: &Path) -> VaultResult<(u64, FrameNumbers)> {
    let mut numbers = FrameNumbers::default();
    let end = read_all(file, |_, record| {
        // This fails only for more ranges than are ever accepted; records beyond that are treated as missing.
        let _ = numbers.add(record.number, record.last_number());
        io::Result::Ok(())
    });
    Ok((end.map_err(failed("reading", path))?, numbers))
}

/// The frame numbers that are missing, if there are damaged bytes before the end of the last whole record.
fn missing_frames(log: File) -> io::Result<Vec<[u64; 2]>> {
    let (mut whole, mut numbers) = (0, FrameNumbers::default());
    let end = read_all(log, |_, record| {
        whole += record.bytes() as u64;
        let _ = numbers.add(record.number, record.last_number()); // as in `read_through`
        io::Result::Ok(())
    })?;
    Ok(if whole == end { Vec::new() } else { numbers.missing_below(numbers.end()) })
}

fn path(data: &Path, id: FeedId) -> PathBuf {
    data.join("feeds").join(id.to_string())
}
