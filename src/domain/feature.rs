//! The list of features, and the key that identifies one feature of a session.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::hand::{Hand, ToolHands};
use super::session::{FeatureRow, FeatureSpace};
use super::text::Invalid;
use super::trainee::Handedness;
use crate::motion::features::path_error::{PathBar, PathError};
use crate::motion::features::{self, Family, Feature, FeatureSettings, Space, StatedReason, UnknownFeature, path};

/// One feature of a session: of one tool, of one hand, or of the session as a whole, in one space.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
pub struct FeatureKey {
    /// Stable name, such as `path_length`.
    #[schema(value_type = String)]
    pub feature: &'static Feature,
    /// The tool's marker; `null` for a feature of a hand or of the whole session.
    pub tool: Option<String>,
    /// The hand that holds the tool, with any marker; `null` for a feature of a tool or of the whole session.
    #[serde(default)]
    pub in_hand: Option<Hand>,
    /// Where it was measured.
    pub space: FeatureSpace,
}

/// A [`FeatureKey`] by name, as stored rows have it. An earlier version may have measured a feature that this one does
/// not.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = FeatureKey)]
pub struct StoredFeatureKey {
    /// Stable name, such as `path_length`.
    pub feature: String,
    /// The tool's marker; `null` for a feature of the whole session.
    pub tool: Option<String>,
    /// Where it was measured.
    pub space: FeatureSpace,
}

/// Why a feature has no value, by its code.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct NotEnoughReason {
    /// Its stable name, such as `too_short`.
    pub code: &'static str,
    /// The numbers of the sentence in `not_enough`, in its order; shares in per cent.
    pub numbers: Vec<f64>,
}

impl NotEnoughReason {
    /// The reason that a result states in words; `None` if this program does not know them.
    pub fn of(sentence: &str) -> Option<Self> {
        StatedReason::of(sentence).map(|StatedReason { code, numbers }| Self { code, numbers })
    }
}

impl From<&FeatureRow> for StoredFeatureKey {
    fn from(row: &FeatureRow) -> Self {
        Self { feature: row.name.clone(), tool: row.tool.clone(), space: row.space }
    }
}

impl PartialEq<FeatureKey> for StoredFeatureKey {
    fn eq(&self, key: &FeatureKey) -> bool {
        key.in_hand.is_none() && self.feature == key.feature.name && self.tool == key.tool && self.space == key.space
    }
}

impl FeatureKey {
    /// A feature of the session as a whole.
    pub fn of_session(feature: &'static Feature, space: FeatureSpace) -> Self {
        Self { feature, tool: None, in_hand: None, space }
    }

    /// A feature of the tool with this marker; of the session as a whole without one.
    pub fn of_tool(feature: &'static Feature, tool: Option<String>, space: FeatureSpace) -> Self {
        Self { feature, tool, in_hand: None, space }
    }

    /// True for a feature of one tool or hand, false for one of the session as a whole.
    pub fn is_of_one_hand(&self) -> bool {
        self.tool.is_some() || self.in_hand.is_some()
    }

    /// True if values of people who prefer different hands must not be compared: the feature's tool is in the preferred
    /// hand of some and in the other hand of others.
    pub fn needs_same_preference(&self) -> bool {
        self.tool.is_some() || matches!(self.in_hand, Some(Hand::Left | Hand::Right))
    }

    /// The key in a session with these hands, of a trainee with this preferred hand: a hand is replaced by the tool
    /// that was in it. `None` if that tool is unknown.
    pub fn in_session(&self, hands: &ToolHands, preferred: Option<Handedness>) -> Option<FeatureKey> {
        let Some(hand) = self.in_hand else { return Some(self.clone()) };
        let tool = hands.tool(hand, preferred)?.to_owned();
        Some(Self::of_tool(self.feature, Some(tool), self.space))
    }
}

impl From<UnknownFeature> for Invalid {
    fn from(unknown: UnknownFeature) -> Self {
        Self::new("feature", format!("{unknown}; see GET /api/v1/features"))
    }
}

/// A feature that can be measured.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct FeatureInfo {
    /// Stable name, such as `path_length`.
    pub name: &'static str,
    /// Title for people.
    pub title: &'static str,
    /// Group of features: `time`, `speed`, `path`, `smoothness`, `movements`, `two_hands` or `view`.
    pub family: &'static str,
    /// Unit; `1` for shares, counts and ratios.
    pub unit: &'static str,
    /// Which values are better: `lower`, `higher` or `neither`.
    pub better: &'static str,
    /// Definition, in one or two sentences.
    pub description: String,
    /// Where the definition comes from.
    pub source: &'static str,
    /// Where it is measured.
    pub spaces: Vec<FeatureSpace>,
    /// Whether each tool has a value of its own.
    pub of_tools: bool,
    /// Whether the session as a whole has a value.
    pub of_session: bool,
}

impl From<&'static Feature> for FeatureInfo {
    fn from(feature: &'static Feature) -> Self {
        let Feature { name, title, unit, source, family, .. } = feature;
        let family = family.name();
        let description = feature.describe(&FeatureSettings::default());
        let spaces = feature.spaces.iter().map(|space| FeatureSpace::from(*space)).collect();
        let (better, of_tools, of_session) =
            (feature.direction.name(), feature.has_tool_values(), feature.has_session_value());
        Self { name, title, family, unit, better, description, source, spaces, of_tools, of_session }
    }
}

impl FeatureInfo {
    /// All features, in display order.
    pub fn all() -> Vec<Self> {
        features::FEATURES.iter().copied().map(Self::from).collect()
    }
}

impl From<Space> for FeatureSpace {
    fn from(space: Space) -> Self {
        match space {
            Space::ThreeD => FeatureSpace::Space3d,
            Space::Image => FeatureSpace::Image,
        }
    }
}

impl From<FeatureSpace> for Space {
    fn from(space: FeatureSpace) -> Self {
        match space {
            FeatureSpace::Space3d => Space::ThreeD,
            FeatureSpace::Image => Space::Image,
        }
    }
}

/// The space that a session's features are compared in first, and the errors that decide it: one camera sees depth
/// from size alone, so lengths in space may be off by much while those in the picture are not.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct ComparisonSpace {
    /// `image` where depth is poor: where lengths in space may be off by more than a fifth, and those in the picture by
    /// clearly less.
    pub space: FeatureSpace,
    /// Half the width of the error bar of all tools' path length in space, divided by that length; 1 where the error is
    /// as large as the length or larger.
    pub path_error_3d: f64,
    /// The same in the picture.
    pub path_error_image: f64,
}

impl ComparisonSpace {
    /// From the rows of a session; `None` for results without error bars, and for tools that hardly moved.
    pub fn of_session(rows: &[FeatureRow]) -> Option<Self> {
        let bar = |row: &FeatureRow| {
            let error = row.error.as_ref()?.as_ref().ok().filter(|_| row.name == path::PATH_LENGTH.name)?;
            let length = row.value.as_ref().ok().copied()?;
            Some(PathBar { space: row.space.into(), length, half: 0.5 * (error.high - error.low) })
        };
        let error = PathError::of_bars(&rows.iter().filter_map(bar).collect::<Vec<_>>())?;
        Some(Self { space: error.better_space().into(), path_error_3d: error.three_d, path_error_image: error.image })
    }
}

/// The space to use for a feature: the named one, or the first space that the feature is measured in.
pub fn resolve_space(feature: &Feature, named: Option<FeatureSpace>) -> Result<FeatureSpace, Invalid> {
    let measured: Vec<FeatureSpace> = feature.spaces.iter().map(|space| (*space).into()).collect();
    match (named, measured.first()) {
        (Some(space), _) if measured.contains(&space) => Ok(space),
        (None, Some(first)) => Ok(*first),
        _ => Err(Invalid::new("space", format!("{} is not measured in this space", feature.name))),
    }
}

/// True if another camera position would give another value: features in the image, along the camera's axes, and of the
/// field of view. Lengths, times and hull volumes in three dimensions do not depend on the camera.
pub fn depends_on_camera(key: &FeatureKey) -> bool {
    key.space == FeatureSpace::Image
        || path::ALONG_CAMERA_AXES.contains(&key.feature)
        || key.feature.family == Family::View
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_key_is_read_and_written_by_name_and_an_unknown_name_is_an_error() {
        let key = FeatureKey::of_tool(&path::SPREAD, Some("red".into()), FeatureSpace::Image);
        let written = json!({"feature": "spread", "tool": "red", "in_hand": null, "space": "image"});
        assert_eq!(json!(key), written);
        let before_hands = json!({"feature": "spread", "tool": "red", "space": "image"});
        assert_eq!(serde_json::from_value::<FeatureKey>(before_hands.clone()).unwrap(), key);
        assert_eq!(serde_json::from_value::<StoredFeatureKey>(before_hands).unwrap(), key);
        let unknown = json!({"feature": "wizardry", "tool": null, "space": "3d"});
        let error = serde_json::from_value::<FeatureKey>(unknown).unwrap_err().to_string();
        assert_eq!(error, "`wizardry` is not a feature");
        let refused = Invalid::from(features::find("wizardry").unwrap_err()).to_string();
        assert_eq!(refused, "feature: `wizardry` is not a feature; see GET /api/v1/features");
    }

    #[test]
    fn a_hand_is_the_tool_that_was_in_it_on_each_box() {
        let of_hand = |hand| FeatureKey {
            in_hand: Some(hand),
            ..FeatureKey::of_session(&path::PATH_LENGTH, FeatureSpace::Space3d)
        };
        let hands = |left: &str, right: &str| ToolHands { left: Some(left.to_owned()), right: Some(right.to_owned()) };
        let prefers = Some(Handedness::Right);
        for (hands, tool) in [(hands("orange", "cyan"), "cyan"), (hands("grasper", "scissors"), "scissors")] {
            let key = of_hand(Hand::Dominant).in_session(&hands, prefers).unwrap();
            assert_eq!(key, FeatureKey::of_tool(&path::PATH_LENGTH, Some(tool.to_owned()), FeatureSpace::Space3d));
        }
        assert_eq!(of_hand(Hand::Dominant).in_session(&hands("orange", "cyan"), None), None);
        assert_eq!(of_hand(Hand::Left).in_session(&ToolHands::default(), prefers), None);
        let whole = FeatureKey::of_session(&path::PATH_LENGTH, FeatureSpace::Space3d);
        assert_eq!(whole.in_session(&ToolHands::default(), None), Some(whole));
    }

    #[test]
    fn every_feature_is_listed_and_found_and_has_a_space() {
        for info in FeatureInfo::all() {
            let feature = features::find(info.name).unwrap();
            assert_eq!(resolve_space(feature, None).unwrap(), info.spaces[0], "{}", info.name);
        }
        assert!(resolve_space(features::find("duration").unwrap(), Some(FeatureSpace::Image)).is_err());
    }
}
