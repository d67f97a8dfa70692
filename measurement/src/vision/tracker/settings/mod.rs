//! Settings of a tracker: camera, tools, colours, and how tools can move.

mod problem;

pub use problem::SettingsProblem;

use serde::{Deserialize, Serialize};

use crate::vision::camera::Camera;
use crate::vision::segmentation::samples::ColourSamples;
pub use crate::vision::space::HandSide;

/// One tool: a tube that ends where the jaw begins, and what shows where it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ToolSpec {
    /// The tool's name.
    pub name: String,
    /// Colour of its tape or of its bare shaft: the label of its samples. Two tools may share a colour; their trocars
    /// distinguish them.
    pub colour: String,
    /// The side of the picture where its hand is, if stated. Used for tools that share a colour, and for bare shafts.
    pub side: Option<HandSide>,
    /// Outer diameter, over the tape if there is one, mm.
    pub diameter_mm: f64,
    /// What shows where it is.
    pub marker: Marker,
}

/// What shows where a tool is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Marker {
    /// A band of coloured tape round the tube, which ends where the tube ends.
    Band {
        /// Its length along the tube, mm, if it was measured: depth then becomes about three times sharper.
        length_mm: Option<f64>,
    },
    /// The bare shaft itself: the tool has no tape.
    Shaft {
        /// Length of the steel collar between the tube's end and the jaws, mm, if it was measured.
        collar_mm: Option<f64>,
        /// Distance from the tube's end to the point of the closed jaws, mm, if it was measured; 0 for a rod without jaws.
        jaw_mm: Option<f64>,
    },
}

impl ToolSpec {
    /// Is it followed by its bare shaft?
    pub fn is_bare(&self) -> bool {
        matches!(self.marker, Marker::Shaft { .. })
    }

    /// Length of the collar between the bare tube's end and the jaws, mm; 0 without one.
    pub fn collar_mm(&self) -> f64 {
        match self.marker {
            Marker::Band { .. } => 0.0,
            Marker::Shaft { collar_mm, .. } => collar_mm.unwrap_or(0.0),
        }
    }

    /// Do jaws show ahead of its bare tube? Not of a rod.
    pub fn has_jaws(&self) -> bool {
        !matches!(self.marker, Marker::Shaft { jaw_mm: Some(0.0), .. })
    }

    /// Length of its band along the tube, mm, if it has a band and its length was measured.
    pub fn band_length_mm(&self) -> Option<f64> {
        match self.marker {
            Marker::Band { length_mm } => length_mm,
            Marker::Shaft { .. } => None,
        }
    }
}

/// Position of the camera (T 6.4). Decides which end of a band is distal while nothing better is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum CameraView {
    /// Camera above the box: hands are below the picture, tips point up in it.
    Top,
    /// Camera at the side: hands are beside the picture, tips point to its centre.
    Side,
}

/// Method that turns borders into a position in space.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum PoseMethod {
    /// Exact tangent planes, then a joint fit of borders and band ends: the default.
    #[default]
    TangentPlanes,
    /// `z ≈ f·D/width`: the thesis's method, kept as the reference. Biased when the tool leans.
    PinholeWidth,
}

/// How tools can move, and for how long a tool is predicted while it is not seen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MotionSettings {
    /// Typical acceleration, mm/s²: a larger value follows motion faster, a smaller one is smoother. Hands reach
    /// 200–1000.
    pub acceleration_mm_s2: f64,
    /// How long such an acceleration lasts, s. With the acceleration it gives the motion noise `a²·t`, mm²/s³.
    pub acceleration_lasts_s: f64,
    /// Speed that a newly seen tool may have, mm/s (one standard deviation).
    pub first_speed_mm_s: f64,
    /// Largest squared Mahalanobis distance of an accepted measurement; 16.3 accepts 99.9 % of good ones.
    pub gate: f64,
    /// Measurements outside the gate are accepted once they have agreed with each other for this long, s.
    pub reacquire_s: f64,
    /// Longest gap that is bridged by prediction, s.
    pub max_prediction_s: f64,
    /// The same for a bare tool whose axis is measured while its tip is hidden, s: the tip's place along the axis is then
    /// unknown to 18 mm (`√(q·t³/3)`) for a steady hand.
    pub max_hidden_s: f64,
    /// Longest gap that the second pass bridges, between two frames where the tool was seen, s. In the middle of a
    /// bridge four times as long as the longest prediction, the tip is known as well as at that prediction's end:
    /// `q·T³/192` and `q·t³/3` mm² are equal for `T = 4t`.
    pub max_bridge_s: f64,
    /// Smallest depth of a tip, mm.
    pub nearest_mm: f64,
    /// Largest depth of a tip, mm.
    pub farthest_mm: f64,
}

impl Default for MotionSettings {
    fn default() -> Self {
        Self {
            acceleration_mm_s2: 400.0,
            acceleration_lasts_s: 0.05,
            first_speed_mm_s: 150.0,
            gate: 16.3,
            reacquire_s: 0.15,
            max_prediction_s: 0.2,
            max_hidden_s: 0.5,
            max_bridge_s: 0.8,
            nearest_mm: 20.0,
            farthest_mm: 1000.0,
        }
    }
}

impl MotionSettings {
    /// Spectral density of the acceleration, mm²/s³: the process noise of the filter for a steady hand.
    pub fn noise_density(&self) -> f64 {
        self.acceleration_mm_s2.powi(2) * self.acceleration_lasts_s
    }
}

/// All settings of a [`super::Tracker`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackerSettings {
    /// The camera, calibrated at the size of the frames.
    pub camera: Camera,
    /// Tools to track; their order is the order of the reports.
    pub tools: Vec<ToolSpec>,
    /// Colour samples that an instructor marked.
    pub samples: ColourSamples,
    /// Position of the camera, if known.
    pub view: Option<CameraView>,
    /// Pose method.
    pub pose: PoseMethod,
    /// Motion model.
    pub motion: MotionSettings,
}

impl TrackerSettings {
    /// The usual settings.
    pub fn new(camera: Camera, tools: Vec<ToolSpec>, samples: ColourSamples) -> Self {
        Self { camera, tools, samples, view: None, pose: PoseMethod::default(), motion: MotionSettings::default() }
    }
}

/// Maximum number of tools.
const MAX_TOOLS: usize = 16;

impl TrackerSettings {
    /// Rejects settings that cannot work for frames of this size.
    pub(super) fn check(&self, width: u32, height: u32) -> Result<(), SettingsProblem> {
        let camera = (self.camera.width, self.camera.height);
        if camera != (width, height) {
            return Err(SettingsProblem::OtherSize { camera, frame: (width, height), shown: None });
        }
        if self.tools.is_empty() {
            return Err(SettingsProblem::NoTool);
        }
        if self.tools.len() > MAX_TOOLS {
            return Err(SettingsProblem::TooManyLabels(self.tools.len(), MAX_TOOLS));
        }
        self.tools.iter().try_for_each(|tool| self.check_tool(tool))?;
        self.colours().iter().try_for_each(|colour| self.check_colour(colour))?;
        let is_tape = |label: &String| self.class_of(label) > 0;
        let has_background = self.samples.labels.iter().any(|l| !is_tape(l) && self.samples.count(l) > 0);
        if has_background { Ok(()) } else { Err(SettingsProblem::NoBackground) }
    }

    fn check_tool(&self, tool: &ToolSpec) -> Result<(), SettingsProblem> {
        let wrong = |what, value_mm| Err(SettingsProblem::Size { tool: tool.name.clone(), what, value_mm });
        let possible = |value: f64| value.is_finite() && value > 0.0;
        if !possible(tool.diameter_mm) {
            return wrong("its diameter", tool.diameter_mm);
        }
        if let Some(length) = tool.band_length_mm().filter(|l| !possible(*l)) {
            return wrong("its band's length", length);
        }
        if self.samples.count(&tool.colour) == 0 {
            return Err(SettingsProblem::NoSamples(tool.name.clone()));
        }
        Ok(())
    }

    /// At most two tools may share a colour, and not on the same side.
    fn check_colour(&self, colour: &str) -> Result<(), SettingsProblem> {
        let tools: Vec<&ToolSpec> = self.tools.iter().filter(|t| t.colour == colour).collect();
        match tools[..] {
            [a, b] if a.side.is_some() && a.side == b.side => {
                Err(SettingsProblem::SameSide(a.name.clone(), b.name.clone()))
            }
            [_] | [_, _] => Ok(()),
            _ => Err(SettingsProblem::CrowdedColour(tools.len(), colour.to_owned())),
        }
    }

    /// The tools' colours, each once, in the tools' order.
    fn colours(&self) -> Vec<&str> {
        let mut colours: Vec<&str> = Vec::new();
        for tool in &self.tools {
            if !colours.contains(&tool.colour.as_str()) {
                colours.push(&tool.colour);
            }
        }
        colours
    }

    /// A label's class in the colour table: 0 if it is no tool's colour.
    pub(super) fn class_of(&self, label: &str) -> u8 {
        self.colours().iter().position(|colour| *colour == label).map_or(0, |i| i as u8 + 1)
    }

    /// The class of each label of the samples.
    pub(super) fn classes(&self) -> Vec<u8> {
        self.samples.labels.iter().map(|label| self.class_of(label)).collect()
    }

    /// Pairs of tools whose tapes share a colour, the left hand's first: by their stated sides, else in their order.
    /// Bare shafts are found by their sides and trocars, each for itself.
    pub(super) fn pairs(&self) -> Vec<[usize; 2]> {
        let mut pairs = Vec::new();
        for (first, tool) in self.tools.iter().enumerate().filter(|(_, tool)| !tool.is_bare()) {
            let rest = self.tools.iter().enumerate().skip(first + 1);
            for (second, other) in rest.filter(|(_, other)| other.colour == tool.colour) {
                let turned = tool.side == Some(HandSide::Right) || other.side == Some(HandSide::Left);
                pairs.push(if turned { [second, first] } else { [first, second] });
            }
        }
        pairs
    }
}

#[cfg(test)]
mod tests;
