//! Assembles a recording from a feed's log: frames in order, with the times in the log, without decoding.
//!
//! Frames that cannot be decoded or shown are left out: H.264 frames before the first key frame, and after a hole up to
//! the next key frame; frames whose time is not after the previous one; pictures whose size differs from the
//! recording's.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};

use serde::{Deserialize, Serialize};

use super::limits::set_once;
use super::{ChildEvent, ChildInputs, ChildTask, Reporter, StopReason, WorkRecord};
use crate::domain::feed::record::{HEADER_BYTES, RecordBody, read_all};
use crate::domain::feed::{FrameCodec, MAX_FRAMES, TimeBase};
use crate::domain::problem::Problem;
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

/// A frame in the log.
#[derive(Clone, Copy, Debug, PartialEq)]
struct LoggedFrame {
    number: u64,
    time: i64,
    is_key: bool,
    /// Offset and length of its bytes in the log.
    offset: u64,
    bytes: usize,
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
fn frames_of(log: &File, reporter: &mut Reporter) -> Result<Vec<LoggedFrame>, StopReason> {
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
            frames.push(LoggedFrame { number, time, is_key, offset: place + HEADER_BYTES as u64, bytes });
        }
        Result::<(), LogReadError>::Ok(())
    })?;
    frames.sort_by_key(|frame: &LoggedFrame| frame.number); // stable: of two with the same number, the first to arrive
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
    all: Vec<LoggedFrame>,
    work: &AssembleWork,
    bytes: &mut Vec<u8>,
) -> Result<Vec<LoggedFrame>, StopReason> {
    /// Latest position of a JPEG's frame header: after tables and the camera's metadata.
    const MAX_HEADER_BYTES: usize = 1 << 16;
    let mut fitting = Vec::with_capacity(all.len());
    for frame in all {
        let says_its_size = work.codec == FrameCodec::Jpeg || frame.is_key;
        if says_its_size {
            let head = if work.codec == FrameCodec::Jpeg { frame.bytes.min(MAX_HEADER_BYTES) } else { frame.bytes };
            read_frame(log, &LoggedFrame { bytes: head, ..frame }, bytes)?;
        }
        if !says_its_size || frame_size(work.codec, bytes).is_none_or(|size| size == work.size) {
            fitting.push(frame);
        }
    }
    Ok(fitting)
}

/// The frames that can be decoded and shown.
fn keep_decodable(all: Vec<LoggedFrame>, codec: FrameCodec) -> Vec<LoggedFrame> {
    let mut times = BTreeSet::new();
    let mut wanted: Option<u64> = None; // the number that continues what was decoded
    let mut decodable: Vec<LoggedFrame> = Vec::with_capacity(all.len());
    for frame in all {
        let continues = codec == FrameCodec::Jpeg || frame.is_key || wanted == Some(frame.number);
        if continues && times.insert(frame.time) {
            wanted = Some(frame.number + 1);
            decodable.push(frame);
        } else {
            wanted = None;
        }
    }
    if codec == FrameCodec::Jpeg {
        // JPEGs are in the order of display, so a time before the last one is a clock that jumped.
        let mut last = i64::MIN;
        decodable.retain(|frame| {
            let is_later = frame.time > last;
            last = last.max(frame.time);
            is_later
        });
    }
    decodable
}

/// Finds the first frame that a decoder can begin with; leaves its bytes in `bytes`.
fn first_start_frame(
    log: &File,
    frames: &[LoggedFrame],
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

/// Decoding time and duration of each frame, ticks: decoding times rise, and each is early enough for display.
fn decoding_times(frames: &[LoggedFrame]) -> Vec<(i64, i64)> {
    let mut shown: Vec<i64> = frames.iter().map(|frame| frame.time).collect();
    shown.sort_unstable();
    let delay = shown.iter().zip(frames).map(|(shown, frame)| shown - frame.time).max().unwrap_or(0);
    let usual = shown.windows(2).map(|pair| pair[1] - pair[0]).min().unwrap_or(1);
    let until_next = |time: i64| {
        let next = shown.partition_point(|shown| *shown <= time);
        shown.get(next).map_or(usual, |next| next - time)
    };
    shown.iter().zip(frames).map(|(shown, frame)| (shown - delay, until_next(frame.time))).collect()
}

fn read_frame(mut log: &File, frame: &LoggedFrame, into: &mut Vec<u8>) -> Result<(), StopReason> {
    into.resize(frame.bytes, 0);
    log.seek(SeekFrom::Start(frame.offset)).and_then(|_| log.read_exact(into)).map_err(unreadable)
}

fn unreadable(error: std::io::Error) -> StopReason {
    let detail = format!("the stored frames cannot be read: {error}");
    StopReason::Impossible(Problem::new("feed-unreadable", "The frames cannot be read", detail))
}

fn nothing_playable_problem(arrived: u64) -> Problem {
    let detail = format!(
        "{arrived} frames arrived, but none can be decoded: pictures must have the announced size, and H.264 must \
         begin with a key frame and repeat its parameter sets with every one"
    );
    Problem::new(Problem::NO_FRAMES, "No frame can be decoded", detail)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(number: u64, time: i64, is_key: bool) -> LoggedFrame {
        LoggedFrame { number, time, is_key, offset: 0, bytes: 1 }
    }

    fn numbers(frames: Vec<LoggedFrame>) -> Vec<u64> {
        frames.iter().map(|frame| frame.number).collect()
    }

    #[test]
    fn h264_begins_with_a_key_frame_and_goes_on_with_one_after_a_hole() {
        let frame = |n: u64| place(n, 40 * n as i64, n % 10 == 3);
        let all: Vec<LoggedFrame> = (0..40).filter(|n| *n != 16).map(frame).collect();
        let kept: Vec<u64> = (3..16).chain(23..40).collect();
        assert_eq!(numbers(keep_decodable(all.clone(), FrameCodec::H264)), kept);
        assert_eq!(keep_decodable(all, FrameCodec::Jpeg).len(), 39, "every JPEG can be decoded");
    }

    #[test]
    fn a_clock_that_jumps_back_or_stands_still_costs_the_frames_that_it_hit() {
        let all = [0, 40, 80, 80, 30, 120].iter().enumerate().map(|(n, time)| place(n as u64, *time, true)).collect();
        assert_eq!(numbers(keep_decodable(all, FrameCodec::Jpeg)), [0, 1, 2, 5]);
    }

    #[test]
    fn every_frame_is_decoded_before_it_is_shown_and_after_the_one_before() {
        // I P B B P B B, in the order of decoding.
        let frames: Vec<LoggedFrame> = [0, 120, 40, 80, 240, 160, 200]
            .iter()
            .enumerate()
            .map(|(n, time)| place(n as u64, *time, n == 0))
            .collect();
        let times = decoding_times(&frames);
        assert!(times.windows(2).all(|pair| pair[0].0 < pair[1].0), "{times:?}");
        assert!(times.iter().zip(&frames).all(|((dts, _), frame)| *dts <= frame.time), "{times:?}");
        assert!(times.iter().all(|(_, duration)| *duration == 40), "{times:?}");
    }
}
