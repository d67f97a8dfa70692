//! A recording of the spool as an MP4 file: its frames in order, at their times, without decoding them.
//!
//! Recordings without a name are sent like this. The same records give the same bytes, so the server notices a recording
//! that it has already.

use std::fs::File;
use std::io;
use std::sync::PoisonError;

use super::Agent;
use crate::domain::feed::playable::{StoredFrame, decoding_times, keep_decodable};
use crate::domain::feed::record::{FeedRecord, RecordBody};
use crate::ids::FeedId;
use crate::media::{CodedFrame, MuxError, Muxer, Stream, can_start_decoding};

/// Why a recording cannot be written as a file.
#[derive(Debug, thiserror::Error)]
pub enum RecordingFileError {
    /// The disk fails or is full.
    #[error("the file of the recording cannot be written ({0}): free space on the computer of the box")]
    Disk(#[from] io::Error),
    /// The frames cannot be put into a file.
    #[error("the file of the recording cannot be made ({0})")]
    Mux(#[from] MuxError),
    /// Frames were dropped meanwhile, because the spool is full.
    #[error("the spool is full, and frames were dropped while the file of the recording was made")]
    Changed,
}

/// Writes the file of a recording that has ended, unless it is there. `false`: no frame of it can be decoded.
///
/// # Errors
/// [`RecordingFileError`].
pub fn write_file(agent: &Agent, id: FeedId) -> Result<bool, RecordingFileError> {
    let _alone = agent.0.writing_file.lock().unwrap_or_else(PoisonError::into_inner); // it guards no data
    let (codec, size, time_base, path) = {
        let spool = agent.spool();
        let Some(recording) = spool.get(id) else { return Ok(false) };
        if recording.file().is_some() {
            return Ok(true);
        }
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
    let mut muxer = Muxer::create(File::create(path)?, Stream { codec, size, time_base, first: &bytes })?;
    for (frame, (dts, duration)) in frames.iter().zip(decoding_times(&frames)) {
        let bytes = bytes_of(agent, id, frame)?;
        muxer.write(CodedFrame { pts: frame.time, dts, duration, is_key: frame.is_key, bytes: &bytes })?;
    }
    muxer.finish()?;
    agent.spool().finish_file(id)?;
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

fn bytes_of(agent: &Agent, id: FeedId, frame: &StoredFrame) -> Result<Vec<u8>, RecordingFileError> {
    let mut spool = agent.spool();
    let entry = spool.get(id).and_then(|recording| recording.at_or_after(frame.number));
    let entry = entry.filter(|entry| entry.number == frame.number && entry.is_frame());
    let bytes = entry.and_then(|entry| spool.read(id, entry)).ok_or(RecordingFileError::Changed)?;
    match FeedRecord::read(&bytes) {
        Ok(FeedRecord { body: RecordBody::Frame { payload, .. }, .. }) => Ok(payload.to_vec()),
        _ => Err(RecordingFileError::Changed),
    }
}
