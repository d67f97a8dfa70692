//! A file of records, some MB long, with the position of each record.

use std::fs::{self, File};
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::domain::feed::numbers::FrameNumbers;
use crate::domain::feed::record::{FeedRecord, GapReason, RecordBody, read_all};

/// Suffix of segment files.
const SUFFIX: &str = "records";

/// Position and numbers of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordEntry {
    /// The frame's number, or the gap's first.
    pub number: u64,
    /// The last number that it covers.
    pub last: u64,
    /// True for a frame that can be decoded without earlier ones.
    pub is_key: bool,
    /// Its length, bytes.
    pub bytes: usize,
    gap: Option<GapReason>,
    offset: u64,
}

impl RecordEntry {
    fn from_record(record: &FeedRecord<'_>, offset: u64, bytes: usize) -> Self {
        let (is_key, gap) = match record.body {
            RecordBody::Frame { is_key, .. } => (is_key, None),
            RecordBody::Gap { reason, .. } => (false, Some(reason)),
        };
        Self { number: record.number, last: record.last_number(), is_key, bytes, gap, offset }
    }

    /// True for a frame, false for a gap.
    pub fn is_frame(&self) -> bool {
        self.gap.is_none()
    }

    /// True if all its numbers are among these.
    pub fn is_in(&self, numbers: &FrameNumbers) -> bool {
        numbers.contains_all(self.number, self.last)
    }
}

/// A file of records with rising numbers.
#[derive(Debug)]
pub(super) struct SpoolSegment {
    path: PathBuf,
    pub(super) entries: Vec<RecordEntry>,
    pub(super) bytes: u64,
}

impl SpoolSegment {
    /// Creates a segment; returns it and its file for appending.
    pub(super) fn create(folder: &Path, serial: u64) -> io::Result<(Self, Arc<File>)> {
        let path = folder.join(format!("{serial:08}.{SUFFIX}"));
        let file = File::create_new(&path)?;
        sync_folder(folder)?;
        Ok((Self { path, entries: Vec::new(), bytes: 0 }, Arc::new(file)))
    }

    /// Opens an existing segment and cuts off an incomplete record at its end.
    pub(super) fn open(path: PathBuf) -> io::Result<Self> {
        let file = File::options().read(true).write(true).open(&path)?;
        let mut entries: Vec<RecordEntry> = Vec::new();
        let bytes = read_all(&file, |place, record| {
            let mut written = Vec::new();
            record.write(&mut written);
            entries.push(RecordEntry::from_record(&record, place, written.len()));
            io::Result::Ok(())
        })?;
        file.set_len(bytes)?;
        file.sync_data()?;
        Ok(Self { path, entries, bytes })
    }

    /// The segments in a folder with their serial numbers, in order.
    pub(super) fn paths_in(folder: &Path) -> io::Result<Vec<(u64, PathBuf)>> {
        let mut found = Vec::new();
        for entry in fs::read_dir(folder)? {
            let path = entry?.path();
            let serial = path.file_stem().and_then(|stem| stem.to_str()?.parse().ok());
            if let Some(serial) = serial.filter(|_| path.extension().is_some_and(|suffix| suffix == SUFFIX)) {
                found.push((serial, path));
            }
        }
        found.sort();
        Ok(found)
    }

    /// Appends a record; on failure the segment is unchanged.
    pub(super) fn append(&mut self, file: &File, record: &FeedRecord<'_>) -> io::Result<()> {
        let mut written = Vec::new();
        record.write(&mut written);
        if let Err(error) = file.write_all_at(&written, self.bytes) {
            file.set_len(self.bytes)?;
            return Err(error);
        }
        self.entries.push(RecordEntry::from_record(record, self.bytes, written.len()));
        self.bytes += written.len() as u64;
        Ok(())
    }

    /// The bytes of a record.
    pub(super) fn read(&self, entry: RecordEntry) -> io::Result<Vec<u8>> {
        let mut bytes = vec![0; entry.bytes];
        File::open(&self.path)?.read_exact_at(&mut bytes, entry.offset)?;
        Ok(bytes)
    }

    /// One more than its last number.
    pub(super) fn end(&self) -> u64 {
        self.entries.last().map_or(0, |entry| entry.last + 1)
    }

    /// True if it contains a frame.
    pub(super) fn has_frames(&self) -> bool {
        self.entries.iter().any(RecordEntry::is_frame)
    }

    /// The range of its gap, if the segment is one gap because the spool was full.
    pub(super) fn sole_gap(&self) -> Option<[u64; 2]> {
        match self.entries[..] {
            [RecordEntry { number, last, gap: Some(GapReason::SpoolFull), .. }] => Some([number, last]),
            _ => None,
        }
    }

    /// Replaces its frames by gaps for the numbers that are not durable elsewhere. The gaps overwrite the start of the
    /// file, so even a full disk has space for them; a power cut in between leaves gaps without records after them. A
    /// gap right before (`before`) is joined to the first one; then the result is `true`.
    pub(super) fn replace_with_gaps(&mut self, durable: &FrameNumbers, before: Option<[u64; 2]>) -> io::Result<bool> {
        let mut gaps: Vec<(u64, u64, GapReason)> = Vec::new();
        for entry in self.entries.iter().filter(|entry| !entry.is_in(durable)) {
            let reason = entry.gap.unwrap_or(GapReason::SpoolFull);
            match gaps.last_mut() {
                Some(gap) if gap.1 + 1 == entry.number && gap.2 == reason => gap.1 = entry.last,
                _ => gaps.push((entry.number, entry.last, reason)),
            }
        }
        let joined = match (before, gaps.first_mut()) {
            (Some([from, last]), Some(gap)) if gap.0 == last + 1 && gap.2 == GapReason::SpoolFull => {
                gap.0 = from;
                true
            }
            _ => false,
        };
        let (mut bytes, mut entries) = (Vec::new(), Vec::new());
        for (number, last, reason) in gaps {
            let record = FeedRecord { epoch: 0, number, body: RecordBody::Gap { last, reason } };
            let offset = bytes.len();
            record.write(&mut bytes);
            entries.push(RecordEntry::from_record(&record, offset as u64, bytes.len() - offset));
        }
        let file = File::options().write(true).open(&self.path)?;
        file.write_all_at(&bytes, 0)?;
        file.set_len(bytes.len() as u64)?;
        file.sync_data()?;
        (self.entries, self.bytes) = (entries, bytes.len() as u64);
        Ok(joined)
    }

    /// The segment's folder has been renamed.
    pub(super) fn move_to(&mut self, folder: &Path) {
        self.path = self.path.file_name().map_or_else(|| self.path.clone(), |name| folder.join(name));
    }

    /// Removes its file; a missing file is no error.
    pub(super) fn remove(&self) -> io::Result<()> {
        match fs::remove_file(&self.path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
            done => done,
        }
    }
}

/// Makes the file names in the folder durable.
pub(super) fn sync_folder(path: &Path) -> io::Result<()> {
    File::open(path)?.sync_all()
}
