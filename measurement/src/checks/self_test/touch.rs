//! Compares the rests of a tool with the corners of the board.
//!
//! In: [`Hold`]s and [`BoardPlacement`]s. Out: a [`Touch`] for each hold: the error of the point of contact in space,
//! or the reason why it does not count; and the [`TouchAccuracy`] over all touches that count. The touched corner is
//! the one nearest to the point of contact in the picture. An error in depth does not show in the picture, so this
//! choice does not make the result look better.

use nalgebra::{Matrix3, Point3, Vector3};

use super::contact::Rod;
use super::hold::Hold;
use super::limits::{MIN_TOUCHES, TOUCH_RMS_MM};
use super::{BoardPlacement, SelfTestEvidence};
use crate::checks::evaluation::CHI_SQUARE_95;
use crate::motion::features::hull;
use crate::vision::camera::{Board, Camera};
use crate::vision::covariance::PositionCovariance;
use crate::vision::space::CameraPoint;

/// Maximum distance of a point of contact from its corner in the picture, as a share of a square. Half would accept any
/// point; hands place a rod to about half a millimetre.
const MAX_CORNER_DISTANCE: f64 = 0.35;

/// A rest counts as above the board only if its height exceeds the others' by this many of their standard deviations.
/// The deviation is that of the majority that agrees best, which is half as wide as that of all rests: scattered errors
/// are the tracker's and count.
const OUTLIER_SIGMAS: f64 = 4.0;

/// A rest of a tool, with its measured error.
#[derive(Clone, Debug, PartialEq)]
pub struct Touch {
    /// The rest.
    pub hold: Hold,
    /// Its error, or why it does not count.
    pub outcome: Result<MeasuredTouch, UnusableReason>,
}

/// A touch that counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredTouch {
    /// Index of the board's placement, from 0.
    pub placement: usize,
    /// Column of the corner on the board, from 0.
    pub column: usize,
    /// Row of the corner on the board, from 0.
    pub row: usize,
    /// The corner in the camera frame, mm.
    pub corner_mm: Point3<f64>,
    /// Point of contact minus corner, camera frame, mm.
    pub error_mm: Vector3<f64>,
    /// The error along the line of sight, mm; positive if the tool seems farther away than it is.
    pub along_mm: f64,
    /// The error across the line of sight, mm.
    pub across_mm: f64,
    /// Whether the error lies within the tracker's stated 95 % region; `None` if the tracker stated none.
    pub is_inside: Option<bool>,
    /// Height of the point of contact above the board, mm.
    height_mm: f64,
    /// Stated standard deviation of the height, mm; 0 if none was stated.
    height_sigma_mm: f64,
    /// Height of the camera above the board, mm.
    camera_mm: f64,
}

/// Why a rest does not count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnusableReason {
    /// The board was not seen whole both before and after it.
    BoardNotSeen,
    /// The board lay elsewhere after the rest than before it.
    BoardMoved,
    /// The rod would come from below the board: the tracker took the tape's end at the hand for the tip.
    WrongWay,
    /// No corner is near.
    NoCornerNear,
    /// The tool was held above the board.
    AboveBoard,
}

/// The accuracy over all touches that count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TouchAccuracy {
    /// Touches that count.
    pub touches: usize,
    /// Root mean square of the errors in space, mm.
    pub rms_mm: f64,
    /// Root mean square along the line of sight, mm.
    pub along_rms_mm: f64,
    /// Root mean square across the line of sight, mm.
    pub across_rms_mm: f64,
    /// Mean along the line of sight, mm: the error that all touches share.
    pub along_mean_mm: f64,
    /// Largest error, mm.
    pub largest_mm: f64,
    /// Smallest and largest depth of the touched corners, mm.
    pub depth_mm: [f64; 2],
    /// Share of the picture between the touched corners (their convex hull).
    pub picture_share: f64,
    /// Touches within the tracker's stated 95 % region.
    pub inside: usize,
    /// Touches with a stated 95 % region.
    pub stated: usize,
}

impl TouchAccuracy {
    /// Do most touches lie inside the error bars that the tracker states?
    pub fn is_as_stated(&self) -> bool {
        2 * self.inside > self.touches
    }
}

/// Compares every rest with the board.
pub(super) fn measure_holds(
    holds: Vec<Hold>,
    placements: &[BoardPlacement],
    board: Board,
    given: &SelfTestEvidence<'_>,
) -> Vec<Touch> {
    let touch = |hold: Hold| Touch { outcome: measure_hold(&hold, placements, board, given), hold };
    let mut touches: Vec<Touch> = holds.into_iter().map(touch).collect();
    let measured: Vec<MeasuredTouch> = touches.iter().filter_map(|touch| touch.outcome.ok()).collect();
    if let Some(usual) = UsualHeight::of(&measured) {
        let hovers =
            touches.iter_mut().filter(|touch| touch.outcome.is_ok_and(|measured| usual.is_exceeded_by(&measured)));
        hovers.for_each(|touch| touch.outcome = Err(UnusableReason::AboveBoard));
    }
    touches
}

/// The height of most rests above the board, as a share of the camera's height.
///
/// A wrong diameter or focal length stretches the line of sight: a rod that rests on the board seems to lie above it
/// (or below) by a share of the camera's own height, and this share is the same at every rest. A tool held above the
/// board deviates from it. So the share of most rests is the box's error, and stays in the figure. A rest that lies
/// higher than that was no touch if the difference exceeds both the error of touches in a good box ([`TOUCH_RMS_MM`])
/// and its own error bar. A rest is never left out for lying too deep, since a rod cannot be held below a board.
struct UsualHeight {
    /// Mean height share of the rests that agree best: those in the shortest interval that holds more than half of all.
    share: f64,
    /// Standard deviation of these rests from the mean.
    scatter: f64,
}

impl UsualHeight {
    fn of(all: &[MeasuredTouch]) -> Option<Self> {
        let mut shares: Vec<f64> = all.iter().map(MeasuredTouch::height_share).collect();
        shares.sort_by(f64::total_cmp);
        let width = |of: &&[f64]| of[of.len() - 1] - of[0];
        let agreeing = shares.windows(shares.len() / 2 + 1).min_by(|a, b| width(a).total_cmp(&width(b)))?;
        let count = agreeing.len() as f64;
        let share = agreeing.iter().sum::<f64>() / count;
        let scatter = (agreeing.iter().map(|of| (of - share).powi(2)).sum::<f64>() / count).sqrt();
        Some(Self { share, scatter })
    }

    fn is_exceeded_by(&self, rest: &MeasuredTouch) -> bool {
        let above_mm = (rest.height_share() - self.share) * rest.camera_mm;
        let allowed_mm = TOUCH_RMS_MM.care.unwrap_or(0.0).hypot(CHI_SQUARE_95[0].sqrt() * rest.height_sigma_mm);
        above_mm > allowed_mm.max(OUTLIER_SIGMAS * self.scatter * rest.camera_mm)
    }
}

impl MeasuredTouch {
    fn height_share(&self) -> f64 {
        self.height_mm / self.camera_mm
    }
}

fn measure_hold(
    hold: &Hold,
    placements: &[BoardPlacement],
    board: Board,
    SelfTestEvidence { camera, tools, reach_mm, .. }: &SelfTestEvidence<'_>,
) -> Result<MeasuredTouch, UnusableReason> {
    let place = placements.iter().position(|placement| placement.spans(hold.from_s, hold.to_s));
    let index = place.ok_or_else(|| why_not_spanned(hold, placements))?;
    let placement = &placements[index];
    let spec = tools.get(hold.tool).ok_or(UnusableReason::NoCornerNear)?;
    let rod = Rod { radius_mm: 0.5 * spec.diameter_mm, reach_mm: *reach_mm };
    let normal = placement.normal();
    if hold.axis.dot(&normal) > 0.0 {
        return Err(UnusableReason::WrongWay);
    }
    let contact = rod.contact(hold.tip_mm, hold.axis, normal);
    let corner = nearest_corner(contact, placement, camera, board).ok_or(UnusableReason::NoCornerNear)?;
    let corner_mm = placement.corner_mm(board, corner);
    let (error_mm, sight) = (contact - corner_mm, corner_mm.coords.normalize());
    let along_mm = error_mm.dot(&sight);
    // Board and tip are measured with one focal length, whose error moves both alike.
    let by_camera = Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, camera.depth_variance_mm2(hold.tip_mm.z)));
    let stated = hold.covariance_mm2.map(|stated| PositionCovariance::from(stated.matrix() - by_camera));
    let is_inside = stated.map(|stated| stated.mahalanobis_squared(&error_mm) <= CHI_SQUARE_95[2]);
    Ok(MeasuredTouch {
        placement: index,
        column: corner % board.columns(),
        row: corner / board.columns(),
        corner_mm,
        error_mm,
        along_mm,
        across_mm: (error_mm - sight * along_mm).norm(),
        is_inside,
        height_mm: error_mm.dot(&normal),
        height_sigma_mm: stated.map_or(0.0, |stated| stated.sigma_along_mm(&normal)),
        camera_mm: -corner_mm.coords.dot(&normal),
    })
}

/// Why no placement spans a rest: the board moved, or was not seen before or after it.
fn why_not_spanned(hold: &Hold, placements: &[BoardPlacement]) -> UnusableReason {
    let before = placements.iter().any(|placement| placement.from_s <= hold.from_s);
    let after = placements.iter().any(|placement| placement.to_s >= hold.to_s);
    if before && after { UnusableReason::BoardMoved } else { UnusableReason::BoardNotSeen }
}

/// The corner nearest to a point in the picture, if it is close enough.
fn nearest_corner(point: Point3<f64>, placement: &BoardPlacement, camera: &Camera, board: Board) -> Option<usize> {
    let seen = camera.project(CameraPoint(point))?;
    let corners: Vec<_> = (0..board.corner_count())
        .map(|corner| camera.project(CameraPoint(placement.corner_mm(board, corner))))
        .collect::<Option<_>>()?;
    let distance = |corner: usize| (corners[corner].0 - seen.0).norm();
    let nearest = (0..corners.len()).min_by(|a, b| distance(*a).total_cmp(&distance(*b)))?;
    let column = nearest % board.columns();
    let along_row = if column + 1 < board.columns() { nearest + 1 } else { nearest - 1 };
    let along_column =
        if nearest + board.columns() < corners.len() { nearest + board.columns() } else { nearest - board.columns() };
    let square_px = [along_row, along_column].map(|beside| (corners[beside].0 - corners[nearest].0).norm());
    (distance(nearest) < MAX_CORNER_DISTANCE * square_px[0].min(square_px[1])).then_some(nearest)
}

/// The accuracy over all touches that count; `None` if they are too few.
pub(super) fn accuracy(touches: &[Touch], camera: &Camera) -> Option<TouchAccuracy> {
    let all: Vec<MeasuredTouch> = touches.iter().filter_map(|touch| touch.outcome.ok()).collect();
    if all.len() < MIN_TOUCHES {
        return None;
    }
    let count = all.len() as f64;
    let rms = |of: fn(&MeasuredTouch) -> f64| (all.iter().map(|m| of(m).powi(2)).sum::<f64>() / count).sqrt();
    let pixels: Vec<_> = all.iter().filter_map(|m| camera.project(CameraPoint(m.corner_mm))).map(|p| p.0).collect();
    let depths = all.iter().map(|m| m.corner_mm.z);
    Some(TouchAccuracy {
        touches: all.len(),
        rms_mm: rms(|m| m.error_mm.norm()),
        along_rms_mm: rms(|m| m.along_mm),
        across_rms_mm: rms(|m| m.across_mm),
        along_mean_mm: all.iter().map(|m| m.along_mm).sum::<f64>() / count,
        largest_mm: all.iter().map(|m| m.error_mm.norm()).fold(0.0, f64::max),
        depth_mm: [depths.clone().fold(f64::INFINITY, f64::min), depths.fold(0.0, f64::max)],
        picture_share: hull::area(&pixels) / f64::from(camera.width) / f64::from(camera.height),
        inside: all.iter().filter(|m| m.is_inside == Some(true)).count(),
        stated: all.iter().filter(|m| m.is_inside.is_some()).count(),
    })
}
