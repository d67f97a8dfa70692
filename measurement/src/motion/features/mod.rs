//! Features: numbers that describe how a hand moved, measured on its path. One file per family; [`FEATURES`] lists them
//! all.
//!
//! **In:** a trajectory (mm, s). **Out:** for each feature, tool and space a value with a unit, or the reason why there
//! is none. **Method** (METHOD 6; T 4.4): local cubic fits put each tool's observed stretches on one even time grid
//! ([`fit`], [`motion`]). So neither the frame rate nor a dropped frame changes a value beyond noise, no value is a
//! difference of two noisy points, and paths of every origin are measured alike. All features of a session are taken
//! over the *task*: from the moment that the first tool starts to move or comes into the picture until the last has
//! stopped or left ([`attempt`]); if nothing moved, over all of the time a tool was seen. **Gives up** with a
//! [`NotEnough`] where too little was seen. Sums describe the seen part, and [`view::NOT_SEEN_SHARE`] states how much
//! was not seen.

pub mod attempt;
pub mod curvature;
pub mod errors;
mod family;
pub mod fit;
pub mod fulcrum;
mod habit;
pub(crate) mod hull;
mod informative;
pub mod motion;
pub mod movement;
mod not_enough;
pub mod path;
pub mod path_error;
pub mod pauses;
pub mod per_movement;
pub mod reference;
pub mod running;
mod settings;
pub mod smoothness;
pub mod spectrum;
pub mod speed;
pub mod straightness;
mod stretch_source;
pub mod submovements;
pub mod time;
pub mod tip_distance;
pub mod turning;
pub mod two_hands;
pub mod view;

pub use family::Family;
pub use habit::Habit;
pub use informative::TooUncertain;
pub use not_enough::{NotEnough, StatedReason};
pub use settings::{FeatureSettings, MOVEMENT_END_RATIO};

use std::fmt;
use std::hash::{Hash, Hasher};

use errors::{ErrorBar, NoErrorBar};
use motion::Motion;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
pub(in crate::motion) use stretch_source::StretchSource;

/// The space that a feature is measured in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Space {
    /// x, y and z.
    ThreeD,
    /// x and y only, in mm: the thesis's form. The camera's weak depth hardly affects it: it changes the scale alone.
    Image,
}

impl Space {
    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            Space::ThreeD => "3d",
            Space::Image => "image",
        }
    }
}

const BOTH: &[Space] = &[Space::ThreeD, Space::Image];
const THREE_D: &[Space] = &[Space::ThreeD];
const IMAGE: &[Space] = &[Space::Image];

/// What a larger value means for skill.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Direction {
    /// Smaller is better.
    Lower,
    /// Larger is better.
    Higher,
    /// The direction alone says nothing about skill.
    Neither,
}

impl Direction {
    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            Direction::Lower => "lower",
            Direction::Higher => "higher",
            Direction::Neither => "neither",
        }
    }
}

/// A feature: all that the program knows about it. Each feature is a static in its family's file. The program passes it
/// as `&'static Feature`. Only stored rows, files and requests hold its name, which [`find`] resolves.
pub struct Feature {
    /// Stable name for files, API and pages.
    pub name: &'static str,
    /// Display name.
    pub title: &'static str,
    /// The family that lists it.
    pub family: Family,
    /// Unit; `1` for shares, counts and ratios.
    pub unit: &'static str,
    /// What a larger value means for skill.
    pub direction: Direction,
    /// Definition, in one or two sentences; `{…}` is replaced by a setting ([`Feature::describe`]).
    pub(in crate::motion) description: &'static str,
    /// Where the definition comes from.
    pub source: &'static str,
    /// Smallest and largest value that a hand can produce; a value outside is withheld.
    pub range: (f64, f64),
    /// The spaces that it is measured in.
    pub spaces: &'static [Space],
    /// Whether it is also measured over windows of the task.
    pub windowed: bool,
    /// The stretches of the recording that explain its value ([`crate::motion::stretches`]).
    pub(in crate::motion) stretches: StretchSource,
    /// What a trainee can change about it; `None` if there is no advice.
    pub habit: Option<Habit>,
    /// How it is measured, and on whose motion.
    measures: &'static [MeasureFn],
}

impl PartialEq for Feature {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Eq for Feature {}

impl Hash for Feature {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.name.hash(state);
    }
}

/// Shown as its name, so that keys and rows stay readable in messages of tests.
impl fmt::Debug for Feature {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// Shown as its name.
impl fmt::Display for Feature {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

/// Written as its name.
impl Serialize for Feature {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name)
    }
}

/// Read by its name.
impl<'de> Deserialize<'de> for &'static Feature {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        find(&String::deserialize(deserializer)?).map_err(D::Error::custom)
    }
}

/// A name that no feature has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is not a feature")]
pub struct UnknownFeature(pub String);

type FeatureResult = Result<f64, NotEnough>;

/// How a feature is measured, by the motion that it needs.
#[derive(Debug)]
enum MeasureFn {
    /// On each tool's own motion.
    Tool(fn(&Motion, &FeatureSettings) -> FeatureResult),
    /// On the motions of all tools together.
    Session(fn(&[Motion], &FeatureSettings) -> FeatureResult),
    /// On the motions of the two tools together.
    Pair(fn(&Motion, &Motion, &FeatureSettings) -> FeatureResult),
    /// On each of two tools compared with the other.
    EachOfPair(fn(&Motion, &Motion, &FeatureSettings) -> FeatureResult),
}

/// One measured feature.
#[derive(Clone, Debug, PartialEq)]
pub struct FeatureValue {
    /// The feature.
    pub feature: &'static Feature,
    /// The tool, as an index into the trajectory's tools; `None` for the session as a whole.
    pub tool: Option<usize>,
    /// The space it was measured in.
    pub space: Space,
    /// The value in the feature's unit, or why there is none.
    pub value: FeatureResult,
    /// The error bar, or why there is none.
    pub error: Result<ErrorBar, NoErrorBar>,
}

impl FeatureValue {
    /// Why the value says nothing; `None` if it says something, and without a value or an error bar.
    pub fn too_uncertain(&self) -> Option<TooUncertain> {
        let (value, bar) = (self.value.ok()?, self.error.ok()?);
        self.feature.too_uncertain(value, [bar.low, bar.high])
    }
}

/// Every feature, in reading order: family by family.
pub static FEATURES: &[&Feature] = &[
    &time::DURATION,
    &time::THINKING_TIME,
    &time::IDLE_SHARE,
    &pauses::SHORT_PAUSES,
    &pauses::MEDIUM_PAUSES,
    &pauses::LONG_PAUSES,
    &pauses::SHORT_PAUSE_SHARE,
    &pauses::MEDIUM_PAUSE_SHARE,
    &pauses::LONG_PAUSE_SHARE,
    &speed::MEAN_VELOCITY,
    &speed::MEDIAN_VELOCITY,
    &speed::PEAK_VELOCITY,
    &speed::JITTER,
    &speed::RELATIVE_JITTER,
    &turning::ANGULAR_VELOCITY,
    &path::PATH_LENGTH,
    &path::DEPTH_TRAVELLED,
    &path::ECONOMY_OF_AREA,
    &path::ECONOMY_OF_VOLUME,
    &path::WORKING_AREA,
    &path::WORKING_VOLUME,
    &path::SPREAD,
    &turning::ANGULAR_PATH,
    &turning::INSERTION_TRAVELLED,
    &smoothness::SMOOTHNESS,
    &curvature::MEDIAN_CURVATURE,
    &curvature::PEAK_CURVATURE,
    &per_movement::LOG_DIMENSIONLESS_JERK,
    &per_movement::NORMALISED_JERK,
    &per_movement::SPECTRAL_ARC_LENGTH,
    &spectrum::TREMOR_SHARE,
    &spectrum::MOTION_FREQUENCY,
    &per_movement::MOVEMENTS,
    &per_movement::MOVEMENT_RATE,
    &submovements::SUBMOVEMENTS,
    &straightness::PATH_RATIO,
    &straightness::FULCRUM_PATH_RATIO,
    &tip_distance::TIP_DISTANCE,
    &tip_distance::TIP_DISTANCE_SPREAD,
    &tip_distance::TIP_DISTANCE_LOW,
    &tip_distance::TIP_DISTANCE_HIGH,
    &two_hands::SYNCHRONY,
    &two_hands::SPEED_BALANCE,
    &two_hands::TOGETHER_SHARE,
    &two_hands::ONE_HAND_SHARE,
    &two_hands::NEITHER_SHARE,
    &two_hands::HANDEDNESS,
    &two_hands::HANDEDNESS_IN_TIME,
    &view::NOT_SEEN_SHARE,
    &view::LEFT_VIEW_SHARE,
    &view::HIDDEN_SHARE,
    &view::LOST_SHARE,
    &view::ABSENCES,
    &view::LONGEST_ABSENCE,
];

/// Finds a feature by its name.
///
/// # Errors
/// No feature has this name: it is misspelled, or an earlier version measured it and this one does not.
pub fn find(name: &str) -> Result<&'static Feature, UnknownFeature> {
    let found = FEATURES.iter().find(|feature| feature.name == name);
    found.copied().ok_or_else(|| UnknownFeature(name.to_owned()))
}

/// Measures every feature that `wanted` selects. Each motion must already be clipped to the interval to measure; a tool
/// without a motion gives the reason.
pub fn measure(
    motions: &[Result<Motion, NotEnough>],
    settings: &FeatureSettings,
    wanted: impl Fn(&Feature) -> bool,
) -> Vec<FeatureValue> {
    let wanted: Vec<&'static Feature> = FEATURES.iter().copied().filter(|feature| wanted(feature)).collect();
    let spaces = [Space::ThreeD, Space::Image].map(|space| (space, in_space(motions, space)));
    let of_feature = |feature: &'static Feature| {
        let spaces = spaces.iter().filter(|(space, _)| feature.spaces.contains(space));
        spaces.flat_map(move |(space, motions)| feature.measure(motions, *space, settings)).collect::<Vec<_>>()
    };
    wanted.into_iter().flat_map(of_feature).collect()
}

fn in_space(motions: &[Result<Motion, NotEnough>], space: Space) -> Vec<Result<Motion, NotEnough>> {
    motions.iter().map(|motion| motion.as_ref().map(|m| m.in_space(space)).map_err(|reason| *reason)).collect()
}

impl Feature {
    /// The definition, in one or two sentences, with the values of the settings.
    pub fn describe(&self, settings: &FeatureSettings) -> String {
        let filled =
            |text: String, (name, value): &(&str, f64)| text.replace(&format!("{{{name}}}"), &value.to_string());
        settings.for_descriptions().iter().fold(self.description.to_owned(), filled)
    }

    /// True if each tool has a value of its own.
    pub fn has_tool_values(&self) -> bool {
        self.measures.iter().any(|measure| matches!(measure, MeasureFn::Tool(_) | MeasureFn::EachOfPair(_)))
    }

    /// True if the session as a whole has a value.
    pub fn has_session_value(&self) -> bool {
        self.measures.iter().any(|measure| matches!(measure, MeasureFn::Session(_) | MeasureFn::Pair(_)))
    }

    /// True if depth decides its value in a space: every feature in three dimensions except the times of view and the
    /// duration, whose beginning and end show in the picture.
    pub fn needs_depth(&self, space: Space) -> bool {
        space == Space::ThreeD && self.family != Family::View && *self != time::DURATION
    }

    fn measure(
        &'static self,
        motions: &[Result<Motion, NotEnough>],
        space: Space,
        settings: &FeatureSettings,
    ) -> Vec<FeatureValue> {
        let values = self.measures.iter().flat_map(|measure| measure.apply(motions, settings));
        let error = Err(NoErrorBar::NotComputed);
        let value = |(tool, value)| FeatureValue { feature: self, tool, space, value: self.in_range(value), error };
        values.map(value).collect()
    }

    fn in_range(&self, value: FeatureResult) -> FeatureResult {
        let (least, most) = self.range;
        value.and_then(|v| if (least..=most).contains(&v) { Ok(v) } else { Err(NotEnough::OutOfRange) })
    }
}

impl MeasureFn {
    fn apply(
        &self,
        motions: &[Result<Motion, NotEnough>],
        settings: &FeatureSettings,
    ) -> Vec<(Option<usize>, FeatureResult)> {
        let each = |value: &dyn Fn(usize, &Motion) -> FeatureResult| {
            let values = motions.iter().enumerate().map(|(tool, motion)| {
                (Some(tool), motion.as_ref().map_err(|reason| *reason).and_then(|motion| value(tool, motion)))
            });
            values.collect()
        };
        match self {
            MeasureFn::Tool(value) => each(&|_, motion| value(motion, settings)),
            MeasureFn::Session(value) => {
                let seen: Vec<Motion> = motions.iter().flatten().cloned().collect();
                let reason = motions.iter().find_map(|motion| motion.as_ref().err()).unwrap_or(&NotEnough::NeverSeen);
                vec![(None, if seen.is_empty() { Err(*reason) } else { value(&seen, settings) })]
            }
            MeasureFn::Pair(value) => vec![(None, two_motions(motions).and_then(|(a, b)| value(a, b, settings)))],
            MeasureFn::EachOfPair(value) => each(&|tool, motion| {
                let (a, b) = two_motions(motions)?;
                value(motion, if tool == 0 { b } else { a }, settings)
            }),
        }
    }
}

fn two_motions(motions: &[Result<Motion, NotEnough>]) -> Result<(&Motion, &Motion), NotEnough> {
    match motions {
        [a, b] => Ok((a.as_ref().map_err(|r| *r)?, b.as_ref().map_err(|r| *r)?)),
        _ => Err(NotEnough::NotTwoTools { found: motions.len() }),
    }
}

#[cfg(test)]
mod tests;
