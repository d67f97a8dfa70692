//! The truth: the position of each tool on each frame, and how much of its band could be seen.

use nalgebra::{Point2, Point3, Vector3};

use crate::simulation::truth::TrueTool;

/// The truth of a simulated or rendered clip, ordered by frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Truth {
    /// Frames with a known truth; rows of other frames are not judged.
    pub frames: Vec<TruthFrame>,
}

/// One frame of the truth.
#[derive(Clone, Debug, PartialEq)]
pub struct TruthFrame {
    /// Decoded frames before this one.
    pub frame: u64,
    /// Time of the picture, s.
    pub time_s: f64,
    /// The tools that exist on this frame, in view or not.
    pub tools: Vec<TruthTool>,
}

/// One tool on one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct TruthTool {
    /// The marker's name.
    pub tool: String,
    /// Tip in the camera frame, mm.
    pub tip_mm: Point3<f64>,
    /// Unit vector along the tube from the hand to the tip, where known.
    pub axis: Option<Vector3<f64>>,
    /// Tip in the recorded frame, pixels, where known.
    pub tip_px: Option<Point2<f64>>,
    /// Share of the band's camera-facing surface that is in frame and not hidden, 0 to 1.
    pub visible: f64,
}

impl From<TrueTool> for TruthTool {
    fn from(TrueTool { tool, tip_mm, axis, tip_px, visible }: TrueTool) -> Self {
        Self { tool, tip_mm, axis: Some(axis), tip_px, visible }
    }
}
