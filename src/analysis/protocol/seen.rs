//! What the tracker saw, for drawing over the video.

use serde::{Deserialize, Serialize};

use crate::vision::reason::MissReason;
use crate::vision::tracker::ToolReport;

/// What the tracker saw of one tool on one frame. Pixels are `f32`: in column 4096 the rounding is 1/2000 pixel, which
/// is fine enough to draw.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeenRow {
    /// Decoded frames before this one.
    pub frame: u64,
    /// Index of the tool.
    pub tool: u32,
    /// Why there is no measurement.
    pub reason: Option<MissReason>,
    /// Both borders of the band, each `u1 v1 u2 v2`.
    pub borders_px: Option<[[f32; 4]; 2]>,
    /// Tip, pixels.
    pub tip_px: Option<[f32; 2]>,
}

impl SeenRow {
    /// The row of one tool's report.
    pub fn new(frame: u64, report: &ToolReport) -> Self {
        let observed = report.outcome.as_ref().ok();
        let tip = observed.map(|o| o.tip_px.0).or_else(|| report.filtered.and_then(|s| s.tip_px));
        let border = |[a, b]: [crate::vision::space::Pixel; 2]| [a.u(), a.v(), b.u(), b.v()].map(|x| x as f32);
        Self {
            frame,
            tool: report.tool as u32,
            reason: report.outcome.as_ref().err().copied(),
            borders_px: report.borders_px.map(|borders| borders.map(border)),
            tip_px: tip.map(|p| [p.x as f32, p.y as f32]),
        }
    }

    /// Every number of the row.
    pub fn numbers(&self) -> impl Iterator<Item = f32> + use<> {
        self.borders_px.into_iter().flatten().flatten().chain(self.tip_px.into_iter().flatten())
    }
}
