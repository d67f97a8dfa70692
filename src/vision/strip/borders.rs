//! Possible borders of a strip, to a pixel: where the mean colour across it changes.
//!
//! Evidence alone does not show a shaft's width well: it takes shade beside the shaft for shaft, or gloss on it for
//! background. Its borders are sharp along their whole length, so they show in the mean over many rows, and so do
//! the borders of gloss and of hard shadows. The fit to the pixels decides among them.

use nalgebra::{Point2, Vector2};

use super::Strip;
use crate::vision::camera::Camera;
use crate::vision::frame::Frame;
use crate::vision::space::Normalised;

/// Rows across the strip.
const ROWS: usize = 60;
/// Part of the strip that is read, from its end: the tool's measured piece is about twelve widths long.
const LONGEST_WIDTHS: f64 = 12.0;
/// The first and the last part of that piece are left out: the end of the shaft, and the picture's rim.
const READ_PART: (f64, f64) = (0.08, 0.95);
/// Borders are looked for from this many half widths to that many from the strip's middle.
const REACH: (f64, f64) = (0.35, 1.8);
/// Borders kept on each side.
const KEPT: usize = 4;
/// A border whose contrast is below this share of the strongest on its side is left out.
const MIN_SHARE: f64 = 0.2;
/// Least contrast of a border's mean colour, codes.
const MIN_CODES: f64 = 3.0;

/// A possible border.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PossibleBorder {
    /// Distance from the strip's middle, in half widths.
    pub at: f64,
    /// Contrast of the mean colour, codes.
    pub codes: f64,
}

/// The possible borders on both sides of the strip's middle, the strongest first. The first side is that of the strip's
/// first border.
pub fn possible_borders(frame: &Frame<'_>, camera: &Camera, strip: &Strip) -> [Vec<PossibleBorder>; 2] {
    let profile = MeanProfile::read(frame, camera, strip);
    [-1.0, 1.0].map(|side| {
        let mut found = profile.peaks(side);
        found.sort_by(|one, other| other.codes.total_cmp(&one.codes));
        let most = found.first().map_or(0.0, |strongest| strongest.codes);
        found.retain(|border| border.codes >= (MIN_SHARE * most).max(MIN_CODES));
        found.truncate(KEPT);
        found
    })
}

/// The strip with its borders moved to these distances from its middle, in half widths.
pub fn with_borders(strip: &Strip, [first, second]: [f64; 2]) -> Strip {
    let [one, other] = strip.borders;
    let moved = |i: usize, share: f64, own: Point2<f64>| {
        let middle = nalgebra::center(&one[i], &other[i]);
        middle + (own - middle) * share
    };
    let borders = [[0, 1].map(|i| moved(i, first, one[i])), [0, 1].map(|i| moved(i, second, other[i]))];
    let middle = |i: usize| Normalised(nalgebra::center(&borders[0][i], &borders[1][i]));
    Strip { borders, entry: middle(0), end: middle(1), width: strip.width * 0.5 * (first + second), ..strip.clone() }
}

/// The mean codes across a strip.
struct MeanProfile {
    /// Distance between places, half widths.
    step: f64,
    /// Mean codes from −`REACH.1` to `REACH.1`.
    codes: Vec<[f64; 3]>,
}

impl MeanProfile {
    fn read(frame: &Frame<'_>, camera: &Camera, strip: &Strip) -> Self {
        let [one, other] = strip.borders;
        let half_px = 0.5 * strip.width * camera.fx;
        let step = 1.0 / half_px.max(2.0);
        let places = (2.0 * REACH.1 / step) as usize + 1;
        let mut sums = vec![([0.0; 3], 0.0); places];
        let part = (LONGEST_WIDTHS / strip.length_widths.max(1.0)).min(1.0);
        let at = |line: [Point2<f64>; 2], share: f64| line[1] + (line[0] - line[1]) * share;
        for row in 0..ROWS {
            let share = READ_PART.0 + (READ_PART.1 - READ_PART.0) * row as f64 / (ROWS - 1) as f64;
            let (left, right) = (at(one, part * share), at(other, part * share));
            let middle = nalgebra::center(&left, &right);
            let half: Vector2<f64> = right - middle;
            for (place, (sum, count)) in sums.iter_mut().enumerate() {
                let distance = place as f64 * step - REACH.1;
                let pixel = camera.pixel_of(Normalised(middle + half * distance));
                let (x, y) = (pixel.u().round(), pixel.v().round());
                if x >= 0.0 && y >= 0.0 && x < frame.width() as f64 && y < frame.height() as f64 {
                    let codes = frame.yuv_at(x as usize, y as usize);
                    *sum = std::array::from_fn(|part| sum[part] + f64::from(codes[part]));
                    *count += 1.0;
                }
            }
        }
        let codes = sums.into_iter().map(|(sum, count): ([f64; 3], f64)| sum.map(|sum| sum / count.max(1.0))).collect();
        Self { step, codes }
    }

    /// The places on one side (−1 or 1) where the colour changes most locally.
    fn peaks(&self, side: f64) -> Vec<PossibleBorder> {
        /// Pixels on each side of a border that are compared.
        const COMPARED: usize = 2;
        let mean = |from: usize| -> [f64; 3] {
            std::array::from_fn(|part| {
                self.codes[from..from + COMPARED].iter().map(|codes| codes[part]).sum::<f64>() / COMPARED as f64
            })
        };
        let last = self.codes.len().saturating_sub(2 * COMPARED);
        let change: Vec<f64> = (0..last)
            .map(|i| {
                let (before, behind) = (mean(i), mean(i + COMPARED));
                (0..3).map(|part| (behind[part] - before[part]).powi(2)).sum::<f64>().sqrt()
            })
            .collect();
        let place = |i: usize| (i + COMPARED) as f64 * self.step - 0.5 * self.step - REACH.1;
        let is_peak = |i: &usize| {
            let near = i.saturating_sub(COMPARED)..(i + COMPARED + 1).min(change.len());
            (REACH.0..REACH.1).contains(&(side * place(*i))) && change[near].iter().all(|other| *other <= change[*i])
        };
        let found = (0..change.len()).filter(is_peak);
        found.map(|i| PossibleBorder { at: side * place(i), codes: change[i] }).collect()
    }
}
