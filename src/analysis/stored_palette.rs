//! The stored form of a box's colours: small, and readable in every version.

use serde::{Deserialize, Serialize};

use super::protocol::{decode, encode};
use crate::vision::frame::{ColourEncoding, Matrix, Range};
use crate::vision::segmentation::samples::{ColourSample, ColourSamples};

/// Stored form of [`ColourSamples`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct StoredPalette {
    /// Codes span 0–255.
    full_range: bool,
    /// Number of the standard: 601, 709 or 2020.
    matrix: u16,
    /// Labels.
    labels: Vec<String>,
    /// Label index and codes of each sample.
    samples: Vec<(u32, [u8; 3])>,
    /// How many samples each marked rectangle gave, in order; empty in palettes stored before rectangles were kept.
    rectangles: Vec<u32>,
}

/// Encodes a box's colours. Fails only for lack of memory.
pub fn store_palette(samples: &ColourSamples) -> Result<Vec<u8>, postcard::Error> {
    encode(&StoredPalette::from(samples))
}

/// Decodes a box's colours; `None` if no version of this program stored these bytes.
pub fn read_palette(bytes: &[u8]) -> Option<ColourSamples> {
    let without_rectangles = || decode(&[bytes, &[0]].concat()); // postcard encodes an empty list as one zero byte
    let stored: StoredPalette = decode(bytes).or_else(|_| without_rectangles()).ok()?;
    stored.colour_samples()
}

impl From<&ColourSamples> for StoredPalette {
    fn from(palette: &ColourSamples) -> Self {
        let matrix = match palette.encoding.matrix {
            Matrix::Bt601 => 601,
            Matrix::Bt709 => 709,
            Matrix::Bt2020 => 2020,
        };
        Self {
            full_range: palette.encoding.range == Range::Full,
            matrix,
            labels: palette.labels.clone(),
            samples: palette.samples.iter().map(|s| (s.label as u32, s.yuv)).collect(),
            rectangles: palette.samples.chunk_by(|a, b| a.rectangle == b.rectangle).map(|of| of.len() as u32).collect(),
        }
    }
}

impl StoredPalette {
    /// The samples; `None` if a sample has an unknown label, the rectangles do not add up, or the matrix is unknown.
    fn colour_samples(&self) -> Option<ColourSamples> {
        let matrix = match self.matrix {
            601 => Matrix::Bt601,
            709 => Matrix::Bt709,
            2020 => Matrix::Bt2020,
            _ => return None,
        };
        let range = if self.full_range { Range::Full } else { Range::Limited };
        let sample = |(&(label, yuv), rectangle): (&(u32, [u8; 3]), u32)| {
            ((label as usize) < self.labels.len()).then_some(ColourSample { label: label as usize, rectangle, yuv })
        };
        let samples = self.samples.iter().zip(self.rectangle_of_samples()?).map(sample).collect::<Option<_>>()?;
        let encoding = ColourEncoding { range, matrix };
        Some(ColourSamples { encoding, labels: self.labels.clone(), samples, places: Vec::new() })
    }

    /// The rectangle of each sample; one rectangle per label where rectangles were not stored.
    fn rectangle_of_samples(&self) -> Option<Vec<u32>> {
        if self.rectangles.is_empty() {
            return Some(self.samples.iter().map(|(label, _)| *label).collect());
        }
        let all: u64 = self.rectangles.iter().map(|n| u64::from(*n)).sum();
        let of_each = |(rectangle, n): (u32, &u32)| std::iter::repeat_n(rectangle, *n as usize);
        (all == self.samples.len() as u64).then(|| (0..).zip(&self.rectangles).flat_map(of_each).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples() -> ColourSamples {
        let encoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt709 };
        let sample = |label, rectangle, y| ColourSample { label, rectangle, yuv: [y, 100, 150] };
        let samples = vec![sample(0, 0, 10), sample(0, 0, 11), sample(1, 1, 12), sample(0, 2, 13)];
        ColourSamples { encoding, labels: vec!["orange".into(), "background".into()], samples, places: Vec::new() }
    }

    #[test]
    fn a_stored_palette_keeps_its_rectangles() {
        assert_eq!(read_palette(&store_palette(&samples()).unwrap()).unwrap(), samples());
    }

    #[test]
    fn a_palette_stored_before_rectangles_has_one_a_label() {
        let StoredPalette { full_range, matrix, labels, samples, .. } = StoredPalette::from(&samples());
        let read = read_palette(&encode(&(full_range, matrix, labels, samples)).unwrap()).unwrap();
        let rectangles: Vec<u32> = read.samples.iter().map(|s| s.rectangle).collect();
        assert_eq!(rectangles, [0, 0, 1, 0]);
    }

    #[test]
    fn rectangles_that_do_not_add_up_are_no_palette() {
        let shape = StoredPalette { rectangles: vec![4_000_000_000, 1], ..StoredPalette::from(&samples()) };
        assert_eq!(read_palette(&encode(&shape).unwrap()), None);
        assert_eq!(read_palette(&[7; 9]), None);
    }
}
