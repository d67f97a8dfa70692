//! What a tool wears, and which annotations this program understands (MARKERS 8).

use serde::{Deserialize, Serialize};

use super::AnnotationsError;

/// The newest `needs` that this program understands: 2 is for files with `marker`.
pub const KNOWN_NEEDS: u32 = 2;

/// What shows where a tool is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum MarkerEntry {
    /// A band of coloured tape round the tube.
    Band {
        /// Its length along the tube, mm.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        length_mm: Option<f64>,
    },
}

/// The keys that say what a program must understand, whatever the rest of the file says.
#[derive(Deserialize)]
struct Requirements {
    needs: Option<u32>,
    segmentation: Option<Kind>,
    #[serde(default)]
    tools: Vec<MarkedBy>,
}

#[derive(Deserialize)]
struct MarkedBy {
    #[serde(default)]
    tool: String,
    marker: Option<Kind>,
}

#[derive(Deserialize)]
struct Kind {
    kind: String,
}

/// Refuses a file that this program would misunderstand.
pub(super) fn check_requirements(text: &str) -> Result<(), AnnotationsError> {
    let syntax = |error: serde_json::Error| AnnotationsError::Syntax(error.to_string());
    let Requirements { needs, segmentation, tools } = serde_json::from_str(text).map_err(syntax)?;
    if let Some(needs) = needs.filter(|needs| *needs > KNOWN_NEEDS) {
        return Err(AnnotationsError::Newer(needs));
    }
    if let Some(Kind { kind }) = segmentation.filter(|of| of.kind != "knn") {
        return Err(AnnotationsError::UnknownSegmentation(kind));
    }
    let unknown = |MarkedBy { tool, marker }| marker.filter(|of: &Kind| of.kind != "band").map(|of| (tool, of.kind));
    match tools.into_iter().find_map(unknown) {
        Some((tool, kind)) => Err(AnnotationsError::UnknownMarker { tool, kind }),
        None => Ok(()),
    }
}
