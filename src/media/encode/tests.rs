use std::fs::File;

use super::*;
use crate::media::{MediaLimits, VideoFile};
use crate::vision::frame::ColourEncoding;

const WIDTH: usize = 96;
const HEIGHT: usize = 64;

/// Properties of a decoded frame: time, mean luma, chroma shifts, U and V in the middle.
type Seen = (f64, f64, (u8, u8), [u8; 2]);

/// A flat frame of this luma, U 90 and V 200.
fn flat(luma: u8, shift: (u8, u8), act: impl FnOnce(&Frame<'_>)) {
    flat_sized(WIDTH, HEIGHT, luma, shift, act);
}

fn flat_sized(width: usize, height: usize, luma: u8, shift: (u8, u8), act: impl FnOnce(&Frame<'_>)) {
    let (cw, ch) = (width.div_ceil(1 << shift.0), height.div_ceil(1 << shift.1));
    let (y, u, v) = (vec![luma; width * height], vec![90; cw * ch], vec![200; cw * ch]);
    let chroma = |data| Plane { data, stride: cw, width: cw, height: ch };
    act(&Frame {
        index: 0,
        time_s: 0.0,
        y: Plane { data: &y, stride: width, width, height },
        u: chroma(&u),
        v: chroma(&v),
        shift_x: shift.0,
        shift_y: shift.1,
        chroma_first_px: [0.0; 2],
        encoding: ColourEncoding { range: Range::Limited, matrix: Matrix::Bt709 },
    });
}

fn settings(samples: SampleFormat) -> VideoSettings {
    VideoSettings { width: WIDTH as u32, height: HEIGHT as u32, fps: 25.0, samples, crf: 12 }
}

/// Encodes frames that grow brighter, at these times, and decodes them again.
fn round_trip(samples: SampleFormat, times_s: &[f64]) -> Vec<Seen> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.mp4");
    let mut writer = VideoWriter::create(File::create(&path).unwrap(), settings(samples)).unwrap();
    for (index, time_s) in times_s.iter().enumerate() {
        flat(luma_of(index), (1, 1), |frame| writer.write(&Frame { time_s: *time_s, ..*frame }).unwrap());
    }
    writer.finish().unwrap();
    let mut video = VideoFile::open(File::open(&path).unwrap(), MediaLimits::default()).unwrap();
    let mut seen = Vec::new();
    while let Some(picture) = video.next_picture().unwrap() {
        let frame = picture.frame();
        let rows = (0..frame.height()).flat_map(|row| frame.y.row(row)).map(|code| f64::from(*code));
        let mean = rows.sum::<f64>() / (frame.width() * frame.height()) as f64;
        let [_, u, v] = frame.yuv_at(WIDTH / 2, HEIGHT / 2);
        seen.push((frame.time_s, mean, (frame.shift_x, frame.shift_y), [u, v]));
    }
    seen
}

fn luma_of(index: usize) -> u8 {
    40 + 5 * index as u8
}

#[test]
fn uneven_and_missing_frames_come_back_at_their_own_times_in_order() {
    let times_s = [0.0, 0.041, 0.0795, 0.2, 0.2111, 0.36, 0.4, 0.44, 0.9, 0.95, 1.0, 1.041, 1.08, 2.5];
    let seen = round_trip(SampleFormat::Yuv420, &times_s);
    assert_eq!(seen.len(), times_s.len());
    for (index, (time_s, frame)) in times_s.iter().zip(&seen).enumerate() {
        assert!(
            (frame.0 - time_s).abs() <= 0.6 / f64::from(TICKS_PER_S),
            "frame {index} at {} instead of {time_s}",
            frame.0
        );
        assert!((frame.1 - f64::from(luma_of(index))).abs() < 2.0, "frame {index} has luma {}", frame.1);
    }
}

#[test]
fn every_sample_format_keeps_its_chroma_resolution_and_its_colour() {
    let expected = [
        (SampleFormat::Yuv420, (1, 1)),
        (SampleFormat::Yuv422, (1, 0)),
        (SampleFormat::Yuv444, (0, 0)),
        (SampleFormat::Yuv420Deep, (1, 1)),
        (SampleFormat::Yuv444Deep, (0, 0)),
    ];
    for (samples, shift) in expected {
        let seen = round_trip(samples, &[0.0, 0.04, 0.08]);
        assert_eq!(seen.len(), 3, "{samples:?}");
        let (_, luma, shifts, [u, v]) = seen[1];
        assert_eq!(shifts, shift, "{samples:?}");
        let off = [luma - f64::from(luma_of(1)), f64::from(u) - 90.0, f64::from(v) - 200.0];
        assert!(off.iter().all(|o| o.abs() < 2.5), "{samples:?}: codes are off by {off:?}");
    }
}

#[test]
fn an_odd_size_needs_full_chroma() {
    let odd = |samples| VideoSettings { width: 97, height: 63, ..settings(samples) };
    let open = |samples| VideoWriter::create(tempfile::tempfile().unwrap(), odd(samples));
    assert!(matches!(open(SampleFormat::Yuv420), Err(EncodeError::Refused { width: 97, height: 63, .. })));
    let mut writer = open(SampleFormat::Yuv444).unwrap();
    flat_sized(97, 63, 90, (0, 0), |frame| writer.write(frame).unwrap());
    writer.finish().unwrap();
}

#[test]
fn time_does_not_stand_still() {
    let mut writer = VideoWriter::create(tempfile::tempfile().unwrap(), settings(SampleFormat::Yuv420)).unwrap();
    flat(80, (1, 1), |frame| {
        writer.write(frame).unwrap();
        assert!(matches!(writer.write(frame), Err(EncodeError::Order { .. })));
    });
}
