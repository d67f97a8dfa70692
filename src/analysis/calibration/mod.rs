//! Finds the board in photos or in a video, calibrates the camera, and checks its uncertainty against parts of the set.
//!
//! The command line and the service's confined child both use this; they only add where the bytes come from.

use std::io::{BufRead, Read, Seek};

use crate::domain::camera_warning::MIN_CHECKED_PHOTOS;
use crate::media::{MediaError, MediaLimits, VideoFile, photo};
use crate::vision::camera::checkerboard;
use crate::vision::camera::report::CameraSigma;
use crate::vision::camera::view_picker::ViewPicker;
use crate::vision::camera::{Board, BoardView, Calibration, CalibrationProblem, Coverage, MIN_PHOTOS, calibrate};
use crate::vision::space::Pixel;

/// Most photos of one calibration; 40 are plenty.
pub const MAX_PHOTOS: usize = 500;

/// The board in each photo or chosen frame, and their common picture size.
#[derive(Clone, Debug, PartialEq)]
pub struct Views {
    /// One view per photo, or per chosen frame.
    pub views: Vec<BoardView>,
    /// Width of every photo, pixels.
    pub width: u32,
    /// Height of every photo, pixels.
    pub height: u32,
}

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

/// Why photos or a video give no views.
#[derive(Debug, thiserror::Error)]
pub enum ViewsError {
    /// No photo was given, or too many.
    #[error("{0} photos given; give 3 to {MAX_PHOTOS}, best about 20 with the board tilted to different sides")]
    Count(usize),
    /// A photo cannot be read.
    #[error("photo {name}: {source}")]
    Photo {
        /// The photo's name.
        name: String,
        /// Why it cannot be read.
        source: MediaError,
    },
    /// A photo has another size than the first.
    #[error(
        "photo {name} is {}×{}, {first_name} is {}×{}: a camera is calibrated at the picture size of its recordings; \
         give only photos of that size",
        size.0, size.1, first_size.0, first_size.1
    )]
    SizeDiffers {
        /// The photo that differs.
        name: String,
        /// Its width and height.
        size: (u32, u32),
        /// Name of the first photo.
        first_name: String,
        /// Its width and height.
        first_size: (u32, u32),
    },
    /// A photo is turned or mirrored for display in another way than the first. A camera's centre is not in the middle of its
    /// picture, so a photo that is turned by itself shows another camera.
    #[error(
        "the photos' orientation tags differ: photo {name} has EXIF {turn}, {first_name} has EXIF {first_turn}; hold the \
         camera the same way for all photos, as it is for recordings, or remove the tag from photos whose pixels are \
         right as stored"
    )]
    TurnDiffers {
        /// The photo that differs.
        name: String,
        /// Its EXIF orientation, 1 to 8.
        turn: u8,
        /// Name of the first photo.
        first_name: String,
        /// Its EXIF orientation.
        first_turn: u8,
    },
    /// The video cannot be read.
    #[error("video {name}: {source}")]
    Video {
        /// The video's name.
        name: String,
        /// Why it cannot be read.
        source: MediaError,
    },
}

/// Whether a file with these first bytes is a photo.
pub fn is_photo(first_bytes: &[u8]) -> bool {
    photo::is_photo(first_bytes)
}

/// Looks for the board in each photo, in order; calls `done` after each.
pub fn views_of_photos<R: BufRead + Seek>(
    photos: impl ExactSizeIterator<Item = (String, R)>,
    board: Board,
    limits: MediaLimits,
    mut done: impl FnMut(&BoardView),
) -> Result<Views, ViewsError> {
    let count = photos.len();
    if count == 0 || count > MAX_PHOTOS {
        return Err(ViewsError::Count(count));
    }
    let mut views: Vec<BoardView> = Vec::with_capacity(count);
    let (mut first_size, mut first_turn) = (None, None);
    for (name, bytes) in photos {
        let luma =
            photo::read_luma(bytes, limits).map_err(|source| ViewsError::Photo { name: name.clone(), source })?;
        let turn = luma.orientation().to_exif();
        let first = *first_turn.get_or_insert(turn);
        if let Some(first_view) = views.first().filter(|_| first != turn) {
            let first_name = first_view.name.clone();
            return Err(ViewsError::TurnDiffers { name, turn, first_name, first_turn: first });
        }
        let size = (luma.width(), luma.height());
        let first = *first_size.get_or_insert(size);
        if let Some(first_view) = views.first().filter(|_| first != size) {
            return Err(ViewsError::SizeDiffers { name, size, first_name: first_view.name.clone(), first_size: first });
        }
        let view = BoardView { name, corners: checkerboard::find(&luma.plane(), board) };
        done(&view);
        views.push(view);
    }
    let (width, height) = first_size.ok_or(ViewsError::Count(0))?;
    Ok(Views { views, width, height })
}

/// Picks sharp and different views of the board from a video. Calls `done` after each decoded frame with the number of
/// frames so far and, if known, in all.
pub fn views_of_video(
    name: &str,
    video: impl Read + Seek + Send + 'static,
    board: Board,
    limits: MediaLimits,
    mut done: impl FnMut(u64, Option<u64>),
) -> Result<Views, ViewsError> {
    let failed = |source| ViewsError::Video { name: name.to_owned(), source };
    let mut file = VideoFile::open(video, limits).map_err(failed)?;
    let expected = file.info().frames_expected;
    let mut film = ViewPicker::new(board, expected);
    let (mut width, mut height) = (0, 0);
    while let Some(picture) = file.next_picture().map_err(failed)? {
        let frame = picture.frame();
        (width, height) = (frame.width() as u32, frame.height() as u32); // bounded by the limits
        film.add_frame(|| format!("frame {} ({:.2} s)", frame.index, frame.time_s), &frame.y);
        done(frame.index + 1, expected);
    }
    Ok(Views { views: film.into_views(), width, height })
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Rotation3, Vector3};
    use rand::rngs::SmallRng;
    use rand::{RngExt, SeedableRng};

    use super::*;
    use crate::vision::camera::Camera;

    const SIZE: (u32, u32) = (960, 600);

    fn board() -> Board {
        Board::new(9, 6, 24.0).unwrap()
    }

    /// Corners of a flat board in 24 poses, some of them far from the centre of the picture, with a noise of 0.05 px.
    /// `look` gives the pixel of a point in space, mm.
    fn photos(look: impl Fn(Vector3<f64>) -> Pixel) -> Views {
        let mut random = SmallRng::seed_from_u64(5);
        let mut noise = || random.random_range(-0.087..0.087); // 0.05 px RMS
        let mut view = |n: u32| {
            let angle = [0.0, 20.0, 30.0, 36.0_f64][n as usize % 4].to_radians();
            let turn = f64::from(n) * 0.81;
            let direction =
                Vector3::new(angle.sin() * turn.cos(), angle.sin() * turn.sin() * 0.7, angle.cos()).normalize();
            let tilt = Vector3::new((f64::from(n) * 1.7).sin(), (f64::from(n) * 2.3).cos(), 0.2) * 0.45;
            let rotation = Rotation3::new(tilt);
            let middle = Vector3::new(96.0, 60.0, 0.0);
            let corner = |point: &nalgebra::Point2<f64>| {
                let pixel = look(rotation * (Vector3::new(point.x, point.y, 0.0) - middle) + direction * 420.0);
                Pixel::new(pixel.u() + noise(), pixel.v() + noise())
            };
            BoardView { name: format!("{n}"), corners: Ok(board().points_mm().iter().map(corner).collect()) }
        };
        let inside = |view: &BoardView| {
            let (width, height) = (f64::from(SIZE.0), f64::from(SIZE.1));
            let is_in = |corner: &Pixel| (0.0..width).contains(&corner.u()) && (0.0..height).contains(&corner.v());
            view.corners.as_ref().unwrap().iter().all(is_in)
        };
        let views: Vec<BoardView> = (0..60).map(&mut view).filter(inside).take(24).collect();
        assert_eq!(views.len(), 24);
        Views { views, width: SIZE.0, height: SIZE.1 }
    }

    /// A lens as the model describes it.
    fn usual(point: Vector3<f64>) -> Pixel {
        let (width, height) = SIZE;
        let (fx, fy, cx, cy) = (560.0, 560.0, 478.0, 301.0);
        let camera =
            Camera { width, height, fx, fy, cx, cy, k1: -0.2, k2: 0.05, p1: 0.0, p2: 0.0, k3: 0.0, focal_sigma: 0.0 };
        camera.project(crate::vision::space::CameraPoint(Point3::from(point))).unwrap()
    }

    /// A lens that shifts each pixel by a wave of 0.6 px: smooth, and unlike any distortion of the model.
    fn wavy(point: Vector3<f64>) -> Pixel {
        let pixel = usual(point);
        let wave = |at: f64| 0.6 * (at / 90.0).sin();
        Pixel::new(pixel.u() + wave(pixel.v()), pixel.v() + wave(pixel.u()))
    }

    /// Every second photo.
    fn half(views: &Views, first: usize) -> Views {
        Views { views: views.views.iter().skip(first).step_by(2).cloned().collect(), ..*views }
    }

    /// Difference of the halves' focal lengths, in units of what the halves state.
    fn halves_differ(views: &Views, calibrate_half: impl Fn(&Views) -> Calibration) -> f64 {
        let [a, b] = [0, 1].map(|first| calibrate_half(&half(views, first)));
        (a.camera.fx - b.camera.fx).abs() / a.sigma.fx.hypot(b.sigma.fx)
    }

    #[test]
    fn the_stated_uncertainty_holds_between_the_halves_of_a_set() {
        let by_noise = |views: &Views| calibrate(&views.views, SIZE.0, SIZE.1, board()).unwrap();
        let checked = |views: &Views| calibrate_and_check(views, board()).unwrap().calibration;
        let of_wave = photos(wavy);
        let ratio = checked(&of_wave).sigma.fx / by_noise(&of_wave).sigma.fx;
        assert!(ratio > 1.5, "a lens beside the model is less certain than the noise says: {ratio}");
        assert!(halves_differ(&of_wave, checked) < 2.5, "{}", halves_differ(&of_wave, checked));
        let clean = photos(usual);
        let ratio = checked(&clean).sigma.fx / by_noise(&clean).sigma.fx;
        assert!((1.0..2.0).contains(&ratio), "clean photos keep their uncertainty: {ratio}");
        assert!((checked(&clean).camera.fx - 560.0).abs() < 3.0 * checked(&clean).sigma.fx);
    }

    #[test]
    fn photos_whose_parts_give_other_cameras_are_refused() {
        let clean = photos(usual);
        let mut calibration = calibrate_and_check(&clean, board()).unwrap().calibration;
        assert_eq!(refuse_unstable(&calibration), Ok(()));
        let part = |fx: f64| Calibration { camera: Camera { fx, ..calibration.camera }, ..calibration.clone() };
        let parts = [part(500.0), part(620.0)];
        widen(&mut calibration.sigma, &parts);
        assert!((calibration.sigma.fx - 60.0).abs() < 1e-9, "the jackknife of two groups: {:?}", calibration.sigma);
        let refused = refuse_unstable(&calibration).unwrap_err();
        assert!(refused.to_string().contains("uncertain by 11 % (limit 5 %)"), "{refused}");
        let few = Views { views: clean.views[..MIN_CHECKED_PHOTOS - 1].to_vec(), ..clean };
        assert!(calibrate_and_check(&few, board()).is_ok(), "so few photos cannot be checked; a warning says so");
    }

    #[test]
    fn a_part_that_gives_no_camera_refuses_the_set() {
        let clean = photos(usual);
        let part = calibrate_and_check(&clean, board()).unwrap().calibration;
        assert_eq!(require_all(vec![Some(part.clone()), Some(part.clone())]).unwrap().len(), 2);
        let refused = require_all(vec![Some(part.clone()), None, Some(part)]).unwrap_err();
        assert_eq!(refused, CalibrationRefusal::PartFails { failed: 1, groups: 3 });
    }

    #[test]
    fn photos_at_the_edge_are_known() {
        let views = photos(usual);
        let at_edge = calibrate_and_check(&views, board()).unwrap().at_edge;
        assert_eq!(at_edge.len(), views.views.len());
        assert!(at_edge.contains(&true) && at_edge.contains(&false), "{at_edge:?}");
        let wall = BoardView { name: "wall".into(), corners: Err(checkerboard::BoardReason::NoBoard) };
        assert!(!is_at_edge(&wall, 960, 600));
    }
}
