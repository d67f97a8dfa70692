//! Finds the board in photos or in a video, calibrates the camera, and checks its uncertainty against parts of the set.
//!
//! The command line and the service's confined child both use this; they only add where the bytes come from.

mod views;

pub use views::{MAX_PHOTOS, Views, ViewsError, is_photo, views_of_photos, views_of_video};

use crate::domain::camera_limits::{ImpossibleCamera, check_camera};
use crate::domain::camera_warning::MIN_CHECKED_PHOTOS;
use crate::vision::camera::report::CameraSigma;
use crate::vision::camera::{Board, BoardView, Calibration, CalibrationProblem, Coverage, MIN_PHOTOS, calibrate};
use crate::vision::space::Pixel;

/// Groups of photos that are left out in turn. More cost time and change little.
const GROUPS: usize = 8;

/// Maximum standard deviation of the focal length between parts of the set, percent: beyond it the camera is refused, as
/// it is for the uncertainty by the corners' noise.
const MAX_FOCAL_SPREAD_PERCENT: f64 = 5.0;

/// Corners in the outermost cells of the picture that put a photo at its edge.
const MIN_EDGE_CORNERS: usize = 4;

/// A calibration whose uncertainty holds between parts of its photos.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckedCalibration {
    /// The calibration. Its standard deviations are the larger of two: by the noise of the corners, and by the change
    /// when a part of the photos is left out.
    pub calibration: Calibration,
    /// For each photo, in order: whether it shows the board at the edge of the picture.
    pub at_edge: Vec<bool>,
}

/// Why the photos give no camera.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationRefusal {
    /// The photos do not determine a camera.
    #[error(transparent)]
    Problem(#[from] CalibrationProblem),
    /// Parts of the photos give other cameras.
    #[error(
        "parts of the photos give different cameras: the focal length is uncertain by {percent:.0} % (limit \
         {MAX_FOCAL_SPREAD_PERCENT} %), although each part fits; use a flat, stiff board, tilt it by 20° to 40° to different \
         sides, and do not use a lens that shows more than about 100°"
    )]
    Unstable {
        /// Standard deviation of the focal length, percent.
        percent: f64,
    },
    /// Without a part of the photos, the others give no camera.
    #[error(
        "the camera depends on single photos: without {failed} of {groups} groups of photos in turn, the others give no camera; \
         take about 20 photos with the board at different places and tilted by 20° to 40° to different sides"
    )]
    PartFails {
        /// Groups without which there is no camera.
        failed: usize,
        /// Groups that were left out in turn.
        groups: usize,
    },
    /// The camera that fits the photos best cannot exist.
    #[error(
        "the photos fit only a camera that cannot exist: do not use a lens that shows more than about 100°, check the number \
         of corners, use a flat, stiff board, and show it also at the picture's edges"
    )]
    Impossible(#[from] ImpossibleCamera),
}

impl CalibrationRefusal {
    /// The refusal without the reasons of single photos, for a reader who has been shown them.
    pub fn without_photo_reasons(self) -> Self {
        match self {
            Self::Problem(problem) => Self::Problem(problem.without_photo_reasons()),
            other => other,
        }
    }
}

/// Calibrates the camera and checks it: the photos that were used are left out in groups, one group at a time. The spread
/// of these cameras (the grouped jackknife: Efron 1982, ch. 2) includes what the corners' noise does not show: boards
/// that are not flat, and a lens that the model does not describe.
///
/// # Errors
/// [`CalibrationRefusal`] if the photos do not determine a camera, or if parts of them give different ones.
pub fn calibrate_and_check(views: &Views, board: Board) -> Result<CheckedCalibration, CalibrationRefusal> {
    let Views { views, width, height } = views;
    let mut calibration = calibrate(views, *width, *height, board)?;
    check_camera(&calibration.camera)?;
    let used: Vec<&BoardView> =
        views.iter().zip(&calibration.photos).filter(|(_, photo)| photo.is_used()).map(|(view, _)| view).collect();
    if used.len() >= MIN_CHECKED_PHOTOS.max(MIN_PHOTOS + 1) {
        let groups = GROUPS.min(used.len());
        let without = |group: usize| {
            let kept = used.iter().enumerate().filter(|(place, _)| place % groups != group);
            let kept: Vec<BoardView> = kept.map(|(_, view)| (*view).clone()).collect();
            calibrate(&kept, *width, *height, board).ok()
        };
        widen(&mut calibration.sigma, &require_all((0..groups).map(without).collect())?);
    }
    refuse_unstable(&calibration)?;
    let at_edge = views.iter().map(|view| is_at_edge(view, *width, *height)).collect();
    Ok(CheckedCalibration { calibration, at_edge })
}

/// The cameras of the parts. A part that gives none cannot be left out of the spread, which would then be too small.
fn require_all(parts: Vec<Option<Calibration>>) -> Result<Vec<Calibration>, CalibrationRefusal> {
    let groups = parts.len();
    let parts: Vec<Calibration> = parts.into_iter().flatten().collect();
    match groups - parts.len() {
        0 => Ok(parts),
        failed => Err(CalibrationRefusal::PartFails { failed, groups }),
    }
}

fn refuse_unstable(calibration: &Calibration) -> Result<(), CalibrationRefusal> {
    let (camera, sigma) = (&calibration.camera, &calibration.sigma);
    let percent = 100.0 * (sigma.fx / camera.fx).max(sigma.fy / camera.fy);
    if percent > MAX_FOCAL_SPREAD_PERCENT { Err(CalibrationRefusal::Unstable { percent }) } else { Ok(()) }
}

/// Raises each standard deviation to that between the parts, if that is larger.
fn widen(sigma: &mut CameraSigma, parts: &[Calibration]) {
    let spread = |of: fn(&Calibration) -> f64| {
        let (count, values) = (parts.len() as f64, parts.iter().map(of));
        let mean = values.clone().sum::<f64>() / count;
        ((count - 1.0) / count * values.map(|value| (value - mean).powi(2)).sum::<f64>()).sqrt()
    };
    if parts.len() < 2 {
        return;
    }
    sigma.fx = sigma.fx.max(spread(|part| part.camera.fx));
    sigma.fy = sigma.fy.max(spread(|part| part.camera.fy));
    sigma.cx = sigma.cx.max(spread(|part| part.camera.cx));
    sigma.cy = sigma.cy.max(spread(|part| part.camera.cy));
    sigma.k1 = sigma.k1.max(spread(|part| part.camera.k1));
    sigma.k2 = sigma.k2.max(spread(|part| part.camera.k2));
    sigma.p1 = sigma.p1.max(spread(|part| part.camera.p1));
    sigma.p2 = sigma.p2.max(spread(|part| part.camera.p2));
    sigma.k3 = sigma.k3.max(spread(|part| part.camera.k3));
}

/// True if the photo shows several corners in the outermost cells of the picture.
fn is_at_edge(view: &BoardView, width: u32, height: u32) -> bool {
    let Ok(corners) = &view.corners else { return false };
    let outermost = |at: f64, size: u32, cells: usize| {
        let margin = f64::from(size) / cells as f64;
        at < margin || at > f64::from(size) - margin
    };
    let is_outermost = |corner: &&Pixel| {
        outermost(corner.u(), width, Coverage::COLUMNS) || outermost(corner.v(), height, Coverage::ROWS)
    };
    corners.iter().filter(is_outermost).count() >= MIN_EDGE_CORNERS
}

#[cfg(test)]
mod tests;
