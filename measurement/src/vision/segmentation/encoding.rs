//! Conversions between a video's Y, U, V codes and gamma-coded colour: range and matrix only.

use nalgebra::{Matrix3, Vector3};

use crate::vision::frame::{ColourEncoding, Matrix, Range};

impl ColourEncoding {
    /// Codes to gamma-coded `[Y', Pb, Pr]`: luma 0..1, differences −0.5..0.5.
    pub fn colour_of(&self, yuv: [u8; 3]) -> [f64; 3] {
        self.colour_of_codes(yuv.map(f64::from))
    }

    /// The same for fractional codes.
    pub fn colour_of_codes(&self, yuv: [f64; 3]) -> [f64; 3] {
        let (black, luma_span, chroma_span) = self.spans();
        [(yuv[0] - black) / luma_span, (yuv[1] - 128.0) / chroma_span, (yuv[2] - 128.0) / chroma_span]
    }

    /// Gamma-coded `[Y', Pb, Pr]` to the nearest codes.
    pub fn codes_of(&self, colour: [f64; 3]) -> [u8; 3] {
        let (black, luma_span, chroma_span) = self.spans();
        let codes = [colour[0] * luma_span + black, colour[1] * chroma_span + 128.0, colour[2] * chroma_span + 128.0];
        codes.map(|c| c.round().clamp(0.0, 255.0) as u8)
    }

    /// Weights of R', G', B' in luma.
    pub fn luma_weights(&self) -> [f64; 3] {
        match self.matrix {
            Matrix::Bt601 => [0.299, 0.587, 0.114],
            Matrix::Bt709 => [0.2126, 0.7152, 0.0722],
            Matrix::Bt2020 => [0.2627, 0.6780, 0.0593],
        }
    }

    /// Matrix from `[Y', Pb, Pr]` to gamma-coded `[R', G', B']`.
    pub fn rgb_from_colour(&self) -> Matrix3<f64> {
        let [kr, kg, kb] = self.luma_weights();
        let (blue, red) = (2.0 * (1.0 - kb), 2.0 * (1.0 - kr));
        Matrix3::new(1.0, 0.0, red, 1.0, -blue * kb / kg, -red * kr / kg, 1.0, blue, 0.0)
    }

    /// Gamma-coded `[R', G', B']` to `[Y', Pb, Pr]`.
    pub fn colour_of_rgb(&self, [r, g, b]: [f64; 3]) -> [f64; 3] {
        let [kr, kg, kb] = self.luma_weights();
        let luma = kr * r + kg * g + kb * b;
        [luma, (b - luma) / (2.0 * (1.0 - kb)), (r - luma) / (2.0 * (1.0 - kr))]
    }

    /// Codes to gamma-coded `[R', G', B']` in 0..1; values outside are kept.
    pub fn rgb_of_codes(&self, yuv: [f64; 3]) -> Vector3<f64> {
        self.rgb_from_colour() * Vector3::from(self.colour_of_codes(yuv))
    }

    /// Matrix from differences of gamma-coded `[R', G', B']` to differences of codes.
    pub fn codes_from_rgb(&self) -> Matrix3<f64> {
        let [kr, kg, kb] = self.luma_weights();
        let (blue, red) = (0.5 / (1.0 - kb), 0.5 / (1.0 - kr));
        let (_, luma_span, chroma_span) = self.spans();
        let colour_from_rgb =
            Matrix3::new(kr, kg, kb, -kr * blue, -kg * blue, (1.0 - kb) * blue, (1.0 - kr) * red, -kg * red, -kb * red);
        Matrix3::from_diagonal(&Vector3::new(luma_span, chroma_span, chroma_span)) * colour_from_rgb
    }

    /// Codes of black.
    pub fn black(&self) -> [f64; 3] {
        [self.spans().0, 128.0, 128.0]
    }

    fn spans(&self) -> (f64, f64, f64) {
        match self.range {
            Range::Limited => (16.0, 219.0, 224.0),
            Range::Full => (0.0, 255.0, 255.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ENCODINGS: [ColourEncoding; 4] = [
        ColourEncoding { range: Range::Limited, matrix: Matrix::Bt709 },
        ColourEncoding { range: Range::Full, matrix: Matrix::Bt709 },
        ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 },
        ColourEncoding { range: Range::Limited, matrix: Matrix::Bt2020 },
    ];

    #[test]
    fn grey_has_equal_red_green_and_blue_in_every_encoding() {
        for encoding in ENCODINGS {
            let rgb = encoding.rgb_of_codes([100.0, 128.0, 128.0]);
            assert!((rgb.max() - rgb.min()).abs() < 1e-12, "{encoding:?}: {rgb}");
        }
    }

    #[test]
    fn codes_survive_the_way_through_colour_and_back() {
        for encoding in ENCODINGS {
            for yuv in [[16, 128, 128], [200, 90, 210], [77, 140, 30]] {
                assert_eq!(encoding.codes_of(encoding.colour_of(yuv)), yuv);
            }
        }
    }

    #[test]
    fn red_green_and_blue_come_back_through_colour() {
        for encoding in ENCODINGS {
            let rgb = [0.8, 0.3, 0.1];
            let back = encoding.rgb_from_colour() * Vector3::from(encoding.colour_of_rgb(rgb));
            assert!((back - Vector3::from(rgb)).norm() < 1e-12, "{encoding:?}: {back}");
        }
    }

    #[test]
    fn differences_of_colour_come_back_as_differences_of_codes() {
        for encoding in ENCODINGS {
            let (one, other) = ([120.0, 100.0, 180.0], [70.0, 140.0, 110.0]);
            let difference = encoding.rgb_of_codes(one) - encoding.rgb_of_codes(other);
            let codes = encoding.codes_from_rgb() * difference;
            assert!((codes - (Vector3::from(one) - Vector3::from(other))).norm() < 1e-9);
        }
    }

    #[test]
    fn luma_of_the_decoded_red_green_and_blue_is_the_luma_coded() {
        for encoding in ENCODINGS {
            let rgb = encoding.rgb_of_codes([120.0, 100.0, 180.0]);
            let luma: f64 = encoding.luma_weights().iter().zip(rgb.iter()).map(|(w, c)| w * c).sum();
            assert!((luma - encoding.colour_of([120, 100, 180])[0]).abs() < 1e-9);
        }
    }
}
