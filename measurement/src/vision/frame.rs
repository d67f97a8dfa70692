//! One picture as the decoder returned it: borrowed Y, U and V planes with their time stamp. Nothing is copied.

use serde::{Deserialize, Serialize};

/// One 8-bit plane; `data[row * stride + column]`.
#[derive(Clone, Copy, Debug)]
pub struct Plane<'a> {
    /// Samples, row by row; rows are `stride` apart and at least `width` long.
    pub data: &'a [u8],
    /// Distance between rows, bytes; never assume that rows are packed.
    pub stride: usize,
    /// Samples in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl<'a> Plane<'a> {
    /// Row `y`, exactly `width` long.
    #[inline]
    pub fn row(&self, y: usize) -> &'a [u8] {
        &self.data[y * self.stride..y * self.stride + self.width]
    }

    /// The sample at column `x`, row `y`.
    #[inline]
    pub fn at(&self, x: usize, y: usize) -> u8 {
        self.data[y * self.stride + x]
    }
}

/// The codes of black and white.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Range {
    /// 16–235 (luma), 16–240 (chroma): most H.264.
    Limited,
    /// 0–255: JPEG and many phones.
    Full,
}

/// The weights that convert R, G, B to Y, U, V.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Matrix {
    /// ITU-R BT.601: standard definition and JPEG.
    Bt601,
    /// ITU-R BT.709: high definition.
    Bt709,
    /// ITU-R BT.2020, non-constant luminance: phones in HDR.
    Bt2020,
}

/// How the codes in the planes represent colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct ColourEncoding {
    /// Code range.
    pub range: Range,
    /// Conversion matrix.
    pub matrix: Matrix,
}

/// A decoded picture in display orientation.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Decoded frames before this one.
    pub index: u64,
    /// Presentation time, seconds from the start of the stream. Frames can be uneven or missing.
    pub time_s: f64,
    /// Luma, full resolution.
    pub y: Plane<'a>,
    /// Blue difference.
    pub u: Plane<'a>,
    /// Red difference.
    pub v: Plane<'a>,
    /// Chroma is `1 << shift_x` times coarser in x: 1 for 4:2:0 and 4:2:2, 0 for 4:4:4.
    pub shift_x: u8,
    /// Chroma is `1 << shift_y` times coarser in y: 1 for 4:2:0, 0 for 4:2:2 and 4:4:4.
    pub shift_y: u8,
    /// Position of the first chroma sample, pixels of luma: 0 on the first pixel, 0.5 midway to the second.
    pub chroma_first_px: [f32; 2],
    /// Encoding of the codes.
    pub encoding: ColourEncoding,
}

impl Frame<'_> {
    /// Columns of the picture.
    pub fn width(&self) -> usize {
        self.y.width
    }

    /// Rows of the picture.
    pub fn height(&self) -> usize {
        self.y.height
    }

    /// Y, U and V codes at a full-resolution pixel.
    #[inline]
    pub fn yuv_at(&self, x: usize, y: usize) -> [u8; 3] {
        let (cx, cy) = (x >> self.shift_x, y >> self.shift_y);
        [self.y.at(x, y), self.u.at(cx, cy), self.v.at(cx, cy)]
    }
}
