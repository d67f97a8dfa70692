//! `annotations.json`: the rectangles that an instructor marked, and the tools' sizes.

use serde::{Deserialize, Serialize};

/// Labels that are not tools.
pub const NOT_TOOLS: [&str; 5] = ["background", "shaft", "jaw", "glove", "other"];

/// From where the camera looks (T 6.4); tells which end of a band is distal where the picture does not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum View {
    /// Camera above the box.
    Top,
    /// Camera at its side.
    Side,
}

/// One marked rectangle, in pixels of the recorded frame. `x`, `y` is the first pixel inside.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LabelledRectangle {
    /// Decoded frame, from 0.
    pub frame: u64,
    /// Marker's name, or one of [`NOT_TOOLS`].
    pub label: String,
    /// First column.
    pub x: i64,
    /// First row.
    pub y: i64,
    /// Columns.
    pub w: i64,
    /// Rows.
    pub h: i64,
}

/// A tool's own sizes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ToolSize {
    /// Marker's name.
    pub tool: String,
    /// Outer diameter over the tape, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub diameter_mm: Option<f64>,
    /// Length of the tape band along the tube, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub band_length_mm: Option<f64>,
}

/// The whole file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct AnnotationsFile {
    /// Outer diameter over the tape of every tool without a size of its own, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tool_diameter_mm: Option<f64>,
    /// Band length of every tool without one of its own, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub band_length_mm: Option<f64>,
    /// Camera's place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub view: Option<View>,
    /// Clip in which `frame` counts, relative to this file; without it, the tracked clip.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub video: Option<String>,
    /// Sizes that win over the general ones.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tools: Vec<ToolSize>,
    /// Marked rectangles.
    pub labels: Vec<LabelledRectangle>,
}

/// A tool as the annotations describe it.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkedTool {
    /// Marker's name.
    pub name: String,
    /// Outer diameter over the tape, mm.
    pub diameter_mm: f64,
    /// Band length, mm, where known.
    pub band_length_mm: Option<f64>,
}

/// Why annotations cannot be used.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum AnnotationsError {
    /// Not JSON, or a key is missing or of the wrong type.
    #[error("not an annotations file: {0}")]
    Syntax(String),
    /// No rectangle names a tool.
    #[error("no label names a tool: mark at least one rectangle on a tool's tape, labelled with the marker's name")]
    NoTool,
    /// A tool without a diameter.
    #[error("tool `{0}` has no diameter: give tool_diameter_mm, or diameter_mm under tools")]
    NoDiameter(String),
    /// A size that no tube has.
    #[error("tool `{tool}`: {key} is {value} mm; expected more than 0 and at most {limit}")]
    Size {
        /// Which tool.
        tool: String,
        /// Which key.
        key: &'static str,
        /// What it holds, mm.
        value: f64,
        /// Largest accepted value, mm.
        limit: f64,
    },
    /// A rectangle that leaves the frame.
    #[error(
        "rectangle {index} (`{label}`, frame {frame}) spans x {x}..{right}, y {y}..{bottom}, outside the {width}×{height} frame"
    )]
    Outside {
        /// Position in the file, from 0.
        index: usize,
        /// Its label.
        label: String,
        /// Its frame.
        frame: u64,
        /// First column.
        x: i64,
        /// One past the last column.
        right: i64,
        /// First row.
        y: i64,
        /// One past the last row.
        bottom: i64,
        /// Frame width.
        width: u32,
        /// Frame height.
        height: u32,
    },
}

impl AnnotationsFile {
    /// Reads the file and checks that it names at least one tool of a possible size.
    pub fn parse(text: &str) -> Result<Self, AnnotationsError> {
        let file: Self = serde_json::from_str(text).map_err(|e| AnnotationsError::Syntax(e.to_string()))?;
        file.marked_tools()?;
        Ok(file)
    }

    /// The tools, in order of first appearance.
    pub fn marked_tools(&self) -> Result<Vec<MarkedTool>, AnnotationsError> {
        let mut tools: Vec<MarkedTool> = Vec::new();
        for label in self.labels.iter().map(|l| l.label.as_str()).filter(|l| !NOT_TOOLS.contains(l)) {
            if tools.iter().all(|t| t.name != label) {
                tools.push(self.marked_tool(label)?);
            }
        }
        if tools.is_empty() { Err(AnnotationsError::NoTool) } else { Ok(tools) }
    }

    fn marked_tool(&self, name: &str) -> Result<MarkedTool, AnnotationsError> {
        let own = self.tools.iter().find(|t| t.tool == name);
        let diameter_mm = own
            .and_then(|t| t.diameter_mm)
            .or(self.tool_diameter_mm)
            .ok_or_else(|| AnnotationsError::NoDiameter(name.to_owned()))?;
        let band_length_mm = own.and_then(|t| t.band_length_mm).or(self.band_length_mm);
        check_size(name, "diameter_mm", diameter_mm, 50.0)?;
        if let Some(length) = band_length_mm {
            check_size(name, "band_length_mm", length, 500.0)?;
        }
        Ok(MarkedTool { name: name.to_owned(), diameter_mm, band_length_mm })
    }

    /// Refuses rectangles that are empty or leave a frame of this size.
    pub fn check_inside(&self, width: u32, height: u32) -> Result<(), AnnotationsError> {
        let outside = |r: &&LabelledRectangle| {
            r.w <= 0
                || r.h <= 0
                || r.x < 0
                || r.y < 0
                || r.x.saturating_add(r.w) > i64::from(width)
                || r.y.saturating_add(r.h) > i64::from(height)
        };
        match self.labels.iter().enumerate().find(|(_, r)| outside(r)) {
            None => Ok(()),
            Some((index, r)) => Err(AnnotationsError::Outside {
                index,
                label: r.label.clone(),
                frame: r.frame,
                x: r.x,
                right: r.x.saturating_add(r.w),
                y: r.y,
                bottom: r.y.saturating_add(r.h),
                width,
                height,
            }),
        }
    }
}

fn check_size(tool: &str, key: &'static str, value: f64, limit: f64) -> Result<(), AnnotationsError> {
    if value.is_finite() && value > 0.0 && value <= limit {
        Ok(())
    } else {
        Err(AnnotationsError::Size { tool: tool.to_owned(), key, value, limit })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = r#"{"tool_diameter_mm":8.0,"band_length_mm":25,
        "tools":[{"tool":"cyan","diameter_mm":5.0}],
        "labels":[{"frame":1,"label":"orange","x":1,"y":2,"w":3,"h":4},
                  {"frame":1,"label":"cyan","x":9,"y":2,"w":3,"h":4},
                  {"frame":1,"label":"background","x":5,"y":6,"w":7,"h":8}]}"#;

    #[test]
    fn a_tools_own_size_wins_and_background_is_no_tool() {
        let tools = AnnotationsFile::parse(FILE).unwrap().marked_tools().unwrap();
        let names: Vec<_> = tools.iter().map(|t| (t.name.as_str(), t.diameter_mm, t.band_length_mm)).collect();
        assert_eq!(names, [("orange", 8.0, Some(25.0)), ("cyan", 5.0, Some(25.0))]);
    }

    #[test]
    fn a_rectangle_that_leaves_the_frame_is_named() {
        let file = AnnotationsFile::parse(FILE).unwrap();
        assert_eq!(file.check_inside(12, 14), Ok(()));
        assert!(matches!(file.check_inside(11, 14), Err(AnnotationsError::Outside { index: 1, .. })));
    }

    #[test]
    fn only_background_is_not_enough() {
        let text = r#"{"tool_diameter_mm":8,"labels":[{"frame":0,"label":"jaw","x":0,"y":0,"w":1,"h":1}]}"#;
        assert_eq!(AnnotationsFile::parse(text), Err(AnnotationsError::NoTool));
    }
}
