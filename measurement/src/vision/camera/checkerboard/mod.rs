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
mod hidden;
mod lattice;

pub use hidden::HiddenCorners;

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
    #[error(
        "only {columns}x{rows} inner corners seen: {}",
        if *may_be_whole { "the rest of the board is hidden or blurred, or it has no more corners" }
        else { "the board is partly outside, hidden or blurred" }
    )]
    Incomplete {
        /// Columns of the part.
        columns: usize,
        /// Rows of the part.
        rows: usize,
        /// No corner is missing in the part.
        is_regular: bool,
        /// The part has no gap and has space around it in the picture, so it may be a whole board of this size.
        may_be_whole: bool,
    },
    /// The board was seen, but not all of its corners.
    #[error("{0}")]
    Hidden(HiddenCorners),
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
    /// Expected positions of the corners that were not seen between them.
    pub missing: Vec<Pixel>,
}

impl BoardNotFound {
    fn new(reason: BoardReason, lattice: &Lattice) -> Self {
        let missing = lattice.missing().iter().filter_map(|corner| corner.expected).collect();
        Self { reason, seen: lattice.positions(), missing }
    }
}

/// As [`find`], but a failure also returns the corners that were seen.
pub fn find_or_partial(photo: &Plane<'_>, board: Board) -> Result<Vec<Pixel>, Box<BoardNotFound>> {
    let mut parts = SeenParts::default();
    if photo.width.min(photo.height) < MIN_PHOTO_PX {
        return Err(Box::new(parts.into_reason(photo, board)));
    }
    let scales = Scales::of(photo);
    for scale in (0..scales.pictures.len()).rev() {
        for lattice in scales.lattices(scale, board) {
            match corners_of(&lattice, board) {
                Ok(corners) => return Ok(corners),
                Err(Some(reason @ BoardReason::OtherBoard { .. })) => {
                    return Err(Box::new(BoardNotFound::new(reason, &lattice)));
                }
                Err(reason) => parts.add(lattice, reason),
            }
        }
    }
    parts.complete(&scales.fitted, board);
    let whole = parts.largest.as_ref().and_then(|part| corners_of(part, board).ok());
    whole.ok_or_else(|| Box::new(parts.into_reason(photo, board)))
}

/// The corners of a lattice that is the board, or why it is none; without a reason, too few of them were seen.
fn corners_of(lattice: &Lattice, board: Board) -> Result<Vec<Pixel>, Option<BoardReason>> {
    let (columns, rows) = oriented_size(lattice.size(), board);
    if !lattice.is_full() || is_smaller((columns, rows), board) {
        return Err(None);
    }
    let Some(corners) = lattice.in_order(board.columns(), board.rows()) else {
        return Err(Some(BoardReason::OtherBoard { columns, rows }));
    };
    if !lattice.is_smooth() || !lattice.alternates() {
        return Err(Some(BoardReason::Irregular));
    }
    let blur = lattice.blur_in_squares();
    if blur > MAX_BLUR_IN_SQUARES {
        return Err(Some(BoardReason::Blurred { blur_percent: 100.0 * blur }));
    }
    Ok(corners.into_iter().map(Pixel).collect())
}

/// Whether a seen size lacks corners of the board, and does not exceed it.
fn is_smaller((columns, rows): (usize, usize), board: Board) -> bool {
    let is_within = columns <= board.columns() && rows <= board.rows();
    is_too_small((columns, rows)) || is_within && (columns < board.columns() || rows < board.rows())
}

fn is_too_small((columns, rows): (usize, usize)) -> bool {
    columns < Board::MIN_CORNERS || rows < Board::MIN_CORNERS
}

/// What was seen of a board that was not found whole.
#[derive(Default)]
struct SeenParts {
    /// Seen whole, but blurred.
    blurred: Option<BoardNotFound>,
    /// The part with most corners that fit a board.
    largest: Option<Lattice>,
    /// As many crossings as the board has, but too many that do not fit.
    irregular: Option<BoardNotFound>,
}

impl SeenParts {
    fn add(&mut self, lattice: Lattice, reason: Option<BoardReason>) {
        let missed = reason.map(|reason| BoardNotFound::new(reason, &lattice));
        let largest = self.largest.as_ref().map_or(0, Lattice::count);
        match (reason, lattice.without_false_corners()) {
            (Some(BoardReason::Blurred { .. }), _) => self.blurred = self.blurred.take().or(missed),
            (_, Some(part)) if part.count() > largest => self.largest = Some(part),
            (_, Some(_)) => {}
            (_, None) => self.irregular = self.irregular.take().or(missed),
        }
    }

    /// Adds the corners beside the largest part that the picture shows, also of rows that are not complete.
    fn complete(&mut self, picture: &Grey, board: Board) {
        self.largest = self.largest.take().map(|part| part.completed(picture, board.columns(), board.rows()));
    }

    fn into_reason(self, photo: &Plane<'_>, board: Board) -> BoardNotFound {
        let of_part = self.largest.and_then(|part| {
            let reason = reason_of_part(&part, photo, board)?;
            Some(BoardNotFound::new(reason, &part))
        });
        let nothing = || BoardNotFound { reason: BoardReason::NoBoard, seen: Vec::new(), missing: Vec::new() };
        self.blurred.or(of_part).or(self.irregular).unwrap_or_else(nothing)
    }
}

/// Why a part is not the whole board; `None` if it is too small for a part of one.
fn reason_of_part(part: &Lattice, photo: &Plane<'_>, board: Board) -> Option<BoardReason> {
    let (columns, rows) = oriented_size(part.size(), board);
    if is_too_small((columns, rows)) {
        return None;
    }
    if is_smaller((columns, rows), board) {
        let is_regular = part.is_full();
        let may_be_whole = is_regular && part.has_space_around(photo.width, photo.height);
        return Some(BoardReason::Incomplete { columns, rows, is_regular, may_be_whole });
    }
    Some(match corners_of(part, board) {
        Err(Some(reason)) => reason,
        _ => BoardReason::Hidden(HiddenCorners::new(&part.missing(), columns * rows)),
    })
}

/// A seen size, with columns and rows swapped if that fits the board better.
fn oriented_size((a, b): (usize, usize), board: Board) -> (usize, usize) {
    let miss = |columns: usize, rows: usize| columns.abs_diff(board.columns()) + rows.abs_diff(board.rows());
    if miss(a, b) <= miss(b, a) { (a, b) } else { (b, a) }
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
