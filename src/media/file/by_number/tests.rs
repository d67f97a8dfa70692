use std::sync::Arc;

use crate::media::testing::{all, open, recording, seen};
use crate::media::{MediaLimits, SampleFormat};

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
