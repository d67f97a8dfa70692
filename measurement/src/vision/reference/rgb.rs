//! Codes of a frame as gamma-coded R', G', B' codes from 0 to 255: the colours that both papers compute with.

use nalgebra::{Matrix3, Vector3};

use crate::vision::frame::{ColourEncoding, Frame};
use crate::vision::segmentation::region_of_interest::CELL_PX;

/// Largest code.
const WHITE: f64 = 255.0;

/// The conversion of one encoding, prepared once for all pixels.
pub(super) struct RgbConversion {
    matrix: Matrix3<f64>,
    /// The colour of the codes 0, 0, 0.
    offset: Vector3<f64>,
}

impl RgbConversion {
    /// The conversion from this encoding.
    pub(super) fn new(encoding: ColourEncoding) -> Self {
        let offset = encoding.rgb_of_codes([0.0; 3]) * WHITE;
        let of_one = |code: [f64; 3]| encoding.rgb_of_codes(code) * WHITE - offset;
        let columns = [of_one([1.0, 0.0, 0.0]), of_one([0.0, 1.0, 0.0]), of_one([0.0, 0.0, 1.0])];
        Self { matrix: Matrix3::from_columns(&columns), offset }
    }

    /// R', G', B' of these codes, limited to 0 to 255.
    pub(super) fn rgb_of(&self, yuv: [f64; 3]) -> Vector3<f64> {
        (self.matrix * Vector3::from(yuv) + self.offset).map(|code| code.clamp(0.0, WHITE))
    }

    /// R' of these codes, rounded.
    pub(super) fn red_of(&self, yuv: [u8; 3]) -> u8 {
        let red = self.matrix.row(0).dot(&Vector3::from(yuv.map(f64::from)).transpose()) + self.offset.x;
        red.round().clamp(0.0, WHITE) as u8
    }

    /// Mean R', G', B' of a cell's pixels.
    pub(super) fn rgb_of_cell(&self, frame: &Frame<'_>, column: usize, row: usize) -> Vector3<f64> {
        let range = |first: usize, end: usize| first * CELL_PX..((first + 1) * CELL_PX).min(end);
        let (mut sum, mut count) = ([0u32; 3], 0u32);
        for y in range(row, frame.height()) {
            for x in range(column, frame.width()) {
                let yuv = frame.yuv_at(x, y);
                sum = [0, 1, 2].map(|i| sum[i] + u32::from(yuv[i]));
                count += 1;
            }
        }
        self.rgb_of(sum.map(|of| f64::from(of) / f64::from(count.max(1))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::frame::{Matrix, Range};

    #[test]
    fn it_agrees_with_the_conversion_of_the_encoding() {
        for range in [Range::Full, Range::Limited] {
            let encoding = ColourEncoding { range, matrix: Matrix::Bt709 };
            let conversion = RgbConversion::new(encoding);
            for yuv in [[16, 128, 128], [120, 110, 140], [235, 128, 128], [90, 130, 100]] {
                let expected = encoding.rgb_of_codes(yuv.map(f64::from)) * WHITE;
                let found = conversion.rgb_of(yuv.map(f64::from));
                assert!((found - expected.map(|code| code.clamp(0.0, WHITE))).norm() < 1e-9, "{found} {expected}");
                assert_eq!(f64::from(conversion.red_of(yuv)), found.x.round());
            }
        }
    }
}
