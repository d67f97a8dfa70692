//! The local contrast of a small picture: luma relative to its neighbourhood, in units of the neighbourhood's spread.
//!
//! Exposure, tone curve, vignetting and white balance change brightness and contrast slowly over the picture, so they
//! cancel. Plain areas stay near zero, because the spread has a floor ([`NOISE_CODES`]).

use super::alignment::Alignment;

/// Half the width of the neighbourhood, cells: a twelfth of the picture's width in all, wider than the structures of a
/// mat and narrower than the light's gradient.
const REACH: usize = 5;

/// Spread of a plain area, codes of 255. Noise of 5 codes per pixel, averaged over at least 25 pixels per cell and over
/// the frames, leaves less than 1; compression adds blocks of about 1.
const NOISE_CODES: f32 = 2.0;

/// Contrast beyond this many spreads says no more: a glint is one structure, not ten.
const MAX_CONTRAST: f32 = 2.5;

/// A picture of local contrast, row by row.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ContrastPicture {
    pub(super) columns: usize,
    pub(super) rows: usize,
    pub(super) values: Vec<f32>,
}

impl ContrastPicture {
    /// From luma codes.
    pub(super) fn of(columns: usize, rows: usize, luma: &[f32]) -> Self {
        let neighbourhood = Neighbourhood::of(columns, rows, luma);
        let contrast = |index: usize| {
            let (mean, variance) = neighbourhood.around(index);
            let spread = (variance + NOISE_CODES * NOISE_CODES).sqrt();
            ((luma[index] - mean) / spread).clamp(-MAX_CONTRAST, MAX_CONTRAST)
        };
        Self { columns, rows, values: (0..columns * rows).map(contrast).collect() }
    }

    /// The value between cells; `None` outside the picture.
    pub(super) fn at(&self, x: f32, y: f32) -> Option<f32> {
        let (left, top) = (x.floor(), y.floor());
        if left < 0.0 || top < 0.0 || x > (self.columns - 1) as f32 || y > (self.rows - 1) as f32 {
            return None;
        }
        let (column, row) = ((left as usize).min(self.columns - 2), (top as usize).min(self.rows - 2));
        let (right, down) = (x - column as f32, y - row as f32);
        let at = row * self.columns + column;
        let between = |at: usize| self.values[at] * (1.0 - right) + self.values[at + 1] * right;
        Some(between(at) * (1.0 - down) + between(at + self.columns) * down)
    }

    /// The picture as it would look after a change of the camera; [`f32::NAN`] where it did not show anything.
    pub(super) fn aligned(&self, alignment: &Alignment) -> Self {
        let place = alignment.inverse(self.columns, self.rows);
        let value = |index: usize| {
            let [x, y] = place([(index % self.columns) as f32, (index / self.columns) as f32]);
            self.at(x, y).unwrap_or(f32::NAN)
        };
        Self { values: (0..self.values.len()).map(value).collect(), ..*self }
    }

    /// Seen in a mirror, upright or not.
    pub(super) fn mirrored(&self, [across, down]: [bool; 2]) -> Self {
        let from = |index: usize| {
            let (x, y) = (index % self.columns, index / self.columns);
            let x = if across { self.columns - 1 - x } else { x };
            let y = if down { self.rows - 1 - y } else { y };
            self.values[y * self.columns + x]
        };
        Self { values: (0..self.values.len()).map(from).collect(), ..*self }
    }
}

/// Luma relative to the mean of its neighbourhood, codes.
pub(super) fn deviations(columns: usize, rows: usize, luma: &[f32]) -> ContrastPicture {
    let neighbourhood = Neighbourhood::of(columns, rows, luma);
    let values = luma.iter().enumerate().map(|(index, code)| code - neighbourhood.around(index).0).collect();
    ContrastPicture { columns, rows, values }
}

/// Means and variances around each cell.
struct Neighbourhood {
    rows: usize,
    sums: IntegralImage,
    squares: IntegralImage,
}

impl Neighbourhood {
    fn of(columns: usize, rows: usize, luma: &[f32]) -> Self {
        let sums = IntegralImage::of(columns, rows, luma.iter().map(|code| f64::from(*code)));
        let squares = IntegralImage::of(columns, rows, luma.iter().map(|code| f64::from(*code).powi(2)));
        Self { rows, sums, squares }
    }

    /// Mean and variance around the cell with this index.
    fn around(&self, index: usize) -> (f32, f32) {
        let columns = self.sums.columns;
        let window = Window::around(index % columns, index / columns, columns, self.rows);
        let mean = self.sums.mean(window);
        (mean as f32, (self.squares.mean(window) - mean * mean).max(0.0) as f32)
    }
}

/// A rectangle of cells: first inclusive, last exclusive.
#[derive(Clone, Copy)]
struct Window {
    left: usize,
    top: usize,
    right: usize,
    bottom: usize,
}

impl Window {
    fn around(x: usize, y: usize, columns: usize, rows: usize) -> Self {
        Self {
            left: x.saturating_sub(REACH),
            top: y.saturating_sub(REACH),
            right: (x + REACH + 1).min(columns),
            bottom: (y + REACH + 1).min(rows),
        }
    }
}

/// Sums over rectangles in constant time.
struct IntegralImage {
    columns: usize,
    sums: Vec<f64>,
}

impl IntegralImage {
    fn of(columns: usize, rows: usize, values: impl Iterator<Item = f64>) -> Self {
        let wide = columns + 1;
        let mut sums = vec![0.0; wide * (rows + 1)];
        for (index, value) in values.enumerate() {
            let at = (index / columns + 1) * wide + index % columns + 1;
            sums[at] = value + sums[at - 1] + sums[at - wide] - sums[at - wide - 1];
        }
        Self { columns, sums }
    }

    fn mean(&self, Window { left, top, right, bottom }: Window) -> f64 {
        let at = |x: usize, y: usize| self.sums[y * (self.columns + 1) + x];
        let sum = at(right, bottom) - at(left, bottom) - at(right, top) + at(left, top);
        sum / ((right - left) * (bottom - top)) as f64
    }
}
