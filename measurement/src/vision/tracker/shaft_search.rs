//! Finds and measures a bare shaft: the strips of the frame, each refined with the edges in the pixels.

use nalgebra::{Point2, Point3, Vector2};

use super::band_fit::BandFit;
use super::frame_context::FrameContext;
use super::measurement::{Grade, Measurement};
use super::predict::Prediction;
use super::probe_pass::STRIP_PASSES;
use super::tool::ToolTracker;
use super::trace::FitRecorder;
use crate::vision::edges::line_fit::BorderLine;
use crate::vision::pose::tangent_planes;
use crate::vision::reason::MissReason;
use crate::vision::space::CameraPoint;
use crate::vision::strip::Strip;
use crate::vision::strip::borders::LikelyStrip;
use crate::vision::strip::finder::FrameStrips;
use crate::vision::tube::{BorderSide, Tube};

/// Length of the shaft that is measured, mm. A longer piece would show its direction better, but the play of the trocar
/// and a bent shaft count more the longer it is.
pub const MEASURED_SHAFT_MM: f64 = 60.0;

/// Searches of the whole picture for a shaft that is not found. They take so long that not every frame is searched,
/// except in recordings where the trocar is known ([`FrameStrips::may_search_always`]).
#[derive(Clone, Copy, Debug, Default)]
pub struct ShaftSearch {
    /// Searches without success since the last one with it.
    failed: u32,
    /// Frames until the next search.
    pause: u32,
    reason: Option<MissReason>,
}

impl ShaftSearch {
    /// The reason of the last search, on frames without one.
    fn pausing(&mut self) -> Option<MissReason> {
        let reason = self.reason.filter(|_| self.pause > 0);
        self.pause = self.pause.saturating_sub(1);
        reason
    }

    /// The reason of the last search.
    fn last_reason(&self) -> MissReason {
        self.reason.unwrap_or(MissReason::NoMarkerColour)
    }

    /// Ends a search that failed for a reason, or succeeded.
    fn end(&mut self, reason: Option<MissReason>, is_trocar_known: bool) {
        /// Most frames between two searches, with the trocar known and without: a tenth and half of a second at 30 Hz.
        const MAX_PAUSES: [u32; 2] = [2, 14];
        self.failed = if reason.is_some() { self.failed + 1 } else { 0 };
        self.pause = self.failed.min(MAX_PAUSES[usize::from(!is_trocar_known)]);
        self.reason = reason;
    }
}

/// Leans away from the camera that are tried, degrees: trocars lie on the camera's side of the tips more often than not.
const LEANS_DEG: [f64; 3] = [0.0, 35.0, -35.0];

impl ToolTracker {
    /// Searches the whole frame for the shaft, and measures the strips that may be it, the best first.
    pub(super) fn find_and_measure_shaft(
        &mut self,
        scene: &FrameContext<'_>,
        prediction: &Prediction,
        bare: usize,
    ) -> Result<Measurement, MissReason> {
        let Some(strips) = scene.strips else { return Err(MissReason::NoMarkerColour) };
        let pausing = match strips.is_turn_of(bare) {
            Some(true) => None,
            Some(false) => Some(self.shaft_search.last_reason()),
            None if strips.may_search_always(bare) => None,
            None => self.shaft_search.pausing(),
        };
        if let Some(reason) = pausing {
            return Err(reason);
        }
        let found = self.measure_best_strip(scene, prediction, strips, &strips.of_tool(bare));
        self.shaft_search.end(found.as_ref().err().copied(), strips.is_trocar_known(bare));
        found
    }

    /// Measures the strips until one is accepted.
    fn measure_best_strip(
        &mut self,
        scene: &FrameContext<'_>,
        prediction: &Prediction,
        frame: &FrameStrips<'_>,
        strips: &[Strip],
    ) -> Result<Measurement, MissReason> {
        let mut best = Err(MissReason::NoMarkerColour);
        for strip in strips {
            let mut recorder = FitRecorder::new(self.trace.is_recording());
            let measured = self.band_fit(scene, prediction).measure_strip(frame, strip, &mut recorder);
            self.trace.record_fits(recorder.into_fits());
            let measured = measured.and_then(|found| {
                if self.agrees_with_fulcrum(&found) { Ok(found) } else { Err(MissReason::OffFulcrum) }
            });
            match measured {
                Ok(found) => return Ok(found),
                Err(reason) => best = best.map_err(|other: MissReason| other.max(reason)),
            }
        }
        best
    }
}

impl BandFit<'_> {
    /// Measures the shaft of a strip: the first of its likely pairs of borders that is a tube's. Whether its end shows
    /// does not choose among them. Smeared borders are sought where no sharp ones are a tube's.
    fn measure_strip(
        &self,
        strips: &FrameStrips<'_>,
        strip: &Strip,
        recorder: &mut FitRecorder,
    ) -> Result<Measurement, MissReason> {
        /// Least smear that shows motion, pixels: a sharp border may seem to have less.
        const MIN_SMEAR_PX: f64 = 3.0;
        let rows = strips.rows_across(self.camera(), strip);
        let smeared = std::iter::once_with(|| rows.with_smeared_borders(MIN_SMEAR_PX / self.camera().fx)).flatten();
        let mut reason = MissReason::BordersNotFound;
        for likely in rows.with_sharp_borders().into_iter().chain(smeared) {
            match self.smeared_by(&likely).measure_between_borders(&likely.strip, recorder) {
                Err(other) if other != MissReason::TipHidden => reason = reason.max(other),
                decided => return decided,
            }
        }
        Err(reason)
    }

    /// The same fit for a tool whose motion has smeared the borders of its strip, if it has. The motion across the strip
    /// is that of the smear. Its sign does not matter.
    fn smeared_by(&self, likely: &LikelyStrip) -> BandFit<'_> {
        let along = likely.strip.end.0 - likely.strip.entry.0;
        let across = Vector2::new(-along.y, along.x).try_normalize(1e-9).filter(|_| likely.smear > 0.0);
        let motion_px_s = across.map_or(self.motion_px_s, |across| {
            let moved_px = likely.smear * self.camera().fx;
            self.motion_px_s + across * (moved_px / self.edges.exposure_s - self.motion_px_s.dot(&across))
        });
        BandFit { motion_px_s, ..*self }
    }

    /// Measures the shaft between the borders of a strip.
    fn measure_between_borders(&self, borders: &Strip, recorder: &mut FitRecorder) -> Result<Measurement, MissReason> {
        let mut best = Err(MissReason::BordersNotFound);
        for start in self.starts_of_strip(borders) {
            let fit = self.fit_shaft(&start, MEASURED_SHAFT_MM, STRIP_PASSES, recorder);
            let tube = fit.as_ref().map_or_else(|miss| miss.tube, |fit| Some(fit.estimate.tube));
            let found = match tube.is_some_and(|tube| !self.is_as_wide(&tube, borders)) {
                true => Err(MissReason::PoorFit),
                false => fit.map_err(|miss| miss.reason).and_then(|fit| self.measurement_of(fit, MEASURED_SHAFT_MM)),
            };
            match found {
                Ok(found) if found.grade() >= Grade::Complete => return Ok(found),
                Ok(found) if found.grade() >= Grade::Possible => best = Ok(found),
                Ok(_) => best = best.map_err(|other: MissReason| other.max(MissReason::PoorFit)),
                Err(reason) => best = best.map_err(|other: MissReason| other.max(reason)),
            }
        }
        best
    }

    /// Is the tube about as wide in the picture as its borders? Otherwise its edges are others. They are compared in the
    /// middle of the measured piece: a strip may end with the point of black jaws, and is narrower there.
    fn is_as_wide(&self, tube: &Tube, borders: &Strip) -> bool {
        /// Several times the error of a border, and less than the distance of a highlight from it.
        const MAX_DIFFERENCE: f64 = 0.15;
        let Some(outline) = tube.outline() else { return false };
        let middle = |side| CameraPoint(outline.border(side, 0.5 * MEASURED_SHAFT_MM)).normalised();
        let [Some(one), Some(other)] = BorderSide::BOTH.map(middle) else { return false };
        let (width, at) = ((one.0 - other.0).norm(), nalgebra::center(&one.0, &other.0));
        (width / width_near(borders, at) - 1.0).abs() < MAX_DIFFERENCE
    }

    /// Rough tubes: through the trocar if it is known, with the borders' taper, and facing the camera.
    fn starts_of_strip(&self, strip: &Strip) -> Vec<Tube> {
        let radius = self.radius_mm();
        let depth_mm = 2.0 * radius / strip.width + radius;
        let tip = Point3::from(strip.end.ray() * depth_mm);
        let through_trocar = self.fulcrum.and_then(|fulcrum| {
            let axis = (tip - fulcrum.at).try_normalize(1e-9)?;
            Some(Tube { tip, axis, radius })
        });
        let by_taper = tangent_planes::locate(strip.borders.map(line_through), strip.end, strip.entry, radius);
        let in_picture = (strip.end.ray() - strip.entry.ray()).try_normalize(1e-9);
        let leaning = LEANS_DEG.into_iter().filter_map(|lean_deg: f64| {
            let (sin, cos) = lean_deg.to_radians().sin_cos();
            Some(Tube { tip, axis: in_picture? * cos + strip.end.ray().normalize() * sin, radius })
        });
        let leaning = leaning.map(|tube| Tube { axis: tube.axis.normalize(), ..tube });
        [through_trocar, by_taper].into_iter().flatten().chain(leaning).collect()
    }
}

/// Distance between a strip's borders next to a point.
fn width_near(strip: &Strip, at: Point2<f64>) -> f64 {
    let (end, entry) = (strip.end.0, strip.entry.0);
    let share = ((at - end).dot(&(entry - end)) / (entry - end).norm_squared().max(1e-12)).clamp(0.0, 1.0);
    let [one, other] = strip.borders.map(|[entry, end]| end + (entry - end) * share);
    (one - other).norm()
}

/// The line through both points.
fn line_through([from, to]: [Point2<f64>; 2]) -> BorderLine {
    let along = to - from;
    let normal = Vector2::new(-along.y, along.x).normalize();
    BorderLine { normal, offset: normal.dot(&from.coords) }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::vision::camera::testing::STRAIGHT;
    use crate::vision::frame::{Frame, Plane};
    use crate::vision::space::Pixel;
    use crate::vision::tracker::shaft_fit::ShaftMiss;
    use crate::vision::tracker::testing::{ENCODING, two_bare_tools};
    use crate::vision::tracker::{Tracker, TrackerSettings};

    /// A shaft before an even box, whose end lies beyond the picture's right rim.
    fn shaft() -> Tube {
        Tube { tip: Point3::new(130.0, 4.0, 150.0), axis: Vector3::x(), radius: 2.5 }
    }

    /// Fits a tube to a picture of a shaft before an even box. `luma` is that of a tool's surface at a distance ahead of the
    /// shaft's end (mm) and across its axis (radii).
    fn fit_to(start: &Tube, shaft: &Tube, luma: impl Fn(f64, f64) -> u8) -> Result<Tube, ShaftMiss> {
        const BOX: u8 = 150;
        let (width, height) = (STRAIGHT.width as usize, STRAIGHT.height as usize);
        let outline = shaft.outline().unwrap();
        let codes = |x: usize, y: usize| {
            let ray = STRAIGHT.normalised_of(Pixel::new(x as f64, y as f64)).unwrap().ray();
            if !BorderSide::BOTH.into_iter().all(|side| outline.normal(side).dot(&ray) > 0.0) {
                return BOX;
            }
            // Of a shaft along x, the surface is about this far from the camera.
            let across = (ray.y * shaft.tip.z - shaft.tip.y) / shaft.radius;
            let depth_mm = shaft.tip.z - shaft.radius * (1.0 - across * across).max(0.0).sqrt();
            luma(ray.x * depth_mm - shaft.tip.x, across)
        };
        let luma: Vec<u8> = (0..width * height).map(|i| codes(i % width, i / width)).collect();
        let grey = vec![128; width * height];
        let [y, u, v] = [&luma, &grey, &grey].map(|data| Plane { data, stride: width, width, height });
        let (index, time_s, shift_x, shift_y, chroma_first_px, encoding) = (0, 0.0, 0, 0, [0.0; 2], ENCODING);
        let frame = Frame { index, time_s, y, u, v, shift_x, shift_y, chroma_first_px, encoding };
        let settings = TrackerSettings { camera: STRAIGHT, ..two_bare_tools() };
        let tracker = Tracker::new(settings, STRAIGHT.width, STRAIGHT.height, ENCODING).unwrap();
        let (table, settings) = (&tracker.table, &tracker.settings);
        let scene = FrameContext { frame: &frame, segment: table, table, settings, strips: None, obstacles: &[] };
        let fit = tracker.tools[0].band_fit(&scene, &Prediction::default());
        let fitted = fit.fit_shaft(start, MEASURED_SHAFT_MM, STRIP_PASSES, &mut FitRecorder::new(false));
        fitted.map(|fit| fit.estimate.tube)
    }

    /// Fits a tube to the picture of that shaft, or to that of the empty box.
    fn fit_shaft(start: &Tube, is_there: bool) -> Option<ShaftMiss> {
        fit_to(start, &shaft(), |_, _| if is_there { 30 } else { 150 }).err()
    }

    #[test]
    fn a_shaft_before_steel_with_a_dark_limb_ends_where_its_colour_does() {
        let shaft = Tube { tip: Point3::new(30.0, 4.0, 150.0), ..shaft() };
        let steel = |across: f64| if (-0.2..0.7).contains(&across) { 210 } else { 32 };
        let luma = |ahead: f64, across: f64| match ahead {
            ..0.0 => 30,
            0.0..12.0 => steel(across),
            _ => 150,
        };
        let start = Tube { tip: shaft.tip - Vector3::x() * 2.0, ..shaft };
        let found = fit_to(&start, &shaft, luma).map_err(|miss| miss.reason).unwrap();
        let off_px = (found.tip.x / found.tip.z - shaft.tip.x / shaft.tip.z) * STRAIGHT.fx;
        assert!(off_px.abs() < 2.0, "{off_px} px, {}", found.tip);
    }

    #[test]
    fn a_tube_that_is_seen_along_its_axis_is_none() {
        let towards = Vector3::new(0.15, 0.0, 0.99).normalize();
        let start = Tube { tip: Point3::new(30.0, 4.0, 150.0), axis: towards, radius: 2.5 };
        let shaft = Tube { tip: start.tip, ..shaft() };
        let luma = |ahead: f64, _| if (-8.0..0.0).contains(&ahead) { 30 } else { 150 };
        assert!(fit_to(&start, &shaft, luma).is_err());
    }

    #[test]
    fn a_shaft_whose_end_is_hidden_is_fitted_to_its_borders() {
        let start = Tube { tip: Point3::new(60.0, 4.3, 153.0), ..shaft() };
        let miss = fit_shaft(&start, true).unwrap();
        assert_eq!(miss.reason, MissReason::TipHidden);
        let Tube { tip, axis, .. } = miss.tube.unwrap();
        let off_px = (tip.y / tip.z - shaft().tip.y / shaft().tip.z) * STRAIGHT.fy;
        assert!(off_px.abs() < 0.1 && axis.y.abs() < 0.001, "{off_px} px, {axis}");
        assert!((tip.z - shaft().tip.z).abs() < 4.0, "{tip}: a step of pixels is half a pixel off");
    }

    #[test]
    fn where_no_border_is_there_is_no_shaft_whose_tip_is_hidden() {
        let miss = fit_shaft(&Tube { tip: Point3::new(60.0, 4.0, 150.0), ..shaft() }, false).unwrap();
        assert_eq!((miss.reason, miss.tube), (MissReason::BordersNotFound, None));
    }

    /// Frames without a search after each failed one.
    fn pauses(search: &mut ShaftSearch, is_trocar_known: bool, searches: usize) -> Vec<usize> {
        let mut after_each = Vec::new();
        for _ in 0..searches {
            search.end(Some(MissReason::TipHidden), is_trocar_known);
            after_each.push(std::iter::from_fn(|| search.pausing()).count());
        }
        after_each
    }

    #[test]
    fn searches_without_success_become_rarer_and_a_success_ends_the_pause() {
        let mut search = ShaftSearch::default();
        assert_eq!(search.pausing(), None, "the first frame is searched");
        assert_eq!(pauses(&mut search, true, 4), [1, 2, 2, 2]);
        search.end(None, true);
        assert_eq!(search.pausing(), None);
        assert_eq!(pauses(&mut search, false, 20).last(), Some(&14));
    }
}
