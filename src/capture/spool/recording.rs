//! A recording in the spool: its hello and its segments.

use std::collections::VecDeque;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::segment::{RecordEntry, SpoolSegment, sync_folder};
use crate::domain::feed::messages::Hello;
use crate::domain::feed::numbers::FrameNumbers;
use crate::domain::feed::record::{FeedRecord, GapReason, RecordBody};

const HELLO: &str = "hello.json";
const BOX: &str = "box";
const SOURCE_LOST: &str = "source-lost";
/// Exists until the start of the recording is corrected.
const START: &str = "start.json";
/// Files that earlier versions made of a recording without a name.
const EARLIER_FILES: [&str; 2] = ["recording.mp4", "recording.new"];
/// Exists once the number of frames was sent to the server: only then can an ended recording be complete.
const CLOSING: &str = "closing";
/// There while it is recorded: if a later run finds it, the recording was broken off.
const RECORDS: &str = "records";

/// A moment since the computer was started. Nothing sets this clock, and it ends with a restart of the computer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StartMoment {
    /// Id of the computer's start.
    pub boot: String,
    /// Time since then, ms.
    pub since_boot_ms: i64,
}

/// A recording in the spool.
#[derive(Debug)]
pub struct SpooledRecording {
    /// The first message about it.
    pub hello: Hello,
    /// The box given to the agent at recording time; `None` for recordings of earlier versions.
    pub in_box: Option<String>,
    /// When it began, if the clock of the computer was not compared with the server by then: the hello may have a wrong
    /// time.
    pub uncorrected_start: Option<StartMoment>,
    /// Why it ended, if its source was lost.
    pub source_lost: Option<String>,
    /// Why it was broken off, if the agent ended while it was recorded.
    pub broken_off: Option<String>,
    /// The numbers that the server has.
    pub durable: FrameNumbers,
    /// One more than the largest number so far.
    pub end: u64,
    pub(super) folder: PathBuf,
    pub(super) segments: VecDeque<SpoolSegment>,
    next_serial: u64,
    /// The last segment's file, while records are appended to it.
    active: Option<Arc<File>>,
    unsynced: Vec<Arc<File>>,
    /// Numbers for which there was no disk space: written as a gap as soon as there is some.
    unwritten: Option<[u64; 2]>,
    is_closing: bool,
}

/// Why a recording was broken off that a later run finds.
const KILLED: &str = "the agent, or its computer, was switched off while it recorded";

impl SpooledRecording {
    /// Creates a recording; its folder and hello are then on the disk.
    pub(super) fn create(folder: PathBuf, hello: Hello, in_box: &str, start: Option<StartMoment>) -> io::Result<Self> {
        fs::create_dir(&folder)?;
        let mut file = File::create(folder.join(BOX))?;
        file.write_all(in_box.as_bytes())?;
        file.sync_all()?;
        if let Some(start) = &start {
            let mut file = File::create(folder.join(START))?;
            file.write_all(&serde_json::to_vec(start)?)?;
            file.sync_all()?;
        }
        File::create(folder.join(RECORDS))?.sync_all()?;
        write_hello(&folder, &hello)?; // last: it makes the folder a recording
        folder.parent().map_or(Ok(()), sync_folder)?;
        Ok(Self { uncorrected_start: start, ..Self::new(folder, hello, Some(in_box.to_owned())) })
    }

    /// Opens a recording of an earlier run; its last segment may be cut off.
    pub(super) fn open(folder: PathBuf) -> io::Result<Self> {
        let hello = serde_json::from_slice(&fs::read(folder.join(HELLO))?)?;
        let in_box = match fs::read_to_string(folder.join(BOX)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            read => Some(read?),
        };
        let mut recording = Self::new(folder.clone(), hello, in_box);
        for (serial, path) in SpoolSegment::paths_in(&folder)? {
            let segment = SpoolSegment::open(path)?;
            recording.next_serial = serial + 1;
            recording.end = recording.end.max(segment.end());
            if segment.entries.is_empty() {
                segment.remove()?;
            } else {
                recording.segments.push_back(segment);
            }
        }
        recording.uncorrected_start = match fs::read(folder.join(START)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            // A damaged file: the start is of no known boot, so its time is not used.
            read => {
                Some(serde_json::from_slice(&read?).unwrap_or(StartMoment { boot: String::new(), since_boot_ms: 0 }))
            }
        };
        recording.source_lost = fs::read_to_string(folder.join(SOURCE_LOST)).ok();
        recording.is_closing = folder.join(CLOSING).exists();
        recording.broken_off = folder.join(RECORDS).exists().then(|| KILLED.to_owned());
        EARLIER_FILES.iter().try_for_each(|file| remove_if_there(&folder.join(file)))?;
        Ok(recording)
    }

    fn new(folder: PathBuf, hello: Hello, in_box: Option<String>) -> Self {
        Self {
            hello,
            in_box,
            uncorrected_start: None,
            source_lost: None,
            broken_off: None,
            durable: FrameNumbers::default(),
            end: 0,
            folder,
            segments: VecDeque::new(),
            next_serial: 0,
            active: None,
            unsynced: Vec::new(),
            unwritten: None,
            is_closing: false,
        }
    }

    /// True for a recording without a name: it is sent as a file, and waits for a name on the server.
    pub fn is_unnamed(&self) -> bool {
        self.hello.trainee.is_empty()
    }

    /// Length of its records, bytes.
    pub fn record_bytes(&self) -> u64 {
        self.segments.iter().map(|segment| segment.bytes).sum()
    }

    /// Corrects when it began.
    pub(super) fn set_start(&mut self, began_at: String) -> io::Result<()> {
        let hello = Hello { began_at, ..self.hello.clone() };
        write_hello(&self.folder, &hello)?;
        self.hello = hello;
        remove_if_there(&self.folder.join(START))?; // if it stays, the start is corrected once more, to the same time
        self.uncorrected_start = None;
        Ok(())
    }

    /// The first record that covers this number or a later one.
    pub fn at_or_after(&self, number: u64) -> Option<RecordEntry> {
        let segment = self.segments.get(self.segments.partition_point(|segment| segment.end() <= number))?;
        segment.entries.get(segment.entries.partition_point(|entry| entry.last < number)).copied()
    }

    /// Number of the newest frame that can be decoded without earlier ones.
    pub fn newest_key(&self) -> Option<u64> {
        let mut entries = self.segments.iter().rev().flat_map(|segment| segment.entries.iter().rev());
        entries.find(|entry| entry.is_key).map(|entry| entry.number)
    }

    /// Number and bytes of the frames that the server has not acknowledged.
    pub fn waiting(&self) -> (u64, u64) {
        let entries = self.segments.iter().flat_map(|segment| &segment.entries);
        let waiting = entries.filter(|entry| entry.is_frame() && !entry.is_in(&self.durable));
        waiting.fold((0, 0), |(frames, bytes), entry| (frames + 1, bytes + entry.bytes as u64))
    }

    /// True if the server has every record of the spool.
    pub fn is_acknowledged(&self) -> bool {
        self.segments.iter().flat_map(|segment| &segment.entries).all(|entry| entry.is_in(&self.durable))
    }

    /// True if the number of frames was sent to the server.
    pub fn is_closing(&self) -> bool {
        self.is_closing
    }

    /// Notes that it ends because its source is lost.
    pub(super) fn note_source_lost(&mut self, why: &str) -> io::Result<()> {
        self.source_lost = Some(why.to_owned()); // known to this run even if it cannot be written
        let mut file = File::create(self.folder.join(SOURCE_LOST))?;
        file.write_all(why.as_bytes())?;
        file.sync_all()?;
        sync_folder(&self.folder)
    }

    /// Notes that it is not recorded any more. A later run finds that a recording was broken off.
    pub(super) fn note_end(&mut self) -> io::Result<()> {
        if self.broken_off.is_some() {
            return Ok(());
        }
        remove_if_there(&self.folder.join(RECORDS))?;
        sync_folder(&self.folder)
    }

    /// Notes that the number of frames is being sent to the server.
    pub(super) fn close(&mut self) -> io::Result<()> {
        if !self.is_closing {
            self.active = None;
            File::create(self.folder.join(CLOSING))?.sync_all()?;
            sync_folder(&self.folder)?;
            self.is_closing = true;
        }
        Ok(())
    }

    /// Turns it into another recording, with a new id and folder that the server does not know.
    pub(super) fn renew(&mut self, folder: PathBuf, hello: Hello) -> io::Result<()> {
        write_hello(&self.folder, &hello)?;
        fs::rename(&self.folder, &folder)?;
        folder.parent().map_or(Ok(()), sync_folder)?;
        self.segments.iter_mut().for_each(|segment| segment.move_to(&folder));
        (self.hello, self.folder, self.durable, self.active) = (hello, folder, FrameNumbers::default(), None);
        Ok(())
    }

    pub(super) fn append(&mut self, record: &FeedRecord<'_>, segment_bytes: u64) -> io::Result<()> {
        self.write_unwritten(segment_bytes)?;
        self.write(record, segment_bytes)
    }

    /// Writes the gap for the numbers that found no disk space.
    pub(super) fn write_unwritten(&mut self, segment_bytes: u64) -> io::Result<()> {
        if let Some([number, last]) = self.unwritten {
            let body = RecordBody::Gap { last, reason: GapReason::SpoolFull };
            self.write(&FeedRecord { epoch: 0, number, body }, segment_bytes)?;
            self.unwritten = None;
        }
        Ok(())
    }

    /// There is no disk space for this record: its numbers become a gap.
    pub(super) fn mark_lost(&mut self, record: &FeedRecord<'_>) {
        let first = self.unwritten.map_or(record.number, |[first, _]| first);
        self.unwritten = Some([first, record.last_number()]);
        self.end = self.end.max(record.last_number() + 1);
    }

    fn write(&mut self, record: &FeedRecord<'_>, segment_bytes: u64) -> io::Result<()> {
        if self.segments.back().is_none_or(|segment| segment.bytes >= segment_bytes) {
            self.active = None;
        }
        let file = match &self.active {
            Some(file) => file.clone(),
            None => {
                let serial = self.next_serial;
                self.next_serial += 1; // before creating: the file may exist although creating it failed
                let (segment, file) = SpoolSegment::create(&self.folder, serial)?;
                self.segments.push_back(segment);
                self.active.insert(file).clone()
            }
        };
        if let Some(segment) = self.segments.back_mut()
            && let Err(error) = segment.append(&file, record)
        {
            if segment.entries.is_empty() {
                // A segment without a record has no place in the order of numbers.
                segment.remove()?;
                self.segments.pop_back();
                self.active = None;
            }
            return Err(error);
        }
        if !self.unsynced.iter().any(|unsynced| Arc::ptr_eq(unsynced, &file)) {
            self.unsynced.push(file);
        }
        self.end = self.end.max(record.last_number() + 1);
        Ok(())
    }

    /// Files with records that may not be on the disk yet.
    pub(super) fn take_unsynced(&mut self) -> Vec<Arc<File>> {
        std::mem::take(&mut self.unsynced)
    }

    /// The bytes of a record. An unreadable record is dropped and is a hole from then on.
    pub(super) fn read(&mut self, wanted: RecordEntry) -> Option<Vec<u8>> {
        let at = self.segments.partition_point(|segment| segment.end() <= wanted.number);
        let segment = self.segments.get_mut(at)?;
        match segment.read(wanted) {
            Ok(bytes) if FeedRecord::read(&bytes).is_ok() => Some(bytes),
            damaged => {
                let why = damaged.err().map_or("its checksum does not match".to_owned(), |error| error.to_string());
                tracing::error!(number = wanted.number, why, "frame in the spool is unreadable and lost");
                segment.entries.retain(|entry| *entry != wanted);
                if self.segments.back().is_some_and(|segment| segment.entries.is_empty()) {
                    self.active = None;
                }
                self.segments.retain(|segment| !segment.entries.is_empty());
                None
            }
        }
    }

    /// Removes segments that the server has completely.
    pub(super) fn drop_acknowledged(&mut self) -> io::Result<()> {
        let active = usize::from(self.active.is_some());
        for at in (0..self.segments.len().saturating_sub(active)).rev() {
            if self.segments[at].entries.iter().all(|entry| entry.is_in(&self.durable)) {
                self.segments[at].remove()?;
                self.segments.remove(at);
            }
        }
        Ok(())
    }

    /// Drops the frames of the oldest segment that has frames; `false` if there is none.
    pub(super) fn drop_oldest(&mut self) -> io::Result<bool> {
        let Some(at) = self.segments.iter().position(SpoolSegment::has_frames) else { return Ok(false) };
        if at + 1 == self.segments.len() {
            self.active = None;
        }
        let before = at.checked_sub(1).and_then(|before| self.segments[before].sole_gap());
        if self.segments[at].replace_with_gaps(&self.durable, before)? {
            self.segments[at - 1].remove()?;
            self.segments.remove(at - 1);
        }
        self.drop_acknowledged()?;
        Ok(true)
    }
}

fn remove_if_there(path: &Path) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        done => done,
    }
}

/// Writes the hello in one step: the file is complete or absent.
fn write_hello(folder: &Path, hello: &Hello) -> io::Result<()> {
    let new = folder.join("hello.new");
    let mut file = File::create(&new)?;
    file.write_all(&serde_json::to_vec(hello)?)?;
    file.sync_all()?;
    fs::rename(&new, folder.join(HELLO))?;
    sync_folder(folder)
}
