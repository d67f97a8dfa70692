//! The frames of a recording that can be decoded and shown, and when each is decoded.
//!
//! Left out are H.264 frames before the first key frame, and after a hole up to the next key frame; and frames whose time
//! is not after the previous one.

use std::collections::BTreeSet;

use super::FrameCodec;

/// A frame of a recording, without its bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoredFrame {
    /// Its number, in decoding order.
    pub number: u64,
    /// When it is shown, ticks.
    pub time: i64,
    /// True if it can be decoded without earlier frames.
    pub is_key: bool,
    /// Offset of its bytes in the file that holds them.
    pub offset: u64,
    /// Length of its bytes.
    pub bytes: usize,
}

/// The frames that can be decoded and shown.
pub fn keep_decodable(all: Vec<StoredFrame>, codec: FrameCodec) -> Vec<StoredFrame> {
    let mut times = BTreeSet::new();
    let mut wanted: Option<u64> = None; // the number that continues what was decoded
    let mut decodable: Vec<StoredFrame> = Vec::with_capacity(all.len());
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

/// Decoding time and duration of each frame, ticks: decoding times rise, and each is early enough for display.
pub fn decoding_times(frames: &[StoredFrame]) -> Vec<(i64, i64)> {
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

#[cfg(test)]
mod tests {
    use super::*;

    fn place(number: u64, time: i64, is_key: bool) -> StoredFrame {
        StoredFrame { number, time, is_key, offset: 0, bytes: 1 }
    }

    fn numbers(frames: Vec<StoredFrame>) -> Vec<u64> {
        frames.iter().map(|frame| frame.number).collect()
    }

    #[test]
    fn h264_begins_with_a_key_frame_and_goes_on_with_one_after_a_hole() {
        let frame = |n: u64| place(n, 40 * n as i64, n % 10 == 3);
        let all: Vec<StoredFrame> = (0..40).filter(|n| *n != 16).map(frame).collect();
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
        let frames: Vec<StoredFrame> = [0, 120, 40, 80, 240, 160, 200]
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
