//! The fixed point about which a tool turns: its trocar (METHOD 4, *beyond*).
//!
//! The axis of every pose passes through it. From many poses it is the point that asks the smallest turn of each, weighed
//! by how sure each pose is of its turn: a pose knows its direction in the picture to a thousandth, its lean towards the
//! camera only to a few hundredths, and an unweighted nearest point to all lines would be dragged towards the tips
//! by that noise. Known, it steadies the lean of every pose, and with it, depth.

use nalgebra::{Matrix2, Matrix2x3, Matrix2x5, Matrix3, Matrix5, Point3, Vector2, Vector3, Vector5};

use super::{TubeEstimate, across, turned};

/// A fulcrum with its covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fulcrum {
    /// Where, camera frame, mm.
    pub at: Point3<f64>,
    /// How sure, mm².
    pub covariance: Matrix3<f64>,
}

/// How far from the fulcrum an axis may pass: the play of a tube in its trocar, mm.
pub const PLAY_MM: f64 = 0.5;

/// Poses whose errors can be taken for independent: what light and background do to a border hardly changes from one
/// frame to the next, so that a thousand frames know the fulcrum no better than so many views of it.
const INDEPENDENT_POSES: f64 = 1.0;

/// The point nearest to all lines `point + s·axis`, unweighted: the textbook start. `None` where the lines are parallel.
pub fn nearest_point(lines: impl Iterator<Item = (Point3<f64>, Vector3<f64>)>) -> Option<Point3<f64>> {
    let (matrix, right) = lines.fold((Matrix3::zeros(), Vector3::zeros()), |(matrix, right), (point, axis)| {
        let projector = Matrix3::identity() - axis * axis.transpose();
        (matrix + projector, right + projector * point.coords)
    });
    Some(Point3::from(matrix.try_inverse()? * right))
}

/// Nearest to a tip that a trocar can be, in radii of the tube: behind the band and a piece of shaft.
const NEAREST_RADII: f64 = 8.0;

/// The fulcrum of many poses; `None` where they turn too little to show it, or are too few. Axes that hardly turn meet
/// where their errors make them meet, even before the tips: such a point is none.
pub fn estimate(poses: &[TubeEstimate]) -> Option<Fulcrum> {
    const FEWEST: usize = 10;
    const ROUNDS: usize = 20;
    if poses.len() < FEWEST {
        return None;
    }
    let mut at = nearest_point(poses.iter().map(|p| (p.tube.tip, p.tube.axis)))?;
    for _ in 0..ROUNDS {
        let (matrix, right) = poses.iter().fold((Matrix3::zeros(), Vector3::zeros()), |(matrix, right), pose| {
            let (weight, miss) = pull(pose, at);
            (matrix + weight, right + miss)
        });
        let covariance = matrix.try_inverse()?;
        let step = covariance * right;
        at += step;
        if !at.iter().all(|c| c.is_finite()) {
            return None;
        }
        if step.norm() < 1e-4 {
            if poses.iter().any(|pose| (pose.tube.tip - at).dot(&pose.tube.axis) < NEAREST_RADII * pose.tube.radius) {
                return None;
            }
            return Some(Fulcrum { at, covariance: covariance * (poses.len() as f64 / INDEPENDENT_POSES).max(1.0) });
        }
    }
    None
}

/// One pose's information on the fulcrum, and that times where it would move it.
fn pull(pose: &TubeEstimate, at: Point3<f64>) -> (Matrix3<f64>, Vector3<f64>) {
    let nothing = (Matrix3::zeros(), Vector3::zeros());
    let mut change = Vector5::zeros();
    for _ in 0..3 {
        let constraint = Constraint::at(&turned(&pose.tube, &change), at);
        let spread = constraint.spread(pose);
        let Some(information) = spread.try_inverse() else { return nothing };
        let missed = constraint.missed - constraint.by_pose * change; // as seen from the pose that was measured
        change = -(pose.covariance * constraint.by_pose.transpose() * information * missed);
    }
    let constraint = Constraint::at(&turned(&pose.tube, &change), at);
    let Some(information) = constraint.spread(pose).try_inverse() else { return nothing };
    let missed = constraint.missed - constraint.by_pose * change;
    let distance = missed.dot(&(information * missed));
    let weight = if distance > 9.0 { 9.0 / distance } else { 1.0 }; // a false pose must not hold the fulcrum
    let by_point = constraint.by_point;
    (by_point.transpose() * information * by_point * weight, -(by_point.transpose() * information * missed * weight))
}

/// The pose that is most likely when the axis is known to pass through the fulcrum.
pub fn steady(pose: &TubeEstimate, fulcrum: &Fulcrum) -> Option<TubeEstimate> {
    let mut change = Vector5::zeros();
    let (mut covariance, mut lasting) = (pose.covariance, pose.lasting);
    for _ in 0..4 {
        let constraint = Constraint::at(&turned(&pose.tube, &change), fulcrum.at);
        let own = constraint.by_point * fulcrum.covariance * constraint.by_point.transpose();
        let information = (constraint.spread(pose) + own).try_inverse()?;
        let gain = pose.covariance * constraint.by_pose.transpose() * information;
        let missed = constraint.missed - constraint.by_pose * change;
        change = -(gain * missed);
        covariance = pose.covariance - gain * constraint.by_pose * pose.covariance;
        let kept = Matrix5::identity() - gain * constraint.by_pose;
        lasting = kept * pose.lasting * kept.transpose() + gain * own * gain.transpose(); // the fulcrum's error lasts, too
    }
    let covariance = (covariance + covariance.transpose()) * 0.5;
    Some(TubeEstimate {
        tube: turned(&pose.tube, &change),
        covariance,
        lasting: (lasting + lasting.transpose()) * 0.5,
        ..*pose
    })
}

/// How many standard deviations the axis passes beside the fulcrum; squared, with two degrees of freedom.
pub fn miss_squared(pose: &TubeEstimate, fulcrum: &Fulcrum) -> f64 {
    let constraint = Constraint::at(&pose.tube, fulcrum.at);
    let spread = constraint.spread(pose) + constraint.by_point * fulcrum.covariance * constraint.by_point.transpose();
    spread.try_inverse().map_or(f64::INFINITY, |information| constraint.missed.dot(&(information * constraint.missed)))
}

/// "The axis passes through the fulcrum", linearised: by how much it misses, and how that depends on the unknowns.
struct Constraint {
    missed: Vector2<f64>,
    by_pose: Matrix2x5<f64>,
    by_point: Matrix2x3<f64>,
}

impl Constraint {
    fn at(tube: &crate::pipeline::tube::Tube, fulcrum: Point3<f64>) -> Self {
        let [first, second] = across(tube.axis);
        let rows = Matrix2x3::from_rows(&[first.transpose(), second.transpose()]);
        let back = fulcrum - tube.tip;
        let lever = back.dot(&tube.axis); // negative: the fulcrum lies behind the tip
        let mut by_pose = Matrix2x5::zeros();
        by_pose.fixed_view_mut::<2, 3>(0, 0).copy_from(&-rows);
        by_pose[(0, 3)] = -lever;
        by_pose[(1, 4)] = -lever;
        Self { missed: rows * back, by_pose, by_point: rows }
    }

    fn spread(&self, pose: &TubeEstimate) -> Matrix2<f64> {
        self.by_pose * pose.covariance * self.by_pose.transpose() + Matrix2::identity() * (PLAY_MM * PLAY_MM)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::tube::Tube;
    use rand::rngs::SmallRng;
    use rand::{Rng, RngExt, SeedableRng};

    const TRUE: Point3<f64> = Point3::new(-118.0, 108.0, 64.0);

    fn gaussian(random: &mut impl Rng) -> f64 {
        (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0
    }

    /// Poses as one camera sees them: the direction in the picture sharp, the lean towards the camera not.
    fn poses(lean_sigma: f64) -> Vec<TubeEstimate> {
        let mut random = SmallRng::seed_from_u64(7);
        (0..150)
            .map(|k| {
                let t = f64::from(k) * 0.1;
                let tip =
                    Point3::new(-20.0 + 30.0 * (t * 0.7).sin(), -5.0 + 25.0 * t.cos(), 190.0 + 12.0 * (t * 1.3).sin());
                let exact = Tube { tip, axis: (tip - TRUE).normalize(), radius: 2.5 };
                let [first, second] = across(exact.axis);
                let sight = tip.coords.normalize();
                let (sharp, lean) = (0.002, lean_sigma);
                // The direction of `across` that turns the tube towards the camera.
                let towards = Vector2::new(first.dot(&sight), second.dot(&sight)).normalize();
                let aside = Vector2::new(-towards.y, towards.x);
                let turn = towards * (gaussian(&mut random) * lean) + aside * (gaussian(&mut random) * sharp);
                let mut covariance = Matrix5::identity() * 1e-4;
                let spread =
                    towards * towards.transpose() * (lean * lean) + aside * aside.transpose() * (sharp * sharp);
                covariance.fixed_view_mut::<2, 2>(3, 3).copy_from(&spread);
                let tube = turned(&exact, &Vector5::new(0.0, 0.0, 0.0, turn.x, turn.y));
                TubeEstimate { tube, covariance, lasting: Matrix5::zeros(), residual_px: 0.1, support: 50.0 }
            })
            .collect()
    }

    #[test]
    fn exact_axes_meet_in_the_fulcrum() {
        let poses = poses(1e-9);
        let plain = nearest_point(poses.iter().map(|p| (p.tube.tip, p.tube.axis))).unwrap();
        assert!((plain - TRUE).norm() < 2.0);
        assert!((estimate(&poses).unwrap().at - TRUE).norm() < 2.0);
    }

    #[test]
    fn lean_noise_drags_the_plain_estimate_and_not_the_weighed_one() {
        let poses = poses(0.08);
        let plain = nearest_point(poses.iter().map(|p| (p.tube.tip, p.tube.axis))).unwrap();
        let weighed = estimate(&poses).unwrap();
        assert!((plain - TRUE).norm() > 15.0, "plain: {plain}");
        assert!((weighed.at - TRUE).norm() < 5.0, "weighed: {}", weighed.at);
        assert!((weighed.at - TRUE).norm() < 4.0 * weighed.covariance.trace().sqrt());
    }

    #[test]
    fn a_known_fulcrum_rights_the_lean() {
        let fulcrum = Fulcrum { at: TRUE, covariance: Matrix3::identity() * 0.25 };
        for pose in poses(0.08) {
            let axis = (pose.tube.tip - TRUE).normalize();
            let steadied = steady(&pose, &fulcrum).unwrap();
            assert!(steadied.tube.axis.angle(&axis) < 0.012, "{} rad off", steadied.tube.axis.angle(&axis));
            assert!(steadied.covariance.trace() <= pose.covariance.trace() + 1e-12);
        }
    }

    #[test]
    fn too_few_poses_are_not_enough() {
        assert_eq!(estimate(&poses(0.02)[..5]), None);
    }
}
