//! The fulcrum: the fixed point of a tool's rotation, in its trocar (METHOD 4.4, *beyond*).
//!
//! The axis of every pose passes through it, within [`PLAY_MM`]. [`super::adjustment`] estimates it from all poses,
//! and uses it to correct the lean, and through that the depth, of each pose.

use nalgebra::{Matrix2, Matrix2x3, Matrix2x5, Matrix3, Point3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::{TubeEstimate, perpendiculars};
use crate::vision::tube::Tube;

/// A fulcrum with its covariance. Results store the upper triangle of the covariance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "UpperFulcrum", into = "UpperFulcrum")]
pub struct Fulcrum {
    /// Position in the camera frame, mm.
    pub at: Point3<f64>,
    /// Its covariance, mm².
    pub covariance: Matrix3<f64>,
}

impl Fulcrum {
    /// Creates it from a position and a covariance given as xx, xy, xz, yy, yz, zz.
    pub fn from_upper(at: Point3<f64>, [xx, xy, xz, yy, yz, zz]: [f64; 6]) -> Self {
        Self { at, covariance: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) }
    }

    /// The fulcrum, if it is known well enough to be stated in results.
    pub fn well_known(self) -> Option<Self> {
        let is_well_known =
            self.covariance.diagonal().iter().all(|variance| *variance <= WELL_KNOWN_MM * WELL_KNOWN_MM);
        is_well_known.then_some(self)
    }

    /// Every number of it.
    pub fn numbers(&self) -> impl Iterator<Item = f64> + use<> {
        <[f64; 3]>::from(self.at).into_iter().chain(self.upper())
    }

    /// Its covariance as xx, xy, xz, yy, yz, zz.
    pub fn upper(&self) -> [f64; 6] {
        [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|place| self.covariance[place])
    }
}

/// Position, and covariance as xx, xy, xz, yy, yz, zz.
#[derive(Serialize, Deserialize)]
struct UpperFulcrum(Point3<f64>, [f64; 6]);

impl From<Fulcrum> for UpperFulcrum {
    fn from(fulcrum: Fulcrum) -> Self {
        Self(fulcrum.at, fulcrum.upper())
    }
}

impl From<UpperFulcrum> for Fulcrum {
    fn from(UpperFulcrum(at, upper): UpperFulcrum) -> Self {
        Self::from_upper(at, upper)
    }
}

/// Largest standard deviation along an axis of a well-known fulcrum, mm. A movement below three of these cannot be
/// distinguished from chance.
const WELL_KNOWN_MM: f64 = 8.0;

/// Usual distance from tip to trocar, mm: trocars are 120 to 250 mm from a box's floor, and the tip works on the floor or
/// half way up.
pub const USUAL_TROCAR_DISTANCE_MM: f64 = 180.0;

/// Standard deviation of the distance from tip to trocar over boxes and tips, mm.
pub const TROCAR_DISTANCE_SIGMA_MM: f64 = 60.0;

/// Maximum squared distance of an axis from the fulcrum: 99.99 % of good measurements are nearer (chi-squared, two
/// degrees of freedom).
pub const MAX_FULCRUM_MISS_SQUARED: f64 = 18.4;

/// How far from the fulcrum an axis may pass: the play of a tube in its trocar, mm.
pub const PLAY_MM: f64 = 0.5;

/// The point nearest to all lines `point + s·axis`, unweighted. `None` if the lines are parallel.
pub fn nearest_point(lines: impl Iterator<Item = (Point3<f64>, Vector3<f64>)>) -> Option<Point3<f64>> {
    let (matrix, right) = lines.fold((Matrix3::zeros(), Vector3::zeros()), |(matrix, right), (point, axis)| {
        let projector = Matrix3::identity() - axis * axis.transpose();
        (matrix + projector, right + projector * point.coords)
    });
    Some(Point3::from(matrix.try_inverse()? * right))
}

/// Minimum distance from a tip to its trocar, in radii of the tube: the band and a piece of shaft lie between.
pub(super) const MIN_TROCAR_DISTANCE_RADII: f64 = 8.0;

/// Squared Mahalanobis distance of the axis from the fulcrum, with two degrees of freedom.
pub fn miss_squared(pose: &TubeEstimate, fulcrum: &Fulcrum) -> f64 {
    let constraint = FulcrumConstraint::at(&pose.tube, fulcrum.at);
    let spread = constraint.by_pose * pose.covariance * constraint.by_pose.transpose() + constraint.play(fulcrum);
    spread.try_inverse().map_or(f64::INFINITY, |information| constraint.miss.dot(&(information * constraint.miss)))
}

/// The constraint "the axis passes through the fulcrum", linearised: the miss, and its derivatives by the unknowns.
pub(super) struct FulcrumConstraint {
    pub(super) miss: Vector2<f64>,
    pub(super) by_pose: Matrix2x5<f64>,
    pub(super) by_point: Matrix2x3<f64>,
}

impl FulcrumConstraint {
    pub(super) fn at(tube: &Tube, fulcrum: Point3<f64>) -> Self {
        let [first, second] = perpendiculars(tube.axis);
        let rows = Matrix2x3::from_rows(&[first.transpose(), second.transpose()]);
        let back = fulcrum - tube.tip;
        let lever = back.dot(&tube.axis); // negative: the fulcrum lies behind the tip
        let mut by_pose = Matrix2x5::zeros();
        by_pose.fixed_view_mut::<2, 3>(0, 0).copy_from(&-rows);
        by_pose[(0, 3)] = -lever;
        by_pose[(1, 4)] = -lever;
        Self { miss: rows * back, by_pose, by_point: rows }
    }

    /// Covariance of an exact axis's distance from a fulcrum with this uncertainty, mm².
    pub(super) fn play(&self, fulcrum: &Fulcrum) -> Matrix2<f64> {
        Matrix2::identity() * (PLAY_MM * PLAY_MM) + self.by_point * fulcrum.covariance * self.by_point.transpose()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix5;

    use super::*;
    use crate::vision::pose::normal_equations::NormalEquations;

    const TRUE: Point3<f64> = Point3::new(-118.0, 108.0, 64.0);

    fn lines() -> impl Iterator<Item = (Point3<f64>, Vector3<f64>)> {
        (0..50).map(|k| {
            let t = f64::from(k) * 0.3;
            let tip = Point3::new(-20.0 + 30.0 * t.sin(), -5.0 + 25.0 * t.cos(), 190.0 + 12.0 * (t * 1.3).sin());
            (tip, (tip - TRUE).normalize())
        })
    }

    #[test]
    fn exact_axes_meet_in_the_fulcrum() {
        assert!((nearest_point(lines()).unwrap() - TRUE).norm() < 1e-9);
    }

    #[test]
    fn an_axis_beside_the_fulcrum_misses_by_as_many_sigmas_as_it_is_unsure_and_has_play() {
        let fulcrum = Fulcrum { at: TRUE, covariance: Matrix3::zeros() };
        let (tip, axis) = lines().next().unwrap();
        let covariance = Matrix5::identity() * 1e-12;
        let aside = perpendiculars(axis)[0] * (3.0 * PLAY_MM);
        let tube = Tube { tip: tip + aside, axis, radius: 2.5 };
        let evidence = NormalEquations::from_covariance(&covariance);
        let pose = TubeEstimate {
            tube,
            covariance,
            lasting: covariance,
            equations: evidence,
            residual_px: 0.1,
            support: 50.0,
        };
        assert!((miss_squared(&pose, &fulcrum) - 9.0).abs() < 1e-3);
    }
}
