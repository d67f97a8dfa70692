//! The spool: captured frames that the server may not have, on the disk, as records of the protocol.
//!
//! ```text
//! SPOOL/lock                       one agent at a time
//! SPOOL/camera.json                the camera controls that are switched off now: see `controls`
//! SPOOL/<recording>/hello.json     the first message about it
//! SPOOL/<recording>/box            the box of the recording
//! SPOOL/<recording>/00000007.records   some MB of frames and gaps, with checksums
//! SPOOL/<recording>/closing        the number of frames was sent to the server
//! SPOOL/<recording>/start.json     when it began since the computer was started, until the server's time is known
//! SPOOL/<recording>/source-lost    why the recording ended, if the source was lost
//! ```
//! A record is in the spool before it is sent, and on the disk at most half a second later. Acknowledged records are
//! removed in whole segments. If the spool or the disk is full, the frames of the oldest segment are replaced by a gap.
//! Opening a spool reads it through and cuts off an incomplete record at the end of a file.

mod recording;
mod segment;
#[cfg(test)]
pub(super) mod testing;
#[cfg(test)]
mod tests;

pub use recording::{SpooledRecording, StartMoment};
pub use segment::RecordEntry;

use std::collections::BTreeMap;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::domain::feed::messages::Hello;
use crate::domain::feed::numbers::FrameNumbers;
use crate::domain::feed::record::FeedRecord;
use crate::ids::FeedId;

/// Usual length of a segment, bytes: small enough to be removed in one piece, and 4000 of them are 16 GiB.
const SEGMENT_BYTES: u64 = 4 << 20;
/// Segments of a small spool at the least.
const MIN_SEGMENTS: u64 = 8;

/// Suffix of folders that are being removed.
const REMOVED_SUFFIX: &str = "gone";

/// The recordings that may be incomplete on the server, by age.
#[derive(Debug)]
pub struct Spool {
    folder: PathBuf,
    max_bytes: u64,
    recordings: BTreeMap<FeedId, SpooledRecording>,
    /// The recording that is being made.
    live: Option<FeedId>,
    lock: File,
}

impl Drop for Spool {
    /// Unlocks explicitly: a child process that has just been started may hold a copy of the lock's descriptor.
    fn drop(&mut self) {
        let _ = self.lock.unlock(); // on failure it ends with the process
    }
}

impl Spool {
    /// Opens a spool that may grow to this many bytes, and creates it if it is missing.
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
            if path.extension().is_some_and(|suffix| suffix == REMOVED_SUFFIX) {
                fs::remove_dir_all(&path)?;
            }
            let Some(id) = path.file_name().and_then(|name| name.to_str()?.parse::<FeedId>().ok()) else { continue };
            match SpooledRecording::open(path.clone()) {
                Ok(recording) => drop(recordings.insert(id, recording)),
                Err(error) => {
                    tracing::warn!(folder = %path.display(), %error, "not a readable recording; folder left as it is")
                }
            }
        }
        Ok(Self { folder: folder.to_owned(), max_bytes: most_bytes, recordings, live: None, lock })
    }

    /// Begins the recording that later records are appended to.
    pub fn begin(&mut self, hello: Hello, in_box: &str) -> io::Result<FeedId> {
        self.begin_uncorrected(hello, in_box, None)
    }

    /// The same for a recording whose start is corrected once the server's time is known.
    pub fn begin_uncorrected(&mut self, hello: Hello, in_box: &str, start: Option<StartMoment>) -> io::Result<FeedId> {
        let id = hello.recording;
        let folder = self.path(id);
        let created = SpooledRecording::create(folder.clone(), hello, in_box, start).inspect_err(|error| {
            if error.kind() != io::ErrorKind::AlreadyExists {
                let _ = fs::remove_dir_all(folder); // without its hello it is no recording
            }
        });
        self.recordings.insert(id, created?);
        self.live = Some(id);
        Ok(id)
    }

    /// Notes that the live recording ends because its source is lost.
    pub fn note_source_lost(&mut self, why: &str) -> io::Result<()> {
        let live = self.live.and_then(|id| self.recordings.get_mut(&id));
        live.map_or(Ok(()), |recording| recording.note_source_lost(why))
    }

    /// Notes that the live recording is broken off: the agent ends while it is recorded.
    pub fn note_broken_off(&mut self, why: &str) {
        if let Some(recording) = self.live.and_then(|id| self.recordings.get_mut(&id)) {
            recording.broken_off = Some(why.to_owned());
        }
    }

    /// Ends the live recording. Frames that did not fit are recorded as a gap, if there is space for that now;
    /// otherwise the server asks for them.
    pub fn end_live(&mut self) {
        let segment_bytes = self.segment_bytes();
        let Some(recording) = self.live.take().and_then(|id| self.recordings.get_mut(&id)) else { return };
        if let Err(error) = recording.write_unwritten(segment_bytes) {
            tracing::warn!(%error, "no space for the last frames; the server will report them missing");
        }
        if let Err(error) = recording.note_end() {
            tracing::warn!(%error, "the end cannot be noted; after a restart the recording counts as broken off");
        }
    }

    /// The recording that records are appended to.
    pub fn live(&self) -> Option<FeedId> {
        self.live
    }

    /// All recordings, oldest first.
    pub fn ids(&self) -> Vec<FeedId> {
        self.recordings.keys().copied().collect()
    }

    /// A recording.
    pub fn get(&self, id: FeedId) -> Option<&SpooledRecording> {
        self.recordings.get(&id)
    }

    /// Folder of a recording.
    pub fn path(&self, id: FeedId) -> PathBuf {
        self.folder.join(id.to_string())
    }

    /// Length of all records, bytes.
    pub fn bytes(&self) -> u64 {
        self.recordings.values().map(SpooledRecording::record_bytes).sum()
    }

    /// How much it may grow before frames are dropped, bytes.
    pub fn room(&self) -> u64 {
        // A disk that does not say how much is free has no limit of its own.
        let disk = rustix::fs::statvfs(&self.folder).ok();
        let free = disk.map_or(u64::MAX, |disk| disk.f_bavail.saturating_mul(disk.f_frsize));
        free.min(self.max_bytes.saturating_sub(self.bytes()))
    }

    /// The most that it may hold, bytes.
    pub fn max_bytes(&self) -> u64 {
        self.max_bytes
    }

    /// Appends a record to the live recording. If there is no space, the oldest frames are dropped; if that is not
    /// enough, this record becomes a gap.
    pub fn append(&mut self, record: &FeedRecord<'_>) -> io::Result<()> {
        let Some(id) = self.live else { return Ok(()) };
        let segment_bytes = self.segment_bytes();
        loop {
            let is_full = self.bytes() + record.bytes() as u64 > self.max_bytes;
            let Some(recording) = self.recordings.get_mut(&id) else { return Ok(()) };
            let appended = match is_full {
                true => Err(io::ErrorKind::StorageFull.into()),
                false => recording.append(record, segment_bytes),
            };
            match appended {
                Err(error) if is_disk_full(&error) => {
                    if !self.drop_oldest()? {
                        self.recordings.get_mut(&id).into_iter().for_each(|recording| recording.mark_lost(record));
                        return Err(error);
                    }
                }
                done => return done,
            }
        }
    }

    fn segment_bytes(&self) -> u64 {
        SEGMENT_BYTES.min(self.max_bytes / MIN_SEGMENTS)
    }

    /// Drops the oldest frames; those of the live recording last, even if the clock was wrong when it began.
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

    /// The files to sync so that all records are on the disk. New records are not delayed.
    pub fn take_unsynced(&mut self) -> Vec<Arc<File>> {
        self.recordings.values_mut().flat_map(SpooledRecording::take_unsynced).collect()
    }

    /// The bytes of a record.
    pub fn read(&mut self, id: FeedId, entry: RecordEntry) -> Option<Vec<u8>> {
        self.recordings.get_mut(&id)?.read(entry)
    }

    /// The server has these numbers: removes segments that it has completely.
    pub fn acknowledge(&mut self, id: FeedId, durable: FrameNumbers) -> io::Result<()> {
        let Some(recording) = self.recordings.get_mut(&id) else { return Ok(()) };
        recording.end = recording.end.max(durable.end());
        recording.durable = durable;
        recording.drop_acknowledged()
    }

    /// Notes that the number of frames is being sent to the server.
    pub fn close(&mut self, id: FeedId) -> io::Result<()> {
        self.recordings.get_mut(&id).map_or(Ok(()), SpooledRecording::close)
    }

    /// Corrects when a recording began. The server must not have heard of it yet.
    pub fn set_start(&mut self, id: FeedId, began_at: String) -> io::Result<()> {
        self.recordings.get_mut(&id).map_or(Ok(()), |recording| recording.set_start(began_at))
    }

    /// Makes the remaining frames of a recording that the server ended too early another recording.
    pub fn renew(&mut self, id: FeedId, new: FeedId) -> io::Result<()> {
        let path = self.path(new);
        let Some(recording) = self.recordings.get_mut(&id) else { return Ok(()) };
        let hello = Hello { recording: new, ..recording.hello.clone() };
        recording.renew(path, hello)?; // on failure it stays unchanged, and frames are still appended to it
        let renewed = self.recordings.remove(&id);
        self.recordings.extend(renewed.map(|recording| (new, recording)));
        self.live = self.live.map(|live| if live == id { new } else { live });
        Ok(())
    }

    /// Removes a recording.
    pub fn remove(&mut self, id: FeedId) -> io::Result<()> {
        self.recordings.remove(&id);
        let gone = self.path(id).with_extension(REMOVED_SUFFIX); // one step: no half-removed recording remains
        fs::rename(self.path(id), &gone)?;
        fs::remove_dir_all(gone)
    }
}

/// True if an error says that there is no space.
pub(super) fn is_disk_full(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge)
}
