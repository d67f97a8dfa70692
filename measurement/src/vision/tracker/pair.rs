//! Tracks two tools of one colour on a frame. Regions are found once, measured for both tools, and assigned together.
//!
//! Each tool is first followed at its predicted position. A tool not found there is searched for outside the bands
//! already found. The cost of giving a band to a tool is the squared Mahalanobis distance from the predicted position,
//! plus the mismatch with the tool's [`Origin`] in squared standard deviations. The distance term is limited so that
//! it counts less than [`DECISIVE_MARGIN`]: for a lost tool the trocar decides whose band it is, not nearness. A band
//! that the origin cannot decide is rejected.

use nalgebra::Point2;

use super::accept::ToolFrameResult;
use super::assignment::{self, Choice};
use super::footprint::Footprint;
use super::frame_context::FrameContext;
use super::measurement::{Grade, Measurement};
use super::origin::{DECISIVE_MARGIN, Origin};
use super::predict::Prediction;
use super::settings::HandSide;
use super::tool::ToolTracker;
use crate::vision::reason::MissReason;
use crate::vision::segmentation::region_of_interest::{CELL_PX, CellBox};

/// Maximum number of regions measured.
const MAX_REGIONS: usize = 4;

/// Maximum cost of the distance, and the cost for a lost tool, which may be anywhere.
const MAX_DISTANCE_COST: f64 = 9.0;

/// Maximum cost of the origin, for a band that does not clearly belong to the other tool.
const MAX_ORIGIN_COST: f64 = 30.0;

/// Finds and measures both tools on a frame: predict → find → measure → accept → learn. The left hand's tool comes
/// first.
pub fn observe(tools: [&mut ToolTracker; 2], scenes: [FrameContext<'_>; 2]) -> [ToolFrameResult; 2] {
    let mut search = PairSearch::predict(tools, &scenes);
    search.measure_at_predictions();
    if let Some(areas) = search.expected_areas() {
        search.find_and_measure(&areas);
    }
    if search.is_any_missing() {
        let anywhere = search.tools[0].search_areas(&scenes[0], None);
        search.find_and_measure(&anywhere);
    }
    search.accept_and_learn()
}

/// Search for both tools on one frame.
struct PairSearch<'a, 's> {
    tools: [&'a mut ToolTracker; 2],
    scenes: &'a [FrameContext<'s>; 2],
    origins: [Origin; 2],
    predictions: [Prediction; 2],
    found: [Option<Measurement>; 2],
    reasons: [MissReason; 2],
}

/// One region, measured for each tool.
type RegionMeasurements = [Result<Measurement, MissReason>; 2];

impl<'a, 's> PairSearch<'a, 's> {
    fn predict(tools: [&'a mut ToolTracker; 2], scenes: &'a [FrameContext<'s>; 2]) -> Self {
        let [left, right] = tools;
        let origins = [left.origin(HandSide::Left), right.origin(HandSide::Right)];
        let predictions = [left.predict(&scenes[0]), right.predict(&scenes[1])];
        let reasons = [MissReason::NoMarkerColour; 2];
        Self { tools: [left, right], scenes, origins, predictions, found: [None, None], reasons }
    }

    /// Measures both tools at their predicted positions. If both find the same band, neither keeps it, and both are
    /// searched for.
    fn measure_at_predictions(&mut self) {
        for tool in 0..2 {
            let measured = self.tools[tool].try_prediction(&self.scenes[tool], &self.predictions[tool]);
            self.found[tool] = measured.filter(|m| !self.belongs_to_other(tool, m));
        }
        if let [Some(left), Some(right)] = &self.found
            && self.are_same_band(left, right)
        {
            self.found = [None, None];
        }
    }

    fn is_any_missing(&self) -> bool {
        self.found.iter().any(Option::is_none)
    }

    /// Areas around the predicted positions of the missing tools; `None` if one has no prediction, or nothing is
    /// missing.
    fn expected_areas(&self) -> Option<Vec<CellBox>> {
        let mut areas: Vec<CellBox> = Vec::new();
        for tool in (0..2).filter(|tool| self.found[*tool].is_none()) {
            for area in self.tools[tool].search_areas(&self.scenes[tool], Some(self.predictions[tool].band?)) {
                match areas.iter_mut().find(|other| other.overlaps(&area)) {
                    Some(other) => *other = other.joined(&area),
                    None => areas.push(area),
                }
            }
        }
        (!areas.is_empty()).then_some(areas)
    }

    /// Measures the regions in these areas for each missing tool, and assigns them.
    fn find_and_measure(&mut self, areas: &[CellBox]) {
        let missing = [0, 1].map(|tool| self.found[tool].is_none());
        let mut candidates = self.measure_regions(areas, missing);
        let choices = self.assign(&candidates);
        for tool in (0..2).filter(|tool| missing[*tool]) {
            match choices[tool] {
                Choice::Band(band) => {
                    let nothing = Err(MissReason::NoMarkerColour);
                    self.found[tool] = std::mem::replace(&mut candidates[band][tool], nothing).ok();
                }
                Choice::Undecided => self.reasons[tool] = MissReason::EitherTool,
                Choice::Nothing => self.reasons[tool] = self.best_reason(tool, &candidates, choices[1 - tool]),
            }
        }
    }

    fn assign(&self, candidates: &[RegionMeasurements]) -> [Choice; 2] {
        let costs: Vec<[Option<f64>; 2]> =
            candidates.iter().map(|measured| [0, 1].map(|tool| self.cost(tool, measured))).collect();
        let are_two = |a: usize, b: usize| match (&candidates[a][0], &candidates[b][1]) {
            (Ok(left), Ok(right)) => !self.are_same_band(left, right),
            _ => true,
        };
        assignment::assign(&costs, are_two)
    }

    /// Why a tool got no band: the reason from the latest stage, over all regions but the one given to the other tool.
    fn best_reason(&self, tool: usize, candidates: &[RegionMeasurements], others: Choice) -> MissReason {
        let own = candidates.iter().enumerate().filter(|(band, _)| others != Choice::Band(*band));
        let reasons = own.filter_map(|(_, measured)| self.rejection_reason(tool, measured));
        reasons.fold(MissReason::NoMarkerColour, MissReason::max)
    }

    fn measure_regions(&mut self, areas: &[CellBox], missing: [bool; 2]) -> Vec<RegionMeasurements> {
        let camera = &self.scenes[0].settings.camera;
        let taken: Vec<Footprint> = self.found.iter().flatten().filter_map(|m| Footprint::of(m, camera)).collect();
        let counts = |column: usize, row: usize| {
            let middle = |cell: usize| (cell * CELL_PX) as f64 + 0.5 * (CELL_PX as f64 - 1.0);
            !taken.iter().any(|band| band.contains(Point2::new(middle(column), middle(row))))
        };
        let finder = usize::from(!missing[0]);
        let regions = self.tools[finder].find_regions_in(&self.scenes[finder], areas, counts);
        let measured = regions.iter().take(MAX_REGIONS).map(|region| {
            [0, 1].map(|tool| {
                let not_needed = Err(MissReason::NoMarkerColour);
                // Measured without the direction to this tool's hand: it would take the wrong end of the other tool's
                // band for the tip.
                if !missing[tool] {
                    return not_needed;
                }
                self.tools[tool].try_region(&self.scenes[tool], &self.predictions[tool], region, None)
            })
        });
        measured.collect()
    }

    /// Cost of giving a region to a tool; `None` if it cannot be that tool's.
    fn cost(&self, tool: usize, measured: &RegionMeasurements) -> Option<f64> {
        let band = measured[tool].as_ref().ok()?;
        if !self.tools[tool].agrees_with_fulcrum(band)
            || self.belongs_to_other(tool, band)
            || self.may_be_the_others(tool, measured)
        {
            return None;
        }
        if self.found[1 - tool].as_ref().is_some_and(|other| self.are_same_band(band, other)) {
            return None;
        }
        let distance = self.tools[tool].mahalanobis_squared(&self.scenes[tool], &band.estimate);
        let by_distance = distance.map_or(MAX_DISTANCE_COST, |squared| squared.min(MAX_DISTANCE_COST));
        Some(by_distance + self.origins[tool].mismatch_squared(&band.estimate).min(MAX_ORIGIN_COST))
    }

    /// Could the region be the band of the other tool, although it could not be measured for that tool? If this tool
    /// is lost and the other was not found on this frame either, only a good fit may claim the region.
    fn may_be_the_others(&self, tool: usize, measured: &RegionMeasurements) -> bool {
        let is_lost = |tool: usize| self.found[tool].is_none() && self.predictions[tool].band.is_none();
        let is_doubtful = measured[tool].as_ref().is_ok_and(|band| band.grade() < Grade::Good);
        is_lost(tool) && self.found[1 - tool].is_none() && measured[1 - tool].is_err() && is_doubtful
    }

    /// Why a tool did not get a region that was given to neither tool.
    fn rejection_reason(&self, tool: usize, measured: &RegionMeasurements) -> Option<MissReason> {
        match &measured[tool] {
            Err(reason) => Some(*reason),
            Ok(band) if self.belongs_to_other(tool, band) => None,
            Ok(_) if self.may_be_the_others(tool, measured) => Some(MissReason::EitherTool),
            Ok(band) if !self.tools[tool].agrees_with_fulcrum(band) => Some(MissReason::OffFulcrum),
            Ok(_) => Some(MissReason::OtherToolsBand),
        }
    }

    /// Does the other tool's origin explain the band so much better that it belongs to the other tool?
    fn belongs_to_other(&self, tool: usize, band: &Measurement) -> bool {
        let [own, other] = [tool, 1 - tool].map(|of| self.origins[of].mismatch_squared(&band.estimate));
        own - other > DECISIVE_MARGIN
    }

    fn are_same_band(&self, one: &Measurement, other: &Measurement) -> bool {
        let of = |band| Footprint::of(band, &self.scenes[0].settings.camera);
        of(one).zip(of(other)).is_some_and(|(one, other)| one.is_same_band(&other))
    }

    fn accept_and_learn(self) -> [ToolFrameResult; 2] {
        let Self { tools: [left, right], scenes, found: [at_left, at_right], reasons, .. } = self;
        let left = left.accept_and_learn(&scenes[0], &at_left.ok_or(reasons[0]), None);
        let right = right.accept_and_learn(&scenes[1], &at_right.ok_or(reasons[1]), None);
        [left, right]
    }
}
