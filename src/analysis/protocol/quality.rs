//! The tracker's summary of a recording, as it is sent and stored.

use serde::{Deserialize, Serialize};

use crate::vision::surroundings::ViewShift;
use crate::vision::tracker::{LightSample, Quality, ToolQuality};

/// The tracker's [`Quality`], and what the decoder adds to it. Results store its fields in this order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct QualitySummary {
    /// Number of frames.
    pub frames: u64,
    /// Number of frames that were recorded interlaced.
    pub frames_interlaced: u64,
    /// Per tool, without the tools' names.
    pub tools: Vec<ToolQuality>,
    /// Scene light.
    pub light: Vec<LightSample>,
    /// How the view is displaced.
    pub view_shifts: Vec<ViewShift>,
}

impl QualitySummary {
    /// The summary of a recording with this many interlaced frames.
    pub fn new(quality: &Quality, frames_interlaced: u64) -> Self {
        let Quality { frames, tools, light, view_shifts } = quality.clone();
        Self { frames, frames_interlaced, tools, light, view_shifts }
    }

    /// The quality for the pipeline, for tools with these names.
    pub fn quality(&self, names: &[String]) -> Quality {
        let named = |(name, tool): (&String, &ToolQuality)| ToolQuality { tool: name.clone(), ..tool.clone() };
        let tools = names.iter().zip(&self.tools).map(named).collect();
        Quality { frames: self.frames, tools, light: self.light.clone(), view_shifts: self.view_shifts.clone() }
    }
}
