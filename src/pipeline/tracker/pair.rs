//! Tracks two tools of one colour on a frame. Regions are found once, measured for both tools, and assigned together.
//!
//! Each tool is first followed at its predicted position. A tool not found there is searched for outside the bands
//! already found. The cost of giving a band to a tool is the squared Mahalanobis distance from the predicted position,
//! plus the mismatch with the tool's [`Origin`] in squared standard deviations. The distance term is limited so that
//! it counts less than [`DECISIVE_MARGIN`]: for a lost tool the trocar decides whose band it is, not nearness. A band
//! that the origin cannot decide is rejected.

use nalgebra::Point2;

use super::assignment::{self, Choice};
use super::footprint::Footprint;
use super::measurement::Measurement;
use super::origin::{DECISIVE, Origin};
use super::settings::Side;
use super::tool::{Scene, Seen, ToolTracker};
use crate::pipeline::reason::Reason;
use crate::pipeline::segmentation::region_of_interest::{CELL_PX, CellBox};
use crate::pipeline::tube::Tube;

/// Maximum number of regions measured.
const MOST_REGIONS: usize = 4;

/// Maximum cost of the distance, and the cost for a lost tool, which may be anywhere.
const MOST_BY_DISTANCE: f64 = 9.0;

/// Maximum cost of the origin, for a band that does not clearly belong to the other tool.
const MOST_BY_ORIGIN: f64 = 30.0;

/// Finds both tools; the left hand's comes first.
pub fn observe(tools: [&mut ToolTracker; 2], scenes: [Scene<'_>; 2]) -> [Seen; 2] {
    let mut look = Look::new(tools, &scenes);
    look.follow();
    let nearby = look.nearby();
    if let Some(places) = &nearby {
        look.search(places);
    }
    if look.is_missing() {
        let anywhere = look.tools[0].places(&scenes[0], None);
        look.search(&anywhere);
    }
    look.conclude()
}

/// Search for both tools on one frame.
struct Look<'a, 's> {
    tools: [&'a mut ToolTracker; 2],
    scenes: &'a [Scene<'s>; 2],
    origins: [Origin; 2],
    expected: [Option<(Tube, f64)>; 2],
    found: [Option<Measurement>; 2],
    reasons: [Reason; 2],
}

/// One region, measured for each tool.
type Candidate = [Result<Measurement, Reason>; 2];

impl<'a, 's> Look<'a, 's> {
    fn new(tools: [&'a mut ToolTracker; 2], scenes: &'a [Scene<'s>; 2]) -> Self {
        let [left, right] = tools;
        let origins = [left.origin(Side::Left), right.origin(Side::Right)];
        let expected = [left.expect(&scenes[0]), right.expect(&scenes[1])];
        let reasons = [Reason::NoMarkerColour; 2];
        Self { tools: [left, right], scenes, origins, expected, found: [None, None], reasons }
    }

    /// Follows both tools at their predicted positions. If both find the same band, neither keeps it, and both are
    /// searched for.
    fn follow(&mut self) {
        for tool in 0..2 {
            let followed = self.tools[tool].follow(&self.scenes[tool], self.expected[tool]);
            self.found[tool] = followed.filter(|m| !self.is_the_others(tool, m));
        }
        if let [Some(left), Some(right)] = &self.found
            && self.are_same(left, right)
        {
            self.found = [None, None];
        }
    }

    fn is_missing(&self) -> bool {
        self.found.iter().any(Option::is_none)
    }

    /// Areas around the predicted positions of the missing tools; `None` if one has no prediction, or nothing is
    /// missing.
    fn nearby(&self) -> Option<Vec<CellBox>> {
        let mut places: Vec<CellBox> = Vec::new();
        for tool in (0..2).filter(|tool| self.found[*tool].is_none()) {
            for place in self.tools[tool].places(&self.scenes[tool], Some(self.expected[tool]?)) {
                match places.iter_mut().find(|other| other.overlaps(&place)) {
                    Some(other) => *other = other.joined(&place),
                    None => places.push(place),
                }
            }
        }
        (!places.is_empty()).then_some(places)
    }

    /// Measures the regions in these areas for each missing tool, and assigns them.
    fn search(&mut self, places: &[CellBox]) {
        let missing = [0, 1].map(|tool| self.found[tool].is_none());
        let mut candidates = self.candidates(places, missing);
        let costs: Vec<[Option<f64>; 2]> =
            candidates.iter().map(|measured| [0, 1].map(|tool| self.cost(tool, measured))).collect();
        let are_two = |a: usize, b: usize| match (&candidates[a][0], &candidates[b][1]) {
            (Ok(left), Ok(right)) => !self.are_same(left, right),
            _ => true,
        };
        let choices = assignment::assign(&costs, are_two);
        for tool in (0..2).filter(|tool| missing[*tool]) {
            match choices[tool] {
                Choice::Band(band) => {
                    let nothing = Err(Reason::NoMarkerColour);
                    self.found[tool] = std::mem::replace(&mut candidates[band][tool], nothing).ok();
                }
                Choice::Undecided => self.reasons[tool] = Reason::EitherTool,
                Choice::Nothing => {
                    let given = match choices[1 - tool] {
                        Choice::Band(band) => Some(band),
                        _ => None,
                    };
                    let own = candidates.iter().enumerate().filter(|(band, _)| Some(*band) != given);
                    let reasons = own.filter_map(|(_, measured)| self.reason(tool, measured));
                    self.reasons[tool] = reasons.fold(Reason::NoMarkerColour, Reason::max);
                }
            }
        }
    }

    fn candidates(&mut self, places: &[CellBox], missing: [bool; 2]) -> Vec<Candidate> {
        let camera = &self.scenes[0].settings.camera;
        let taken: Vec<Footprint> = self.found.iter().flatten().filter_map(|m| Footprint::of(m, camera)).collect();
        let counts = |column: usize, row: usize| {
            let middle = |cell: usize| (cell * CELL_PX) as f64 + 0.5 * (CELL_PX as f64 - 1.0);
            !taken.iter().any(|band| band.holds(Point2::new(middle(column), middle(row))))
        };
        let finder = usize::from(!missing[0]);
        let regions = self.tools[finder].regions_in(&self.scenes[finder], places, counts);
        let measured = regions.iter().take(MOST_REGIONS).map(|region| {
            [0, 1].map(|tool| {
                let not_needed = Err(Reason::NoMarkerColour);
                // Measured without the direction to this tool's hand: it would take the wrong end of the other tool's
                // band for the tip.
                if missing[tool] { self.tools[tool].measure(&self.scenes[tool], region, None) } else { not_needed }
            })
        });
        measured.collect()
    }

    /// Cost of giving a region to a tool; `None` if it cannot be that tool's.
    fn cost(&self, tool: usize, measured: &Candidate) -> Option<f64> {
        let band = measured[tool].as_ref().ok()?;
        if !self.tools[tool].comes_from_the_hand(band)
            || self.is_the_others(tool, band)
            || self.is_claimed(tool, measured)
        {
            return None;
        }
        if self.found[1 - tool].as_ref().is_some_and(|other| self.are_same(band, other)) {
            return None;
        }
        let Scene { frame, settings, .. } = &self.scenes[tool];
        let distance = self.tools[tool].surprise(frame.time_s, &band.estimate, &settings.motion.thread());
        let by_distance = distance.map_or(MOST_BY_DISTANCE, |squared| squared.min(MOST_BY_DISTANCE));
        Some(by_distance + self.origins[tool].against(&band.estimate).min(MOST_BY_ORIGIN))
    }

    /// Could the region be the band of the other tool, although it could not be measured for that tool? If this tool
    /// is lost and the other was not found on this frame either, only a good fit may claim the region.
    fn is_claimed(&self, tool: usize, measured: &Candidate) -> bool {
        let is_lost = |tool: usize| self.found[tool].is_none() && self.expected[tool].is_none();
        let is_doubtful = measured[tool].as_ref().is_ok_and(|band| !band.is_good());
        is_lost(tool) && self.found[1 - tool].is_none() && measured[1 - tool].is_err() && is_doubtful
    }

    /// Why a tool did not get a region that was given to neither tool.
    fn reason(&self, tool: usize, measured: &Candidate) -> Option<Reason> {
        match &measured[tool] {
            Err(reason) => Some(*reason),
            Ok(band) if self.is_the_others(tool, band) => None,
            Ok(_) if self.is_claimed(tool, measured) => Some(Reason::EitherTool),
            Ok(_) => Some(Reason::ImpossiblePose),
        }
    }

    /// Does the other tool's origin explain the band so much better that it belongs to the other tool?
    fn is_the_others(&self, tool: usize, band: &Measurement) -> bool {
        let [own, other] = [tool, 1 - tool].map(|of| self.origins[of].against(&band.estimate));
        own - other > DECISIVE
    }

    fn are_same(&self, one: &Measurement, other: &Measurement) -> bool {
        let of = |band| Footprint::of(band, &self.scenes[0].settings.camera);
        of(one).zip(of(other)).is_some_and(|(one, other)| one.is_same(&other))
    }

    fn conclude(self) -> [Seen; 2] {
        let Self { tools: [left, right], scenes, found: [at_left, at_right], reasons, .. } = self;
        let left = left.conclude(&scenes[0], at_left.ok_or(reasons[0]));
        let right = right.conclude(&scenes[1], at_right.ok_or(reasons[1]));
        [left, right]
    }
}
