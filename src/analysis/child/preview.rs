//! Makes a small JPEG of one frame, for lists and pages.

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};

use crate::vision::frame::Frame;

/// Largest width of a preview, pixels.
const MAX_WIDTH: usize = 480;

/// JPEG quality, 1–100.
const QUALITY: u8 = 80;

/// Keeps the better preview so far: the first frame, then the one in the middle of the recording.
pub(super) struct Preview {
    middle: u64,
    jpeg: Vec<u8>,
}

impl Preview {
    pub(super) fn new(frames_expected: Option<u64>) -> Self {
        Self { middle: frames_expected.unwrap_or(0) / 2, jpeg: Vec::new() }
    }

    /// Considers a frame; only two frames of a recording are encoded.
    pub(super) fn consider(&mut self, frame: &Frame<'_>) {
        if frame.index == 0 || frame.index == self.middle {
            // If encoding fails, the session only lacks a preview.
            if let Ok(jpeg) = encode(frame) {
                self.jpeg = jpeg;
            }
        }
    }

    /// The JPEG; empty if none could be encoded.
    pub(super) fn into_jpeg(self) -> Vec<u8> {
        self.jpeg
    }
}

fn encode(frame: &Frame<'_>) -> image::ImageResult<Vec<u8>> {
    let step = frame.width().div_ceil(MAX_WIDTH).max(1);
    let (width, height) = ((frame.width() / step).max(1), (frame.height() / step).max(1));
    let pixels: Vec<u8> = (0..height)
        .flat_map(|y| (0..width).map(move |x| (x * step, y * step)))
        .flat_map(|(x, y)| rgb(frame, x, y))
        .collect();
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, QUALITY).write_image(
        &pixels,
        width as u32,
        height as u32,
        ExtendedColorType::Rgb8,
    )?;
    Ok(jpeg)
}

fn rgb(frame: &Frame<'_>, x: usize, y: usize) -> [u8; 3] {
    let rgb = frame.encoding.rgb_of_codes(frame.yuv_at(x, y).map(f64::from));
    [rgb.x, rgb.y, rgb.z].map(|c| (c * 255.0).round().clamp(0.0, 255.0) as u8)
}
