//! The undistorted picture as a grid of cells. A tube's borders are straight in it for any lens.

use nalgebra::{Point2, Vector2};

use crate::vision::camera::Camera;
use crate::vision::segmentation::cells::{CellGrid, CellPicture};
use crate::vision::space::{Normalised, Pixel};

/// Values on a grid of columns and rows.
#[derive(Clone, Debug, Default)]
pub struct GridMap {
    /// Columns.
    pub columns: usize,
    /// Rows.
    pub rows: usize,
    /// Row by row.
    pub values: Vec<f32>,
}

impl GridMap {
    /// The value between four cells; 0 outside.
    #[inline]
    pub fn at(&self, x: f32, y: f32) -> f32 {
        if !(x >= 0.0 && y >= 0.0 && x < (self.columns - 1) as f32 && y < (self.rows - 1) as f32) {
            return 0.0;
        }
        let (column, row) = (x as u32, y as u32); // `floor` is a call
        let first = row as usize * self.columns + column as usize;
        let (x, y) = (x - column as f32, y - row as f32);
        let [upper, lower] = [first, first + self.columns].map(|i| self.values[i] * (1.0 - x) + self.values[i + 1] * x);
        upper * (1.0 - y) + lower * y
    }

    /// The map at half its resolution: means of 2 × 2 values.
    pub fn halved(&self) -> Self {
        let (columns, rows) = (self.columns / 2, self.rows / 2);
        let value = |column: usize, row: usize| {
            let first = 2 * row * self.columns + 2 * column;
            let four = [first, first + 1, first + self.columns, first + self.columns + 1];
            four.into_iter().map(|i| self.values[i]).sum::<f32>() / 4.0
        };
        let values = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
        Self { columns, rows, values: values.map(|(column, row)| value(column, row)).collect() }
    }
}

/// The grid of the undistorted picture.
#[derive(Clone)]
pub struct UndistortedGrid {
    camera: Camera,
    cells: CellGrid,
    /// Columns.
    pub columns: usize,
    /// Rows.
    pub rows: usize,
    /// Side of a cell, normalised.
    pub pitch: f64,
    origin: Vector2<f64>,
    /// Where each of its cells lies in the frame's cells: index of the upper left of four, and the shares of the right
    /// and the lower ones; `None` outside the picture.
    sources: Vec<Option<(u32, [f32; 2])>>,
}

impl UndistortedGrid {
    /// The grid for a camera's frames; `None` if the lens model has no direction for the picture's rim.
    pub fn new(camera: &Camera) -> Option<Self> {
        let cells = CellGrid::new(camera.width as usize, camera.height as usize);
        let (low, high) = bounds(camera)?;
        let pitch = cells.cell_px as f64 / camera.fx;
        let size = ((high - low) / pitch).map(f64::ceil);
        /// A lens that stretches the picture more is not undistorted as a whole.
        const MAX_STRETCH: f64 = 3.0;
        if size.x > MAX_STRETCH * cells.columns as f64 || size.y > MAX_STRETCH * cells.rows as f64 {
            return None;
        }
        let (columns, rows) = (size.x as usize, size.y as usize);
        let mut grid = Self { camera: *camera, cells, columns, rows, pitch, origin: low, sources: Vec::new() };
        let all = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
        grid.sources = all.map(|(column, row)| grid.source(column, row)).collect();
        Some(grid)
    }

    /// The normalised point at a place of the grid.
    pub fn normalised(&self, at: Point2<f64>) -> Normalised {
        Normalised(Point2::from(at.coords * self.pitch + self.origin))
    }

    /// The frame's pixel at a place of the grid.
    pub fn pixel(&self, at: Point2<f64>) -> Pixel {
        self.camera.pixel_of(self.normalised(at))
    }

    /// The place of the grid that shows a normalised point.
    pub fn place(&self, at: Normalised) -> Point2<f64> {
        Point2::from((at.0.coords - self.origin) / self.pitch)
    }

    /// Width of the frames, pixels.
    pub fn picture_width_px(&self) -> f64 {
        f64::from(self.camera.width)
    }

    /// Is this place inside the picture?
    pub fn is_inside(&self, at: Point2<f64>) -> bool {
        let [x, y] = [at.x.round(), at.y.round()];
        let on_grid = x >= 0.0 && y >= 0.0 && x < self.columns as f64 && y < self.rows as f64;
        on_grid && self.sources[y as usize * self.columns + x as usize].is_some()
    }

    /// Values of the frame's cells on this grid; 0 outside the picture.
    pub fn undistorted(&self, values: &[f32]) -> GridMap {
        let below = self.cells.columns;
        let value = |source: &Option<(u32, [f32; 2])>| {
            let Some((first, [x, y])) = *source else { return 0.0 };
            let first = first as usize;
            let [upper, lower] = [first, first + below].map(|i| values[i] * (1.0 - x) + values[i + 1] * x);
            upper * (1.0 - y) + lower * y
        };
        GridMap { columns: self.columns, rows: self.rows, values: self.sources.iter().map(value).collect() }
    }

    /// Codes of the frame's cells at a place of the grid; `None` outside the picture.
    pub fn codes(&self, cells: &CellPicture, at: Point2<f64>) -> Option<[f64; 3]> {
        let (first, [x, y]) = self.source_of(at)?;
        let first = first as usize;
        let mean = |one: f64, other: f64, share: f32| one + (other - one) * f64::from(share);
        let row = |first: usize, part: usize| {
            mean(f64::from(cells.codes[first][part]), f64::from(cells.codes[first + 1][part]), x)
        };
        Some(std::array::from_fn(|part| mean(row(first, part), row(first + self.cells.columns, part), y)))
    }

    /// 1 inside the picture, 0 outside.
    pub fn inside(&self) -> GridMap {
        let values = self.sources.iter().map(|source| if source.is_some() { 1.0 } else { 0.0 });
        GridMap { columns: self.columns, rows: self.rows, values: values.collect() }
    }

    fn source(&self, column: usize, row: usize) -> Option<(u32, [f32; 2])> {
        let at = Point2::new(column as f64, row as f64);
        // Beyond the fold of the lens model a direction has a pixel, too, but it is not the one that shows it.
        let back = self.camera.normalised_of(self.pixel(at))?;
        self.source_of(at).filter(|_| (self.place(back) - at).norm() < 0.5)
    }

    /// The four cells about a place: index of the upper left one, and the shares of the right and the lower ones.
    fn source_of(&self, at: Point2<f64>) -> Option<(u32, [f32; 2])> {
        let pixel = self.pixel(at);
        let half = 0.5 * (self.cells.cell_px as f64 - 1.0);
        let at = [pixel.u(), pixel.v()].map(|px| (px - half) / self.cells.cell_px as f64);
        let limits = [self.cells.columns, self.cells.rows].map(|count| count as f64 - 1.0);
        at.into_iter().zip(limits).all(|(at, limit)| at >= 0.0 && at < limit).then(|| {
            let [x, y] = at.map(|at| at as usize);
            let shares = [at[0] - x as f64, at[1] - y as f64].map(|share| share as f32);
            ((y * self.cells.columns + x) as u32, shares)
        })
    }
}

/// The smallest and the largest normalised coordinates of the picture's rim.
fn bounds(camera: &Camera) -> Option<(Vector2<f64>, Vector2<f64>)> {
    const POINTS: usize = 30;
    let (right, bottom) = (f64::from(camera.width) - 1.0, f64::from(camera.height) - 1.0);
    let mut low = Vector2::repeat(f64::INFINITY);
    let mut high = Vector2::repeat(f64::NEG_INFINITY);
    for i in 0..POINTS {
        let share = i as f64 / (POINTS - 1) as f64;
        let (u, v) = (share * right, share * bottom);
        for pixel in [Pixel::new(u, 0.0), Pixel::new(u, bottom), Pixel::new(0.0, v), Pixel::new(right, v)] {
            let at = camera.normalised_of(pixel)?.0.coords;
            (low, high) = (low.inf(&at), high.sup(&at));
        }
    }
    Some((low, high))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::camera::testing::wide;

    #[test]
    fn a_straight_line_in_space_is_straight_on_the_grid() {
        let camera = wide();
        let grid = UndistortedGrid::new(&camera).unwrap();
        let cells = CellGrid::new(camera.width as usize, camera.height as usize);
        // The frame's cells show x + 2y of the undistorted picture.
        let half = 0.5 * (cells.cell_px as f64 - 1.0);
        let value = |i: usize| {
            let [column, row] = [i % cells.columns, i / cells.columns].map(|at| (at * cells.cell_px) as f64 + half);
            let at = camera.normalised_of(Pixel::new(column, row)).unwrap().0;
            (at.x + 2.0 * at.y) as f32
        };
        let values: Vec<f32> = (0..cells.count()).map(value).collect();
        let map = grid.undistorted(&values);
        for (column, row) in [(grid.columns / 2, grid.rows / 2), (grid.columns / 3, grid.rows / 5)] {
            let at = grid.normalised(Point2::new(column as f64, row as f64)).0;
            let found = map.values[row * grid.columns + column];
            assert!((f64::from(found) - at.x - 2.0 * at.y).abs() < 1e-3, "{found} at {at}");
        }
    }

    #[test]
    fn the_corners_of_the_grid_lie_outside_a_picture_of_a_barrel_lens() {
        let grid = UndistortedGrid::new(&wide()).unwrap();
        let centre = Point2::new(grid.columns as f64 / 2.0, grid.rows as f64 / 2.0);
        assert!(grid.is_inside(centre));
        assert!(!grid.is_inside(Point2::new(-1.0, 5.0)));
    }
}
