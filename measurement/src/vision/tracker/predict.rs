//! Predict: where a tool's band is expected on the frame, and how fast it moves in the picture.

use nalgebra::Vector2;

use super::Tracker;
use super::frame_context::FrameContext;
use super::tool::ToolTracker;
use crate::vision::camera::Camera;
use crate::vision::filter::track::TrackSettings;
use crate::vision::space::CameraPoint;
use crate::vision::tube::{Outline, Tube};

/// A tube, and the length of the tape band at its end.
#[derive(Clone, Copy, Debug)]
pub struct Band {
    /// The tube.
    pub tube: Tube,
    /// Length of the band, mm.
    pub length_mm: f64,
}

/// What is expected of a tool on a frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Prediction {
    /// Its band; `None` if the tool is not being tracked.
    pub band: Option<Band>,
    /// Motion of its tip in the picture, pixels/s; zero if unknown.
    pub motion_px_s: Vector2<f64>,
}

impl ToolTracker {
    /// Predicts the tool's position, and its motion in the picture.
    pub(super) fn predict(&self, scene: &FrameContext<'_>) -> Prediction {
        let (time_s, track_settings) = (scene.frame.time_s, scene.track_settings());
        Prediction {
            band: self.expected_band(time_s, &track_settings),
            motion_px_s: self.expected_motion(time_s, &track_settings, scene.camera()).unwrap_or_default(),
        }
    }

    /// The last band, moved to the predicted tip.
    fn expected_band(&self, time_s: f64, track_settings: &TrackSettings) -> Option<Band> {
        let state = self.track.expected(time_s, track_settings)?;
        let Band { tube, length_mm } = self.last_band?;
        Some(Band { tube: Tube { tip: state.tip(), ..tube }, length_mm })
    }

    /// Predicted motion of the tip in the picture, pixels/s.
    pub(super) fn expected_motion(
        &self,
        time_s: f64,
        track_settings: &TrackSettings,
        camera: &Camera,
    ) -> Option<Vector2<f64>> {
        const STEP_S: f64 = 1e-3;
        let state = self.track.expected(time_s, track_settings)?;
        let pixel = |point| camera.project(CameraPoint(point));
        Some((pixel(state.tip() + state.velocity() * STEP_S)?.0 - pixel(state.tip())?.0) / STEP_S)
    }
}

impl Tracker {
    /// The expected outline of each tool, so that the other tools know what may hide them.
    pub(super) fn expected_outlines(&self, time_s: f64) -> Vec<Option<Outline>> {
        let motion = self.settings.motion.track_settings();
        self.tools.iter().map(|tool| tool.expected_band(time_s, &motion).and_then(|band| band.tube.outline())).collect()
    }

    /// The tools that share no colour with another, the nearest to the camera first because it may hide the others.
    pub(super) fn nearest_first(&self, outlines: &[Option<Outline>]) -> Vec<usize> {
        let is_alone = |tool: &usize| !self.pairs.iter().flatten().any(|paired| paired == tool);
        let depth_mm = |tool: &usize| outlines[*tool].map_or(f64::INFINITY, |outline| outline.rim(0.0, 0.0).z);
        let mut alone: Vec<usize> = (0..self.tools.len()).filter(is_alone).collect();
        alone.sort_by(|one, other| depth_mm(one).total_cmp(&depth_mm(other)));
        alone
    }
}
