//! A box trainer: a box with a camera and with tools, which wear coloured tape or none.

use serde::{Deserialize, Serialize};

use super::files::annotations::{MarkedTool, MarkerEntry, Side, View};
use super::text::{Code, Name, Paragraphs};
use crate::ids::GroupId;

/// A box to be registered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewBox {
    /// Name for people.
    pub name: Name,
    /// Short unique name; derived from `name` if absent.
    pub code: Option<Code>,
    /// The camera's viewpoint, if known before tools are marked.
    pub view: Option<View>,
    /// Free notes.
    pub notes: Option<Paragraphs>,
    /// The groups whose instructors may change it. Absent: all groups of the instructor who registers it; for an
    /// administrator none, so that only administrators may change it.
    pub groups: Option<Vec<GroupId>>,
}

/// Changes to a box; absent fields stay as they are.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BoxChange {
    /// New name.
    pub name: Option<Name>,
    /// New code.
    pub code: Option<Code>,
    /// New view.
    pub view: Option<View>,
    /// New notes.
    pub notes: Option<Paragraphs>,
    /// The groups whose instructors may change it. An instructor names own groups, at least one; other groups stay.
    pub groups: Option<Vec<GroupId>>,
}

/// A tool of a box.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct BoxTool {
    /// The tool's name: its tape's colour, such as `orange`, or a name of its own.
    pub name: String,
    /// Colour of its tape or of its bare shaft, where that is not its name. Two tools of one colour are distinguished
    /// by their trocars.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colour: Option<String>,
    /// The side of the picture that the tool's hand is on, where known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub side: Option<Side>,
    /// Outer diameter, over the tape if there is one, mm.
    pub diameter_mm: f64,
    /// Length of the tape band along the tube, mm, where known.
    pub band_length_mm: Option<f64>,
    /// What shows where a tool without tape is; absent for a tool with a band of tape.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub marker: Option<MarkerEntry>,
}

impl From<MarkedTool> for BoxTool {
    fn from(tool: MarkedTool) -> Self {
        let MarkedTool { name, colour, side, diameter_mm, marker } = tool;
        let colour = (colour != name).then_some(colour);
        let (band_length_mm, marker) = match marker {
            MarkerEntry::Band { length_mm } => (length_mm, None),
            MarkerEntry::Shaft { .. } => (None, Some(marker)),
        };
        Self { name, colour, side, diameter_mm, band_length_mm, marker }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tool(marker: MarkerEntry) -> BoxTool {
        let (name, colour, side) = ("left".to_owned(), "shaft".to_owned(), Some(Side::Left));
        BoxTool::from(MarkedTool { name, colour, side, diameter_mm: 5.0, marker })
    }

    #[test]
    fn a_tool_with_tape_is_stored_as_before_and_one_without_tape_with_its_marker() {
        let band = tool(MarkerEntry::Band { length_mm: Some(25.0) });
        let shaft = tool(MarkerEntry::Shaft { collar_mm: Some(8.0), jaw_mm: None });
        let of_both = r#"{"name":"left","colour":"shaft","side":"left","diameter_mm":5.0,"band_length_mm":"#;
        for (tool, own) in [(band, "25.0}"), (shaft, r#"null,"marker":{"kind":"shaft","collar_mm":8.0}}"#)] {
            let stored = of_both.to_owned() + own;
            assert_eq!(serde_json::to_string(&tool).unwrap(), stored);
            assert_eq!(serde_json::from_str::<BoxTool>(&stored).unwrap(), tool);
        }
    }
}
