//! Finds the gaps of a path, and decides why the tool has no position there: it left the view, or the tracker lost it.

use super::motion::FrameInstant;
use super::report::{Absence, Gap};
use crate::vision::camera::Camera;
use crate::vision::reason::MissReason;
use crate::vision::space::CameraPoint;
use crate::vision::trajectory::Sample;

/// Usual length of a band, mm, if it was not measured.
const USUAL_BAND_MM: f64 = 25.0;

/// Width of the margin along the picture's edges, as a share of the picture's height. A band's end in this margin
/// counts as being at the edge: in two frames a hand at 200 mm/s moves this far.
const MARGIN_SHARE: f64 = 0.08;

/// The margin along the picture's edges, for a band of known length.
pub struct FrameMargin<'a> {
    camera: &'a Camera,
    band_mm: f64,
}

impl<'a> FrameMargin<'a> {
    /// The margin for a band of this length, mm.
    pub fn new(camera: &'a Camera, band_mm: Option<f64>) -> Self {
        Self { camera, band_mm: band_mm.unwrap_or(USUAL_BAND_MM) }
    }

    /// Does the tip or the band's other end lie in the margin or outside the picture?
    fn is_reached_by(&self, sample: &Sample) -> bool {
        let back = sample.axis.map(|axis| sample.tip_mm - axis * self.band_mm);
        [Some(sample.tip_mm), back].into_iter().flatten().any(|end| !self.is_well_inside(CameraPoint(end)))
    }

    fn is_well_inside(&self, point: CameraPoint) -> bool {
        let (width, height) = (f64::from(self.camera.width), f64::from(self.camera.height));
        let margin = MARGIN_SHARE * height;
        let inside = |at: f64, size: f64| (margin..size - margin).contains(&at);
        self.camera.project(point).is_some_and(|at| inside(at.u(), width) && inside(at.v(), height))
    }
}

/// The gaps of a path, in order. `reasons` holds for every frame why the tool was not measured.
pub fn find_gaps(
    path: &[Sample],
    instants: &[FrameInstant],
    reasons: &[Option<MissReason>],
    rim: &FrameMargin<'_>,
) -> Vec<Gap> {
    let mut gaps = Vec::new();
    let mut before: Option<&Sample> = None;
    let mut next = 0; // index of the first instant after the last sample
    for after in path.iter().map(Some).chain([None]) {
        let end = after.map_or(instants.len(), |sample| instants.partition_point(|instant| instant.0 < sample.frame));
        if next < end {
            let absence = classify_absence(before, after, &reasons[next..end.min(reasons.len())], rim);
            gaps.push(Gap { first: instants[next].0, last: instants[end - 1].0, absence });
        }
        (next, before) = (end + 1, after);
    }
    gaps
}

/// Why a tool has no position now, judged without later frames: from its last position, and the reason why it was not
/// measured.
pub fn absence_now(last: Option<&Sample>, reason: MissReason, rim: &FrameMargin<'_>) -> Absence {
    classify_absence(last, None, &[Some(reason)], rim)
}

fn classify_absence(
    before: Option<&Sample>,
    after: Option<&Sample>,
    reasons: &[Option<MissReason>],
    rim: &FrameMargin<'_>,
) -> Absence {
    let main = main_reason(reasons).unwrap_or(MissReason::NoMarkerColour);
    let vanished = matches!(main, MissReason::NoMarkerColour | MissReason::TooSmall | MissReason::TipHidden);
    let by_the_rim = [before, after].into_iter().flatten().any(|sample| rim.is_reached_by(sample));
    let never_there = before.is_none() && after.is_none() && main == MissReason::NoMarkerColour;
    if never_there || (vanished && by_the_rim) { Absence::LeftView } else { Absence::Lost(main) }
}

/// The most frequent reason. The causes to reject a pose count together: however many there are, the band was there.
fn main_reason(reasons: &[Option<MissReason>]) -> Option<MissReason> {
    let all = || reasons.iter().flatten().copied();
    let general = most_frequent(all().map(MissReason::general).collect())?;
    most_frequent(all().filter(|reason| reason.general() == general).collect())
}

/// The most frequent of these; among equally frequent ones, the one from the latest stage.
fn most_frequent(reasons: Vec<MissReason>) -> Option<MissReason> {
    let count = |reason: MissReason| reasons.iter().filter(|other| **other == reason).count();
    let mut kinds = reasons.clone();
    kinds.sort_unstable();
    kinds.dedup();
    kinds.into_iter().max_by_key(|reason| (count(*reason), *reason))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;
    use crate::vision::camera::testing::STRAIGHT as CAMERA;
    use crate::vision::trajectory::SampleState;

    /// A tip at 150 mm depth whose tube comes from below: 6 px per mm, so its band ends 150 px further down.
    fn at(frame: u64, y_px: f64) -> Sample {
        Sample {
            frame,
            time_s: frame as f64 * 0.04,
            tool: 0,
            tip_mm: Point3::new(0.0, (y_px - CAMERA.cy) / 6.0, 150.0),
            velocity_mm_s: None,
            axis: Some(-Vector3::y()),
            tip_px: None,
            covariance_mm2: None,
            state: SampleState::Observed,
        }
    }

    fn gaps(path: &[Sample], frames: u64, reason: MissReason) -> Vec<Gap> {
        let instants: Vec<FrameInstant> = (0..frames).map(|frame| (frame, frame as f64 * 0.04)).collect();
        let reason_of = |frame: u64| path.iter().all(|s| s.frame != frame).then_some(reason);
        let reasons: Vec<Option<MissReason>> = (0..frames).map(reason_of).collect();
        find_gaps(path, &instants, &reasons, &FrameMargin::new(&CAMERA, Some(25.0)))
    }

    #[test]
    fn a_band_that_slides_out_below_has_left_the_view() {
        let path = [at(0, 300.0), at(1, 560.0), at(5, 300.0)];
        let gap = Gap { first: 2, last: 4, absence: Absence::LeftView };
        assert_eq!(gaps(&path, 6, MissReason::NoMarkerColour), [gap]);
    }

    #[test]
    fn a_band_that_vanishes_in_the_midst_of_the_picture_is_lost() {
        let path = [at(0, 300.0), at(5, 300.0)];
        let lost = |reason| [Gap { first: 1, last: 4, absence: Absence::Lost(reason) }];
        assert_eq!(gaps(&path, 6, MissReason::NoMarkerColour), lost(MissReason::NoMarkerColour));
    }

    #[test]
    fn a_band_that_is_there_but_cannot_be_measured_is_lost_even_at_the_rim() {
        let path = [at(0, 560.0), at(5, 560.0)];
        let lost = Gap { first: 1, last: 4, absence: Absence::Lost(MissReason::PoorFit) };
        assert_eq!(gaps(&path, 6, MissReason::PoorFit), [lost]);
    }

    #[test]
    fn causes_to_reject_a_pose_count_together() {
        let reasons = [MissReason::TipHidden, MissReason::TipHidden, MissReason::NotTape, MissReason::PoorFit];
        let one_more = reasons.into_iter().chain([MissReason::NotTape]);
        assert_eq!(main_reason(&reasons.map(Some)), Some(MissReason::TipHidden));
        assert_eq!(main_reason(&one_more.map(Some).collect::<Vec<_>>()), Some(MissReason::NotTape));
    }

    #[test]
    fn gaps_reach_to_the_recordings_ends_and_a_tool_that_never_came_was_out_of_view() {
        let ends = gaps(&[at(2, 300.0)], 5, MissReason::NoMarkerColour);
        assert_eq!(ends.iter().map(|g| (g.first, g.last)).collect::<Vec<_>>(), [(0, 1), (3, 4)]);
        let never = gaps(&[], 5, MissReason::NoMarkerColour);
        assert_eq!(never, [Gap { first: 0, last: 4, absence: Absence::LeftView }]);
        assert!(gaps(&[at(0, 300.0)], 1, MissReason::NoMarkerColour).is_empty());
    }
}
