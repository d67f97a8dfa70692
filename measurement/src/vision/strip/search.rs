//! Search: straight strips from the picture's rim, over direction, offset, width and end.
//!
//! **In** the evidence of each cell. **Out** rough strips, the best first. **Method** For each direction the evidence is
//! turned so that strips are rows. A row's score at each place is the evidence inside the strip's width, less what
//! speaks for a shaft beside it: a dark area has no strip in it. Scores add up from the rim on; the strip ends where
//! their sum is largest.

use nalgebra::{Point2, Vector2, Vector3};

use super::grid::{GridMap, UndistortedGrid};
use super::{DISTANCES_MM, plane_through};
use crate::vision::space::HandSide;

/// Step between directions, degrees: it moves the end of a strip of twelve widths by a fifth of a width only.
const STEP_DEG: f64 = 2.0;
/// Directions on both sides of the horizontal, from the hand's side, degrees.
const REACH_DEG: f64 = 95.0;
/// Ratio of successive widths: the nearest is wrong by at most a fifth, which the outline then corrects.
const WIDTH_RATIO: f64 = 1.45;
/// Smallest width, cells of half resolution.
const MIN_WIDTH: f64 = 1.5;
/// Strips kept for each direction and width.
const KEPT_OF_EACH: usize = 3;
/// Two strips are one if their directions differ by less than this (cosine of 12°) and their middles by less than
/// their width.
const SAME_DIRECTION: f64 = 0.978;
/// A strip begins in this part of the picture's width, from the hand's side: half, and 10 % for a trocar near the middle.
const OWN_SIDE: f64 = 0.6;

/// A rough strip on the full grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughStrip {
    /// A point of its middle line.
    pub point: Point2<f64>,
    /// Unit vector from the rim to its end.
    pub direction: Vector2<f64>,
    /// Width, cells.
    pub width: f64,
    /// Its end: distance from `point` along `direction`, cells.
    pub end: f64,
    /// Sum of the evidence, divided by the root of the width.
    pub score: f64,
}

/// What limits a search.
#[derive(Clone, Copy)]
pub struct SearchLimits {
    /// The side of the picture where the hand is; `None`: both.
    pub side: Option<HandSide>,
    /// The tube's diameter, mm.
    pub diameter_mm: f64,
    /// The point of the picture through which strips pass, as a direction from the camera, and the largest sine of the
    /// angle between it and a strip's plane.
    pub trocar: Option<(Vector3<f64>, f64)>,
}

/// One candidate, on the turned grid.
#[derive(Clone, Copy)]
struct TurnedStrip {
    score: f32,
    angle: f64,
    row: usize,
    width: f64,
    end: usize,
}

/// Searches the evidence, at half the grid's resolution, for the best `count` different strips.
pub fn search(grid: &UndistortedGrid, evidence: &GridMap, limits: &SearchLimits, count: usize) -> Vec<RoughStrip> {
    let half = evidence.halved();
    let side = (half.columns as f64).hypot(half.rows as f64) as usize + 2;
    let turned = Turned { grid, half: &half, side };
    let mut found: Vec<TurnedStrip> = Vec::new();
    for angle in angles(limits.side) {
        turned.search_direction(angle, limits, &mut found);
    }
    found.sort_by(|one, other| other.score.total_cmp(&one.score));
    let mut kept: Vec<(TurnedStrip, Point2<f64>)> = Vec::new();
    for candidate in found {
        if kept.len() == count {
            break;
        }
        let Some((entry, middle)) = turned.ends(&candidate) else { continue };
        let is_new = kept.iter().all(|(other, at)| !is_same(&candidate, middle, other, *at));
        if is_new && is_on_side(grid.pixel(entry).u() / grid.picture_width_px(), limits.side) {
            kept.push((candidate, middle));
        }
    }
    kept.iter().map(|(candidate, _)| turned.rough_strip(candidate)).collect()
}

/// The widths that a tube of this diameter can have, cells of half resolution.
fn widths(grid: &UndistortedGrid, diameter_mm: f64) -> Vec<f64> {
    let (narrow, wide) = width_limits(grid, diameter_mm);
    let widths = std::iter::successors(Some((0.5 * narrow).max(MIN_WIDTH)), |width| Some(width * WIDTH_RATIO));
    let mut all: Vec<f64> = widths.clone().take_while(|width| *width < 0.5 * wide).collect();
    all.extend(widths.skip(all.len()).take(1));
    all
}

/// The smallest and the largest width of a tube of this diameter, cells of the grid.
pub fn width_limits(grid: &UndistortedGrid, diameter_mm: f64) -> (f64, f64) {
    let (near, far) = DISTANCES_MM;
    (diameter_mm / far / grid.pitch, diameter_mm / near / grid.pitch)
}

/// The directions that a tool of this side can have, radians.
fn angles(side: Option<HandSide>) -> impl Iterator<Item = f64> {
    let (middle, reach) = match side {
        Some(HandSide::Left) => (0.0, REACH_DEG),
        Some(HandSide::Right) => (180.0, REACH_DEG),
        None => (0.0, 180.0),
    };
    let steps = (2.0 * reach / STEP_DEG) as usize;
    (0..=steps).map(move |step| f64::to_radians(middle - reach + step as f64 * STEP_DEG))
}

/// May a strip of this side begin at this part of the picture's width?
fn is_on_side(part: f64, side: Option<HandSide>) -> bool {
    match side {
        Some(HandSide::Left) => part < OWN_SIDE,
        Some(HandSide::Right) => part > 1.0 - OWN_SIDE,
        None => true,
    }
}

fn direction(angle: f64) -> Vector2<f64> {
    Vector2::new(angle.cos(), angle.sin())
}

fn across(direction: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-direction.y, direction.x)
}

fn is_same(one: &TurnedStrip, middle: Point2<f64>, other: &TurnedStrip, at: Point2<f64>) -> bool {
    /// Middles nearer than this are one strip, cells of half resolution, however narrow.
    const MIN_APART: f64 = 3.0;
    let along = direction(other.angle);
    direction(one.angle).dot(&along) > SAME_DIRECTION
        && (middle - at).dot(&across(along)).abs() < one.width.max(other.width).max(MIN_APART)
}

/// The evidence at half resolution, to be read along rows of any direction.
struct Turned<'a> {
    grid: &'a UndistortedGrid,
    half: &'a GridMap,
    /// Columns and rows of the turned square: the picture's diagonal.
    side: usize,
}

impl Turned<'_> {
    fn centre(&self) -> Point2<f64> {
        Point2::new(0.5 * (self.half.columns as f64 - 1.0), 0.5 * (self.half.rows as f64 - 1.0))
    }

    /// The point of half resolution at a column and row of the turned square.
    fn place(&self, angle: f64, column: f64, row: f64) -> Point2<f64> {
        let along = direction(angle);
        let middle = 0.5 * self.side as f64;
        self.centre() + along * (column - middle) + across(along) * (row - middle)
    }

    /// A point of half resolution on the full grid.
    fn on_full_grid(at: Point2<f64>) -> Point2<f64> {
        Point2::from(at.coords * 2.0 + Vector2::repeat(0.5))
    }

    /// The part of the turned square that the picture covers along a direction: first place, behind the last. `along` is
    /// the picture's size along the square's side at angle 0.
    fn extent(&self, along: usize, across: usize, angle: f64) -> (usize, usize) {
        let half = 0.5 * (angle.cos().abs() * along as f64 + angle.sin().abs() * across as f64);
        let middle = 0.5 * self.side as f64;
        ((middle - half).max(0.0) as usize, ((middle + half).ceil() as usize + 1).min(self.side))
    }

    /// The rows whose strips may pass through the trocar: first, behind the last.
    fn rows(&self, angle: f64, limits: &SearchLimits) -> (usize, usize) {
        let (first, end) = self.extent(self.half.rows, self.half.columns, angle);
        let Some((trocar, within)) = limits.trocar else { return (first, end) };
        const APART: f64 = 60.0;
        let passes = |row: usize| {
            let at = |column: f64| self.grid.normalised(Self::on_full_grid(self.place(angle, column, row as f64)));
            let middle = 0.5 * self.side as f64;
            plane_through(at(middle), at(middle + APART)).dot(&trocar).abs() < within
        };
        let Some(first) = (first..end).find(|row| passes(*row)) else { return (0, 0) };
        let last = (first..end).rev().find(|row| passes(*row)).unwrap_or(first);
        (first, last + 1)
    }

    /// Adds the best strips of one direction.
    fn search_direction(&self, angle: f64, limits: &SearchLimits, found: &mut Vec<TurnedStrip>) {
        let (first, end) = self.rows(angle, limits);
        if first >= end {
            return;
        }
        let widths = widths(self.grid, limits.diameter_mm);
        let margin = widths.last().map_or(0.0, |width| width + 2.0).ceil() as usize;
        let rows = RowSums::new(self, angle, first.saturating_sub(margin), (end + margin).min(self.side));
        let mut scores = Vec::new();
        for width in widths {
            let mut best = [TurnedStrip { score: 0.0, angle, row: 0, width, end: 0 }; KEPT_OF_EACH];
            for row in first..end {
                let (score, end) = rows.best_end(row, width, &mut scores);
                let worst = best.iter_mut().min_by(|one, other| one.score.total_cmp(&other.score));
                if let Some(worst) = worst.filter(|worst| score > worst.score) {
                    *worst = TurnedStrip { score, angle, row, width, end };
                }
            }
            found.extend(best.into_iter().filter(|candidate| candidate.score > 0.0));
        }
    }

    /// Where a candidate enters the picture, on the full grid, and its middle, at half resolution.
    fn ends(&self, candidate: &TurnedStrip) -> Option<(Point2<f64>, Point2<f64>)> {
        let at = |column: usize| self.place(candidate.angle, column as f64, candidate.row as f64);
        let first = (0..=candidate.end).find(|column| self.grid.is_inside(Self::on_full_grid(at(*column))))?;
        Some((Self::on_full_grid(at(first)), nalgebra::center(&at(first), &at(candidate.end))))
    }

    fn rough_strip(&self, candidate: &TurnedStrip) -> RoughStrip {
        let TurnedStrip { score, angle, row, width, end } = *candidate;
        let middle = 0.5 * self.side as f64;
        RoughStrip {
            point: Self::on_full_grid(self.place(angle, middle, row as f64)),
            direction: direction(angle),
            width: 2.0 * width,
            end: 2.0 * (end as f64 - middle),
            score: f64::from(score),
        }
    }
}

/// Sums over the rows of the turned evidence: of all values, and of the positive ones.
struct RowSums {
    first: usize,
    first_column: usize,
    columns: usize,
    all: Vec<f32>,
    positive: Vec<f32>,
}

impl RowSums {
    fn new(turned: &Turned<'_>, angle: f64, first: usize, end: usize) -> Self {
        let (first_column, end_column) = turned.extent(turned.half.columns, turned.half.rows, angle);
        let columns = end_column - first_column;
        let (mut all, mut positive) = (vec![0.0; columns], vec![0.0; columns]);
        let [step_x, step_y] = <[f64; 2]>::from(direction(angle)).map(|step| step as f32);
        for row in first..end {
            let start = turned.place(angle, first_column as f64, row as f64);
            let (start_x, start_y) = (start.x as f32, start.y as f32);
            let before = all.len() - columns;
            for column in 0..columns {
                let value = turned.half.at(start_x + step_x * column as f32, start_y + step_y * column as f32);
                all.push(all[before + column] + value);
                positive.push(positive[before + column] + value.max(0.0));
            }
        }
        Self { first, first_column, columns, all, positive }
    }

    /// The largest sum of scores from the rim on, divided by the root of the width, and the column where it ends. `scores`
    /// is memory for one row.
    fn best_end(&self, row: usize, width: f64, scores: &mut Vec<f32>) -> (f32, usize) {
        let middle = (row - self.first) as f64 + 0.5;
        let flank = (0.5 * width).max(1.0);
        let (low, high) = (middle - 0.5 * width, middle + 0.5 * width);
        scores.clear();
        scores.resize(self.columns, 0.0);
        self.add_row(&self.all, high, 1.0, scores);
        self.add_row(&self.all, low, -1.0, scores);
        self.add_row(&self.positive, low, -1.0, scores);
        self.add_row(&self.positive, low - flank, 1.0, scores);
        self.add_row(&self.positive, high + flank, -1.0, scores);
        self.add_row(&self.positive, high, 1.0, scores);
        let (mut sum, mut best, mut end) = (0.0f32, 0.0f32, 0);
        for (column, score) in scores.iter().enumerate() {
            sum += score;
            if sum > best {
                (best, end) = (sum, column);
            }
        }
        (best / (width as f32).sqrt(), self.first_column + end)
    }

    /// Adds a row of sums, between two rows of the turned evidence, times a factor.
    fn add_row(&self, sums: &[f32], at: f64, factor: f32, into: &mut [f32]) {
        let (first, share) = self.between(at);
        let (above, below) = sums[first..first + 2 * self.columns].split_at(self.columns);
        add_weighted(into, [above, below], [factor * (1.0 - share), factor * share]);
    }

    /// Beginning of the sums before a place, and the share of those after it.
    fn between(&self, at: f64) -> (usize, f32) {
        let rows = self.all.len() / self.columns;
        let at = at.clamp(0.0, rows as f64 - 1.001);
        let row = at as usize;
        (row * self.columns, (at - row as f64) as f32)
    }
}

/// Adds two rows, each times its factor.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn add_weighted(into: &mut [f32], [one, other]: [&[f32]; 2], factors: [f32; 2]) {
    for ((into, one), other) in into.iter_mut().zip(one).zip(other) {
        *into += one * factors[0] + other * factors[1];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::camera::testing::STRAIGHT;

    /// Evidence of a strip from the left rim to an end, on a picture that speaks against a shaft elsewhere.
    fn evidence(grid: &UndistortedGrid, strip: &RoughStrip) -> GridMap {
        let value = |i: usize| {
            let at = Point2::new((i % grid.columns) as f64, (i / grid.columns) as f64) - strip.point;
            let inside =
                at.dot(&across(strip.direction)).abs() < 0.5 * strip.width && at.dot(&strip.direction) < strip.end;
            if inside { 2.0 } else { -2.0 }
        };
        let values = (0..grid.columns * grid.rows).map(value).collect();
        GridMap { columns: grid.columns, rows: grid.rows, values }
    }

    #[test]
    fn a_strip_is_found_with_its_direction_and_end() {
        let grid = UndistortedGrid::new(&STRAIGHT).unwrap();
        let (narrow, wide) = width_limits(&grid, 5.0);
        let drawn = RoughStrip {
            point: Point2::new(0.4 * grid.columns as f64, 0.5 * grid.rows as f64),
            direction: direction(0.3),
            width: (narrow * wide).sqrt(),
            end: 10.0,
            score: 0.0,
        };
        let limits = SearchLimits { side: Some(HandSide::Left), diameter_mm: 5.0, trocar: None };
        let found = search(&grid, &evidence(&grid, &drawn), &limits, 1)[0];
        let end = |strip: &RoughStrip| strip.point + strip.direction * strip.end;
        assert!(found.direction.angle(&drawn.direction) < STEP_DEG.to_radians(), "{found:?}");
        assert!((end(&found) - end(&drawn)).norm() < drawn.width, "{found:?}");
        assert!((found.width / drawn.width).ln().abs() < WIDTH_RATIO.ln(), "{found:?}");
    }

    #[test]
    fn an_even_dark_area_holds_no_strip() {
        let grid = UndistortedGrid::new(&STRAIGHT).unwrap();
        let map = GridMap { columns: grid.columns, rows: grid.rows, values: vec![2.0; grid.columns * grid.rows] };
        let limits = SearchLimits { side: Some(HandSide::Left), diameter_mm: 5.0, trocar: None };
        let rim = search(&grid, &map, &limits, 1);
        let inside = rim.iter().filter(|strip| {
            let end = strip.point + strip.direction * strip.end;
            grid.is_inside(end + across(strip.direction) * 3.0 * strip.width)
                && grid.is_inside(end - across(strip.direction) * 3.0 * strip.width)
        });
        assert_eq!(inside.count(), 0);
    }
}
