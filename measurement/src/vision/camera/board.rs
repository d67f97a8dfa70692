//! The checkerboard: how many inner corners it has and how large its squares are.

use nalgebra::Point2;

/// A checkerboard with `columns` × `rows` inner corners; valid by construction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Board {
    columns: usize,
    rows: usize,
    square_mm: f64,
}

/// Why a board's size is refused.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum BoardProblem {
    /// Too few or too many inner corners to be found.
    #[error(
        "a board of {columns}x{rows} inner corners is not supported; count the points where four squares meet, {}x{} \
         to {}x{}",
        Board::MIN_CORNERS,
        Board::MIN_CORNERS,
        Board::MAX_CORNERS,
        Board::MAX_CORNERS
    )]
    Corners {
        /// Inner corners along one side.
        columns: usize,
        /// Inner corners along the other side.
        rows: usize,
    },
    /// A square that cannot be printed or filmed.
    #[error("a square of {0} mm is not possible; measure one square's side, more than 0 and at most 1000 mm")]
    Square(f64),
}

impl Board {
    /// Minimum of inner corners along a side; with two the lens's distortion would not show.
    pub const MIN_CORNERS: usize = 3;
    /// Maximum of inner corners along a side; bounds the search, above every board in use.
    pub const MAX_CORNERS: usize = 60;

    /// Creates a board from its inner corners (where four squares meet) and the side of a square.
    pub fn new(columns: usize, rows: usize, square_mm: f64) -> Result<Self, BoardProblem> {
        let possible = Self::MIN_CORNERS..=Self::MAX_CORNERS;
        if !possible.contains(&columns) || !possible.contains(&rows) {
            return Err(BoardProblem::Corners { columns, rows });
        }
        if !(square_mm > 0.0 && square_mm <= 1000.0) {
            return Err(BoardProblem::Square(square_mm));
        }
        Ok(Self { columns, rows, square_mm })
    }

    /// Inner corners along a row.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Inner corners along a column.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Side of a square, mm.
    pub fn square_mm(&self) -> f64 {
        self.square_mm
    }

    /// Number of inner corners.
    pub fn corner_count(&self) -> usize {
        self.columns * self.rows
    }

    /// The inner corners on the board, mm, row by row. The origin is the board's middle, where rotation and translation
    /// of a pose are least correlated.
    pub fn points_mm(&self) -> Vec<Point2<f64>> {
        let middle = |count: usize| (count - 1) as f64 / 2.0;
        let at = |i: usize, count: usize| (i as f64 - middle(count)) * self.square_mm;
        (0..self.rows)
            .flat_map(|row| (0..self.columns).map(move |column| (column, row)))
            .map(|(column, row)| Point2::new(at(column, self.columns), at(row, self.rows)))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_board_that_cannot_be_printed_is_refused() {
        assert!(Board::new(9, 6, 21.0).is_ok());
        assert!(matches!(Board::new(9, 2, 21.0), Err(BoardProblem::Corners { columns: 9, rows: 2 })));
        assert!(matches!(Board::new(usize::MAX, 6, 21.0), Err(BoardProblem::Corners { .. })));
        for square in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(Board::new(9, 6, square), Err(BoardProblem::Square(_))));
        }
    }

    #[test]
    fn corners_lie_a_square_apart_around_the_middle() {
        let points = Board::new(4, 3, 10.0).unwrap().points_mm();
        assert_eq!(points[0], Point2::new(-15.0, -10.0));
        assert_eq!(points[1] - points[0], nalgebra::Vector2::new(10.0, 0.0));
        assert_eq!(points[4] - points[0], nalgebra::Vector2::new(0.0, 10.0));
        assert_eq!(points[11], Point2::new(15.0, 10.0));
    }
}
