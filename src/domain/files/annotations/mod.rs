//! `annotations.json`: the rectangles that an instructor marked, and the tools' sizes.
//!
//! A rectangle's label is a tape colour, and a tool is named after its colour, unless `tools` says otherwise: two tools
//! with the same tape are entries with different names and one `colour`. Labels may then name the colour or either
//! tool. The tracker distinguishes such tools by their trocars. It assigns the names by the side of the picture that
//! each hand is on: the entry's `side`, else a word of its name (`left`, `grasper-right`), else the first entry is the
//! left one.
//!
//! ```json
//! {"tool_diameter_mm": 5.0,
//!  "tools": [{"tool": "left", "colour": "orange"}, {"tool": "right", "colour": "orange", "side": "right"}],
//!  "labels": [{"frame": 12, "label": "orange", "x": 310, "y": 220, "w": 18, "h": 9}]}
//! ```
//!
//! A tool without tape has a `marker` of the kind `shaft`, and the file says `needs` 2. Rectangles labelled `shaft`
//! then show the look of its tube.

mod marker;
mod sizes;

pub use marker::{KNOWN_NEEDS, MarkerEntry};
pub use sizes::ToolSize;

use serde::{Deserialize, Serialize};

use super::{MAX_TOOL_NAME_LENGTH, is_tool_name};
use crate::vision::tracker::{CameraView, HandSide, Marker, ToolSpec};

/// The label of the tools' shafts: the colour of a tool without tape, unless its entry names another one.
const SHAFT: &str = "shaft";

/// Labels that are not tools; [`SHAFT`] is one where a tool without tape has this colour.
pub const NOT_TOOLS: [&str; 5] = ["background", SHAFT, "jaw", "glove", "other"];

/// Maximum number of tape colours in one box; the tracker has the same limit for tools.
const MAX_COLOURS: usize = 16;

/// The camera's viewpoint (T 6.4); it decides which end of a band is distal where the picture does not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum View {
    /// Camera above the box.
    Top,
    /// Camera at the side of the box.
    Side,
}

impl From<View> for CameraView {
    fn from(view: View) -> Self {
        match view {
            View::Top => Self::Top,
            View::Side => Self::Side,
        }
    }
}

/// One marked rectangle, in pixels of the recorded frame. `x`, `y` is the first pixel inside.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LabelledRectangle {
    /// Decoded frame, from 0.
    pub frame: u64,
    /// Colour of a tool's tape or shaft, or the tool's name, or one of [`NOT_TOOLS`].
    pub label: String,
    /// First column.
    pub x: i64,
    /// First row.
    pub y: i64,
    /// Columns.
    pub w: i64,
    /// Rows.
    pub h: i64,
    /// Rectangles of one frame and label with the same number were painted in one stroke. They count as one mark,
    /// because adjacent areas look alike.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stroke: Option<u32>,
}

/// The side of the picture that a tool's hand is on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// The tool comes from the left.
    Left,
    /// The tool comes from the right.
    Right,
}

impl From<Side> for HandSide {
    fn from(side: Side) -> Self {
        match side {
            Side::Left => Self::Left,
            Side::Right => Self::Right,
        }
    }
}

impl Side {
    /// The side that a word of a tool's name gives, unless the name has words for both.
    fn from_name(name: &str) -> Option<Self> {
        let has = |side: &str| name.split(|c: char| !c.is_alphanumeric()).any(|word| word.eq_ignore_ascii_case(side));
        match (has("left"), has("right")) {
            (true, false) => Some(Self::Left),
            (false, true) => Some(Self::Right),
            _ => None,
        }
    }
}

/// One tool's entry.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct ToolEntry {
    /// The tool's name.
    pub tool: String,
    /// Colour of its tape, where that is not its name: the label of its rectangles. Two tools may share a colour.
    /// Without tape it is the label of its shaft's rectangles; absent: `shaft`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colour: Option<String>,
    /// The side of the picture that its hand is on; used only for tools that share a colour, and for tools without
    /// tape.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub side: Option<Side>,
    /// Outer diameter, over the tape if there is one, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub diameter_mm: Option<f64>,
    /// Length of the tape band along the tube, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub band_length_mm: Option<f64>,
    /// The tool's marker; absent: a band of tape. A file with this key says `needs` 2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub marker: Option<MarkerEntry>,
}

impl ToolEntry {
    /// The colour of its tape or of its shaft.
    fn colour(&self) -> &str {
        self.colour.as_deref().unwrap_or(if self.is_shaft() { SHAFT } else { &self.tool })
    }

    /// True for a tool without tape.
    fn is_shaft(&self) -> bool {
        self.marker.as_ref().is_some_and(MarkerEntry::is_shaft)
    }
}

/// The whole file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct AnnotationsFile {
    /// What a program must understand to read the file; absent: 1. A program refuses a larger number than it knows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub needs: Option<u32>,
    /// Outer diameter of every tool without a size of its own, over the tape if there is one, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tool_diameter_mm: Option<f64>,
    /// Band length of every tool with tape and without a length of its own, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub band_length_mm: Option<f64>,
    /// The camera's viewpoint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub view: Option<View>,
    /// Path of the clip that `frame` refers to, relative to this file; absent: the tracked clip.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub video: Option<String>,
    /// Path of a photo of the box without tools, relative to this file, with the clip's camera and picture size. In the
    /// stored colours of a box it is the SHA-256 of the photo.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub empty_box: Option<String>,
    /// Sizes that take precedence over the general ones, and colours that tools share.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tools: Vec<ToolEntry>,
    /// Marked rectangles.
    pub labels: Vec<LabelledRectangle>,
}

/// A tool as the annotations describe it.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkedTool {
    /// The tool's name.
    pub name: String,
    /// Colour of its tape or of its shaft: the label of its samples.
    pub colour: String,
    /// The side of the picture that its hand is on, where known.
    pub side: Option<Side>,
    /// Outer diameter, over the tape if there is one, mm.
    pub diameter_mm: f64,
    /// What shows where it is.
    pub marker: MarkerEntry,
}

impl From<MarkedTool> for ToolSpec {
    fn from(MarkedTool { name, colour, side, diameter_mm, marker }: MarkedTool) -> Self {
        Self { name, colour, side: side.map(HandSide::from), diameter_mm, marker: Marker::from(marker) }
    }
}

/// Why annotations cannot be used.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum AnnotationsError {
    /// Not JSON, or a key is missing or of the wrong type.
    #[error("not an annotations file: {0}")]
    Syntax(String),
    /// Made for a newer program.
    #[error(
        "the annotations need version {0} of the format, and this program knows {KNOWN_NEEDS}: install a newer \
         version of Trocar"
    )]
    Newer(u32),
    /// A marker that this program cannot follow.
    #[error(
        "tool `{tool}`: this program follows bands of tape and bare shafts, not markers of the kind `{kind}`: use one \
         of these, or install a version of Trocar that follows such markers"
    )]
    UnknownMarker {
        /// The tool.
        tool: String,
        /// The kind in the file.
        kind: String,
    },
    /// A way to recognise colours that this program does not have.
    #[error(
        "segmentation of the kind `{0}` is not possible: leave out `segmentation`, and mark rectangles on each colour"
    )]
    UnknownSegmentation(String),
    /// Two lengths for one band.
    #[error("tool `{0}`: band_length_mm and the marker's length_mm differ; give the length once")]
    TwoLengths(String),
    /// A tool without tape in a file that older programs would read as one with tape.
    #[error("tool `{0}` has no tape: add `\"needs\": 2` beside tools, because older versions would expect tape on it")]
    ShaftWithoutNeeds(String),
    /// A tool without tape that has the length of a band.
    #[error("tool `{0}` has no tape: remove its band_length_mm, or its marker of the kind `shaft`")]
    BandOfShaft(String),
    /// A tool without tape has the colour of another tool's tape.
    #[error("tool `{tool}` has no tape, but `{colour}` is the tape colour of another tool: give it another colour")]
    TapeAndShaft {
        /// The tool without tape.
        tool: String,
        /// The colour.
        colour: String,
    },
    /// No rectangle shows the shaft of a tool without tape.
    #[error("tool `{tool}` has no tape: mark at least one rectangle on its shaft, and label it `{colour}`")]
    ShaftNotMarked {
        /// The tool.
        tool: String,
        /// The label that is missing.
        colour: String,
    },
    /// A tool without tape on an unknown side.
    #[error(
        "tool `{0}` has no tape, and its side is not known: add `\"side\": \"left\"` or `\"side\": \"right\"` to its \
         entry"
    )]
    ShaftWithoutSide(String),
    /// Two tools without tape on one side.
    #[error(
        "tools `{}` and `{}` have no tape and the same side: only one tool without tape on each side can be followed",
        .0[0], .0[1]
    )]
    ShaftsOnOneSide([String; 2]),
    /// No rectangle names a tool.
    #[error("no label names a tool: mark at least one rectangle on a tool's tape, labelled with the marker's name")]
    NoTool,
    /// A colour that is empty or reserved.
    #[error(
        "tool `{tool}`: `{colour}` is not the colour of a tool; give the label of the tool's rectangles as its colour"
    )]
    InvalidColour {
        /// The tool.
        tool: String,
        /// The colour in the file.
        colour: String,
    },
    /// A tool with a reserved label as its name; its rectangles would wrongly count as tape.
    #[error("`{0}` is a reserved label and cannot be the name of a tool; give the tool another name under tools")]
    ReservedName(String),
    /// A name that is not allowed.
    #[error(
        "`{0}…` cannot be a tool's name: use at most {MAX_TOOL_NAME_LENGTH} characters and begin with a letter or a \
         digit"
    )]
    InvalidName(String),
    /// More colours than the tracker can distinguish.
    #[error(
        "{0} colours are marked; at most {MAX_COLOURS} are possible: label all that is not tape as background or other"
    )]
    TooManyColours(usize),
    /// A tool listed twice with different colours.
    #[error("tool `{0}` is listed twice under tools with different colours; give each tool a name of its own")]
    TwoColours(String),
    /// A tool without a diameter.
    #[error("tool `{0}` has no diameter: give tool_diameter_mm, or diameter_mm under tools")]
    NoDiameter(String),
    /// A size that no instrument of a box trainer has.
    #[error("tool `{tool}`: {what} is {value} mm; expected {min} to {max} mm, because {ground}")]
    UnlikelySize {
        /// The tool.
        tool: String,
        /// The size.
        what: &'static str,
        /// The value in the file, mm.
        value: f64,
        /// Smallest accepted value, mm.
        min: f64,
        /// Largest accepted value, mm.
        max: f64,
        /// Where the range comes from.
        ground: &'static str,
    },
    /// A size of a tool that the file does not have.
    #[error("tool `{0}` is not among the tools of these colours: mark it first")]
    UnknownTool(String),
    /// A tool whose new size is missing.
    #[error("tool `{0}` has no new size: give the sizes of all tools")]
    SizeMissing(String),
    /// A size of a marker that the tool does not have.
    #[error("tool `{0}` has another kind of marker: mark it again")]
    OtherMarker(String),
    /// An impossible size.
    #[error("tool `{tool}`: {key} is {value} mm; expected more than 0 and at most {limit}")]
    InvalidSize {
        /// The tool.
        tool: String,
        /// The key.
        key: &'static str,
        /// The value in the file, mm.
        value: f64,
        /// Largest accepted value, mm.
        limit: f64,
    },
    /// A rectangle that reaches outside the frame.
    #[error(
        "rectangle {index} (`{label}`, frame {frame}) spans x {x}..{right}, y {y}..{bottom}, outside the \
         {width}×{height} frame"
    )]
    OutsideFrame {
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
    /// Reads the file and checks that it names at least one tool with a valid size.
    pub fn parse(text: &str) -> Result<Self, AnnotationsError> {
        marker::check_requirements(text)?;
        let file: Self = serde_json::from_str(text).map_err(|e| AnnotationsError::Syntax(e.to_string()))?;
        file.marked_tools()?.iter().try_for_each(sizes::check_possible)?;
        Ok(file)
    }

    /// The same tools and marks with other sizes. Each tool of the file has one new size, and keeps its colour, its side,
    /// and its kind of marker: other samples belong to another colour or marker.
    pub fn with_sizes(self, sizes: Vec<ToolSize>) -> Result<Self, AnnotationsError> {
        let mut resized = Vec::with_capacity(sizes.len());
        for tool in self.marked_tools()? {
            resized.push(sizes::resized(tool, &sizes)?);
        }
        if let Some(unknown) = sizes.iter().find(|size| resized.iter().all(|tool| tool.name != size.tool)) {
            return Err(AnnotationsError::UnknownTool(unknown.tool.clone()));
        }
        resized.iter().try_for_each(sizes::check_possible)?;
        let tools = resized.into_iter().map(ToolEntry::from).collect();
        Ok(Self { tool_diameter_mm: None, band_length_mm: None, tools, ..self })
    }

    /// The tools, in order of first appearance of their colours; tools of one colour in the order of `tools`.
    pub fn marked_tools(&self) -> Result<Vec<MarkedTool>, AnnotationsError> {
        self.check_colours()?;
        self.check_shaft_entries()?;
        let mut tools: Vec<MarkedTool> = Vec::new();
        for colour in self.marked_colours() {
            let mut names: Vec<&str> = Vec::new();
            for entry in self.tools.iter().filter(|entry| entry.colour() == colour) {
                if !names.contains(&entry.tool.as_str()) {
                    names.push(&entry.tool);
                }
            }
            if names.is_empty() {
                names.push(colour);
            }
            for name in names {
                tools.push(self.marked_tool(name, colour)?);
            }
        }
        marker::check_shaft_sides(&tools)?;
        if tools.is_empty() { Err(AnnotationsError::NoTool) } else { Ok(tools) }
    }

    /// The tape colour of each tool with tape, in the tools' order; a shared colour appears more than once.
    pub fn tape_colours(&self) -> Vec<String> {
        let tools = self.marked_tools().unwrap_or_default().into_iter();
        tools.filter(|tool| !tool.marker.is_shaft()).map(|tool| tool.colour).collect()
    }

    /// The marked colours of tools, in order of first appearance.
    pub fn marked_colours(&self) -> Vec<&str> {
        let mut colours: Vec<&str> = Vec::new();
        for colour in self.labels.iter().map(|l| self.colour_of(&l.label)).filter(|c| self.is_of_tools(c)) {
            if !colours.contains(&colour) {
                colours.push(colour);
            }
        }
        colours
    }

    /// True if a tool has no tape.
    pub fn has_bare_tools(&self) -> bool {
        self.tools.iter().any(ToolEntry::is_shaft)
    }

    /// True unless a label is reserved for something else than tools.
    fn is_of_tools(&self, colour: &str) -> bool {
        !NOT_TOOLS.contains(&colour) || self.tools.iter().any(|entry| entry.is_shaft() && entry.colour() == colour)
    }

    /// The colour for a label: the colour of the tool with this name, else the label itself.
    pub fn colour_of<'a>(&'a self, label: &'a str) -> &'a str {
        self.tools.iter().find(|entry| entry.tool == label).map_or(label, ToolEntry::colour)
    }

    fn check_colours(&self) -> Result<(), AnnotationsError> {
        for entry in &self.tools {
            let colour = entry.colour();
            if (entry.colour.is_some() || entry.is_shaft()) && NOT_TOOLS.contains(&entry.tool.as_str()) {
                return Err(AnnotationsError::ReservedName(entry.tool.clone()));
            }
            let is_reserved = NOT_TOOLS.contains(&colour) && !(entry.is_shaft() && colour == SHAFT);
            if entry.colour.is_some() && (colour.trim().is_empty() || is_reserved) {
                return Err(AnnotationsError::InvalidColour { tool: entry.tool.clone(), colour: colour.to_owned() });
            }
            if self.colour_of(&entry.tool) != colour {
                return Err(AnnotationsError::TwoColours(entry.tool.clone()));
            }
        }
        let colours = self.marked_colours().len();
        if colours > MAX_COLOURS { Err(AnnotationsError::TooManyColours(colours)) } else { Ok(()) }
    }

    fn marked_tool(&self, name: &str, colour: &str) -> Result<MarkedTool, AnnotationsError> {
        if !is_tool_name(name) {
            let shown = name.escape_debug().take(MAX_TOOL_NAME_LENGTH).collect();
            return Err(AnnotationsError::InvalidName(shown));
        }
        let own = self.tools.iter().find(|t| t.tool == name);
        let side = own.and_then(|t| t.side).or_else(|| Side::from_name(name));
        let diameter_mm = own
            .and_then(|t| t.diameter_mm)
            .or(self.tool_diameter_mm)
            .ok_or_else(|| AnnotationsError::NoDiameter(name.to_owned()))?;
        check_size(name, "diameter_mm", diameter_mm, 50.0)?;
        let marker = self.marker_of(name, own)?;
        Ok(MarkedTool { name: name.to_owned(), colour: colour.to_owned(), side, diameter_mm, marker })
    }

    /// Refuses rectangles that are empty or reach outside a frame of this size.
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
            Some((index, r)) => Err(AnnotationsError::OutsideFrame {
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
        Err(AnnotationsError::InvalidSize { tool: tool.to_owned(), key, value, limit })
    }
}

#[cfg(test)]
mod tests;
