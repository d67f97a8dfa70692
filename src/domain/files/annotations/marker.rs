//! The markers of tools, and which annotations this program understands.

use serde::{Deserialize, Serialize};

use super::AnnotationsError;

/// The newest `needs` that this program understands: 2 is for files with `marker`.
pub const KNOWN_NEEDS: u32 = 2;

/// The marker of a tool: what shows where it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum MarkerEntry {
    /// A band of coloured tape round the tube.
    Band {
        /// Its length along the tube, mm.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        length_mm: Option<f64>,
    },
}

/// The version of the format, read before all else: a newer version may change the type of any other key.
#[derive(Deserialize)]
struct FormatVersion {
    needs: Option<u32>,
}

/// The keys of version 2 that name what a program must be able to do.
#[derive(Deserialize)]
struct Requirements {
    segmentation: Option<KindOnly>,
    #[serde(default)]
    tools: Vec<ToolRequirements>,
}

#[derive(Deserialize)]
struct ToolRequirements {
    #[serde(default)]
    tool: String,
    marker: Option<KindOnly>,
}

#[derive(Deserialize)]
struct KindOnly {
    kind: String,
}

/// Refuses a file that this program would misunderstand.
pub(super) fn check_requirements(text: &str) -> Result<(), AnnotationsError> {
    let syntax = |error: serde_json::Error| AnnotationsError::Syntax(error.to_string());
    let FormatVersion { needs } = serde_json::from_str(text).map_err(syntax)?;
    if let Some(needs) = needs.filter(|needs| *needs > KNOWN_NEEDS) {
        return Err(AnnotationsError::Newer(needs));
    }
    let Requirements { segmentation, tools } = serde_json::from_str(text).map_err(syntax)?;
    if let Some(KindOnly { kind }) = segmentation.filter(|of| of.kind != "knn") {
        return Err(AnnotationsError::UnknownSegmentation(kind));
    }
    let other = |ToolRequirements { tool, marker }| {
        marker.filter(|marker: &KindOnly| marker.kind != "band").map(|marker| (tool, marker.kind))
    };
    match tools.into_iter().find_map(other) {
        Some((tool, kind)) => Err(AnnotationsError::UnknownMarker { tool, kind }),
        None => Ok(()),
    }
}
