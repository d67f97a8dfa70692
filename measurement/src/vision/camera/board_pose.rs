//! The pose of a board in front of a known camera, and whether the lens still matches the calibration.
//!
//! In: inner corners, pixels, in the order of [`Board::points_mm`]. Out: the board's pose, mm, the reprojection error
//! of its corners, and the change of the focal length since the calibration. Method: a homography of the undistorted
//! corners, refined on the reprojection error with the camera held fixed ([`super::refine`]); for the focal length one
//! more factor, common to all boards, by Gauss–Newton.
//!
//! A board that faces the camera hides a zoom: the board could as well be nearer. Only the perspective across a tilted
//! board and the lens's distortion, which does not scale with the picture, reveal it. So the factor has its own
//! standard deviation.

use nalgebra::{Isometry3, Matrix6, Point2, Vector2, Vector6};

use super::refine::{self, PosedPhoto};
use super::{Board, Camera, initial};
use crate::vision::space::Pixel;

/// Maximum steps of the minimisation; from nearly the right focal length it needs about four.
const MAX_STEPS: usize = 20;

/// A board with its pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedBoard {
    /// Pose, mm: x along the rows, y along the columns, z through the board away from the camera.
    pub camera_from_board: Isometry3<f64>,
    /// Root mean square distance between seen and expected corners, px (as OpenCV counts it).
    pub rms_px: f64,
}

/// The estimated change of the focal length against the stored camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FocalChange {
    /// Share of the camera's focal length: 0.01 if the lens is 1 % longer than the camera states.
    pub share: f64,
    /// Standard deviation of the share, from the residuals of the corners.
    pub sigma: f64,
}

/// The pose of a board; `None` if the corners cannot be those of this board in front of this camera.
pub fn locate(camera: &Camera, board: Board, corners: &[Pixel]) -> Option<PlacedBoard> {
    let points = board.points_mm();
    if corners.len() != points.len() {
        return None;
    }
    let pose = initial_pose(camera, &points, corners)?;
    let placed = refine::refine_pose(&points, camera, PosedPhoto { seen: corners, pose })?;
    let rms_px = refine::rms(&refine::corner_residuals(&points, camera, &placed)?);
    rms_px.is_finite().then_some(PlacedBoard { camera_from_board: placed.pose, rms_px })
}

/// The change of the focal length that explains the corners of all views best; `None` without a finite answer.
pub fn focal_change(camera: &Camera, board: Board, views: &[Vec<Pixel>]) -> Option<FocalChange> {
    let points = board.points_mm();
    let mut poses = views.iter().map(|seen| initial_pose(camera, &points, seen)).collect::<Option<Vec<_>>>()?;
    let mut factor = 1.0;
    for _ in 0..MAX_STEPS {
        let normal = FocalEquations::at(&points, &scaled(camera, factor), views, &poses)?;
        let (by, steps) = normal.solve()?;
        factor *= 1.0 + by;
        poses = poses.iter().zip(&steps).map(|(pose, step)| refine::moved_pose(pose, step)).collect();
        if by.abs() < 1e-10 {
            break;
        }
    }
    let normal = FocalEquations::at(&points, &scaled(camera, factor), views, &poses)?;
    let change = FocalChange { share: factor - 1.0, sigma: normal.sigma()? };
    (change.share.is_finite() && change.sigma.is_finite()).then_some(change)
}

fn scaled(camera: &Camera, factor: f64) -> Camera {
    Camera { fx: camera.fx * factor, fy: camera.fy * factor, ..*camera }
}

/// A pose in closed form, from the undistorted corners.
fn initial_pose(camera: &Camera, points: &[Point2<f64>], seen: &[Pixel]) -> Option<Isometry3<f64>> {
    let straight: Option<Vec<Pixel>> =
        seen.iter().map(|pixel| camera.normalised_of(*pixel).map(|n| Pixel(n.0))).collect();
    let unit = Camera { fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0, ..camera.without_distortion() };
    initial::pose(&unit, &initial::homography(points, &straight?)?)
}

/// The normal equations of the focal length's factor and one pose per view; the poses are eliminated view by view.
#[derive(Default)]
struct FocalEquations {
    factor: f64,
    factor_slope: f64,
    views: Vec<(Matrix6<f64>, Vector6<f64>, Vector6<f64>)>,
    squares: f64,
    numbers: usize,
}

impl FocalEquations {
    fn at(points: &[Point2<f64>], camera: &Camera, views: &[Vec<Pixel>], poses: &[Isometry3<f64>]) -> Option<Self> {
        let mut normal = Self::default();
        for (seen, pose) in views.iter().zip(poses) {
            let (mut square, mut joint, mut slope) = (Matrix6::zeros(), Vector6::zeros(), Vector6::zeros());
            for (point, seen) in points.iter().zip(seen) {
                let (pixel, by_camera, by_pose) = refine::project(camera, pose, point)?;
                let by_factor: Vector2<f64> = by_camera.column(0) * camera.fx + by_camera.column(1) * camera.fy;
                let miss = seen.0 - pixel.0;
                square += by_pose.transpose() * by_pose;
                joint += by_pose.transpose() * by_factor;
                slope += by_pose.transpose() * miss;
                normal.factor += by_factor.norm_squared();
                normal.factor_slope += by_factor.dot(&miss);
                normal.squares += miss.norm_squared();
                normal.numbers += 2;
            }
            normal.views.push((square, joint, slope));
        }
        Some(normal)
    }

    /// The factor's equation with the poses eliminated: weight and gradient.
    fn reduced(&self) -> Option<(f64, f64)> {
        let (mut weight, mut slope) = (self.factor, self.factor_slope);
        for (square, joint, own) in &self.views {
            let eliminated = square.cholesky()?;
            weight -= joint.dot(&eliminated.solve(joint));
            slope -= joint.dot(&eliminated.solve(own));
        }
        (weight > 0.0).then_some((weight, slope))
    }

    fn solve(&self) -> Option<(f64, Vec<Vector6<f64>>)> {
        let (weight, slope) = self.reduced()?;
        let by = slope / weight;
        let step = |(square, joint, own): &(Matrix6<f64>, _, _)| Some(square.cholesky()?.solve(&(own - joint * by)));
        Some((by, self.views.iter().map(step).collect::<Option<_>>()?))
    }

    fn sigma(&self) -> Option<f64> {
        let spent = 1 + 6 * self.views.len();
        let freedom = self.numbers.checked_sub(spent).filter(|n| *n > 0)?;
        Some((self.squares / freedom as f64 / self.reduced()?.0).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};
    use rand::rngs::SmallRng;
    use rand::{RngExt, SeedableRng};

    use super::*;
    use crate::vision::camera::testing::wide;
    use crate::vision::space::CameraPoint;

    fn board() -> Board {
        Board::new(9, 6, 21.0).unwrap()
    }

    fn pose(x: f64, lean: f64) -> Isometry3<f64> {
        Isometry3::new(Vector3::new(x, -12.0, 240.0), Vector3::new(lean, 0.05, 0.1))
    }

    /// Corners as a camera sees them, each coordinate off by up to `noise_px`.
    fn seen(camera: &Camera, pose: &Isometry3<f64>, noise_px: f64) -> Vec<Pixel> {
        let mut dice = SmallRng::seed_from_u64(4);
        let mut off = || noise_px * dice.random_range(-1.0..=1.0);
        let corners = board().points_mm();
        let project = |p: Point2<f64>| camera.project(CameraPoint(pose * Point3::new(p.x, p.y, 0.0))).unwrap();
        corners.into_iter().map(project).map(|pixel| Pixel::new(pixel.u() + off(), pixel.v() + off())).collect()
    }

    #[test]
    fn a_board_is_found_where_it_lies() {
        let truth = pose(14.0, 0.12);
        let placed = locate(&wide(), board(), &seen(&wide(), &truth, 0.0)).unwrap();
        assert!((placed.camera_from_board.translation.vector - truth.translation.vector).norm() < 1e-6);
        assert!(placed.camera_from_board.rotation.angle_to(&truth.rotation) < 1e-8 && placed.rms_px < 1e-6);
        assert_eq!(locate(&wide(), board(), &[]), None);
    }

    #[test]
    fn a_zoom_shows_in_the_focal_length_to_within_what_the_noise_allows() {
        let zoomed = scaled(&wide(), 1.03);
        let views =
            |camera: &Camera| [pose(14.0, 0.12), pose(-20.0, 0.2)].map(|pose| seen(camera, &pose, 0.05)).to_vec();
        let of = |views: Vec<Vec<Pixel>>| focal_change(&wide(), board(), &views).unwrap();
        let (changed, unchanged) = (of(views(&zoomed)), of(views(&wide())));
        assert!((changed.share - 0.03).abs() < 4.0 * changed.sigma && changed.sigma < 0.005, "{changed:?}");
        assert!(unchanged.share.abs() < 4.0 * unchanged.sigma && unchanged.sigma < 0.005, "{unchanged:?}");
    }
}
