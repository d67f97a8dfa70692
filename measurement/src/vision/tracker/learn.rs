//! Learn: what an accepted measurement says about edges, band length, fulcrum, and the side of the hand.
//!
//! A measurement that the track refused teaches nothing: it may be of something else. What is learned from a frame
//! serves the frames after it.

use super::accept::ToolFrameResult;
use super::frame_context::FrameContext;
use super::measure::direction_in_picture;
use super::measurement::{Grade, Measurement};
use super::predict::Band;
use super::report::TrocarEvidence;
use super::tool::ToolTracker;
use crate::vision::edges::chroma_siting;
use crate::vision::edges::exposure;
use crate::vision::edges::shaft;
use crate::vision::frame::Frame;
use crate::vision::pose::adjustment::{self, Adjustment};
use crate::vision::reason::MissReason;

/// The causal adjustment is computed from this many poses, and again each time their number has doubled. At the
/// maximum every second pose is dropped.
const MIN_KEYFRAMES: usize = 16;
const MAX_KEYFRAMES: usize = 128;

/// A live fulcrum is used only once its standard deviation is below this, mm: half of an assumed one's, so the poses say
/// more of it than the usual distance does.
const MAX_FULCRUM_SIGMA_MM: f64 = 30.0;

impl ToolTracker {
    /// Learns edges, band length and fulcrum from the frame's measurement, if the track accepted it. Call once per
    /// frame, also without a measurement.
    pub(super) fn learn(&mut self, scene: &FrameContext<'_>, measured: Option<&Measurement>, result: &ToolFrameResult) {
        let accepted = measured.filter(|_| result.advance.observed);
        if let Some(measurement) = accepted.filter(|m| m.grade() >= Grade::Complete) {
            let motion = self.expected_motion(scene.frame.time_s, &scene.track_settings(), scene.camera());
            self.edges.learn(scene.frame, &measurement.fitted_edges, motion.unwrap_or_default());
        }
        self.edges.finish_frame();
        if let Some(measurement) = accepted.filter(|m| m.grade() == Grade::Good) {
            self.lengths.add(measurement.length_mm, measurement.length_sigma_mm);
            self.learn_fulcrum(measurement);
        }
    }

    /// What the axes say of the trocar so far.
    pub(super) fn trocar(&self) -> TrocarEvidence {
        match &self.adjustment {
            Some(adjustment) if adjustment.is_right_way_round() => TrocarEvidence::Shown,
            Some(adjustment) if adjustment.is_wrong_way_round() => TrocarEvidence::Missing,
            _ if self.seen_shaft.is_missing() => TrocarEvidence::Missing,
            None if self.keyframes.len() >= MIN_KEYFRAMES => TrocarEvidence::Missing,
            _ => TrocarEvidence::Possible,
        }
    }

    fn learn_fulcrum(&mut self, measurement: &Measurement) {
        self.keyframes.push(measurement.estimate);
        if self.keyframes.len() >= MIN_KEYFRAMES && self.keyframes.len().is_power_of_two() {
            self.adjustment = adjustment::estimate(&self.keyframes).or(self.adjustment.take());
        }
        if self.keyframes.len() >= MAX_KEYFRAMES {
            let mut keep = false;
            self.keyframes.retain(|_| {
                keep = !keep;
                keep
            });
        }
    }

    /// Learns from an accepted measurement on which side of the band the hand is. If the votes contradict the current
    /// direction, the tool was tracked the wrong way round: tracking restarts and its measurements so far are
    /// withdrawn. Needless once the axes show that the trocar lies behind the tips.
    pub(super) fn learn_hand_side(&mut self, scene: &FrameContext<'_>, result: &ToolFrameResult) {
        if !result.advance.observed || self.adjustment.as_ref().is_some_and(Adjustment::is_right_way_round) {
            return;
        }
        let Some(Band { tube: last, length_mm }) = self.last_band else { return };
        let Some(to_hand) = direction_in_picture(scene.camera(), &last, -last.axis) else { return };
        let is_visible = |place, at| scene.is_visible(place, at);
        let tube = shaft::continuation(scene.frame, scene.camera(), &self.edges, &last, length_mm, is_visible);
        self.seen_shaft.add(&tube);
        if let Some(contrast) = tube.contrast() {
            self.hand_direction.add_vote(to_hand, contrast);
        }
        if self.adjustment.as_ref().is_some_and(Adjustment::is_wrong_way_round) {
            self.hand_direction.set_opposite(to_hand);
        }
        if self.hand_direction.contradicts(to_hand) {
            self.withdraw(MissReason::WrongWayRound);
        }
    }
}

/// Is the fulcrum known well enough to be used?
pub fn is_fulcrum_known(adjustment: &Adjustment) -> bool {
    adjustment
        .comparable_fulcrum()
        .is_some_and(|fulcrum| fulcrum.covariance.trace() < MAX_FULCRUM_SIGMA_MM * MAX_FULCRUM_SIGMA_MM)
}

/// Decides from all tools together where the chroma samples lie: one camera recorded them all.
pub fn share_chroma_siting(frame: &Frame<'_>, tools: &mut [ToolTracker]) {
    let [stated_px, _] = frame.chroma_first_px;
    let shown = tools.iter().filter_map(|tool| tool.edges.chroma_right());
    let right_px = chroma_siting::decide(shown, stated_px, frame.shift_x);
    tools.iter_mut().for_each(|tool| tool.edges.set_chroma_right_px(right_px));
}

/// Decides from all tools together how long the camera exposes.
pub fn share_exposure(tools: &mut [ToolTracker]) {
    if let Some(exposure_s) = exposure::decide(tools.iter().map(|tool| tool.edges.exposure_evidence)) {
        tools.iter_mut().for_each(|tool| tool.edges.exposure_s = exposure_s);
    }
}
