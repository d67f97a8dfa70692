//! The tracker of one tool: its state, and the way of a frame through the stages.

use super::accept::ToolFrameResult;
use super::band_length_estimator::BandLengthEstimator;
use super::frame_context::FrameContext;
use super::hand_direction::HandDirection;
use super::learn;
use super::measurement::Measurement;
use super::origin::{self, Origin};
use super::predict::{Band, Prediction};
use super::record::{FrameRecord, PackedRecords};
use super::rival::Rivalry;
use super::settings::{HandSide, ToolSpec};
use super::shaft_search::ShaftSearch;
use super::trace::TraceRecorder;
use crate::vision::blob::components::ComponentFinder;
use crate::vision::edges::edge_model::EdgeModel;
use crate::vision::edges::shaft::SeenShaft;
use crate::vision::filter::track::Track;
use crate::vision::pose::TubeEstimate;
use crate::vision::pose::adjustment::Adjustment;
use crate::vision::pose::axis_line::AxisLine;
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::reason::MissReason;
use crate::vision::tube::Outline;

/// Tracker of one tool.
pub struct ToolTracker {
    pub(super) spec: ToolSpec,
    pub(super) class: u8,
    /// Its place among the tools with bare shafts.
    pub(super) bare: Option<usize>,
    pub(super) shaft_search: ShaftSearch,
    pub(super) finder: ComponentFinder,
    pub(super) edges: EdgeModel,
    pub(super) track: Track,
    /// The band and the pose of the last accepted measurement.
    pub(super) last_band: Option<Band>,
    pub(super) last_pose: Option<TubeEstimate>,
    pub(super) hand_direction: HandDirection,
    pub(super) seen_shaft: SeenShaft,
    pub(super) adjustment: Option<Adjustment>,
    pub(super) keyframes: Vec<TubeEstimate>,
    pub(super) lengths: BandLengthEstimator,
    pub(super) rivalry: Rivalry,
    pub(super) records: PackedRecords,
    pub(super) trace: TraceRecorder,
    /// All measurements before this frame were withdrawn.
    pub(super) has_withdrawn: bool,
}

impl ToolTracker {
    pub(super) fn new(spec: ToolSpec, class: u8, bare: Option<usize>, edges: EdgeModel) -> Self {
        Self {
            spec,
            class,
            bare,
            shaft_search: ShaftSearch::default(),
            finder: ComponentFinder::default(),
            edges,
            track: Track::default(),
            last_band: None,
            last_pose: None,
            hand_direction: HandDirection::default(),
            seen_shaft: SeenShaft::default(),
            adjustment: None,
            keyframes: Vec::new(),
            lengths: BandLengthEstimator::default(),
            rivalry: Rivalry::default(),
            records: PackedRecords::default(),
            trace: TraceRecorder::default(),
            has_withdrawn: false,
        }
    }

    /// Forgets the tool's position, but keeps the edge appearance, the band length and the direction to the hand.
    pub(super) fn start_over(&mut self) {
        let fresh = self.fresh();
        let Self { finder, lengths, hand_direction: hand, .. } = std::mem::replace(self, fresh);
        (self.finder, self.lengths, self.hand_direction) = (finder, lengths, hand);
    }

    /// A tracker of the same tool that has never seen it, but knows the edge appearance.
    pub(super) fn fresh(&self) -> Self {
        Self::new(self.spec.clone(), self.class, self.bare, self.edges.clone())
    }

    /// Starts over, and withdraws all measurements so far for this reason.
    pub(super) fn withdraw(&mut self, reason: MissReason) {
        let (records, trace) = (std::mem::take(&mut self.records), std::mem::take(&mut self.trace));
        self.start_over();
        (self.records, self.trace) = (records.without_poses(reason), trace);
        self.has_withdrawn = true;
    }

    /// Finds and measures the tool on a frame: predict → find → measure → accept → learn.
    pub(super) fn observe(&mut self, scene: &FrameContext<'_>) -> ToolFrameResult {
        let prediction = self.predict(scene);
        let measured = match self.try_prediction(scene, &prediction) {
            Some(measurement) => Ok(measurement),
            None => match self.bare {
                Some(bare) => self.find_and_measure_shaft(scene, &prediction, bare),
                None => self.find_and_measure(scene, &prediction, None),
            },
        };
        if self.bare.is_some() {
            let axis = if measured.is_err() { self.measure_axis(scene, &prediction) } else { None };
            return self.accept_and_learn(scene, &measured, axis); // its hand's side and its trocar are known otherwise
        }
        let measured = measured.map(|found| self.prefer_rival(scene, &prediction, found));
        let result = self.accept_and_learn(scene, &measured, None);
        self.learn_hand_side(scene, &result);
        result
    }

    /// Of the followed band and a rival, the one that is the tool's. If it is the rival, all measurements so far are
    /// withdrawn.
    fn prefer_rival(
        &mut self,
        scene: &FrameContext<'_>,
        prediction: &Prediction,
        followed: Measurement,
    ) -> Measurement {
        let Some(rival) = self.find_rival(scene, prediction, &followed) else { return followed };
        self.withdraw(MissReason::NotTape);
        (self.hand_direction, self.lengths) = Default::default();
        rival
    }

    /// The last two stages of a frame, and its record for the second pass. `axis` is what was measured of a tool whose
    /// tip is hidden.
    pub(super) fn accept_and_learn(
        &mut self,
        scene: &FrameContext<'_>,
        measured: &Result<Measurement, MissReason>,
        axis: Option<AxisLine>,
    ) -> ToolFrameResult {
        self.records.push(FrameRecord::new(measured), axis);
        let result = self.accept(scene, measured, axis);
        self.learn(scene, measured.as_ref().ok(), &result);
        result
    }

    /// Outline at the last measured position.
    pub(super) fn last_outline(&self) -> Option<Outline> {
        self.last_band.and_then(|band| band.tube.outline())
    }

    /// The point about which the tool turns, if known.
    pub(super) fn fulcrum(&self) -> Option<Fulcrum> {
        self.known_adjustment().map(|a| a.fulcrum)
    }

    /// The adjustment, if its fulcrum is known well enough to be used.
    pub(super) fn known_adjustment(&self) -> Option<&Adjustment> {
        let is_usable = |adjusted: &&Adjustment| !adjusted.is_wrong_way_round() && learn::is_fulcrum_known(adjusted);
        self.adjustment.as_ref().filter(is_usable)
    }

    /// The best known origin of the tool: its fulcrum, else an assumed one from the last pose, else its side of the
    /// picture.
    pub(super) fn origin(&self, side: HandSide) -> Origin {
        let assumed = || self.last_pose.as_ref().map(origin::assumed_trocar);
        self.fulcrum().or_else(assumed).map_or(Origin::Side(side), Origin::Fulcrum)
    }
}
