//! A frame as square cells: the mean codes of the pixels of each cell.
//!
//! A bare shaft has no colour of its own, so it is found by its shape. Cells average noise and compression away, and
//! are as coarse as a shaft's shape allows.

use std::ops::Range;

use crate::vision::frame::{ColourEncoding, Frame};

/// Rows of cells in a picture: a tube of 5 mm at 330 mm, seen by a lens as wide as 0.55 of the picture's width, is then
/// about two cells wide.
const ROWS: usize = 180;
/// Smallest side of a cell, pixels: half of it is a chroma sample.
const MIN_CELL_PX: usize = 2;

/// The cells of a picture size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellGrid {
    /// Side of a cell, pixels.
    pub cell_px: usize,
    /// Whole cells in a row.
    pub columns: usize,
    /// Whole rows of cells.
    pub rows: usize,
}

impl CellGrid {
    /// The cells of pictures of this size.
    pub fn new(width: usize, height: usize) -> Self {
        let cell_px = ((height as f64 / ROWS as f64).round() as usize).max(MIN_CELL_PX);
        Self { cell_px, columns: width / cell_px, rows: height / cell_px }
    }

    /// Number of cells.
    pub fn count(&self) -> usize {
        self.columns * self.rows
    }
}

/// The mean codes (Y, U, V) of each cell, row by row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CellPicture {
    /// The cells.
    pub grid: CellGrid,
    /// Mean codes.
    pub codes: Vec<[u8; 3]>,
}

impl CellPicture {
    /// The cells of a frame.
    pub fn of(frame: &Frame<'_>) -> Self {
        let grid = CellGrid::new(frame.width(), frame.height());
        let mut codes = vec![[0; 3]; grid.count()];
        let planes =
            [(&frame.y, 0, 0), (&frame.u, frame.shift_x, frame.shift_y), (&frame.v, frame.shift_x, frame.shift_y)];
        for (part, (plane, shift_x, shift_y)) in planes.into_iter().enumerate() {
            let spans: Vec<Range<usize>> =
                (0..grid.columns).map(|column| span(column, grid.cell_px, shift_x, plane.width)).collect();
            let mut sums = vec![0u32; plane.width];
            for (row, cells) in codes.chunks_exact_mut(grid.columns).enumerate() {
                let lines = span(row, grid.cell_px, shift_y, plane.height);
                sums.fill(0);
                lines.clone().for_each(|line| add_line(&mut sums, plane.row(line)));
                for (cell, span) in cells.iter_mut().zip(&spans) {
                    let pixels = (span.len() * lines.len()) as u32;
                    let sum = sums[span.clone()].iter().sum::<u32>();
                    cell[part] = ((sum + pixels / 2) / pixels.max(1)) as u8;
                }
            }
        }
        Self { grid, codes }
    }

    /// The same colours with the codes of another encoding.
    pub fn with_encoding(mut self, from: ColourEncoding, to: ColourEncoding) -> Self {
        if from != to {
            let convert = |codes: [u8; 3]| {
                let rgb = from.rgb_of_codes(codes.map(f64::from));
                to.codes_of(to.colour_of_rgb(rgb.into()))
            };
            self.codes.iter_mut().for_each(|codes| *codes = convert(*codes));
        }
        self
    }
}

/// The samples of a plane under a cell: those whose pixels begin inside it, at least one.
fn span(cell: usize, cell_px: usize, shift: u8, limit: usize) -> Range<usize> {
    let first = (cell * cell_px).div_ceil(1 << shift).min(limit.saturating_sub(1));
    let end = ((cell + 1) * cell_px).div_ceil(1 << shift).min(limit).max(first + 1);
    first..end
}

/// Adds a line of samples to the sums of its columns.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn add_line(sums: &mut [u32], line: &[u8]) {
    sums.iter_mut().zip(line).for_each(|(sum, code)| *sum += u32::from(*code));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::frame::{Matrix, Plane, Range};

    #[test]
    fn a_cell_has_the_mean_of_its_pixels() {
        let (width, height) = (640, 360);
        let luma: Vec<u8> = (0..width * height).map(|i| if (i % width) / 2 % 2 == 0 { 10 } else { 31 }).collect();
        let chroma = vec![90; width * height / 4];
        let plane = |data, width, height| Plane { data, stride: width, width, height };
        let frame = Frame {
            index: 0,
            time_s: 0.0,
            y: plane(&luma, width, height),
            u: plane(&chroma, width / 2, height / 2),
            v: plane(&chroma, width / 2, height / 2),
            shift_x: 1,
            shift_y: 1,
            chroma_first_px: [0.0; 2],
            encoding: ColourEncoding { range: Range::Limited, matrix: Matrix::Bt709 },
        };
        let cells = CellPicture::of(&frame);
        assert_eq!((cells.grid.cell_px, cells.grid.columns, cells.grid.rows), (2, 320, 180));
        assert_eq!(cells.codes[..2], [[10, 90, 90], [31, 90, 90]]);
    }
}
