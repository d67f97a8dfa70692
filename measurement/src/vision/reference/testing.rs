//! Drawn pictures of bare shafts, for tests.

use nalgebra::Point2;

use crate::vision::camera::Camera;
use crate::vision::frame::{ColourEncoding, Frame, Matrix, Plane, Range};
use crate::vision::pose::tangent_planes;
use crate::vision::segmentation::samples::ColourSamples;
use crate::vision::space::Normalised;
use crate::vision::tube::{BorderSide, Outline, Tube};

/// A small pinhole camera.
pub(super) const CAMERA: Camera = Camera {
    width: 320,
    height: 240,
    fx: 260.0,
    fy: 260.0,
    cx: 159.5,
    cy: 119.5,
    k1: 0.0,
    k2: 0.0,
    p1: 0.0,
    p2: 0.0,
    k3: 0.0,
    focal_sigma: 0.0,
};

/// Time from one frame to the next, s.
pub(super) const FRAME_S: f64 = 0.04;

/// Luma of a dark shaft.
pub(super) const DARK: u8 = 20;

/// Luma of the board.
const BOARD: u8 = 200;

const ENCODING: ColourEncoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 };

/// No marked colours.
pub(super) fn no_samples() -> ColourSamples {
    ColourSamples::new(ENCODING)
}

/// A grey picture of tubes over a board.
pub(super) struct GreyPicture {
    luma: Vec<u8>,
    chroma: Vec<u8>,
}

impl GreyPicture {
    /// A picture of these tubes with this luma.
    pub(super) fn of(tubes: &[(Tube, u8)]) -> Self {
        let (width, height) = (CAMERA.width as usize, CAMERA.height as usize);
        let outlines: Vec<(Tube, Outline, u8)> =
            tubes.iter().filter_map(|(tube, luma)| Some((*tube, tube.outline()?, *luma))).collect();
        let luma_of = |i: usize| {
            let (u, v) = ((i % width) as f64, (i / width) as f64);
            let at = Point2::new((u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy);
            let shown = outlines.iter().find(|(tube, outline, _)| shows(tube, outline, Normalised(at)));
            shown.map_or(BOARD, |(.., luma)| *luma)
        };
        Self { luma: (0..width * height).map(luma_of).collect(), chroma: vec![128; width * height] }
    }

    /// The picture as a frame.
    pub(super) fn frame(&self, index: u64, time_s: f64) -> Frame<'_> {
        let (width, height) = (CAMERA.width as usize, CAMERA.height as usize);
        let plane = |data| Plane { data, stride: width, width, height };
        Frame {
            index,
            time_s,
            y: plane(&self.luma),
            u: plane(&self.chroma),
            v: plane(&self.chroma),
            shift_x: 0,
            shift_y: 0,
            chroma_first_px: [0.0; 2],
            encoding: ENCODING,
        }
    }
}

/// Does the tube lie in this direction?
fn shows(tube: &Tube, outline: &Outline, at: Normalised) -> bool {
    let is_between = BorderSide::BOTH.iter().all(|side| outline.normal(*side).dot(&at.ray()) > 0.0);
    is_between && tangent_planes::distance_behind_tip(tube, at).is_some_and(|behind_mm| behind_mm > 0.0)
}
