//! Where to look (T 6.6.1): the predicted place first, else the whole frame on a coarse grid.
//!
//! The frame is seen as *cells* of [`CELL_PX`] pixels: with 4:2:0 video exactly one chroma sample each, so that no
//! colour is looked up twice. The coarse grid visits every [`COARSE_STEP`]th cell in both directions; a band narrower
//! than that many cells can slip through, but such a band is too small to be measured anyway.

use super::colour_table::ColourTable;
use crate::pipeline::frame::Frame;

/// Pixels across one cell.
pub const CELL_PX: usize = 2;

/// Cells between looks on the coarse grid.
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

    /// The cells around pixels `low..high`, widened by `margin_px` and cut at the frame; `None` if nothing is left.
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

    /// Grown by `cells` on every side, cut at the frame.
    pub fn grown(self, cells: usize, frame: &Frame<'_>) -> Self {
        let whole = Self::whole(frame);
        Self {
            left: self.left.saturating_sub(cells),
            top: self.top.saturating_sub(cells),
            right: (self.right + cells).min(whole.right),
            bottom: (self.bottom + cells).min(whole.bottom),
        }
    }

    /// The smallest that holds both.
    pub fn joined(&self, other: &Self) -> Self {
        Self {
            left: self.left.min(other.left),
            top: self.top.min(other.top),
            right: self.right.max(other.right),
            bottom: self.bottom.max(other.bottom),
        }
    }

    /// Do both have a cell in common?
    pub fn overlaps(&self, other: &Self) -> bool {
        self.left < other.right && other.left < self.right && self.top < other.bottom && other.top < self.bottom
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.right - self.left
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.bottom - self.top
    }

    fn joins(&self, column: usize, row: usize, reach: usize) -> bool {
        column + reach >= self.left
            && column < self.right + reach
            && row + reach >= self.top
            && row < self.bottom + reach
    }

    /// Grown so that it holds this cell.
    pub fn include(&mut self, column: usize, row: usize) {
        self.left = self.left.min(column);
        self.top = self.top.min(row);
        self.right = self.right.max(column + 1);
        self.bottom = self.bottom.max(row + 1);
    }
}

/// Class of the colour in a cell.
#[inline]
pub fn class_at(frame: &Frame<'_>, table: &ColourTable, column: usize, row: usize) -> u8 {
    table.class_of(frame.yuv_at(column * CELL_PX, row * CELL_PX))
}

/// Looks over the whole frame on the coarse grid; boxes around what has this class, most looks first, each widened so
/// that it holds the whole band.
pub fn coarse_search(frame: &Frame<'_>, table: &ColourTable, class: u8) -> Vec<CellBox> {
    const MOST_BOXES: usize = 64; // a frame full of the colour must not cost a second
    let whole = CellBox::whole(frame);
    let mut found: Vec<(CellBox, usize)> = Vec::new();
    for row in (COARSE_STEP / 2..whole.bottom).step_by(COARSE_STEP) {
        for column in (COARSE_STEP / 2..whole.right).step_by(COARSE_STEP) {
            if class_at(frame, table, column, row) != class {
                continue;
            }
            let near = found.iter_mut().find(|(seen, _)| seen.joins(column, row, 2 * COARSE_STEP));
            if let Some((seen, looks)) = near {
                seen.include(column, row);
                *looks += 1;
            } else if found.len() < MOST_BOXES {
                found.push((CellBox { left: column, top: row, right: column + 1, bottom: row + 1 }, 1));
            }
        }
    }
    found.sort_by_key(|(_, looks)| std::cmp::Reverse(*looks));
    found.into_iter().map(|(seen, _)| seen.grown(2 * COARSE_STEP, frame)).collect()
}
