//! What one photo of a checkerboard is good for, told while whoever took it still holds the board.

use serde::{Deserialize, Serialize};

use super::named;
use crate::pipeline::camera::glance;
use crate::pipeline::camera::{Board, Coverage};

named! {
    /// A side of a picture, or of a board as it is seen.
    Edge: "edge" {
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
    /// What may be the cause that a board was not found.
    PhotoHint: "hint" {
        /// Too little light.
        Dark = "dark",
        /// Burnt out by the light or its reflection.
        Glare = "glare",
        /// Nothing in the picture is sharp.
        Soft = "soft",
        /// The board leaves the picture; `cut_off` says where.
        CutOff = "cut_off",
    }
}

/// A photo of a checkerboard at a glance. It says nothing of accuracy: only all photos together do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct PhotoCheck {
    /// Columns, pixels.
    pub width: u32,
    /// Rows, pixels.
    pub height: u32,
    /// Was the board found whole? Then a calibration can use the photo.
    pub found: bool,
    /// Column and row of every inner corner, pixels, row by row of the board; of a board that was not found whole those
    /// that were seen, in no order.
    pub corners: Vec<[f64; 2]>,
    /// Why the board was not found whole.
    pub reason: Option<String>,
    /// What may be the cause.
    pub hints: Vec<PhotoHint>,
    /// The sides of the picture at which what was seen of the board ends.
    pub cut_off: Vec<Edge>,
    /// The side of the board that is clearly nearer to the camera; null where it faces the camera.
    pub near: Option<Edge>,
    /// Which parts of the picture its corners fill.
    pub coverage: PhotoCoverage,
}

/// Corners in each of equal cells of a picture.
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
    /// Corners that are shown at most: more than any board has.
    pub const MOST_CORNERS: usize = (Board::MOST + 2).pow(2);

    /// Of a photo of this size.
    pub fn new((width, height): (u32, u32), glance: &glance::Glance) -> Self {
        let mut hints: Vec<PhotoHint> = glance.hints.iter().map(hint).collect();
        hints.dedup();
        Self {
            width,
            height,
            found: glance.reason.is_none(),
            corners: glance
                .corners
                .iter()
                .take(Self::MOST_CORNERS)
                .map(|corner| [corner.u(), corner.v()].map(to_hundredth))
                .collect(),
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

/// For drawing: a calibration finds its corners anew.
fn to_hundredth(value: f64) -> f64 {
    (value * 100.0).round() / 100.0
}

fn hint(hint: &glance::Hint) -> PhotoHint {
    match hint {
        glance::Hint::Dark => PhotoHint::Dark,
        glance::Hint::Glare => PhotoHint::Glare,
        glance::Hint::Soft => PhotoHint::Soft,
        glance::Hint::CutOff(_) => PhotoHint::CutOff,
    }
}

fn cut_off(hint: &glance::Hint) -> Option<Edge> {
    match hint {
        glance::Hint::CutOff(at) => Some(edge(*at)),
        _ => None,
    }
}

fn edge(at: glance::Edge) -> Edge {
    match at {
        glance::Edge::Left => Edge::Left,
        glance::Edge::Right => Edge::Right,
        glance::Edge::Top => Edge::Top,
        glance::Edge::Bottom => Edge::Bottom,
    }
}
