use std::sync::Arc;

use super::{ListedPacket, spread_over};
use crate::media::testing::{all, open, recording, seen};
use crate::media::{MediaLimits, Picture, SampleFormat};

/// Number and pixel hash of each frame shown; the times are meaningless.
fn shown(recording: &Arc<[u8]>, numbers: &[u64]) -> Option<Vec<(u64, u64)>> {
    let mut few = Vec::new();
    let done = open(recording, MediaLimits::default()).show_frames(numbers, |picture| {
        let (number, _, pixels) = seen(&picture.frame());
        few.push((number, pixels));
    });
    done.map(|()| few)
}

#[test]
fn each_frame_shown_alone_is_the_one_that_decoding_counts_up_to() {
    let clip: Arc<[u8]> = recording(SampleFormat::Yuv420, 160).into();
    let all: Vec<(u64, u64)> = all(&clip).into_iter().map(|(number, _, pixels)| (number, pixels)).collect();
    for wanted in &all {
        assert_eq!(shown(&clip, &[wanted.0]), Some(vec![*wanted]), "frame {}", wanted.0);
    }
}

#[test]
fn frames_of_several_groups_come_in_order_and_once() {
    let clip: Arc<[u8]> = recording(SampleFormat::Yuv420, 160).into();
    let all = all(&clip);
    let wanted = [0, 1, 2, 49, 50, 51, 97, 158, 159];
    let pixels: Vec<(u64, u64)> = wanted.iter().map(|&number| (number, all[number as usize].2)).collect();
    let asked = [159, 1, 0, 2, 49, 51, 50, 97, 158, 1];
    assert_eq!(shown(&clip, &asked), Some(pixels));
}

#[test]
fn a_frame_beyond_the_end_is_not_guessed() {
    let clip: Arc<[u8]> = recording(SampleFormat::Yuv420, 30).into();
    assert_eq!(shown(&clip, &[0, 30]), None);
}

/// Numbers and pixel hashes of the frames that are spread over a recording, and the number of packets read.
fn spread(recording: &Arc<[u8]>, most: usize) -> (Vec<(u64, u64)>, usize) {
    let (mut frames, mut packets) = (Vec::new(), 0);
    let show = |picture: &Picture| {
        let (number, _, pixels) = seen(&picture.frame());
        frames.push((number, pixels));
    };
    open(recording, MediaLimits::default()).show_spread(most, show, || packets += 1).unwrap();
    (frames, packets)
}

#[test]
fn frames_spread_over_a_recording_are_those_that_decoding_counts_up_to() {
    let clip: Arc<[u8]> = recording(SampleFormat::Yuv420, 160).into();
    let all: Vec<(u64, u64)> = all(&clip).into_iter().map(|(number, _, pixels)| (number, pixels)).collect();
    for most in [1, 2, 7, 60, 1000] {
        let (frames, packets) = spread(&clip, most);
        assert_eq!(frames.len(), most.min(160));
        assert!(frames.iter().all(|frame| all[frame.0 as usize] == *frame), "{most}");
        let longest = 2 * 159 / (most as u64 - 1).clamp(1, 159) + 1;
        let numbers: Vec<u64> = frames.iter().map(|frame| frame.0).collect();
        assert!(numbers.windows(2).all(|pair| (1..=longest).contains(&(pair[1] - pair[0]))), "{most}: {numbers:?}");
        assert!(numbers[0] == 0 && packets >= 160, "{most}: {numbers:?}, {packets} packets");
    }
}

#[test]
fn a_key_frame_since_the_frame_before_is_preferred() {
    let keys = [0, 50, 100, 150];
    let listed: Vec<ListedPacket> =
        (0..160).map(|number| ListedPacket { pts: number, dts: number, is_key: keys.contains(&number) }).collect();
    assert_eq!(spread_over(&listed, 4), [0, 50, 100, 150]);
    assert_eq!(spread_over(&listed, 6), [0, 31, 50, 95, 100, 150]);
    assert_eq!(spread_over(&listed[..1], 60), [0]);
}
