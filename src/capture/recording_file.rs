//! A recording of the spool as an MP4 file: its frames in order, at their times, without decoding them.
//!
//! Recordings without a name are sent like this. The same records give the same bytes, so the server notices a recording
//! that it has already.
//!
//! The file is never on the disk, where the recording would take its space twice: it is made while it is sent. Its first
//! bytes have the length of what follows, which is known only at the end. So it is made twice: first for its length and for
//! the bytes that are changed afterwards ([`FileOutline`]), then for the receiver.

use std::collections::BTreeMap;
use std::io::{self, Seek, SeekFrom, Write};
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bytes::Bytes;
use tokio::io::AsyncRead;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tokio_util::io::StreamReader;

use super::Agent;
use crate::domain::feed::playable::{StoredFrame, decoding_times, keep_decodable};
use crate::domain::feed::record::{FeedRecord, RecordBody};
use crate::ids::FeedId;
use crate::media::{CodedFrame, MuxError, Muxer, Stream, can_start_decoding};

/// Bytes that are passed on in one piece, and pieces that may wait for the receiver.
const PIECE_BYTES: usize = 1 << 16;
const MAX_WAITING: usize = 8;

/// Why a recording cannot be made a file.
#[derive(Debug, thiserror::Error)]
pub enum RecordingFileError {
    /// The frames cannot be put into a file.
    #[error("the file of the recording cannot be made ({0})")]
    Mux(#[from] MuxError),
    /// Frames were dropped from the spool meanwhile.
    #[error("the spool is full, and frames of the recording were dropped while it was sent")]
    Dropped,
    /// The file was not the same the second time.
    #[error("the frames of the recording changed while it was sent")]
    Changed,
}

/// The bytes of a file, as they are made.
pub type FileBytes = Pin<Box<dyn AsyncRead + Send + Sync>>;

/// A recording as a file. Clones are the same file.
#[derive(Clone)]
pub struct RecordingFile(Arc<FileParts>);

struct FileParts {
    agent: Agent,
    id: FeedId,
    frames: Vec<StoredFrame>,
    outline: FileOutline,
}

impl RecordingFile {
    /// The file of a recording that has ended; reads all its frames. `None`: none of them can be decoded.
    ///
    /// # Errors
    /// [`RecordingFileError`].
    pub fn of(agent: &Agent, id: FeedId) -> Result<Option<Self>, RecordingFileError> {
        let Some(frames) = playable_frames(agent, id)? else { return Ok(None) };
        let shared = SharedOutline::default();
        mux(agent, id, &frames, shared.clone())?;
        let outline = shared.lock().outline.clone();
        Ok(Some(Self(Arc::new(FileParts { agent: agent.clone(), id, frames, outline }))))
    }

    /// Its length.
    pub fn bytes(&self) -> u64 {
        self.0.outline.bytes
    }

    /// True if the spool still has all its frames.
    pub fn is_whole(&self) -> bool {
        let FileParts { agent, id, frames, .. } = &*self.0;
        let spool = agent.spool();
        let Some(recording) = spool.get(*id) else { return false };
        let is_there = |frame: &StoredFrame| {
            recording.at_or_after(frame.number).is_some_and(|entry| entry.number == frame.number && entry.is_frame())
        };
        frames.iter().all(is_there)
    }

    /// Its bytes from the start, made on a thread that ends with the reader. If they cannot be made, reading fails.
    pub fn open(&self) -> FileBytes {
        let (sender, pieces) = mpsc::channel(MAX_WAITING);
        let file = self.clone();
        tokio::task::spawn_blocking(move || {
            if let Err(error) = file.write_to(sender.clone()) {
                let _ = sender.blocking_send(Err(io::Error::other(error.to_string()))); // the reader may be gone
            }
        });
        Box::pin(StreamReader::new(ReceiverStream::new(pieces)))
    }

    fn write_to(&self, sender: PieceSender) -> Result<(), RecordingFileError> {
        let FileParts { agent, id, frames, outline } = &*self.0;
        let shared = SharedPieces(Arc::new(Mutex::new(Pieces::new(outline.clone(), sender))));
        mux(agent, *id, frames, shared.clone())?;
        shared.lock().finish()
    }
}

/// Writes the frames as an MP4 file.
fn mux(
    agent: &Agent,
    id: FeedId,
    frames: &[StoredFrame],
    to: impl Write + Seek + Send + 'static,
) -> Result<(), RecordingFileError> {
    let (codec, size, time_base) = {
        let spool = agent.spool();
        let hello = &spool.get(id).ok_or(RecordingFileError::Dropped)?.hello;
        (hello.codec, (hello.width, hello.height), hello.time_base)
    };
    let first = bytes_of(agent, id, frames.first().ok_or(RecordingFileError::Dropped)?)?;
    let mut muxer = Muxer::create(to, Stream { codec, size, time_base, first: &first })?;
    for (frame, (dts, duration)) in frames.iter().zip(decoding_times(frames)) {
        let bytes = bytes_of(agent, id, frame)?;
        muxer.write(CodedFrame { pts: frame.time, dts, duration, is_key: frame.is_key, bytes: &bytes })?;
    }
    Ok(muxer.finish()?)
}

/// The frames that a player can show, from the first one that can be decoded on; `None`: there is none.
fn playable_frames(agent: &Agent, id: FeedId) -> Result<Option<Vec<StoredFrame>>, RecordingFileError> {
    let codec = {
        let spool = agent.spool();
        let Some(recording) = spool.get(id) else { return Ok(None) };
        recording.hello.codec
    };
    let mut frames = keep_decodable(frames_of(agent, id), codec);
    for at in 0..frames.len() {
        if can_start_decoding(codec, &bytes_of(agent, id, &frames[at])?) {
            frames.drain(..at);
            return Ok(Some(frames));
        }
    }
    Ok(None)
}

/// The frames in the spool. The spool is locked for one record at a time, so that another recording continues.
fn frames_of(agent: &Agent, id: FeedId) -> Vec<StoredFrame> {
    let (mut frames, mut next) = (Vec::new(), 0);
    loop {
        let mut spool = agent.spool();
        let Some(entry) = spool.get(id).and_then(|recording| recording.at_or_after(next)) else { return frames };
        next = entry.last + 1;
        if !entry.is_frame() {
            continue;
        }
        let Some(bytes) = spool.read(id, entry) else { continue }; // damaged: it is a hole from now on
        if let Ok(FeedRecord { number, body: RecordBody::Frame { time, is_key, payload }, .. }) =
            FeedRecord::read(&bytes)
        {
            frames.push(StoredFrame { number, time, is_key, offset: 0, bytes: payload.len() });
        }
    }
}

/// The bytes of a frame, unless it was dropped meanwhile.
fn bytes_of(agent: &Agent, id: FeedId, frame: &StoredFrame) -> Result<Vec<u8>, RecordingFileError> {
    let mut spool = agent.spool();
    let entry = spool.get(id).and_then(|recording| recording.at_or_after(frame.number));
    let entry = entry.filter(|entry| entry.number == frame.number && entry.is_frame());
    let bytes = entry.and_then(|entry| spool.read(id, entry)).ok_or(RecordingFileError::Dropped)?;
    match FeedRecord::read(&bytes) {
        Ok(FeedRecord { body: RecordBody::Frame { payload, .. }, .. }) => Ok(payload.to_vec()),
        _ => Err(RecordingFileError::Dropped),
    }
}

/// The length of a file, and the bytes that its writer changed after it had written more: their last values.
#[derive(Clone, Debug, Default)]
struct FileOutline {
    bytes: u64,
    changed: BTreeMap<u64, u8>,
}

/// Keeps the outline of what is written, and nothing else.
#[derive(Debug, Default)]
struct OutlineWriter {
    outline: FileOutline,
    position: u64,
}

/// Shared with FFmpeg's writer, which is gone when the file is complete.
#[derive(Clone, Default)]
struct SharedOutline(Arc<Mutex<OutlineWriter>>);

impl SharedOutline {
    fn lock(&self) -> MutexGuard<'_, OutlineWriter> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner) // read only if the writer has succeeded
    }
}

impl Write for SharedOutline {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut writer = self.lock();
        let position = writer.position;
        let end = position + bytes.len() as u64;
        let behind = writer.outline.bytes.saturating_sub(position);
        let changed = (position..end).zip(bytes).take(usize::try_from(behind).unwrap_or(usize::MAX));
        writer.outline.changed.extend(changed.map(|(at, byte)| (at, *byte)));
        writer.outline.bytes = writer.outline.bytes.max(end);
        writer.position = end;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for SharedOutline {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let mut writer = self.lock();
        writer.position = position_after(to, writer.position, writer.outline.bytes)?;
        Ok(writer.position)
    }
}

type PieceSender = mpsc::Sender<io::Result<Bytes>>;

/// A file that is passed on from its start to its end, with the bytes that its writer changes at the end.
struct Pieces {
    outline: FileOutline,
    sender: PieceSender,
    /// What is passed on next.
    piece: Vec<u8>,
    /// Length of what was written so far, the piece included.
    written: u64,
    position: u64,
}

#[derive(Clone)]
struct SharedPieces(Arc<Mutex<Pieces>>);

impl SharedPieces {
    fn lock(&self) -> MutexGuard<'_, Pieces> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner) // as above
    }
}

impl Pieces {
    fn new(outline: FileOutline, sender: PieceSender) -> Self {
        Self { outline, sender, piece: Vec::with_capacity(PIECE_BYTES), written: 0, position: 0 }
    }

    fn send_piece(&mut self) -> io::Result<()> {
        let piece = std::mem::replace(&mut self.piece, Vec::with_capacity(PIECE_BYTES));
        let gone = |_| io::Error::new(io::ErrorKind::BrokenPipe, "the receiver is gone");
        self.sender.blocking_send(Ok(piece.into())).map_err(gone)
    }

    fn finish(&mut self) -> Result<(), RecordingFileError> {
        if self.written != self.outline.bytes {
            return Err(RecordingFileError::Changed);
        }
        let _ = self.send_piece(); // a receiver that is gone does not miss it
        Ok(())
    }
}

impl Write for SharedPieces {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut pieces = self.lock();
        // What was passed on had its last values already.
        let known = usize::try_from(pieces.written.saturating_sub(pieces.position)).unwrap_or(usize::MAX);
        let new = &bytes[known.min(bytes.len())..];
        let start = pieces.position + (bytes.len() - new.len()) as u64;
        if !new.is_empty() {
            if start != pieces.written {
                return Err(io::Error::other("a file with a hole cannot be passed on"));
            }
            let end = start + new.len() as u64;
            let at = pieces.piece.len();
            pieces.piece.extend_from_slice(new);
            let Pieces { outline, piece, .. } = &mut *pieces;
            for (place, byte) in outline.changed.range(start..end) {
                piece[at + (place - start) as usize] = *byte; // inside: the range says so
            }
            pieces.written = end;
            if pieces.piece.len() >= PIECE_BYTES {
                pieces.send_piece()?;
            }
        }
        pieces.position += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for SharedPieces {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let mut pieces = self.lock();
        pieces.position = position_after(to, pieces.position, pieces.written)?;
        Ok(pieces.position)
    }
}

fn position_after(to: SeekFrom, position: u64, end: u64) -> io::Result<u64> {
    let place = match to {
        SeekFrom::Start(place) => Some(place),
        SeekFrom::Current(by) => position.checked_add_signed(by),
        SeekFrom::End(by) => end.checked_add_signed(by),
    };
    place.ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "a place before the start of the file"))
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use tokio::io::AsyncReadExt;

    use super::*;
    use crate::capture::spool::testing;

    /// The file as a muxer writes it to a disk.
    fn on_a_disk(agent: &Agent, id: FeedId) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("recording.mp4");
        let frames = playable_frames(agent, id).unwrap().unwrap();
        mux(agent, id, &frames, File::create_new(&path).unwrap()).unwrap();
        std::fs::read(path).unwrap()
    }

    async fn streamed(file: &RecordingFile) -> Vec<u8> {
        let mut bytes = Vec::new();
        file.open().read_to_end(&mut bytes).await.unwrap();
        bytes
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn the_bytes_are_those_of_the_file_on_a_disk_and_take_no_space_there() {
        for frames in [1, 20, 900] {
            let (folder, mut spool, id) = testing::spool(1 << 20);
            testing::add(&mut spool, 0..frames);
            spool.end_live();
            let (bytes, files) = (spool.bytes(), std::fs::read_dir(folder.path()).unwrap().count());
            let agent = Agent::new(spool);
            let file = RecordingFile::of(&agent, id).unwrap().unwrap();
            let sent = streamed(&file).await;
            assert_eq!(sent.len() as u64, file.bytes());
            assert!(sent == on_a_disk(&agent, id), "{frames} frames");
            assert!(!file.0.outline.changed.is_empty() && file.0.outline.changed.len() < 64, "the lengths only");
            assert!(sent == streamed(&file).await, "once more");
            assert_eq!((agent.spool().bytes(), std::fs::read_dir(folder.path()).unwrap().count()), (bytes, files));
        }
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn frames_that_are_dropped_while_a_file_is_sent_fail_its_reader() {
        let (_folder, mut spool, id) = testing::spool(100 * 132);
        testing::add(&mut spool, 0..90);
        spool.end_live();
        let agent = Agent::new(spool);
        let file = RecordingFile::of(&agent, id).unwrap().unwrap();
        assert!(file.is_whole());
        let live = agent.spool().begin(testing::hello(1_795_000_009_000), "box-1").unwrap();
        testing::add(&mut agent.spool(), 0..40);
        assert!(!file.is_whole());
        let read = file.open().read_to_end(&mut Vec::new()).await;
        assert!(read.unwrap_err().to_string().contains("dropped"));
        let rest = RecordingFile::of(&agent, id).unwrap().unwrap();
        assert!(rest.bytes() < file.bytes() && streamed(&rest).await.len() as u64 == rest.bytes());
        agent.spool().remove(live).unwrap();
    }
}
