//! Connected components of one class inside a box of cells (METHOD 3.1).

use super::moments::Moments;
use crate::vision::frame::Frame;
use crate::vision::segmentation::Segment;
use crate::vision::segmentation::region_of_interest::CellBox;

/// A region of touching cells of one class.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Component {
    /// Area, centroid and spread, in pixels.
    pub moments: Moments,
    /// The cells it spans.
    pub bounds: CellBox,
}

/// Finds components; keeps its buffers between frames.
#[derive(Default)]
pub struct ComponentFinder {
    classes: Vec<u8>,
    mask: Vec<bool>,
    stack: Vec<(usize, usize)>,
}

impl ComponentFinder {
    /// All components of `class` in `search` with at least `least_cells` cells, largest first. Cells touch by side or
    /// corner.
    pub fn find(
        &mut self,
        frame: &Frame<'_>,
        segment: &dyn Segment,
        class: u8,
        search: CellBox,
        least_cells: usize,
    ) -> Vec<Component> {
        self.find_where(frame, segment, class, search, least_cells, |_, _| true)
    }

    /// The same, using only the cells (column, row) for which `counts` is true.
    pub fn find_where(
        &mut self,
        frame: &Frame<'_>,
        segment: &dyn Segment,
        class: u8,
        search: CellBox,
        least_cells: usize,
        counts: impl Fn(usize, usize) -> bool,
    ) -> Vec<Component> {
        self.classify(frame, segment, class, search, counts);
        let width = search.width();
        let mut found = Vec::new();
        for start in 0..self.mask.len() {
            if self.mask[start] {
                let component = self.flood((start % width, start / width), search);
                if component.moments.cells() >= least_cells {
                    found.push(component);
                }
            }
        }
        found.sort_by_key(|c: &Component| std::cmp::Reverse(c.moments.cells()));
        found
    }

    fn classify(
        &mut self,
        frame: &Frame<'_>,
        segment: &dyn Segment,
        class: u8,
        search: CellBox,
        counts: impl Fn(usize, usize) -> bool,
    ) {
        self.mask.clear();
        for row in search.top..search.bottom {
            let columns = search.left..search.right;
            self.classes.clear();
            segment.classify_row(frame, row, columns.clone(), 1, &mut self.classes);
            let classes = columns.zip(&self.classes);
            self.mask.extend(classes.map(|(column, found)| *found == class && counts(column, row)));
        }
    }

    fn flood(&mut self, start: (usize, usize), search: CellBox) -> Component {
        let (width, height) = (search.width(), search.height());
        let mut moments = Moments::default();
        let mut bounds = CellBox {
            left: search.left + start.0,
            top: search.top + start.1,
            right: search.left + start.0 + 1,
            bottom: search.top + start.1 + 1,
        };
        self.mask[start.1 * width + start.0] = false;
        self.stack.push(start);
        while let Some((x, y)) = self.stack.pop() {
            let (column, row) = (search.left + x, search.top + y);
            moments.add_cell(column, row);
            bounds.include(column, row);
            for ny in y.saturating_sub(1)..(y + 2).min(height) {
                for nx in x.saturating_sub(1)..(x + 2).min(width) {
                    let neighbour = &mut self.mask[ny * width + nx];
                    if *neighbour {
                        *neighbour = false;
                        self.stack.push((nx, ny));
                    }
                }
            }
        }
        Component { moments, bounds }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::frame::{ColourEncoding, Matrix, Plane, Range};
    use crate::vision::segmentation::colour_table::ColourTable;
    use crate::vision::segmentation::knn::Knn;
    use crate::vision::segmentation::samples::ColourSamples;

    #[test]
    fn two_blocks_that_touch_at_a_corner_are_one_and_a_third_stays_apart() {
        let encoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 };
        let samples = ColourSamples::of_orange_tape(encoding);
        let table = ColourTable::new(Knn::new(&samples, &[1, 0]).unwrap(), encoding);
        let picture = ["##....", "##....", "..##..", "..##.#"];
        let plane = |on: u8, off: u8, times: usize| -> Vec<u8> {
            picture
                .iter()
                .flat_map(|row| std::iter::repeat_n(row, times))
                .flat_map(|row| {
                    row.bytes().flat_map(move |c| std::iter::repeat_n(if c == b'#' { on } else { off }, times))
                })
                .collect()
        };
        let (y, u, v) = (plane(150, 60, 2), plane(60, 128, 1), plane(200, 128, 1));
        let full = Plane { data: &y, stride: 12, width: 12, height: 8 };
        let half = |data| Plane { data, stride: 6, width: 6, height: 4 };
        let frame = Frame {
            index: 0,
            time_s: 0.0,
            y: full,
            u: half(&u),
            v: half(&v),
            shift_x: 1,
            shift_y: 1,
            chroma_first_px: [0.5; 2],
            encoding,
        };
        let found = ComponentFinder::default().find(&frame, &table, 1, CellBox::whole(&frame), 1);
        let sizes: Vec<usize> = found.iter().map(|c| c.moments.cells()).collect();
        assert_eq!(sizes, [8, 1]);
        assert_eq!(found[0].moments.centroid(), [3.5, 3.5]);
    }
}
