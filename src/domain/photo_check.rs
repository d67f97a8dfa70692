//! Immediate feedback on one photo of a checkerboard, while the user still holds the board.

use serde::{Deserialize, Serialize};

use super::named;
use crate::vision::camera::photo_inspection;
use crate::vision::camera::{Board, Coverage};
use crate::vision::space::Pixel;

named! {
    /// A side of a picture, or of a board in the picture.
    PhotoEdge: "edge" {
        /// Left.
        Left = "left",
        /// Right.
        Right = "right",
        /// Top.
        Top = "top",
        /// Bottom.
        Bottom = "bottom",
    }
}

named! {
    /// A possible reason why a board was not found.
    PhotoHint: "hint" {
        /// Too little light.
        Dark = "dark",
        /// Overexposed by the light or its reflection.
        Glare = "glare",
        /// Nothing in the picture is sharp.
        Soft = "soft",
        /// The picture shows a board of another size: count its inner corners again.
        Count = "count",
        /// The board reaches beyond the picture; `cut_off` says where.
        CutOff = "cut_off",
    }
}

/// Result of a quick check of one checkerboard photo. It says nothing about accuracy, which depends on all photos
/// together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct PhotoCheck {
    /// Columns, pixels.
    pub width: u32,
    /// Rows, pixels.
    pub height: u32,
    /// Whether the whole board was found. Only then can a calibration use the photo.
    pub found: bool,
    /// Column and row of every inner corner, pixels, row by row of the board. If the board was not found whole: the
    /// corners that were seen, in no order.
    pub corners: Vec<[f64; 2]>,
    /// Expected places of corners that were not seen between the others: hidden, blurred or overexposed.
    pub missing: Vec<[f64; 2]>,
    /// Why the board was not found whole.
    pub reason: Option<String>,
    /// Possible causes.
    pub hints: Vec<PhotoHint>,
    /// The sides of the picture that cut off the board.
    pub cut_off: Vec<PhotoEdge>,
    /// The side of the board that is clearly nearer to the camera; null where it faces the camera.
    pub near: Option<PhotoEdge>,
    /// Which parts of the picture the corners cover.
    pub coverage: PhotoCoverage,
}

/// Number of corners in each cell of a grid over the picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct PhotoCoverage {
    /// Cells across.
    pub columns: u32,
    /// Cells down.
    pub rows: u32,
    /// Corners in each, row by row.
    pub corners: Vec<u32>,
}

impl PhotoCheck {
    /// Maximum number of corners in the result: more than any board has.
    pub const MAX_CORNERS: usize = (Board::MAX_CORNERS + 2).pow(2);

    /// The check of a photo of this size.
    pub fn new((width, height): (u32, u32), glance: &photo_inspection::PhotoInspection) -> Self {
        let mut hints: Vec<PhotoHint> = glance.hints.iter().map(hint).collect();
        hints.dedup();
        Self {
            width,
            height,
            found: glance.reason.is_none(),
            corners: places(&glance.corners),
            missing: places(&glance.missing),
            reason: glance.reason.map(|reason| reason.to_string()),
            hints,
            cut_off: glance.hints.iter().filter_map(cut_off).collect(),
            near: glance.near.map(edge),
            coverage: PhotoCoverage {
                columns: Coverage::COLUMNS as u32,
                rows: Coverage::ROWS as u32,
                corners: glance.coverage.corners.iter().map(|&count| count as u32).collect(),
            },
        }
    }
}

fn places(corners: &[Pixel]) -> Vec<[f64; 2]> {
    let place = |corner: &Pixel| [corner.u(), corner.v()].map(to_hundredth);
    corners.iter().take(PhotoCheck::MAX_CORNERS).map(place).collect()
}

/// Rounds for drawing; a calibration detects the corners again with full precision.
fn to_hundredth(value: f64) -> f64 {
    (value * 100.0).round() / 100.0
}

fn hint(hint: &photo_inspection::Hint) -> PhotoHint {
    match hint {
        photo_inspection::Hint::Dark => PhotoHint::Dark,
        photo_inspection::Hint::Glare => PhotoHint::Glare,
        photo_inspection::Hint::Soft => PhotoHint::Soft,
        photo_inspection::Hint::Count => PhotoHint::Count,
        photo_inspection::Hint::CutOff(_) => PhotoHint::CutOff,
    }
}

fn cut_off(hint: &photo_inspection::Hint) -> Option<PhotoEdge> {
    match hint {
        photo_inspection::Hint::CutOff(at) => Some(edge(*at)),
        _ => None,
    }
}

fn edge(at: photo_inspection::PictureSide) -> PhotoEdge {
    match at {
        photo_inspection::PictureSide::Left => PhotoEdge::Left,
        photo_inspection::PictureSide::Right => PhotoEdge::Right,
        photo_inspection::PictureSide::Top => PhotoEdge::Top,
        photo_inspection::PictureSide::Bottom => PhotoEdge::Bottom,
    }
}
