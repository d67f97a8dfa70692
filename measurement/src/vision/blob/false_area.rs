//! Measures the parts of a marked frame that have a tool's colour but are not the tool. The samples alone cannot show
//! this if the peg that looks like the tape was not marked.
//!
//! Input: a frame, what segments it, and the rectangles that mark one tool's band on it. Regions that reach into the
//! rectangle around those marks are the band; all others are false. A false region that touches the band counts as
//! band. If several tools share the colour, each region with a mark on it is a band. If there are fewer such regions
//! than tools, the largest other regions count as the missing bands, which were not marked on this frame.

use super::components::{Component, ComponentFinder};
use crate::vision::frame::Frame;
use crate::vision::segmentation::Segment;
use crate::vision::segmentation::palette::FalseArea;
use crate::vision::segmentation::region_of_interest::{CELL_PX, CellBox};
use crate::vision::segmentation::samples::MarkedRectangle;

/// The false area of a class whose colour `tool_count` tools share; `None` if no mark lies on a region of that colour,
/// so that no band is known.
pub fn false_area(
    frame: &Frame<'_>,
    segment: &dyn Segment,
    class: u8,
    marks: &[&MarkedRectangle],
    tool_count: usize,
) -> Option<FalseArea> {
    let whole = CellBox::whole(frame);
    let mut marked: Vec<CellBox> = marks.iter().map(|mark| cells_of(mark)).collect();
    let around = marked.iter().copied().reduce(|a, b| a.joined(&b))?;
    if tool_count == 1 {
        marked = vec![around];
    }
    let found = ComponentFinder::default().find(frame, segment, class, whole, 1);
    let is_band = |region: &Component| marked.iter().any(|mark| region.bounds.overlaps(mark));
    let (bands, mut others): (Vec<Component>, Vec<Component>) = found.into_iter().partition(is_band);
    if bands.is_empty() {
        return None;
    }
    others.sort_by_key(|region| std::cmp::Reverse(region.moments.cells()));
    let unmarked = tool_count.saturating_sub(bands.len()).min(others.len());
    let others = others.split_off(unmarked);
    let cells = |of: &[Component]| of.iter().map(|c| c.moments.cells()).sum::<usize>() as f64;
    let band = cells(&bands) / tool_count.min(bands.len()) as f64;
    let outside = (whole.width() * whole.height()) as f64 - cells(&bands);
    Some(FalseArea {
        tool: marks[0].label.clone(),
        frame: frame.index,
        share: cells(&others) / outside.max(1.0),
        largest_of_band: others.first().map_or(0.0, |region| region.moments.cells() as f64) / band,
    })
}

fn cells_of(mark: &MarkedRectangle) -> CellBox {
    CellBox {
        left: mark.x / CELL_PX,
        top: mark.y / CELL_PX,
        right: (mark.x + mark.w).div_ceil(CELL_PX),
        bottom: (mark.y + mark.h).div_ceil(CELL_PX),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::frame::{ColourEncoding, Matrix, Plane, Range};
    use crate::vision::segmentation::colour_table::ColourTable;
    use crate::vision::segmentation::knn::Knn;
    use crate::vision::segmentation::samples::ColourSamples;

    const ENCODING: ColourEncoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 };

    /// A picture of cells: `#` has the tape's colour.
    fn of_picture(cells: &[&str], marks: &[MarkedRectangle], tool_count: usize) -> Option<FalseArea> {
        let samples = ColourSamples::of_orange_tape(ENCODING);
        let table = ColourTable::new(Knn::new(&samples, &[1, 0]).unwrap(), ENCODING);
        let plane = |on: u8, off: u8| -> Vec<u8> {
            let row = |row: &&str| row.bytes().flat_map(|c| [if c == b'#' { on } else { off }; 2]).collect::<Vec<u8>>();
            cells.iter().map(row).flat_map(|row| [row.clone(), row].concat()).collect()
        };
        let (y, u, v) = (plane(150, 60), plane(60, 128), plane(200, 128));
        let (width, height) = (2 * cells[0].len(), 2 * cells.len());
        let plane = |data| Plane { data, stride: width, width, height };
        let (y, u, v) = (plane(&y), plane(&u), plane(&v));
        let frame = Frame {
            index: 7,
            time_s: 0.0,
            y,
            u,
            v,
            shift_x: 0,
            shift_y: 0,
            chroma_first_px: [0.0; 2],
            encoding: ENCODING,
        };
        false_area(&frame, &table, 1, &marks.iter().collect::<Vec<_>>(), tool_count)
    }

    fn mark(x: usize, y: usize) -> MarkedRectangle {
        MarkedRectangle { label: "orange".into(), x, y, w: 2, h: 2 }
    }

    #[test]
    fn what_is_marked_is_the_band_and_all_else_is_false() {
        let picture = ["##......", "##......", "......#.", "......#.", "......#.", "........", "#.......", "........"];
        let area = of_picture(&picture, &[mark(2, 2)], 1).unwrap();
        assert_eq!((area.tool.as_str(), area.frame), ("orange", 7));
        assert_eq!(area.largest_of_band, 3.0 / 4.0);
        assert_eq!(area.share, 4.0 / 60.0);
    }

    #[test]
    fn a_mark_beside_its_colour_leaves_the_band_unknown() {
        assert_eq!(of_picture(&["##......", "........"], &[mark(10, 2)], 1), None);
    }
    #[test]
    fn of_two_tools_of_one_colour_the_unmarked_one_is_no_false_area() {
        let picture = ["##....##", "##....##", "......##", "........", "#.......", "........"];
        let of_one = of_picture(&picture, &[mark(2, 2)], 1).unwrap();
        assert_eq!(of_one.largest_of_band, 6.0 / 4.0);
        let of_two = of_picture(&picture, &[mark(2, 2)], 2).unwrap();
        assert_eq!((of_two.largest_of_band, of_two.share), (1.0 / 4.0, 1.0 / 44.0));
        let both_marked = of_picture(&picture, &[mark(2, 2), mark(14, 2)], 2).unwrap();
        assert_eq!((both_marked.largest_of_band, both_marked.share), (1.0 / 5.0, 1.0 / 38.0), "of the mean band");
    }
}
