//! Fits a bare tube up to its end: at its rim, or where its full width or its colour ends.
//!
//! A shaft that turns into steel or into the box has an edge along its whole rim. Jaws in its own colour leave only
//! pieces of one, and have edges of their own. A tip on such an edge would be a centimetre off and look right.

use nalgebra::Point2;

use super::band_fit::BandFit;
use super::frame_context::FrameContext;
use super::probe_pass::{FINE_PASSES, FoundEdges, ProbePass};
use super::refine::PassFit;
use super::trace::FitRecorder;
use crate::vision::camera::Camera;
use crate::vision::edges::outline_probes::OutlinePoint;
use crate::vision::edges::shaft_colour_end;
use crate::vision::edges::shaft_end::{self, ShaftEnd};
use crate::vision::edges::shaft_rows::{self, ShaftRow};
use crate::vision::pose::joint_fit::{END_OFFSET_PX, MeasuredEdge};
use crate::vision::reason::MissReason;
use crate::vision::space::{CameraPoint, Pixel};
use crate::vision::strip::finder::FrameStrips;
use crate::vision::tube::{BorderSide, Outline, OutlinePart, Tube};

/// A shaft that was not measured.
pub(super) struct ShaftMiss {
    pub(super) reason: MissReason,
    /// The tube that its borders show, where only its end is hidden.
    pub(super) tube: Option<Tube>,
}

/// A fitted tube whose end shows.
struct FitWithEnd {
    fit: PassFit,
    /// Where the end is seen, mm behind that of the tube: 0, or at the end of its collar.
    end_mm: f64,
}

impl FitWithEnd {
    /// The end of the tube itself is seen.
    fn of_tube(fit: PassFit) -> Self {
        Self { fit, end_mm: 0.0 }
    }
}

impl From<MissReason> for ShaftMiss {
    fn from(reason: MissReason) -> Self {
        Self { reason, tube: None }
    }
}

/// Rows across the shaft are read from this far behind the assumed tip to that far ahead, mm: the strip may end with
/// the point of closed jaws, and a tip that was false may lie behind the end.
const ROWS_MM: [f64; 2] = [70.0, -35.0];
/// Rows across the width of a shaft: their distance is a twentieth of it, and from one pixel to two and a half.
const ROWS_PER_WIDTH: f64 = 20.0;
const ROWS_PX: (f64, f64) = (1.0, 2.5);

/// Largest distance of an edge on the tube, pixels: a few times the error of an edge.
const NEAR_PX: f64 = 1.0;

/// Places ahead of the end, diameters: on the hinge, before jaws that may be open.
const AHEAD_DIAMETERS: [f64; 3] = [0.1, 0.3, 0.5];

/// Least number of places in the picture that decide what lies there.
const MIN_PLACES: usize = 6;

impl BandFit<'_> {
    /// Fits a bare tube. Its end shows as its rim, or as the end of its full width or of its colour.
    pub(super) fn fit_shaft(
        &self,
        start: &Tube,
        length_mm: f64,
        passes: &[ProbePass],
        recorder: &mut FitRecorder,
    ) -> Result<PassFit, ShaftMiss> {
        let fit = match self.fit_passes(start, length_mm, passes, recorder) {
            Ok(fit) if self.is_end_of_tube(&fit) => Ok(FitWithEnd::of_tube(fit)),
            Ok(fit) => self.fit_end(&fit.estimate.tube, length_mm, recorder),
            Err(MissReason::TipHidden) => self.fit_end(start, length_mm, recorder),
            Err(reason) => Err(reason.into()),
        };
        let FitWithEnd { fit, end_mm } = fit?;
        let tube = fit.estimate.tube;
        if !self.shows_borders(&fit) || !self.is_long_in_picture(&tube, length_mm) {
            return Err(MissReason::PoorFit.into());
        }
        if self.is_end_covered(&tube, end_mm) || self.is_end_behind_box(&tube, end_mm) {
            return Err(ShaftMiss { reason: MissReason::TipHidden, tube: Some(tube) });
        }
        Ok(fit)
    }

    /// Does a thing lie across the end, this far behind the tube's (mm)? It is wider than the tool: beside the place ahead of
    /// the end, the box hardly shows on either side. What may be the box in shade is a thing, too, if no hinge shows.
    fn is_end_covered(&self, tube: &Tube, end_mm: f64) -> bool {
        let is_hidden = |shows: fn(&FrameStrips<'_>, Pixel) -> Option<bool>| self.is_box_hidden(tube, end_mm, shows);
        is_hidden(|strips, at| strips.shows_box(at))
            || (is_hidden(|strips, at| strips.shows_lit_box(at)) && !self.shows_hinge(tube, end_mm))
    }

    /// Does the box hardly show beside the place ahead of an end, on either side?
    fn is_box_hidden(&self, tube: &Tube, end_mm: f64, shows: impl Fn(&FrameStrips<'_>, Pixel) -> Option<bool>) -> bool {
        /// Distances from the axis, radii.
        const BESIDE_RADII: [f64; 2] = [1.5, 1.9];
        let (Some(strips), Some(outline)) = (self.scene.strips, tube.outline()) else { return false };
        let mut hidden: Vec<bool> = Vec::new();
        for diameters in AHEAD_DIAMETERS {
            let Some([one, other]) = self.borders_px(&outline, end_mm - diameters * self.spec.diameter_mm) else {
                continue;
            };
            let (middle, half) = (nalgebra::center(&one, &other), (one - other) * 0.5);
            let beside = BESIDE_RADII.into_iter().flat_map(|radii| [middle + half * radii, middle - half * radii]);
            hidden.extend(beside.filter_map(|at| Some(!shows(strips, Pixel(at))?)));
        }
        is_mostly(&hidden, 2.0 / 3.0)
    }

    /// Is the measured piece long in the picture? Seen nearly along its axis, a tube shows neither its lean nor that it is
    /// one: closed jaws are as long.
    fn is_long_in_picture(&self, tube: &Tube, length_mm: f64) -> bool {
        /// Least length, widths: twelve degrees between the line of sight and a 5 mm tool (METHOD 3.6).
        const MIN_WIDTHS: f64 = 2.5;
        let Some(outline) = tube.outline() else { return false };
        let ends = self.borders_px(&outline, 0.0).zip(self.borders_px(&outline, length_mm));
        ends.is_none_or(|([one, other], [far, _])| (far - one).norm() >= MIN_WIDTHS * (other - one).norm())
    }

    /// Where both borders are in the picture, this far behind the tip, pixels.
    fn borders_px(&self, outline: &Outline, back_mm: f64) -> Option<[Point2<f64>; 2]> {
        let [one, other] =
            BorderSide::BOTH.map(|side| self.camera().project(CameraPoint(outline.border(side, back_mm))));
        Some([one?.0, other?.0])
    }

    /// Do enough edges confirm each border? They may lie farther from it the more they are smeared.
    fn shows_borders(&self, fit: &PassFit) -> bool {
        let near_px = NEAR_PX + self.smear_px();
        let outline = fit.estimate.tube.outline();
        outline.is_some_and(|outline| are_confirmed(&fit.found.edges, &outline, self.camera(), near_px))
    }

    /// Does the end of the tube show all across?
    fn shows_rim(&self, fit: &PassFit) -> bool {
        /// Share of the rim in sight whose edge lies on it. The median over a tool's frames was 0.67 to 1 for steel
        /// jaws, and 0.18 to 0.33 for black ones, in the even of 22 ray-traced recordings.
        const MIN_SHARE: f64 = 0.6;
        let Some(outline) = fit.estimate.tube.outline() else { return false };
        let rim = OutlinePart::DistalEnd;
        let on_rim = count_near(&fit.found.edges, rim, &outline, self.camera(), NEAR_PX) as f64;
        on_rim >= MIN_SHARE * fit.found.visible[rim]
    }

    /// Does the tool's tube end where the fitted one does? Its end shows all across, or the end of the full width and
    /// that of the colour agree with it. A collar has a rim, too, so neither may contradict, and the shaft must have its
    /// colour up to the end. That may also be the colour of a black collar.
    fn is_end_of_tube(&self, fit: &PassFit) -> bool {
        let Some(rows) = self.rows_across(&fit.estimate.tube) else { return false };
        let full_width = self.locate_end(&rows).map(|end| self.is_near(end.back_mm));
        let colour = self.locate_colour_end(&rows);
        let is_colours = colour.map(|back_mm| self.is_near(back_mm) || self.is_near(back_mm + self.spec.collar_mm()));
        let agree = full_width == Some(true) && colour.is_some_and(|back_mm| self.is_near(back_mm));
        (agree || self.shows_rim(fit))
            && full_width.unwrap_or(true)
            && is_colours.unwrap_or(true)
            && shaft_colour_end::reaches(&rows, self.spec.diameter_mm, 0.0)
    }

    /// Is this distance of two ends less than a collar's length?
    fn is_near(&self, back_mm: f64) -> bool {
        const MAX_APART_DIAMETERS: f64 = 0.4;
        back_mm.abs() < MAX_APART_DIAMETERS * self.spec.diameter_mm
    }

    /// Fits a tube whose end is not where the start assumes it. The tube is first moved to its borders, if enough of
    /// them shows: only there are its rows those of the shaft.
    fn fit_end(&self, start: &Tube, length_mm: f64, recorder: &mut FitRecorder) -> Result<FitWithEnd, ShaftMiss> {
        let moved = self.fit_axis(start, length_mm, FINE_PASSES, recorder).map(|(tube, _)| tube);
        let tube = moved.unwrap_or(*start);
        let rows = self.rows_across(&tube).unwrap_or_default();
        if let Some(fit) = self.fit_colour_end(tube, &rows, length_mm, recorder) {
            return Ok(FitWithEnd::of_tube(fit));
        }
        if let Some(end) = self.locate_end(&rows) {
            let fit = self.fit_located(tube, end, |rows| self.locate_end(rows), length_mm, recorder)?;
            let rows = self.rows_across(&fit.estimate.tube).unwrap_or_default();
            let shows_tubes_end = shaft_colour_end::changes(&rows, self.spec.diameter_mm);
            let end_mm = if shows_tubes_end { 0.0 } else { -self.spec.collar_mm() };
            return Ok(FitWithEnd { fit, end_mm });
        }
        let colour_end = |rows: &[ShaftRow]| self.locate_colour_end_alone(rows);
        match (colour_end(&rows).filter(|end| self.shows_jaws(&tube, end.back_mm)), moved) {
            (Some(end), _) => {
                let fit = self.fit_located(tube, end, colour_end, length_mm, recorder)?;
                let tube = fit.estimate.tube;
                let hidden = ShaftMiss { reason: MissReason::TipHidden, tube: Some(tube) };
                if self.shows_jaws(&tube, 0.0) { Ok(FitWithEnd::of_tube(fit)) } else { Err(hidden) }
            }
            (None, Some(tube)) => Err(ShaftMiss { reason: MissReason::TipHidden, tube: Some(tube) }),
            (None, None) => Err(MissReason::BordersNotFound.into()),
        }
    }

    /// Fits a tube whose rim is where its colour ends. The fitted tube must show that end, too. The colour may be that
    /// of a black collar, so with a collar the end of the full width must agree.
    fn fit_colour_end(
        &self,
        mut tube: Tube,
        rows: &[ShaftRow],
        length_mm: f64,
        recorder: &mut FitRecorder,
    ) -> Option<PassFit> {
        tube.tip -= tube.axis * self.locate_colour_end(rows)?;
        let fit = self.fit_passes(&tube, length_mm, FINE_PASSES, recorder).ok()?;
        let rows = self.rows_across(&fit.estimate.tube)?;
        let back_mm = self.locate_colour_end(&rows).filter(|back_mm| self.is_near(*back_mm))?;
        let agrees = match self.locate_end(&rows) {
            Some(end) => self.is_near(end.back_mm),
            None => self.is_colour_of_tube(&rows, back_mm),
        };
        (agrees && self.shows_rim(&fit)).then_some(fit)
    }

    /// Where the colour ends, if the full width shows no end.
    fn locate_colour_end_alone(&self, rows: &[ShaftRow]) -> Option<ShaftEnd> {
        /// Standard deviation, mm: 0.3 to 0.5 mm in eight of the even of 42 ray-traced recordings.
        const SIGMA_MM: f64 = 0.5;
        let back_mm = self.locate_colour_end(rows)?;
        let is_alone = self.locate_end(rows).is_none() && self.is_colour_of_tube(rows, back_mm);
        is_alone.then_some(ShaftEnd { back_mm, sigma_mm: SIGMA_MM })
    }

    /// Do jaws show ahead of a place, this far behind the tip (mm)? If the box shows instead, lit or in shade, it may be what
    /// is seen between open black jaws.
    fn shows_jaws(&self, tube: &Tube, back_mm: f64) -> bool {
        let shown = self.seen_about(tube, back_mm, &AHEAD_DIAMETERS, |strips, [_, ahead]| strips.shows_box(ahead));
        !(self.spec.has_jaws() && is_mostly(&shown, 1.0 / 3.0))
    }

    /// Does a hinge show ahead of an end? A rod without jaws has none.
    fn shows_hinge(&self, tube: &Tube, end_mm: f64) -> bool {
        let is_seen = |rows: &[ShaftRow]| shaft_end::shows_hinge(rows, self.spec.diameter_mm, end_mm);
        !self.spec.has_jaws() || self.rows_across(tube).is_none_or(|rows| is_seen(&rows))
    }

    /// Does a part of the box lie before the end, such as a peg? The box shows where the jaws must be, and either a given
    /// collar does not show there, or the box changes at the end also without the tool. Steel may look like the box, but
    /// hardly where the box changes.
    fn is_end_behind_box(&self, tube: &Tube, end_mm: f64) -> bool {
        /// Of the places: light on the box changes.
        const MIN_SHOWN: f64 = 2.0 / 3.0;
        /// Of the places: the part's edge may lie askew.
        const MIN_CHANGED: f64 = 0.5;
        let shown = self.seen_about(tube, end_mm, &AHEAD_DIAMETERS, |strips, [_, ahead]| strips.shows_lit_box(ahead));
        let changed = || {
            // Those next to the end lie in neighbouring cells, which show both sides of it.
            let [_, apart @ ..] = &AHEAD_DIAMETERS;
            self.seen_about(tube, end_mm, apart, |strips, [behind, ahead]| strips.box_changes(behind, ahead))
        };
        // Ahead of the tube's own end a given collar must show.
        let collar_mm = self.spec.collar_mm() + end_mm;
        let shows_collar = || {
            let rows = self.rows_across(tube).unwrap_or_default();
            shaft_colour_end::shows_collar(&rows, collar_mm, 0.0)
        };
        let is_possible = self.spec.has_jaws() && is_mostly(&shown, MIN_SHOWN);
        is_possible && if collar_mm > 0.0 { !shows_collar() } else { is_mostly(&changed(), MIN_CHANGED) }
    }

    /// What pairs of places show, so many diameters behind and ahead of a place this far behind the tip (mm). Those ahead
    /// lie on the jaws.
    fn seen_about(
        &self,
        tube: &Tube,
        back_mm: f64,
        apart_diameters: &[f64],
        shows: impl Fn(&FrameStrips<'_>, [Pixel; 2]) -> Option<bool>,
    ) -> Vec<bool> {
        let (Some(strips), Some(outline)) = (self.scene.strips, tube.outline()) else { return Vec::new() };
        let places = apart_diameters.iter().flat_map(|apart| [-0.3, 0.0, 0.3].map(|across| (*apart, across)));
        let pairs = places.filter_map(|(ahead, across)| {
            let ahead_mm = ahead * self.spec.diameter_mm;
            let pixel = |back_mm| self.camera().project(CameraPoint(outline.rim(back_mm, across)));
            Some([pixel(back_mm + ahead_mm)?, pixel(back_mm - ahead_mm)?])
        });
        pairs.filter_map(|pair| shows(strips, pair)).collect()
    }

    /// Does the colour that ends here belong to the tube and not to its collar?
    fn is_colour_of_tube(&self, rows: &[ShaftRow], back_mm: f64) -> bool {
        let collar_mm = self.spec.collar_mm();
        collar_mm == 0.0 || shaft_colour_end::shows_collar(rows, collar_mm, back_mm)
    }

    /// Fits a tube that ends where its rows show it, less its collar.
    fn fit_located(
        &self,
        mut tube: Tube,
        first: ShaftEnd,
        locate: impl Fn(&[ShaftRow]) -> Option<ShaftEnd>,
        length_mm: f64,
        recorder: &mut FitRecorder,
    ) -> Result<PassFit, ShaftMiss> {
        let mut first = Some(first);
        let mut last = Err(MissReason::TipHidden.into());
        for pass in FINE_PASSES {
            let located = first.take().or_else(|| locate(&self.rows_across(&tube)?));
            let end = located.ok_or(ShaftMiss { reason: MissReason::TipHidden, tube: Some(tube) })?;
            tube.tip -= tube.axis * end.back_mm;
            let mut found = self.edges_along(&tube, length_mm, *pass, recorder)?;
            self.use_end(&tube, &end, &mut found).ok_or(MissReason::PoorFit)?;
            let fit = self.fit_edges(found, &tube, length_mm, pass.fineness, recorder)?;
            tube = fit.estimate.tube;
            last = Ok(fit);
        }
        last
    }

    /// Rows across a tube.
    fn rows_across(&self, tube: &Tube) -> Option<Vec<ShaftRow>> {
        let outline = tube.outline()?;
        let step_px = (2.0 * tube.radius * self.px_per_mm_across(tube) / ROWS_PER_WIDTH).clamp(ROWS_PX.0, ROWS_PX.1);
        let obstacles = self.scene.obstacles_before(&outline, ROWS_MM);
        let scene = FrameContext { obstacles: &obstacles, ..*self.scene };
        let is_visible = |place, at| scene.is_visible(place, at);
        Some(shaft_rows::read(self.scene.frame, self.camera(), &outline, ROWS_MM, step_px, is_visible))
    }

    /// Where the full width ends, less the collar. A tool whose collar is not given may have one of steel.
    fn locate_end(&self, rows: &[ShaftRow]) -> Option<ShaftEnd> {
        let (diameter_mm, collar_mm) = (self.spec.diameter_mm, self.spec.collar_mm());
        let end = shaft_end::locate(self.edges, rows, diameter_mm, collar_mm)?;
        (collar_mm > 0.0 || shaft_colour_end::reaches(rows, diameter_mm, end.back_mm)).then_some(end)
    }

    fn locate_colour_end(&self, rows: &[ShaftRow]) -> Option<f64> {
        shaft_colour_end::locate(rows, self.spec.diameter_mm)
    }

    /// Replaces the edges of a tube's rim by the end of its full width, where the tube's tip is.
    fn use_end(&self, tube: &Tube, end: &ShaftEnd, found: &mut FoundEdges) -> Option<()> {
        /// Where both borders show the end, across the near half: 0.86 radii from the middle.
        const ACROSS: [f64; 2] = [-0.66, 0.66];
        /// Standard deviation of the end at one border alone, pixels.
        const SIGMA_PX: f64 = 0.3;
        let outline = tube.outline()?;
        let px_per_mm = shaft_rows::mm_per_px(self.camera(), &outline)?.recip();
        let pixel = |back_mm, across| self.camera().project(CameraPoint(outline.rim(back_mm, across)));
        let mut edges = Vec::new();
        for across in ACROSS {
            let at = pixel(0.0, across)?.0;
            let outward = (at - pixel(1.0, across)?.0).try_normalize(1e-9)?;
            let place = OutlinePoint::Rim { back_mm: 0.0, across };
            let at = Pixel(at + outward * END_OFFSET_PX);
            edges.push(MeasuredEdge::new(place, at, outward, SIGMA_PX, self.camera())?);
        }
        found.replace_distal_end(edges, end.sigma_mm * px_per_mm);
        Some(())
    }
}

/// Is more than this share of what places show true? Too few of them decide nothing.
fn is_mostly(shown: &[bool], share: f64) -> bool {
    let count = shown.iter().filter(|shows| **shows).count() as f64;
    shown.len() >= MIN_PLACES && count > share * shown.len() as f64
}

/// Do enough edges confirm each border of a tube? Some line passes through any two edges. A border with no more says
/// nothing about the lean, and many edges on the other border and at the end do not make up for that.
fn are_confirmed(edges: &[MeasuredEdge], outline: &Outline, camera: &Camera, near_px: f64) -> bool {
    /// One more than a line has unknowns. With fewer, 10 of 16 tubes were false in 19 ray-traced recordings, and 27 of
    /// 568 with more.
    const MIN_EDGES: usize = 3;
    let count = |side| count_near(edges, OutlinePart::Border(side), outline, camera, near_px);
    BorderSide::BOTH.into_iter().all(|side| count(side) >= MIN_EDGES)
}

/// Number of a part's edges that lie as near to an outline.
fn count_near(edges: &[MeasuredEdge], part: OutlinePart, outline: &Outline, camera: &Camera, near_px: f64) -> usize {
    let is_near = |edge: &MeasuredEdge| edge.residual_px(outline, camera).is_some_and(|px| px.abs() < near_px);
    edges.iter().filter(|edge| edge.point.part() == part && is_near(edge)).count()
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;
    use crate::vision::camera::testing::STRAIGHT as CAMERA;
    use crate::vision::frame::{Frame, Plane};
    use crate::vision::segmentation::cells::CellPicture;
    use crate::vision::segmentation::shaft_colour::ShaftColour;
    use crate::vision::strip::finder::{BareTool, SearchTurn, StripFinder};
    use crate::vision::tracker::predict::Prediction;
    use crate::vision::tracker::testing::{ENCODING, two_bare_tools};
    use crate::vision::tracker::{Marker, Tracker, TrackerSettings};

    /// Edges on both borders of a tube at these distances behind its tip.
    fn border_edges(tube: &Tube, backs_mm: &[f64]) -> Vec<MeasuredEdge> {
        let outline = tube.outline().unwrap();
        let edge = |side: BorderSide, back_mm: f64| {
            let [at, opposite] =
                [side, side.opposite()].map(|side| CAMERA.project(CameraPoint(outline.border(side, back_mm))).unwrap());
            let outward = (at.0 - opposite.0).normalize();
            MeasuredEdge::new(OutlinePoint::Border { side, back_mm }, at, outward, 0.1, &CAMERA).unwrap()
        };
        BorderSide::BOTH.into_iter().flat_map(|side| backs_mm.iter().map(move |back| edge(side, *back))).collect()
    }

    /// A frame of the camera's size with these codes of luma and of chroma.
    fn frame_of<'a>([luma, chroma]: [&'a [u8]; 2]) -> Frame<'a> {
        let (width, height) = (CAMERA.width as usize, CAMERA.height as usize);
        let [y, u, v] = [luma, chroma, chroma].map(|data| Plane { data, stride: width, width, height });
        let (index, time_s, shift_x, shift_y, chroma_first_px, encoding) = (0, 0.0, 0, 0, [0.0; 2], ENCODING);
        Frame { index, time_s, y, u, v, shift_x, shift_y, chroma_first_px, encoding }
    }

    /// Is the end of a tube before an even mat covered, if a ring of this radius (mm) and luma lies about it?
    fn is_covered_by_ring(radius_mm: f64, ring: u8) -> bool {
        let tip_px = CAMERA.project(CameraPoint(tube().tip)).unwrap().0;
        let radius_px = radius_mm * CAMERA.fx / tube().tip.z;
        let is_ring = |at: Point2<f64>| nalgebra::distance(&at, &tip_px) < radius_px;
        let jaws = jaws_of(230);
        let luma = |at| if is_ring(at) { ring } else { jaws(at) };
        with_fit(&two_bare_tools(), luma, |fit| fit.is_end_covered(&tube(), 0.0))
    }

    /// A tube before an even mat.
    fn tube() -> Tube {
        Tube { tip: Point3::new(0.0, 0.0, 150.0), axis: Vector3::x(), radius: 2.5 }
    }

    /// Luma of the mat.
    const MAT: u8 = 150;

    /// Asks the fit of a frame with this luma at a pixel, before an even mat.
    fn with_fit(
        settings: &TrackerSettings,
        luma: impl Fn(Point2<f64>) -> u8,
        ask: impl Fn(&BandFit<'_>) -> bool,
    ) -> bool {
        with_box(settings, |_| MAT, luma, ask)
    }

    /// Asks the fit of a frame, with the luma of the empty box and of the frame at a pixel.
    fn with_box(
        settings: &TrackerSettings,
        empty: impl Fn(Point2<f64>) -> u8,
        luma: impl Fn(Point2<f64>) -> u8,
        ask: impl Fn(&BandFit<'_>) -> bool,
    ) -> bool {
        let (width, height) = (CAMERA.width as usize, CAMERA.height as usize);
        let at = |i: usize| Point2::new((i % width) as f64, (i / width) as f64);
        let empty: Vec<u8> = (0..width * height).map(|i| empty(at(i))).collect();
        let luma: Vec<u8> = (0..width * height).map(|i| luma(at(i))).collect();
        let grey = vec![128; width * height];
        let shaft = ShaftColour::new(&[[30, 128, 128]]).unwrap();
        let tools = [BareTool { side: None, diameter_mm: 5.0 }];
        let finder =
            StripFinder::learn(&CAMERA, shaft, &tools, &[CellPicture::of(&frame_of([&empty, &grey]))], None).unwrap();
        let frame = frame_of([&luma, &grey]);
        let strips = FrameStrips::new(&finder, &frame, SearchTurn::All);
        let settings = TrackerSettings { camera: CAMERA, ..settings.clone() };
        let tracker = Tracker::new(settings, CAMERA.width, CAMERA.height, ENCODING).unwrap();
        let (table, settings) = (&tracker.table, &tracker.settings);
        let scene =
            FrameContext { frame: &frame, segment: table, table, settings, strips: Some(&strips), obstacles: &[] };
        ask(&tracker.tools[0].band_fit(&scene, &Prediction::default()))
    }

    #[test]
    fn a_thing_wider_than_the_tool_covers_its_end() {
        for luma in [220, MAT - 40] {
            assert!(is_covered_by_ring(8.0, luma), "luma {luma}, which may be that of the mat in shade");
            assert!(!is_covered_by_ring(2.5, luma), "no wider than the tool");
        }
    }

    /// Jaws of this luma ahead of the tube, as wide as it.
    fn jaws_of(luma: u8) -> impl Fn(Point2<f64>) -> u8 {
        let tip_px = CAMERA.project(CameraPoint(tube().tip)).unwrap().0;
        let radius_px = tube().radius * CAMERA.fx / tube().tip.z;
        let is_there = move |at: Point2<f64>| at.x > tip_px.x && (at.y - tip_px.y).abs() < radius_px;
        move |at| if is_there(at) { luma } else { MAT }
    }

    #[test]
    fn an_end_where_the_box_begins_lies_behind_it_unless_it_is_a_rods() {
        let is_behind_box = |fit: &BandFit<'_>| fit.is_end_behind_box(&tube(), 0.0);
        let tip_u = CAMERA.project(CameraPoint(tube().tip)).unwrap().u();
        let block = |at: Point2<f64>| if at.x > tip_u { 190 } else { MAT };
        let jaws = |luma: u8| {
            let jaws = jaws_of(luma);
            move |at: Point2<f64>| if jaws(at) == MAT { block(at) } else { luma }
        };
        assert!(with_box(&two_bare_tools(), block, block, is_behind_box));
        for luma in [40, 120, 240] {
            assert!(!with_box(&two_bare_tools(), block, jaws(luma), is_behind_box), "jaws of luma {luma}");
        }
        assert!(!with_fit(&two_bare_tools(), jaws_of(MAT), is_behind_box), "steel mirrors an even mat");
        let mut rods = two_bare_tools();
        for tool in &mut rods.tools {
            tool.marker = Marker::Shaft { collar_mm: None, jaw_mm: Some(0.0) };
        }
        assert!(!with_box(&rods, block, block, is_behind_box));
    }

    #[test]
    fn jaws_show_unless_the_box_does_in_places() {
        let shows_jaws = |fit: &BandFit<'_>| fit.shows_jaws(&tube(), 0.0);
        assert!(with_fit(&two_bare_tools(), jaws_of(230), shows_jaws));
        assert!(!with_fit(&two_bare_tools(), jaws_of(MAT - 40), shows_jaws), "the mat in shade");
    }

    #[test]
    fn two_edges_confirm_no_border() {
        let tube = Tube { tip: Point3::new(10.0, 0.0, 180.0), axis: Vector3::new(0.8, 0.0, 0.6), radius: 2.5 };
        let outline = tube.outline().unwrap();
        let three = border_edges(&tube, &[10.0, 30.0, 50.0]);
        assert!(are_confirmed(&three, &outline, &CAMERA, NEAR_PX));
        assert!(!are_confirmed(&three[1..], &outline, &CAMERA, NEAR_PX), "two on one border");
        let aside = Tube { tip: tube.tip + Vector3::y(), ..tube }.outline().unwrap();
        assert!(!are_confirmed(&three, &aside, &CAMERA, NEAR_PX), "they lie on another tube");
    }
}
