//! Measures whether the scene's light changes. About once a second it compares a coarse grid of pixels with the first
//! frame that is bright enough. Exposure and white balance change the whole picture, tools only parts of it, so the
//! median over the grid is used.

use super::report::LightSample;
use crate::vision::frame::Frame;

/// Time between two samples, s: automatic exposure takes about as long to settle.
const INTERVAL_S: f64 = 1.0;

/// Columns and rows of the grid: 0.01 ms per sample.
const GRID: (usize, usize) = (32, 18);

/// Luma range of usable pixels, as shares of white: neither noise nor overexposed.
const USABLE_LUMA: std::ops::RangeInclusive<f64> = 0.08..=0.92;

/// Minimum number of pixels for a median.
const MIN_PIXELS: usize = 64;

/// Samples a recording's light.
#[derive(Default)]
pub struct LightWatch {
    first: Vec<[f64; 3]>,
    last_s: Option<f64>,
    changes: [Vec<f64>; 3],
    samples: Vec<LightSample>,
}

impl LightWatch {
    /// Samples a frame if the interval has passed.
    pub fn sample_frame(&mut self, frame: &Frame<'_>) {
        if self.last_s.is_some_and(|last_s| frame.time_s < last_s + INTERVAL_S) {
            return;
        }
        if self.first.iter().filter(|first| USABLE_LUMA.contains(&first[0])).count() < MIN_PIXELS {
            self.first = pixels(frame).collect(); // no reference frame yet, or a dark one
        }
        self.last_s = Some(frame.time_s);
        self.changes.iter_mut().for_each(Vec::clear);
        for (now, first) in pixels(frame).zip(&self.first).filter(|(_, first)| USABLE_LUMA.contains(&first[0])) {
            let change = [now[0] / first[0], now[1] - first[1], now[2] - first[2]];
            self.changes.iter_mut().zip(change).for_each(|(all, one)| all.push(one));
        }
        if self.changes[0].len() >= MIN_PIXELS {
            let [luma_ratio, blue, red] = self.changes.each_mut().map(|values| median(values));
            self.samples.push(LightSample { time_s: frame.time_s, luma_ratio, chroma_shift: [blue, red] });
        }
    }

    /// The latest sample.
    pub fn last(&self) -> Option<LightSample> {
        self.samples.last().copied()
    }

    /// Drops all samples but the latest; keeps the reference frame.
    pub fn forget_past(&mut self) {
        self.samples.drain(..self.samples.len().saturating_sub(1));
    }

    /// The samples, in time order.
    pub fn into_samples(self) -> Vec<LightSample> {
        self.samples
    }
}

/// The grid's pixels, gamma-coded `[Y', Pb, Pr]`.
fn pixels<'a>(frame: &'a Frame<'_>) -> impl Iterator<Item = [f64; 3]> + 'a {
    let place = |index: usize, of: usize, size: usize| (2 * index + 1) * size / (2 * of);
    let places = (0..GRID.1).flat_map(|row| (0..GRID.0).map(move |column| (column, row)));
    places.map(move |(column, row)| {
        let (x, y) = (place(column, GRID.0, frame.width()), place(row, GRID.1, frame.height()));
        frame.encoding.colour_of(frame.yuv_at(x, y))
    })
}

fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::frame::{ColourEncoding, Matrix, Plane, Range};

    const WIDTH: usize = 64;
    const HEIGHT: usize = 36;

    /// A picture of one colour; the left part of it is hidden by something black.
    fn look_at(watch: &mut LightWatch, time_s: f64, yuv: [u8; 3], hidden_columns: usize) {
        let mut luma = vec![yuv[0]; WIDTH * HEIGHT];
        luma.chunks_mut(WIDTH).for_each(|row| row[..hidden_columns].fill(16));
        let (blue, red) = (vec![yuv[1]; WIDTH * HEIGHT], vec![yuv[2]; WIDTH * HEIGHT]);
        let plane = |data| Plane { data, stride: WIDTH, width: WIDTH, height: HEIGHT };
        let encoding = ColourEncoding { range: Range::Limited, matrix: Matrix::Bt709 };
        let (y, u, v) = (plane(&luma), plane(&blue), plane(&red));
        watch.sample_frame(&Frame {
            index: 0,
            time_s,
            y,
            u,
            v,
            shift_x: 0,
            shift_y: 0,
            chroma_first_px: [0.0; 2],
            encoding,
        });
    }

    #[test]
    fn dimmer_light_and_another_white_balance_are_measured_once_a_second() {
        let mut watch = LightWatch::default();
        look_at(&mut watch, 0.0, [116, 128, 128], 0);
        look_at(&mut watch, 0.5, [20, 128, 128], 0);
        look_at(&mut watch, 1.0, [96, 128, 128], 0);
        look_at(&mut watch, 2.0, [116, 120, 139], 0);
        let samples = watch.into_samples();
        assert_eq!(samples.iter().map(|s| s.time_s).collect::<Vec<_>>(), [0.0, 1.0, 2.0]);
        assert!((samples[1].luma_ratio - 0.8).abs() < 1e-12 && samples[1].chroma_shift == [0.0, 0.0]);
        let [blue, red] = samples[2].chroma_shift.map(|shift| 224.0 * shift);
        assert!((blue + 8.0).abs() < 1e-9 && (red - 11.0).abs() < 1e-9 && samples[2].luma_ratio == 1.0);
    }

    #[test]
    fn a_moving_tool_does_not_change_the_light() {
        let mut watch = LightWatch::default();
        look_at(&mut watch, 0.0, [116, 128, 128], 0);
        look_at(&mut watch, 1.0, [116, 128, 128], WIDTH * 2 / 5);
        assert_eq!(watch.into_samples()[1].luma_ratio, 1.0);
    }

    #[test]
    fn a_dark_first_frame_is_nothing_to_compare_with() {
        let mut watch = LightWatch::default();
        look_at(&mut watch, 0.0, [17, 128, 128], 0);
        look_at(&mut watch, 1.0, [90, 128, 128], 0);
        look_at(&mut watch, 2.0, [164, 128, 128], 0);
        let ratios: Vec<f64> = watch.into_samples().iter().map(|sample| sample.luma_ratio).collect();
        assert_eq!(ratios, [1.0, 2.0], "black is 16: 74 codes of light became 148");
    }
}
