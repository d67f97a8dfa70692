//! Finds the frames that show the whole board, with its corners.
//!
//! In: the luma planes of a recording, in order. Out: a bounded number of [`BoardSighting`]s. Two or three frames a
//! second are searched while no tool is in sight, and fewer while one is. A board that lies still looks the same on
//! every frame, and a frame with a hidden corner gives no board, since the finder never guesses. A search costs as much
//! as tracking ten frames.

use crate::vision::camera::board_pose::{PlacedBoard, locate};
use crate::vision::camera::checkerboard::{self, BoardReason};
use crate::vision::camera::{Board, Camera};
use crate::vision::frame::Frame;
use crate::vision::space::Pixel;

/// Time between two searches, s: a board that lies still for 2 s is seen four times.
const SEARCH_INTERVAL_S: f64 = 0.4;

/// Time between two searches while a tool is in sight, s; the tool nearly always hides a corner.
const SEARCH_INTERVAL_WITH_TOOL_S: f64 = 2.0;

/// Number of searches after which the interval doubles: without a tool, the first 600 take 4 minutes, the next 600
/// take 8.
const SEARCHES_PER_DOUBLING: usize = 600;

/// A frame that shows the board whole.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardSighting {
    /// The frame's time, s.
    pub time_s: f64,
    /// The board's corners, in the order of [`Board::points_mm`], the rows from left to right.
    pub corners: Vec<Pixel>,
    /// The board's pose.
    pub placed: PlacedBoard,
}

/// Looks for the board in a recording.
pub struct BoardWatch {
    board: Board,
    camera: Camera,
    /// Factor on the time between two searches.
    interval_factor: f64,
    last_s: f64,
    searched: usize,
    sightings: Vec<BoardSighting>,
    reason: Option<BoardReason>,
}

impl BoardWatch {
    /// Prepares to search for this board with this camera.
    pub fn new(board: Board, camera: Camera) -> Self {
        let last_s = f64::NEG_INFINITY;
        Self { board, camera, interval_factor: 1.0, last_s, searched: 0, sightings: Vec::new(), reason: None }
    }

    /// Searches a frame if the interval has passed; `has_tool` says whether a tool is in sight.
    pub fn search_frame(&mut self, frame: &Frame<'_>, has_tool: bool) {
        let every_s = if has_tool { SEARCH_INTERVAL_WITH_TOOL_S } else { SEARCH_INTERVAL_S };
        if frame.time_s < self.last_s + every_s * self.interval_factor {
            return;
        }
        self.last_s = frame.time_s;
        self.searched += 1;
        if self.searched.is_multiple_of(SEARCHES_PER_DOUBLING) {
            self.interval_factor *= 2.0;
        }
        match checkerboard::find(&frame.y, self.board) {
            Ok(corners) => self.record(frame.time_s, corners),
            Err(reason) => self.reason = Some(reason),
        }
    }

    /// A watch that has already seen these corners.
    #[cfg(test)]
    pub(super) fn with_sightings(board: Board, camera: Camera, seen: Vec<(f64, Vec<Pixel>)>) -> Self {
        let mut watch = Self::new(board, camera);
        seen.into_iter().for_each(|(time_s, corners)| watch.record(time_s, corners));
        watch
    }

    /// The board that is searched for.
    pub fn board(&self) -> Board {
        self.board
    }

    /// Number of frames searched.
    pub fn searched(&self) -> usize {
        self.searched
    }

    /// Why the last frame without the board did not show it.
    pub fn last_reason(&self) -> Option<BoardReason> {
        self.reason
    }

    /// All sightings, in order of time.
    pub fn into_sightings(self) -> Vec<BoardSighting> {
        self.sightings
    }

    fn record(&mut self, time_s: f64, corners: Vec<Pixel>) {
        let from_left = |corners: &Vec<Pixel>| corners[self.board.columns() - 1].u() - corners[0].u();
        let readings = possible_orders(corners, self.board).into_iter();
        let Some(corners) = readings.max_by(|a, b| from_left(a).total_cmp(&from_left(b))) else { return };
        if let Some(placed) = locate(&self.camera, self.board, &corners) {
            self.sightings.push(BoardSighting { time_s, corners, placed });
        }
    }
}

/// The same corners in every possible order of the board: also from the other end, and, if the board has as many
/// columns as rows, along the columns.
pub(super) fn possible_orders(corners: Vec<Pixel>, board: Board) -> Vec<Vec<Pixel>> {
    let (columns, rows) = (board.columns(), board.rows());
    let reversed = |corners: &Vec<Pixel>| corners.iter().rev().copied().collect::<Vec<_>>();
    let mut all = vec![reversed(&corners)];
    if columns == rows && corners.len() == columns * rows {
        let places = (0..rows).flat_map(|row| (0..columns).map(move |column| (rows - 1 - column) * columns + row));
        let turned: Vec<Pixel> = places.map(|place| corners[place]).collect();
        all.extend([reversed(&turned), turned]);
    }
    all.push(corners);
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_board_has_four_orders_that_keep_its_face_and_another_board_two() {
        let grid = |columns: usize, rows: usize| -> Vec<Pixel> {
            let cells = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
            cells.map(|(column, row)| Pixel::new(column as f64, row as f64)).collect()
        };
        let handedness = |corners: &Vec<Pixel>, columns: usize| {
            let (along, down) = (corners[1].0 - corners[0].0, corners[columns].0 - corners[0].0);
            along.perp(&down)
        };
        for (columns, rows, ways) in [(4, 4, 4), (5, 3, 2)] {
            let all = possible_orders(grid(columns, rows), Board::new(columns, rows, 10.0).unwrap());
            assert_eq!(all.len(), ways);
            assert!(all.iter().all(|corners| handedness(corners, columns) == 1.0), "{all:?}");
            assert!((1..ways).all(|i| all[i] != all[0]));
        }
    }
}
