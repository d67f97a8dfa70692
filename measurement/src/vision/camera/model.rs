//! Pinhole with the Brown–Conrady lens of OpenCV (`k1 k2 p1 p2 k3`).
//!
//! Undistortion is applied to points, never to frames: a remap of 1080p costs more than all tracking.

use nalgebra::{Matrix2, Point2, Vector2};
use serde::{Deserialize, Serialize};

use crate::vision::space::{CameraPoint, Normalised, Pixel};

/// Intrinsics and distortion of one camera at one picture size.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Picture width, pixels.
    pub width: u32,
    /// Picture height, pixels.
    pub height: u32,
    /// Focal length in x, pixels.
    pub fx: f64,
    /// Focal length in y, pixels.
    pub fy: f64,
    /// Principal point, column, pixels.
    pub cx: f64,
    /// Principal point, row, pixels.
    pub cy: f64,
    /// Radial distortion, r².
    pub k1: f64,
    /// Radial distortion, r⁴.
    pub k2: f64,
    /// Tangential distortion.
    pub p1: f64,
    /// Tangential distortion.
    pub p2: f64,
    /// Radial distortion, r⁶.
    pub k3: f64,
    /// Standard deviation of the focal lengths, as a share of them; 0 if it is not known.
    #[serde(default)]
    pub focal_sigma: f64,
}

impl Camera {
    /// Undistorted direction → distorted direction, with the 2×2 Jacobian of that map.
    pub fn distort_with_jacobian(&self, n: Normalised) -> (Vector2<f64>, Matrix2<f64>) {
        let (x, y) = (n.0.x, n.0.y);
        let (xx, yy, xy) = (x * x, y * y, x * y);
        let r2 = xx + yy;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let radial_slope = self.k1 + r2 * (2.0 * self.k2 + 3.0 * r2 * self.k3); // d radial / d r²
        let distorted = Vector2::new(
            x * radial + 2.0 * self.p1 * xy + self.p2 * (r2 + 2.0 * xx),
            y * radial + self.p1 * (r2 + 2.0 * yy) + 2.0 * self.p2 * xy,
        );
        let cross = 2.0 * xy * radial_slope + 2.0 * self.p1 * x + 2.0 * self.p2 * y;
        let jacobian = Matrix2::new(
            radial + 2.0 * xx * radial_slope + 2.0 * self.p1 * y + 6.0 * self.p2 * x,
            cross,
            cross,
            radial + 2.0 * yy * radial_slope + 6.0 * self.p1 * y + 2.0 * self.p2 * x,
        );
        (distorted, jacobian)
    }

    /// Variance of a depth by the error of the focal lengths alone, mm². A tube that looks as wide as it does lies farther
    /// away for a longer focal length, in proportion; x and y stay as they are.
    pub fn depth_variance_mm2(&self, depth_mm: f64) -> f64 {
        (self.focal_sigma * depth_mm).powi(2)
    }

    /// The pixel of the recorded frame that shows an undistorted direction.
    pub fn pixel_of(&self, n: Normalised) -> Pixel {
        let (d, _) = self.distort_with_jacobian(n);
        Pixel::new(self.fx * d.x + self.cx, self.fy * d.y + self.cy)
    }

    /// The pixel that shows a point in space; `None` behind the camera.
    pub fn project(&self, point: CameraPoint) -> Option<Pixel> {
        point.normalised().map(|n| self.pixel_of(n))
    }

    /// The undistorted direction that a pixel of the recorded frame shows, to < 1e-6 px.
    ///
    /// Newton's method on the distortion. Returns `None` rather than a wrong direction where the lens model folds over
    /// (far outside the picture).
    pub fn normalised_of(&self, pixel: Pixel) -> Option<Normalised> {
        let target = Vector2::new((pixel.u() - self.cx) / self.fx, (pixel.v() - self.cy) / self.fy);
        let tolerance = 1e-10;
        let mut guess = target;
        for _ in 0..30 {
            let (seen, jacobian) = self.distort_with_jacobian(Normalised(Point2::from(guess)));
            let miss = target - seen;
            if miss.norm() < tolerance {
                let grows = jacobian.determinant() > 0.0 && jacobian.trace() > 0.0;
                return grows.then(|| Normalised(Point2::from(guess)));
            }
            let step = jacobian.try_inverse()? * miss;
            let longest = 0.5 * (1.0 + guess.norm()); // keeps the first steps at the rim from leaving the valid branch
            guess += if step.norm() > longest { step * (longest / step.norm()) } else { step };
            if !guess.iter().all(|c| c.is_finite()) {
                return None;
            }
        }
        None
    }

    /// The same camera without distortion, for reference methods that assume none.
    pub fn without_distortion(&self) -> Self {
        Self { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0, ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::camera::testing::wide;

    #[test]
    fn undistortion_inverts_distortion_to_a_millionth_of_a_pixel() {
        let camera = wide();
        for u in (0..1280).step_by(79) {
            for v in (0..720).step_by(71) {
                let pixel = Pixel::new(f64::from(u), f64::from(v));
                let back = camera.pixel_of(camera.normalised_of(pixel).unwrap());
                assert!((back.0 - pixel.0).norm() < 1e-6, "{pixel:?} came back as {back:?}");
            }
        }
    }

    #[test]
    fn jacobian_agrees_with_differences() {
        let camera = wide();
        let at = Normalised::new(0.41, -0.27);
        let (_, jacobian) = camera.distort_with_jacobian(at);
        let step = 1e-6;
        for (column, (dx, dy)) in [(step, 0.0), (0.0, step)].into_iter().enumerate() {
            let (ahead, _) = camera.distort_with_jacobian(Normalised::new(at.0.x + dx, at.0.y + dy));
            let (behind, _) = camera.distort_with_jacobian(Normalised::new(at.0.x - dx, at.0.y - dy));
            let slope = (ahead - behind) / (2.0 * step);
            assert!((slope - jacobian.column(column)).norm() < 1e-8);
        }
    }

    #[test]
    fn a_pixel_beyond_the_fold_has_no_direction() {
        assert_eq!(wide().normalised_of(Pixel::new(20_000.0, 366.0)), None);
    }
}
