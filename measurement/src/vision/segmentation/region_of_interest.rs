//! Where to search for a tool (T 6.6.1): around the predicted position first, else on the whole frame with a coarse
//! grid.
//!
//! The frame is processed in *cells* of [`CELL_PX`] pixels: with 4:2:0 video exactly one chroma sample each, so that
//! no colour is looked up twice. The coarse grid visits every [`COARSE_STEP`]th cell in both directions. A band
//! narrower than that many cells can be missed, but it would be too small to be measured anyway.

use super::Segment;
use crate::vision::frame::Frame;

/// Pixels across one cell.
pub const CELL_PX: usize = 2;

/// Cells between samples of the coarse grid.
const COARSE_STEP: usize = 4;

/// A rectangle of cells; `right` and `bottom` are one past the last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellBox {
    /// First column.
    pub left: usize,
    /// First row.
    pub top: usize,
    /// One past the last column.
    pub right: usize,
    /// One past the last row.
    pub bottom: usize,
}

impl CellBox {
    /// All cells of a frame.
    pub fn whole(frame: &Frame<'_>) -> Self {
        Self { left: 0, top: 0, right: frame.width().div_ceil(CELL_PX), bottom: frame.height().div_ceil(CELL_PX) }
    }

    /// The cells around pixels `low..high`, widened by `margin_px` and clipped to the frame; `None` if nothing is
    /// left.
    pub fn around(low: [f64; 2], high: [f64; 2], margin_px: f64, frame: &Frame<'_>) -> Option<Self> {
        let whole = Self::whole(frame);
        let cell = |px: f64, last: usize| ((px / CELL_PX as f64).max(0.0) as usize).min(last);
        let found = Self {
            left: cell(low[0] - margin_px, whole.right),
            top: cell(low[1] - margin_px, whole.bottom),
            right: cell(high[0] + margin_px + CELL_PX as f64, whole.right),
            bottom: cell(high[1] + margin_px + CELL_PX as f64, whole.bottom),
        };
        (found.left < found.right && found.top < found.bottom).then_some(found)
    }

    /// Grown by `cells` on every side, clipped to the frame.
    pub fn grown(self, cells: usize, frame: &Frame<'_>) -> Self {
        let whole = Self::whole(frame);
        Self {
            left: self.left.saturating_sub(cells),
            top: self.top.saturating_sub(cells),
            right: (self.right + cells).min(whole.right),
            bottom: (self.bottom + cells).min(whole.bottom),
        }
    }

    /// The smallest box that contains both.
    pub fn joined(&self, other: &Self) -> Self {
        Self {
            left: self.left.min(other.left),
            top: self.top.min(other.top),
            right: self.right.max(other.right),
            bottom: self.bottom.max(other.bottom),
        }
    }

    /// Do both boxes have a cell in common?
    pub fn overlaps(&self, other: &Self) -> bool {
        self.left < other.right && other.left < self.right && self.top < other.bottom && other.top < self.bottom
    }

    /// Number of columns.
    pub fn width(&self) -> usize {
        self.right - self.left
    }

    /// Number of rows.
    pub fn height(&self) -> usize {
        self.bottom - self.top
    }

    fn is_near_cell(&self, column: usize, row: usize, reach: usize) -> bool {
        column + reach >= self.left
            && column < self.right + reach
            && row + reach >= self.top
            && row < self.bottom + reach
    }

    /// Grows the box so that it contains this cell.
    pub fn include(&mut self, column: usize, row: usize) {
        self.left = self.left.min(column);
        self.top = self.top.min(row);
        self.right = self.right.max(column + 1);
        self.bottom = self.bottom.max(row + 1);
    }
}

/// Searches the whole frame on the coarse grid. Returns boxes around the samples of this class, those with most
/// samples first, each widened so that it contains the whole band.
pub fn coarse_search(frame: &Frame<'_>, segment: &dyn Segment, class: u8) -> Vec<CellBox> {
    const MAX_BOXES: usize = 64; // limits the time on a frame full of the colour
    let whole = CellBox::whole(frame);
    let mut found: Vec<(CellBox, usize)> = Vec::new();
    let columns = COARSE_STEP / 2..whole.right;
    let mut classes = Vec::new();
    for row in (COARSE_STEP / 2..whole.bottom).step_by(COARSE_STEP) {
        classes.clear();
        segment.classify_row(frame, row, columns.clone(), COARSE_STEP, &mut classes);
        let here = columns.clone().step_by(COARSE_STEP).zip(&classes).filter(|(_, found)| **found == class);
        for (column, _) in here {
            let near = found.iter_mut().find(|(seen, _)| seen.is_near_cell(column, row, 2 * COARSE_STEP));
            if let Some((seen, looks)) = near {
                seen.include(column, row);
                *looks += 1;
            } else if found.len() < MAX_BOXES {
                found.push((CellBox { left: column, top: row, right: column + 1, bottom: row + 1 }, 1));
            }
        }
    }
    found.sort_by_key(|(_, looks)| std::cmp::Reverse(*looks));
    found.into_iter().map(|(seen, _)| seen.grown(2 * COARSE_STEP, frame)).collect()
}
