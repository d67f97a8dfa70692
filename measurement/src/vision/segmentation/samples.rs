//! Colour samples: the pixels inside the rectangles that an instructor marked. Plain data, so that they can be stored
//! per box and read back.

use serde::{Deserialize, Serialize};

use crate::vision::frame::{ColourEncoding, Frame};

/// A marked rectangle, in pixels of the recorded frame; `x`, `y` is its first pixel.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MarkedRectangle {
    /// Name of the tool's colour, or a label that is no tool (`background`, `shaft`, …).
    pub label: String,
    /// First column.
    pub x: usize,
    /// First row.
    pub y: usize,
    /// Columns.
    pub w: usize,
    /// Rows.
    pub h: usize,
}

/// One marked colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ColourSample {
    /// Index into [`ColourSamples::labels`].
    pub label: usize,
    /// The marked rectangle that it comes from, counted over all labels from 0. Pixels of one rectangle resemble each
    /// other more than the same tape on the next frame.
    pub rectangle: u32,
    /// Codes as decoded, in the samples' encoding.
    pub yuv: [u8; 3],
}

/// All marked colours of a box.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ColourSamples {
    /// How the codes relate to colour.
    pub encoding: ColourEncoding,
    /// Label names.
    pub labels: Vec<String>,
    /// The samples.
    pub samples: Vec<ColourSample>,
    /// Where each stroke begins, by its number as [`ColourSample::rectangle`]; empty for stored samples.
    pub places: Vec<RectanglePlace>,
}

/// Where an instructor marked a colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RectanglePlace {
    /// The frame.
    pub frame: u64,
    /// First column of its first rectangle, pixels.
    pub x: usize,
    /// First row.
    pub y: usize,
}

/// Maximum number of samples from one rectangle; in a larger one, pixels are taken at even steps. Otherwise a huge
/// background rectangle would cost time and outvote the tape.
const MAX_PER_RECTANGLE: usize = 400;

#[cfg(test)]
impl ColourSamples {
    /// Orange tape (150, 60, 200) and a grey background (60, 128, 128), for tests that draw their own pictures.
    pub fn of_orange_tape(encoding: ColourEncoding) -> Self {
        let sample = |label, yuv| ColourSample { label, rectangle: label as u32, yuv };
        Self {
            encoding,
            labels: vec!["orange".into(), "background".into()],
            samples: [sample(0, [150, 60, 200]), sample(1, [60, 128, 128])].repeat(5),
            places: Vec::new(),
        }
    }
}

impl ColourSamples {
    /// No samples yet, in this encoding.
    pub fn new(encoding: ColourEncoding) -> Self {
        Self { encoding, labels: Vec::new(), samples: Vec::new(), places: Vec::new() }
    }

    /// Adds the pixels inside rectangles of one label, without parts outside the frame. Several rectangles were painted
    /// in one stroke: together they count as one. Codes of a frame in another encoding are converted to the samples'
    /// encoding.
    pub fn collect_stroke(&mut self, frame: &Frame<'_>, rectangles: &[MarkedRectangle]) {
        let number = self.samples.last().map_or(0, |last| last.rectangle + 1);
        let end = |of: &MarkedRectangle| {
            (of.x.saturating_add(of.w).min(frame.width()), of.y.saturating_add(of.h).min(frame.height()))
        };
        let size = |of: &MarkedRectangle| end(of).0.saturating_sub(of.x) * end(of).1.saturating_sub(of.y);
        let pixels: usize = rectangles.iter().map(size).sum();
        let too_many = pixels.div_ceil(MAX_PER_RECTANGLE).max(1);
        // A single rectangle is sampled on a grid. Of a stroke, whose rectangles may be one row high, every n-th pixel
        // is taken: a new grid in each rectangle would take at least one pixel of each, however many there are.
        let (step, every) = match rectangles.len() {
            1 => ((too_many as f64).sqrt().ceil() as usize, 1),
            _ => (1, too_many),
        };
        let on_grid = |of: &'_ MarkedRectangle| {
            let (left, (right, bottom)) = (of.x, end(of));
            (of.y..bottom).step_by(step).flat_map(move |y| (left..right).step_by(step).map(move |x| (x, y)))
        };
        let marked = rectangles.iter().flat_map(|of| on_grid(of).map(move |at| (of, at)));
        if let Some(first) = rectangles.first() {
            self.places.truncate(number as usize); // a stroke outside the frame has no sample, and gives its number back
            self.places.push(RectanglePlace { frame: frame.index, x: first.x, y: first.y });
        }
        for (of, (x, y)) in marked.step_by(every) {
            let label = self.label_index(&of.label);
            let yuv = self.encoding.codes_of(frame.encoding.colour_of(frame.yuv_at(x, y)));
            self.samples.push(ColourSample { label, rectangle: number, yuv });
        }
    }

    /// The class of each label for these tapes: 0 if it is none of them, else the tape's position counted from 1.
    pub fn classes(&self, tapes: &[String]) -> Vec<u8> {
        let place = |label: &String| tapes.iter().position(|tape| tape == label);
        self.labels.iter().map(|label| place(label).map_or(0, |place| place as u8 + 1)).collect()
    }

    /// Number of samples of a label.
    pub fn count(&self, label: &str) -> usize {
        self.samples.iter().filter(|s| self.labels[s.label] == label).count()
    }

    /// Number of samples per label, in the order of the labels.
    pub fn counts(&self) -> Vec<(String, u64)> {
        self.labels.iter().map(|label| (label.clone(), self.count(label) as u64)).collect()
    }

    /// Mean and spread of a label's samples, as codes of the given encoding.
    pub fn usual_colour(&self, label: &str, encoding: ColourEncoding) -> UsualColour {
        let own = self.codes_of_label(label, encoding);
        let (count, sum, squares) = own.fold((0.0, [0.0; 3], [0.0; 3]), |(n, sum, squares), codes| {
            let codes = codes.map(f64::from);
            let add = |sum: [f64; 3], more: [f64; 3]| [0, 1, 2].map(|i| sum[i] + more[i]);
            (n + 1.0, add(sum, codes), add(squares, codes.map(|code| code * code)))
        });
        let count = f64::max(count, 1.0);
        let codes = sum.map(|s| s / count);
        let variance = |i: usize| squares[i] / count - codes[i] * codes[i];
        UsualColour {
            codes,
            luma_spread: variance(0).max(0.0).sqrt(),
            chroma_spread: (variance(1) + variance(2)).max(0.0).sqrt(),
        }
    }

    /// The codes of a label's samples, in the given encoding.
    pub fn codes_of_label(&self, label: &str, encoding: ColourEncoding) -> impl Iterator<Item = [u8; 3]> {
        let own = self.samples.iter().filter(move |s| self.labels[s.label] == label);
        own.map(move |s| encoding.codes_of(self.encoding.colour_of(s.yuv)))
    }

    fn label_index(&mut self, name: &str) -> usize {
        self.labels.iter().position(|l| l == name).unwrap_or_else(|| {
            self.labels.push(name.to_owned());
            self.labels.len() - 1
        })
    }
}

/// The colour of a label's samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UsualColour {
    /// Mean codes of Y, U, V.
    pub codes: [f64; 3],
    /// Standard deviation of the samples' luma, codes.
    pub luma_spread: f64,
    /// Distance of the samples' chroma from the mean, root mean square, codes. Light and shade on a round tape change
    /// its chroma.
    pub chroma_spread: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::frame::{Matrix, Plane, Range};
    use proptest::prelude::*;

    const SIZE: usize = 200;
    const ENCODING: ColourEncoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 };

    /// Number of samples from a stroke of these rectangles on a grey frame.
    fn samples_of(rectangles: &[MarkedRectangle]) -> usize {
        let grey = vec![128; SIZE * SIZE];
        let plane = Plane { data: &grey, stride: SIZE, width: SIZE, height: SIZE };
        let (y, u, v) = (plane, plane, plane);
        let frame = Frame {
            index: 0,
            time_s: 0.0,
            y,
            u,
            v,
            shift_x: 0,
            shift_y: 0,
            chroma_first_px: [0.0; 2],
            encoding: ENCODING,
        };
        let mut samples = ColourSamples::new(ENCODING);
        samples.collect_stroke(&frame, rectangles);
        assert!(samples.samples.iter().all(|sample| sample.rectangle == 0), "one stroke");
        samples.samples.len()
    }

    proptest! {
        #[test]
        fn a_stroke_has_as_many_votes_as_a_rectangle_however_it_is_cut(
            (x, y, w) in (0..60_usize, 0..60_usize, 1..140_usize),
            heights in proptest::collection::vec(1..4_usize, 2..40),
        ) {
            let mut top = y;
            let strips: Vec<MarkedRectangle> = heights.iter().map(|&h| {
                top += h;
                MarkedRectangle { label: "background".into(), x, y: top - h, w, h }
            }).collect();
            let pixels = w * heights.iter().sum::<usize>();
            let taken = samples_of(&strips);
            prop_assert!(taken <= MAX_PER_RECTANGLE, "{taken} of {pixels}");
            prop_assert!(taken >= pixels.min(MAX_PER_RECTANGLE / 2), "{taken} of {pixels}");
        }
    }
}
