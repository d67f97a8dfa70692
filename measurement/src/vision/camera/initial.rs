//! Start values for the refinement: a first camera and first poses in closed form.
//!
//! In: inner corners of flat boards, pixels. Out: focal lengths without distortion, and the pose of each board. Method:
//! a homography per photo (normalised DLT), then Zhang's two constraints per homography (Z. Zhang, "A flexible new
//! technique for camera calibration", PAMI 2000). Three of his five unknowns are assumed: zero skew, and the principal
//! point in the picture's middle. The full closed form fails under a laparoscope's distortion, and the refinement finds
//! the principal point anyway.

use nalgebra::{
    Isometry3, Matrix2, Matrix3, Point2, Rotation3, SMatrix, SymmetricEigen, Translation3, UnitQuaternion, Vector2,
    Vector3,
};

use super::Camera;
use crate::vision::space::Pixel;

/// A pinhole camera without distortion, from the homographies of the boards.
pub(super) fn camera(homographies: &[Matrix3<f64>], width: u32, height: u32) -> Camera {
    let (cx, cy) = ((f64::from(width) - 1.0) / 2.0, (f64::from(height) - 1.0) / 2.0);
    let (fx, fy) = focal_lengths(homographies, cx, cy).unwrap_or_else(|| {
        let usual = f64::from(width.max(height)); // a field of view of 53°: boards that face the camera do not give one
        (usual, usual)
    });
    Camera { width, height, fx, fy, cx, cy, k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0, focal_sigma: 0.0 }
}

/// The homography that maps points of the board, mm, to pixels; `None` if they do not span a plane.
pub(super) fn homography(points: &[Point2<f64>], seen: &[Pixel]) -> Option<Matrix3<f64>> {
    let from = Normalisation::of(points.iter().copied())?;
    let to = Normalisation::of(seen.iter().map(|p| p.0))?;
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (point, pixel) in points.iter().zip(seen) {
        let (p, q) = (from.apply(*point), to.apply(pixel.0));
        for (row, target) in [(0, q.x), (3, q.y)] {
            let mut equation = SMatrix::<f64, 9, 1>::zeros();
            for (i, value) in [p.x, p.y, 1.0].into_iter().enumerate() {
                equation[row + i] = value;
                equation[6 + i] = -target * value;
            }
            normal += equation * equation.transpose();
        }
    }
    let eigen = SymmetricEigen::new(normal);
    let least = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    let h = Matrix3::from_row_slice(least.as_slice());
    let h = to.matrix().try_inverse()? * h * from.matrix();
    let size = h.norm();
    (h.iter().all(|v| v.is_finite()) && h.determinant().abs() > 1e-12 * size.powi(3)).then(|| h / size)
}

/// The pose `camera_from_board` that a homography implies for a camera without distortion; the board is in front.
pub(super) fn pose(camera: &Camera, homography: &Matrix3<f64>) -> Option<Isometry3<f64>> {
    let k = Matrix3::new(camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0);
    let h = k.try_inverse()? * homography;
    let (a, b, c) = (h.column(0).into_owned(), h.column(1).into_owned(), h.column(2).into_owned());
    let scale = 2.0 / (a.norm() + b.norm()) * if c.z < 0.0 { -1.0 } else { 1.0 };
    let (a, b, t) = (a * scale, b * scale, c * scale);
    let svd = Matrix3::from_columns(&[a, b, a.cross(&b)]).svd(true, true);
    let rotation = svd.u? * svd.v_t?;
    let finite = rotation.iter().chain(t.iter()).all(|v| v.is_finite());
    (finite && t.z > 0.0).then(|| isometry(rotation, t))
}

fn isometry(rotation: Matrix3<f64>, t: Vector3<f64>) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Isometry3::from_parts(Translation3::from(t), rotation)
}

/// Zhang's constraints with the principal point known: linear in `1/fx²` and `1/fy²`.
fn focal_lengths(homographies: &[Matrix3<f64>], cx: f64, cy: f64) -> Option<(f64, f64)> {
    let mut both = (Matrix2::zeros(), Vector2::zeros());
    let mut one = (0.0, 0.0);
    for (coefficients, right) in homographies.iter().flat_map(|h| constraints(h, cx, cy)) {
        both.0 += coefficients * coefficients.transpose();
        both.1 += coefficients * right;
        one.0 += coefficients.sum() * coefficients.sum();
        one.1 += coefficients.sum() * right;
    }
    let focal = |inverse_square: f64| (inverse_square > 0.0).then(|| inverse_square.sqrt().recip());
    let separate = both.0.try_inverse().map(|inverse| inverse * both.1);
    let separate = separate.and_then(|s| Some((focal(s.x)?, focal(s.y)?)));
    // Cameras have nearly square pixels; another ratio comes from noise in photos that do not determine it.
    let plausible = separate.filter(|(fx, fy)| (0.5..2.0).contains(&(fx / fy)));
    plausible.or_else(|| focal(one.1 / one.0).map(|f| (f, f)))
}

fn constraints(homography: &Matrix3<f64>, cx: f64, cy: f64) -> [(Vector2<f64>, f64); 2] {
    let centred = Matrix3::new(1.0, 0.0, -cx, 0.0, 1.0, -cy, 0.0, 0.0, 1.0) * homography;
    let (a, b) = (centred.column(0).into_owned(), centred.column(1).into_owned());
    let size = (a.xy().norm() * b.xy().norm()).max(f64::MIN_POSITIVE);
    [
        (Vector2::new(a.x * b.x, a.y * b.y) / size, -a.z * b.z / size),
        (Vector2::new(a.x * a.x - b.x * b.x, a.y * a.y - b.y * b.y) / size, -(a.z * a.z - b.z * b.z) / size),
    ]
}

/// Shift and scale that bring points to mean 0 and mean distance √2; otherwise the DLT is badly conditioned.
struct Normalisation {
    mean: Point2<f64>,
    scale: f64,
}

impl Normalisation {
    fn of(points: impl ExactSizeIterator<Item = Point2<f64>> + Clone) -> Option<Self> {
        let count = points.len() as f64;
        let mean = Point2::from(points.clone().map(|p| p.coords).sum::<Vector2<f64>>() / count);
        let distance = points.map(|p| (p - mean).norm()).sum::<f64>() / count;
        (distance > 0.0 && distance.is_finite()).then(|| Self { mean, scale: std::f64::consts::SQRT_2 / distance })
    }

    fn apply(&self, point: Point2<f64>) -> Vector2<f64> {
        (point - self.mean) * self.scale
    }

    fn matrix(&self) -> Matrix3<f64> {
        let (s, m) = (self.scale, self.mean);
        Matrix3::new(s, 0.0, -s * m.x, 0.0, s, -s * m.y, 0.0, 0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::vision::camera::Board;
    use crate::vision::space::CameraPoint;

    #[test]
    fn without_distortion_the_closed_form_is_exact() {
        let board = Board::new(9, 6, 21.0).unwrap().points_mm();
        let truth = Camera { fx: 900.0, fy: 880.0, ..camera(&[], 1280, 720) };
        let poses = [(0.4, 0.1), (-0.3, 0.3), (0.1, -0.5)]
            .map(|(a, b)| Isometry3::new(Vector3::new(10.0, -20.0, 400.0), Vector3::new(a, b, 0.3)));
        let homographies = poses.map(|pose| {
            let seen: Vec<_> =
                board.iter().map(|p| truth.project(CameraPoint(pose * Point3::new(p.x, p.y, 0.0))).unwrap()).collect();
            homography(&board, &seen).unwrap()
        });
        let found = camera(&homographies, 1280, 720);
        assert!((found.fx - 900.0).abs() < 1e-6 && (found.fy - 880.0).abs() < 1e-6, "{found:?}");
        for (h, truth) in homographies.iter().zip(&poses) {
            let found = pose(&found, h).unwrap();
            assert!((found.translation.vector - truth.translation.vector).norm() < 1e-6);
            assert!(found.rotation.angle_to(&truth.rotation) < 1e-8);
        }
    }

    #[test]
    fn points_on_one_spot_have_no_homography() {
        let points = vec![Point2::new(1.0, 1.0); 9];
        assert_eq!(homography(&points, &[Pixel::new(3.0, 3.0); 9]), None);
    }
}
