//! Finds a checkerboard's inner corners in a photo.
//!
//! In: one luma plane and the board that was shown. Out: all its inner corners, row by row, to a few hundredths of a
//! pixel, or why not. Method: at several scales, coarse first, [`crossing`]s of two edges are found and joined to a
//! [`grid`] by topology alone, so that rotation, perspective and a lens's bending do not matter; each corner is then
//! fitted in the full picture ([`corner`]) and the [`lattice`] completed where the picture shows more.
//!
//! Assumes at least 8 px per square. Never guesses: a corner that the pixels do not show is not returned, and a board
//! that is not seen whole gives a [`BoardReason`].

mod corner;
mod crossing;
mod grey;
mod grid;
mod lattice;

use super::Board;
use crate::pipeline::frame::Plane;
use crate::pipeline::space::Pixel;
use grey::Grey;
use lattice::Lattice;

/// Edges wider than this (standard deviation, in squares) leave too little of the squares to locate a corner.
const MOST_BLUR_IN_SQUARES: f64 = 0.2;

/// Below this many pixels on the shorter side no further scale is made.
const SMALLEST_SCALE_PX: usize = 120;

/// A board of the fewest corners does not fit into less.
const SMALLEST_PHOTO_PX: usize = 24;

/// Grids tried at one scale, the largest first.
const MOST_GRIDS: usize = 3;

/// Why a photo gives no corners.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum BoardReason {
    /// Nothing like a checkerboard was seen.
    #[error("no checkerboard seen: it is missing, hidden, too blurred or too small (at least 8 pixels a square)")]
    NoBoard,
    /// Part of a board was seen.
    #[error("only {columns}x{rows} inner corners seen: the board is partly outside, hidden or blurred")]
    Incomplete {
        /// Columns of the part.
        columns: usize,
        /// Rows of the part.
        rows: usize,
    },
    /// A board was seen whole, but of another size.
    #[error("a board of {columns}x{rows} inner corners or more is seen, another than the one asked for")]
    OtherBoard {
        /// Columns seen.
        columns: usize,
        /// Rows seen.
        rows: usize,
    },
    /// The corners are there, but washed out.
    #[error("blurred: edges are {blur_percent:.0} % of a square wide; hold board and camera still, and focus")]
    Blurred {
        /// Blur's standard deviation in percent of a square.
        blur_percent: f64,
    },
    /// Crossings were found that do not lie as a board's corners do.
    #[error("the crossings found do not form a regular board")]
    Irregular,
}

/// All inner corners of the board, row by row. Which of the (equivalent) first corners is chosen is not defined, but
/// rows run so that columns lie clockwise of them in the picture: the board is seen from its face.
pub fn find(photo: &Plane<'_>, board: Board) -> Result<Vec<Pixel>, BoardReason> {
    seek(photo, board).map_err(|missed| missed.reason)
}

/// A board that was not found whole.
#[derive(Clone, Debug, PartialEq)]
pub struct Missed {
    /// Why not.
    pub reason: BoardReason,
    /// What was seen of it, in no order: where to look for what is wrong.
    pub seen: Vec<Pixel>,
}

/// As [`find`]; where that fails, with what was seen.
pub fn seek(photo: &Plane<'_>, board: Board) -> Result<Vec<Pixel>, Missed> {
    let mut missed = Missed { reason: BoardReason::NoBoard, seen: Vec::new() };
    if photo.width.min(photo.height) < SMALLEST_PHOTO_PX {
        return Err(missed);
    }
    let scales = Scales::of(photo);
    for scale in (0..scales.pictures.len()).rev() {
        for lattice in scales.lattices(scale, board) {
            match corners_of(&lattice, board) {
                Ok(corners) => return Ok(corners),
                Err(reason @ BoardReason::OtherBoard { .. }) => {
                    return Err(Missed { reason, seen: lattice.positions() });
                }
                Err(reason) if weight(&reason) > weight(&missed.reason) => {
                    missed = Missed { reason, seen: lattice.positions() };
                }
                Err(_) => {}
            }
        }
    }
    Err(missed)
}

fn corners_of(lattice: &Lattice, board: Board) -> Result<Vec<Pixel>, BoardReason> {
    let (columns, rows) = upright(lattice.size(), board);
    if columns < Board::FEWEST || rows < Board::FEWEST {
        return Err(BoardReason::NoBoard);
    }
    if !lattice.is_full()
        || columns < board.columns() && rows <= board.rows()
        || rows < board.rows() && columns <= board.columns()
    {
        return Err(BoardReason::Incomplete { columns, rows });
    }
    let Some(corners) = lattice.in_order(board.columns(), board.rows()) else {
        return Err(BoardReason::OtherBoard { columns, rows });
    };
    if !lattice.is_smooth() || !lattice.alternates() {
        return Err(BoardReason::Irregular);
    }
    let blur = lattice.blur_in_squares();
    if blur > MOST_BLUR_IN_SQUARES {
        return Err(BoardReason::Blurred { blur_percent: 100.0 * blur });
    }
    Ok(corners.into_iter().map(Pixel).collect())
}

/// A size as seen, turned the way that fits the board better.
fn upright((a, b): (usize, usize), board: Board) -> (usize, usize) {
    let miss = |columns: usize, rows: usize| columns.abs_diff(board.columns()) + rows.abs_diff(board.rows());
    if miss(a, b) <= miss(b, a) { (a, b) } else { (b, a) }
}

/// Of several reasons the one counts that saw most of the board.
fn weight(reason: &BoardReason) -> usize {
    match reason {
        BoardReason::NoBoard => 0,
        BoardReason::Incomplete { columns, rows } => columns * rows,
        BoardReason::Irregular => usize::MAX - 1,
        BoardReason::Blurred { .. } | BoardReason::OtherBoard { .. } => usize::MAX,
    }
}

/// The photo at full, half, quarter … size.
struct Scales {
    pictures: Vec<Grey>,
    /// At full size, lightly smoothed: what corners are fitted to.
    fitted: Grey,
}

impl Scales {
    fn of(photo: &Plane<'_>) -> Self {
        let mut pictures = vec![Grey::from_plane(photo)];
        while let Some(last) = pictures.last().filter(|p| p.width.min(p.height) >= 2 * SMALLEST_SCALE_PX) {
            let half = last.halved();
            pictures.push(half);
        }
        let fitted = pictures[0].binomial();
        Self { pictures, fitted }
    }

    /// Lattices found at one scale and measured at full size.
    fn lattices(&self, scale: usize, board: Board) -> impl Iterator<Item = Lattice> {
        let crossings = crossing::find(&self.pictures[scale].smoothed());
        let mut grids = grid::grow(&crossings);
        grids.truncate(MOST_GRIDS);
        let most = board.columns().max(board.rows()) + 2;
        grids.into_iter().map(move |mut grid| {
            grid.enlarge(scale);
            Lattice::measure(&self.fitted, &grid, most)
        })
    }
}

#[cfg(test)]
mod tests;
