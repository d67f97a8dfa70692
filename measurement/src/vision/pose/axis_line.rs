//! The line of a tube's axis (METHOD 5): what both borders show of a tube whose end is hidden.
//!
//! **In** edges on both borders of a tube that is about right. **Out** an [`AxisLine`]. **Method** Along each border a
//! straight line is fitted to the distances of its edges from the expected border. Half of the difference of both lines
//! is the distance of the axis from the expected one in the picture; their sum is the error of the width, and so of the
//! distance from the camera.

use nalgebra::{Matrix2, Matrix3, Point3, Vector2, Vector3};

use super::joint_fit::MeasuredEdge;
use crate::numbers::quantile::quantile;
use crate::vision::camera::Camera;
use crate::vision::edges::outline_probes::OutlinePoint;
use crate::vision::space::CameraPoint;
use crate::vision::tube::{BorderSide, Outline, OutlinePart, Tube};

/// The line of a tube's axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisLine {
    /// A point of it near the tip, camera frame, mm.
    pub point: Point3<f64>,
    /// Unit vector along it.
    pub direction: Vector3<f64>,
    /// Standard deviation across it in the picture, mm.
    pub across_mm: f64,
    /// Standard deviation of its distance from the camera, mm.
    pub depth_mm: f64,
}

/// Standard deviation along the axis that a position on it is stated with, mm: as much as the whole box, so that it
/// says nothing.
const ALONG_MM: f64 = 300.0;

impl AxisLine {
    /// The point of the line that is nearest to an expected tip, and its covariance: known across the line only.
    pub fn position_near(&self, expected: Point3<f64>) -> (Point3<f64>, Matrix3<f64>) {
        let along = self.direction;
        let at = self.point + along * (expected - self.point).dot(&along);
        let ray = at.coords.normalize();
        let across = ray.cross(&along).try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
        let part = |way: Vector3<f64>, sigma_mm: f64| way * way.transpose() * (sigma_mm * sigma_mm);
        (at, part(across, self.across_mm) + part(ray, self.depth_mm) + part(along, ALONG_MM))
    }
}

/// The tube, turned and moved so that its borders lie on the edges, and the line of its axis. `None` if too few edges
/// agree on either border, or if the width does not. `smear_px` is the error of each border by motion blur (standard
/// deviation).
pub fn fit(
    edges: &[MeasuredEdge],
    tube: &Tube,
    length_mm: f64,
    smear_px: f64,
    camera: &Camera,
) -> Option<(Tube, AxisLine)> {
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
    let width_px = 2.0 * tube.radius * px_per_mm(tube.tip - tube.axis * (0.5 * length_mm))?;
    let wider = (first.at(0.5) + second.at(0.5)) / width_px;
    if wider.abs() > MAX_WIDTH_ERROR {
        return None;
    }
    let moved = |at: Point3<f64>, share: f64| -> Option<Point3<f64>> {
        let aside = to_first * (0.5 * (first.at(share) - second.at(share)) / px_per_mm(at)?);
        Some((at + aside) / (1.0 + wider))
    };
    let tip = moved(tube.tip, 0.0)?;
    let direction = (tip - moved(tube.tip - tube.axis * length_mm, 1.0)?).try_normalize(1e-9)?;
    let at_tip_px = 0.5 * first.sigma_at_tip_px.hypot(second.sigma_at_tip_px);
    let across_px = BORDERS_ALIKE_PX.hypot(at_tip_px).hypot(smear_px);
    let line = AxisLine {
        point: tip,
        direction,
        across_mm: across_px / px_per_mm(tip)?,
        depth_mm: WIDTH_PX / width_px * tip.z,
    };
    Some((Tube { tip, axis: direction, ..*tube }, line))
}

/// Error that shifts both borders alike, pixels: the least that is stated for any position
/// (`motion::LEAST_SIGMA_PX`).
const BORDERS_ALIKE_PX: f64 = 0.3;

/// Error of the width on one frame, pixels. Light, gloss and background shift both borders by half a pixel, and lastingly:
/// so the 16 frames of half a second are weighted as one measurement with an error of one pixel.
const WIDTH_PX: f64 = 4.0;

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
    use crate::vision::pose::normal_equations::Offsets;
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
    fn fitted(edges: &[MeasuredEdge], off: [f64; 5]) -> Option<AxisLine> {
        let mut tube = perturbed(&tube(), &off.into());
        let mut line = None;
        for _ in 0..3 {
            let (turned, found) = fit(edges, &tube, LENGTH_MM, 0.0, &camera())?;
            (tube, line) = (turned, Some(found));
        }
        line
    }

    /// Distance of a point from the line, in the picture and along the line of sight, mm.
    fn miss_mm(line: &AxisLine, at: Point3<f64>) -> (f64, f64) {
        let (nearest, ray) =
            (line.point + line.direction * (at - line.point).dot(&line.direction), at.coords.normalize());
        let across = ray.cross(&line.direction).normalize();
        ((nearest - at).dot(&across).abs(), (nearest - at).dot(&ray).abs())
    }

    #[test]
    fn the_line_is_that_of_the_axis_from_a_start_that_is_off() {
        let line = fitted(&edges(&Offsets::zeros(), 0.0), [0.8, -0.6, 6.0, 0.02, -0.02]).unwrap();
        let (across_mm, depth_mm) = miss_mm(&line, tube().tip);
        assert!(across_mm < 0.02 && depth_mm < 1.5, "{across_mm} mm across, {depth_mm} in depth: the lean is a guess");
        let by_hand = miss_mm(&line, tube().tip - tube().axis * 150.0);
        assert!(by_hand.0 < 0.05, "{} mm by the hand", by_hand.0);
    }

    #[test]
    fn a_third_of_false_edges_leave_the_line_where_it_is() {
        let mut edges = edges(&Offsets::zeros(), 0.1);
        for edge in edges.iter_mut().step_by(3) {
            edge.at.0 += edge.outward * 3.0;
            *edge = MeasuredEdge::new(edge.point, edge.at, edge.outward, edge.sigma_px, &camera()).unwrap();
        }
        let line = fitted(&edges, [0.5, 0.0, 0.0, 0.01, 0.0]).unwrap();
        let (across_mm, depth_mm) = miss_mm(&line, tube().tip);
        assert!(across_mm < 2.0 * line.across_mm, "{across_mm} mm, stated {}", line.across_mm);
        assert!(depth_mm < 2.0 * line.depth_mm, "{depth_mm} mm, stated {}", line.depth_mm);
    }

    #[test]
    fn a_tube_of_another_width_or_without_one_border_has_no_line() {
        let edges = edges(&Offsets::zeros(), 0.0);
        let thin = Tube { radius: 1.9, ..tube() };
        assert!(fit(&edges, &thin, LENGTH_MM, 0.0, &camera()).is_none());
        let is_first = |edge: &MeasuredEdge| edge.point.part() == OutlinePart::Border(BorderSide::First);
        let one: Vec<MeasuredEdge> = edges.into_iter().filter(is_first).collect();
        assert!(fit(&one, &tube(), LENGTH_MM, 0.0, &camera()).is_none());
    }

    #[test]
    fn a_position_on_the_line_says_nothing_along_it() {
        let direction = Vector3::new(0.6, 0.0, 0.8);
        let line = AxisLine { point: Point3::new(0.0, 0.0, 150.0), direction, across_mm: 0.2, depth_mm: 2.0 };
        let expected = line.point + direction * 20.0 + Vector3::y() * 3.0;
        let (at, covariance) = line.position_near(expected);
        assert!((at - (line.point + direction * 20.0)).norm() < 1e-9);
        let sigma_mm = |way: Vector3<f64>| way.dot(&(covariance * way)).sqrt();
        let across = at.coords.cross(&direction).normalize();
        assert!((sigma_mm(across) - 0.2).abs() < 1e-6, "{} mm", sigma_mm(across));
        assert!(sigma_mm(direction) > 100.0);
        let information = covariance.try_inverse().unwrap();
        assert!(direction.dot(&(information * direction)) < 1.0 / 100f64.powi(2));
    }
}
