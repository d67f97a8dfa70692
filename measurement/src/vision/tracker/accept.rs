//! Accept: does the track allow the measurement (depth limits, Mahalanobis gate)? [`super::search`] and [`super::pair`]
//! have compared it with the fulcrum before.

use super::frame_context::FrameContext;
use super::measurement::{Grade, Measurement};
use super::predict::Band;
use super::tool::ToolTracker;
use crate::vision::filter::track::{Advance, TrackSettings};
use crate::vision::pose::TubeEstimate;
use crate::vision::pose::adjustment;
use crate::vision::pose::axis_line::AxisLine;
use crate::vision::pose::fulcrum::MAX_FULCRUM_MISS_SQUARED;
use crate::vision::reason::MissReason;

/// A measured band, steadied with what is known of the tool.
pub struct SteadiedBand {
    /// Tube and covariance.
    pub estimate: TubeEstimate,
    /// Length of the band, known or as seen, mm.
    pub length_mm: f64,
}

/// Result of one frame for one tool.
pub struct ToolFrameResult {
    /// The steadied band, or the reason for having none.
    pub outcome: Result<SteadiedBand, MissReason>,
    /// How the track advanced.
    pub advance: Advance,
}

impl ToolTracker {
    /// Advances the track with the frame's measurement, which the track accepts or refuses, or with the axis of a tool
    /// whose tip is hidden.
    pub(super) fn accept(
        &mut self,
        scene: &FrameContext<'_>,
        measured: &Result<Measurement, MissReason>,
        axis: Option<AxisLine>,
    ) -> ToolFrameResult {
        let steadied = measured.as_ref().map(|measurement| self.steady(measurement)).map_err(|reason| *reason);
        let position =
            steadied.as_ref().ok().map(|band| (band.estimate.tube.tip, band.estimate.changing_tip_covariance()));
        let (time_s, settings) = (scene.frame.time_s, scene.track_settings());
        let advance = match axis {
            Some(line) => self.advance_along_axis(time_s, &line, &settings),
            None => self.track.advance(time_s, position, &settings),
        };
        if let (Ok(accepted), true) = (&steadied, advance.observed) {
            self.last_band = Some(Band { tube: accepted.estimate.tube, length_mm: accepted.length_mm });
            self.last_pose = Some(accepted.estimate);
        }
        let outcome = match advance.refused {
            Some(reason) => Err(reason),
            None => steadied,
        };
        ToolFrameResult { outcome, advance }
    }

    /// Advances the track with the axis of a tool whose tip is hidden, and expects the tool along it from now on.
    fn advance_along_axis(&mut self, time_s: f64, line: &AxisLine, settings: &TrackSettings) -> Advance {
        let (advance, used) = self.track.advance_along_axis(time_s, line, settings);
        if let (Some(band), Some(_)) = (&mut self.last_band, used) {
            band.tube.axis = line.direction;
        }
        advance
    }

    /// Does a measurement at the predicted position agree with the tool's motion and with its fulcrum?
    pub(super) fn continues_track(&self, scene: &FrameContext<'_>, measurement: &Measurement) -> bool {
        self.track.would_accept(scene.frame.time_s, &measurement.estimate, &scene.track_settings())
            && self.agrees_with_fulcrum(measurement)
    }

    /// Does the axis pass through the known fulcrum, or do the pixels support the measurement so well that it is
    /// accepted even if not? It may then lead to a better fulcrum.
    pub(super) fn agrees_with_fulcrum(&self, measurement: &Measurement) -> bool {
        measurement.grade() == Grade::Good || measurement.fulcrum_miss_squared < MAX_FULCRUM_MISS_SQUARED
    }

    /// Squared Mahalanobis distance of a pose from the predicted position; `None` if the tool is not being tracked.
    pub(super) fn mahalanobis_squared(&self, scene: &FrameContext<'_>, pose: &TubeEstimate) -> Option<f64> {
        let state = self.track.expected(scene.frame.time_s, &scene.track_settings())?;
        Some(state.distance_squared(pose.tube.tip, pose.changing_tip_covariance()))
    }

    /// The measured band, corrected with the fulcrum and the offsets that all poses share, once they are known.
    fn steady(&self, measurement: &Measurement) -> SteadiedBand {
        let steadied = self.known_adjustment().and_then(|a| adjustment::steady(&measurement.estimate, a));
        SteadiedBand { estimate: steadied.unwrap_or(measurement.estimate), length_mm: measurement.length_mm }
    }
}
