//! Fits a tube to one band on one frame: from a region of the tool's colour, or from where the band is expected.

use nalgebra::Vector2;

use super::frame_context::FrameContext;
use super::measure::{Attempt, RegionAttempt};
use super::measurement::{Grade, Measurement};
use super::predict::Band;
use super::probe_pass::{CLOSE_PASS, FINE_PASSES, PROBE_PASSES};
use super::settings::{CameraView, PoseMethod, ToolSpec};
use super::trace::FitRecorder;
use crate::vision::blob::moments::RegionRectangle;
use crate::vision::camera::Camera;
use crate::vision::edges::edge_model::EdgeModel;
use crate::vision::edges::parallel_borders;
use crate::vision::edges::scan_lines::{self, CoarseBand};
use crate::vision::edges::shaft;
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::pose::{pinhole_width, tangent_planes};
use crate::vision::reason::MissReason;
use crate::vision::segmentation::region_of_interest::CellBox;
use crate::vision::space::{CameraPoint, Normalised, Pixel};
use crate::vision::tube::Tube;

/// Everything needed to fit one band, except where it is.
pub struct BandFit<'a> {
    /// The frame.
    pub scene: &'a FrameContext<'a>,
    /// The tool's class in the colour table.
    pub class: u8,
    /// The tool.
    pub spec: &'a ToolSpec,
    /// Length of the band and its standard deviation, mm: measured by a person (standard deviation 0), or learned from
    /// this recording.
    pub length: Option<(f64, f64)>,
    /// Expected motion in the picture, pixels/s.
    pub motion_px_s: Vector2<f64>,
    /// Fulcrum in the camera frame, mm, once known.
    pub fulcrum: Option<Fulcrum>,
    /// Depth at the last measurement, mm.
    pub last_depth_mm: Option<f64>,
    /// Appearance of the tool's edges.
    pub edges: &'a EdgeModel,
    /// Each step of a fit is recorded.
    pub is_traced: bool,
}

impl BandFit<'_> {
    pub(super) fn camera(&self) -> &Camera {
        self.scene.camera()
    }

    pub(super) fn radius_mm(&self) -> f64 {
        0.5 * self.spec.diameter_mm
    }

    /// Measures the band of a region. `hand_first` returns whether the first of two ends is nearer to the hand, if
    /// known. Otherwise the end with a shaft beyond it is the hand's, else the camera's view decides.
    pub fn measure(
        &self,
        region: &RegionRectangle,
        hand_first: impl Fn(Pixel, Pixel) -> Option<bool>,
    ) -> RegionAttempt {
        let mut recorder = FitRecorder::new(self.is_traced);
        let outcome = self.measure_recorded(region, hand_first, &mut recorder);
        Attempt { outcome, fits: recorder.into_fits() }
    }

    fn measure_recorded(
        &self,
        region: &RegionRectangle,
        hand_first: impl Fn(Pixel, Pixel) -> Option<bool>,
        recorder: &mut FitRecorder,
    ) -> Result<Measurement, MissReason> {
        let FrameContext { frame, segment, .. } = self.scene;
        let coarse = scan_lines::scan(frame, *segment, self.class, region).ok_or(MissReason::BordersNotFound)?;
        self.measure_coarse(&coarse, hand_first, recorder)
    }

    /// Measures the likeliest band inside a region that is not a band's alone, for example because a prop of the tape's
    /// colour touches it.
    pub fn measure_inside(&self, bounds: CellBox, hand_first: impl Fn(Pixel, Pixel) -> Option<bool>) -> RegionAttempt {
        /// Longest band of unknown length, in widths.
        const LONGEST: f64 = 8.0;
        /// A band that leans towards the camera looks longer, relative to its middle's width.
        const LEANING: f64 = 1.25;
        let mut recorder = FitRecorder::new(self.is_traced);
        let FrameContext { frame, segment, .. } = self.scene;
        let longest = self.length.map_or(LONGEST, |(length_mm, _)| LEANING * length_mm / self.spec.diameter_mm);
        let mut best: Result<Measurement, MissReason> = Err(MissReason::WrongShape);
        for coarse in parallel_borders::find(frame, *segment, self.class, bounds, longest) {
            let found = self.measure_coarse(&coarse, &hand_first, &mut recorder);
            best = match (best, found) {
                (Ok(one), Ok(other)) => Ok(Measurement::likelier(one, other)),
                (best, found) => better_of(best, found),
            };
        }
        Attempt { outcome: best, fits: recorder.into_fits() }
    }

    /// Measures the band with these coarse borders; if the shaft behind it seems wider than the band, also the one with
    /// the shaft's borders, and returns the likelier.
    fn measure_coarse(
        &self,
        coarse: &CoarseBand,
        hand_first: impl Fn(Pixel, Pixel) -> Option<bool>,
        recorder: &mut FitRecorder,
    ) -> Result<Measurement, MissReason> {
        let found = self.measure_between(coarse, &hand_first, recorder)?;
        let found = match self.as_wide_as_shaft(coarse, &found) {
            Some(wider) => more_likely(self.measure_between(&wider, &hand_first, recorder), Ok(found))?,
            None => found,
        };
        if self.is_piece(&found) { Err(MissReason::NotTape) } else { Ok(found) }
    }

    /// Measures the band with these coarse borders.
    fn measure_between(
        &self,
        coarse: &CoarseBand,
        hand_first: impl Fn(Pixel, Pixel) -> Option<bool>,
        recorder: &mut FitRecorder,
    ) -> Result<Measurement, MissReason> {
        let lines = self.border_lines(coarse).ok_or(MissReason::BordersNotFound)?;
        let [back, front] = coarse.ends;
        let known = hand_first(back, front);
        let likely = known.unwrap_or_else(|| self.hand_first_by_view(back, front));
        if self.scene.settings.pose == PoseMethod::PinholeWidth {
            let [distal, proximal] = self.ends(coarse, likely)?;
            let tube = pinhole_width::locate(lines, distal, proximal, self.radius_mm());
            return Ok(self.measurement_from_width(tube.ok_or(MissReason::PoorFit)?, coarse));
        }
        let mut fit = |hand_at_back: bool| {
            let [distal, proximal] = self.ends(coarse, hand_at_back)?;
            let by_taper = tangent_planes::locate(lines, distal, proximal, self.radius_mm());
            let starts = self.starts(coarse, [distal, proximal], by_taper);
            let seen_mm = by_taper.and_then(|tube| tangent_planes::distance_behind_tip(&tube, proximal));
            self.best_fit_of(&starts, seen_mm, recorder)
        };
        match known {
            Some(hand_at_back) => fit(hand_at_back),
            None => more_likely(fit(likely), fit(!likely)),
        }
    }

    /// The viewing directions of the band's distal and proximal end.
    fn ends(&self, coarse: &CoarseBand, hand_at_back: bool) -> Result<[Normalised; 2], MissReason> {
        let [back, front] = coarse.ends;
        let (distal, proximal) = if hand_at_back { (front, back) } else { (back, front) };
        let sight = |pixel| self.camera().normalised_of(pixel).ok_or(MissReason::OutsideLensModel);
        Ok([sight(distal)?, sight(proximal)?])
    }

    /// Guesses the hand's end from the camera's position: hands are below the picture, or beside it.
    fn hand_first_by_view(&self, first: Pixel, second: Pixel) -> bool {
        let frame = self.scene.frame;
        let centre = Pixel::new(0.5 * frame.width() as f64, 0.5 * frame.height() as f64);
        match self.scene.settings.view {
            Some(CameraView::Top) => first.v() > second.v(),
            _ => (first.0 - centre.0).norm() > (second.0 - centre.0).norm(),
        }
    }

    /// Refines each start until one explains the pixels well; otherwise returns the best fit that is possible at all.
    /// Skips a start that would lead to a fit already made.
    fn best_fit_of(
        &self,
        starts: &[Tube],
        seen_mm: Option<f64>,
        recorder: &mut FitRecorder,
    ) -> Result<Measurement, MissReason> {
        let length_mm = self.length.map(|l| l.0).or(seen_mm).ok_or(MissReason::LengthUnknown)?;
        let mut refined: Vec<Tube> = Vec::new();
        let mut best: Result<Measurement, MissReason> = Err(MissReason::PoorFit);
        let mut piece = None;
        for start in starts {
            if refined.iter().any(|tube| self.is_similar(start, tube, length_mm)) {
                continue;
            }
            let found = self.refine(start, length_mm, PROBE_PASSES, recorder);
            refined.extend(found.as_ref().ok().map(|m| m.estimate.tube));
            let found = found.and_then(possible).map(|found| self.with_continuation(found));
            match found {
                Ok(found) if self.is_piece(&found) => piece = Some(found),
                found => best = better_of(best, found),
            }
            if best.as_ref().is_ok_and(|m| m.grade() == Grade::Good) {
                break;
            }
        }
        best.or_else(|reason| piece.ok_or(reason))
    }

    /// Is it a piece of a wider band? An end is missing, and there is tape behind the measured length.
    fn is_piece(&self, found: &Measurement) -> bool {
        let is_length_measured = self.spec.band_length_mm().is_some();
        !found.ends_seen && is_length_measured && self.has_tape_behind(&found.estimate.tube, found.length_mm)
    }

    /// The measurement, with where the borders of its band go on.
    pub fn with_continuation(&self, found: Measurement) -> Measurement {
        let (scene, tube) = (self.scene, &found.estimate.tube);
        let is_visible = |place, at| scene.is_visible(place, at);
        let continuation =
            shaft::continuation(scene.frame, self.camera(), self.edges, tube, found.length_mm, is_visible);
        Measurement { continuation: Some(continuation), ..found }
    }

    /// Fits the expected band to the edges in the pixels, without a colour region. Accepts the fit only if it agrees
    /// with the expectation.
    pub fn follow(&self, expected: &Band) -> Attempt<Option<Measurement>> {
        let mut recorder = FitRecorder::new(self.is_traced);
        let can_follow = self.scene.settings.pose == PoseMethod::TangentPlanes;
        let outcome = if can_follow { self.follow_recorded(expected, &mut recorder) } else { None };
        Attempt { outcome, fits: recorder.into_fits() }
    }

    /// If the tube is within `RIGHT_PX` of where it was expected, one close pass is enough.
    fn follow_recorded(&self, expected: &Band, recorder: &mut FitRecorder) -> Option<Measurement> {
        const RIGHT_PX: f64 = 3.0;
        const MAX_PX: f64 = 15.0;
        let Band { tube, length_mm } = *expected;
        let within = |found: &Measurement, limit_px: f64| {
            self.corner_distance_px(&tube, &found.estimate.tube, length_mm).is_some_and(|px| px < limit_px)
        };
        let close = self.refine(&tube, length_mm, CLOSE_PASS, recorder).ok();
        let (start, passes) = match close.filter(|found| found.grade() >= Grade::Complete) {
            Some(found) if within(&found, RIGHT_PX) => return Some(found),
            Some(found) => (found.estimate.tube, CLOSE_PASS),
            None => (tube, FINE_PASSES), // with an end not found, the tube may have slid along its axis
        };
        let found = self.refine(&start, length_mm, passes, recorder).ok()?;
        let grade = found.grade();
        let goes_on = grade >= Grade::Complete && within(&found, MAX_PX);
        (grade == Grade::Good || goes_on).then_some(found)
    }

    /// Largest distance between corresponding corners of the bands of two tubes in the picture, pixels.
    fn corner_distance_px(&self, one: &Tube, other: &Tube, length_mm: f64) -> Option<f64> {
        let mut pairs = one.outline()?.corners(length_mm).into_iter().zip(other.outline()?.corners(length_mm));
        let pixel = |corner| self.camera().project(CameraPoint(corner)).map(|pixel| pixel.0);
        pairs.try_fold(0.0, |max: f64, (one, other)| Some(max.max((pixel(one)? - pixel(other)?).norm())))
    }

    /// Would refining `start` lead to `refined`, which was refined already?
    fn is_similar(&self, start: &Tube, refined: &Tube, length_mm: f64) -> bool {
        const NEAR_PX: f64 = 3.0;
        const NEAR_RAD: f64 = 0.15;
        start.axis.angle(&refined.axis) < NEAR_RAD
            && self.corner_distance_px(start, refined, length_mm).is_some_and(|px| px < NEAR_PX)
    }
}

/// The measurement, if it may be a band.
fn possible(measurement: Measurement) -> Result<Measurement, MissReason> {
    if measurement.grade() >= Grade::Possible { Ok(measurement) } else { Err(MissReason::PoorFit) }
}

/// Of two ways round, the one that is more likely a tool's band; the first unless the second is clearly better.
fn more_likely(
    first: Result<Measurement, MissReason>,
    second: Result<Measurement, MissReason>,
) -> Result<Measurement, MissReason> {
    const CLEARLY: f64 = 0.15;
    match (&first, &second) {
        (Ok(one), Ok(other)) if other.likelihood() <= one.likelihood() + CLEARLY => first,
        (Ok(_), Ok(_)) => second,
        _ => better_of(first, second),
    }
}

/// The measurement that agrees with more of the outline; without one, the reason from the later stage.
fn better_of(
    old: Result<Measurement, MissReason>,
    new: Result<Measurement, MissReason>,
) -> Result<Measurement, MissReason> {
    let is_better = match (&new, &old) {
        (Ok(new), Ok(old)) => new.seen_share > old.seen_share,
        (Ok(_), Err(_)) => true,
        (Err(new), Err(old)) => new > old,
        (Err(_), Ok(_)) => false,
    };
    if is_better { new } else { old }
}
