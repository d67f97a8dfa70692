//! The report of a calibration: the fit of each photo, the standard deviation of each number, and where corners were
//! seen.

use std::str::FromStr;

use super::checkerboard::BoardReason;
use super::{Board, Camera};
use crate::vision::space::Pixel;

/// One photo with the corners found in it, or the reason why there are none.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardView {
    /// Name of the photo, or of the frame in a video; for the report only.
    pub name: String,
    /// The board's inner corners in [`Board::points_mm`]'s order, or why the photo is left out.
    pub corners: Result<Vec<Pixel>, PhotoReason>,
}

/// A camera calibrated from photos, and its uncertainty.
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
    /// Standard deviation of each of the camera's parameters.
    pub sigma: CameraSigma,
    /// Parts of the picture where corners were seen.
    pub coverage: Coverage,
}

impl Calibration {
    /// Number of photos that the camera was calibrated from.
    pub fn used_count(&self) -> usize {
        self.photos.iter().filter(|p| p.is_used()).count()
    }
}

/// The result of one photo of a calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotoReport {
    /// The view's name.
    pub name: String,
    /// Root mean square distance between seen and expected corners, px. For a photo that was left out, it is measured
    /// against the camera of the other photos. `None` without corners.
    pub rms_px: Option<f64>,
    /// Why the photo was left out; `None` if it was used.
    pub reason: Option<PhotoReason>,
}

impl PhotoReport {
    /// Whether the photo was used for the calibration.
    pub fn is_used(&self) -> bool {
        self.reason.is_none()
    }
}

/// Why a photo was left out.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PhotoReason {
    /// The file is no photo that can be read.
    #[error("{0}")]
    Unreadable(String),
    /// Most photos have another size.
    #[error(
        "the photo is {}×{}, most photos are {}×{}: a camera is calibrated at one picture size",
        size.0, size.1, usual.0, usual.1
    )]
    OtherSize {
        /// Width and height of the photo, pixels.
        size: (u32, u32),
        /// Width and height of most photos, pixels.
        usual: (u32, u32),
    },
    /// The board was not found.
    #[error(transparent)]
    NoCorners(#[from] BoardReason),
    /// The corners lie as on a bent board.
    #[error("board is bent: it bulges by {bulge_mm:.1} mm; use a stiff, flat board")]
    Bent {
        /// Height of the bulge over the board's corners, mm.
        bulge_mm: f64,
    },
    /// A few corners lie far from their expected positions.
    #[error("corner {column},{row} lies {off_px:.1} px from its expected position: it was hidden or found wrongly")]
    CornerOff {
        /// Column of the worst corner, from 1.
        column: usize,
        /// Row of the worst corner, from 1.
        row: usize,
        /// Distance from the expected position, px.
        off_px: f64,
    },
    /// The corners contradict the camera that the other photos agree on.
    #[error(
        "the corners are {rms_px:.2} px from where the camera of the other photos expects them: the board moved during \
         the exposure, or zoom or focus changed"
    )]
    Misfit {
        /// Root mean square distance, px.
        rms_px: f64,
    },
}

/// Standard deviations of a camera's parameters, for independent corners with the noise seen in the residuals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraSigma {
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

/// Number of corners in each part of the picture.
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

    /// Counts the corners per cell; corners outside the picture are not counted.
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

    /// Share of the cells with at least one corner, 0–1. In the other cells the distortion is extrapolated.
    pub fn share(&self) -> f64 {
        self.corners.iter().filter(|&&n| n > 0).count() as f64 / self.corners.len().max(1) as f64
    }
}

/// Why the photos do not give a camera.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationProblem {
    /// The board was found in too few photos.
    #[error(
        "the {board} board was found in {found} of {given} photos, at least {} are needed{}",
        super::calibrate::MIN_PHOTOS, advice(*other, common.as_deref())
    )]
    TooFewPhotos {
        /// Columns and rows of the requested board, as `9x6`.
        board: CornerCounts,
        /// Number of photos with the board.
        found: usize,
        /// Photos given.
        given: usize,
        /// A board of another size that most photos with a board show.
        other: Option<CornerCounts>,
        /// The most frequent reason for leaving a photo out; `None` if the reader has the reason of each photo.
        common: Option<Box<PhotoReason>>,
    },
    /// A view does not have as many corners as the board.
    #[error("photo {name} has {found} corners, the board has {expected}")]
    Corners {
        /// Name of the photo.
        name: String,
        /// Corners of the photo.
        found: usize,
        /// Corners of the board.
        expected: usize,
    },
    /// The board has nearly the same tilt in all photos.
    #[error(
        "the board's tilt differs by only {widest_deg:.1}° between all photos, too little to find the focal length; \
         take photos with the board tilted by 20° to 40° to different sides"
    )]
    SamePose {
        /// Widest angle between two boards, degrees.
        widest_deg: f64,
    },
    /// The photos do not determine the camera well enough.
    #[error(
        "the focal length is uncertain by {percent:.0} %; take more photos, with the board tilted to different sides \
         and near the edges of the picture"
    )]
    Undetermined {
        /// Standard deviation of the focal length, percent.
        percent: f64,
    },
    /// The photos contradict each other.
    #[error(
        "the photos do not agree on one camera; take all photos with the same zoom and focus, use a flat board, and \
         check the board's size"
    )]
    Contradiction,
}

impl CalibrationProblem {
    /// The problem without the reasons of single photos, for a reader who has been shown them.
    pub fn without_photo_reasons(mut self) -> Self {
        if let Self::TooFewPhotos { common, .. } = &mut self {
            *common = None;
        }
        self
    }
}

/// Columns and rows of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct CornerCounts {
    /// Inner corners along a row.
    pub columns: usize,
    /// Inner corners along a column.
    pub rows: usize,
}

impl From<Board> for CornerCounts {
    fn from(board: Board) -> Self {
        Self { columns: board.columns(), rows: board.rows() }
    }
}

impl std::fmt::Display for CornerCounts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{}", self.columns, self.rows)
    }
}

impl FromStr for CornerCounts {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let sides = text.split_once(['x', 'X', '×']);
        let parsed = sides.and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
        let (columns, rows) = parsed.ok_or("expected COLUMNSxROWS of inner corners, such as 9x6")?;
        Ok(Self { columns, rows })
    }
}

fn advice(other: Option<CornerCounts>, common: Option<&PhotoReason>) -> String {
    match (other, common) {
        (Some(size), _) => format!(
            "; the photos show {size} inner corners: if these are all, give that number (inner corners are the points where \
             four squares meet, one less than the squares in each direction), otherwise show the whole board"
        ),
        (None, Some(reason)) => format!("; most often: {reason}"),
        (None, None) => "; take photos that show the whole board, tilted to different sides".to_owned(),
    }
}
