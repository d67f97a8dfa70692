//! Bands inside a region that is not a band's alone: a prop of the tape's colour touches it, or lies behind it.
//!
//! **In:** the cells of a region. **Out:** the coarse borders and ends of the bands that it may contain, the likeliest
//! first. **Method:** the region's boundary is split into straight pieces, by a Hough transform with the direction of
//! the boundary. Two pieces that face away from each other, side by side, are the borders of a band. A prop that
//! touches a band covers a part of a border, seldom both borders for the whole length. **Gives up** on regions whose
//! boundary is not made of a few straight pieces: noise, or a wall of the tape's colour.

use nalgebra::{Point2, Vector2};

use super::scan_lines::CoarseBand;
use crate::vision::blob::select::MIN_WIDTH_PX;
use crate::vision::frame::Frame;
use crate::vision::segmentation::Segment;
use crate::vision::segmentation::region_of_interest::{CELL_PX, CellBox};
use crate::vision::space::Pixel;

/// Maximum number of bands returned: each costs a fit from several starts.
const MAX_BANDS: usize = 4;

/// Directions of boundaries in half a turn: 5° apart, so that a border of 40 cells stays within two cells of its line.
const DIRECTIONS: usize = 36;

/// Maximum angle between a boundary and the direction that it votes for: the error of a direction taken from five by
/// five cells.
const MAX_TURN_RAD: f64 = 0.2;

/// Distance of a boundary cell from the line of its border, pixels.
const NEAR_LINE_PX: f64 = 3.0;

/// Minimum number of cells of a border.
const MIN_BORDER_CELLS: usize = 6;

/// Gap between cells of one border, pixels: a highlight or a crease.
const MAX_GAP_PX: f64 = 16.0;

/// Minimum length of the part where both borders lie side by side, in widths. A shorter band is nearly seen end on.
const MIN_OVERLAP_WIDTHS: f64 = 0.5;

/// Minimum share of tape on the midline: less is a gap between two things.
const MIN_FILLED: f64 = 0.8;

/// Largest distance from the last cell of a border to the band's end, pixels: at its corners, the direction of the
/// boundary turns.
const MAX_CORNER_PX: f64 = 10.0;

/// Maximum number of boundary cells of a region that is searched. The outline of a band that fills the frame has fewer.
const MAX_BOUNDARY_CELLS: usize = 4000;

/// A cell at the boundary of a region.
struct BoundaryCell {
    /// Its centre, pixels.
    at: Vector2<f64>,
    /// Unit vector out of the region.
    outward: Vector2<f64>,
}

/// A straight piece of the boundary.
struct Border {
    cells: Vec<Vector2<f64>>,
    /// Distance of its line from the origin along the normal, pixels.
    offset_px: f64,
    /// Extent along the line, pixels.
    along_px: [f64; 2],
}

/// A band that a region may contain.
struct Candidate {
    band: CoarseBand,
    centre: Vector2<f64>,
    length_px: f64,
    /// Number of boundary cells that support it.
    support: usize,
}

/// The bands that the cells of a class in `bounds` may contain, the likeliest first. `max_length` is the longest
/// possible band, in widths.
pub fn find(frame: &Frame<'_>, segment: &dyn Segment, class: u8, bounds: CellBox, max_length: f64) -> Vec<CoarseBand> {
    let mask = Mask::new(frame, segment, class, bounds);
    let boundary = mask.boundary();
    if boundary.len() > MAX_BOUNDARY_CELLS {
        return Vec::new();
    }
    let mut all: Vec<Candidate> = (0..DIRECTIONS).flat_map(|k| along(&mask, &boundary, k, max_length)).collect();
    all.sort_by_key(|candidate| std::cmp::Reverse(candidate.support));
    let mut kept: Vec<Candidate> = Vec::new();
    for candidate in all {
        if kept.len() < MAX_BANDS && !kept.iter().any(|better| is_same(better, &candidate)) {
            kept.push(candidate);
        }
    }
    kept.into_iter().map(|candidate| candidate.band).collect()
}

/// Do two candidates lie on each other?
fn is_same(better: &Candidate, other: &Candidate) -> bool {
    const SAME_RAD: f64 = 0.3;
    let is_near = (better.centre - other.centre).norm() < 0.5 * better.band.width_px.max(0.5 * better.length_px);
    is_near && better.band.axis.dot(&other.band.axis).abs() > SAME_RAD.cos()
}

/// The candidates whose borders have the `k`th direction.
fn along(mask: &Mask, boundary: &[BoundaryCell], k: usize, max_length: f64) -> Vec<Candidate> {
    let angle = std::f64::consts::PI * k as f64 / DIRECTIONS as f64;
    let normal = Vector2::new(angle.cos(), angle.sin());
    let right = borders(boundary, normal, normal);
    let left = borders(boundary, normal, -normal);
    let pairs = right.iter().flat_map(|one| left.iter().map(move |other| (one, other)));
    pairs.filter_map(|(one, other)| candidate(mask, normal, one, other, max_length)).collect()
}

/// The straight pieces of the boundary that face `outward`; `normal` measures their offset.
fn borders(boundary: &[BoundaryCell], normal: Vector2<f64>, outward: Vector2<f64>) -> Vec<Border> {
    let axis = Vector2::new(-normal.y, normal.x);
    let mut facing: Vec<(f64, f64, Vector2<f64>)> = boundary
        .iter()
        .filter(|cell| cell.outward.dot(&outward) > MAX_TURN_RAD.cos())
        .map(|cell| (cell.at.dot(&normal), cell.at.dot(&axis), cell.at))
        .collect();
    facing.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut found = Vec::new();
    let (mut first, mut last, mut next) = (0, 0, f64::NEG_INFINITY);
    for middle in 0..facing.len() {
        let offset_px = facing[middle].0;
        if offset_px < next {
            continue;
        }
        next = offset_px + 0.5 * NEAR_LINE_PX;
        while facing[first].0 < offset_px - NEAR_LINE_PX {
            first += 1;
        }
        while last < facing.len() && facing[last].0 <= offset_px + NEAR_LINE_PX {
            last += 1;
        }
        found.extend(pieces(&facing[first..last], offset_px));
    }
    found
}

/// The pieces without a gap of the cells near one line.
fn pieces(near: &[(f64, f64, Vector2<f64>)], offset_px: f64) -> Vec<Border> {
    let mut sorted: Vec<(f64, Vector2<f64>)> = near.iter().map(|(_, along, at)| (*along, *at)).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let runs = sorted.chunk_by(|a, b| b.0 - a.0 < MAX_GAP_PX).filter(|run| run.len() >= MIN_BORDER_CELLS);
    let border = |run: &[(f64, Vector2<f64>)]| Border {
        cells: run.iter().map(|(_, at)| *at).collect(),
        offset_px,
        along_px: [run[0].0, run[run.len() - 1].0],
    };
    runs.map(border).collect()
}

/// The band between two borders, if they can be those of one.
fn candidate(mask: &Mask, normal: Vector2<f64>, right: &Border, left: &Border, max_length: f64) -> Option<Candidate> {
    let axis = Vector2::new(-normal.y, normal.x);
    let width_px = right.offset_px - left.offset_px;
    let from = right.along_px[0].max(left.along_px[0]);
    let to = right.along_px[1].min(left.along_px[1]);
    if width_px < MIN_WIDTH_PX || to - from < MIN_OVERLAP_WIDTHS * width_px {
        return None;
    }
    let middle_px = 0.5 * (right.offset_px + left.offset_px);
    let at = |along_px: f64| normal * middle_px + axis * along_px;
    // A border that a prop covers in part is shorter than the band; one that a prop continues is longer.
    let whole = [right.along_px[0].min(left.along_px[0]), right.along_px[1].max(left.along_px[1])];
    let [low, high] = if whole[1] - whole[0] < max_length * width_px { whole } else { [from, to] };
    let length_px = high - low;
    if length_px > max_length * width_px {
        return None;
    }
    let steps = (length_px / CELL_PX as f64) as usize + 1;
    let filled = (0..steps).filter(|k| mask.is_set(at(low + CELL_PX as f64 * *k as f64))).count();
    if (filled as f64) < MIN_FILLED * steps as f64 {
        return None;
    }
    let border = |of: &Border, outward: Vector2<f64>| -> Vec<Pixel> {
        of.cells.iter().map(|cell| Pixel(Point2::from(cell + outward * (0.5 * CELL_PX as f64)))).collect()
    };
    let band = CoarseBand {
        borders: [border(left, -normal), border(right, normal)],
        ends: [mask.end_of_tape(at(low), -axis), mask.end_of_tape(at(high), axis)],
        axis,
        width_px: width_px + CELL_PX as f64,
    };
    let support = right.cells.len() + left.cells.len();
    Some(Candidate { band, centre: at(0.5 * (low + high)), length_px, support })
}

/// The cells of a class in a box, with a margin of background.
struct Mask {
    bounds: CellBox,
    set: Vec<bool>,
}

impl Mask {
    /// Cells on each side of a cell that decide the direction of the boundary there.
    const REACH: i64 = 2;

    fn new(frame: &Frame<'_>, segment: &dyn Segment, class: u8, bounds: CellBox) -> Self {
        let mut classes = Vec::with_capacity(bounds.width() * bounds.height());
        for row in bounds.top..bounds.bottom {
            segment.classify_row(frame, row, bounds.left..bounds.right, 1, &mut classes);
        }
        Self { bounds, set: classes.into_iter().map(|found| found == class).collect() }
    }

    /// Is this cell, counted from the box's corner, of the class?
    fn get(&self, x: i64, y: i64) -> bool {
        let (width, height) = (self.bounds.width() as i64, self.bounds.height() as i64);
        (0..width).contains(&x) && (0..height).contains(&y) && self.set[(y * width + x) as usize]
    }

    /// Is the cell at a pixel of the class?
    fn is_set(&self, at: Vector2<f64>) -> bool {
        let cell = |px: f64, first: usize| ((px + 0.5) / CELL_PX as f64).floor() as i64 - first as i64;
        self.get(cell(at.x, self.bounds.left), cell(at.y, self.bounds.top))
    }

    /// The last pixel of the class from a pixel in a direction, within [`MAX_CORNER_PX`].
    fn end_of_tape(&self, from: Vector2<f64>, towards: Vector2<f64>) -> Pixel {
        let steps = (1..=MAX_CORNER_PX as usize).map(|step| from + towards * step as f64);
        Pixel(Point2::from(steps.take_while(|at| self.is_set(*at)).last().unwrap_or(from)))
    }

    fn boundary(&self) -> Vec<BoundaryCell> {
        let (width, height) = (self.bounds.width() as i64, self.bounds.height() as i64);
        let cells = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        cells.filter_map(|(x, y)| self.boundary_cell(x, y)).collect()
    }

    fn boundary_cell(&self, x: i64, y: i64) -> Option<BoundaryCell> {
        let is_inside = [(1, 0), (-1, 0), (0, 1), (0, -1)].iter().all(|(dx, dy)| self.get(x + dx, y + dy));
        if !self.get(x, y) || is_inside {
            return None;
        }
        let around = -Self::REACH..=Self::REACH;
        let offsets = around.clone().flat_map(|dy| around.clone().map(move |dx| (dx, dy)));
        let set = offsets.filter(|(dx, dy)| self.get(x + dx, y + dy));
        let inward: Vector2<f64> = set.map(|(dx, dy)| Vector2::new(dx as f64, dy as f64)).sum();
        let centre =
            |cell: i64, first: usize| ((cell + first as i64) * CELL_PX as i64) as f64 + 0.5 * (CELL_PX as f64 - 1.0);
        let at = Vector2::new(centre(x, self.bounds.left), centre(y, self.bounds.top));
        Some(BoundaryCell { at, outward: -inward.try_normalize(1e-9)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::frame::{ColourEncoding, Matrix, Plane, Range};
    use crate::vision::segmentation::colour_table::ColourTable;
    use crate::vision::segmentation::knn::Knn;
    use crate::vision::segmentation::samples::ColourSamples;

    const WIDTH: usize = 320;
    const HEIGHT: usize = 240;
    const ENCODING: ColourEncoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 };

    /// Bands in a picture where the pixels for which `is_tape` is true have the tape's colour.
    fn found(is_tape: impl Fn(Vector2<f64>) -> bool) -> Vec<CoarseBand> {
        let samples = ColourSamples::of_orange_tape(ENCODING);
        let table = ColourTable::new(Knn::new(&samples, &[1, 0]).unwrap(), ENCODING);
        let plane = |on: u8, off: u8| -> Vec<u8> {
            let pixels = (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| Vector2::new(x as f64, y as f64)));
            pixels.map(|pixel| if is_tape(pixel) { on } else { off }).collect()
        };
        let planes = [plane(150, 60), plane(60, 128), plane(200, 128)];
        let [y, u, v] = planes.each_ref().map(|data| Plane { data, stride: WIDTH, width: WIDTH, height: HEIGHT });
        let chroma_first_px = [0.0; 2];
        let frame =
            Frame { index: 0, time_s: 0.0, y, u, v, shift_x: 0, shift_y: 0, chroma_first_px, encoding: ENCODING };
        find(&frame, &table, 1, CellBox::whole(&frame), 5.0)
    }

    const CENTRE: Vector2<f64> = Vector2::new(160.0, 120.0);
    const BAND: [f64; 2] = [110.0, 34.0];

    /// A band of 110 by 34 pixels that leans by `angle`.
    fn is_band(pixel: Vector2<f64>, angle: f64) -> bool {
        let [along, across] = [axis(angle), Vector2::new(-angle.sin(), angle.cos())].map(|v| v.dot(&(pixel - CENTRE)));
        2.0 * along.abs() < BAND[0] && 2.0 * across.abs() < BAND[1]
    }

    fn axis(angle: f64) -> Vector2<f64> {
        Vector2::new(angle.cos(), angle.sin())
    }

    /// True if the band is found to within three cells.
    fn is_right(band: &CoarseBand, angle: f64) -> bool {
        let ends = [-0.5, 0.5].map(|side| CENTRE + axis(angle) * (side * BAND[0]));
        let near = |end: &Vector2<f64>| band.ends.iter().any(|found| (found.0.coords - end).norm() < 6.0);
        (band.width_px - BAND[1]).abs() < 4.0 && ends.iter().all(near)
    }

    #[test]
    fn a_band_is_found_at_any_angle() {
        for k in 0..24 {
            let angle = 0.13 + f64::from(k) * std::f64::consts::PI / 24.0;
            let bands = found(|pixel| is_band(pixel, angle));
            assert!(
                bands.first().is_some_and(|band| is_right(band, angle)),
                "{angle}: {:?}",
                bands.iter().map(|b| (b.width_px, b.ends, b.axis)).collect::<Vec<_>>()
            );
        }
    }

    #[test]
    fn a_band_is_found_beside_a_triangle_of_its_colour() {
        for k in 0..12 {
            let angle = 0.13 + f64::from(k) * std::f64::consts::PI / 12.0;
            // Its corner lies inside the band; it widens to 70 px, away from the band.
            let is_triangle = |pixel: Vector2<f64>| {
                let from_corner = pixel - CENTRE - axis(angle) * 20.0;
                let (beside, along) =
                    (from_corner.dot(&Vector2::new(-angle.sin(), angle.cos())), from_corner.dot(&axis(angle)));
                (0.0..70.0).contains(&beside) && along.abs() < 0.5 * beside
            };
            let bands = found(|pixel| is_band(pixel, angle) || is_triangle(pixel));
            assert!(
                bands.iter().any(|band| is_right(band, angle)),
                "{angle}: {:?}",
                bands.iter().map(|b| (b.width_px, b.ends, b.axis)).collect::<Vec<_>>()
            );
        }
    }

    #[test]
    fn a_disc_and_scattered_cells_contain_no_band() {
        assert_eq!(found(|pixel| (pixel - CENTRE).norm() < 60.0), []);
        assert_eq!(found(|pixel| (pixel.x as usize * 7 + pixel.y as usize * 13).is_multiple_of(5)), []);
    }
}
