//! The smoothness of T 4.38: how sharply the path turns per millimetre.
//!
//! Measured over the movements only. The thesis leaves out steps of length 0, and with them the turn at a corner where
//! the hand stops. On a real path a stop is never exact, so everything slower than a movement is left out instead.

use nalgebra::Point3;

use super::motion::{Motion, Span};
use super::movement::movements;
use super::{BOTH, Direction, Family, Feature, FeatureSettings, Habit, MeasureFn, NotEnough, StretchSource};

/// How sharply the path turns.
pub static SMOOTHNESS: Feature = Feature {
    name: "smoothness",
    title: "Smoothness",
    family: Family::Smoothness,
    unit: "1/mm²",
    direction: Direction::Lower,
    description: "Sum over all movements, on points of their path {smoothness_step} mm apart, of the squared turn per \
                  length: (2·(π − angle) / (a + b))², where a and b are the lengths of two neighbouring steps and the \
                  angle is the one between them. Turning at rest does not count. 0 is a straight line; larger is more \
                  crooked.",
    source: "thesis eq. 4.38 with the cosine rule's denominator corrected to 2ab; Moll 2014 (OMPL)",
    range: (0.0, 1e9),
    spaces: BOTH,
    windowed: true,
    stretches: StretchSource::CrookedMovements,
    habit: Some(Habit::FlowingMovements),
    measures: &[MeasureFn::Tool(smoothness)],
};

/// Number of starting points, evenly spread over one step from the path's start. How much a corner is cut depends on
/// where the points fall, so the value is the mean over these starts.
const STARTS: u32 = 8;

fn smoothness(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    let step = settings.smoothness_step_mm;
    let start = |k: u32| step * f64::from(k) / f64::from(STARTS);
    let movements = movements(motion, settings);
    let of_start = |k: u32| movements.iter().flat_map(move |movement| turns(movement, start(k), step));
    let turns: Vec<f64> = (0..STARTS).flat_map(of_start).collect();
    if turns.is_empty() {
        return Err(NotEnough::NoMovement);
    }
    Ok(turns.iter().map(|turn| turn * turn).sum::<f64>() / f64::from(STARTS))
}

/// The contribution of a stretch of path to the sum, 1/mm².
pub(in crate::motion) fn squared_turns(span: &Span, step_mm: f64) -> f64 {
    let start = |k: u32| step_mm * f64::from(k) / f64::from(STARTS);
    let turns = (0..STARTS).flat_map(|k| turns(span, start(k), step_mm));
    turns.map(|turn| turn * turn).sum::<f64>() / f64::from(STARTS)
}

fn turns(span: &Span, start_mm: f64, step_mm: f64) -> Vec<f64> {
    walk_equal_steps(span, start_mm, step_mm).windows(3).map(|p| turn_per_mm(&p[0], &p[1], &p[2])).collect()
}

/// Points on a span's path, each one step from the point before in a straight line, like a pair of dividers walked
/// along it. The first is `start_mm` from the first node.
///
/// Equal steps *along* the path were tried and rejected: where a hand is slow, noise adds a millimetre of path within a
/// tenth of a millimetre, the chords shrink, and one such place outweighs the whole session.
fn walk_equal_steps(span: &Span, start_mm: f64, step_mm: f64) -> Vec<Point3<f64>> {
    let Some(first) = span.nodes.first().map(|node| node.position) else { return Vec::new() };
    let (mut last, mut points) = (first, if start_mm > 0.0 { Vec::new() } else { vec![first] });
    for (from, to) in span.nodes.iter().zip(&span.nodes[1..]).map(|(from, to)| (from.position, to.position)) {
        loop {
            let radius = if points.is_empty() { start_mm } else { step_mm };
            if (to - last).norm() <= radius {
                break;
            }
            last = sphere_exit(from, to, last, radius);
            points.push(last);
        }
    }
    points
}

/// The point where a leg that ends outside a sphere leaves it for the last time.
fn sphere_exit(from: Point3<f64>, to: Point3<f64>, centre: Point3<f64>, radius: f64) -> Point3<f64> {
    let (leg, offset) = (to - from, from - centre);
    let (a, b, c) = (leg.norm_squared(), offset.dot(&leg), offset.norm_squared() - radius * radius);
    from + leg * ((-b + (b * b - a * c).max(0.0).sqrt()) / a).clamp(0.0, 1.0)
}

/// One term of T 4.38 before it is squared; 0 if a step has no length.
fn turn_per_mm(before: &Point3<f64>, here: &Point3<f64>, after: &Point3<f64>) -> f64 {
    let (a, b, c) = ((here - before).norm(), (after - here).norm(), (after - before).norm());
    if a == 0.0 || b == 0.0 {
        return 0.0;
    }
    let cosine = (a * a + b * b - c * c) / (2.0 * a * b);
    2.0 * (std::f64::consts::PI - cosine.clamp(-1.0, 1.0).acos()) / (a + b)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::super::motion::MotionNode;
    use super::*;

    #[test]
    fn a_right_angle_turns_by_a_quarter_per_mean_step() {
        let term = turn_per_mm(&Point3::new(-1.0, 0.0, 0.0), &Point3::origin(), &Point3::new(0.0, 3.0, 0.0));
        assert!((term - std::f64::consts::PI / 4.0).abs() < 1e-12); // 2·(π/2)/(1+3)
    }

    #[test]
    fn the_points_are_a_step_apart_and_noise_at_rest_lays_none() {
        let node = |x: f64, y: f64| MotionNode {
            position: Point3::new(x, y, 0.0),
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
        };
        let trembling = (0..100).map(|i| node(0.3 * f64::from(i % 2), 0.0));
        let going = (0..100).map(|i| node(0.35 * f64::from(i), 0.2 * f64::from(i % 3)));
        let span = Span { first: 0, nodes: trembling.chain(going).collect() };
        let points = walk_equal_steps(&span, 0.0, 1.0);
        assert_eq!(points[0], Point3::origin());
        assert!(points.windows(2).all(|p| ((p[1] - p[0]).norm() - 1.0).abs() < 1e-9));
        assert!((30..=36).contains(&points.len()), "{} points on 34.65 mm", points.len());
        assert!(((walk_equal_steps(&span, 0.25, 1.0)[0] - Point3::origin()).norm() - 0.25).abs() < 1e-9);
    }

    #[test]
    fn going_straight_back_turns_by_a_half_and_resting_by_nothing() {
        let (a, b) = (Point3::origin(), Point3::new(1.0, 0.0, 0.0));
        assert_eq!(turn_per_mm(&a, &b, &a), std::f64::consts::PI);
        assert_eq!(turn_per_mm(&a, &a, &b), 0.0);
    }
}
