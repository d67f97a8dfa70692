//! Says which corners of a board that was not found whole were not seen.
//!
//! In: a lattice that is no whole board. Out: the lattice without corners that cannot be the board's, completed as far
//! as the picture shows corners, and the cells that stay empty. A highlight or a finger shows crossings of its own, and
//! splits a grid in two; the search for a whole board then stops early, because it takes no row that is not complete.

use std::collections::BTreeMap;

use nalgebra::{Point2, Vector2};

use super::{Bounds, Cell, Corner, Grey, Lattice};
use crate::vision::space::Pixel;

/// A larger share of corners that do not fit the others means that the lattice shows no board.
const MAX_FALSE_SHARE: f64 = 0.3;

/// A corner that was not seen, although corners around it were.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::vision::camera::checkerboard) struct MissingCorner {
    /// Row in the picture, from 1 at the top.
    pub row: usize,
    /// Column in the picture, from 1 at the left.
    pub column: usize,
    /// Where its neighbours expect it.
    pub expected: Option<Pixel>,
}

impl Lattice {
    /// The lattice without corners that do not fit the others; `None` if these are too many for a board.
    pub fn without_false_corners(mut self) -> Option<Self> {
        let count = self.count();
        let even = self.corners.iter().filter(|(cell, corner)| is_bright_at_even(**cell, corner)).count();
        let most_are_even = 2 * even >= count;
        self.corners.retain(|cell, corner| is_bright_at_even(*cell, corner) == most_are_even);
        while let Some(worst) = self.least_smooth() {
            self.corners.remove(&worst);
        }
        self.drop_sparse_sides();
        (self.count() as f64 >= (1.0 - MAX_FALSE_SHARE) * count as f64).then_some(self)
    }

    /// The lattice with rows and columns that the picture shows at least half, up to a board's size.
    pub fn completed(mut self, picture: &Grey, columns: usize, rows: usize) -> Self {
        for _ in 0..columns + rows {
            let mut filled = self.clone();
            filled.fill(picture);
            self = filled.without_false_corners().unwrap_or(self);
            let Some(line) = self.half_seen_side(picture, columns, rows) else { break };
            self.corners.extend(line);
        }
        self
    }

    /// The cells of the spanned rectangle without a corner, by row and column as they lie in the picture.
    pub fn missing(&self) -> Vec<MissingCorner> {
        let Some(bounds) = self.bounds() else { return Vec::new() };
        let place = self.place_in_picture(bounds);
        let missing = |cell: Cell| {
            let (column, row) = place(cell);
            MissingCorner { row, column, expected: self.predict(cell).map(Pixel) }
        };
        let mut missing: Vec<_> = bounds.cells().filter(|cell| !self.corners.contains_key(cell)).map(missing).collect();
        missing.sort_by_key(|corner| (corner.row, corner.column));
        missing
    }

    /// Whether the corners next to the spanned rectangle, if there were any, would lie inside a picture of this size.
    pub fn has_space_around(&self, width: usize, height: usize) -> bool {
        let mut sides = self.bounds().into_iter().flat_map(|bounds| bounds.sides(1)).flatten();
        sides.all(|cell| self.predict(cell).is_some_and(|at| is_inside(at, width, height)))
    }

    /// The corner that most rows and columns would lie smoothly without.
    fn least_smooth(&self) -> Option<Cell> {
        let mut blame = BTreeMap::<Cell, usize>::new();
        for cell in self.bent_fours().flatten() {
            *blame.entry(cell).or_default() += 1;
        }
        blame.into_iter().max_by_key(|(_, fours)| *fours).map(|(cell, _)| cell)
    }

    /// The corners seen of a row or column next to the spanned rectangle, if they are at least half of it.
    fn half_seen_side(&self, picture: &Grey, columns: usize, rows: usize) -> Option<Vec<(Cell, Corner)>> {
        let bounds = self.bounds()?;
        let (wide, high) = bounds.size();
        let fits = |wide: usize, high: usize| wide <= columns && high <= rows || wide <= rows && high <= columns;
        let sides = bounds.sides(1).into_iter().enumerate();
        sides.filter(|(side, _)| if *side < 2 { fits(wide + 1, high) } else { fits(wide, high + 1) }).find_map(
            |(_, line)| {
                let corner = |&cell: &Cell| {
                    let place = self.place(cell)?;
                    let corner = Corner::fit(picture, &place).filter(Corner::is_crossing)?;
                    Some((cell, corner))
                };
                let seen: Vec<_> = line.iter().filter_map(corner).collect();
                let mut tried = self.clone();
                tried.corners.extend(seen.iter().cloned());
                let fitting = tried.without_false_corners()?;
                let seen: Vec<_> = seen.into_iter().filter(|(cell, _)| fitting.corners.contains_key(cell)).collect();
                (2 * seen.len() >= line.len()).then_some(seen)
            },
        )
    }

    /// Column and row of a cell, from 1, counted from the rectangle's corner at the top left of the picture.
    fn place_in_picture(&self, bounds: Bounds) -> impl Fn(Cell) -> (usize, usize) {
        let mean_step = |(dc, dr): Cell| {
            let step =
                |(&(column, row), corner): (&Cell, &Corner)| Some(self.position((column + dc, row + dr))? - corner.at);
            self.corners.iter().filter_map(step).sum::<Vector2<f64>>()
        };
        let (along, down) = (mean_step((1, 0)).x, mean_step((0, 1)).x);
        let (first, last) = (bounds.first, bounds.last);
        move |(column, row): Cell| {
            // The direction along a column lies clockwise of the direction along a row, so four turns are possible.
            let (column, row) = match along.abs() >= down.abs() {
                true if along > 0.0 => (column - first.0, row - first.1),
                true => (last.0 - column, last.1 - row),
                false if down > 0.0 => (row - first.1, last.0 - column),
                false => (last.1 - row, column - first.0),
            };
            (column as usize + 1, row as usize + 1)
        }
    }
}

/// Whether the square ahead of a corner is bright where column and row add up to an even number.
pub(super) fn is_bright_at_even((column, row): Cell, corner: &Corner) -> bool {
    ((column + row) % 2 == 0) == corner.is_bright_ahead()
}

fn is_inside(at: Point2<f64>, width: usize, height: usize) -> bool {
    (0.0..width as f64 - 1.0).contains(&at.x) && (0.0..height as f64 - 1.0).contains(&at.y)
}
