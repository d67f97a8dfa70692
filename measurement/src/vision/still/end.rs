//! The end of a shaft between its borders in a still: where its look changes all across it, or its full width ends.
//!
//! **In** the frame, the borders as lines. **Out** the places along the lines. **Method** Rows across the shaft, as in
//! a recording. In a still the borders are known along the whole shaft, so a weaker step of the colour shows the end:
//! jaws of steel mirror dark things, too. Five lanes along the shaft are compared, two inside the borders and three
//! between them. Where the shaft's look ends on most of them, and neither it nor the borders continue ahead, the shaft
//! ends. Its rim is half an ellipse: the borders' lanes end less far ahead, or behind, than the middle one. Jaws in the
//! shaft's own colour have no such step: there the full width ends. Without a camera, lengths along the shaft are in
//! widths of the picture, and a lean makes them seem shorter than they are.

use super::lines::ShaftLines;
use crate::vision::edges::edge_model::EdgeModel;
use crate::vision::edges::shaft_end;
use crate::vision::edges::shaft_rows::{self, Codes, ShaftRow, distance, mean_codes};
use crate::vision::frame::Frame;
use crate::vision::space::Pixel;

/// Rows across the width at the rough end: their distance is a twentieth of it, and from one pixel to two and a half.
const ROWS_PER_WIDTH: f64 = 20.0;
const ROWS_PX: (f64, f64) = (1.0, 2.5);
/// The rows reach from this far behind the rough end to that far ahead, diameters: things of the shaft's colour may
/// lie between the end and that of the strip.
const REACH_DIAMETERS: (f64, f64) = (20.0, 7.0);
/// Least width that is read, as a share of that at the rough end: ahead, the lines meet.
const LEAST_WIDTH: f64 = 0.3;

/// Lanes along the shaft: inside each border, and three between.
const LANES: usize = 5;
/// Length of the pieces behind and ahead of a step that are compared, diameters.
const PIECE_DIAMETERS: f64 = 0.5;
/// Least step, codes: the least contrast of a border.
const MIN_STEP_CODES: f64 = 12.0;
/// Least step, as a multiple of the usual one along the shaft: what light and highlights make.
const MIN_STEP_RATIO: f64 = 3.0;
/// Where the shaft must look as it does next to its end, diameters behind it, and the largest difference, as a share
/// of the step.
const ALIKE_DIAMETERS: [f64; 2] = [2.0, 5.0];
const MAX_UNLIKE_SHARE: f64 = 0.5;
/// Length of the shaft behind its end that must have borders, diameters, and the least share of it that must: things
/// behind the shaft that look like it hide a third of its borders.
const LONG_DIAMETERS: f64 = 6.0;
const MIN_LONG_SHARE: f64 = 0.6;
/// Length ahead of the end where the shaft's look may show again, diameters: jaws have it in places.
const MAX_RESUMED_DIAMETERS: f64 = 2.0;
/// Where the borders must not continue, diameters ahead: a collar is shorter. And the largest share that may have them.
const AHEAD_DIAMETERS: [f64; 2] = [2.5, 5.0];
const MAX_AHEAD_SHARE: f64 = 0.5;
/// Least distance of the colours on both sides of a border, codes.
const MIN_BORDER_CODES: f64 = 12.0;
/// Largest distance between the ends of the look, in the middle, and of the full width, diameters: a rim's bulge.
const MAX_APART_DIAMETERS: f64 = 0.6;

/// Where a shaft ends, as places along its lines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StillEnd {
    /// Where its borders end.
    pub borders: f64,
    /// Where its middle ends: the near half of the rim is curved.
    pub middle: f64,
}

/// Where the shaft ends; `None` if that is not clear.
pub fn locate(
    frame: &Frame<'_>,
    lines: &ShaftLines,
    edges: &EdgeModel,
    diameter_mm: f64,
    collar_mm: f64,
) -> Option<StillEnd> {
    let (places, rows) = rows_across(frame, lines, diameter_mm);
    let shaft = LookEnds::new(&rows, diameter_mm)?;
    let look = shaft.locate();
    let full_width = shaft_end::locate(edges, &rows, diameter_mm, collar_mm).map(|end| end.back_mm);
    // A collar may look like the shaft, so that the look ends with it.
    let is_near = |one: f64, other: f64| (one - other).abs() < MAX_APART_DIAMETERS * diameter_mm;
    let [borders_mm, middle_mm] = match (look, full_width) {
        (Some([_, middle_mm]), Some(end)) if !is_near(middle_mm, end) => return None,
        (Some(_), None) if collar_mm > 0.0 => return None,
        (Some(look), _) => look,
        (None, end) => [end?; 2],
    };
    let place = |back_mm| place_of(back_mm, &places, &rows);
    Some(StillEnd { borders: place(borders_mm)?, middle: place(middle_mm)? })
}

/// The place along the lines of a distance behind the rough end.
fn place_of(back_mm: f64, places: &[f64], rows: &[ShaftRow]) -> Option<f64> {
    let next = rows.iter().position(|row| row.back_mm <= back_mm)?;
    let before = next.checked_sub(1)?;
    let share = (rows[before].back_mm - back_mm) / (rows[before].back_mm - rows[next].back_mm);
    Some(places[before] + share * (places[next] - places[before]))
}

/// The places along the lines, and the rows across the shaft there, the farthest behind first.
fn rows_across(frame: &Frame<'_>, lines: &ShaftLines, diameter_mm: f64) -> (Vec<f64>, Vec<ShaftRow>) {
    let width = lines.width(lines.length);
    let step_px = (width / ROWS_PER_WIDTH).clamp(ROWS_PX.0, ROWS_PX.1);
    let step_mm = step_px * diameter_mm / width;
    let walk = |diameters: f64, sign: f64| {
        let count = (diameters * diameter_mm / step_mm) as usize;
        let next = move |place: &f64| Some(place + sign * step_mm * lines.width(*place) / diameter_mm);
        let is_shaft = move |place: &f64| lines.width(*place) > LEAST_WIDTH * width;
        std::iter::successors(Some(lines.length), next).skip(1).take(count).take_while(is_shaft).collect::<Vec<f64>>()
    };
    let (behind, ahead) = (walk(REACH_DIAMETERS.0, -1.0), walk(REACH_DIAMETERS.1, 1.0));
    let first = behind.len() as f64;
    let places: Vec<f64> = behind.into_iter().rev().chain([lines.length]).chain(ahead).collect();
    let row = |(i, place): (usize, &f64)| row_at(frame, lines, *place, (first - i as f64) * step_mm);
    let rows = places.iter().enumerate().map(row).collect();
    (places, rows)
}

fn row_at(frame: &Frame<'_>, lines: &ShaftLines, place: f64, back_mm: f64) -> ShaftRow {
    let [one, other] = [0, 1].map(|side| lines.offset(side, place));
    let (middle, half) = (0.5 * (one + other), 0.5 * (other - one));
    let codes = |across: f64| shaft_rows::codes_at(frame, Pixel(lines.at(place, middle + across)));
    shaft_rows::row_of(back_mm, |radii| codes(radii * half), |sign, px| codes(sign * (half + px)))
}

/// The codes of a row on a lane.
fn lane_of(row: &ShaftRow, lane: usize) -> Option<Codes> {
    match lane {
        0 | 1 => row.borders[lane].map(|[inside, _]| inside),
        _ => row.inside[lane - 2],
    }
}

/// The mean codes of some rows on each lane, where most of them show it.
type Look = [Option<Codes>; LANES];

fn look_of(rows: &[ShaftRow]) -> Look {
    std::array::from_fn(|lane| {
        let seen = || rows.iter().filter_map(|row| lane_of(row, lane));
        mean_codes(seen()).filter(|_| 2 * seen().count() >= rows.len())
    })
}

/// Distances of the lanes' colours, codes, the least first.
fn lane_distances(one: &Look, other: &Look) -> Vec<f64> {
    let both = one.iter().zip(other).filter_map(|(one, other)| Some(distance((*one)?, (*other)?)));
    let mut distances: Vec<f64> = both.collect();
    distances.sort_by(f64::total_cmp);
    distances
}

/// The median distance of the lanes' colours, codes; `None` if two are hidden.
fn median_distance(one: &Look, other: &Look) -> Option<f64> {
    let distances = lane_distances(one, other);
    (distances.len() + 1 >= LANES).then(|| distances[(distances.len() - 1) / 2])
}

/// Where the shaft's look ends.
struct LookEnds<'a> {
    rows: &'a [ShaftRow],
    step_mm: f64,
    diameter_mm: f64,
    /// Step of the look at each row, codes; 0 where it is hidden.
    steps: Vec<f64>,
    /// The usual step along the shaft, codes.
    usual_codes: f64,
}

impl<'a> LookEnds<'a> {
    fn new(rows: &'a [ShaftRow], diameter_mm: f64) -> Option<Self> {
        let step_mm = rows.first()?.back_mm - rows.get(1)?.back_mm;
        let mut ends = Self { rows, step_mm, diameter_mm, steps: Vec::new(), usual_codes: 0.0 };
        let steps: Vec<Option<f64>> = (0..rows.len()).map(|row| ends.step_at(row)).collect();
        ends.steps = steps.iter().map(|step| step.unwrap_or(0.0)).collect();
        let seen = rows.iter().zip(steps).filter(|(row, _)| row.back_mm > 0.0).filter_map(|(_, step)| step);
        let mut behind: Vec<f64> = seen.collect();
        behind.sort_by(f64::total_cmp);
        ends.usual_codes = behind.get(behind.len() / 2).copied().unwrap_or(0.0);
        Some(ends)
    }

    /// Number of rows of a length.
    fn count(&self, diameters: f64) -> usize {
        ((diameters * self.diameter_mm / self.step_mm) as usize).max(3)
    }

    fn step_at(&self, row: usize) -> Option<f64> {
        let piece = self.count(PIECE_DIAMETERS);
        let behind = look_of(self.rows.get(row.checked_sub(piece)?..row)?);
        let ahead = look_of(self.rows.get(row + 1..row + 1 + piece)?);
        median_distance(&behind, &ahead)
    }

    /// Where the look ends, mm behind the rough end: of the borders, and of the middle.
    fn locate(&self) -> Option<[f64; 2]> {
        let least = MIN_STEP_CODES.max(MIN_STEP_RATIO * self.usual_codes);
        let near = self.count(PIECE_DIAMETERS);
        let is_greatest = |row: usize| {
            let around = row.saturating_sub(near)..(row + near + 1).min(self.steps.len());
            around.into_iter().all(|other| self.steps[other] <= self.steps[row])
        };
        let mut ends = (0..self.steps.len())
            .filter(|row| self.steps[*row] > least && is_greatest(*row))
            .filter(|row| self.is_shaft_behind(*row).unwrap_or(false) && !self.continues(*row));
        ends.find_map(|row| self.rim_at(row))
    }

    /// Where the rim near a row meets the borders and the middle, mm behind the rough end, by least squares over the
    /// lanes. `None` if too few of them show it.
    fn rim_at(&self, row: usize) -> Option<[f64; 2]> {
        /// How far ahead a lane ends, as a share of the middle's distance ahead of the borders.
        const BULGES: [f64; LANES] = [0.51, 0.51, 0.86, 1.0, 0.86];
        /// Least number of lanes on the ellipse: one more than it has unknowns.
        const MIN_LANES: usize = 3;
        /// Largest distance of a lane's end from the ellipse, diameters.
        const MAX_OFF: f64 = 0.2;
        /// How far behind the borders the middle may end, diameters: tools lean away from the camera.
        const MAX_BEHIND: f64 = 0.2;
        let mut ends: Vec<[f64; 2]> =
            (0..LANES).filter_map(|lane| Some([BULGES[lane], self.crossing(lane, row)?])).collect();
        while ends.len() >= MIN_LANES {
            let [borders, bulge] = rim_of(&ends)?;
            let off = |[at, back]: &[f64; 2]| (back - borders - bulge * at).abs();
            let (worst, by) = ends.iter().map(off).enumerate().max_by(|one, other| one.1.total_cmp(&other.1))?;
            if by < MAX_OFF * self.diameter_mm {
                return (bulge < MAX_BEHIND * self.diameter_mm).then_some([borders, borders + bulge]);
            }
            ends.remove(worst);
        }
        None
    }

    /// Where a lane's colour is halfway between those behind and ahead of a row, mm behind the rough end.
    fn crossing(&self, lane: usize, row: usize) -> Option<f64> {
        /// The pieces whose colours are compared, from and to this far from the row, diameters: beyond the rim's bulge.
        const PIECE: [f64; 2] = [0.35, 0.75];
        let [near, far] = PIECE.map(|diameters| self.count(diameters));
        let mean = |rows: &[ShaftRow]| mean_codes(rows.iter().filter_map(|row| lane_of(row, lane)));
        let behind = mean(self.rows.get(row.checked_sub(far)?..row - near)?)?;
        let ahead = mean(self.rows.get(row + near..row + far)?)?;
        let rise: Codes = std::array::from_fn(|part| ahead[part] - behind[part]);
        let all: f64 = rise.iter().map(|rise| rise * rise).sum();
        if all.sqrt() < MIN_STEP_CODES {
            return None;
        }
        let share = |row: usize| {
            let codes = mean(self.rows.get(row.checked_sub(1)?..row + 2)?)?;
            Some((0..3).map(|part| (codes[part] - behind[part]) * rise[part]).sum::<f64>() / all)
        };
        let crossings = (row - far..row + far).filter_map(|row| {
            let (before, after) = (share(row)?, share(row + 1)?);
            let is_crossed = before <= 0.5 && after > 0.5;
            is_crossed.then(|| self.rows[row].back_mm - (0.5 - before) / (after - before) * self.step_mm)
        });
        let off = |back_mm: &f64| (back_mm - self.rows[row].back_mm).abs();
        crossings.min_by(|one, other| off(one).total_cmp(&off(other)))
    }

    /// Does the shaft look the same far behind a row, with borders?
    fn is_shaft_behind(&self, row: usize) -> Option<bool> {
        let next = look_of(&self.rows[row - self.count(PIECE_DIAMETERS)..row]);
        let [from, to] = ALIKE_DIAMETERS.map(|diameters| row.saturating_sub(self.count(diameters)));
        let far = look_of(self.rows.get(to..from)?);
        let behind = &self.rows[row.saturating_sub(self.count(LONG_DIAMETERS))..row];
        let is_long = (0..2).all(|side| {
            let seen = behind.iter().filter(|row| row.borders[side].is_some()).count();
            let shown = behind.iter().filter(|row| has_border(row, side, &far)).count();
            shown as f64 >= MIN_LONG_SHARE * seen as f64
        });
        Some(is_long && median_distance(&next, &far)? < MAX_UNLIKE_SHARE * self.steps[row])
    }

    /// Do the shaft's look or its borders continue ahead of a row?
    fn continues(&self, row: usize) -> bool {
        let look = look_of(&self.rows[row - self.count(PIECE_DIAMETERS)..row]);
        let ahead = &self.rows[row + 1..];
        let is_alike = |row: &&ShaftRow| {
            let own = look_of(std::slice::from_ref(*row));
            median_distance(&own, &look).is_some_and(|codes| codes < MAX_UNLIKE_SHARE * self.steps_of_end(&look, ahead))
        };
        let alike = ahead.iter().filter(is_alike).count();
        let [from, to] = AHEAD_DIAMETERS.map(|diameters| self.count(diameters).min(ahead.len()));
        let with_borders = ahead[from..to].iter().filter(|row| (0..2).all(|side| has_border(row, side, &look))).count();
        alike > self.count(MAX_RESUMED_DIAMETERS) || with_borders as f64 > MAX_AHEAD_SHARE * (to - from).max(1) as f64
    }

    /// The step from a look to that of the next piece, codes.
    fn steps_of_end(&self, look: &Look, ahead: &[ShaftRow]) -> f64 {
        let piece = self.count(PIECE_DIAMETERS).min(ahead.len());
        median_distance(look, &look_of(&ahead[..piece])).unwrap_or(0.0)
    }
}

/// Where the borders of a rim end, and how much farther its middle, from the ends of lanes `[bulge, end]`: least
/// squares, with the usual size of a bulge in view.
fn rim_of(ends: &[[f64; 2]]) -> Option<[f64; 2]> {
    /// Variance of a lane's end over that of the bulge: a tenth of the diameter, and leans of any angle.
    const RATIO: f64 = 0.1;
    let count = ends.len() as f64;
    let [x, y] = [0, 1].map(|part| ends.iter().map(|end| end[part]).sum::<f64>());
    let [xx, xy] = [0, 1].map(|part| ends.iter().map(|end| end[0] * end[part]).sum::<f64>());
    let xx = xx + RATIO;
    let whole = count * xx - x * x;
    (whole > 1e-9).then(|| [(xx * y - x * xy) / whole, (count * xy - x * y) / whole])
}

/// Has a row the border of this side, of the shaft's look?
fn has_border(row: &ShaftRow, side: usize, look: &Look) -> bool {
    row.borders[side].zip(look[side]).is_some_and(|([inside, outside], shaft)| {
        distance(inside, outside) > MIN_BORDER_CODES && distance(inside, shaft) < distance(outside, shaft)
    })
}
