//! A recording in the spool: its hello and its segments.

use std::collections::VecDeque;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::segment::{Entry, Segment, sync_folder};
use crate::domain::feed::numbers::Numbers;
use crate::domain::feed::record::{Body, GapReason, Record};
use crate::domain::feed::words::Hello;

const HELLO: &str = "hello.json";
const BOX: &str = "box";
/// Is there once the server was told how many frames there are: only then is a recording that has ended whole.
const CLOSING: &str = "closing";

/// A recording in the spool.
#[derive(Debug)]
pub struct Recording {
    /// What is said of it first.
    pub hello: Hello,
    /// The box in which it was recorded, as the agent was told it; agents of earlier versions did not write it down.
    pub in_box: Option<String>,
    /// What the server has.
    pub durable: Numbers,
    /// One more than its largest number so far.
    pub end: u64,
    pub(super) folder: PathBuf,
    pub(super) segments: VecDeque<Segment>,
    next_serial: u64,
    /// The last segment's file, while records are appended to it.
    active: Option<Arc<File>>,
    unsynced: Vec<Arc<File>>,
    /// Numbers for which there was no room at all: told as a gap as soon as there is some.
    unwritten: Option<[u64; 2]>,
    is_closing: bool,
}

impl Recording {
    /// A new one: its folder and hello are on the disk.
    pub(super) fn create(folder: PathBuf, hello: Hello, in_box: &str) -> io::Result<Self> {
        fs::create_dir(&folder)?;
        let mut file = File::create(folder.join(BOX))?;
        file.write_all(in_box.as_bytes())?;
        file.sync_all()?;
        write_hello(&folder, &hello)?; // last: it makes the folder a recording
        folder.parent().map_or(Ok(()), sync_folder)?;
        Ok(Self::new(folder, hello, Some(in_box.to_owned())))
    }

    /// One of an earlier run; its last segment may have been cut.
    pub(super) fn open(folder: PathBuf) -> io::Result<Self> {
        let hello = serde_json::from_slice(&fs::read(folder.join(HELLO))?)?;
        let in_box = match fs::read_to_string(folder.join(BOX)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            read => Some(read?),
        };
        let mut recording = Self::new(folder.clone(), hello, in_box);
        for (serial, path) in Segment::paths_in(&folder)? {
            let segment = Segment::open(path)?;
            recording.next_serial = serial + 1;
            recording.end = recording.end.max(segment.end());
            if segment.entries.is_empty() {
                segment.remove()?;
            } else {
                recording.segments.push_back(segment);
            }
        }
        recording.is_closing = folder.join(CLOSING).exists();
        Ok(recording)
    }

    fn new(folder: PathBuf, hello: Hello, in_box: Option<String>) -> Self {
        Self {
            hello,
            in_box,
            durable: Numbers::default(),
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

    /// The first record that speaks of this number or a later one.
    pub fn at_or_after(&self, number: u64) -> Option<Entry> {
        let segment = self.segments.get(self.segments.partition_point(|segment| segment.end() <= number))?;
        segment.entries.get(segment.entries.partition_point(|entry| entry.last < number)).copied()
    }

    /// The newest frame that can be decoded without the ones before.
    pub fn newest_key(&self) -> Option<u64> {
        let mut entries = self.segments.iter().rev().flat_map(|segment| segment.entries.iter().rev());
        entries.find(|entry| entry.is_key).map(|entry| entry.number)
    }

    /// Frames that the server has not acknowledged, and their bytes.
    pub fn waiting(&self) -> (u64, u64) {
        let entries = self.segments.iter().flat_map(|segment| &segment.entries);
        let waiting = entries.filter(|entry| entry.is_frame() && !entry.is_in(&self.durable));
        waiting.fold((0, 0), |(frames, bytes), entry| (frames + 1, bytes + entry.bytes as u64))
    }

    /// Has the server everything that lies here?
    pub fn is_acknowledged(&self) -> bool {
        self.segments.iter().flat_map(|segment| &segment.entries).all(|entry| entry.is_in(&self.durable))
    }

    /// Was the server told how many frames there are?
    pub fn is_closing(&self) -> bool {
        self.is_closing
    }

    /// Notes that the server is told next how many frames there are.
    pub(super) fn close(&mut self) -> io::Result<()> {
        if !self.is_closing {
            self.active = None;
            File::create(self.folder.join(CLOSING))?.sync_all()?;
            sync_folder(&self.folder)?;
            self.is_closing = true;
        }
        Ok(())
    }

    /// Becomes another recording, with another id in another folder, of which the server knows nothing.
    pub(super) fn renew(&mut self, folder: PathBuf, hello: Hello) -> io::Result<()> {
        write_hello(&self.folder, &hello)?;
        fs::rename(&self.folder, &folder)?;
        folder.parent().map_or(Ok(()), sync_folder)?;
        self.segments.iter_mut().for_each(|segment| segment.move_to(&folder));
        (self.hello, self.folder, self.durable, self.active) = (hello, folder, Numbers::default(), None);
        Ok(())
    }

    pub(super) fn append(&mut self, record: &Record<'_>, segment_bytes: u64) -> io::Result<()> {
        self.write_unwritten(segment_bytes)?;
        self.write(record, segment_bytes)
    }

    /// Tells of the numbers for which there was no room.
    pub(super) fn write_unwritten(&mut self, segment_bytes: u64) -> io::Result<()> {
        if let Some([number, last]) = self.unwritten {
            let body = Body::Gap { last, reason: GapReason::SpoolFull };
            self.write(&Record { epoch: 0, number, body }, segment_bytes)?;
            self.unwritten = None;
        }
        Ok(())
    }

    /// There was no room for this record: its numbers are a gap.
    pub(super) fn give_up(&mut self, record: &Record<'_>) {
        let first = self.unwritten.map_or(record.number, |[first, _]| first);
        self.unwritten = Some([first, record.last()]);
        self.end = self.end.max(record.last() + 1);
    }

    fn write(&mut self, record: &Record<'_>, segment_bytes: u64) -> io::Result<()> {
        if self.segments.back().is_none_or(|segment| segment.bytes >= segment_bytes) {
            self.active = None;
        }
        let file = match &self.active {
            Some(file) => file.clone(),
            None => {
                let serial = self.next_serial;
                self.next_serial += 1; // first: the file may be there although making it failed
                let (segment, file) = Segment::create(&self.folder, serial)?;
                self.segments.push_back(segment);
                self.active.insert(file).clone()
            }
        };
        if let Some(segment) = self.segments.back_mut()
            && let Err(error) = segment.append(&file, record)
        {
            if segment.entries.is_empty() {
                // One without a record has no place among the numbers.
                segment.remove()?;
                self.segments.pop_back();
                self.active = None;
            }
            return Err(error);
        }
        if !self.unsynced.iter().any(|unsynced| Arc::ptr_eq(unsynced, &file)) {
            self.unsynced.push(file);
        }
        self.end = self.end.max(record.last() + 1);
        Ok(())
    }

    /// Files that hold records which are perhaps not on the disk yet.
    pub(super) fn take_unsynced(&mut self) -> Vec<Arc<File>> {
        std::mem::take(&mut self.unsynced)
    }

    /// The bytes of a record; one that cannot be read any more is forgotten, and is a hole from then on.
    pub(super) fn read(&mut self, wanted: Entry) -> Option<Vec<u8>> {
        let at = self.segments.partition_point(|segment| segment.end() <= wanted.number);
        let segment = self.segments.get_mut(at)?;
        match segment.read(wanted) {
            Ok(bytes) if Record::read(&bytes).is_ok() => Some(bytes),
            damaged => {
                let why = damaged.err().map_or("its checksum does not match".to_owned(), |error| error.to_string());
                tracing::error!(number = wanted.number, why, "a frame in the spool cannot be read, and is lost");
                segment.entries.retain(|entry| *entry != wanted);
                if self.segments.back().is_some_and(|segment| segment.entries.is_empty()) {
                    self.active = None;
                }
                self.segments.retain(|segment| !segment.entries.is_empty());
                None
            }
        }
    }

    /// Lets go of whole segments that the server has.
    pub(super) fn let_go(&mut self) -> io::Result<()> {
        let active = usize::from(self.active.is_some());
        for at in (0..self.segments.len().saturating_sub(active)).rev() {
            if self.segments[at].entries.iter().all(|entry| entry.is_in(&self.durable)) {
                self.segments[at].remove()?;
                self.segments.remove(at);
            }
        }
        Ok(())
    }

    /// Gives up the frames of its oldest segment that has some; `false` if there is none.
    pub(super) fn drop_oldest(&mut self) -> io::Result<bool> {
        let Some(at) = self.segments.iter().position(Segment::has_frames) else { return Ok(false) };
        if at + 1 == self.segments.len() {
            self.active = None;
        }
        let before = at.checked_sub(1).and_then(|before| self.segments[before].only_gap());
        if self.segments[at].become_gaps(&self.durable, before)? {
            self.segments[at - 1].remove()?;
            self.segments.remove(at - 1);
        }
        self.let_go()?;
        Ok(true)
    }
}

/// Writes the hello in one step: it is there whole or not at all.
fn write_hello(folder: &Path, hello: &Hello) -> io::Result<()> {
    let new = folder.join("hello.new");
    let mut file = File::create(&new)?;
    file.write_all(&serde_json::to_vec(hello)?)?;
    file.sync_all()?;
    fs::rename(&new, folder.join(HELLO))?;
    sync_folder(folder)
}
