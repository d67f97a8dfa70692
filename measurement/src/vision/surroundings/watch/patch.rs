//! Patches of a small picture, and where a later picture shows them.
//!
//! **In:** two small pictures ([`LumaCells`]). **Out:** the displacement of a patch ([`Patch::follow`]), and how much
//! the later picture looks like it at a place ([`Patch::likeness`]). **Method:** Gauss–Newton on the patch's own slopes
//! (Lucas & Kanade 1981, inverse compositional). Luma counts relative to the patch's mean and with a gain, so exposure
//! and soft shadows cancel. **Gives up** (`None`) on a patch without structure in both directions: a straight edge does
//! not show a displacement along itself.

use std::array;

use crate::vision::frame::Frame;
use crate::vision::surroundings::sampler::{shrink, small_size};

/// Side of a patch, cells: 80 px of a 1280-pixel picture, about 15 mm of a mat. A peg and its rim fit into it, and a
/// tool covers few of them.
pub(super) const SIDE: usize = 8;

const CELLS: usize = SIDE * SIDE;

/// Root mean square of the luma's slope across the direction where it is smallest, codes per cell. A smoothed cell has
/// noise of 0.2 codes, a compressed one of up to 1; over 64 cells, the displacement is then known to 0.1 cells.
const MIN_SLOPE: f32 = 1.0;

/// Least correlation of a patch with its image. Two codes of error beside three codes of structure give 0.83.
pub(super) const MIN_LIKENESS: f32 = 0.8;

/// A patch whose contrast fell below this share is covered.
const MIN_GAIN: f32 = 0.3;

/// Steps of Gauss–Newton, the longest one in each direction, and one that is short enough to end with, cells.
const STEPS: usize = 5;
const MAX_STEP: f32 = 1.5;
const LAST_STEP: f32 = 0.02;

/// Luma of a frame's cells, each averaged with its neighbours 1 : 2 : 1 in both directions, so that it can be read
/// between cells.
#[derive(Clone, Debug)]
pub(super) struct LumaCells {
    pub(super) columns: usize,
    pub(super) rows: usize,
    pub(super) values: Vec<f32>,
}

impl LumaCells {
    /// `None` if the frame is too small or too narrow.
    pub(super) fn of(frame: &Frame<'_>) -> Option<Self> {
        let (columns, rows) = small_size(frame.width(), frame.height())?;
        let codes: Vec<f32> = shrink(&frame.y, columns, rows).into_iter().map(f32::from).collect();
        let across = blur(&codes, 1, |index| index.is_multiple_of(columns) || (index + 1).is_multiple_of(columns));
        let values = blur(&across, columns, |index| index < columns || index + columns >= codes.len());
        Some(Self { columns, rows, values })
    }

    /// The cells of a patch whose first cell is at column `x`, row `y`, between cells if need be. `None` if they are
    /// not all inside the picture.
    fn window(&self, [x, y]: [f32; 2]) -> Option<[f32; CELLS]> {
        let (left, top) = (x.floor(), y.floor());
        let is_inside = |first: f32, size: usize| first >= 0.0 && first + SIDE as f32 <= size as f32 - 1.0;
        if !(is_inside(left, self.columns) && is_inside(top, self.rows)) {
            return None;
        }
        let (right, down) = (x - left, y - top);
        let weights = [(1.0 - right) * (1.0 - down), right * (1.0 - down), (1.0 - right) * down, right * down];
        let first = top as usize * self.columns + left as usize;
        let mut cells = [0.0; CELLS];
        for (row, line) in cells.chunks_exact_mut(SIDE).enumerate() {
            let upper = &self.values[first + row * self.columns..][..=SIDE];
            let lower = &self.values[first + (row + 1) * self.columns..][..=SIDE];
            for (column, cell) in line.iter_mut().enumerate() {
                let around = [upper[column], upper[column + 1], lower[column], lower[column + 1]];
                *cell = around.iter().zip(weights).map(|(value, weight)| value * weight).sum();
            }
        }
        Some(cells)
    }
}

/// Averages each value with the two `step` away; those at the rim stay.
fn blur(values: &[f32], step: usize, is_rim: impl Fn(usize) -> bool) -> Vec<f32> {
    let blurred = |(index, value): (usize, &f32)| {
        if is_rim(index) { *value } else { 0.5 * value + 0.25 * (values[index - step] + values[index + step]) }
    };
    values.iter().enumerate().map(blurred).collect()
}

/// A piece of a picture with structure in both directions.
#[derive(Clone, Debug)]
pub(super) struct Patch {
    /// Column and row of its first cell.
    pub(super) corner: [f32; 2],
    /// Luma relative to its mean, codes.
    pub(super) luma: [f32; CELLS],
    /// Slopes to the right and down, each relative to its mean, codes per cell.
    slopes: [[f32; CELLS]; 2],
    /// Sum of the squares of the luma.
    pub(super) power: f32,
    /// Inverse of the matrix of the sums of the slopes' products: xx, xy, yy.
    inverse: [f32; 3],
}

/// What a picture shows where a patch may be.
struct Comparison {
    /// Luma relative to its mean, codes.
    seen: [f32; CELLS],
    /// Its contrast relative to the patch's.
    gain: f32,
    /// Correlation.
    likeness: f32,
}

impl Patch {
    /// The patch with this first cell, at least one cell from the rim. `None` without structure in both directions.
    pub(super) fn learn(picture: &LumaCells, corner: [usize; 2]) -> Option<Self> {
        let corner = corner.map(|cell| cell as f32);
        let moved = |right: f32, down: f32| picture.window([corner[0] + right, corner[1] + down]);
        let slope = |ahead: [f32; CELLS], behind: [f32; CELLS]| -> [f32; CELLS] {
            centred(array::from_fn(|cell| 0.5 * (ahead[cell] - behind[cell])))
        };
        let slopes = [slope(moved(1.0, 0.0)?, moved(-1.0, 0.0)?), slope(moved(0.0, 1.0)?, moved(0.0, -1.0)?)];
        let luma = centred(moved(0.0, 0.0)?);
        let [xx, xy, yy] = [[0, 0], [0, 1], [1, 1]].map(|[one, other]| dot(&slopes[one], &slopes[other]));
        let weakest = 0.5 * (xx + yy - (xx - yy).hypot(2.0 * xy));
        if weakest < CELLS as f32 * MIN_SLOPE * MIN_SLOPE {
            return None;
        }
        let determinant = xx * yy - xy * xy;
        let inverse = [yy, -xy, xx].map(|of| of / determinant);
        Some(Self { corner, power: dot(&luma, &luma), luma, slopes, inverse })
    }

    fn compare(&self, picture: &LumaCells, [right, down]: [f32; 2]) -> Option<Comparison> {
        let seen = centred(picture.window([self.corner[0] + right, self.corner[1] + down])?);
        let (product, power) = (dot(&self.luma, &seen), dot(&seen, &seen));
        let likeness = product / (self.power * power).sqrt().max(f32::MIN_POSITIVE);
        Some(Comparison { seen, gain: product / self.power, likeness })
    }

    /// How much the picture looks like the patch at this displacement: their correlation. `None` if the place is not
    /// inside the picture.
    pub(super) fn likeness(&self, picture: &LumaCells, shift: [f32; 2]) -> Option<f32> {
        Some(self.compare(picture, shift)?.likeness)
    }

    /// The displacement where the picture shows the patch, cells. `None` if it does not show it within `reach` of
    /// `start`.
    pub(super) fn follow(&self, picture: &LumaCells, start: [f32; 2], reach: f32) -> Option<[f32; 2]> {
        let mut shift = start;
        for _ in 0..STEPS {
            let Comparison { seen, gain, .. } = self.compare(picture, shift)?;
            if gain < MIN_GAIN {
                return None;
            }
            let unexplained: [f32; CELLS] = array::from_fn(|cell| seen[cell] / gain - self.luma[cell]);
            let [across, along] = [0, 1].map(|axis| dot(&self.slopes[axis], &unexplained));
            let [xx, xy, yy] = self.inverse;
            let step = [xx * across + xy * along, xy * across + yy * along].map(|of| of.clamp(-MAX_STEP, MAX_STEP));
            shift = [shift[0] - step[0], shift[1] - step[1]];
            if (shift[0] - start[0]).hypot(shift[1] - start[1]) > reach {
                return None;
            }
            if step[0].hypot(step[1]) < LAST_STEP {
                break;
            }
        }
        (self.likeness(picture, shift)? >= MIN_LIKENESS).then_some(shift)
    }
}

fn centred(mut cells: [f32; CELLS]) -> [f32; CELLS] {
    let mean = cells.iter().sum::<f32>() / CELLS as f32;
    cells.iter_mut().for_each(|cell| *cell -= mean);
    cells
}

fn dot(one: &[f32; CELLS], other: &[f32; CELLS]) -> f32 {
    one.iter().zip(other).map(|(one, other)| one * other).sum()
}
