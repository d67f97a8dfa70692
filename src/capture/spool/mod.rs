//! What was captured and is not known to be on the server: on the disk, in the records of the protocol.
//!
//! ```text
//! SPOOL/lock                       one agent at a time
//! SPOOL/camera.json                what is switched off at the camera, while it is: see `controls`
//! SPOOL/<recording>/hello.json     what is said of it first
//! SPOOL/<recording>/box            in which box it was recorded
//! SPOOL/<recording>/00000007.records   some MB of frames and gaps, with their checksums
//! SPOOL/<recording>/closing        the server was told how many frames there are
//! ```
//! A record is in the spool before it is sent, and on the disk half a second later at most. What the server acknowledged
//! goes, in whole segments. When the spool is full, or the disk, the oldest segment's frames go and a gap stays in their
//! place. Opening a spool reads it through and cuts off whatever is no whole record at the end of a file.

mod recording;
mod segment;
#[cfg(test)]
pub(super) mod testing;
#[cfg(test)]
mod tests;

pub use recording::Recording;
pub use segment::Entry;

use std::collections::BTreeMap;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::domain::feed::numbers::Numbers;
use crate::domain::feed::record::Record;
use crate::domain::feed::words::Hello;
use crate::ids::FeedId;

/// A segment's usual length, bytes: little enough to go at once, and 4000 of them are 16 GiB.
const SEGMENT_BYTES: u64 = 4 << 20;
/// A small spool has at least so many segments.
const LEAST_SEGMENTS: u64 = 8;

/// How the names of folders end that are being removed.
const GONE: &str = "gone";

/// The recordings that are not known to be whole on the server, by age.
#[derive(Debug)]
pub struct Spool {
    folder: PathBuf,
    most_bytes: u64,
    recordings: BTreeMap<FeedId, Recording>,
    /// The one that is being recorded.
    live: Option<FeedId>,
    lock: File,
}

impl Drop for Spool {
    /// By itself the lock would outlive this where a child of the process has just been started and holds a copy.
    fn drop(&mut self) {
        let _ = self.lock.unlock(); // else it ends with the process
    }
}

impl Spool {
    /// Opens a spool, made if it is missing, that may grow to so many bytes.
    ///
    /// # Errors
    /// Another agent has it open, or the file system fails.
    pub fn open(folder: &Path, most_bytes: u64) -> io::Result<Self> {
        fs::create_dir_all(folder)?;
        let lock = File::create(folder.join("lock"))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(io::Error::new(io::ErrorKind::ResourceBusy, "another agent uses this spool"));
            }
            Err(TryLockError::Error(error)) => return Err(error),
        }
        let mut recordings = BTreeMap::new();
        for entry in fs::read_dir(folder)? {
            let path = entry?.path();
            if path.extension().is_some_and(|suffix| suffix == GONE) {
                fs::remove_dir_all(&path)?;
            }
            let Some(id) = path.file_name().and_then(|name| name.to_str()?.parse::<FeedId>().ok()) else { continue };
            match Recording::open(path.clone()) {
                Ok(recording) => drop(recordings.insert(id, recording)),
                Err(error) => tracing::warn!(folder = %path.display(), %error, "no recording: it is left as it is"),
            }
        }
        Ok(Self { folder: folder.to_owned(), most_bytes, recordings, live: None, lock })
    }

    /// Begins the recording to which records are appended from now on.
    pub fn begin(&mut self, hello: Hello, in_box: &str) -> io::Result<FeedId> {
        let id = hello.recording;
        self.recordings.insert(id, Recording::create(self.path(id), hello, in_box)?);
        self.live = Some(id);
        Ok(id)
    }

    /// No more records come. What had no room at last is told as a gap, if there is room for that now; else the server asks.
    pub fn end(&mut self) {
        let segment_bytes = self.segment_bytes();
        if let Some(recording) = self.live.take().and_then(|id| self.recordings.get_mut(&id))
            && let Err(error) = recording.write_unwritten(segment_bytes)
        {
            tracing::warn!(%error, "the last frames had no room, and not even the gap in their place has");
        }
    }

    /// The recording to which records are appended.
    pub fn live(&self) -> Option<FeedId> {
        self.live
    }

    /// All recordings, the oldest first.
    pub fn ids(&self) -> Vec<FeedId> {
        self.recordings.keys().copied().collect()
    }

    /// A recording.
    pub fn get(&self, id: FeedId) -> Option<&Recording> {
        self.recordings.get(&id)
    }

    /// Where a recording lies.
    pub fn path(&self, id: FeedId) -> PathBuf {
        self.folder.join(id.to_string())
    }

    /// Bytes of all records.
    pub fn bytes(&self) -> u64 {
        let segments = self.recordings.values().flat_map(|recording| &recording.segments);
        segments.map(|segment| segment.bytes).sum()
    }

    /// Appends a record to the live recording. Where there is no room, the oldest frames go; where there is none even so,
    /// this one is a gap.
    pub fn append(&mut self, record: &Record<'_>) -> io::Result<()> {
        let Some(id) = self.live else { return Ok(()) };
        let segment_bytes = self.segment_bytes();
        loop {
            let is_full = self.bytes() + record.bytes() as u64 > self.most_bytes;
            let Some(recording) = self.recordings.get_mut(&id) else { return Ok(()) };
            let appended = match is_full {
                true => Err(io::ErrorKind::StorageFull.into()),
                false => recording.append(record, segment_bytes),
            };
            match appended {
                Err(error) if is_for_want_of_space(&error) => {
                    if !self.drop_oldest()? {
                        self.recordings.get_mut(&id).into_iter().for_each(|recording| recording.give_up(record));
                        return Err(error);
                    }
                }
                done => return done,
            }
        }
    }

    fn segment_bytes(&self) -> u64 {
        SEGMENT_BYTES.min(self.most_bytes / LEAST_SEGMENTS)
    }

    /// Gives up the oldest frames; those of the live recording last, whatever the clock said when it began.
    fn drop_oldest(&mut self) -> io::Result<bool> {
        for is_live in [false, true] {
            for (id, recording) in &mut self.recordings {
                if (self.live == Some(*id)) == is_live && recording.drop_oldest()? {
                    return Ok(true);
                }
            }
        }
        Ok(false)
    }

    /// Files that must be synced for all records to be on the disk; without holding up who appends meanwhile.
    pub fn take_unsynced(&mut self) -> Vec<Arc<File>> {
        self.recordings.values_mut().flat_map(Recording::take_unsynced).collect()
    }

    /// The bytes of a record.
    pub fn read(&mut self, id: FeedId, entry: Entry) -> Option<Vec<u8>> {
        self.recordings.get_mut(&id)?.read(entry)
    }

    /// The server has these: whole segments of them go.
    pub fn acknowledge(&mut self, id: FeedId, durable: Numbers) -> io::Result<()> {
        let Some(recording) = self.recordings.get_mut(&id) else { return Ok(()) };
        recording.end = recording.end.max(durable.end());
        recording.durable = durable;
        recording.let_go()
    }

    /// Notes that the server is told next how many frames there are.
    pub fn close(&mut self, id: FeedId) -> io::Result<()> {
        self.recordings.get_mut(&id).map_or(Ok(()), Recording::close)
    }

    /// Makes another recording of what is left of one that the server ended too early.
    pub fn renew(&mut self, id: FeedId, new: FeedId) -> io::Result<()> {
        let path = self.path(new);
        let Some(recording) = self.recordings.get_mut(&id) else { return Ok(()) };
        let hello = Hello { recording: new, ..recording.hello.clone() };
        recording.renew(path, hello)?; // else it stays what it was, and frames go on into it
        let renewed = self.recordings.remove(&id);
        self.recordings.extend(renewed.map(|recording| (new, recording)));
        self.live = self.live.map(|live| if live == id { new } else { live });
        Ok(())
    }

    /// Forgets a recording.
    pub fn remove(&mut self, id: FeedId) -> io::Result<()> {
        self.recordings.remove(&id);
        let gone = self.path(id).with_extension(GONE); // in one step: half a recording is none
        fs::rename(self.path(id), &gone)?;
        fs::remove_dir_all(gone)
    }
}

fn is_for_want_of_space(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge)
}
