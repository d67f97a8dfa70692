//! A box trainer: a camera that looks into it from one side, and tools marked with coloured tape.

use serde::{Deserialize, Serialize};

use super::files::annotations::{MarkedTool, Side, View};
use super::text::{Code, Name, Paragraphs};

/// A box to be registered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewBox {
    /// What people call it.
    pub name: Name,
    /// Its short unique name; made from `name` if absent.
    pub code: Option<Code>,
    /// From where the camera looks, if known before tools are marked.
    pub view: Option<View>,
    /// Anything worth knowing about it.
    pub notes: Option<Paragraphs>,
}

/// Changes to a box; what is absent stays.
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
}

/// A tool as it is known in a box.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct BoxTool {
    /// The tool's name: its colour, such as `orange`, or one of its own.
    pub name: String,
    /// Colour of its tape, where that is not its name. Two tools of one colour are told apart by their trocars.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colour: Option<String>,
    /// The side of the picture on which its hand is, where that is told.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub side: Option<Side>,
    /// Outer diameter over the tape, mm.
    pub diameter_mm: f64,
    /// Length of the tape band along the tube, mm, where known.
    pub band_length_mm: Option<f64>,
}

impl From<MarkedTool> for BoxTool {
    fn from(tool: MarkedTool) -> Self {
        let MarkedTool { name, colour, side, diameter_mm, band_length_mm } = tool;
        let colour = (colour != name).then_some(colour);
        Self { name, colour, side, diameter_mm, band_length_mm }
    }
}
