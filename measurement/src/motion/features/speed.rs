//! Features of speed and acceleration.

use super::motion::{Motion, MotionNode};
use super::{BOTH, Direction, Family, Feature, FeatureSettings, Habit, MeasureFn, NotEnough, StretchSource};
use crate::numbers::quantile::quantile;

/// Mean speed.
pub static MEAN_VELOCITY: Feature = Feature {
    name: "mean_velocity",
    title: "Mean velocity",
    family: Family::Speed,
    unit: "mm/s",
    direction: Direction::Neither,
    description: "Mean over the seen time of the task of the speed. Skilled hands tend to be faster, but noise and \
                  haste raise it too.",
    source: "thesis eq. 4.34",
    range: (0.0, 5_000.0),
    spaces: BOTH,
    windowed: true,
    stretches: StretchSource::WholeTask,
    habit: None,
    measures: &[MeasureFn::Tool(mean_velocity)],
};

/// Usual speed: the median.
pub static MEDIAN_VELOCITY: Feature = Feature {
    name: "median_velocity",
    title: "Median velocity",
    family: Family::Speed,
    unit: "mm/s",
    direction: Direction::Neither,
    description: "The speed that is exceeded in half of the seen time of the task.",
    source: "quantile of the speed; a few fast reaches raise the mean but not the median",
    range: (0.0, 5_000.0),
    spaces: BOTH,
    windowed: false,
    stretches: StretchSource::WholeTask,
    habit: None,
    measures: &[MeasureFn::Tool(|motion, settings| velocity_quantile(motion, settings, 0.5))],
};

/// Highest speed without outliers: the 95 % quantile.
pub static PEAK_VELOCITY: Feature = Feature {
    name: "peak_velocity",
    title: "Peak velocity (95 %)",
    family: Family::Speed,
    unit: "mm/s",
    direction: Direction::Neither,
    description: "The speed that is exceeded in 5 % of the seen time of the task.",
    source: "the 95 % quantile, because a maximum is mostly noise",
    range: (0.0, 5_000.0),
    spaces: BOTH,
    windowed: true,
    stretches: StretchSource::FastSeconds,
    habit: None,
    measures: &[MeasureFn::Tool(|motion, settings| velocity_quantile(motion, settings, 0.95))],
};

/// Mean acceleration: how unsteady the motion is.
pub static JITTER: Feature = Feature {
    name: "jitter",
    title: "Jitter",
    family: Family::Speed,
    unit: "mm/s²",
    direction: Direction::Lower,
    description: "Mean over the seen time of the task of the acceleration's magnitude. It grows with speed: compare \
                  people of similar speed, or use the relative jitter.",
    source: "thesis eq. 4.35",
    range: (0.0, 1e6),
    spaces: BOTH,
    windowed: true,
    stretches: StretchSource::UnsteadySeconds,
    habit: Some(Habit::SteadyHand),
    measures: &[MeasureFn::Tool(jitter)],
};

/// How unsteady the motion is relative to its speed.
pub static RELATIVE_JITTER: Feature = Feature {
    name: "relative_jitter",
    title: "Relative jitter",
    family: Family::Speed,
    unit: "1/s",
    direction: Direction::Lower,
    description: "Jitter divided by the mean velocity, so that fast hands do not count as unsteady.",
    source: "mean |a| · T / path length",
    range: (0.0, 1e4),
    spaces: BOTH,
    windowed: true,
    stretches: StretchSource::UnsteadySeconds,
    habit: Some(Habit::SteadyHand),
    measures: &[MeasureFn::Tool(relative_jitter)],
};

/// A tool with a mean speed below this is at rest, and a ratio to its speed is noise; mm/s.
const REST_MM_S: f64 = 1.0;

pub(super) fn mean_velocity(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    Ok(mean(motion, |node| node.velocity.norm()))
}

fn jitter(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    Ok(mean(motion, |node| node.acceleration.norm()))
}

fn relative_jitter(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    let speed = mean_velocity(motion, settings)?;
    if speed < REST_MM_S { Err(NotEnough::NoMovement) } else { Ok(jitter(motion, settings)? / speed) }
}

fn velocity_quantile(motion: &Motion, settings: &FeatureSettings, share: f64) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    Ok(quantile(motion.nodes().map(|node| node.velocity.norm()).collect(), share).unwrap_or(f64::NAN))
}

/// The mean over time, by the trapezium rule within each span.
fn mean(motion: &Motion, of: impl Fn(&MotionNode) -> f64) -> f64 {
    let sum: f64 = motion.steps().map(|(a, b)| (of(a) + of(b)) / 2.0).sum();
    sum / motion.observed_steps() as f64
}
