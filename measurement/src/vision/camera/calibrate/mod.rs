//! Calibrates a camera from photos of a board: start values, refinement, and leaving out photos that do not fit.
//!
//! In: the corners found in each photo. Out: [`Calibration`], or the [`CalibrationProblem`]. Method: all photos are
//! refined together; then the photo that fits worst is tested: it is left out if the camera of the *other* photos
//! explains it far worse than it explains them. The test excludes the photo itself, because a bent board distorts the
//! fitted camera and so hides its own bend. This repeats until every photo fits. A photo that was left out early, when
//! another bad photo still spoiled the camera, is taken back at the end if it fits after all.

use std::collections::BTreeMap;
use std::mem::{Discriminant, discriminant};

use nalgebra::{Point2, Vector3};

use super::bent_board::fit_bulge;
use super::refine::{self, CameraFit, PosedPhoto};
use super::report::{
    BoardView, Calibration, CalibrationProblem, CameraSigma, CornerCounts, Coverage, PhotoReason, PhotoReport,
};
use super::{Board, Camera, initial};
use crate::vision::camera::checkerboard::BoardReason;
use crate::vision::space::Pixel;

/// Minimum of photos for a calibration; two would do on paper, but a bad photo would go unnoticed.
pub const MIN_PHOTOS: usize = 3;

/// Minimum of photos that must show a board of the same other size before that size is proposed.
const MIN_PHOTOS_OF_SIZE: usize = 2;

/// A photo is left out if it fits worse than the others' median by this factor …
const MISFIT_FACTOR: f64 = 3.0;
/// … and by at least this much, px: smaller differences are explained by corner noise and the board's print.
const MISFIT_PX: f64 = 0.25;

/// The board's tilt must differ by this much between photos, degrees; with parallel boards, focal length and distance
/// cannot be separated.
const MIN_TURN_DEG: f64 = 5.0;

/// Maximum standard deviation of the focal length, percent; a less certain calibration is refused.
const MAX_FOCAL_SIGMA_PERCENT: f64 = 5.0;

/// A photo is reported as bent if a curved board reduces its RMS error to this share of the flat board's.
const BENT_RMS_SHARE: f64 = 0.5;

/// Calibrates a camera of this picture size from the corners found in photos of the board.
///
/// # Errors
/// [`CalibrationProblem`] if the photos are too few, too alike or contradictory.
pub fn calibrate(
    views: &[BoardView],
    width: u32,
    height: u32,
    board: Board,
) -> Result<Calibration, CalibrationProblem> {
    let points = board.points_mm();
    let found = views_with_corners(views, board)?;
    let (camera, photos) = initial_estimate(&points, &found, width, height)?;
    let outcome = PhotoSelection::of(&points, camera, photos)?;
    check_turns(&outcome.fit)?;
    check_focal_length(&outcome.fit)?;
    Ok(report(views, &points, board, outcome))
}

/// The photos with corners, each with its index in the list of views.
type FoundCorners<'a> = Vec<(usize, &'a [Pixel])>;

fn views_with_corners(views: &[BoardView], board: Board) -> Result<FoundCorners<'_>, CalibrationProblem> {
    let mut found = FoundCorners::new();
    for (index, view) in views.iter().enumerate() {
        let Ok(corners) = &view.corners else { continue };
        if corners.len() != board.corner_count() {
            let name = view.name.clone();
            return Err(CalibrationProblem::Corners { name, found: corners.len(), expected: board.corner_count() });
        }
        found.push((index, corners));
    }
    if found.len() < MIN_PHOTOS { Err(too_few(views, board, found.len())) } else { Ok(found) }
}

fn too_few(views: &[BoardView], board: Board, found: usize) -> CalibrationProblem {
    let reasons: Vec<&PhotoReason> = views.iter().filter_map(|view| view.corners.as_ref().err()).collect();
    let frequency = |reason: &PhotoReason| reasons.iter().filter(|other| kind(other) == kind(reason)).count();
    let common = reasons.iter().rev().max_by_key(|reason| frequency(reason)).map(|&reason| Box::new(reason.clone()));
    let other = if found == 0 { size_shown(&reasons) } else { None };
    CalibrationProblem::TooFewPhotos { board: board.into(), found, given: views.len(), other, common }
}

/// What a reason says, without its numbers.
fn kind(reason: &PhotoReason) -> (Discriminant<PhotoReason>, Option<Discriminant<BoardReason>>) {
    let of_board = if let PhotoReason::NoCorners(reason) = reason { Some(discriminant(reason)) } else { None };
    (discriminant(reason), of_board)
}

/// The size that more than half of the photos with a part of a board show without a gap, at least
/// [`MIN_PHOTOS_OF_SIZE`]. Boards that are hidden or cut off are so by another amount in each photo.
fn size_shown(reasons: &[&PhotoReason]) -> Option<CornerCounts> {
    let (mut with_board, mut sizes) = (0, BTreeMap::<CornerCounts, usize>::new());
    for reason in reasons {
        let PhotoReason::NoCorners(reason) = reason else { continue };
        with_board += usize::from(*reason != BoardReason::NoBoard);
        if let BoardReason::OtherBoard { columns, rows }
        | BoardReason::Incomplete { columns, rows, is_regular: true, .. } = *reason
        {
            *sizes.entry(CornerCounts { columns, rows }).or_default() += 1;
        }
    }
    let (size, photos) = sizes.into_iter().max_by_key(|(_, photos)| *photos)?;
    (photos >= MIN_PHOTOS_OF_SIZE && 2 * photos > with_board).then_some(size)
}

/// A photo with a pose, and its index in the list of views.
#[derive(Clone, Debug)]
struct CandidatePhoto<'a> {
    index: usize,
    posed: PosedPhoto<'a>,
}

fn initial_estimate<'a>(
    points: &[Point2<f64>],
    found: &FoundCorners<'a>,
    width: u32,
    height: u32,
) -> Result<(Camera, Vec<CandidatePhoto<'a>>), CalibrationProblem> {
    let homographies: Option<Vec<_>> = found.iter().map(|(_, seen)| initial::homography(points, seen)).collect();
    let homographies = homographies.ok_or(CalibrationProblem::Contradiction)?;
    let camera = initial::camera(&homographies, width, height);
    let candidate = |(&(index, seen), h): (&(usize, &'a [Pixel]), _)| {
        Some(CandidatePhoto { index, posed: PosedPhoto { seen, pose: initial::pose(&camera, h)? } })
    };
    let candidates: Option<Vec<_>> = found.iter().zip(&homographies).map(candidate).collect();
    Ok((camera, candidates.ok_or(CalibrationProblem::Contradiction)?))
}

/// The photos that agree on a camera, that camera, and the photos that were left out.
struct PhotoSelection<'a> {
    used: Vec<usize>,
    fit: CameraFit<'a>,
    left_out: Vec<CandidatePhoto<'a>>,
}

impl<'a> PhotoSelection<'a> {
    fn of(
        points: &[Point2<f64>],
        camera: Camera,
        candidates: Vec<CandidatePhoto<'a>>,
    ) -> Result<Self, CalibrationProblem> {
        let used = candidates.iter().map(|c| c.index).collect();
        let fit = refined(points, camera, candidates.into_iter().map(|c| c.posed).collect())?;
        let mut selection = Self { used, fit, left_out: Vec::new() };
        while selection.leave_out_worst(points)? {}
        selection.take_back_fitting(points)?;
        Ok(selection)
    }

    /// Tests the photo that fits worst; returns true if it was left out.
    fn leave_out_worst(&mut self, points: &[Point2<f64>]) -> Result<bool, CalibrationProblem> {
        if self.used.len() <= MIN_PHOTOS {
            return Ok(false);
        }
        let each = self.rms_each(points);
        let Some(worst) = (0..each.len()).max_by(|&a, &b| each[a].total_cmp(&each[b])) else { return Ok(false) };
        let mut others = self.fit.photos.clone();
        let suspect = others.remove(worst);
        let fit = refined(points, self.fit.camera, others)?;
        let own = refine::refine_pose(points, &fit.camera, suspect.clone());
        let own_rms = own.as_ref().map_or(f64::INFINITY, |p| rms_of(points, &fit.camera, p));
        let index = self.used[worst];
        let without = Self { used: [&self.used[..worst], &self.used[worst + 1..]].concat(), fit, left_out: Vec::new() };
        if !is_misfit(own_rms, &without.rms_each(points)) {
            return Ok(false);
        }
        let mut left_out = std::mem::take(&mut self.left_out);
        left_out.push(CandidatePhoto { index, posed: own.unwrap_or(suspect) });
        *self = Self { left_out, ..without };
        Ok(true)
    }

    /// Takes back the photos that fit the final camera after all.
    fn take_back_fitting(&mut self, points: &[Point2<f64>]) -> Result<(), CalibrationProblem> {
        let each = self.rms_each(points);
        let camera = self.fit.camera;
        let refitted = std::mem::take(&mut self.left_out).into_iter().map(|c| {
            let posed = refine::refine_pose(points, &camera, c.posed.clone()).unwrap_or(c.posed);
            CandidatePhoto { posed, ..c }
        });
        let (left_out, back): (Vec<_>, Vec<_>) =
            refitted.partition(|c| is_misfit(rms_of(points, &camera, &c.posed), &each));
        self.left_out = left_out;
        if !back.is_empty() {
            let mut photos = self.fit.photos.clone();
            for candidate in back {
                self.used.push(candidate.index);
                photos.push(candidate.posed);
            }
            self.fit = refined(points, camera, photos)?;
        }
        Ok(())
    }

    fn rms_each(&self, points: &[Point2<f64>]) -> Vec<f64> {
        self.fit.photos.iter().map(|p| rms_of(points, &self.fit.camera, p)).collect()
    }
}

fn refined<'a>(
    points: &[Point2<f64>],
    camera: Camera,
    photos: Vec<PosedPhoto<'a>>,
) -> Result<CameraFit<'a>, CalibrationProblem> {
    refine::refine_all(points, camera, photos).ok_or(CalibrationProblem::Contradiction)
}

fn rms_of(points: &[Point2<f64>], camera: &Camera, photo: &PosedPhoto<'_>) -> f64 {
    refine::corner_residuals(points, camera, photo).map_or(f64::INFINITY, |m| refine::rms(&m))
}

fn is_misfit(rms_px: f64, others: &[f64]) -> bool {
    let mut others = others.to_vec();
    others.sort_by(f64::total_cmp);
    let median = others.get(others.len() / 2).copied().unwrap_or(f64::INFINITY);
    rms_px > MISFIT_FACTOR * median && rms_px > median + MISFIT_PX
}

fn check_turns(fit: &CameraFit<'_>) -> Result<(), CalibrationProblem> {
    let normals: Vec<Vector3<f64>> = fit.photos.iter().map(|p| p.pose.rotation * Vector3::z()).collect();
    let angles = normals.iter().flat_map(|a| normals.iter().map(move |b| a.angle(b)));
    let widest_deg = angles.fold(0.0, f64::max).to_degrees();
    if widest_deg < MIN_TURN_DEG { Err(CalibrationProblem::SamePose { widest_deg }) } else { Ok(()) }
}

fn check_focal_length(fit: &CameraFit<'_>) -> Result<(), CalibrationProblem> {
    let relative = |i: usize, f: f64| 100.0 * fit.covariance[(i, i)].sqrt() / f;
    let percent = relative(0, fit.camera.fx).max(relative(1, fit.camera.fy));
    let sensible = fit.camera.fx > 0.0 && fit.camera.fy > 0.0;
    match percent {
        _ if !sensible => Err(CalibrationProblem::Contradiction),
        percent if percent <= MAX_FOCAL_SIGMA_PERCENT => Ok(()),
        percent => Err(CalibrationProblem::Undetermined { percent }),
    }
}

fn report(views: &[BoardView], points: &[Point2<f64>], board: Board, outcome: PhotoSelection<'_>) -> Calibration {
    let PhotoSelection { used, fit, left_out } = outcome;
    let mut photos: Vec<PhotoReport> = views
        .iter()
        .map(|view| PhotoReport { name: view.name.clone(), rms_px: None, reason: view.corners.as_ref().err().cloned() })
        .collect();
    for (index, photo) in used.into_iter().zip(&fit.photos) {
        photos[index].rms_px = Some(rms_of(points, &fit.camera, photo));
    }
    for candidate in &left_out {
        photos[candidate.index].rms_px = Some(rms_of(points, &fit.camera, &candidate.posed));
        photos[candidate.index].reason = Some(reason_left_out(points, board, &fit, &candidate.posed));
    }
    let all: Vec<_> =
        fit.photos.iter().filter_map(|p| refine::corner_residuals(points, &fit.camera, p)).flatten().collect();
    let corners = fit.photos.iter().flat_map(|p| p.seen);
    Calibration {
        coverage: Coverage::of(corners, fit.camera.width, fit.camera.height),
        camera: fit.camera,
        board,
        rms_px: refine::rms(&all),
        photos,
        sigma: sigma(&fit),
    }
}

fn sigma(fit: &CameraFit<'_>) -> CameraSigma {
    let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = std::array::from_fn(|i| fit.covariance[(i, i)].sqrt());
    CameraSigma { fx, fy, cx, cy, k1, k2, p1, p2, k3 }
}

/// Why a photo does not fit: a bent board, one bad corner, or all corners.
fn reason_left_out(points: &[Point2<f64>], board: Board, fit: &CameraFit<'_>, photo: &PosedPhoto<'_>) -> PhotoReason {
    let misses = refine::corner_residuals(points, &fit.camera, photo).unwrap_or_default();
    let rms_px = refine::rms(&misses);
    let bent = fit_bulge(points, &fit.camera, photo).filter(|b| b.rms_px < BENT_RMS_SHARE * rms_px);
    if let Some(bulge) = bent {
        return PhotoReason::Bent { bulge_mm: bulge.height_mm };
    }
    let worst = misses.iter().map(|m| m.norm()).enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
    match worst {
        Some((index, off_px)) if off_px > 6.0 * refine::robust_sigma(&misses) => {
            PhotoReason::CornerOff { column: index % board.columns() + 1, row: index / board.columns() + 1, off_px }
        }
        _ => PhotoReason::Misfit { rms_px },
    }
}

#[cfg(test)]
mod tests;
