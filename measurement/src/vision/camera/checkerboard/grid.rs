//! Joins single crossings to a grid by topology alone: it uses no homography, so distortion does not matter.
//!
//! In: crossings. Out: connected grids, each crossing with its column and row. Method: from every crossing the nearest
//! fitting one is searched along each of its four half edges; a link counts if both ends choose each other.
//! Neighbouring corners of a checkerboard have their dark and bright sectors swapped, so a link joins a rising edge to
//! a falling edge; this rule alone rejects most false neighbours. A walk over the links then gives columns and rows at
//! any rotation of the board.

use std::collections::{BTreeMap, VecDeque};
use std::f64::consts::{PI, TAU};

use nalgebra::Point2;

use super::crossing::Crossing;

/// Maximum angle between a half edge's direction and its neighbour, radians: the edge bends under distortion, and its
/// direction was measured on a small ring.
const MAX_OFF_RAY: f64 = 0.3;

/// Corners by column and row. In the picture (x right, y down), the direction along a column lies clockwise of the
/// direction along a row.
#[derive(Clone, Debug, Default)]
pub(super) struct Grid {
    pub corners: BTreeMap<(i32, i32), Point2<f64>>,
}

/// Grids of at least four corners, the largest first.
pub(super) fn connect(crossings: &[Crossing]) -> Vec<Grid> {
    let links = mutual_links(&chosen_neighbours(crossings));
    let mut taken = vec![false; crossings.len()];
    let mut grids: Vec<Grid> = Vec::new();
    for seed in 0..crossings.len() {
        if !taken[seed] {
            grids.push(grid_from_seed(seed, crossings, &links, &mut taken));
        }
    }
    grids.retain(|grid| grid.corners.len() >= 4);
    grids.sort_by_key(|grid| std::cmp::Reverse(grid.corners.len()));
    grids
}

/// For every crossing and half edge: the nearest crossing that could be its neighbour, and the half edge of that
/// neighbour.
type Links = Vec<[Option<(usize, usize)>; 4]>;

fn chosen_neighbours(crossings: &[Crossing]) -> Links {
    crossings.iter().map(|own| std::array::from_fn(|slot| nearest_along(own, slot, crossings))).collect()
}

fn nearest_along(own: &Crossing, slot: usize, crossings: &[Crossing]) -> Option<(usize, usize)> {
    let mut nearest = (f64::INFINITY, None);
    let (sin, cos) = own.rays[slot].sin_cos();
    for (index, other) in crossings.iter().enumerate() {
        let way = other.at - own.at;
        let ahead = way.x * cos + way.y * sin;
        let aside = way.y * cos - way.x * sin;
        if ahead <= 0.0 || aside.abs() > MAX_OFF_RAY * ahead || way.norm_squared() >= nearest.0 {
            continue;
        }
        let back = way.y.atan2(way.x) + PI;
        let fits = |&s: &usize| other.rises(s) != own.rises(slot) && angle_between(other.rays[s], back) < MAX_OFF_RAY;
        if let Some(met_by) = (0..4).find(fits) {
            nearest = (way.norm_squared(), Some((index, met_by)));
        }
    }
    nearest.1
}

/// Smallest difference between two directions, radians.
fn angle_between(a: f64, b: f64) -> f64 {
    let difference = (a - b).rem_euclid(TAU);
    difference.min(TAU - difference)
}

fn mutual_links(chosen: &Links) -> Links {
    let agreed = |own: usize, slot: usize| {
        chosen[own][slot].filter(|&(other, met_by)| chosen[other][met_by] == Some((own, slot)))
    };
    (0..chosen.len()).map(|own| std::array::from_fn(|slot| agreed(own, slot))).collect()
}

/// Follows all links from a seed. A crossing's half edge `slot` points to grid direction `slot − turn` (0: next column,
/// 1: next row, 2: previous column, 3: previous row).
fn grid_from_seed(seed: usize, crossings: &[Crossing], links: &Links, taken: &mut [bool]) -> Grid {
    let mut grid = Grid::default();
    let mut queue = VecDeque::from([(seed, (0, 0), 0)]);
    taken[seed] = true;
    grid.corners.insert((0, 0), crossings[seed].at);
    while let Some((own, (column, row), turn)) = queue.pop_front() {
        for direction in 0..4 {
            let Some((next, met_by)) = links[own][(direction + turn) % 4] else { continue };
            let cell = match direction {
                0 => (column + 1, row),
                1 => (column, row + 1),
                2 => (column - 1, row),
                _ => (column, row - 1),
            };
            // A second crossing for a cell, or a second cell for a crossing, is a contradiction: the first one stays.
            if taken[next] || grid.corners.contains_key(&cell) {
                continue;
            }
            taken[next] = true;
            grid.corners.insert(cell, crossings[next].at);
            queue.push_back((next, cell, (met_by + 4 - (direction + 2) % 4) % 4));
        }
    }
    grid
}

impl Grid {
    /// Converts positions found after `halvings` of a picture to that picture's pixels. Pixel centres, not pixel
    /// corners, have whole coordinates.
    pub fn scale_to_full_size(&mut self, halvings: usize) {
        let factor = f64::from(1_u32 << halvings.min(16));
        for at in self.corners.values_mut() {
            *at = Point2::from((at.coords.add_scalar(0.5) * factor).add_scalar(-0.5));
        }
    }
}
