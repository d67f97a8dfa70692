//! Checks a single photo of a board while the photographer still holds the board: its corners, or what is wrong and
//! where.
//!
//! In: one luma plane and the board that was shown. Out: the corners, the side of the board that leans towards the
//! camera, and the parts of the picture that the board fills; or the reason why it was not found, the part that was
//! seen, and hints at the cause. Method: [`checkerboard`] decides; the hints come from the grey levels of the whole
//! picture and from the distance between the seen corners and the picture's edge. The nearer side of the board follows
//! from the lengths of its opposite sides. No camera is known yet, so the lens's distortion is first removed with one
//! coefficient: the one that makes a homography fit the corners best. The result is rough, and only meant for advice
//! such as "tilt it the other way".
//!
//! A single photo says nothing about accuracy; only all photos together do ([`super::calibrate()`]).

use nalgebra::{Point2, Vector2};

use super::checkerboard::{self, BoardNotFound, BoardReason};
use super::{Board, Coverage, initial};
use crate::vision::frame::Plane;
use crate::vision::space::Pixel;

/// A picture with a median below this is too dark to find a board, codes.
const DARK_MEDIAN_CODE: u8 = 36;
/// Codes from this value up count as overexposed.
const OVEREXPOSED_CODE: usize = 250;
/// A larger share of overexposed pixels may hide squares. A white sheet in good light stays below [`OVEREXPOSED_CODE`].
const MAX_OVEREXPOSED_SHARE: f64 = 0.12;
/// If the steepest edges climb by less than this share of the picture's contrast from one pixel to the next, nothing in
/// the picture is sharp.
const MIN_SHARPNESS: f64 = 0.12;
/// Share of neighbouring pixels that count as the steepest edges.
const STEEPEST_SHARE: f64 = 0.002;
/// The board is cut off at a side of the picture if its seen corners end within this distance, squares: the next corner
/// would lie outside, or nearly.
const CUT_OFF_DISTANCE_SQUARES: f64 = 1.3;
/// A board counts as tilted if the natural logarithm of the ratio of its opposite sides reaches this: about 8° at a
/// box's distances.
const MIN_TILT: f64 = 0.06;
/// Distortion coefficients `k` that are tried, as in `r / (1 + k r²)` with r = 1 in the picture's corner.
const TRIED_DISTORTIONS: [f64; 15] =
    [0.15, 0.1, 0.05, 0.0, -0.05, -0.1, -0.15, -0.2, -0.25, -0.3, -0.35, -0.4, -0.45, -0.5, -0.55];

/// A side of the picture, or of the board as it appears in the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureSide {
    /// Left.
    Left,
    /// Right.
    Right,
    /// Top.
    Top,
    /// Bottom.
    Bottom,
}

/// A possible cause of a board that was not found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hint {
    /// Too little light.
    Dark,
    /// Overexposed by the light or its reflection.
    Glare,
    /// The board is not sharp, or nothing in the picture is.
    Soft,
    /// A whole board of another size is seen, or one whose outer corners are hidden.
    Count,
    /// The board leaves the picture at this side.
    CutOff(PictureSide),
}

/// The result of checking one photo.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotoInspection {
    /// All inner corners, row by row; if there is a `reason`, only the corners that were seen, in no order.
    pub corners: Vec<Pixel>,
    /// Expected positions of corners that were not seen between the others.
    pub missing: Vec<Pixel>,
    /// Why the board was not found whole; `None` if it was.
    pub reason: Option<BoardReason>,
    /// Possible causes of the reason.
    pub hints: Vec<Hint>,
    /// The side of the board that is nearer to the camera; `None` if the board faces the camera, or was not found.
    pub near: Option<PictureSide>,
    /// Parts of the picture where a calibration would find corners in this photo.
    pub coverage: Coverage,
}

/// Checks one photo.
pub fn inspect_photo(photo: &Plane<'_>, board: Board) -> PhotoInspection {
    let coverage = |corners: &[Pixel]| Coverage::of(corners.iter(), photo.width as u32, photo.height as u32);
    let size = Vector2::new(photo.width as f64, photo.height as f64);
    match checkerboard::find_or_partial(photo, board) {
        Ok(corners) => {
            let (near, coverage) = (near_side(&corners, board, size), coverage(&corners));
            PhotoInspection { near, coverage, corners, missing: Vec::new(), reason: None, hints: Vec::new() }
        }
        Err(missed) => {
            let BoardNotFound { reason, seen, missing } = *missed;
            let hints = hints(photo, &reason, &seen);
            PhotoInspection { hints, coverage: coverage(&[]), corners: seen, missing, reason: Some(reason), near: None }
        }
    }
}

fn hints(photo: &Plane<'_>, reason: &BoardReason, seen: &[Pixel]) -> Vec<Hint> {
    let levels = GreyLevels::of(photo);
    let is_another_board = matches!(reason, BoardReason::OtherBoard { .. });
    let may_be_another = matches!(reason, BoardReason::Incomplete { may_be_whole: true, .. });
    let is_unseen = matches!(reason, BoardReason::NoBoard);
    let is_blurred = matches!(reason, BoardReason::Blurred { .. });
    let causes = [
        (Hint::Dark, levels.median < DARK_MEDIAN_CODE),
        (Hint::Glare, levels.overexposed > MAX_OVEREXPOSED_SHARE),
        (Hint::Soft, is_blurred || (is_unseen && levels.median >= DARK_MEDIAN_CODE && levels.steepest < MIN_SHARPNESS)),
    ];
    let of_light = causes.into_iter().filter(|(_, holds)| *holds && !is_another_board).map(|(hint, _)| hint);
    let of_count = (is_another_board || may_be_another).then_some(Hint::Count);
    let is_part = matches!(reason, BoardReason::Incomplete { .. } | BoardReason::Hidden(_) | BoardReason::Irregular);
    let of_edges = cut_off_sides(photo, if is_part { seen } else { &[] }).into_iter().map(Hint::CutOff);
    of_count.into_iter().chain(of_light).chain(of_edges).collect()
}

/// The sides of the picture where the seen part of the board is cut off.
fn cut_off_sides(photo: &Plane<'_>, seen: &[Pixel]) -> Vec<PictureSide> {
    let Some(square) = square_px(seen) else { return Vec::new() };
    let limit = CUT_OFF_DISTANCE_SQUARES * square;
    let least = |of: fn(&Pixel) -> f64| seen.iter().map(of).fold(f64::INFINITY, f64::min);
    let most = |of: fn(&Pixel) -> f64| seen.iter().map(of).fold(f64::NEG_INFINITY, f64::max);
    let sides = [
        (PictureSide::Left, least(Pixel::u)),
        (PictureSide::Right, photo.width as f64 - most(Pixel::u)),
        (PictureSide::Top, least(Pixel::v)),
        (PictureSide::Bottom, photo.height as f64 - most(Pixel::v)),
    ];
    sides.into_iter().filter(|(_, distance)| *distance < limit).map(|(edge, _)| edge).collect()
}

/// Median distance of a corner to its nearest neighbour.
fn square_px(corners: &[Pixel]) -> Option<f64> {
    let nearest = |one: &Pixel| {
        let others = corners.iter().map(|other| (other.0 - one.0).norm()).filter(|distance| *distance > 0.0);
        others.fold(f64::INFINITY, f64::min)
    };
    let mut distances: Vec<f64> = corners.iter().map(nearest).filter(|distance| distance.is_finite()).collect();
    distances.sort_by(f64::total_cmp);
    distances.get(distances.len() / 2).copied()
}

/// Grey levels of a whole picture.
struct GreyLevels {
    median: u8,
    /// Share of overexposed pixels.
    overexposed: f64,
    /// Difference between neighbouring pixels at the steepest edges, as a share of the contrast.
    steepest: f64,
}

impl GreyLevels {
    fn of(photo: &Plane<'_>) -> Self {
        let (mut codes, mut steps) = ([0_usize; 256], [0_usize; 256]);
        for y in 0..photo.height {
            let row = photo.row(y);
            row.iter().for_each(|&code| codes[usize::from(code)] += 1);
            row.windows(2).for_each(|pair| steps[usize::from(pair[0].abs_diff(pair[1]))] += 1);
        }
        let contrast = f64::from(quantile(&codes, 0.98) - quantile(&codes, 0.02)).max(1.0);
        let all = codes.iter().sum::<usize>().max(1) as f64;
        Self {
            median: quantile(&codes, 0.5),
            overexposed: codes[OVEREXPOSED_CODE..].iter().sum::<usize>() as f64 / all,
            steepest: f64::from(quantile(&steps, 1.0 - STEEPEST_SHARE)) / contrast,
        }
    }
}

/// The code that this share of the pixels does not exceed.
fn quantile(counts: &[usize; 256], share: f64) -> u8 {
    let most = share * counts.iter().sum::<usize>() as f64;
    let mut sum = 0;
    let reached = counts.iter().position(|count| {
        sum += count;
        sum as f64 >= most
    });
    reached.unwrap_or(255) as u8
}

/// The side of the board that leans towards the camera: the squares are largest there.
fn near_side(corners: &[Pixel], board: Board, size: Vector2<f64>) -> Option<PictureSide> {
    let straight = without_distortion(corners, board, size)?;
    let (columns, last) = (board.columns(), straight.len().checked_sub(board.columns())?);
    let [a, b] = [straight.first()?, straight.get(columns - 1)?];
    let [c, d] = [straight.get(last)?, straight.last()?];
    let ratio = |long: Vector2<f64>, short: Vector2<f64>| (long.norm() / short.norm()).ln();
    // Two vectors in the picture, first row to last row and first column to last column; the length of each is how much
    // the squares grow on the way.
    let down = ((c.coords + d.coords) - (a.coords + b.coords)).try_normalize(0.0)? * ratio(d - c, b - a);
    let across = ((b.coords + d.coords) - (a.coords + c.coords)).try_normalize(0.0)? * ratio(d - b, c - a);
    let grows = down + across;
    match (grows.norm() >= MIN_TILT, grows.x.abs() > grows.y.abs()) {
        (false, _) => None,
        (true, true) => Some(if grows.x > 0.0 { PictureSide::Right } else { PictureSide::Left }),
        (true, false) => Some(if grows.y > 0.0 { PictureSide::Bottom } else { PictureSide::Top }),
    }
}

/// The corners without the lens's distortion, estimated with one coefficient.
fn without_distortion(corners: &[Pixel], board: Board, size: Vector2<f64>) -> Option<Vec<Point2<f64>>> {
    let centre = (size - Vector2::repeat(1.0)) / 2.0;
    let points = board.points_mm();
    let bent_back = |k: f64| -> Vec<Pixel> {
        let straight = |corner: &Pixel| {
            let from = corner.0.coords - centre;
            Pixel((centre + from / (1.0 + k * from.norm_squared() / centre.norm_squared())).into())
        };
        corners.iter().map(straight).collect()
    };
    let tried = TRIED_DISTORTIONS.iter().filter_map(|&k| {
        let straight = bent_back(k);
        Some((homography_error(&points, &straight)?, straight))
    });
    let best = tried.min_by(|(a, _), (b, _)| a.total_cmp(b))?.1;
    Some(best.into_iter().map(|pixel| pixel.0).collect())
}

/// Squared error of the best homography, relative to the spread of the points.
fn homography_error(points: &[Point2<f64>], seen: &[Pixel]) -> Option<f64> {
    let homography = initial::homography(points, seen)?;
    let middle = seen.iter().map(|pixel| pixel.0.coords).sum::<Vector2<f64>>() / seen.len() as f64;
    let (mut missed, mut spread) = (0.0, 0.0);
    for (point, pixel) in points.iter().zip(seen) {
        let at = homography * point.to_homogeneous();
        missed += (at.xy() / at.z - pixel.0.coords).norm_squared();
        spread += (pixel.0.coords - middle).norm_squared();
    }
    (missed / spread).is_finite().then_some(missed / spread)
}

#[cfg(test)]
mod tests;
