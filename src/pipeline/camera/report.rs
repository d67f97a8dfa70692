//! What a calibration says of itself: how well each photo fits, how sure each number is, where corners were seen.

use super::checkerboard::BoardReason;
use super::{Board, Camera};
use crate::pipeline::space::Pixel;

/// What was looked for in one photo, and what was found.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardView {
    /// Name of the photo, or of the frame in a video; for the report only.
    pub name: String,
    /// The board's inner corners in [`Board::points_mm`]'s order, or why there are none.
    pub corners: Result<Vec<Pixel>, BoardReason>,
}

/// A camera made from photos, and how far to trust it.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// The camera.
    pub camera: Camera,
    /// The board on the photos.
    pub board: Board,
    /// Root mean square distance between seen and expected corners over all used photos, px (as OpenCV counts it).
    pub rms_px: f64,
    /// Every photo that was given, in order.
    pub photos: Vec<PhotoReport>,
    /// Standard deviation of each of the camera's numbers.
    pub sigma: Sigma,
    /// Where in the picture corners were seen.
    pub coverage: Coverage,
}

impl Calibration {
    /// Photos that the camera was made from.
    pub fn used(&self) -> usize {
        self.photos.iter().filter(|p| p.used()).count()
    }
}

/// One photo's part in a calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotoReport {
    /// The view's name.
    pub name: String,
    /// Root mean square distance between seen and expected corners, px; of a photo left out, under the camera that the
    /// others made. `None` without corners.
    pub rms_px: Option<f64>,
    /// Why the photo was left out; `None` if it was used.
    pub reason: Option<PhotoReason>,
}

impl PhotoReport {
    /// Whether the camera was made from it too.
    pub fn used(&self) -> bool {
        self.reason.is_none()
    }
}

/// Why a photo was left out.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PhotoReason {
    /// The board was not found.
    #[error(transparent)]
    NoCorners(#[from] BoardReason),
    /// The corners lie as on a curved board.
    #[error("board is bent: it bulges by {bulge_mm:.1} mm; use a stiff, flat board")]
    Bent {
        /// Height of the bulge over the board's corners, mm.
        bulge_mm: f64,
    },
    /// A few corners lie far from where all others put them.
    #[error("corner {column},{row} lies {off_px:.1} px from where the others put it: hidden or wrongly found")]
    CornerOff {
        /// Column of the worst corner, from 1.
        column: usize,
        /// Row of the worst corner, from 1.
        row: usize,
        /// How far it is off, px.
        off_px: f64,
    },
    /// The corners contradict the camera that the other photos agree on.
    #[error(
        "corners miss the camera of the other photos by {rms_px:.2} px: moved during the exposure, or another zoom or focus"
    )]
    Misfit {
        /// Root mean square distance, px.
        rms_px: f64,
    },
}

/// Standard deviations of a camera's numbers, for independent corners as noisy as they were found to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sigma {
    /// Of the focal length in x, pixels.
    pub fx: f64,
    /// Of the focal length in y, pixels.
    pub fy: f64,
    /// Of the principal point's column, pixels.
    pub cx: f64,
    /// Of the principal point's row, pixels.
    pub cy: f64,
    /// Of the radial distortion, r².
    pub k1: f64,
    /// Of the radial distortion, r⁴.
    pub k2: f64,
    /// Of the tangential distortion.
    pub p1: f64,
    /// Of the tangential distortion.
    pub p2: f64,
    /// Of the radial distortion, r⁶.
    pub k3: f64,
}

/// How many corners fell into each part of the picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Coverage {
    /// Corners per cell of [`Coverage::COLUMNS`] × [`Coverage::ROWS`] equal cells, row by row.
    pub corners: Vec<usize>,
}

impl Coverage {
    /// Cells across.
    pub const COLUMNS: usize = 8;
    /// Cells down.
    pub const ROWS: usize = 6;

    /// Counts corners; those outside the picture count nowhere.
    pub(super) fn of<'a>(corners: impl Iterator<Item = &'a Pixel>, width: u32, height: u32) -> Self {
        let mut counts = vec![0; Self::COLUMNS * Self::ROWS];
        let cell = |at: f64, size: u32, cells: usize| {
            let share = (at + 0.5) / f64::from(size); // pixel centres are whole: the picture spans −½ … size − ½
            (0.0..1.0).contains(&share).then_some((share * cells as f64) as usize)
        };
        for corner in corners {
            let place = cell(corner.u(), width, Self::COLUMNS).zip(cell(corner.v(), height, Self::ROWS));
            if let Some((column, row)) = place {
                counts[row * Self::COLUMNS + column] += 1;
            }
        }
        Self { corners: counts }
    }

    /// Share of the cells in which a corner was seen, 0–1. Where none was, the distortion is extrapolated.
    pub fn share(&self) -> f64 {
        self.corners.iter().filter(|&&n| n > 0).count() as f64 / self.corners.len().max(1) as f64
    }
}

/// Why photos make no camera.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationProblem {
    /// Too few photos in which the board was found.
    #[error(
        "the {board} board was found in {found} of {given} photos, at least {} are needed{}",
        super::calibrate::FEWEST_PHOTOS, advice(*other, *common)
    )]
    TooFewPhotos {
        /// Columns and rows asked for, as `9x6`.
        board: BoardSize,
        /// Photos in which the board was found.
        found: usize,
        /// Photos given.
        given: usize,
        /// Another board that several photos show.
        other: Option<BoardSize>,
        /// The reason most photos were left out for.
        common: Option<BoardReason>,
    },
    /// A view holds another number of corners than the board has.
    #[error("photo {name} has {found} corners, the board has {expected}")]
    Corners {
        /// Which photo.
        name: String,
        /// How many corners it came with.
        found: usize,
        /// How many the board has.
        expected: usize,
    },
    /// The board always stood the same way.
    #[error(
        "the board is turned by only {widest_deg:.1}° between all photos, which does not tell the focal length; take photos with the board tilted by 20° to 40° to different sides"
    )]
    SamePose {
        /// Widest angle between two boards, degrees.
        widest_deg: f64,
    },
    /// The photos leave the camera open.
    #[error(
        "the photos leave the focal length uncertain by {percent:.0} %; take more, with the board tilted to different sides and near the picture's rim"
    )]
    Undetermined {
        /// Standard deviation of the focal length, percent.
        percent: f64,
    },
    /// The photos contradict each other.
    #[error(
        "the photos do not agree on one camera; use photos of one zoom and focus, of a flat board, and check the board's size"
    )]
    Contradiction,
}

/// Columns and rows of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct BoardSize {
    /// Inner corners along a row.
    pub columns: usize,
    /// Inner corners along a column.
    pub rows: usize,
}

impl From<Board> for BoardSize {
    fn from(board: Board) -> Self {
        Self { columns: board.columns(), rows: board.rows() }
    }
}

impl std::fmt::Display for BoardSize {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{}", self.columns, self.rows)
    }
}

fn advice(other: Option<BoardSize>, common: Option<BoardReason>) -> String {
    match (other, common) {
        (Some(size), _) => {
            format!("; the photos show a board of {size} inner corners: count again where four squares meet")
        }
        (None, Some(reason)) => format!("; most often: {reason}"),
        (None, None) => "; take photos with the board tilted to different sides".to_owned(),
    }
}
