//! Refines the camera and all poses together with Levenberg–Marquardt, to explain the seen corners best.
//!
//! In: a start ([`super::initial`]) and the corners of every photo, pixels. Out: the camera, each board's pose and the
//! covariance of the camera's nine parameters. Method: the reprojection error is minimised with an analytic Jacobian;
//! corners further off than [`ROBUST_SIGMAS`] are weighted down (Huber), so that one bad corner cannot drag the camera.
//! A pose affects only its own photo's corners, so the normal equations form an arrow matrix: the poses are eliminated
//! photo by photo (Schur complement), and the cost grows linearly with the number of photos.

use nalgebra::{Isometry3, Point2, Point3, SMatrix, SVector, Translation3, UnitQuaternion, Vector2, Vector3};

use super::Camera;
use crate::vision::space::{Normalised, Pixel};

/// Corners further off than this many robust standard deviations lose weight; this affects 1 % of good corners.
pub(super) const ROBUST_SIGMAS: f64 = 3.0;

/// Maximum steps of one minimisation; a good start needs about ten.
const MAX_STEPS: usize = 100;

/// The minimisation has converged when a step's relative gain falls below this.
const MIN_GAIN: f64 = 1e-10;

/// Number of camera parameters that are refined: fx fy cx cy k1 k2 p1 p2 k3.
pub(super) const INTRINSIC_COUNT: usize = 9;

type CameraJacobian = SMatrix<f64, 2, INTRINSIC_COUNT>;
type PoseJacobian = SMatrix<f64, 2, 6>;

/// The corners of one photo and the pose of its board.
#[derive(Clone, Debug)]
pub(super) struct PosedPhoto<'a> {
    /// Corners as seen, in the order of the board's points.
    pub seen: &'a [Pixel],
    /// Pose `camera_from_board`, mm.
    pub pose: Isometry3<f64>,
}

/// The result of the minimisation.
#[derive(Clone, Debug)]
pub(super) struct CameraFit<'a> {
    pub camera: Camera,
    pub photos: Vec<PosedPhoto<'a>>,
    /// Covariance of the nine intrinsics, for independent corners with the noise seen in the residuals.
    pub covariance: SMatrix<f64, INTRINSIC_COUNT, INTRINSIC_COUNT>,
}

/// Refines camera and poses together; `None` if the equations have no finite solution.
pub(super) fn refine_all<'a>(
    points: &[Point2<f64>],
    camera: Camera,
    photos: Vec<PosedPhoto<'a>>,
) -> Option<CameraFit<'a>> {
    let mut state = CameraState { camera, photos };
    // Far from the solution every corner is far off, so the first pass gives all corners full weight.
    state = minimise(points, state, f64::INFINITY)?;
    for _ in 0..3 {
        let limit = ROBUST_SIGMAS * robust_sigma(&state.residuals(points)?);
        state = minimise(points, state, limit)?;
    }
    let sigma = robust_sigma(&state.residuals(points)?);
    let normal = CalibrationEquations::at(points, &state, ROBUST_SIGMAS * sigma)?;
    let covariance = normal.reduced(0.0)?.0.try_inverse()? * normal.sigma_px().powi(2);
    let finite = covariance.iter().all(|v| v.is_finite());
    finite.then_some(CameraFit { camera: state.camera, photos: state.photos, covariance })
}

/// Refines one pose with the camera held fixed: shows how well a photo agrees with a camera calibrated without it.
pub(super) fn refine_pose<'a>(
    points: &[Point2<f64>],
    camera: &Camera,
    photo: PosedPhoto<'a>,
) -> Option<PosedPhoto<'a>> {
    let mut pose = photo.pose;
    for _ in 0..30 {
        let mut square = SMatrix::<f64, 6, 6>::zeros();
        let mut slope = SVector::<f64, 6>::zeros();
        for (point, seen) in points.iter().zip(photo.seen) {
            let (pixel, _, jacobian) = project(camera, &pose, point)?;
            square += jacobian.transpose() * jacobian;
            slope += jacobian.transpose() * (seen.0 - pixel.0);
        }
        let step = square.cholesky()?.solve(&slope);
        pose = moved_pose(&pose, &step);
        if step.norm() < 1e-9 {
            break;
        }
    }
    pose.translation.vector.iter().all(|v| v.is_finite()).then_some(PosedPhoto { pose, ..photo })
}

/// Seen minus expected position of each corner of a photo, px; `None` if the board is behind the camera.
pub(super) fn corner_residuals(
    points: &[Point2<f64>],
    camera: &Camera,
    photo: &PosedPhoto<'_>,
) -> Option<Vec<Vector2<f64>>> {
    let miss = |(point, seen): (&Point2<f64>, &Pixel)| Some(seen.0 - project(camera, &photo.pose, point)?.0.0);
    points.iter().zip(photo.seen).map(miss).collect()
}

/// Standard deviation per coordinate from the median distance, which a few bad corners do not change.
pub(super) fn robust_sigma(misses: &[Vector2<f64>]) -> f64 {
    const MEDIAN_OF_UNIT_RAYLEIGH: f64 = 1.177_41;
    let mut distances: Vec<f64> = misses.iter().map(|m| m.norm()).collect();
    distances.sort_by(f64::total_cmp);
    let median = distances.get(distances.len() / 2).copied().unwrap_or(0.0);
    // Computed corners agree to rounding errors; without a floor their noise and every weight would be 0.
    (median / MEDIAN_OF_UNIT_RAYLEIGH).max(1e-6)
}

/// Root mean square of distances, px, as OpenCV counts it: per corner, not per coordinate.
pub(super) fn rms(misses: &[Vector2<f64>]) -> f64 {
    (misses.iter().map(|m| m.norm_squared()).sum::<f64>() / misses.len().max(1) as f64).sqrt()
}

/// The pixel of a board's point, with its derivatives by the intrinsics and by the pose (rotation, then translation).
pub(super) fn project(
    camera: &Camera,
    pose: &Isometry3<f64>,
    point: &Point2<f64>,
) -> Option<(Pixel, CameraJacobian, PoseJacobian)> {
    let turned = pose.rotation * Vector3::new(point.x, point.y, 0.0);
    let (pixel, by_camera, by_point) = project_point(camera, Point3::from(turned + pose.translation.vector))?;
    let mut by_pose = PoseJacobian::zeros();
    by_pose.fixed_columns_mut::<3>(0).copy_from(&(by_point * -turned.cross_matrix()));
    by_pose.fixed_columns_mut::<3>(3).copy_from(&by_point);
    Some((pixel, by_camera, by_pose))
}

/// The pixel of a point in camera space, with its derivatives by the intrinsics and by the point.
pub(super) fn project_point(camera: &Camera, at: Point3<f64>) -> Option<(Pixel, CameraJacobian, SMatrix<f64, 2, 3>)> {
    if at.z <= 0.0 {
        return None;
    }
    let (x, y) = (at.x / at.z, at.y / at.z);
    let (d, mut by_direction) = camera.distort_with_jacobian(Normalised::new(x, y));
    by_direction.row_mut(0).scale_mut(camera.fx);
    by_direction.row_mut(1).scale_mut(camera.fy);
    let direction_by_point = SMatrix::<f64, 2, 3>::new(1.0, 0.0, -x, 0.0, 1.0, -y) / at.z;
    let r2 = x * x + y * y;
    let (kx, ky) = (camera.fx * x, camera.fy * y);
    let by_camera = CameraJacobian::from_columns(&[
        Vector2::new(d.x, 0.0),
        Vector2::new(0.0, d.y),
        Vector2::x(),
        Vector2::y(),
        Vector2::new(kx, ky) * r2,
        Vector2::new(kx, ky) * r2 * r2,
        Vector2::new(2.0 * kx * y, camera.fy * (r2 + 2.0 * y * y)),
        Vector2::new(camera.fx * (r2 + 2.0 * x * x), 2.0 * ky * x),
        Vector2::new(kx, ky) * r2 * r2 * r2,
    ]);
    let pixel = Pixel::new(camera.fx * d.x + camera.cx, camera.fy * d.y + camera.cy);
    Some((pixel, by_camera, by_direction * direction_by_point))
}

/// A pose after a small rotation (about the camera's axes, radians) and translation (mm).
pub(super) fn moved_pose(pose: &Isometry3<f64>, step: &SVector<f64, 6>) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0).into_owned());
    let shift = pose.translation.vector + step.fixed_rows::<3>(3);
    Isometry3::from_parts(Translation3::from(shift), turn * pose.rotation)
}

fn adjusted_camera(camera: &Camera, step: &SVector<f64, INTRINSIC_COUNT>) -> Camera {
    Camera {
        fx: camera.fx + step[0],
        fy: camera.fy + step[1],
        cx: camera.cx + step[2],
        cy: camera.cy + step[3],
        k1: camera.k1 + step[4],
        k2: camera.k2 + step[5],
        p1: camera.p1 + step[6],
        p2: camera.p2 + step[7],
        k3: camera.k3 + step[8],
        ..*camera
    }
}

#[derive(Clone)]
struct CameraState<'a> {
    camera: Camera,
    photos: Vec<PosedPhoto<'a>>,
}

impl CameraState<'_> {
    fn residuals(&self, points: &[Point2<f64>]) -> Option<Vec<Vector2<f64>>> {
        let per_photo: Option<Vec<_>> =
            self.photos.iter().map(|photo| corner_residuals(points, &self.camera, photo)).collect();
        Some(per_photo?.concat())
    }

    fn cost(&self, points: &[Point2<f64>], limit_px: f64) -> Option<f64> {
        Some(self.residuals(points)?.iter().map(|m| huber(m.norm(), limit_px).0).sum())
    }
}

/// Huber's loss and weight: quadratic within the limit, linear beyond it.
fn huber(distance: f64, limit: f64) -> (f64, f64) {
    if distance <= limit {
        (distance * distance, 1.0)
    } else {
        (2.0 * limit * distance - limit * limit, limit / distance)
    }
}

fn minimise<'a>(points: &[Point2<f64>], mut state: CameraState<'a>, limit_px: f64) -> Option<CameraState<'a>> {
    let mut cost = state.cost(points, limit_px)?;
    let mut damping = 1e-3;
    for _ in 0..MAX_STEPS {
        let normal = CalibrationEquations::at(points, &state, limit_px)?;
        let mut gain = 0.0;
        while damping < 1e12 {
            let trial = normal.step(damping).map(|step| step.applied_to(&state));
            let better = trial.and_then(|t| Some((t.cost(points, limit_px)?, t))).filter(|(c, _)| *c < cost);
            if let Some((new_cost, new_state)) = better {
                gain = (cost - new_cost) / cost;
                (cost, state) = (new_cost, new_state);
                damping = (damping * 0.1).max(1e-12);
                break;
            }
            damping *= 10.0;
        }
        if gain < MIN_GAIN {
            break;
        }
    }
    cost.is_finite().then_some(state)
}

/// The normal equations as an arrow matrix: the camera's block, and per photo the pose's block and the joint block.
struct CalibrationEquations {
    camera: SMatrix<f64, INTRINSIC_COUNT, INTRINSIC_COUNT>,
    camera_slope: SVector<f64, INTRINSIC_COUNT>,
    photos: Vec<PhotoEquations>,
    weighted_squares: f64,
    weights: f64,
}

struct PhotoEquations {
    pose: SMatrix<f64, 6, 6>,
    joint: SMatrix<f64, INTRINSIC_COUNT, 6>,
    slope: SVector<f64, 6>,
}

struct CalibrationStep {
    camera: SVector<f64, INTRINSIC_COUNT>,
    poses: Vec<SVector<f64, 6>>,
}

impl CalibrationEquations {
    fn at(points: &[Point2<f64>], state: &CameraState<'_>, limit_px: f64) -> Option<Self> {
        let mut normal = Self {
            camera: SMatrix::zeros(),
            camera_slope: SVector::zeros(),
            photos: Vec::with_capacity(state.photos.len()),
            weighted_squares: 0.0,
            weights: 0.0,
        };
        for photo in &state.photos {
            let mut own = PhotoEquations { pose: SMatrix::zeros(), joint: SMatrix::zeros(), slope: SVector::zeros() };
            for (point, seen) in points.iter().zip(photo.seen) {
                let (pixel, by_camera, by_pose) = project(&state.camera, &photo.pose, point)?;
                let miss = seen.0 - pixel.0;
                let (_, weight) = huber(miss.norm(), limit_px);
                normal.camera += by_camera.transpose() * by_camera * weight;
                normal.camera_slope += by_camera.transpose() * miss * weight;
                own.pose += by_pose.transpose() * by_pose * weight;
                own.joint += by_camera.transpose() * by_pose * weight;
                own.slope += by_pose.transpose() * miss * weight;
                normal.weighted_squares += weight * miss.norm_squared();
                normal.weights += weight;
            }
            normal.photos.push(own);
        }
        Some(normal)
    }

    /// The camera's equations with the poses eliminated; the diagonal is raised by `damping` (Marquardt).
    fn reduced(
        &self,
        damping: f64,
    ) -> Option<(SMatrix<f64, INTRINSIC_COUNT, INTRINSIC_COUNT>, SVector<f64, INTRINSIC_COUNT>)> {
        let mut matrix = damped(&self.camera, damping);
        let mut slope = self.camera_slope;
        for photo in &self.photos {
            let eliminated = damped(&photo.pose, damping).cholesky()?;
            matrix -= photo.joint * eliminated.solve(&photo.joint.transpose());
            slope -= photo.joint * eliminated.solve(&photo.slope);
        }
        Some((matrix, slope))
    }

    fn step(&self, damping: f64) -> Option<CalibrationStep> {
        let (matrix, slope) = self.reduced(damping)?;
        let camera = matrix.cholesky()?.solve(&slope);
        let own = |photo: &PhotoEquations| {
            Some(damped(&photo.pose, damping).cholesky()?.solve(&(photo.slope - photo.joint.transpose() * camera)))
        };
        Some(CalibrationStep { camera, poses: self.photos.iter().map(own).collect::<Option<_>>()? })
    }

    /// Standard deviation per coordinate; every photo takes six unknowns and the camera nine.
    fn sigma_px(&self) -> f64 {
        let unknowns = (INTRINSIC_COUNT + 6 * self.photos.len()) as f64;
        (self.weighted_squares / (2.0 * self.weights - unknowns).max(1.0)).sqrt()
    }
}

fn damped<const N: usize>(matrix: &SMatrix<f64, N, N>, damping: f64) -> SMatrix<f64, N, N> {
    let mut raised = *matrix;
    for i in 0..N {
        raised[(i, i)] *= 1.0 + damping;
    }
    raised
}

impl CalibrationStep {
    fn applied_to<'a>(&self, state: &CameraState<'a>) -> CameraState<'a> {
        let photos = state.photos.iter().zip(&self.poses);
        CameraState {
            camera: adjusted_camera(&state.camera, &self.camera),
            photos: photos
                .map(|(photo, step)| PosedPhoto { pose: moved_pose(&photo.pose, step), ..photo.clone() })
                .collect(),
        }
    }
}

#[cfg(test)]
pub(super) mod tests;
