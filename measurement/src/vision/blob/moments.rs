//! Area, centroid and principal axis of a region, from sums over its cells.

use nalgebra::{Matrix2, Vector2};

use crate::vision::segmentation::region_of_interest::CELL_PX;

/// Sums over a region's cells, in pixels of the recorded frame. Sums can be added, so that parts can be joined.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    count: f64,
    sum: [f64; 2],
    squares: [f64; 3],
}

impl Moments {
    /// Adds one cell.
    pub fn add_cell(&mut self, column: usize, row: usize) {
        let centre = (CELL_PX as f64 - 1.0) / 2.0; // pixel 0 is centred at 0
        let (x, y) = ((column * CELL_PX) as f64 + centre, (row * CELL_PX) as f64 + centre);
        self.count += 1.0;
        self.sum = [self.sum[0] + x, self.sum[1] + y];
        self.squares = [self.squares[0] + x * x, self.squares[1] + x * y, self.squares[2] + y * y];
    }

    /// The moments of both regions together.
    pub fn joined(&self, other: &Self) -> Self {
        Self {
            count: self.count + other.count,
            sum: [0, 1].map(|i| self.sum[i] + other.sum[i]),
            squares: [0, 1, 2].map(|i| self.squares[i] + other.squares[i]),
        }
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.count as usize
    }

    /// Area, square pixels.
    pub fn area_px2(&self) -> f64 {
        self.count * (CELL_PX * CELL_PX) as f64
    }

    /// Centre of mass, pixels.
    pub fn centroid(&self) -> [f64; 2] {
        self.sum.map(|s| s / self.count.max(1.0))
    }

    /// The rectangle with the same centre and second moments.
    pub fn rectangle(&self) -> RegionRectangle {
        let [x, y] = self.centroid();
        let n = self.count.max(1.0);
        let within = (CELL_PX * CELL_PX) as f64 / 12.0; // a cell is a square, not a point
        let covariance = Matrix2::new(
            self.squares[0] / n - x * x + within,
            self.squares[1] / n - x * y,
            self.squares[1] / n - x * y,
            self.squares[2] / n - y * y + within,
        );
        let eigen = covariance.symmetric_eigen();
        let long = if eigen.eigenvalues[0] >= eigen.eigenvalues[1] { 0 } else { 1 };
        let side = |variance: f64| (12.0 * variance.max(0.0)).sqrt(); // a uniform side of length a has variance a²/12
        RegionRectangle {
            centre: Vector2::new(x, y),
            axis: eigen.eigenvectors.column(long).into_owned(),
            length_px: side(eigen.eigenvalues[long]),
            width_px: side(eigen.eigenvalues[1 - long]),
        }
    }
}

/// The rectangle with a region's centre and second moments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionRectangle {
    /// Centre, pixels.
    pub centre: Vector2<f64>,
    /// Unit vector along the longer side; its sign has no meaning.
    pub axis: Vector2<f64>,
    /// Longer side, pixels.
    pub length_px: f64,
    /// Shorter side, pixels.
    pub width_px: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_leaning_bar_has_its_own_axis_length_and_width() {
        let (length, width, angle) = (120.0, 30.0, 0.5f64);
        let along = Vector2::new(angle.cos(), angle.sin());
        let across = Vector2::new(-along.y, along.x);
        let mut moments = Moments::default();
        for row in 0..150u32 {
            for column in 0..150u32 {
                let p = Vector2::new(f64::from(column) * 2.0 + 0.5 - 150.0, f64::from(row) * 2.0 + 0.5 - 150.0);
                if p.dot(&along).abs() < length / 2.0 && p.dot(&across).abs() < width / 2.0 {
                    moments.add_cell(column as usize, row as usize);
                }
            }
        }
        let found = moments.rectangle();
        assert!((found.axis.dot(&along).abs() - 1.0).abs() < 1e-3);
        assert!((found.length_px - length).abs() < 1.0 && (found.width_px - width).abs() < 1.0, "{found:?}");
        assert!((found.centre - Vector2::new(150.0, 150.0)).norm() < 0.5);
    }
}
