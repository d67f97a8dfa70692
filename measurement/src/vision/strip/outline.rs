//! Outline: both borders and the end of a rough strip, to a fifth of a cell.
//!
//! **In** the evidence on the undistorted grid, a rough strip. **Out** a [`Strip`]. **Method** The strip's surroundings
//! are read along its rows. Four numbers, the places of both borders at its beginning and at its end, are moved as long
//! as the evidence inside grows, less what speaks for a shaft just outside. Then each row's evidence is added up from
//! the rim on, and the strip ends where the sum is largest.

use nalgebra::{Point2, Vector2};

use super::Strip;
use super::grid::{GridMap, UndistortedGrid};
use super::search::RoughStrip;

/// Distance between places across the strip, cells.
const STEP_ACROSS: f64 = 0.5;
/// Largest ratio of a strip's widths at both ends: that of its distances from the camera, as 240 mm to 60 mm.
const MAX_TAPER: f64 = 4.0;
/// How far a width may be outside the limits of the tube's, as a share.
const WIDTH_SLACK: f64 = 0.2;
/// Weight of the evidence inside against that outside.
const INSIDE_WEIGHT: f64 = 1.5;
/// Least rows of a strip, cells.
const MIN_ROWS: usize = 4;
/// Rounds of borders and end: each begins where the last one ended.
const ROUNDS: usize = 3;

/// Finds the borders and the end of a rough strip. `inside` is 1 inside the picture; `widths` are the smallest and the
/// largest width that the tube can have, cells. `None` if nothing like a shaft is left.
pub fn outline(
    grid: &UndistortedGrid,
    evidence: &GridMap,
    inside: &GridMap,
    rough: &RoughStrip,
    widths: (f64, f64),
) -> Option<Strip> {
    let mut now = Estimate { origin: rough.point, along: rough.direction, width: rough.width, end: rough.end };
    let mut found = None;
    for _ in 0..ROUNDS {
        let rows = Rows::read(grid, evidence, inside, &now)?;
        let borders = rows.fit_borders(now.width, widths)?;
        let (strip, next) = rows.strip(grid, &now, &borders)?;
        (now, found) = (next, Some(strip));
    }
    found
}

/// A strip as one round sees it.
struct Estimate {
    origin: Point2<f64>,
    along: Vector2<f64>,
    width: f64,
    /// Distance from the origin along the strip, cells.
    end: f64,
}

/// Both borders' places across the strip: of the left one at the beginning and at the end, then of the right one.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Borders([f64; 4]);

impl Borders {
    fn at(&self, share: f64) -> (f64, f64) {
        let [left, left_end, right, right_end] = self.0;
        (left + (left_end - left) * share, right + (right_end - right) * share)
    }

    fn widths(&self) -> (f64, f64) {
        let [left, left_end, right, right_end] = self.0;
        (right - left, right_end - left_end)
    }

    /// Can a tube have these widths?
    fn are_possible(&self, (narrow, wide): (f64, f64)) -> bool {
        let (one, other) = self.widths();
        let (least, most) = (one.min(other), one.max(other));
        least >= narrow * (1.0 - WIDTH_SLACK) && most <= wide * (1.0 + WIDTH_SLACK) && most <= MAX_TAPER * least
    }
}

/// The rows across a strip, from the picture's rim to beyond its end.
struct Rows {
    /// Places along the strip, cells from its origin.
    places: Vec<f64>,
    /// Is the row inside the picture?
    is_inside: Vec<bool>,
    half: f64,
    columns: usize,
    /// Sums across each row: of the evidence, and of what speaks for a shaft.
    all: Vec<f64>,
    positive: Vec<f64>,
    /// First and last row of the strip.
    first: usize,
    last: usize,
}

impl Rows {
    fn read(grid: &UndistortedGrid, evidence: &GridMap, inside: &GridMap, now: &Estimate) -> Option<Self> {
        const MIN_INSIDE: f64 = 0.6;
        let across = Vector2::new(-now.along.y, now.along.x);
        let half = 1.6 * now.width + 4.0;
        let columns = (2.0 * half / STEP_ACROSS) as usize + 1;
        let reach = (grid.columns as f64).hypot(grid.rows as f64);
        let mut rows = Self {
            places: Vec::new(),
            is_inside: Vec::new(),
            half,
            columns,
            all: Vec::new(),
            positive: Vec::new(),
            first: 0,
            last: 0,
        };
        let steps = (reach + now.end + 6.0 * now.width + 20.0).max(0.0) as usize;
        rows.all.reserve(steps * (columns + 1));
        rows.positive.reserve(steps * (columns + 1));
        for step in 0..steps {
            let place = step as f64 - reach;
            let middle = now.origin + now.along * place;
            let count = (now.width / STEP_ACROSS).max(1.0) as usize;
            let at = |column: usize| middle + across * (column as f64 * STEP_ACROSS - half);
            let near = (columns - count) / 2..(columns + count).div_ceil(2);
            let share = near.clone().map(|column| read(inside, at(column))).sum::<f64>() / near.len() as f64;
            let is_inside = share > MIN_INSIDE;
            if !is_inside && rows.places.is_empty() {
                continue; // before the picture's rim
            }
            let (mut all, mut positive) = (0.0, 0.0);
            for column in 0..columns {
                rows.all.push(all);
                rows.positive.push(positive);
                let value = read(evidence, at(column)) * STEP_ACROSS;
                (all, positive) = (all + value, positive + value.max(0.0));
            }
            rows.all.push(all);
            rows.positive.push(positive);
            rows.places.push(place);
            rows.is_inside.push(is_inside);
        }
        rows.last = rows.places.iter().rposition(|place| *place <= now.end)?;
        (rows.is_inside[..=rows.last].iter().filter(|inside| **inside).count() >= MIN_ROWS).then_some(rows)
    }

    /// A place across a row: the number of the sum before it, and the share of the next one.
    #[inline(always)]
    fn place(&self, row: usize, across: f64) -> (usize, f64) {
        let at = ((across + self.half) / STEP_ACROSS + 0.5).clamp(0.0, self.columns as f64 - 0.001);
        let column = at as u32; // `floor` is a call
        (row * (self.columns + 1) + column as usize, at - f64::from(column))
    }

    /// The part of the strip's length before a row: 0 at the first, 1 at the last.
    fn share_of(&self, row: usize) -> f64 {
        (self.places[row] - self.places[self.first]) / (self.places[self.last] - self.places[self.first]).max(1.0)
    }

    fn between(&self, sums: &[f64], row: usize, from: f64, to: f64) -> f64 {
        sum_to(sums, self.place(row, to)) - sum_to(sums, self.place(row, from))
    }

    /// The rows of the strip inside the picture, each with its share of the strip's length.
    fn inside(&self) -> Vec<(usize, f64)> {
        let rows = (self.first..=self.last).filter(|row| self.is_inside[*row]);
        rows.map(|row| (row, self.share_of(row))).collect()
    }

    /// The evidence inside the borders, less what speaks for a shaft just outside, in these rows.
    fn gain(&self, rows: &[(usize, f64)], borders: &Borders) -> f64 {
        let of_row = |(row, share): &(usize, f64)| {
            let (left, right) = borders.at(*share);
            let flank = ((right - left) / 3.0).max(1.5);
            let [before, left, right, behind] =
                [left - flank, left, right, right + flank].map(|across| self.place(*row, across));
            let beside = (sum_to(&self.positive, left) - sum_to(&self.positive, before))
                + (sum_to(&self.positive, behind) - sum_to(&self.positive, right));
            INSIDE_WEIGHT * (sum_to(&self.all, right) - sum_to(&self.all, left)) - beside
        };
        rows.iter().map(of_row).sum()
    }

    /// The borders of most gain, by moving them together and one by one.
    fn fit_borders(&self, width: f64, widths: (f64, f64)) -> Option<Borders> {
        const LAST_STEP: f64 = 0.2;
        const MOVES: [[f64; 4]; 9] = [
            [1.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 1.0],
            [1.0, 0.0, 1.0, 0.0],
            [0.0, 1.0, 0.0, 1.0],
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [-1.0, -1.0, 1.0, 1.0],
        ];
        let half = 0.5 * width.clamp(widths.0, widths.1.max(widths.0));
        let mut best = Borders([-half, -half, half, half]);
        let rows = self.inside();
        let mut gain = self.gain(&rows, &best);
        let mut step = (0.25 * width).max(1.0);
        while step > LAST_STEP {
            let mut has_moved = false;
            for way in MOVES.iter().flat_map(|way| [(way, step), (way, -step)]) {
                let moved = Borders(std::array::from_fn(|i| best.0[i] + way.1 * way.0[i]));
                if !moved.are_possible(widths) {
                    continue;
                }
                let there = self.gain(&rows, &moved);
                if there > gain + 1e-6 {
                    (best, gain, has_moved) = (moved, there, true);
                }
            }
            if !has_moved {
                step *= 0.5;
            }
        }
        (gain > 0.0).then_some(best)
    }

    /// Evidence of each row: the median of its left quarter, its middle and its right quarter, because one of them may
    /// be a highlight or a shadow; each as a mean over half a width along the strip. And the same less what speaks for a
    /// shaft beside it.
    fn evidence(&self, borders: &Borders) -> (Vec<f64>, Vec<f64>) {
        const PARTS: [(f64, f64); 3] = [(0.08, 0.33), (0.33, 0.67), (0.67, 0.92)];
        let usual_width = 0.5 * (borders.widths().0 + borders.widths().1);
        let reach = ((0.25 * usual_width) as usize).max(1);
        let least = borders.widths().0.max(borders.widths().1) / (MAX_TAPER * (1.0 + WIDTH_SLACK));
        let part = |row: usize, (from, to): (f64, f64)| {
            let (left, right) = borders.at(self.share_of(row));
            let width = right - left;
            self.between(&self.all, row, left + from * width, left + to * width) / ((to - from) * width).max(0.3)
        };
        let parts: Vec<[f64; 3]> = (0..self.places.len()).map(|row| PARTS.map(|of| part(row, of))).collect();
        let smooth = |row: usize, of: usize| {
            let near = row.saturating_sub(reach)..(row + reach + 1).min(parts.len());
            near.clone().map(|row| parts[row][of]).sum::<f64>() / near.len() as f64
        };
        let (mut own, mut net) = (Vec::new(), Vec::new());
        for row in 0..self.places.len() {
            let mut three: [f64; 3] = std::array::from_fn(|of| smooth(row, of));
            three.sort_by(f64::total_cmp);
            let (left, right) = borders.at(self.share_of(row));
            let flank = ((right - left) / 3.0).max(1.5);
            let beside = self.between(&self.positive, row, left - flank, left)
                + self.between(&self.positive, row, right, right + flank);
            let counts = self.is_inside[row] && right - left >= least;
            own.push(three[1]);
            net.push(if counts { three[1] - 0.5 * beside / (2.0 * flank) } else { 0.0 });
        }
        (own, net)
    }

    /// The strip between these borders up to its end, and the estimate for the next round.
    fn strip(&self, grid: &UndistortedGrid, now: &Estimate, borders: &Borders) -> Option<(Strip, Estimate)> {
        let (own, net) = self.evidence(borders);
        let (mut sum, mut score, mut end) = (0.0, 0.0, 0);
        for (row, evidence) in net.iter().enumerate() {
            sum += evidence;
            if sum > score {
                (score, end) = (sum, row);
            }
        }
        let length = self.places[end] - self.places[self.first];
        if score <= 0.0 || length < MIN_ROWS as f64 - 1.0 {
            return None;
        }
        let across = Vector2::new(-now.along.y, now.along.x);
        let at = |row: usize, place: f64| now.origin + now.along * self.places[row] + across * place;
        let (first, last) = (borders.at(0.0), borders.at(self.share_of(end)));
        let middle = |(left, right): (f64, f64)| 0.5 * (left + right);
        let [entry, tip] = [at(self.first, middle(first)), at(end, middle(last))];
        let rows: Vec<usize> = (self.first..=end).filter(|row| self.is_inside[*row]).collect();
        let count = rows.len().max(1) as f64;
        let width = last.1 - last.0;
        let point = |at: Point2<f64>| grid.normalised(at).0;
        let strip = Strip {
            borders: [
                [point(at(self.first, first.0)), point(at(end, last.0))],
                [point(at(self.first, first.1)), point(at(end, last.1))],
            ],
            entry: grid.normalised(entry),
            end: grid.normalised(tip),
            width: width * grid.pitch,
            length_widths: length / width.max(0.1),
            score,
            net_evidence: rows.iter().map(|row| net[*row]).sum::<f64>() / count,
            supported_share: rows.iter().filter(|row| own[**row] > 0.0).count() as f64 / count,
            end_step_codes: None,
        };
        let along = (tip - entry).try_normalize(1e-9)?;
        let next = Estimate { origin: tip, along, width: 0.5 * (borders.widths().0 + borders.widths().1), end: 0.0 };
        Some((strip, next))
    }
}

/// A sum over a row from its left rim to a place across.
#[inline(always)]
fn sum_to(sums: &[f64], (first, share): (usize, f64)) -> f64 {
    let pair = &sums[first..first + 2];
    pair[0] * (1.0 - share) + pair[1] * share
}

fn read(map: &GridMap, at: Point2<f64>) -> f64 {
    f64::from(map.at(at.x as f32, at.y as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::camera::testing::STRAIGHT;
    use crate::vision::strip::search::width_limits;

    #[test]
    fn borders_and_end_of_a_tapered_strip_are_found_from_a_rough_one() {
        let grid = UndistortedGrid::new(&STRAIGHT).unwrap();
        let (columns, rows) = (grid.columns as f64, grid.rows as f64);
        let end = 0.6 * columns;
        // Borders of a strip from the left rim, a little narrower towards its end.
        let border = |x: f64, sign: f64| 0.5 * rows + 0.05 * x + sign * (5.0 - 0.008 * x);
        let value = |i: usize| {
            let (x, y) = ((i % grid.columns) as f64, (i / grid.columns) as f64);
            if x < end && y > border(x, -1.0) && y < border(x, 1.0) { 2.0 } else { -2.0 }
        };
        let map = GridMap {
            columns: grid.columns,
            rows: grid.rows,
            values: (0..grid.columns * grid.rows).map(value).collect(),
        };
        let rough = RoughStrip {
            point: Point2::new(0.3 * columns, 0.5 * rows + 0.015 * columns + 1.5),
            direction: Vector2::new(1.0, 0.03).normalize(),
            width: 8.0,
            end: 0.3 * columns - 4.0,
            score: 1.0,
        };
        let strip = outline(&grid, &map, &grid.inside(), &rough, width_limits(&grid, 5.0)).unwrap();
        let found = grid.place(strip.end);
        assert!((found.x - end).abs() < 2.0, "{found}: rows are means over half a width");
        let [first, second] =
            strip.borders.map(|border| border.map(|at| grid.place(crate::vision::space::Normalised(at))));
        for at in first.into_iter().chain(second) {
            let off =
                [-1.0, 1.0].map(|sign| (at.y - border(at.x, sign)).abs()).into_iter().fold(f64::INFINITY, f64::min);
            assert!(off < 0.6, "{at} is {off} off");
        }
        assert!(strip.is_believable());
    }
}
