//! The report of one frame: measurements, filtered samples, and the lines drawn over the picture.

use super::Tracker;
use super::accept::{SteadiedBand, ToolFrameResult};
use super::gaps::{self, FrameMargin};
use super::motion::{self, FrameInstant, PastPose};
use super::report::{FrameReport, Observation, ToolReport};
use crate::vision::frame::Frame;
use crate::vision::reason::MissReason;
use crate::vision::space::{CameraPoint, Pixel};
use crate::vision::trajectory::{Sample, SampleState};
use crate::vision::tube::BorderSide;

impl Tracker {
    /// The report of a frame, from the result of each tool.
    pub(super) fn frame_report(
        &mut self,
        frame: &Frame<'_>,
        mut results: Vec<(usize, ToolFrameResult)>,
    ) -> FrameReport {
        results.sort_by_key(|(tool, _)| *tool);
        let instant = (frame.index, frame.time_s);
        let tools = results.into_iter().map(|(tool, result)| self.tool_report(tool, instant, result)).collect();
        FrameReport { frame: frame.index, time_s: frame.time_s, tools }
    }

    fn tool_report(&mut self, tool: usize, instant: FrameInstant, result: ToolFrameResult) -> ToolReport {
        let filtered = self.filtered_sample(tool, instant, &result);
        let refused = result.outcome.as_ref().err().copied();
        let absence = refused.filter(|_| filtered.is_none()).map(|reason| {
            let rim = FrameMargin::new(&self.settings.camera, self.settings.tools[tool].band_length_mm());
            gaps::absence_now(self.last_samples[tool].as_ref(), reason, &rim)
        });
        let drawn = result.outcome.as_ref().ok().and_then(|band| self.drawing(band));
        let outcome = result.outcome.and_then(|band| self.observation(&band).ok_or(MissReason::OutsideLensModel));
        self.last_samples[tool] = filtered.or(self.last_samples[tool]);
        ToolReport {
            tool,
            outcome,
            filtered,
            absence,
            borders_px: drawn.map(|(borders, _)| borders),
            band_end_px: drawn.map(|(_, end)| end),
            has_withdrawn: std::mem::take(&mut self.tools[tool].has_withdrawn),
        }
    }

    /// The causal filter's estimate, if the tool is being tracked.
    fn filtered_sample(&self, tool: usize, instant: FrameInstant, result: &ToolFrameResult) -> Option<Sample> {
        let camera = &self.settings.camera;
        let pose = self.tools[tool].last_pose.as_ref().map(PastPose::from);
        let seen = if result.advance.observed { SampleState::Observed } else { SampleState::Predicted };
        let state = result.advance.state?;
        Some(motion::state_sample(&state, pose.as_ref(), tool, instant, seen, camera, None))
    }

    fn observation(&self, band: &SteadiedBand) -> Option<Observation> {
        let estimate = &band.estimate;
        let tip = estimate.tube.tip;
        Some(Observation {
            tip_mm: tip,
            axis: estimate.tube.axis,
            covariance_mm2: motion::stated_covariance(&estimate.tip_covariance(), &self.settings.camera, &tip).matrix(),
            tip_px: self.settings.camera.project(CameraPoint(tip))?,
            border_residual_px: estimate.residual_px,
        })
    }

    /// Both borders and the distal end, as drawn over the frame.
    fn drawing(&self, band: &SteadiedBand) -> Option<([[Pixel; 2]; 2], Pixel)> {
        let outline = band.estimate.tube.outline()?;
        let pixel = |point| self.settings.camera.project(CameraPoint(point));
        let border = |side| Some([pixel(outline.border(side, 0.0))?, pixel(outline.border(side, band.length_mm))?]);
        let borders = [border(BorderSide::First)?, border(BorderSide::Second)?];
        Some((borders, pixel(outline.rim(0.0, 0.0))?))
    }
}
