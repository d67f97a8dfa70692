//! The flow: what happens to each frame, and what a whole recording becomes.

mod report;
mod settings;

pub use report::{FrameReport, Observation, Quality, ToolQuality, ToolReport, Tracking};
pub use settings::{MotionSettings, PoseMethod, SettingsProblem, ToolSpec, TrackerSettings, View};
