//! Alternates finding and measuring for one tool, and records both in the trace.

use nalgebra::Vector2;

use super::footprint::Footprint;
use super::frame_context::FrameContext;
use super::measure::Attempt;
use super::measurement::Measurement;
use super::predict::{Band, Prediction};
use super::tool::ToolTracker;
use crate::vision::blob::components::Component;
use crate::vision::blob::moments::Moments;
use crate::vision::reason::MissReason;

/// Maximum number of regions measured in one search: a peg board has half a dozen rings, each larger than a band far
/// from the camera.
const MAX_REGIONS: usize = 8;

/// Regions that were measured and rejected on this frame.
type Rejected = Vec<(Moments, MissReason)>;

impl ToolTracker {
    /// Measures at the predicted position, without a colour search.
    pub(super) fn try_prediction(&mut self, scene: &FrameContext<'_>, prediction: &Prediction) -> Option<Measurement> {
        let Attempt { outcome, fits } = self.measure_at_prediction(scene, prediction);
        self.trace.record_fits(fits);
        outcome
    }

    /// Searches by colour, first around the predicted position, then on the whole frame. The band at
    /// `elsewhere_than` does not count.
    pub(super) fn find_and_measure(
        &mut self,
        scene: &FrameContext<'_>,
        prediction: &Prediction,
        elsewhere_than: Option<&Footprint>,
    ) -> Result<Measurement, MissReason> {
        let mut rejected = Rejected::new();
        let mut search = |band| self.search_near(scene, prediction, band, elsewhere_than, &mut rejected);
        let nearby = search(prediction.band);
        match nearby {
            Err(_) if prediction.band.is_some() => search(None),
            found => found,
        }
    }

    /// Finds the regions near a band, or anywhere, and measures the largest until one is accepted. A region that was
    /// rejected earlier on this frame is not measured again: the visible part of a hidden band is the same in both
    /// searches.
    fn search_near(
        &mut self,
        scene: &FrameContext<'_>,
        prediction: &Prediction,
        band: Option<Band>,
        elsewhere_than: Option<&Footprint>,
        rejected: &mut Rejected,
    ) -> Result<Measurement, MissReason> {
        let mut best_reason = MissReason::NoMarkerColour;
        let mut best: Option<Measurement> = None;
        let regions = self.find_regions(scene, band);
        let is_elsewhere = |found: &Measurement| {
            elsewhere_than
                .zip(Footprint::of(found, scene.camera()))
                .is_none_or(|(place, found)| !place.is_same_band(&found))
        };
        for region in regions.iter().take(MAX_REGIONS) {
            let earlier = rejected.iter().find(|(moments, _)| *moments == region.moments);
            let reason = match earlier {
                Some((_, reason)) => *reason,
                None => match self.try_region_as_own(scene, prediction, region) {
                    Ok(found) if !is_elsewhere(&found) => continue,
                    Ok(found) if band.is_some() || found.is_clear() => return Ok(found),
                    Ok(found) => {
                        best = Some(match best {
                            Some(other) => Measurement::likelier(other, found),
                            None => found,
                        });
                        continue;
                    }
                    Err(reason) => {
                        rejected.push((region.moments, reason));
                        reason
                    }
                },
            };
            best_reason = best_reason.max(reason);
        }
        best.ok_or(best_reason)
    }

    /// Measures a region, and rejects it if its axis misses the fulcrum and the pixels do not support it well.
    fn try_region_as_own(
        &mut self,
        scene: &FrameContext<'_>,
        prediction: &Prediction,
        region: &Component,
    ) -> Result<Measurement, MissReason> {
        let to_hand = self.direction_to_hand(scene.camera(), prediction);
        let Attempt { outcome, fits } = self.measure_region_of_own_colour(scene, prediction, region, to_hand);
        self.trace.record_fits(fits);
        let measured = outcome.and_then(|measurement| {
            if !self.agrees_with_fulcrum(&measurement) {
                Err(MissReason::OffFulcrum)
            } else if measurement.is_without_shaft() {
                Err(MissReason::NotTape)
            } else {
                Ok(measurement)
            }
        });
        self.trace.record_region(region, measured.as_ref().err().copied());
        measured
    }

    /// Measures a region.
    pub(super) fn try_region(
        &mut self,
        scene: &FrameContext<'_>,
        prediction: &Prediction,
        region: &Component,
        to_hand: Option<Vector2<f64>>,
    ) -> Result<Measurement, MissReason> {
        let Attempt { outcome, fits } = self.measure_region(scene, prediction, region, to_hand);
        self.trace.record_fits(fits);
        outcome
    }
}
