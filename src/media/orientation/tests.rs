//! What players show is the truth here: the matrix's own formula, and FFmpeg's tools.

use std::fs::File;
use std::process::Command;
use std::sync::Arc;

use proptest::prelude::*;

use super::*;
use crate::media::testing::{open, with_matrix};
use crate::media::{FeedDecoder, MediaLimits, SampleFormat, VideoFile, VideoSettings, VideoWriter};
use crate::vision::frame::{ColourEncoding, Frame, Matrix, Plane, Range};

/// The eight orientations as a, b, c, d: (x, y) is displayed at (ax + cy, bx + dy).
const EIGHT: [[i32; 4]; 8] = [
    [1, 0, 0, 1],
    [0, 1, -1, 0],
    [-1, 0, 0, -1],
    [0, -1, 1, 0],
    [-1, 0, 0, 1],
    [1, 0, 0, -1],
    [0, 1, 1, 0],
    [0, -1, -1, 0],
];

fn matrix([a, b, c, d]: [i32; 4]) -> [i32; 9] {
    [a << 16, b << 16, 0, c << 16, d << 16, 0, 0, 0, 1 << 30]
}

fn bytes_of(matrix: [i32; 9]) -> Vec<u8> {
    matrix.iter().flat_map(|number| number.to_ne_bytes()).collect()
}

fn orientation(parts: [i32; 4]) -> PictureOrientation {
    of_bytes(&bytes_of(matrix(parts))).unwrap()
}

/// Where a stored pixel is displayed, by the matrix's formula, in a picture of this stored size.
fn displayed_place([a, b, c, d]: [i32; 4], (x, y): (usize, usize), (width, height): (usize, usize)) -> (usize, usize) {
    let (x, y, right, bottom) = (x as i32, y as i32, width as i32 - 1, height as i32 - 1);
    let least = |p: i32, q: i32| (p * right).min(0) + (q * bottom).min(0);
    ((a * x + c * y - least(a, c)) as usize, (b * x + d * y - least(b, d)) as usize)
}

/// A recording without loss in 4:2:0: each pixel has a code of its own place.
fn recording_of(width: usize, height: usize) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.mp4");
    let (w, h) = (width as u32, height as u32);
    let settings = VideoSettings { width: w, height: h, fps: 25.0, samples: SampleFormat::Yuv420, crf: 0 };
    let mut writer = VideoWriter::create(File::create(&path).unwrap(), settings).unwrap();
    for index in 0..3 {
        let codes = |w: usize, h: usize, seed: usize| -> Vec<u8> {
            (0..w * h).map(|i| (16 + (i % w * 5 + i / w * 11 + seed + index * 3) % 200) as u8).collect()
        };
        let (cw, ch) = (width / 2, height / 2);
        let planes = [codes(width, height, 0), codes(cw, ch, 70), codes(cw, ch, 140)];
        writer.write(&frame_of(&planes, (width, height), (1, 1), index as f64 / 25.0)).unwrap();
    }
    writer.finish().unwrap();
    std::fs::read(&path).unwrap()
}

fn frame_of(planes: &[Vec<u8>; 3], (width, height): (usize, usize), shift: (u8, u8), time_s: f64) -> Frame<'_> {
    let (cw, ch) = (width.div_ceil(1 << shift.0), height.div_ceil(1 << shift.1));
    Frame {
        index: 0,
        time_s,
        y: Plane { data: &planes[0], stride: width, width, height },
        u: Plane { data: &planes[1], stride: cw, width: cw, height: ch },
        v: Plane { data: &planes[2], stride: cw, width: cw, height: ch },
        shift_x: shift.0,
        shift_y: shift.1,
        chroma_first_px: [0.5; 2],
        encoding: ColourEncoding { range: Range::Limited, matrix: Matrix::Bt709 },
    }
}

/// Size and packed planes of every frame.
fn decoded(mut video: VideoFile) -> Vec<((usize, usize), Vec<u8>)> {
    let mut frames = Vec::new();
    while let Some(picture) = video.next_picture().unwrap() {
        let frame = picture.frame();
        let rows = [frame.y, frame.u, frame.v].map(|plane| (0..plane.height).flat_map(move |y| plane.row(y).to_vec()));
        frames.push(((frame.width(), frame.height()), rows.into_iter().flatten().collect()));
    }
    frames
}

#[test]
fn every_orientation_is_shown_as_ffmpeg_shows_it() {
    let clip = recording_of(96, 64);
    let folder = tempfile::tempdir().unwrap();
    for parts in EIGHT {
        let turned = with_matrix(clip.clone(), matrix(parts));
        let path = folder.path().join("turned.mp4");
        std::fs::write(&path, &turned).unwrap();
        let mut ffmpeg = Command::new("ffmpeg");
        ffmpeg.args(["-v", "error", "-i"]).arg(&path).args(["-f", "rawvideo", "-pix_fmt", "yuv420p", "-"]);
        let shown = ffmpeg.output().unwrap().stdout;
        let frames = decoded(open(&Arc::from(turned), MediaLimits::default()));
        let size = if parts[0] == 0 { (64, 96) } else { (96, 64) };
        assert!(frames.len() == 3 && frames.iter().all(|frame| frame.0 == size), "{parts:?}");
        assert!(frames.into_iter().flat_map(|frame| frame.1).eq(shown), "{parts:?}");
    }
}

#[test]
fn every_orientation_follows_the_matrix_s_formula() {
    for size in [(4, 6), (5, 3), (1, 1)] {
        for parts in EIGHT {
            let orientation = orientation(parts);
            for (x, y) in (0..size.0).flat_map(|x| (0..size.1).map(move |y| (x, y))) {
                let shown = displayed_place(parts, (x, y), size);
                assert_eq!(orientation.stored_place(shown, size), (x, y), "{parts:?} {size:?}");
            }
        }
    }
}

#[test]
fn chroma_samples_stay_at_their_place_when_a_picture_is_turned() {
    for parts in EIGHT {
        let shown = |first, shift| orientation(parts).displayed_chroma(first, shift);
        // The first sample as displayed is the stored sample of that corner; its place follows the formula, too.
        let [a, b, c, d] = parts.map(|part| part as f32);
        let corner = |first: f32, reversed: bool| if reversed { 4.0 + first } else { first };
        let [x, y] = [corner(0.0, a + b < 0.0), corner(0.5, c + d < 0.0)];
        let least = |p: f32, q: f32| (5.0 * p).min(0.0) + (5.0 * q).min(0.0);
        let formula = [a * x + c * y - least(a, c), b * x + d * y - least(b, d)];
        assert_eq!(shown([0.0, 0.5], (1, 1)), formula, "{parts:?}");
    }
}

#[test]
fn a_matrix_that_no_phone_writes_is_refused_with_what_it_does() {
    let turned = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        [cos, sin, -sin, cos].map(|part| (part * ONE).round() as i32)
    };
    let refused = |[a, b, c, d]: [i32; 4], u: i32| {
        let clip = with_matrix(recording_of(96, 64), [a, b, u, c, d, 0, 0, 0, 1 << 30]);
        let error = VideoFile::open(std::io::Cursor::new(clip), MediaLimits::default()).err().unwrap().to_string();
        assert!(error.contains("Export the recording"), "{error}");
        error
    };
    let one = ONE as i32;
    for (parts, how) in [
        (turned(12.0), "turned by 12.0°"),
        (turned(-89.0), "turned by -89.0°"),
        ([2 * one, 0, 0, 2 * one], "scaled by the factor 2.000"),
        ([one, 0, 0, one / 2], "stretched"),
        ([one, 0, one / 2, one], "slanted"),
        ([one, one, one, one], "pressed into a line"),
        ([0; 4], "pressed into a line"),
    ] {
        let error = refused(parts, 0);
        assert!(error.contains(how), "{error}");
    }
    assert!(refused([one, 0, 0, one], 1 << 20).contains("perspective"));
}

#[test]
fn a_rounded_matrix_is_taken_for_the_one_that_was_meant() {
    for parts in EIGHT {
        let rounded = matrix(parts).map(|number| if number == 0 { -3 } else { number + 5 });
        let [a, b, _, c, d, ..] = rounded;
        let rounded = bytes_of([a, b, 0, c, d, 0, 0, 0, 1 << 30]);
        assert_eq!(of_bytes(&rounded).unwrap(), orientation(parts));
    }
}

#[test]
fn an_orientation_inside_the_frames_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (upright, noted) = (folder.path().join("upright.mp4"), folder.path().join("noted.h264"));
    std::fs::write(&upright, recording_of(96, 64)).unwrap();
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-v", "error", "-i"]).arg(&upright).args(["-c", "copy", "-bsf:v"]);
    ffmpeg.arg("h264_mp4toannexb,h264_metadata=display_orientation=insert:flip=horizontal");
    assert!(ffmpeg.arg(&noted).status().unwrap().success());
    let mut in_mp4 = Command::new("ffmpeg");
    in_mp4.args(["-v", "error", "-i"]).arg(&noted).args(["-c", "copy"]);
    assert!(in_mp4.arg(folder.path().join("noted.mp4")).status().unwrap().success());

    let mut video =
        VideoFile::open(File::open(folder.path().join("noted.mp4")).unwrap(), MediaLimits::default()).unwrap();
    assert!(matches!(video.next_picture(), Err(MediaError::Orientation(_))));

    let (codec, time_base) = (crate::domain::feed::FrameCodec::H264, [1, 25_000].try_into().unwrap());
    let mut live = FeedDecoder::new(codec, (96, 64), time_base, MediaLimits::default()).unwrap();
    live.send_frame(0, 0, &std::fs::read(&noted).unwrap()).unwrap();
    live.finish_input();
    assert!(matches!(live.next_picture(), Err(MediaError::Orientation(_))));
}

proptest! {
    #[test]
    fn any_matrix_is_one_of_the_eight_or_refused(numbers in prop::array::uniform9(any::<i32>()), cut in 0usize..40) {
        let mut bytes = bytes_of(numbers);
        let _ = of_bytes(&bytes);
        bytes.truncate(cut);
        let _ = of_bytes(&bytes);
    }
}
