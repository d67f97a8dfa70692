//! Features of the path's shape: its length, its economy, and the space that it takes up.

use nalgebra::{Point3, Vector3};

use super::hull;
use super::motion::Motion;
use super::{
    BOTH, Direction, Family, Feature, FeatureSettings, Habit, IMAGE, MeasureFn, NotEnough, StretchSource, THREE_D,
};

/// Maximum path length of a hand, mm: ten kilometres.
pub(super) const MAX_PATH_MM: f64 = 1e7;

/// Length of the path.
pub static PATH_LENGTH: Feature = Feature {
    name: "path_length",
    title: "Path length",
    family: Family::Path,
    unit: "mm",
    direction: Direction::Lower,
    description: "Length of the seen path during the task; nothing is added across gaps.",
    source: "universal in the field",
    range: (0.0, MAX_PATH_MM),
    spaces: BOTH,
    windowed: true,
    stretches: StretchSource::Detours,
    habit: Some(Habit::ShorterWay),
    measures: &[MeasureFn::Tool(path_length)],
};

/// Distance moved towards and away from the camera.
pub static DEPTH_TRAVELLED: Feature = Feature {
    name: "depth_travelled",
    title: "Depth travelled",
    family: Family::Path,
    unit: "mm",
    direction: Direction::Lower,
    description: "Sum of the path's steps along the line of sight (z), both ways.",
    source: "depth perception of ProMIS and TrEndo, taken along the camera's axis",
    range: (0.0, MAX_PATH_MM),
    spaces: THREE_D,
    windowed: true,
    stretches: StretchSource::DepthDetours,
    habit: Some(Habit::JudgeDepth),
    measures: &[MeasureFn::Tool(depth_travelled)],
};

/// Size of the area used in the picture, relative to the path length.
pub static ECONOMY_OF_AREA: Feature = Feature {
    name: "economy_of_area",
    title: "Economy of area",
    family: Family::Path,
    unit: "1",
    direction: Direction::Higher,
    description: "Square root of the area of the path's bounding rectangle in x and y, divided by the path's length \
                  there.",
    source: "Oropesa 2013 (EVA)",
    range: (0.0, 1.0),
    spaces: IMAGE,
    windowed: false,
    stretches: StretchSource::UnsummedDetours,
    habit: Some(Habit::ShorterWay),
    measures: &[MeasureFn::Tool(economy_of_area)],
};

/// Size of the volume used, relative to the path length.
pub static ECONOMY_OF_VOLUME: Feature = Feature {
    name: "economy_of_volume",
    title: "Economy of volume",
    family: Family::Path,
    unit: "1",
    direction: Direction::Higher,
    description: "Cube root of the volume of the path's bounding box along the camera's axes, divided by the path's \
                  length.",
    source: "Oropesa 2013 (EVA)",
    range: (0.0, 1.0),
    spaces: THREE_D,
    windowed: false,
    stretches: StretchSource::UnsummedDetours,
    habit: Some(Habit::ShorterWay),
    measures: &[MeasureFn::Tool(economy_of_volume)],
};

/// Area used in the picture.
pub static WORKING_AREA: Feature = Feature {
    name: "working_area",
    title: "Working area",
    family: Family::Path,
    unit: "mm²",
    direction: Direction::Lower,
    description: "Area of the convex hull of the path in x and y.",
    source: "D'Angelo 2016 (working volume), in the plane",
    range: (0.0, 1e9),
    spaces: IMAGE,
    windowed: false,
    stretches: StretchSource::OutlyingSeconds,
    habit: Some(Habit::StayClose),
    measures: &[MeasureFn::Tool(working_area)],
};

/// Volume used.
pub static WORKING_VOLUME: Feature = Feature {
    name: "working_volume",
    title: "Working volume",
    family: Family::Path,
    unit: "mm³",
    direction: Direction::Lower,
    description: "Volume of the convex hull of the path.",
    source: "D'Angelo 2016",
    range: (0.0, 1e13),
    spaces: THREE_D,
    windowed: false,
    stretches: StretchSource::OutlyingSeconds,
    habit: Some(Habit::StayClose),
    measures: &[MeasureFn::Tool(working_volume)],
};

/// How far the tip spreads around its mean position.
pub static SPREAD: Feature = Feature {
    name: "spread",
    title: "Spread",
    family: Family::Path,
    unit: "mm",
    direction: Direction::Lower,
    description: "Root mean square distance of the tip from its mean position during the task.",
    source: "PerkTutor (spread of the position)",
    range: (0.0, 20_000.0),
    spaces: BOTH,
    windowed: true,
    stretches: StretchSource::OutlyingSeconds,
    habit: Some(Habit::StayClose),
    measures: &[MeasureFn::Tool(spread)],
};

/// The features that are measured along the camera's axes: another direction of the camera gives another value.
pub static ALONG_CAMERA_AXES: [&Feature; 2] = [&DEPTH_TRAVELLED, &ECONOMY_OF_VOLUME];

/// Maximum number of points in a hull: every instant of six minutes. A longer path is thinned to every second or third
/// instant. That costs almost nothing: a hand is slow at the turning points, which determine the hull.
const MAX_HULL_POINTS: usize = 20_000;

pub(super) fn path_length(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    Ok(motion.length_mm())
}

fn depth_travelled(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    Ok(motion.steps().map(|(a, b)| (b.position.z - a.position.z).abs()).sum())
}

fn economy_of_area(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    let length = moved_length(motion, settings)?;
    let size = bounding_box(motion);
    Ok((size.x * size.y).sqrt() / length)
}

fn economy_of_volume(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    let length = moved_length(motion, settings)?;
    let size = bounding_box(motion);
    Ok((size.x * size.y * size.z).cbrt() / length)
}

fn working_area(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    let points: Vec<_> = hull_points(motion, settings)?.iter().map(|p| p.xy()).collect();
    Ok(hull::area(&points))
}

fn working_volume(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    Ok(hull::volume(&hull_points(motion, settings)?))
}

fn spread(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    let count = motion.nodes().count() as f64;
    let mean = motion.nodes().map(|node| node.position.coords).sum::<Vector3<f64>>() / count;
    let square: f64 = motion.nodes().map(|node| (node.position.coords - mean).norm_squared()).sum();
    Ok((square / count).sqrt())
}

/// The path's length, if the tool moved at all.
fn moved_length(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    let length = path_length(motion, settings)?;
    if length < settings.smoothness_step_mm { Err(NotEnough::NoMovement) } else { Ok(length) }
}

fn hull_points(motion: &Motion, settings: &FeatureSettings) -> Result<Vec<Point3<f64>>, NotEnough> {
    moved_length(motion, settings)?;
    let every = motion.nodes().count().div_ceil(MAX_HULL_POINTS);
    Ok(motion.nodes().step_by(every).map(|node| node.position).collect())
}

fn bounding_box(motion: &Motion) -> Vector3<f64> {
    let corners = motion.nodes().map(|node| node.position.coords).map(|p| (p, p));
    let both = corners.reduce(|(least, most), (p, _)| (least.inf(&p), most.sup(&p)));
    both.map_or_else(Vector3::zeros, |(least, most)| most - least)
}
