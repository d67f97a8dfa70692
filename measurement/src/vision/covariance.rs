//! The stated error of a position.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Covariance of a position's error in the camera frame, mm². Depth is uncertain along the line of sight, so away from
/// the picture's centre the errors in x, y and z are correlated. Results store its fields in this order.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // the fields are the entries of the upper triangle
pub struct PositionCovariance {
    pub xx: f64,
    pub xy: f64,
    pub xz: f64,
    pub yy: f64,
    pub yz: f64,
    pub zz: f64,
}

impl PositionCovariance {
    /// The covariance of independent errors in x, y and z, from their standard deviations, mm: all that is known of a
    /// position with [`sigma_xy_mm`](Self::sigma_xy_mm) and [`sigma_z_mm`](Self::sigma_z_mm) alone.
    pub fn from_sigmas(sigma_xy_mm: f64, sigma_z_mm: f64) -> Self {
        let [across, depth] = [sigma_xy_mm, sigma_z_mm].map(|sigma| sigma * sigma);
        Self { xx: across, xy: 0.0, xz: 0.0, yy: across, yz: 0.0, zz: depth }
    }

    /// Creates it from xx, xy, xz, yy, yz, zz.
    pub fn from_upper([xx, xy, xz, yy, yz, zz]: [f64; 6]) -> Self {
        Self { xx, xy, xz, yy, yz, zz }
    }

    /// xx, xy, xz, yy, yz, zz.
    pub fn upper(&self) -> [f64; 6] {
        let Self { xx, xy, xz, yy, yz, zz } = *self;
        [xx, xy, xz, yy, yz, zz]
    }

    /// The whole matrix.
    pub fn matrix(&self) -> Matrix3<f64> {
        let Self { xx, xy, xz, yy, yz, zz } = *self;
        Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
    }

    /// Standard deviation across the line of sight (RMS of x and y), mm.
    pub fn sigma_xy_mm(&self) -> f64 {
        (0.5 * (self.xx + self.yy)).sqrt()
    }

    /// Standard deviation of depth, mm.
    pub fn sigma_z_mm(&self) -> f64 {
        self.zz.sqrt()
    }

    /// Standard deviation along a unit vector, mm.
    pub fn sigma_along_mm(&self, direction: &Vector3<f64>) -> f64 {
        direction.dot(&(self.matrix() * direction)).max(0.0).sqrt()
    }

    /// Squared Mahalanobis length of an error in mm; infinite if the covariance is singular.
    pub fn mahalanobis_squared(&self, error_mm: &Vector3<f64>) -> f64 {
        self.matrix().cholesky().map_or(f64::INFINITY, |factor| error_mm.dot(&factor.solve(error_mm)))
    }

    /// True if errors can have it: the matrix is finite and positive semi-definite, within the rounding of a file with
    /// six digits.
    pub fn is_valid(&self) -> bool {
        const ROUNDING: f64 = 1e-6;
        let matrix = self.matrix();
        let margin = (ROUNDING * matrix.trace()).max(f64::MIN_POSITIVE);
        let variances = matrix.diagonal();
        matrix.iter().all(|entry| entry.is_finite())
            && variances.min() >= 0.0
            && (matrix + Matrix3::from_diagonal_element(margin)).cholesky().is_some()
    }

    /// A matrix `F` with `F·Fᵀ` equal to the covariance (Cholesky, depth first). Of three independent errors of
    /// variance 1, the third is the error of depth: it moves a position along its line of sight, wherever it lies.
    pub fn factor(&self) -> Matrix3<f64> {
        let root = |variance: f64| variance.max(0.0).sqrt();
        let divided = |covariance: f64, by: f64| if by > 0.0 { covariance / by } else { 0.0 };
        let z = root(self.zz);
        let [xz, yz] = [self.xz, self.yz].map(|covariance| divided(covariance, z));
        let x = root(self.xx - xz * xz);
        let y_without_z = root(self.yy - yz * yz);
        let xy = divided(self.xy - xz * yz, x).clamp(-y_without_z, y_without_z);
        let y = root(y_without_z * y_without_z - xy * xy);
        Matrix3::new(x, 0.0, xz, xy, y, yz, 0.0, 0.0, z)
    }
}

/// Takes the symmetric part of a matrix.
impl From<Matrix3<f64>> for PositionCovariance {
    fn from(of: Matrix3<f64>) -> Self {
        let entry = |row: usize, column: usize| 0.5 * (of[(row, column)] + of[(column, row)]);
        Self::from_upper([(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|(row, column)| entry(row, column)))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    prop_compose! {
        fn any_covariance()(parts in prop::array::uniform9(-3.0..3.0f64)) -> PositionCovariance {
            let root = Matrix3::from_row_slice(&parts);
            (root * root.transpose()).into()
        }
    }

    proptest! {
        #[test]
        fn the_two_sigmas_are_roots_of_its_variances(of in any_covariance()) {
            let variances = of.matrix().diagonal();
            prop_assert_eq!(of.sigma_z_mm(), variances.z.sqrt());
            prop_assert_eq!(of.sigma_xy_mm(), (0.5 * (variances.x + variances.y)).sqrt());
            prop_assert!((of.sigma_along_mm(&Vector3::z()) - of.sigma_z_mm()).abs() < 1e-12);
        }

        #[test]
        fn two_sigmas_come_back_to_the_last_bit(xy in 0.0..100.0f64, z in 0.0..100.0f64) {
            let of = PositionCovariance::from_sigmas(xy, z);
            prop_assert_eq!((of.sigma_xy_mm(), of.sigma_z_mm()), (xy, z));
            prop_assert!(of.is_valid());
        }

        #[test]
        fn its_factor_gives_it_back_and_is_valid(of in any_covariance()) {
            let factor = of.factor();
            prop_assert!((factor * factor.transpose() - of.matrix()).amax() < 1e-9);
            prop_assert!(of.is_valid());
        }
    }

    #[test]
    fn a_depth_error_moves_a_position_along_its_line_of_sight() {
        let ray = Vector3::new(60.0, -40.0, 200.0).normalize();
        let of = PositionCovariance::from(ray * ray.transpose() * 4.0 + Matrix3::identity() * 1e-6);
        assert!(of.factor().column(2).normalize().cross(&ray).norm() < 1e-5);
        assert!((of.sigma_along_mm(&ray) - 2.0).abs() < 1e-6);
    }

    #[test]
    fn what_is_no_covariance_is_not_valid() {
        let valid = |upper: [f64; 6]| PositionCovariance::from_upper(upper).is_valid();
        assert!(valid([0.0; 6]) && valid([1.0, 1.0, 1.0, 1.0, 1.0, 1.0]));
        assert!(valid([0.04, 0.0, 0.19, 0.04, 0.0, 0.9025]), "singular");
        for upper in [
            [-1.0, 0.0, 0.0, 1.0, 0.0, 1.0],
            [1.0, 1.1, 0.0, 1.0, 0.0, 1.0],
            [1.0, 0.9, 0.9, 1.0, -0.9, 1.0], // each pair is possible, all three together are not
            [0.0, 0.1, 0.0, 0.0, 0.0, 0.0],
            [f64::NAN, 0.0, 0.0, 1.0, 0.0, 1.0],
            [1.0, 0.0, 0.0, 1.0, 0.0, f64::INFINITY],
        ] {
            assert!(!valid(upper), "{upper:?}");
        }
    }

    #[test]
    fn an_error_is_measured_in_units_of_its_covariance() {
        let of = PositionCovariance::from_sigmas(0.5, 2.0);
        assert!((of.mahalanobis_squared(&Vector3::new(0.5, 1.0, 2.0)) - 6.0).abs() < 1e-12);
        assert_eq!(PositionCovariance::from_sigmas(0.0, 2.0).mahalanobis_squared(&Vector3::x()), f64::INFINITY);
    }
}
