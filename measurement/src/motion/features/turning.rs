//! Features of a tool's motion about its trocar: how far it turns, and how far it moves in and out.
//!
//! A tool pivots in the wall, so a hand turns and pushes the tool rather than moving its tip freely. Both features are
//! computed from the tip and the trocar ([`super::fulcrum`]), not from the shaft's own axis: the tip is known to tenths
//! of a millimetre, over a lever of decimetres.

use nalgebra::{Point3, Vector3};

use super::motion::Motion;
use super::path::MAX_PATH_MM;
use super::{Direction, Family, Feature, FeatureSettings, Habit, MeasureFn, NotEnough, StretchSource, THREE_D};

/// Total angle that the tool turns.
pub static ANGULAR_PATH: Feature = Feature {
    name: "angular_path",
    title: "Angular path",
    family: Family::Path,
    unit: "rad",
    direction: Direction::Lower,
    description: "Sum of the angles through which the line from the trocar to the tip turns during the seen time of \
                  the task.",
    source: "Simball Box (angular distance), without the shaft's own roll",
    range: (0.0, 1e5),
    spaces: THREE_D,
    windowed: true,
    stretches: StretchSource::TurningDetours,
    habit: Some(Habit::ShorterWay),
    measures: &[MeasureFn::Tool(angular_path)],
};

/// Mean speed of turning.
pub static ANGULAR_VELOCITY: Feature = Feature {
    name: "angular_velocity",
    title: "Mean angular velocity",
    family: Family::Speed,
    unit: "rad/s",
    direction: Direction::Neither,
    description: "Angular path divided by the seen time of the task.",
    source: "PerkTutor (rotational actions), as a mean",
    range: (0.0, 100.0),
    spaces: THREE_D,
    windowed: true,
    stretches: StretchSource::TurningSeconds,
    habit: None,
    measures: &[MeasureFn::Tool(angular_velocity)],
};

/// Distance moved in and out.
pub static INSERTION_TRAVELLED: Feature = Feature {
    name: "insertion_travelled",
    title: "Insertion travelled",
    family: Family::Path,
    unit: "mm",
    direction: Direction::Lower,
    description: "Sum of the changes of the tip's distance from the trocar, both ways: how far the hand pushes and \
                  pulls.",
    source: "EndoViS and PerkTutor (depth perception along the trocar's axis)",
    range: (0.0, MAX_PATH_MM),
    spaces: THREE_D,
    windowed: true,
    stretches: StretchSource::InsertionDetours,
    habit: Some(Habit::JudgeDepth),
    measures: &[MeasureFn::Tool(insertion_travelled)],
};

fn angular_path(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    let fulcrum = motion.context.fulcrum.ok_or(NotEnough::NoFulcrum)?;
    Ok(motion.steps().map(|(a, b)| angle(a.position - fulcrum, b.position - fulcrum)).sum())
}

fn angular_velocity(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    Ok(angular_path(motion, settings)? / motion.observed_s())
}

fn insertion_travelled(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    let fulcrum = motion.context.fulcrum.ok_or(NotEnough::NoFulcrum)?;
    let depth = |tip: Point3<f64>| (tip - fulcrum).norm();
    Ok(motion.steps().map(|(a, b)| (depth(b.position) - depth(a.position)).abs()).sum())
}

/// The angle between two directions; accurate also for small angles.
pub(in crate::motion) fn angle(a: Vector3<f64>, b: Vector3<f64>) -> f64 {
    a.cross(&b).norm().atan2(a.dot(&b))
}
