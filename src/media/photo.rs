//! A photo that lies whole in a file: its luma, in display orientation.
//!
//! Photos come from strangers: only JPEG and PNG are decoded (in Rust, without FFmpeg), sizes and memory are bounded
//! before a pixel is read. The EXIF orientation is honoured, as [`super::VideoFile`] honours a video's rotation:
//! otherwise a phone's photos and its videos would calibrate two different cameras.

use std::io::{BufRead, Seek};

use image::{DynamicImage, ImageDecoder, ImageReader};

use super::file::check_size;
use super::{Limits, MediaError};
use crate::pipeline::frame::Plane;

/// Most memory that decoding one photo may take, bytes: four bytes of sixteen bits for each pixel within [`Limits`].
const MOST_BYTES: u64 = 256 << 20;

/// A photo's luma, 0–255; owns its memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Luma {
    data: Vec<u8>,
    width: u32,
    height: u32,
}

impl Luma {
    /// The photo as the pipeline sees it.
    pub fn plane(&self) -> Plane<'_> {
        let (width, height) = (self.width as usize, self.height as usize);
        Plane { data: &self.data, stride: width, width, height }
    }

    /// Columns, pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows, pixels.
    pub fn height(&self) -> u32 {
        self.height
    }
}

/// Whether a file that begins like this is a photo, of whatever kind: not a video.
pub fn is_photo(first_bytes: &[u8]) -> bool {
    image::guess_format(first_bytes).is_ok()
}

/// Reads a JPEG or PNG photo. [`MediaError::Photo`] if it is none or damaged, [`MediaError::OverLimit`] if it is larger
/// than a recording may be.
pub fn read_luma(bytes: impl BufRead + Seek, limits: Limits) -> Result<Luma, MediaError> {
    let mut reader = ImageReader::new(bytes).with_guessed_format().map_err(unreadable)?;
    let mut bounds = image::Limits::default();
    bounds.max_alloc = Some(MOST_BYTES);
    reader.limits(bounds);
    let mut decoder = reader.into_decoder().map_err(unreadable)?;
    let (width, height) = decoder.dimensions();
    check_size(width, height, limits)?;
    let orientation = decoder.orientation().map_err(unreadable)?;
    let mut picture = DynamicImage::from_decoder(decoder).map_err(unreadable)?;
    picture.apply_orientation(orientation);
    let (width, height) = (picture.width(), picture.height());
    Ok(Luma { data: luma(picture), width, height })
}

/// Grey pictures as they are; colour by BT.601's weights, which give back the Y that a JPEG holds. (`into_luma8` weighs
/// by BT.709: on a lens with colour fringes its edges lie elsewhere, half a pixel on a real laparoscope.)
fn luma(picture: DynamicImage) -> Vec<u8> {
    if !picture.color().has_color() {
        return picture.into_luma8().into_raw();
    }
    let weigh =
        |[r, g, b]: [u8; 3]| (19_595 * u32::from(r) + 38_470 * u32::from(g) + 7_471 * u32::from(b) + 32_768) >> 16;
    picture.into_rgb8().pixels().map(|p| weigh(p.0) as u8).collect() // the weights add up to 1: at most 255
}

fn unreadable(error: impl std::fmt::Display) -> MediaError {
    MediaError::Photo(error.to_string())
}
