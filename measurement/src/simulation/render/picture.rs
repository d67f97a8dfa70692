//! A simulated picture: planes as a decoder would deliver them.

use crate::vision::frame::{ColourEncoding, Frame, Matrix, Plane, Range};

/// Chroma resolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chroma {
    /// Half in both directions (4:2:0), as in nearly all video.
    Quarter,
    /// Half across (4:2:2).
    Half,
    /// Full (4:4:4).
    Full,
}

impl Chroma {
    /// Right shifts from luma to chroma coordinates, x and y.
    pub fn shift(self) -> (u8, u8) {
        match self {
            Chroma::Quarter => (1, 1),
            Chroma::Half => (1, 0),
            Chroma::Full => (0, 0),
        }
    }
}

/// One picture, BT.709 limited range, packed rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rendered {
    /// Luma columns.
    pub width: usize,
    /// Luma rows.
    pub height: usize,
    /// Chroma resolution.
    pub chroma: Chroma,
    /// Luma.
    pub y: Vec<u8>,
    /// Blue difference.
    pub u: Vec<u8>,
    /// Red difference.
    pub v: Vec<u8>,
}

impl Rendered {
    /// A black picture.
    pub fn black(width: usize, height: usize, chroma: Chroma) -> Self {
        let (sx, sy) = chroma.shift();
        let samples = chroma_length(width, sx) * chroma_length(height, sy);
        Self { width, height, chroma, y: vec![16; width * height], u: vec![128; samples], v: vec![128; samples] }
    }

    /// The picture as the pipeline sees a decoded one.
    pub fn frame(&self, index: u64, time_s: f64) -> Frame<'_> {
        let (shift_x, shift_y) = self.chroma.shift();
        let (width, height) = (chroma_length(self.width, shift_x), chroma_length(self.height, shift_y));
        let chroma = |data| Plane { data, stride: width, width, height };
        Frame {
            index,
            time_s,
            y: Plane { data: &self.y, stride: self.width, width: self.width, height: self.height },
            u: chroma(&self.u),
            v: chroma(&self.v),
            shift_x,
            shift_y,
            chroma_first_px: [shift_x, shift_y].map(|halvings| 0.5 * (f32::from(1u16 << halvings) - 1.0)),
            encoding: ColourEncoding { range: Range::Limited, matrix: Matrix::Bt709 },
        }
    }
}

/// Chroma samples along an edge of this many luma samples.
pub fn chroma_length(luma: usize, shift: u8) -> usize {
    luma.div_ceil(1 << shift)
}
