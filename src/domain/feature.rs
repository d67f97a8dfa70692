//! The list of features, and the key that identifies one feature of a session.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::session::{FeatureRow, FeatureSpace};
use super::text::Invalid;

use crate::motion::features::{self, Family, Feature, Space};

/// One feature of a session: of one tool, or of the session as a whole, in one space.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
pub struct FeatureKey {
    /// Stable name, such as `path_length`.
    pub feature: String,
    /// The tool's marker; `null` for a feature of the whole session.
    pub tool: Option<String>,
    /// Where it was measured.
    pub space: FeatureSpace,
}

impl From<&FeatureRow> for FeatureKey {
    fn from(row: &FeatureRow) -> Self {
        Self { feature: row.name.clone(), tool: row.tool.clone(), space: row.space }
    }
}

/// A feature that can be measured.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct FeatureInfo {
    /// Stable name, such as `path_length`.
    pub name: &'static str,
    /// Title for people.
    pub title: &'static str,
    /// Unit; `1` for shares, counts and ratios.
    pub unit: &'static str,
    /// Which values are better: `lower`, `higher` or `neither`.
    pub better: &'static str,
    /// Definition, in one or two sentences.
    pub description: &'static str,
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
        let Feature { name, title, unit, description, source, .. } = feature;
        let spaces = feature.spaces.iter().map(|space| FeatureSpace::from(*space)).collect();
        let (better, of_tools, of_session) =
            (feature.direction.name(), feature.has_tool_values(), feature.has_session_value());
        Self { name, title, unit, better, description, source, spaces, of_tools, of_session }
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

/// Finds a feature by its name.
pub fn find_feature(name: &str) -> Result<&'static Feature, Invalid> {
    features::find(name)
        .ok_or_else(|| Invalid::new("feature", format!("`{name}` is not a feature; see GET /api/v1/features")))
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
    let name = key.feature.as_str();
    key.space == FeatureSpace::Image
        || ["depth_travelled", "economy_of_volume"].contains(&name)
        || features::find(name).is_some_and(|feature| feature.family == Family::View)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_feature_is_listed_and_found_and_has_a_space() {
        for info in FeatureInfo::all() {
            let feature = find_feature(info.name).unwrap();
            assert_eq!(resolve_space(feature, None).unwrap(), info.spaces[0], "{}", info.name);
        }
        assert!(find_feature("wizardry").is_err());
        assert!(resolve_space(find_feature("duration").unwrap(), Some(FeatureSpace::Image)).is_err());
    }

    #[test]
    fn features_along_the_cameras_axes_exist() {
        for name in ["depth_travelled", "economy_of_volume"] {
            assert!(features::find(name).is_some(), "{name}");
        }
    }
}
