//! Finds a checkerboard's inner corners in a photo.
//!
//! In: one luma plane and the board that was shown. Out: all its inner corners, row by row, to a few hundredths of a
//! pixel, or the reason why not. Method: at several scales, coarse first, [`crossing`]s of two edges are found and
//! joined to a [`grid`] by topology alone, so that rotation, perspective and distortion do not matter; each corner is
//! then fitted in the full picture ([`corner`]), and the [`lattice`] is completed where the picture shows more corners.
//!
//! Assumes at least 8 px per square. The finder never guesses: a corner that the pixels do not show is not returned,
//! and a board that is not seen whole gives a [`BoardReason`].

mod corner;
mod crossing;
mod grey;
mod grid;
mod lattice;

use super::Board;
use crate::vision::frame::Plane;
use crate::vision::space::Pixel;
use grey::Grey;
use lattice::Lattice;

/// Maximum blur of the edges (standard deviation, in squares); beyond it too little of the squares is left to locate a
/// corner.
const MAX_BLUR_IN_SQUARES: f64 = 0.2;

/// Minimum of pixels on the shorter side of a scaled picture.
const MIN_SCALE_PX: usize = 120;

/// Minimum of pixels on the shorter side of a photo; a smaller one cannot hold the smallest board.
const MIN_PHOTO_PX: usize = 24;

/// Maximum of grids tried at one scale, the largest first.
const MAX_GRIDS: usize = 3;

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
    #[error("the photo shows a board of {columns}x{rows} inner corners or more, not the board that was asked for")]
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
    /// The crossings found do not lie like a board's corners.
    #[error("the crossings found do not form a regular board")]
    Irregular,
}

/// All inner corners of the board, row by row. The choice among the (equivalent) first corners is not defined. In the
/// picture, the direction along a column lies clockwise of the direction along a row: the board is seen from its face.
///
/// # Errors
/// [`BoardReason`] if the board was not found whole.
pub fn find(photo: &Plane<'_>, board: Board) -> Result<Vec<Pixel>, BoardReason> {
    find_or_partial(photo, board).map_err(|missed| missed.reason)
}

/// A board that was not found whole.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardNotFound {
    /// Why it was not found.
    pub reason: BoardReason,
    /// The corners that were seen, in no order; they show where the problem lies.
    pub seen: Vec<Pixel>,
}

/// As [`find`], but a failure also returns the corners that were seen.
pub fn find_or_partial(photo: &Plane<'_>, board: Board) -> Result<Vec<Pixel>, BoardNotFound> {
    let mut missed = BoardNotFound { reason: BoardReason::NoBoard, seen: Vec::new() };
    if photo.width.min(photo.height) < MIN_PHOTO_PX {
        return Err(missed);
    }
    let scales = Scales::of(photo);
    for scale in (0..scales.pictures.len()).rev() {
        for lattice in scales.lattices(scale, board) {
            match corners_of(&lattice, board) {
                Ok(corners) => return Ok(corners),
                Err(reason @ BoardReason::OtherBoard { .. }) => {
                    return Err(BoardNotFound { reason, seen: lattice.positions() });
                }
                Err(reason) if reason_rank(&reason) > reason_rank(&missed.reason) => {
                    missed = BoardNotFound { reason, seen: lattice.positions() };
                }
                Err(_) => {}
            }
        }
    }
    Err(missed)
}

fn corners_of(lattice: &Lattice, board: Board) -> Result<Vec<Pixel>, BoardReason> {
    let (columns, rows) = oriented_size(lattice.size(), board);
    if columns < Board::MIN_CORNERS || rows < Board::MIN_CORNERS {
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
    if blur > MAX_BLUR_IN_SQUARES {
        return Err(BoardReason::Blurred { blur_percent: 100.0 * blur });
    }
    Ok(corners.into_iter().map(Pixel).collect())
}

/// A seen size, with columns and rows swapped if that fits the board better.
fn oriented_size((a, b): (usize, usize), board: Board) -> (usize, usize) {
    let miss = |columns: usize, rows: usize| columns.abs_diff(board.columns()) + rows.abs_diff(board.rows());
    if miss(a, b) <= miss(b, a) { (a, b) } else { (b, a) }
}

/// Ranks a reason: of several, the one that saw most of the board is reported.
fn reason_rank(reason: &BoardReason) -> usize {
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
    /// The photo at full size, lightly smoothed; corners are fitted to it.
    fitted: Grey,
}

impl Scales {
    fn of(photo: &Plane<'_>) -> Self {
        let mut pictures = vec![Grey::from_plane(photo)];
        while let Some(last) = pictures.last().filter(|p| p.width.min(p.height) >= 2 * MIN_SCALE_PX) {
            let half = last.halved();
            pictures.push(half);
        }
        let fitted = pictures[0].binomial();
        Self { pictures, fitted }
    }

    /// Lattices found at one scale and measured at full size.
    fn lattices(&self, scale: usize, board: Board) -> impl Iterator<Item = Lattice> {
        let crossings = crossing::find(&self.pictures[scale].smoothed());
        let mut grids = grid::connect(&crossings);
        grids.truncate(MAX_GRIDS);
        let most = board.columns().max(board.rows()) + 2;
        grids.into_iter().map(move |mut grid| {
            grid.scale_to_full_size(scale);
            Lattice::measure(&self.fitted, &grid, most)
        })
    }
}

#[cfg(test)]
mod tests;
