//! Which shifts of the whole picture are likely, if the patches are not near their places: all shifts by whole steps at
//! half the resolution, scored by the patches that look alike there.
//!
//! **Cost:** a million products: at most [`MAX_PATCHES`] patches are compared, each with its 16 half-size cells.

use super::patch::{LumaCells, Patch, SIDE};

/// Largest shift in each direction, cells of half the resolution: 30 cells, a quarter of the picture's longer side.
const REACH: i32 = 15;

/// Number of patches that are compared.
const MAX_PATCHES: usize = 60;

/// Number of shifts that are returned.
const CANDIDATES: usize = 2;

/// Two shifts that differ by no more than this in each direction are one.
const PEAK_REACH: i32 = 2;

/// Only the part of a correlation above this counts, so that some patches that fit well outweigh many that fit badly:
/// 16 cells reach it by chance at many places.
const CHANCE_LIKENESS: f32 = 0.5;

/// Least contrast relative to the patch's.
const MIN_CONTRAST: f32 = 0.3;

/// Side of a patch at half the resolution.
const HALF: usize = SIDE / 2;

/// A picture at half the resolution.
struct HalfPicture {
    columns: usize,
    rows: usize,
    values: Vec<f32>,
    /// Root of the sum of squares about the mean of the patch that begins at each cell; 0 where none fits.
    contrasts: Vec<f32>,
}

/// A patch at half the resolution.
struct HalfPatch {
    column: i32,
    row: i32,
    luma: [f32; HALF * HALF],
    contrast: f32,
}

/// The shifts, to the right and down in cells, where most patches look alike; the best first.
pub(super) fn likely_shifts(patches: &[&Patch], picture: &LumaCells) -> Vec<[f32; 2]> {
    let every = patches.len().div_ceil(MAX_PATCHES).max(1);
    let patches: Vec<HalfPatch> = patches.iter().step_by(every).map(|patch| HalfPatch::of(patch)).collect();
    let picture = HalfPicture::of(picture);
    let shifts = (-REACH..=REACH).flat_map(|down| (-REACH..=REACH).map(move |right| [right, down]));
    let score = |shift: [i32; 2]| patches.iter().map(|patch| patch.score(&picture, shift)).sum::<f32>();
    let mut scored: Vec<(f32, [i32; 2])> = shifts.map(|shift| (score(shift), shift)).collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut best: Vec<[i32; 2]> = Vec::new();
    for (_, shift) in scored {
        let is_same = |of: &[i32; 2]| (0..2).all(|axis| (of[axis] - shift[axis]).abs() <= PEAK_REACH);
        if !best.iter().any(is_same) {
            best.push(shift);
        }
        if best.len() == CANDIDATES {
            break;
        }
    }
    best.into_iter().map(|shift| shift.map(|half_cells| (2 * half_cells) as f32)).collect()
}

impl HalfPatch {
    fn of(patch: &Patch) -> Self {
        let mut luma = [0.0; HALF * HALF];
        for (index, code) in patch.luma.iter().enumerate() {
            luma[index / SIDE / 2 * HALF + index % SIDE / 2] += 0.25 * code;
        }
        let [column, row] = patch.corner.map(|cell| cell as i32 / 2);
        Self { column, row, luma, contrast: luma.iter().map(|code| code * code).sum::<f32>().sqrt() }
    }

    /// By how much it looks more alike than by chance after this shift; 0 outside the picture.
    fn score(&self, picture: &HalfPicture, [right, down]: [i32; 2]) -> f32 {
        let (Ok(column), Ok(row)) = (usize::try_from(self.column + right), usize::try_from(self.row + down)) else {
            return 0.0;
        };
        if column + HALF > picture.columns || row + HALF > picture.rows {
            return 0.0;
        }
        let first = row * picture.columns + column;
        let contrast = picture.contrasts[first];
        if contrast <= MIN_CONTRAST * self.contrast {
            return 0.0;
        }
        let lines = self.luma.chunks_exact(HALF).zip(picture.values[first..].chunks(picture.columns));
        let product: f32 = lines.map(|(own, seen)| own.iter().zip(seen).map(|(a, b)| a * b).sum::<f32>()).sum();
        (product / (contrast * self.contrast).max(f32::MIN_POSITIVE) - CHANCE_LIKENESS).max(0.0)
    }
}

impl HalfPicture {
    fn of(picture: &LumaCells) -> Self {
        let (columns, rows) = (picture.columns / 2, picture.rows / 2);
        let mean = |index: usize| {
            let first = index / columns * 2 * picture.columns + index % columns * 2;
            let lines = [first, first + picture.columns].map(|at| picture.values[at] + picture.values[at + 1]);
            0.25 * (lines[0] + lines[1])
        };
        let values = (0..columns * rows).map(mean).collect();
        let mut half = Self { columns, rows, values, contrasts: Vec::new() };
        half.contrasts = (0..columns * rows).map(|first| half.contrast(first)).collect();
        half
    }

    /// Root of the sum of squares about the mean of the patch with this first cell; 0 where none fits.
    fn contrast(&self, first: usize) -> f32 {
        if first % self.columns + HALF > self.columns || first / self.columns + HALF > self.rows {
            return 0.0;
        }
        let (mut sum, mut squares) = (0.0, 0.0);
        for line in self.values[first..].chunks(self.columns).take(HALF) {
            sum += line[..HALF].iter().sum::<f32>();
            squares += line[..HALF].iter().map(|code| code * code).sum::<f32>();
        }
        (squares - sum * sum / (HALF * HALF) as f32).max(0.0).sqrt()
    }
}
