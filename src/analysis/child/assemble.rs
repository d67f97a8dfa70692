//! Assembles a recording from a feed's log: frames in order, with the times in the log, without decoding.
//!
//! Frames that cannot be decoded or shown are left out: H.264 frames before the first key frame, and after a hole up to
//! the next key frame; frames whose time is not after the previous one; pictures whose size differs from the
//! recording's.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};

use serde::{Deserialize, Serialize};

use super::limits::set_once;
use super::{ChildEvent, ChildInputs, ChildTask, Reporter, StopReason, WorkRecord};
use crate::domain::feed::playable::{StoredFrame, decoding_times, keep_decodable};
use crate::domain::feed::record::{HEADER_BYTES, RecordBody, read_all};
use crate::domain::feed::{FrameCodec, MAX_FRAMES, TimeBase};
use crate::domain::problem::Problem;
use crate::domain::text::count_of;
use crate::media::{CodedFrame, MediaLimits, Muxer, Stream, can_start_decoding, frame_size};

/// Frames between two signs of life.
const FRAMES_PER_ALIVE: usize = 250;

/// What assembling needs besides the log.
#[derive(Debug, Serialize, Deserialize)]
pub struct AssembleWork {
    /// Codec of the frames.
    pub codec: FrameCodec,
    /// Picture width and height, pixels.
    pub size: (u32, u32),
    /// Time base of the frames.
    pub time_base: TimeBase,
}

impl ChildTask for AssembleWork {
    /// Frames in the recording, and frames that were left out because they cannot be decoded or shown.
    type Record = [u64; 2];
    type Output = Option<[u64; 2]>;

    fn run(self, inputs: ChildInputs, reporter: &mut Reporter) -> Result<(), StopReason> {
        let [log, output] = inputs.pair()?;
        let all = frames_of(&log, reporter)?;
        let arrived = all.len() as u64;
        let mut bytes = Vec::new();
        let fitting = keep_matching_size(&log, all, &self, &mut bytes)?;
        let mut frames = keep_decodable(fitting, self.codec);
        let Some(first) = first_start_frame(&log, &frames, self.codec, &mut bytes)? else {
            return Err(StopReason::Impossible(nothing_playable_problem(arrived)));
        };
        frames.drain(..first);
        let stream = Stream { codec: self.codec, size: self.size, time_base: self.time_base, first: &bytes };
        let mut muxer = Muxer::create(output, stream)?;
        for (done, (frame, (dts, duration))) in frames.iter().zip(decoding_times(&frames)).enumerate() {
            if done % FRAMES_PER_ALIVE == 0 {
                reporter.alive(done as u64, Some(frames.len() as u64))?;
            }
            read_frame(&log, frame, &mut bytes)?;
            muxer.write(CodedFrame { pts: frame.time, dts, duration, is_key: frame.is_key, bytes: &bytes })?;
        }
        muxer.finish()?;
        let written = frames.len() as u64;
        Ok(reporter.record(WorkRecord::Assemble([written, arrived - written]))?)
    }

    fn accept(
        &self,
        [frames, left_out]: [u64; 2],
        output: &mut Option<[u64; 2]>,
        _: MediaLimits,
    ) -> Result<ChildEvent, String> {
        if frames == 0 || frames.max(left_out) > MAX_FRAMES {
            return Err("an assembled recording with an impossible number of frames".into());
        }
        set_once(output, [frames, left_out], "recording")?;
        Ok(ChildEvent::Nothing)
    }
}

/// All frames of the log in the order of their numbers, each once.
fn frames_of(log: &File, reporter: &mut Reporter) -> Result<Vec<StoredFrame>, StopReason> {
    /// Bytes between two signs of life: seconds on the slowest disk.
    const BYTES_PER_ALIVE: u64 = 64 << 20;
    let (mut frames, mut word_at) = (Vec::new(), 0);
    let mut log = log;
    log.seek(SeekFrom::Start(0)).map_err(unreadable)?;
    read_all(log, |place, record| {
        if place >= word_at {
            reporter.alive(0, None).map_err(LogReadError::ParentGone)?;
            word_at = place + BYTES_PER_ALIVE;
        }
        if let RecordBody::Frame { time, is_key, payload } = record.body {
            let (number, bytes) = (record.number, payload.len());
            frames.push(StoredFrame { number, time, is_key, offset: place + HEADER_BYTES as u64, bytes });
        }
        Result::<(), LogReadError>::Ok(())
    })?;
    frames.sort_by_key(|frame: &StoredFrame| frame.number); // stable: of two with the same number, the first to arrive
    frames.dedup_by_key(|frame| frame.number);
    Ok(frames)
}

/// Why a log was not read to its end.
enum LogReadError {
    Disk(std::io::Error),
    ParentGone(std::io::Error),
}

impl From<std::io::Error> for LogReadError {
    fn from(error: std::io::Error) -> Self {
        LogReadError::Disk(error)
    }
}

impl From<LogReadError> for StopReason {
    fn from(unread: LogReadError) -> Self {
        match unread {
            LogReadError::Disk(error) => unreadable(error),
            LogReadError::ParentGone(error) => StopReason::ParentGone(error),
        }
    }
}

/// Removes pictures of another size. H.264 frames that follow such a key frame lack their reference, and are left out
/// like frames after a hole.
fn keep_matching_size(
    log: &File,
    all: Vec<StoredFrame>,
    work: &AssembleWork,
    bytes: &mut Vec<u8>,
) -> Result<Vec<StoredFrame>, StopReason> {
    /// Latest position of a JPEG's frame header: after tables and the camera's metadata.
    const MAX_HEADER_BYTES: usize = 1 << 16;
    let mut fitting = Vec::with_capacity(all.len());
    for frame in all {
        let says_its_size = work.codec == FrameCodec::Jpeg || frame.is_key;
        if says_its_size {
            let head = if work.codec == FrameCodec::Jpeg { frame.bytes.min(MAX_HEADER_BYTES) } else { frame.bytes };
            read_frame(log, &StoredFrame { bytes: head, ..frame }, bytes)?;
        }
        if !says_its_size || frame_size(work.codec, bytes).is_none_or(|size| size == work.size) {
            fitting.push(frame);
        }
    }
    Ok(fitting)
}

/// Finds the first frame that a decoder can begin with; leaves its bytes in `bytes`.
fn first_start_frame(
    log: &File,
    frames: &[StoredFrame],
    codec: FrameCodec,
    bytes: &mut Vec<u8>,
) -> Result<Option<usize>, StopReason> {
    for (index, frame) in frames.iter().enumerate().filter(|(_, frame)| frame.is_key || codec == FrameCodec::Jpeg) {
        read_frame(log, frame, bytes)?;
        if can_start_decoding(codec, bytes) {
            return Ok(Some(index));
        }
    }
    Ok(None)
}

fn read_frame(mut log: &File, frame: &StoredFrame, into: &mut Vec<u8>) -> Result<(), StopReason> {
    into.resize(frame.bytes, 0);
    log.seek(SeekFrom::Start(frame.offset)).and_then(|_| log.read_exact(into)).map_err(unreadable)
}

fn unreadable(error: std::io::Error) -> StopReason {
    let detail = format!("the stored frames cannot be read: {error}");
    StopReason::Impossible(Problem::new("feed-unreadable", "The frames cannot be read", detail))
}

fn nothing_playable_problem(arrived: u64) -> Problem {
    let arrived = count_of(arrived, "frame");
    let detail = format!(
        "{arrived} arrived, but none can be decoded: pictures must have the announced size, and H.264 must \
         begin with a key frame and repeat its parameter sets with every one"
    );
    Problem::new(Problem::NO_FRAMES, "No frame can be decoded", detail)
}
