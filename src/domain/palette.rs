//! One version of a box's colour samples: never changed, only followed by the next.

use super::boxes::BoxTool;
use super::files::annotations::AnnotationsFile;
use serde::{Deserialize, Serialize};

/// Colour samples to be stored as a box's next version.
#[derive(Clone, Debug, PartialEq)]
pub struct NewPalette {
    /// What the instructor marked.
    pub annotations: AnnotationsFile,
    /// The tools that it names, with their sizes.
    pub tools: Vec<BoxTool>,
    /// How many samples each label gave.
    pub counts: Vec<LabelCount>,
    /// The samples themselves, in the form that the tracker reads back; opaque to the store.
    pub samples: Vec<u8>,
}

/// How many colour samples a label gave.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LabelCount {
    /// Marker's name, or `background`, `shaft`, …
    pub label: String,
    /// Pixels sampled.
    pub samples: u64,
}
