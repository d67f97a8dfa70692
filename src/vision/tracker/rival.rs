//! Rivals: a thing of the tape's colour may have been taken for the tool. While no trocar confirms the followed band,
//! the tracker looks now and then for another band in the picture, and compares both: by the shaft behind the tape,
//! and by motion.

use super::footprint::Footprint;
use super::frame_context::FrameContext;
use super::measurement::Measurement;
use super::predict::Prediction;
use super::tool::ToolTracker;
use crate::vision::camera::Camera;
use crate::vision::pose::adjustment::Adjustment;
use crate::vision::space::{CameraPoint, Pixel};

/// Frames from one look to the next: a search of the whole picture costs several times a followed frame.
const EVERY_FRAMES: u64 = 8;

/// How much likelier a rival must be: half of what a shaft behind the band adds.
const CLEARLY: f64 = 0.5;

/// A tip that is this far from where it was has moved, pixels: several times the error of a measured tip.
const MOVED_PX: f64 = 6.0;

/// Where the tips of the followed band and of its rival were first seen.
#[derive(Clone, Copy, Debug, Default)]
pub struct FirstPlaces {
    followed: Option<Pixel>,
    rival: Option<Pixel>,
}

impl ToolTracker {
    /// A band elsewhere in the picture that is the tool's, if the followed one is not. It is searched for as if the tool
    /// had never been seen.
    pub(super) fn find_rival(
        &mut self,
        scene: &FrameContext<'_>,
        prediction: &Prediction,
        followed: &Measurement,
    ) -> Option<Measurement> {
        let is_confirmed = self.adjustment.as_ref().is_some_and(Adjustment::is_right_way_round);
        if is_confirmed || !scene.frame.index.is_multiple_of(EVERY_FRAMES) {
            return None;
        }
        let followed = self.with_continuation(scene, prediction, followed.clone());
        let is_still = !has_moved(&mut self.first_places.followed, tip_px(&followed, scene.camera())?);
        if followed.is_clear() && !is_still {
            return None;
        }
        let at = Footprint::of(&followed, scene.camera())?;
        let rival = self.fresh().find_and_measure(scene, &Prediction::default(), Some(&at)).ok()?;
        let moves = has_moved(&mut self.first_places.rival, tip_px(&rival, scene.camera())?);
        let is_likelier = rival.likelihood() > followed.likelihood() + CLEARLY;
        let is_the_moving_one = is_still && moves && rival.is_clear();
        (is_likelier || is_the_moving_one).then_some(rival)
    }
}

fn tip_px(band: &Measurement, camera: &Camera) -> Option<Pixel> {
    camera.project(CameraPoint(band.estimate.tube.tip))
}

/// Is a tip away from its first place? If it has none yet, this is it.
fn has_moved(first: &mut Option<Pixel>, now: Pixel) -> bool {
    (first.get_or_insert(now).0 - now.0).norm() > MOVED_PX
}
