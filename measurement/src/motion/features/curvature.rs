//! Features of curvature: how tightly the path bends while the tool moves. Measured in the picture only: depth errors
//! of 0.4 mm bend straight strokes by 0.015/mm.

use super::motion::{Motion, MotionNode};
use super::{Direction, Family, Feature, FeatureSettings, Habit, IMAGE, MeasureFn, NotEnough, StretchSource};
use crate::numbers::quantile::weighted_quantile;

/// The usual curvature: the median along the path.
pub static MEDIAN_CURVATURE: Feature = Feature {
    name: "median_curvature",
    title: "Median curvature",
    description: "The curvature |v × a|/|v|³ that is exceeded along half of the path, where the speed is at least \
                  {movement_speed} mm/s.",
    measures: &[MeasureFn::Tool(|motion, settings| curvature(motion, settings, 0.5))],
    ..CURVATURE
};

/// The highest curvature without outliers: the 95 % quantile along the path.
pub static PEAK_CURVATURE: Feature = Feature {
    name: "peak_curvature",
    title: "Peak curvature (95 %)",
    description: "The curvature |v × a|/|v|³ that is exceeded along 5 % of the path, where the speed is at least \
                  {movement_speed} mm/s.",
    measures: &[MeasureFn::Tool(|motion, settings| curvature(motion, settings, 0.95))],
    ..CURVATURE
};

const CURVATURE: Feature = Feature {
    name: "",
    title: "",
    family: Family::Smoothness,
    unit: "1/mm",
    direction: Direction::Lower,
    description: "",
    source: "Fard 2018 (curvature); by path, not by time, so that slow turns, where noise bends most, count little",
    range: (0.0, 1e3),
    spaces: IMAGE,
    windowed: false,
    stretches: StretchSource::BendingSeconds,
    habit: Some(Habit::FlowingMovements),
    measures: &[],
};

fn curvature(motion: &Motion, settings: &FeatureSettings, share: f64) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    let moving = motion.nodes().map(|node| (node_curvature(node), node.velocity.norm()));
    let moving: Vec<(f64, f64)> = moving.filter(|(_, speed)| *speed >= settings.movement_speed_mm_s).collect();
    weighted_quantile(moving, share).ok_or(NotEnough::NoMovement)
}

/// The curvature of the path at a node, 1/mm.
pub(in crate::motion) fn node_curvature(node: &MotionNode) -> f64 {
    node.velocity.cross(&node.acceleration).norm() / node.velocity.norm().powi(3)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;

    #[test]
    fn a_helix_bends_by_its_radius_and_its_rise() {
        let (radius, rise) = (20.0, 7.0); // mm, and mm a radian
        let (sin, cos) = 0.8_f64.sin_cos();
        let node = MotionNode {
            position: Point3::new(radius * cos, radius * sin, 0.8 * rise),
            velocity: 3.0 * Vector3::new(-radius * sin, radius * cos, rise),
            acceleration: 9.0 * Vector3::new(-radius * cos, -radius * sin, 0.0),
        };
        assert!((node_curvature(&node) - radius / (radius * radius + rise * rise)).abs() < 1e-12);
    }
}
