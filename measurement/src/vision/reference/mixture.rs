//! Motion and darkness: the mask of Framework 1 (T 4.2.1.1, 4.2.1.2).
//!
//! Each cell of 2×2 pixels has a mixture of [`MODES`] Gaussians of its colour, after Stauffer & Grimson (T 4.7–4.9). A
//! cell is moving if its colour belongs to none of the Gaussians that make up the background. It is dark if its
//! distance from black in R', G', B' is below a threshold. The mask contains the cells that are both, closed by one
//! cell.

use nalgebra::Vector3;

use super::SHAFT_CLASS;
use super::rgb::RgbConversion;
use crate::vision::frame::Frame;
use crate::vision::segmentation::Segment;
use crate::vision::segmentation::region_of_interest::{CELL_PX, CellBox};
use crate::vision::segmentation::samples::ColourSamples;

/// Gaussians for each cell, `k` in T 4.7.
const MODES: usize = 3;

/// Learning rate `α` (T 4.8).
const LEARNING_RATE: f32 = 0.01;

/// Minimum share `T` of the background in the mixture (T 4.9).
const BACKGROUND_SHARE: f32 = 0.7;

/// Standard deviation of a new Gaussian, codes.
const FIRST_SIGMA: f32 = 15.0;

/// Smallest standard deviation, codes. The papers state none; without one, a Gaussian of constant pixels shrinks to a
/// point, and rounding errors no longer match it.
const MIN_SIGMA: f32 = 2.0;

/// A colour belongs to a Gaussian within this many standard deviations.
const MATCH_SIGMAS: f32 = 2.5;

/// Largest distance from black of a dark colour, if no colour of the shaft is marked, codes.
const USUAL_DARKNESS: f64 = 90.0;

/// Label of the marked colours of a bare shaft.
const SHAFT_LABEL: &str = "shaft";

/// Distance from black below which a colour is dark, codes: mean and three standard deviations of the marked colours of
/// the shaft, or [`USUAL_DARKNESS`].
pub(super) fn darkness_threshold(samples: &ColourSamples) -> f64 {
    let conversion = RgbConversion::new(samples.encoding);
    let shaft = samples.samples.iter().filter(|sample| samples.labels[sample.label] == SHAFT_LABEL);
    let distances = shaft.map(|sample| conversion.rgb_of(sample.yuv.map(f64::from)).norm());
    let (count, sum, squares) = distances.fold((0.0, 0.0, 0.0), |(n, s, q), d| (n + 1.0, s + d, q + d * d));
    if count == 0.0 {
        return USUAL_DARKNESS;
    }
    let mean = sum / count;
    mean + 3.0 * (squares / count - mean * mean).max(0.0).sqrt()
}

/// One Gaussian of a cell's colour, with the covariance `σ²·I`.
#[derive(Clone, Copy, Debug)]
struct ColourMode {
    /// Share of the mixture; 0 if it is not used yet.
    weight: f32,
    mean: Vector3<f32>,
    variance: f32,
}

impl ColourMode {
    const UNUSED: Self = Self { weight: 0.0, mean: Vector3::new(0.0, 0.0, 0.0), variance: FIRST_SIGMA * FIRST_SIGMA };

    /// The ratio ω/σ, high for a Gaussian of the background.
    fn ratio(&self) -> f32 {
        self.weight / self.variance.sqrt()
    }

    fn matches(&self, colour: Vector3<f32>) -> bool {
        self.weight > 0.0 && (colour - self.mean).norm_squared() < MATCH_SIGMAS * MATCH_SIGMAS * self.variance
    }

    /// Learns a colour that matches, with the rate `ρ = α/ω`. The original `ρ = α·N(X)` hardly changes anything.
    fn learn(&mut self, colour: Vector3<f32>) {
        let rate = (LEARNING_RATE / self.weight).min(1.0);
        self.mean += (colour - self.mean) * rate;
        let squared = (colour - self.mean).norm_squared();
        self.variance = (self.variance + (squared - self.variance) * rate).max(MIN_SIGMA * MIN_SIGMA);
    }
}

/// The mixture of one cell, in descending order of ω/σ.
#[derive(Clone, Copy, Debug)]
struct CellMixture([ColourMode; MODES]);

impl CellMixture {
    /// Learns the next colour of the cell. Returns whether it is moving.
    fn observe(&mut self, colour: Vector3<f32>) -> bool {
        let matched = self.0.iter().position(|mode| mode.matches(colour));
        self.0.iter_mut().for_each(|mode| mode.weight *= 1.0 - LEARNING_RATE);
        let current = matched.unwrap_or(MODES - 1); // the last one has the least ω/σ
        if matched.is_some() {
            self.0[current].weight += LEARNING_RATE;
            self.0[current].learn(colour);
        } else {
            self.0[current] = ColourMode { weight: LEARNING_RATE, mean: colour, ..ColourMode::UNUSED };
        }
        let total: f32 = self.0.iter().map(|mode| mode.weight).sum();
        self.0.iter_mut().for_each(|mode| mode.weight /= total);
        let share_before = self.share_before(current);
        self.0.sort_by(|one, other| other.ratio().total_cmp(&one.ratio()));
        share_before > BACKGROUND_SHARE
    }

    /// Share of the Gaussians with a higher ω/σ. If they alone exceed the background's share, this one is none of the
    /// first `B` Gaussians, which T 4.9 takes for the background.
    fn share_before(&self, current: usize) -> f32 {
        let own = self.0[current].ratio();
        let is_before = |(i, mode): &(usize, &ColourMode)| mode.ratio() > own || mode.ratio() == own && *i < current;
        self.0.iter().enumerate().filter(is_before).map(|(_, mode)| mode.weight).sum()
    }
}

/// The mixtures of all cells, and the mask of the latest frame.
pub(super) struct MotionMixture {
    /// Distance from black below which a cell is dark, codes.
    darkness: f64,
    columns: usize,
    cells: Vec<CellMixture>,
    mask: Vec<bool>,
}

impl MotionMixture {
    /// Without any frame yet.
    pub(super) fn new(darkness: f64) -> Self {
        Self { darkness, columns: 0, cells: Vec::new(), mask: Vec::new() }
    }

    /// Learns a frame, and finds its mask. All frames must have the same size.
    pub(super) fn observe(&mut self, frame: &Frame<'_>) {
        let whole = CellBox::whole(frame);
        self.columns = whole.width();
        let count = whole.width() * whole.height();
        self.cells.resize(count, CellMixture([ColourMode::UNUSED; MODES]));
        let conversion = RgbConversion::new(frame.encoding);
        self.mask.clear();
        for (i, cell) in self.cells.iter_mut().enumerate() {
            let colour = conversion.rgb_of_cell(frame, i % whole.width(), i / whole.width());
            let is_moving = cell.observe(colour.cast());
            self.mask.push(is_moving && colour.norm() < self.darkness);
        }
        let dilated = spread(&self.mask, self.columns, true);
        self.mask = spread(&dilated, self.columns, false);
    }
}

impl Segment for MotionMixture {
    fn class_at(&self, _frame: &Frame<'_>, x: usize, y: usize) -> u8 {
        let is_set = self.mask.get(y / CELL_PX * self.columns + x / CELL_PX).copied().unwrap_or(false);
        if is_set { SHAFT_CLASS } else { 0 }
    }
}

/// Sets each cell to `value` that has a neighbour with `value`: dilation for true, erosion for false. What lies outside
/// the picture changes nothing.
fn spread(mask: &[bool], columns: usize, value: bool) -> Vec<bool> {
    let rows = mask.len().checked_div(columns).unwrap_or(0);
    let around = |i: usize, end: usize| i.saturating_sub(1)..(i + 2).min(end);
    let has_neighbour = |column: usize, row: usize| {
        around(row, rows).any(|y| around(column, columns).any(|x| mask[y * columns + x] == value))
    };
    let changed = |i: usize| if has_neighbour(i % columns, i / columns) { value } else { !value };
    (0..mask.len()).map(changed).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::vision::frame::{ColourEncoding, Matrix, Range};
    use crate::vision::segmentation::samples::ColourSample;

    const GREY: Vector3<f32> = Vector3::new(180.0, 180.0, 180.0);
    const BLACK: Vector3<f32> = Vector3::new(20.0, 20.0, 20.0);

    fn fresh() -> CellMixture {
        CellMixture([ColourMode::UNUSED; MODES])
    }

    proptest! {
        #[test]
        fn weights_add_up_to_one_and_modes_stay_in_order(
            colours in prop::collection::vec(prop::array::uniform3(0.0..255.0f32), 1..60),
        ) {
            let mut cell = fresh();
            for colour in colours {
                cell.observe(Vector3::from(colour));
                let total: f32 = cell.0.iter().map(|mode| mode.weight).sum();
                prop_assert!((total - 1.0).abs() < 1e-4, "{total}");
                prop_assert!(cell.0.windows(2).all(|pair| pair[0].ratio() >= pair[1].ratio()));
            }
        }
    }

    /// After n frames the background's weight is 0.99ⁿ: more than T = 0.7 up to 35.
    #[test]
    fn a_resting_object_becomes_background_after_35_frames() {
        let mut cell = fresh();
        assert!((0..600).all(|_| !cell.observe(GREY)), "the first colour is the background");
        assert!((0..35).all(|_| cell.observe(BLACK)), "new");
        assert!(!cell.observe(BLACK), "absorbed");
        assert!(!cell.observe(GREY), "the old background is not forgotten");
    }

    #[test]
    fn a_matching_colour_moves_the_mean_by_its_share() {
        let mut cell = fresh();
        (0..10).for_each(|_| _ = cell.observe(GREY));
        let near = GREY + Vector3::new(6.0, 0.0, 0.0);
        assert!(!cell.observe(near));
        assert!((cell.0[0].mean.x - 180.06).abs() < 1e-3, "ρ = α/ω = 0.01: {}", cell.0[0].mean);
    }

    #[test]
    fn a_closed_mask_has_no_gap_of_one_cell_and_keeps_its_border() {
        let mask = |rows: [&str; 5]| -> Vec<bool> { rows.concat().bytes().map(|cell| cell == b'#').collect() };
        let open = mask(["##.##..", "##.##..", "##.##..", ".......", "......."]);
        let closed = mask(["#####..", "#####..", "#####..", ".......", "......."]);
        assert_eq!(spread(&spread(&open, 7, true), 7, false), closed);
    }

    #[test]
    fn darkness_follows_the_marked_shaft() {
        let encoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 };
        let grey = |label, y| ColourSample { label, rectangle: 0, yuv: [y, 128, 128] };
        let mut samples = ColourSamples::new(encoding);
        samples.labels = vec!["background".into(), SHAFT_LABEL.into()];
        samples.samples = vec![grey(0, 200)];
        assert_eq!(darkness_threshold(&samples), USUAL_DARKNESS);
        samples.samples.extend([grey(1, 20), grey(1, 40)]);
        let expected = (30.0 + 3.0 * 10.0) * 3f64.sqrt();
        assert!((darkness_threshold(&samples) - expected).abs() < 1e-6);
    }
}
