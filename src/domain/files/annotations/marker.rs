//! The markers of tools, and which annotations this program understands.

use serde::{Deserialize, Serialize};

use super::{AnnotationsError, AnnotationsFile, MarkedTool, ToolEntry, check_size};
use crate::vision::tracker::Marker;

/// The newest `needs` that this program understands: 2 is for files with `marker`.
pub const KNOWN_NEEDS: u32 = 2;

/// Maximum length of a band, mm.
const MAX_BAND_MM: f64 = 500.0;

/// Maximum length of a collar and of jaws, mm.
const MAX_PART_MM: f64 = 100.0;

/// The marker of a tool: what shows where it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum MarkerEntry {
    /// A band of coloured tape round the tube.
    Band {
        /// Its length along the tube, mm.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        length_mm: Option<f64>,
    },
    /// The bare shaft: the tool has no tape.
    Shaft {
        /// Length of the steel collar between the tube's end and the jaws, mm.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        collar_mm: Option<f64>,
        /// Distance from the tube's end to the point of the closed jaws, mm; 0 for a rod without jaws.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        jaw_mm: Option<f64>,
    },
}

impl MarkerEntry {
    /// True for a tool without tape.
    pub fn is_shaft(&self) -> bool {
        matches!(self, Self::Shaft { .. })
    }
}

impl From<MarkerEntry> for Marker {
    fn from(marker: MarkerEntry) -> Self {
        match marker {
            MarkerEntry::Band { length_mm } => Self::Band { length_mm },
            MarkerEntry::Shaft { collar_mm, jaw_mm } => Self::Shaft { collar_mm, jaw_mm },
        }
    }
}

/// The kinds of markers that this program follows.
const KNOWN_KINDS: [&str; 2] = ["band", "shaft"];

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
        marker.filter(|marker: &KindOnly| !KNOWN_KINDS.contains(&&*marker.kind)).map(|marker| (tool, marker.kind))
    };
    match tools.into_iter().find_map(other) {
        Some((tool, kind)) => Err(AnnotationsError::UnknownMarker { tool, kind }),
        None => Ok(()),
    }
}

impl AnnotationsFile {
    /// What shows where a tool is; its lengths are possible.
    pub(super) fn marker_of(&self, tool: &str, own: Option<&ToolEntry>) -> Result<MarkerEntry, AnnotationsError> {
        let check = |key, length: Option<f64>, limit| length.map_or(Ok(()), |mm| check_size(tool, key, mm, limit));
        let in_entry = own.and_then(|entry| entry.band_length_mm);
        let in_marker = match own.and_then(|entry| entry.marker) {
            Some(marker @ MarkerEntry::Shaft { collar_mm, jaw_mm }) => {
                check("marker.collar_mm", collar_mm, MAX_PART_MM)?;
                check("marker.jaw_mm", jaw_mm.filter(|mm| *mm != 0.0), MAX_PART_MM)?;
                return Ok(marker);
            }
            Some(MarkerEntry::Band { length_mm }) => length_mm,
            None => None,
        };
        if let (Some(one), Some(other)) = (in_entry, in_marker)
            && one != other
        {
            return Err(AnnotationsError::TwoLengths(tool.to_owned()));
        }
        check("marker.length_mm", in_marker, MAX_BAND_MM)?;
        let length_mm = in_marker.or(in_entry).or(self.band_length_mm);
        check("band_length_mm", length_mm, MAX_BAND_MM)?;
        Ok(MarkerEntry::Band { length_mm })
    }

    /// Refuses an entry of a tool without tape that an older program would misunderstand, or that contradicts itself.
    pub(super) fn check_shaft_entries(&self) -> Result<(), AnnotationsError> {
        let colours = self.marked_colours();
        for entry in self.tools.iter().filter(|entry| entry.is_shaft()) {
            let (tool, colour) = (entry.tool.clone(), entry.colour());
            if self.needs != Some(KNOWN_NEEDS) {
                return Err(AnnotationsError::ShaftWithoutNeeds(tool));
            }
            if entry.band_length_mm.is_some() {
                return Err(AnnotationsError::BandOfShaft(tool));
            }
            if self.tools.iter().any(|other| !other.is_shaft() && other.colour() == colour) {
                return Err(AnnotationsError::TapeAndShaft { tool, colour: colour.to_owned() });
            }
            if !colours.contains(&colour) {
                return Err(AnnotationsError::ShaftNotMarked { tool, colour: colour.to_owned() });
            }
        }
        Ok(())
    }
}

/// Refuses tools without tape that the tracker could not distinguish: one on each side is possible.
pub(super) fn check_shaft_sides(tools: &[MarkedTool]) -> Result<(), AnnotationsError> {
    let shafts: Vec<&MarkedTool> = tools.iter().filter(|tool| tool.marker.is_shaft()).collect();
    for (index, tool) in shafts.iter().enumerate() {
        let Some(side) = tool.side else { return Err(AnnotationsError::ShaftWithoutSide(tool.name.clone())) };
        if let Some(other) = shafts[..index].iter().find(|other| other.side == Some(side)) {
            return Err(AnnotationsError::ShaftsOnOneSide([other.name.clone(), tool.name.clone()]));
        }
    }
    Ok(())
}
