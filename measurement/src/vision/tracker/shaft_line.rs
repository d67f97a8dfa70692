//! Measures the axis of a bare shaft whose tip is hidden (METHOD 5).

use super::band_fit::BandFit;
use super::frame_context::FrameContext;
use super::predict::{Band, Prediction};
use super::probe_pass::{ProbePass, STRIP_PASSES};
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
        let tube = Tube { axis: towards_tip.unwrap_or(tube.axis), ..tube };
        let mut recorder = FitRecorder::new(self.trace.is_recording());
        let fit = self.band_fit(scene, prediction).fit_axis(&tube, MEASURED_SHAFT_MM, STRIP_PASSES, &mut recorder);
        self.trace.record_fits(recorder.into_fits());
        fit.map(|(_, line)| line)
    }
}

impl BandFit<'_> {
    /// Moves a tube pass by pass until its borders lie on the edges. Returns it, and the line of its axis by the last
    /// pass; `None` if its borders do not show.
    pub(super) fn fit_axis(
        &self,
        start: &Tube,
        length_mm: f64,
        passes: &[ProbePass],
        recorder: &mut FitRecorder,
    ) -> Option<(Tube, AxisLine)> {
        let mut fitted = None;
        let mut tube = *start;
        for pass in passes {
            recorder.start_fit(&tube, length_mm);
            let found = self.border_edges(&tube, length_mm, *pass, recorder)?;
            let fit = axis_line::fit(&found.edges, &tube, length_mm, found.smear_error_px(), self.camera())?;
            (tube, fitted) = (fit.0, Some(fit));
        }
        fitted
    }
}
