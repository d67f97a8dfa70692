//! The box without tools, cell by cell: what is behind a bare shaft.
//!
//! **In** the picture of the empty box, or cells of frames spread over the recording. **Out** the usual codes of each
//! cell, and how far a frame's cell agrees with them. **Method** From frames, each cell's median luma, weighted with the
//! probability that the cell does *not* show the shaft, and the mean codes near it. Nothing is learned under a shaft,
//! so a tool at rest does not become background as it does in the thesis (METHOD 3.6, T 5.1). Its jaws do not look like the
//! shaft: once its ends are known, the cells ahead of them are [learned again](Background::learn_beside).

use std::collections::BTreeSet;

use super::cells::{CellGrid, CellPicture};
use super::shaft_colour::{AnyColour, ShaftColour};

/// Codes of luma about the median that count as the same surface: twice the usual noise and flicker.
const SAME_SURFACE_CODES: f32 = 8.0;
/// Noise that quantisation adds to a cell: standard deviation, codes.
const QUANTISATION_CODES: f32 = 2.0;
/// Weight of a sample that is certainly shaft: a cell that is always covered keeps its plain median.
const LEAST_WEIGHT: f32 = 1e-3;
/// Share of the difference from the background in the evidence of a cell that looks like the shaft: it may be a tool
/// that never moves. A still does not show its background there at all.
const LIKE_SHAFT_SHARE: f32 = 0.5;
/// Least luma for ratios of luma, codes.
const LEAST_LUMA: f32 = 8.0;

/// Shares of what a cell outside the shaft shows: the background, the background in shade, anything else.
const SAME_SHARE: f32 = 0.80;
const SHADE_SHARE: f32 = 0.17;
const OTHER_SHARE: f32 = 0.03;
/// Luma in shade, as a share of the usual luma: darkest, brightest.
const SHADE: (f32, f32) = (0.25, 1.03);
/// Standard deviation of chroma in shade about the usual one shrunk alike, codes.
const SHADE_CHROMA_CODES: f32 = 6.0;

/// The box without tools.
#[derive(Clone)]
pub struct Background {
    grid: CellGrid,
    /// Usual codes of each cell.
    usual: Vec<[f32; 3]>,
    /// Does the cell look like the shaft without any tool?
    like_shaft: Vec<bool>,
    /// Share of the difference from the background in the evidence of such a cell.
    like_shaft_share: f32,
    /// Noise of each channel: standard deviation, codes.
    noise: [f32; 3],
    /// Log density of the usual codes themselves in the box as usual.
    same_normaliser: f32,
    /// Is the box itself known in the cell? Not where jaws or shafts covered it on all frames, or on all but one.
    is_known: Vec<bool>,
}

/// Largest log density below that of the box's own codes where the box may still show, nats: 3.6 standard deviations of
/// noise, or 25 codes of chroma in shade.
const MAX_BELOW: f32 = 5.0;

impl Background {
    /// From frames spread over the recording, at least one, all of one size.
    pub fn from_frames(frames: &[CellPicture], shaft: &ShaftColour, any: &AnyColour) -> Option<Self> {
        let grid = frames.first()?.grid;
        let mut samples: Vec<WeightedSample> = Vec::with_capacity(frames.len());
        let usual = (0..grid.count()).map(|cell| {
            samples.clear();
            samples.extend(frames.iter().map(|frame| sample(frame.codes[cell], shaft, any)));
            usual_codes(&mut samples).0
        });
        let mut background = Self::new(grid, usual.collect(), frames, shaft, any);
        if frames.len() == 1 {
            background.like_shaft_share = 0.0;
        }
        Some(background)
    }

    /// Learns the cells again that the jaws of the tools often covered: each frame comes with its covered cells. What the
    /// other frames show there is the box. If they show only the shaft, or there are too few, the cell is unknown.
    pub fn learn_beside(&mut self, frames: &[(&CellPicture, BTreeSet<usize>)], shaft: &ShaftColour, any: &AnyColour) {
        /// A cell is learned again if it was covered on this share of the frames: together with the shaft, that may be
        /// most of them.
        const MIN_COVERED: f64 = 0.25;
        /// Least number of frames that must show the box: one alone may show a thing that passes.
        const MIN_SHOWN: f32 = 2.0;
        let mut counts = vec![0usize; self.usual.len()];
        frames.iter().flat_map(|(_, covered)| covered).for_each(|cell| counts[*cell] += 1);
        let often = |count: usize| count > 0 && count as f64 >= MIN_COVERED * frames.len() as f64;
        for cell in (0..counts.len()).filter(|cell| often(counts[*cell])) {
            let free = frames.iter().filter(|(_, covered)| !covered.contains(&cell));
            let mut samples: Vec<WeightedSample> =
                free.map(|(frame, _)| sample(frame.codes[cell], shaft, any)).collect();
            let (codes, weight) = usual_codes(&mut samples);
            self.is_known[cell] = weight >= MIN_SHOWN;
            if self.is_known[cell] {
                self.usual[cell] = codes;
                self.like_shaft[cell] = shaft.log_density(codes) > any.log_density(codes);
            }
        }
    }

    /// From the picture of the empty box. Its exposure may differ from the recording's: its luma is scaled by the
    /// median ratio.
    pub fn from_empty(
        empty: &CellPicture,
        frames: &[CellPicture],
        shaft: &ShaftColour,
        any: &AnyColour,
    ) -> Option<Self> {
        if frames.iter().any(|frame| frame.grid != empty.grid) {
            return None;
        }
        let mean =
            |cell: usize| frames.iter().map(|frame| f32::from(frame.codes[cell][0])).sum::<f32>() / frames.len() as f32;
        let ratios = (0..empty.grid.count()).map(|cell| mean(cell) / f32::from(empty.codes[cell][0]).max(LEAST_LUMA));
        let gain = median(ratios.filter(|ratio| ratio.is_finite()).collect()).unwrap_or(1.0);
        let usual = empty.codes.iter().map(|codes| {
            let [y, u, v] = codes.map(f32::from);
            [y * gain, u, v]
        });
        Some(Self::new(empty.grid, usual.collect(), frames, shaft, any))
    }

    fn new(grid: CellGrid, usual: Vec<[f32; 3]>, frames: &[CellPicture], shaft: &ShaftColour, any: &AnyColour) -> Self {
        /// Every fourth frame and seventh cell is enough for a median.
        const EVERY: (usize, usize) = (4, 7);
        let like_shaft = usual.iter().map(|codes| shaft.log_density(*codes) > any.log_density(*codes)).collect();
        let noise = std::array::from_fn(|part| {
            let off = frames.iter().step_by(EVERY.0).flat_map(|frame| {
                let pairs = frame.codes.iter().zip(&usual).step_by(EVERY.1);
                pairs.map(|(codes, usual)| (f32::from(codes[part]) - usual[part]).abs())
            });
            1.4826 * median(off.collect()).unwrap_or(0.0) + QUANTISATION_CODES
        });
        let [y, u, v]: [f32; 3] = noise;
        let same_normaliser = -1.5 * std::f32::consts::TAU.ln() - (y * u * v).ln();
        let is_known = vec![true; grid.count()];
        Self { grid, usual, like_shaft, like_shaft_share: LIKE_SHAFT_SHARE, noise, same_normaliser, is_known }
    }

    /// The cells.
    pub fn grid(&self) -> CellGrid {
        self.grid
    }

    /// Usual codes near a pixel: of the brightest of the nine cells about it, because a cell at the border of a tool
    /// that never moves holds some of the tool.
    pub fn usual_at(&self, x: usize, y: usize) -> [f32; 3] {
        let codes = self.cells_near(x, y).map(|cell| self.usual[cell]);
        codes.max_by(|one, other| one[0].total_cmp(&other[0])).unwrap_or_default()
    }

    /// Side of a cell, pixels.
    pub fn cell_px(&self) -> usize {
        self.grid.cell_px
    }

    /// The nine cells about a pixel.
    fn cells_near(&self, x: usize, y: usize) -> impl Iterator<Item = usize> + use<> {
        let CellGrid { cell_px, columns, rows } = self.grid;
        let near = move |at: usize, count: usize| {
            let cell = (at / cell_px).min(count - 1);
            cell.saturating_sub(1)..(cell + 2).min(count)
        };
        near(y, rows).flat_map(move |row| near(x, columns).map(move |column| row * columns + column))
    }

    /// Is the box itself known at a pixel?
    pub fn is_known_at(&self, [x, y]: [usize; 2]) -> bool {
        let CellGrid { cell_px, columns, rows } = self.grid;
        self.is_known[(y / cell_px).min(rows - 1) * columns + (x / cell_px).min(columns - 1)]
    }

    /// May the box, lit or in shade, show these mean codes of a patch about a pixel, as large as a cell? The patch may
    /// lie in nine cells.
    pub fn may_show(&self, [x, y]: [usize; 2], codes: [f32; 3]) -> bool {
        let is_shade = |usual| shade_log_density(usual, usual) - shade_log_density(codes, usual) < MAX_BELOW;
        self.may_show_lit([x, y], codes)
            || self
                .cells_near(x, y)
                .map(|cell| self.usual[cell])
                .any(|usual| may_be_shade(codes, usual) && is_shade(usual))
    }

    /// The same of the box as it is usually lit.
    pub fn may_show_lit(&self, [x, y]: [usize; 2], codes: [f32; 3]) -> bool {
        let is_same = |usual| self.same_log_density(usual, usual) - self.same_log_density(codes, usual) < MAX_BELOW;
        self.cells_near(x, y).any(|cell| is_same(self.usual[cell]))
    }

    /// Does the box as it is usually lit look otherwise at one pixel than about another?
    pub fn changes_between(&self, [x, y]: [usize; 2], about: [usize; 2]) -> bool {
        let CellGrid { cell_px, columns, rows } = self.grid;
        let cell = (y / cell_px).min(rows - 1) * columns + (x / cell_px).min(columns - 1);
        !self.may_show_lit(about, self.usual[cell])
    }

    /// Does the cell look like the shaft without any tool?
    pub fn is_like_shaft(&self, cell: usize) -> bool {
        self.like_shaft[cell]
    }

    /// Share of the difference from the background in the evidence of a cell. The colour alone is the rest.
    pub fn share_of_difference(&self, cell: usize) -> f32 {
        if self.like_shaft[cell] { self.like_shaft_share } else { 1.0 }
    }

    /// Log density of these codes in a cell that no shaft covers; `any` is their log density anywhere.
    pub fn log_density(&self, cell: usize, codes: [f32; 3], any: f32) -> f32 {
        log_of_sum(self.log_density_of_box(cell, codes), any + OTHER_SHARE.ln())
    }

    /// A lower bound of [`Self::log_density`]: the part of the box as usual.
    pub fn least_log_density(&self, cell: usize, codes: [f32; 3]) -> f32 {
        self.same_log_density(codes, self.usual[cell]) + SAME_SHARE.ln()
    }

    /// Log density of these codes in a cell that shows the box itself, lit or in shade.
    pub fn log_density_of_box(&self, cell: usize, codes: [f32; 3]) -> f32 {
        let usual = self.usual[cell];
        let shade = shade_log_density(codes, usual) + SHADE_SHARE.ln();
        log_of_sum(self.least_log_density(cell, codes), shade)
    }

    /// Of the background as usual: a Student distribution with four degrees of freedom.
    fn same_log_density(&self, codes: [f32; 3], usual: [f32; 3]) -> f32 {
        let squares: f32 = (0..3).map(|part| ((codes[part] - usual[part]) / self.noise[part]).powi(2)).sum();
        self.same_normaliser - 3.5 * (0.25 * squares).ln_1p()
    }
}

/// Logarithm of the sum of two numbers with these logarithms.
fn log_of_sum(one: f32, other: f32) -> f32 {
    let most = one.max(other);
    most + (1.0 + (one.min(other) - most).exp()).ln()
}

/// Is the luma a share of the usual one that shade leaves?
fn may_be_shade(codes: [f32; 3], usual: [f32; 3]) -> bool {
    let share = codes[0] / usual[0].max(LEAST_LUMA);
    share > SHADE.0 && share < SHADE.1
}

/// Log density of the background in shade: darker by any factor, with its chroma shrunk alike.
fn shade_log_density(codes: [f32; 3], usual: [f32; 3]) -> f32 {
    const IMPOSSIBLE: f32 = -12.0;
    const GREY: f32 = 128.0;
    let share = codes[0] / usual[0].max(LEAST_LUMA);
    let variance = SHADE_CHROMA_CODES * SHADE_CHROMA_CODES;
    let off: f32 = (1..3).map(|part| (codes[part] - GREY - share.min(1.5) * (usual[part] - GREY)).powi(2)).sum();
    let luma = if may_be_shade(codes, usual) { -(0.75 * usual[0]).max(20.0).ln() } else { IMPOSSIBLE };
    luma - (std::f32::consts::TAU * variance).ln() - 3.0 * (0.25 * off / variance).ln_1p()
}

/// Luma, weight and codes of a cell on one frame.
type WeightedSample = (f32, f32, [f32; 3]);

/// A sample of the box: its weight is the probability that the cell does not show the shaft.
fn sample(codes: [u8; 3], shaft: &ShaftColour, any: &AnyColour) -> WeightedSample {
    let codes = codes.map(f32::from);
    let ratio = (shaft.log_density(codes) - any.log_density(codes)).clamp(-20.0, 20.0);
    (codes[0], 1.0 / (1.0 + ratio.exp()) + LEAST_WEIGHT, codes)
}

/// The mean of the codes near the weighted median luma, and the sum of the weights.
fn usual_codes(samples: &mut [WeightedSample]) -> ([f32; 3], f32) {
    samples.sort_by(|one, other| one.0.total_cmp(&other.0));
    let weight = samples.iter().map(|(_, weight, _)| weight).sum::<f32>();
    let half = 0.5 * weight;
    let mut sum = 0.0;
    let middle = samples.iter().find(|(_, weight, _)| {
        sum += weight;
        sum >= half
    });
    let median = middle.map_or(0.0, |(luma, ..)| *luma);
    let near = samples.iter().filter(|(luma, ..)| (luma - median).abs() <= SAME_SURFACE_CODES);
    let (count, total) = near.fold((0.0f32, [0.0; 3]), |(count, total), (.., codes)| {
        (count + 1.0, std::array::from_fn(|part| total[part] + codes[part]))
    });
    (total.map(|total| total / count.max(1.0)), weight)
}

fn median(mut values: Vec<f32>) -> Option<f32> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: CellGrid = CellGrid { cell_px: 4, columns: 6, rows: 4 };
    const MAT: [u8; 3] = [150, 110, 140];
    const SHAFT: [u8; 3] = [30, 127, 129];

    fn shaft() -> ShaftColour {
        ShaftColour::new(&[SHAFT; 50]).unwrap()
    }

    /// Frames of a mat; the shaft covers cell 0 on the first `covered` of ten.
    fn frames(covered: usize) -> Vec<CellPicture> {
        let frame = |i: usize| {
            let mut codes = vec![MAT; GRID.count()];
            if i < covered {
                codes[0] = SHAFT;
            }
            CellPicture { grid: GRID, codes }
        };
        (0..10).map(frame).collect()
    }

    fn background(covered: usize) -> Background {
        let frames = frames(covered);
        Background::from_frames(&frames, &shaft(), &AnyColour::new(&frames)).unwrap()
    }

    #[test]
    fn a_still_does_not_show_what_its_shafts_cover() {
        let share = |frames: &[CellPicture]| {
            Background::from_frames(frames, &shaft(), &AnyColour::new(frames)).unwrap().share_of_difference(0)
        };
        let covered = frames(10);
        assert_eq!([share(&covered[..1]), share(&covered), share(&frames(9))], [0.0, LIKE_SHAFT_SHARE, 1.0]);
    }

    #[test]
    fn a_shaft_that_rests_for_most_of_the_recording_is_not_learned() {
        assert_eq!(background(9).usual[0], MAT.map(f32::from));
        assert!(!background(9).is_like_shaft(0));
    }

    #[test]
    fn jaws_that_rest_are_not_the_box() {
        const STEEL: [u8; 3] = [110, 126, 131];
        let learned = |covered: usize| {
            let mut pictures = frames(0);
            pictures[..covered].iter_mut().for_each(|picture| picture.codes[0] = STEEL);
            let (shaft, any) = (shaft(), AnyColour::new(&pictures));
            let mut background = Background::from_frames(&pictures, &shaft, &any).unwrap();
            let cells = |i: usize| (0..1).filter(|_| i < covered).collect();
            let frames: Vec<(&CellPicture, BTreeSet<usize>)> =
                pictures.iter().enumerate().map(|(i, picture)| (picture, cells(i))).collect();
            background.learn_beside(&frames, &shaft, &any);
            background
        };
        assert_eq!(learned(8).usual[0], MAT.map(f32::from), "two frames show the box");
        assert!(learned(8).is_known_at([0, 0]) && !learned(9).is_known_at([0, 0]), "one frame may show anything");
        assert!(learned(10).is_known_at([GRID.cell_px, 0]), "no jaws there");
    }

    #[test]
    fn a_shaded_mat_is_likelier_background_than_a_shaft_is() {
        let (background, any) = (background(3), -12.0);
        let shaded = background.log_density(0, [75.0, 119.0, 134.0], any);
        let covered = background.log_density(0, SHAFT.map(f32::from), any);
        assert!(shaded > covered + 3.0, "{shaded} {covered}");
    }

    #[test]
    fn a_mat_is_known_in_shade_and_nothing_else_is_taken_for_it() {
        let background = background(3);
        let shows = |codes| background.may_show([0, 0], codes);
        let [y, u, v] = MAT.map(f32::from);
        let in_shade = [0.6 * y, 128.0 + 0.6 * (u - 128.0), 128.0 + 0.6 * (v - 128.0)];
        assert!(shows([y, u, v]) && shows(in_shade));
        assert!(!shows([y + 40.0, u, v]) && !shows([y, u - 60.0, v + 40.0]), "brighter, or of another colour");
        let black = Background { usual: vec![[1.0, 128.0, 128.0]; GRID.count()], ..background };
        assert!(!black.may_show([0, 0], [220.0, 128.0, 128.0]), "a white thing before a black box");
    }

    #[test]
    fn an_empty_picture_of_half_the_light_gives_the_same_background() {
        let frames = frames(0);
        let [y, u, v] = MAT;
        let empty = CellPicture { grid: GRID, codes: vec![[y / 2, u, v]; GRID.count()] };
        let (shaft, any) = (shaft(), AnyColour::new(&frames));
        let background = Background::from_empty(&empty, &frames, &shaft, &any).unwrap();
        assert!((background.usual[5][0] - f32::from(y)).abs() < 2.0);
    }
}
