//! The plane through the camera and a tube's axis (METHOD 5): what both borders show of a tube whose end is hidden.
//!
//! **In** edges on both borders of a tube that is about right. **Out** an [`AxisPlane`]. **Method** Along each border a
//! straight line is fitted to the distances of its edges from the expected border. Half of the difference of both lines
//! is the distance of the axis from the expected one in the picture. Half of their sum is an error of the width, which
//! does not count.

use nalgebra::{Matrix2, Matrix3, Point3, Vector2, Vector3};

use super::joint_fit::MeasuredEdge;
use crate::numbers::quantile::quantile;
use crate::vision::camera::Camera;
use crate::vision::edges::outline_probes::OutlinePoint;
use crate::vision::space::CameraPoint;
use crate::vision::tube::{BorderSide, Outline, OutlinePart, Tube};

/// The plane through the camera and a tube's axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisPlane {
    /// Unit normal.
    pub normal: Vector3<f64>,
    /// Standard deviation of the tip's distance from it, mm.
    pub sigma_mm: f64,
}

/// Standard deviation in the plane that a position on it is stated with, mm: as much as the whole box, so that it says
/// nothing.
const IN_PLANE_MM: f64 = 300.0;

impl AxisPlane {
    /// The point of the plane that is nearest to an expected tip, and its covariance: known across the plane only.
    pub fn position_near(&self, expected: Point3<f64>) -> (Point3<f64>, Matrix3<f64>) {
        let across = self.normal * self.normal.transpose();
        let in_plane = (Matrix3::identity() - across) * (IN_PLANE_MM * IN_PLANE_MM);
        let at = expected - self.normal * self.normal.dot(&expected.coords);
        (at, across * (self.sigma_mm * self.sigma_mm) + in_plane)
    }

    /// By how many standard deviations an expected tip is off the plane, squared, if its covariance is this.
    pub fn miss_squared(&self, expected: Point3<f64>, covariance: &Matrix3<f64>) -> f64 {
        let miss_mm = self.normal.dot(&expected.coords);
        miss_mm * miss_mm / (self.normal.dot(&(covariance * self.normal)) + self.sigma_mm * self.sigma_mm)
    }
}

/// The tube, turned and moved so that its axis lies in the middle of the edges, and the plane of the axis. `None` if
/// too few edges agree on either border, or if the width does not. `smear_px` is the error by motion blur (standard
/// deviation).
pub fn fit(
    edges: &[MeasuredEdge],
    tube: &Tube,
    length_mm: f64,
    smear_px: f64,
    camera: &Camera,
) -> Option<(Tube, AxisPlane)> {
    /// Largest difference of the width from the expected one, as a share: several times the error of two borders.
    const MAX_WIDTH_ERROR: f64 = 0.15;
    let outline = tube.outline()?;
    let [first, second] = BorderSide::BOTH.map(|side| BorderFit::of(side, edges, &outline, length_mm, camera));
    let (first, second) = (first?, second?);
    let [n, m] = BorderSide::BOTH.map(|side| outline.normal(side));
    let to_first = (m - n).try_normalize(1e-9)?;
    let px_per_mm = |at: Point3<f64>| -> Option<f64> {
        let [one, other] = [0.5, -0.5].map(|mm| camera.project(CameraPoint(at + to_first * mm)));
        Some((one?.0 - other?.0).norm())
    };
    let middle = tube.tip - tube.axis * (0.5 * length_mm);
    let too_wide_px = first.at(0.5) + second.at(0.5);
    if too_wide_px.abs() > MAX_WIDTH_ERROR * 2.0 * tube.radius * px_per_mm(middle)? {
        return None;
    }
    let moved = |at: Point3<f64>, share: f64| -> Option<Point3<f64>> {
        Some(at + to_first * (0.5 * (first.at(share) - second.at(share)) / px_per_mm(at)?))
    };
    let tip = moved(tube.tip, 0.0)?;
    let axis = (tip - moved(tube.tip - tube.axis * length_mm, 1.0)?).try_normalize(1e-9)?;
    let normal = axis.cross(&tip.coords).try_normalize(1e-9)?;
    let by_edges_px = 0.5 * first.sigma_at_tip_px.hypot(second.sigma_at_tip_px);
    let sigma_px = BORDERS_ALIKE_PX.hypot(by_edges_px).hypot(smear_px);
    Some((Tube { tip, axis, ..*tube }, AxisPlane { normal, sigma_mm: sigma_px / px_per_mm(tip)? }))
}

/// Error that shifts both borders alike, pixels: the least that is stated for any position
/// (`motion::LEAST_SIGMA_PX`).
const BORDERS_ALIKE_PX: f64 = 0.3;

/// A line through the distances of a border's edges from the expected border.
struct BorderFit {
    /// Distance at the tip, and its increase up to the measured length, pixels.
    line: Vector2<f64>,
    sigma_at_tip_px: f64,
}

impl BorderFit {
    /// Fits it; `None` if too few edges agree with one line.
    fn of(
        side: BorderSide,
        edges: &[MeasuredEdge],
        outline: &Outline,
        length_mm: f64,
        camera: &Camera,
    ) -> Option<Self> {
        /// Edges on a border that is long enough to have a direction.
        const MIN_EDGES: usize = 5;
        const ROUNDS: usize = 5;
        /// Standard deviation of one edge, pixels: never less than that of texture and compression.
        const LEAST_SIGMA_PX: f64 = 0.1;
        let distances: Vec<(f64, f64)> = edges
            .iter()
            .filter(|edge| edge.point.part() == OutlinePart::Border(side))
            .filter_map(|edge| match edge.point {
                OutlinePoint::Border { back_mm, .. } => Some((back_mm / length_mm, edge.residual_px(outline, camera)?)),
                OutlinePoint::Rim { .. } => None,
            })
            .collect();
        if distances.len() < MIN_EDGES {
            return None;
        }
        let mut line = Vector2::new(quantile(distances.iter().map(|(_, px)| *px).collect(), 0.5)?, 0.0);
        for round in 0..=ROUNDS {
            let off = |(share, px): &(f64, f64)| px - line.x - line.y * share;
            let usual_px = quantile(distances.iter().map(|at| off(at).abs()).collect(), 0.5)?;
            let sigma_px = (usual_px / 0.6745).max(LEAST_SIGMA_PX);
            let mut matrix = Matrix2::zeros();
            let mut right = Vector2::zeros();
            let mut agreeing = 0;
            for at in distances.iter().filter(|at| off(at).abs() < 3.0 * sigma_px) {
                let row = Vector2::new(1.0, at.0);
                matrix += row * row.transpose();
                right += row * at.1;
                agreeing += 1;
            }
            let inverse = matrix.try_inverse().filter(|_| agreeing >= MIN_EDGES)?;
            if round == ROUNDS {
                return Some(Self { line, sigma_at_tip_px: sigma_px * inverse[(0, 0)].sqrt() });
            }
            line = inverse * right;
        }
        None
    }

    /// Distance at a share of the measured length, pixels.
    fn at(&self, share: f64) -> f64 {
        self.line.x + self.line.y * share
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand::rngs::SmallRng;

    use super::*;
    use crate::vision::camera::testing::wide as camera;
    use crate::vision::pose::normal_equations::{OFFSETS, Offsets};
    use crate::vision::pose::{perturbed, testing};

    const LENGTH_MM: f64 = 60.0;

    fn tube() -> Tube {
        Tube { tip: Point3::new(-30.0, -8.0, 190.0), axis: Vector3::new(0.40, -0.62, 0.675).normalize(), radius: 2.5 }
    }

    fn edges(offsets: &Offsets, noise_px: f64) -> Vec<MeasuredEdge> {
        let backs_mm: Vec<f64> = (1..25).map(|place| 2.4 * f64::from(place)).collect();
        testing::edges(&tube(), &camera(), &backs_mm, offsets, noise_px, &mut SmallRng::seed_from_u64(3))
    }

    /// Fitted from a start that is off by this.
    fn fitted(edges: &[MeasuredEdge], off: [f64; 5]) -> Option<(Tube, AxisPlane)> {
        let mut found = (perturbed(&tube(), &off.into()), None);
        for _ in 0..3 {
            let (tube, plane) = fit(edges, &found.0, LENGTH_MM, 0.0, &camera())?;
            found = (tube, Some(plane));
        }
        Some((found.0, found.1?))
    }

    fn miss_mm(plane: &AxisPlane, at: Point3<f64>) -> f64 {
        plane.normal.dot(&at.coords).abs()
    }

    #[test]
    fn the_plane_contains_the_axis_from_a_start_that_is_off() {
        let (_, plane) = fitted(&edges(&Offsets::zeros(), 0.0), [0.8, -0.6, 4.0, 0.02, -0.02]).unwrap();
        assert!(miss_mm(&plane, tube().tip) < 0.01, "{} mm at the tip", miss_mm(&plane, tube().tip));
        let behind = tube().tip - tube().axis * 150.0;
        assert!(miss_mm(&plane, behind) < 0.05, "{} mm by the hand", miss_mm(&plane, behind));
    }

    #[test]
    fn an_error_of_the_width_and_a_third_of_false_edges_leave_the_plane_where_it_is() {
        let wider = Offsets::from(std::array::from_fn::<f64, OFFSETS, _>(|i| if i == 0 { 0.8 } else { 0.0 }));
        let mut edges = edges(&wider, 0.1);
        for edge in edges.iter_mut().step_by(3) {
            edge.at.0 += edge.outward * 3.0;
            *edge = MeasuredEdge::new(edge.point, edge.at, edge.outward, edge.sigma_px, &camera()).unwrap();
        }
        let (_, plane) = fitted(&edges, [0.5, 0.0, 0.0, 0.01, 0.0]).unwrap();
        let miss = miss_mm(&plane, tube().tip);
        assert!(miss < 2.0 * plane.sigma_mm, "{miss} mm, stated {}", plane.sigma_mm);
    }

    #[test]
    fn a_tube_of_another_width_or_without_one_border_has_no_plane() {
        let edges = edges(&Offsets::zeros(), 0.0);
        let thin = Tube { radius: 1.9, ..tube() };
        assert!(fit(&edges, &thin, LENGTH_MM, 0.0, &camera()).is_none());
        let one: Vec<MeasuredEdge> =
            edges.into_iter().filter(|edge| edge.point.part() == OutlinePart::Border(BorderSide::First)).collect();
        assert!(fit(&one, &tube(), LENGTH_MM, 0.0, &camera()).is_none());
    }

    #[test]
    fn a_position_on_the_plane_says_nothing_along_it() {
        let plane = AxisPlane { normal: Vector3::new(0.8, -0.6, 0.0), sigma_mm: 0.2 };
        let expected = Point3::new(5.0, 2.0, 150.0);
        let (at, covariance) = plane.position_near(expected);
        assert!(plane.normal.dot(&at.coords).abs() < 1e-12);
        assert!((at - expected).cross(&plane.normal).norm() < 1e-12, "moved across the plane only");
        assert!((plane.normal.dot(&(covariance * plane.normal)).sqrt() - 0.2).abs() < 1e-9);
        assert!(covariance[(2, 2)].sqrt() > 100.0);
        let wide = Matrix3::identity() * 4.0;
        assert!((plane.miss_squared(expected, &wide) - 2.8f64.powi(2) / 4.04).abs() < 1e-9);
    }
}
