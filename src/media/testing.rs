//! Recordings and EXIF blocks for tests, and hashes of frames.

use std::fs::File;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::Cursor;
use std::sync::Arc;

use super::{MediaLimits, SampleFormat, VideoFile, VideoSettings, VideoWriter};
use crate::vision::frame::{ColourEncoding, Frame, Matrix, Plane, Range};

const WIDTH: usize = 96;
const HEIGHT: usize = 64;

/// The bytes of an MP4 recording at 25 Hz with a key frame every two seconds: a moving texture with grain.
pub(super) fn recording(samples: SampleFormat, frames: u64) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.mp4");
    let settings = VideoSettings { width: WIDTH as u32, height: HEIGHT as u32, fps: 25.0, samples, crf: 23 };
    let mut writer = VideoWriter::create(File::create(&path).unwrap(), settings).unwrap();
    for index in 0..frames {
        let code = |x: usize, y: usize| {
            let grain = (((x * 31 + y * 17 + index as usize * 101) * 2_654_435_761) >> 12) & 15;
            (60 + (x * 3 + y * 5 + index as usize * 2) % 120 + grain) as u8
        };
        let plane = |w: usize, h: usize| (0..w * h).map(|i| code(i % w, i / w)).collect::<Vec<u8>>();
        let (y, u, v) = (plane(WIDTH, HEIGHT), plane(WIDTH / 2, HEIGHT / 2), plane(WIDTH / 2, HEIGHT / 2));
        let chroma = |data| Plane { data, stride: WIDTH / 2, width: WIDTH / 2, height: HEIGHT / 2 };
        let frame = Frame {
            index,
            time_s: index as f64 / 25.0,
            y: Plane { data: &y, stride: WIDTH, width: WIDTH, height: HEIGHT },
            u: chroma(&u),
            v: chroma(&v),
            shift_x: 1,
            shift_y: 1,
            chroma_first_px: [0.5; 2],
            encoding: ColourEncoding { range: Range::Limited, matrix: Matrix::Bt709 },
        };
        writer.write(&frame).unwrap();
    }
    writer.finish().unwrap();
    std::fs::read(&path).unwrap()
}

/// An MP4 recording with another display matrix in its only track: nine numbers, 16.16 fixed point.
pub(super) fn with_matrix(mut mp4: Vec<u8>, matrix: [i32; 9]) -> Vec<u8> {
    let header = mp4.windows(4).position(|name| name == b"tkhd").unwrap();
    assert_eq!(mp4[header + 4], 0, "the header's version, which sets the matrix's place");
    for (number, place) in matrix.iter().zip((header + 44..).step_by(4)) {
        mp4[place..place + 4].copy_from_slice(&number.to_be_bytes());
    }
    mp4
}

/// Opens the recording. The reference count of `recording` shows whether it is still open.
pub(super) fn open(recording: &Arc<[u8]>, limits: MediaLimits) -> VideoFile {
    VideoFile::open(Cursor::new(recording.clone()), limits).unwrap()
}

/// A frame's number, time and pixel hash.
pub(super) fn seen(frame: &Frame<'_>) -> (u64, f64, u64) {
    let mut hasher = DefaultHasher::new();
    for plane in [frame.y, frame.u, frame.v] {
        (0..plane.height).for_each(|row| plane.row(row).hash(&mut hasher));
    }
    (frame.index, frame.time_s, hasher.finish())
}

/// All frames of the recording, decoded one after the other.
pub(super) fn all(recording: &Arc<[u8]>) -> Vec<(u64, f64, u64)> {
    let mut video = open(recording, MediaLimits::default());
    std::iter::from_fn(|| video.next_picture().unwrap()).map(|picture| seen(&picture.frame())).collect()
}

/// The smallest EXIF block with an orientation, 1 to 8.
pub fn exif(orientation: u8) -> Vec<u8> {
    let mut block = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
    block.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
    block
}
