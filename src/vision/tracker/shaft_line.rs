//! Measures the axis of a bare shaft whose tip is hidden (METHOD 5).

use super::frame_context::FrameContext;
use super::predict::{Band, Prediction};
use super::probe_pass::STRIP_PASSES;
use super::shaft_search::MEASURED_SHAFT_MM;
use super::tool::ToolTracker;
use super::trace::FitRecorder;
use crate::vision::pose::axis_line::{self, AxisLine};
use crate::vision::tube::Tube;

impl ToolTracker {
    /// The shaft's axis, from its borders where they are expected. `None` if the tool is not being tracked,
    /// or if its borders do not show.
    pub(super) fn measure_axis(&mut self, scene: &FrameContext<'_>, prediction: &Prediction) -> Option<AxisLine> {
        let Band { tube, .. } = prediction.band?;
        let towards_tip = self.fulcrum().and_then(|fulcrum| (tube.tip - fulcrum.at).try_normalize(1e-9));
        let mut tube = Tube { axis: towards_tip.unwrap_or(tube.axis), ..tube };
        let mut recorder = FitRecorder::new(self.trace.is_recording());
        let line = self.follow_axis(scene, prediction, &mut tube, &mut recorder);
        self.trace.record_fits(recorder.into_fits());
        line
    }

    /// Moves the tube pass by pass until its borders lie on the edges, and returns the line of the last pass.
    fn follow_axis(
        &self,
        scene: &FrameContext<'_>,
        prediction: &Prediction,
        tube: &mut Tube,
        recorder: &mut FitRecorder,
    ) -> Option<AxisLine> {
        let fit = self.band_fit(scene, prediction);
        let mut line = None;
        for pass in STRIP_PASSES {
            recorder.start_fit(tube, MEASURED_SHAFT_MM);
            let found = fit.border_edges(tube, MEASURED_SHAFT_MM, *pass, recorder)?;
            let smear_px = found.smear_error_px();
            let (turned, of_axis) = axis_line::fit(&found.edges, tube, MEASURED_SHAFT_MM, smear_px, scene.camera())?;
            (*tube, line) = (turned, Some(of_axis));
        }
        line
    }
}
