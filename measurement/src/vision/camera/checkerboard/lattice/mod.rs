//! A grid of measured corners: holes are filled, rows are added where the picture shows them, doubtful rows are
//! removed.
//!
//! In: a rough [`Grid`] and the full picture. Out: a full rectangle of corners, or the part that was seen. A corner
//! that the rough grid lacks is predicted from its neighbours, and counts only if the pixels show a crossing there; no
//! corner is ever interpolated.

mod diagnosis;

use diagnosis::is_bright_at_even;

pub(super) use diagnosis::MissingCorner;

use std::collections::BTreeMap;

use nalgebra::{Point2, Vector2};

use super::corner::{Corner, CornerGuess};
use super::grey::Grey;
use super::grid::Grid;
use crate::vision::space::Pixel;

type Cell = (i32, i32);

/// Corners measured in the full picture, by column and row.
#[derive(Clone)]
pub(super) struct Lattice {
    corners: BTreeMap<Cell, Corner>,
}

/// The cells that a lattice spans, first and last included.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Bounds {
    first: Cell,
    last: Cell,
}

impl Bounds {
    fn size(&self) -> (usize, usize) {
        ((self.last.0 - self.first.0 + 1) as usize, (self.last.1 - self.first.1 + 1) as usize)
    }

    fn cells(self) -> impl Iterator<Item = Cell> {
        (self.first.1..=self.last.1).flat_map(move |row| (self.first.0..=self.last.0).map(move |column| (column, row)))
    }

    /// The cells of the four outermost rows and columns, moved outwards by `outwards`.
    fn sides(self, outwards: i32) -> [Vec<Cell>; 4] {
        let (columns, rows) = (self.first.0..=self.last.0, self.first.1..=self.last.1);
        [
            rows.clone().map(|row| (self.first.0 - outwards, row)).collect(),
            rows.map(|row| (self.last.0 + outwards, row)).collect(),
            columns.clone().map(|column| (column, self.first.1 - outwards)).collect(),
            columns.map(|column| (column, self.last.1 + outwards)).collect(),
        ]
    }
}

impl Lattice {
    /// Measures every corner of a rough grid, then adds the corners that can be seen, up to `most` along a side.
    pub fn measure(picture: &Grey, rough: &Grid, most: usize) -> Self {
        let mut lattice = Self { corners: BTreeMap::new() };
        for (&cell, &at) in &rough.corners {
            let steps = [(1, 0), (0, 1)].map(|axis| step(|c| rough.corners.get(&c).copied(), cell, axis));
            if let [Some(row), Some(column)] = steps {
                lattice.try_place(picture, cell, &CornerGuess { at, steps: [row, column] });
            }
        }
        for _ in 0..2 * most {
            lattice.drop_sparse_sides();
            if !(lattice.fill(picture) | lattice.extend(picture, most)) {
                break;
            }
        }
        lattice
    }

    /// Columns and rows spanned.
    pub fn size(&self) -> (usize, usize) {
        self.bounds().map_or((0, 0), |b| b.size())
    }

    /// Corners measured.
    pub fn count(&self) -> usize {
        self.corners.len()
    }

    /// Whether every cell of the spanned rectangle holds a corner.
    pub fn is_full(&self) -> bool {
        let (columns, rows) = self.size();
        self.count() == columns * rows
    }

    /// Median blur, in squares: how much of a square an edge takes up.
    pub fn blur_in_squares(&self) -> f64 {
        let ratio = |(&cell, corner): (&Cell, &Corner)| Some(corner.blur_px / self.place(cell)?.square_px());
        median(self.corners.iter().filter_map(ratio).collect())
    }

    /// Whether the corners lie as smoothly as perspective and distortion allow: third differences along rows and
    /// columns are small against a square.
    pub fn is_smooth(&self) -> bool {
        self.bent_fours().next().is_none()
    }

    /// Four neighbours in a row or column that do not lie smoothly.
    fn bent_fours(&self) -> impl Iterator<Item = [Cell; 4]> {
        let axes = [(1, 0), (0, 1)];
        let fours = self
            .corners
            .keys()
            .flat_map(move |&(column, row)| axes.map(|(dc, dr)| [0, 1, 2, 3].map(|k| (column + k * dc, row + k * dr))));
        fours.filter(|four| {
            let [Some(a), Some(b), Some(c), Some(d)] = four.map(|cell| self.position(cell)) else { return false };
            let third = (d - a) - (c - b) * 3.0;
            third.norm() >= 0.15 * (c - b).norm() + 1.0
        })
    }

    /// Whether dark and bright squares alternate over the whole lattice.
    pub fn alternates(&self) -> bool {
        let even = self.corners.iter().filter(|(cell, corner)| is_bright_at_even(**cell, corner)).count();
        even == 0 || even == self.count()
    }

    /// The corners row by row, turned so that a row holds `columns` corners; `None` if the size differs.
    pub fn in_order(&self, columns: usize, rows: usize) -> Option<Vec<Point2<f64>>> {
        let bounds = self.bounds().filter(|_| self.is_full())?;
        let (last_column, first_row) = (bounds.last.0, bounds.first.1);
        let quarter = |(column, row): Cell| (last_column - row, first_row + column); // a rotation, not a mirror image
        let upright = |(column, row): Cell| (bounds.first.0 + column, first_row + row);
        let turn = |turned: bool| {
            let cells = (0..rows as i32).flat_map(|row| (0..columns as i32).map(move |column| (column, row)));
            cells.map(|cell| self.position(if turned { quarter(cell) } else { upright(cell) })).collect()
        };
        match bounds.size() {
            size if size == (columns, rows) => turn(false),
            size if size == (rows, columns) => turn(true),
            _ => None,
        }
    }

    /// Every corner, in no order.
    pub fn positions(&self) -> Vec<Pixel> {
        self.corners.values().map(|corner| Pixel(corner.at)).collect()
    }

    fn bounds(&self) -> Option<Bounds> {
        let cells = || self.corners.keys();
        let first = (cells().map(|c| c.0).min()?, cells().map(|c| c.1).min()?);
        let last = (cells().map(|c| c.0).max()?, cells().map(|c| c.1).max()?);
        Some(Bounds { first, last })
    }

    fn position(&self, cell: Cell) -> Option<Point2<f64>> {
        self.corners.get(&cell).map(|c| c.at)
    }

    /// The measured or predicted position of a cell's corner.
    fn place(&self, cell: Cell) -> Option<CornerGuess> {
        let get = |c: Cell| self.position(c);
        let steps = [step(get, cell, (1, 0))?, step(get, cell, (0, 1))?];
        let at = get(cell).or_else(|| self.predict(cell))?;
        Some(CornerGuess { at, steps })
    }

    /// Predicts a missing corner from its row and column: between two neighbours, or beyond two or three.
    fn predict(&self, (column, row): Cell) -> Option<Point2<f64>> {
        let at = |(dc, dr): Cell, k: i32| self.position((column + k * dc, row + k * dr)).map(|p| p.coords);
        let between = [(1, 0), (0, 1)].map(|axis| Some((at(axis, 1)? + at(axis, -1)?) / 2.0));
        let beyond = [(1, 0), (-1, 0), (0, 1), (0, -1)].map(|axis| {
            let (near, far) = (at(axis, 1)?, at(axis, 2)?);
            Some(at(axis, 3).map_or(near * 2.0 - far, |farthest| (near - far) * 3.0 + farthest))
        });
        let found = between.into_iter().flatten().chain(beyond.into_iter().flatten());
        let (count, sum) = found.fold((0, Vector2::zeros()), |(n, sum), p: Vector2<f64>| (n + 1, sum + p));
        (count > 0).then(|| Point2::from(sum / f64::from(count)))
    }

    fn try_place(&mut self, picture: &Grey, cell: Cell, place: &CornerGuess) -> bool {
        let corner = Corner::fit(picture, place).filter(Corner::is_crossing);
        let found = corner.is_some();
        self.corners.extend(corner.map(|c| (cell, c)));
        found
    }

    /// Removes outermost rows and columns that are less than half full, repeatedly: they are clutter that happened to
    /// fit.
    fn drop_sparse_sides(&mut self) {
        while let Some(bounds) = self.bounds() {
            let sparse = bounds
                .sides(0)
                .into_iter()
                .find(|side| 2 * side.iter().filter(|c| self.corners.contains_key(c)).count() < side.len());
            let Some(side) = sparse else { break };
            self.corners.retain(|cell, _| !side.contains(cell));
        }
    }

    fn fill(&mut self, picture: &Grey) -> bool {
        let missing = self.bounds().into_iter().flat_map(Bounds::cells).filter(|c| !self.corners.contains_key(c));
        let missing: Vec<_> = missing.collect();
        let mut grew = false;
        for cell in missing {
            if let Some(place) = self.place(cell) {
                grew |= self.try_place(picture, cell, &place);
            }
        }
        grew
    }

    /// Adds a row or column on every side where the picture shows all its corners.
    fn extend(&mut self, picture: &Grey, most: usize) -> bool {
        let mut grew = false;
        for side in 0..4 {
            let Some(bounds) = self.bounds() else { break };
            let (columns, rows) = bounds.size();
            if columns.max(rows) >= most {
                break;
            }
            let line = &bounds.sides(1)[side];
            let corner = |&cell: &Cell| {
                let corner = Corner::fit(picture, &self.place(cell)?).filter(Corner::is_crossing)?;
                Some((cell, corner))
            };
            if let Some(found) = line.iter().map(corner).collect::<Option<Vec<_>>>() {
                self.corners.extend(found);
                grew = true;
            }
        }
        grew
    }
}

/// The step from a corner to the next along an axis, from pairs of known corners nearby; the nearest rows come first.
fn step(at: impl Fn(Cell) -> Option<Point2<f64>>, (column, row): Cell, (dc, dr): Cell) -> Option<Vector2<f64>> {
    [0, 1, -1, 2, -2].into_iter().find_map(|aside| {
        let pair = |k: i32| {
            let from = (column + k * dc + aside * dr, row + k * dr + aside * dc);
            Some(at((from.0 + dc, from.1 + dr))? - at(from)?)
        };
        let near: Vec<_> = [-1, 0].into_iter().filter_map(pair).collect();
        let steps = if near.is_empty() { [-2, 1].into_iter().filter_map(pair).collect() } else { near };
        (!steps.is_empty()).then(|| steps.iter().sum::<Vector2<f64>>() / steps.len() as f64)
    })
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
