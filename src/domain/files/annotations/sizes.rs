//! Sizes of tools that are possible in a box trainer, and corrected sizes.

use serde::{Deserialize, Serialize};

use super::{AnnotationsError, MarkedTool, MarkerEntry, ToolEntry};

/// Accepted diameters, mm: trocars have 2 to 15 mm, and an instrument passes through one.
const DIAMETER_MM: [f64; 2] = [2.0, 15.0];

/// Accepted lengths of a band of tape, mm: a shorter one shows too little of its borders to give a direction, and a longer
/// one does not fit on the part of a tube that is inside a box.
const BAND_MM: [f64; 2] = [5.0, 150.0];

/// The corrected size of a tool.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ToolSize {
    /// The tool's name.
    pub tool: String,
    /// Outer diameter, over the tape if there is one, mm: 2 to 15.
    pub diameter_mm: f64,
    /// Length of the tape band along the tube, mm: 5 to 150; `null` if it was not measured, and for a bare shaft.
    #[serde(default)]
    pub band_length_mm: Option<f64>,
    /// The lengths of a tool without tape; `null` for a tool with tape.
    #[serde(default)]
    pub marker: Option<MarkerEntry>,
}

/// Refuses a tool that no box trainer has: most likely a slip of the keyboard, and all depths would be wrong.
pub(super) fn check_possible(tool: &MarkedTool) -> Result<(), AnnotationsError> {
    let check = |what, value: f64, [min, max]: [f64; 2], ground| match (min..=max).contains(&value) {
        true => Ok(()),
        false => Err(AnnotationsError::UnlikelySize { tool: tool.name.clone(), what, value, min, max, ground }),
    };
    check("its diameter", tool.diameter_mm, DIAMETER_MM, "an instrument passes through a trocar of 2 to 15 mm")?;
    match tool.marker {
        MarkerEntry::Band { length_mm: Some(length_mm) } => {
            let ground = "a shorter band shows no direction, and a longer one does not fit into a box";
            check("the length of its tape", length_mm, BAND_MM, ground)
        }
        MarkerEntry::Band { length_mm: None } | MarkerEntry::Shaft { .. } => Ok(()),
    }
}

/// The tool with its new size among `sizes`.
pub(super) fn resized(tool: MarkedTool, sizes: &[ToolSize]) -> Result<MarkedTool, AnnotationsError> {
    let size = sizes.iter().find(|size| size.tool == tool.name);
    let size = size.ok_or_else(|| AnnotationsError::SizeMissing(tool.name.clone()))?;
    let marker = match (tool.marker, size.marker) {
        (MarkerEntry::Band { .. }, None) => MarkerEntry::Band { length_mm: size.band_length_mm },
        (MarkerEntry::Band { .. }, Some(marker @ MarkerEntry::Band { .. })) => marker,
        (MarkerEntry::Shaft { .. }, Some(marker @ MarkerEntry::Shaft { .. })) if size.band_length_mm.is_none() => {
            marker
        }
        _ => return Err(AnnotationsError::OtherMarker(tool.name)),
    };
    Ok(MarkedTool { diameter_mm: size.diameter_mm, marker, ..tool })
}

impl From<MarkedTool> for ToolEntry {
    fn from(MarkedTool { name, colour, side, diameter_mm, marker }: MarkedTool) -> Self {
        let colour = (colour != name).then_some(colour);
        let (band_length_mm, marker) = match marker {
            MarkerEntry::Band { length_mm } => (length_mm, None),
            MarkerEntry::Shaft { .. } => (None, Some(marker)),
        };
        Self { tool: name, colour, side, diameter_mm: Some(diameter_mm), band_length_mm, marker }
    }
}

#[cfg(test)]
mod tests {
    use super::super::AnnotationsFile;
    use super::*;

    fn file(sizes: &str) -> Result<AnnotationsFile, AnnotationsError> {
        AnnotationsFile::parse(&format!(
            r#"{{"tools":[{{"tool":"left","colour":"orange"{sizes}}}],"labels":[{{"frame":0,"label":"orange","x":1,"y":1,"w":2,"h":2}}]}}"#
        ))
    }

    fn size(diameter_mm: f64, band_length_mm: Option<f64>) -> ToolSize {
        ToolSize { tool: "left".to_owned(), diameter_mm, band_length_mm, marker: None }
    }

    #[test]
    fn a_size_that_no_instrument_has_is_refused_with_the_range_and_its_ground() {
        for good in [
            r#","diameter_mm":2"#,
            r#","diameter_mm":15,"band_length_mm":5"#,
            r#","diameter_mm":5,"band_length_mm":150"#,
        ] {
            assert!(file(good).is_ok(), "{good}");
        }
        for (bad, range) in [
            (r#","diameter_mm":50"#, "expected 2 to 15 mm, because an instrument passes through a trocar"),
            (r#","diameter_mm":1.9"#, "expected 2 to 15 mm"),
            (r#","diameter_mm":5,"band_length_mm":2.8"#, "the length of its tape is 2.8 mm; expected 5 to 150 mm"),
            (r#","diameter_mm":5,"band_length_mm":151"#, "expected 5 to 150 mm"),
        ] {
            let refused = file(bad).unwrap_err().to_string();
            assert!(refused.contains(range) && refused.contains("tool `left`"), "{refused}");
        }
    }

    #[test]
    fn a_corrected_size_changes_nothing_else() {
        let before = file(r#","diameter_mm":5,"band_length_mm":25,"side":"right""#).unwrap();
        let after = before.clone().with_sizes(vec![size(5.2, Some(24.0))]).unwrap();
        assert_eq!(after.labels, before.labels);
        let [was, is] = [&before, &after].map(|file| file.marked_tools().unwrap().remove(0));
        assert_eq!((is.diameter_mm, is.marker), (5.2, MarkerEntry::Band { length_mm: Some(24.0) }));
        assert_eq!((is.name, is.colour, is.side), (was.name, was.colour, was.side));
        assert_eq!(after.clone().with_sizes(vec![size(5.0, Some(25.0))]), Ok(before.clone()), "and back");
        for (sizes, refusal) in [
            (vec![], AnnotationsError::SizeMissing("left".to_owned())),
            (
                vec![size(5.0, None), ToolSize { tool: "x".to_owned(), ..size(5.0, None) }],
                AnnotationsError::UnknownTool("x".to_owned()),
            ),
            (
                vec![ToolSize {
                    marker: Some(MarkerEntry::Shaft { collar_mm: None, jaw_mm: None }),
                    ..size(5.0, None)
                }],
                AnnotationsError::OtherMarker("left".to_owned()),
            ),
        ] {
            assert_eq!(before.clone().with_sizes(sizes), Err(refusal));
        }
        assert!(before.with_sizes(vec![size(50.0, None)]).unwrap_err().to_string().contains("expected 2 to 15 mm"));
    }
}
