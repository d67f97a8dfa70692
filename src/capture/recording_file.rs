//! A recording of the spool as an MP4 file: its frames in order, at their times, without decoding them.
//!
//! Recordings without a name are sent like this. The same records give the same bytes, so the server notices a recording
//! that it has already.

use std::fs::File;
use std::io;
use std::sync::PoisonError;

use super::Agent;
use super::spool::NoSpace;
use crate::domain::feed::playable::{StoredFrame, decoding_times, keep_decodable};
use crate::domain::feed::record::{FeedRecord, RecordBody};
use crate::ids::FeedId;
use crate::media::{CodedFrame, MuxError, Muxer, Stream, can_start_decoding};

/// Why a recording cannot be written as a file.
#[derive(Debug, thiserror::Error)]
pub enum RecordingFileError {
    /// There is no space for it now.
    #[error(transparent)]
    NoSpace(#[from] NoSpace),
    /// The disk fails.
    #[error("the file of the recording cannot be written ({0}): free space on the computer of the box")]
    Disk(#[from] io::Error),
    /// The frames cannot be put into a file.
    #[error("the file of the recording cannot be made ({0})")]
    Mux(#[from] MuxError),
    /// The file was given up for the frames of another recording, or its own frames were dropped.
    #[error("the spool is full, and frames had precedence over the file of the recording")]
    GivenUp,
}

/// Writes the file of a recording that has ended, unless it is there. `false`: no frame of it can be decoded.
///
/// # Errors
/// [`RecordingFileError`]; nothing of the file remains.
pub fn write_file(agent: &Agent, id: FeedId) -> Result<bool, RecordingFileError> {
    let _alone = agent.0.writing_file.lock().unwrap_or_else(PoisonError::into_inner); // it guards no data
    {
        let mut spool = agent.spool();
        let Some(recording) = spool.get(id) else { return Ok(false) };
        if recording.file().is_some() {
            return Ok(true);
        }
        spool.begin_file(id)?;
    }
    let unfinished = UnfinishedFile { agent, id };
    let is_written = write_frames(agent, id)?;
    if is_written {
        let mut spool = agent.spool();
        spool.get(id).filter(|recording| recording.is_writing_file()).ok_or(RecordingFileError::GivenUp)?;
        spool.finish_file(id)?;
    }
    drop(unfinished);
    Ok(is_written)
}

/// A file that is being written. What is not complete is removed when this is dropped.
struct UnfinishedFile<'a> {
    agent: &'a Agent,
    id: FeedId,
}

impl Drop for UnfinishedFile<'_> {
    fn drop(&mut self) {
        if let Err(error) = self.agent.spool().give_up_file(self.id) {
            tracing::warn!(recording = %self.id, %error, "the unfinished file of a recording cannot be removed");
        }
    }
}

/// Writes the frames into the unfinished file. `false`: none of them can be decoded.
fn write_frames(agent: &Agent, id: FeedId) -> Result<bool, RecordingFileError> {
    let (codec, size, time_base, path) = {
        let spool = agent.spool();
        let recording = spool.get(id).ok_or(RecordingFileError::GivenUp)?;
        let hello = &recording.hello;
        (hello.codec, (hello.width, hello.height), hello.time_base, recording.unfinished_file())
    };
    let mut frames = keep_decodable(frames_of(agent, id), codec);
    let mut first = None;
    for (at, frame) in frames.iter().enumerate() {
        let bytes = bytes_of(agent, id, frame)?;
        if can_start_decoding(codec, &bytes) {
            first = Some((at, bytes));
            break;
        }
    }
    let Some((at, bytes)) = first else { return Ok(false) };
    frames.drain(..at);
    let file = File::create(path)?;
    let mut muxer = Muxer::create(file.try_clone()?, Stream { codec, size, time_base, first: &bytes })?;
    for (frame, (dts, duration)) in frames.iter().zip(decoding_times(&frames)) {
        let bytes = bytes_of(agent, id, frame)?;
        muxer.write(CodedFrame { pts: frame.time, dts, duration, is_key: frame.is_key, bytes: &bytes })?;
    }
    muxer.finish()?;
    file.sync_all()?; // without the lock on the spool: another recording continues
    Ok(true)
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

/// The bytes of a frame, unless the file was given up meanwhile.
fn bytes_of(agent: &Agent, id: FeedId, frame: &StoredFrame) -> Result<Vec<u8>, RecordingFileError> {
    let mut spool = agent.spool();
    let recording = spool.get(id).filter(|recording| recording.is_writing_file());
    let entry = recording.and_then(|recording| recording.at_or_after(frame.number));
    let entry = entry.filter(|entry| entry.number == frame.number && entry.is_frame());
    let bytes = entry.and_then(|entry| spool.read(id, entry)).ok_or(RecordingFileError::GivenUp)?;
    match FeedRecord::read(&bytes) {
        Ok(FeedRecord { body: RecordBody::Frame { payload, .. }, .. }) => Ok(payload.to_vec()),
        _ => Err(RecordingFileError::GivenUp),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::spool::testing;

    #[test]
    fn an_unfinished_file_leaves_nothing_behind() {
        let (_folder, mut spool, id) = testing::spool(1 << 20);
        testing::add(&mut spool, 0..20);
        spool.end_live();
        let bytes = spool.bytes();
        let path = spool.get(id).unwrap().unfinished_file();
        let agent = Agent::new(spool);
        // The frames of another recording had precedence when the file was half written.
        agent.spool().begin_file(id).unwrap();
        let unfinished = UnfinishedFile { agent: &agent, id };
        std::fs::write(&path, [1; 100]).unwrap();
        drop(unfinished);
        assert!(!path.exists());
        assert_eq!(agent.spool().bytes(), bytes);
        std::fs::create_dir(&path).unwrap(); // it cannot be written
        assert!(matches!(write_file(&agent, id), Err(RecordingFileError::Disk(_))));
        assert_eq!(agent.spool().bytes(), bytes, "no space is reserved");
        std::fs::remove_dir(&path).unwrap();
        assert!(write_file(&agent, id).unwrap());
        assert!(!path.exists() && agent.spool().get(id).unwrap().file().is_some());
    }
}
