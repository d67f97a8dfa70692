//! Detects a bent board: its corners are fitted once more with a board that may curve.
//!
//! In: one photo's corners, its flat pose and a camera that was calibrated without it. Out: the height of the bulge
//! that explains the corners best, and the residual. Method: the board's height is `a·x² + b·xy + c·y²`; pose and the
//! three curvatures are found by Gauss–Newton. Paper on a board curls like that; a twist is the `xy` term.

use nalgebra::{Isometry3, Point2, Point3, SMatrix, SVector, Vector3};

use super::Camera;
use super::refine::{PosedPhoto, moved_pose, project_point};
use crate::vision::space::Pixel;

/// A curved board, fitted to a photo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bulge {
    /// Height from the lowest to the highest corner over the board's own mean plane, mm.
    pub height_mm: f64,
    /// Root mean square distance of the seen corners from those of the curved board, px.
    pub rms_px: f64,
}

/// Fits a curved board; `None` if the fit diverges.
pub(super) fn fit_bulge(points: &[Point2<f64>], camera: &Camera, photo: &PosedPhoto<'_>) -> Option<Bulge> {
    let size = points.iter().map(|p| p.coords.norm()).fold(f64::MIN_POSITIVE, f64::max);
    let mut shape = CurvedBoard { pose: photo.pose, heights: Vector3::zeros(), size };
    for _ in 0..30 {
        let mut square = SMatrix::<f64, 9, 9>::zeros();
        let mut slope = SVector::<f64, 9>::zeros();
        for (point, seen) in points.iter().zip(photo.seen) {
            let (pixel, jacobian) = shape.project(camera, point)?;
            square += jacobian.transpose() * jacobian;
            slope += jacobian.transpose() * (seen.0 - pixel.0);
        }
        let step = square.cholesky()?.solve(&slope);
        shape.pose = moved_pose(&shape.pose, &step.fixed_rows::<6>(0).into_owned());
        shape.heights += step.fixed_rows::<3>(6);
        if step.norm() < 1e-9 {
            break;
        }
    }
    let squares =
        |(point, seen): (&Point2<f64>, &Pixel)| Some((seen.0 - shape.project(camera, point)?.0.0).norm_squared());
    let sum = points.iter().zip(photo.seen).map(squares).sum::<Option<f64>>()?;
    let rms_px = (sum / points.len() as f64).sqrt();
    rms_px.is_finite().then(|| Bulge { height_mm: shape.height_mm(points), rms_px })
}

struct CurvedBoard {
    pose: Isometry3<f64>,
    /// Height that each of the three curvatures adds at a distance of `size`, mm.
    heights: Vector3<f64>,
    size: f64,
}

impl CurvedBoard {
    fn curvatures(&self, point: &Point2<f64>) -> Vector3<f64> {
        let (x, y) = (point.x / self.size, point.y / self.size);
        Vector3::new(x * x, x * y, y * y)
    }

    fn project(&self, camera: &Camera, point: &Point2<f64>) -> Option<(Pixel, SMatrix<f64, 2, 9>)> {
        let curvatures = self.curvatures(point);
        let turned = self.pose.rotation * Vector3::new(point.x, point.y, self.heights.dot(&curvatures));
        let (pixel, _, by_point) = project_point(camera, Point3::from(turned + self.pose.translation.vector))?;
        let normal = self.pose.rotation * Vector3::z();
        let mut jacobian = SMatrix::<f64, 2, 9>::zeros();
        jacobian.fixed_columns_mut::<3>(0).copy_from(&(by_point * -turned.cross_matrix()));
        jacobian.fixed_columns_mut::<3>(3).copy_from(&by_point);
        jacobian.fixed_columns_mut::<3>(6).copy_from(&(by_point * normal * curvatures.transpose()));
        Some((pixel, jacobian))
    }

    /// Difference between the highest and the lowest corner, mm. The height has no slope in the middle and the points
    /// lie around the middle, so the mean plane is level.
    fn height_mm(&self, points: &[Point2<f64>]) -> f64 {
        let heights = points.iter().map(|p| self.heights.dot(&self.curvatures(p)));
        let (low, high) = heights.fold((f64::MAX, f64::MIN), |(l, h), z| (l.min(z), h.max(z)));
        high - low
    }
}
