//! T 4.38's smoothness: how sharply the path turns per millimetre.

use nalgebra::Point3;

use super::motion::{Motion, Span};
use super::{BOTH, Direction, Feature, FeatureSettings, Measure, NotEnough};

/// How crooked.
pub const SMOOTHNESS: Feature = Feature {
    name: "smoothness",
    title: "Smoothness",
    unit: "1/mm²",
    direction: Direction::Lower,
    description: "Sum over the path, on points 1 mm apart along it, of the squared turn per length: (2·(π − angle) / \
                  (a + b))², where a and b are the lengths of two neighbouring steps and the angle is the one between \
                  them. 0 is a straight line; larger is more crooked.",
    source: "T 4.38 with the cosine rule's denominator corrected to 2ab; Moll 2014 (OMPL)",
    range: (0.0, 1e9),
    spaces: BOTH,
    windowed: true,
    measures: &[Measure::Tool(smoothness)],
};

/// Where on the first step the points may start: a corner is cut more or less depending on where the points fall, so
/// the value is the mean over evenly spread starts.
const STARTS: u32 = 8;

fn smoothness(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    let step = settings.smoothness_step_mm;
    let start = |k: u32| step * f64::from(k) / f64::from(STARTS);
    let turns: Vec<f64> =
        (0..STARTS).flat_map(|k| motion.spans.iter().flat_map(move |s| turns(s, step, start(k)))).collect();
    if turns.is_empty() {
        return Err(NotEnough::NoMovement);
    }
    Ok(turns.iter().map(|turn| turn * turn).sum::<f64>() / f64::from(STARTS))
}

fn turns(span: &Span, step_mm: f64, start_mm: f64) -> Vec<f64> {
    let points: Vec<Point3<f64>> = along(span, step_mm, start_mm).collect();
    points.windows(3).map(|p| turn_per_mm(&p[0], &p[1], &p[2])).collect()
}

/// One term of T 4.38 before it is squared; 0 where a step has no length.
fn turn_per_mm(before: &Point3<f64>, here: &Point3<f64>, after: &Point3<f64>) -> f64 {
    let (a, b, c) = ((here - before).norm(), (after - here).norm(), (after - before).norm());
    if a == 0.0 || b == 0.0 {
        return 0.0;
    }
    let cosine = (a * a + b * b - c * c) / (2.0 * a * b);
    2.0 * (std::f64::consts::PI - cosine.clamp(-1.0, 1.0).acos()) / (a + b)
}

/// Points at equal distances along a span's path, the first at `start_mm` (less than a step) from its first node. The
/// rest that is shorter than a step is left out.
pub(super) fn along(span: &Span, step_mm: f64, start_mm: f64) -> impl Iterator<Item = Point3<f64>> {
    let legs = span.nodes.iter().zip(&span.nodes[1..]).map(|(from, to)| (from.position, to.position - from.position));
    let mut walked = step_mm - start_mm; // since the last point, as if there had been one before the path
    legs.filter(|(_, leg)| leg.norm() > 0.0).flat_map(move |(from, leg)| {
        let (before, length) = (walked, leg.norm());
        let count = ((before + length) / step_mm) as usize;
        walked = before + length - count as f64 * step_mm;
        (1..=count).map(move |k| from + leg * ((k as f64 * step_mm - before) / length))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_right_angle_turns_by_a_quarter_per_mean_step() {
        let term = turn_per_mm(&Point3::new(-1.0, 0.0, 0.0), &Point3::origin(), &Point3::new(0.0, 3.0, 0.0));
        assert!((term - std::f64::consts::PI / 4.0).abs() < 1e-12); // 2·(π/2)/(1+3)
    }

    #[test]
    fn going_straight_back_turns_by_a_half_and_resting_by_nothing() {
        let (a, b) = (Point3::origin(), Point3::new(1.0, 0.0, 0.0));
        assert_eq!(turn_per_mm(&a, &b, &a), std::f64::consts::PI);
        assert_eq!(turn_per_mm(&a, &a, &b), 0.0);
    }
}
