use std::sync::Arc;

use super::*;
use crate::media::testing::{all, open, recording, seen};
use crate::media::{MediaLimits, SampleFormat};

#[test]
fn every_picture_comes_once_in_order_at_any_speed_of_the_threads() {
    let clip: Arc<[u8]> = recording(SampleFormat::Yuv420, 80).into();
    let mut pictures = ReadAhead::new(open(&clip, MediaLimits::default())).unwrap();
    let mut ahead = Vec::new();
    while let Some(picture) = pictures.next_picture().unwrap() {
        ahead.push(seen(&picture.frame()));
    }
    assert_eq!(ahead, all(&clip));
    assert!(pictures.next_picture().unwrap().is_none(), "the end stays the end");
}

#[test]
fn the_first_pictures_are_shown_and_come_again() {
    let clip: Arc<[u8]> = recording(SampleFormat::Yuv420, 30).into();
    let mut pictures = ReadAhead::new(open(&clip, MediaLimits::default())).unwrap();
    let shown: Vec<_> = pictures.first_pictures(12).unwrap().iter().map(|picture| seen(&picture.frame())).collect();
    assert_eq!(shown, all(&clip)[..12]);
    let mut ahead = Vec::new();
    while let Some(picture) = pictures.next_picture().unwrap() {
        ahead.push(seen(&picture.frame()));
    }
    assert_eq!(ahead, all(&clip));
}

#[test]
fn an_error_comes_after_the_pictures_before_it() {
    let clip: Arc<[u8]> = recording(SampleFormat::Yuv420, 30).into();
    let limits = MediaLimits { frames: 20, ..MediaLimits::default() };
    let mut pictures = ReadAhead::new(open(&clip, limits)).unwrap();
    for _ in 0..20 {
        assert!(pictures.next_picture().unwrap().is_some());
    }
    assert!(matches!(pictures.next_picture(), Err(MediaError::OverLimit { .. })));
    assert!(pictures.next_picture().unwrap().is_none());
}

#[test]
fn dropping_the_reader_early_stops_the_decoder() {
    let clip: Arc<[u8]> = recording(SampleFormat::Yuv420, 60).into();
    let mut pictures = ReadAhead::new(open(&clip, MediaLimits::default())).unwrap();
    assert!(pictures.next_picture().unwrap().is_some());
    assert!(Arc::strong_count(&clip) > 1, "it is being read");
    drop(pictures);
    assert_eq!(Arc::strong_count(&clip), 1);
}
