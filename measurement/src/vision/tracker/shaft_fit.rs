//! Fits a bare tube up to its end: at its rim, or where its full width ends.
//!
//! A shaft that turns into steel or into the box has an edge along its whole rim. Jaws in its own colour leave only
//! pieces of one, and have edges of their own. A tip on such an edge would be a centimetre off and look right.

use super::band_fit::BandFit;
use super::probe_pass::{FINE_PASSES, FoundEdges, ProbePass};
use super::refine::PassFit;
use super::trace::FitRecorder;
use crate::vision::camera::Camera;
use crate::vision::edges::outline_probes::OutlinePoint;
use crate::vision::edges::shaft_end::{self, ShaftEnd};
use crate::vision::edges::shaft_rows;
use crate::vision::pose::joint_fit::{END_OFFSET_PX, MeasuredEdge};
use crate::vision::reason::MissReason;
use crate::vision::space::{CameraPoint, Pixel};
use crate::vision::tube::{BorderSide, Outline, OutlinePart, Tube};

/// A shaft that was not measured.
pub(super) struct ShaftMiss {
    pub(super) reason: MissReason,
    /// The tube that its borders show, where only its end is hidden.
    pub(super) tube: Option<Tube>,
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

impl BandFit<'_> {
    /// Fits a bare tube, whose end may be its rim or the end of its full width.
    pub(super) fn fit_shaft(
        &self,
        start: &Tube,
        length_mm: f64,
        passes: &[ProbePass],
        recorder: &mut FitRecorder,
    ) -> Result<PassFit, ShaftMiss> {
        let fit = match self.fit_passes(start, length_mm, passes, recorder) {
            Ok(fit) if self.shows_rim(&fit) && self.is_rim_of_tube(&fit.estimate.tube) => Ok(fit),
            Ok(fit) => self.fit_full_width(&fit.estimate.tube, length_mm, recorder),
            Err(MissReason::TipHidden) => self.fit_full_width(start, length_mm, recorder),
            Err(reason) => Err(reason.into()),
        };
        fit.and_then(|fit| if self.shows_borders(&fit) { Ok(fit) } else { Err(MissReason::PoorFit.into()) })
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

    /// Is the rim that of the tube, not of its collar? A collar has a rim, too, so the end of the full width must not
    /// contradict.
    fn is_rim_of_tube(&self, tube: &Tube) -> bool {
        /// Largest distance of both ends, diameters: a collar is longer.
        const MAX_APART_DIAMETERS: f64 = 0.4;
        let is_near = |end: ShaftEnd| end.back_mm.abs() < MAX_APART_DIAMETERS * self.spec.diameter_mm;
        self.spec.collar_mm() == 0.0 || self.locate_end(tube).is_none_or(is_near)
    }

    /// Fits a tube that ends where its full width does, less its collar. Before the end is sought, the tube is moved to
    /// its borders, if enough of them shows: only there are its rows those of the shaft.
    fn fit_full_width(&self, start: &Tube, length_mm: f64, recorder: &mut FitRecorder) -> Result<PassFit, ShaftMiss> {
        let moved = self.fit_axis(start, length_mm, FINE_PASSES, recorder).map(|(tube, _)| tube);
        let mut tube = moved.unwrap_or(*start);
        let mut last = Err(MissReason::TipHidden.into());
        for pass in FINE_PASSES {
            let end = self.locate_end(&tube).ok_or_else(|| match moved {
                Some(_) => ShaftMiss { reason: MissReason::TipHidden, tube: Some(tube) },
                None => MissReason::BordersNotFound.into(),
            })?;
            tube.tip -= tube.axis * end.back_mm;
            let mut found = self.edges_along(&tube, length_mm, *pass, recorder)?;
            self.use_end(&tube, &end, &mut found).ok_or(MissReason::PoorFit)?;
            let fit = self.fit_edges(found, &tube, length_mm, pass.fineness, recorder)?;
            tube = fit.estimate.tube;
            last = Ok(fit);
        }
        last
    }

    fn locate_end(&self, tube: &Tube) -> Option<ShaftEnd> {
        let outline = tube.outline()?;
        let step_px = (2.0 * tube.radius * self.px_per_mm_across(tube) / ROWS_PER_WIDTH).clamp(ROWS_PX.0, ROWS_PX.1);
        let is_visible = |place, at| self.scene.is_visible(place, at);
        let rows = shaft_rows::read(self.scene.frame, self.camera(), &outline, ROWS_MM, step_px, is_visible);
        shaft_end::locate(self.edges, &rows, self.spec.diameter_mm, self.spec.collar_mm())
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
