//! Features of curvature: how tightly the path bends where the tool moves.

use super::motion::Motion;
use super::quantile::weighted_quantile;
use super::{BOTH, Direction, Family, Feature, FeatureSettings, Measure, NotEnough};

/// How tightly usually.
pub const MEDIAN_CURVATURE: Feature = Feature {
    name: "median_curvature",
    title: "Median curvature",
    description: "The curvature |v × a|/|v|³ that is exceeded along half of the path, where the speed is at least 10 mm/s.",
    measures: &[Measure::Tool(|motion, settings| curvature(motion, settings, 0.5))],
    ..CURVATURE
};

/// How tightly at most, without the outliers.
pub const PEAK_CURVATURE: Feature = Feature {
    name: "peak_curvature",
    title: "Peak curvature (95 %)",
    description: "The curvature |v × a|/|v|³ that is exceeded along 5 % of the path, where the speed is at least 10 mm/s.",
    measures: &[Measure::Tool(|motion, settings| curvature(motion, settings, 0.95))],
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
    spaces: BOTH,
    windowed: false,
    measures: &[],
};

fn curvature(motion: &Motion, settings: &FeatureSettings, share: f64) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    let moving = motion.nodes().map(|node| (node, node.velocity.norm()));
    let moving = moving.filter(|(_, speed)| *speed >= settings.movement_speed_mm_s);
    let bends = moving.map(|(node, speed)| (node.velocity.cross(&node.acceleration).norm() / speed.powi(3), speed));
    let bends: Vec<(f64, f64)> = bends.collect();
    if bends.is_empty() { Err(NotEnough::NoMovement) } else { Ok(weighted_quantile(bends, share)) }
}
