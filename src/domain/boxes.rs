//! A box trainer: a camera that looks into it from one side, and tools marked with coloured tape.

use serde::{Deserialize, Serialize};

use super::files::annotations::{MarkedTool, View};
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
    /// Marker's name, such as `orange`.
    pub name: String,
    /// Outer diameter over the tape, mm.
    pub diameter_mm: f64,
    /// Length of the tape band along the tube, mm, where known.
    pub band_length_mm: Option<f64>,
}

impl From<MarkedTool> for BoxTool {
    fn from(tool: MarkedTool) -> Self {
        Self { name: tool.name, diameter_mm: tool.diameter_mm, band_length_mm: tool.band_length_mm }
    }
}
