//! How direct each movement is, compared with the straight line and with the shortest way about the trocar.
//!
//! A straight line is no fair reference for a tool that pivots in the wall (Chmarra 2008): a hand retracts, turns and
//! inserts. Take two points at distances `r ≤ R` from the trocar, seen from there at an angle `θ` to each other. A way
//! that retracts to a distance `ρ`, turns and inserts has the length `(R − ρ) + (r − ρ) + ρ·θ`. As long as `θ ≤ 2`, the
//! shortest way has `ρ = r` and the length `R − r + r·θ`. For larger angles, which no box allows, it has `ρ = 0` and
//! the length `R + r`. A hand that does all of this at once can be shorter, by a factor of at most √2.

use nalgebra::Point3;

use super::motion::{Motion, Span};
use super::per_movement::median_over_movements;
use super::turning::angle;
use super::{BOTH, Direction, Family, Feature, FeatureSettings, Habit, MeasureFn, NotEnough, StretchSource, THREE_D};

/// Length compared with the straight line.
pub static PATH_RATIO: Feature = Feature {
    name: "path_ratio",
    title: "Path ratio",
    family: Family::Movements,
    unit: "1",
    direction: Direction::Lower,
    description: "A movement's path length divided by the straight distance from its start to its end; median over \
                  the movements of at most {longest_movement} s, weighted by their duration. 1 is a straight line.",
    source: "PerkTutor (path inefficiency), per movement, because a task ends where it began",
    range: (1.0, MAX_RATIO),
    spaces: BOTH,
    windowed: false,
    stretches: StretchSource::IndirectMovements,
    habit: Some(Habit::ShorterWay),
    measures: &[MeasureFn::Tool(path_ratio)],
};

/// Length compared with the shortest way about the trocar.
pub static FULCRUM_PATH_RATIO: Feature = Feature {
    name: "fulcrum_path_ratio",
    title: "Path ratio about the trocar",
    family: Family::Movements,
    unit: "1",
    direction: Direction::Lower,
    description: "A movement's path length divided by the shortest way from its start to its end that retracts, turns \
                  about the trocar and inserts, one after the other; median over the movements of at most \
                  {longest_movement} s, weighted by their duration. 1 is that way; a hand that does all at once \
                  reaches 0.7.",
    source: "ours, after Chmarra 2008: the straight line is no suitable reference",
    range: (0.7, MAX_RATIO),
    spaces: THREE_D,
    windowed: false,
    stretches: StretchSource::IndirectAboutTrocar,
    habit: Some(Habit::ShorterWay),
    measures: &[MeasureFn::Tool(fulcrum_path_ratio)],
};

/// Maximum ratio; a movement with a larger one ends where it began.
const MAX_RATIO: f64 = 100.0;

fn path_ratio(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    let ratio = median_ratio(motion, settings, |from, to| (to - from).norm())?;
    Ok(ratio.max(1.0)) // rounding
}

fn fulcrum_path_ratio(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    let fulcrum = motion.context.fulcrum.ok_or(NotEnough::NoFulcrum)?;
    median_ratio(motion, settings, |from, to| shortest_way_about(fulcrum, from, to))
}

fn median_ratio(
    motion: &Motion,
    settings: &FeatureSettings,
    way_mm: impl Fn(Point3<f64>, Point3<f64>) -> f64,
) -> Result<f64, NotEnough> {
    let ratio = |movement: &Span| {
        let (from, to) = (movement.nodes.first()?.position, movement.nodes.last()?.position);
        let ratio = movement.length_mm() / way_mm(from, to);
        Some(if ratio <= MAX_RATIO { ratio } else { f64::INFINITY })
    };
    let median = median_over_movements(motion, settings, ratio)?;
    if median.is_finite() { Ok(median) } else { Err(NotEnough::ReturnsToStart) }
}

/// The length of the shortest way that retracts, turns and inserts, mm.
pub(in crate::motion) fn shortest_way_about(fulcrum: Point3<f64>, from: Point3<f64>, to: Point3<f64>) -> f64 {
    let (a, b) = (from - fulcrum, to - fulcrum);
    let (near, far) = (a.norm().min(b.norm()), a.norm().max(b.norm()));
    far - near + near * angle(a, b).min(2.0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const FULCRUM: Point3<f64> = Point3::new(-100.0, -80.0, 60.0);

    #[test]
    fn going_straight_in_is_the_way_and_so_is_turning_alone() {
        let (tip, back) = (Point3::new(20.0, 10.0, 200.0), 0.7);
        let retracted = FULCRUM + (tip - FULCRUM) * back;
        assert!((shortest_way_about(FULCRUM, tip, retracted) - (tip - retracted).norm()).abs() < 1e-9);
        let turned = FULCRUM + nalgebra::Rotation3::from_euler_angles(0.0, 0.3, 0.0) * (tip - FULCRUM);
        let lever = (tip - FULCRUM).norm();
        assert!(
            (shortest_way_about(FULCRUM, tip, turned) - lever * angle(tip - FULCRUM, turned - FULCRUM)).abs() < 1e-9
        );
    }

    proptest! {
        #[test]
        fn the_way_is_the_shortest_of_its_kind_and_no_shorter_than_straight(
            from in prop::array::uniform3(-100.0f64..100.0),
            to in prop::array::uniform3(-100.0f64..100.0),
            share in 0.0f64..1.0,
        ) {
            let (from, to) = (Point3::from(from), Point3::from(to));
            let (a, b) = (from - FULCRUM, to - FULCRUM);
            let at = share * a.norm().min(b.norm());
            let other = a.norm() - at + b.norm() - at + at * angle(a, b);
            let way = shortest_way_about(FULCRUM, from, to);
            prop_assert!(way <= other + 1e-9 && way >= (to - from).norm() - 1e-9);
            prop_assert_eq!(way, shortest_way_about(FULCRUM, to, from));
        }
    }
}
