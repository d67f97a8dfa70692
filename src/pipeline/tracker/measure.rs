//! One band on one frame: from a region of the marker's colour to a tube in space with its covariance.

use nalgebra::Point2;

use crate::pipeline::blob::moments::Rectangle;
use crate::pipeline::camera::Camera;
use crate::pipeline::edges::line_fit::{self, Line};
use crate::pipeline::edges::outline_probes::{Place, ProbeLayout, border_probes, rim_probes};
use crate::pipeline::edges::scan_lines::{self, CoarseBand};
use crate::pipeline::edges::subpixel::{EdgeModel, Probe};
use crate::pipeline::frame::Frame;
use crate::pipeline::pose::joint_fit::{self, MeasuredEdge};
use crate::pipeline::pose::{TubeEstimate, pinhole_width, tangent_planes};
use crate::pipeline::reason::Reason;
use crate::pipeline::segmentation::colour_table::ColourTable;
use crate::pipeline::space::{Normalised, Pixel};
use crate::pipeline::tracker::{PoseMethod, ToolSpec};
use crate::pipeline::tube::Tube;

/// What a measurement needs besides the region.
pub struct Bench<'a> {
    /// The frame.
    pub frame: &'a Frame<'a>,
    /// The camera.
    pub camera: &'a Camera,
    /// Colours.
    pub table: &'a ColourTable,
    /// The tool's class in the table.
    pub class: u8,
    /// The tool.
    pub spec: &'a ToolSpec,
    /// How its edges look.
    pub edges: &'a mut EdgeModel,
    /// Pose method.
    pub method: PoseMethod,
}

/// A band measured.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// Tube and covariance.
    pub estimate: TubeEstimate,
    /// Length of band that was seen or is known, mm.
    pub length_mm: f64,
}

/// Looks first wide, then close: the coarse lines may be two pixels off, the first fit is not.
const LOOKS: [ProbeLayout; 2] =
    [ProbeLayout { chord_px: 8.0, reach_px: 7.0 }, ProbeLayout { chord_px: 6.0, reach_px: 5.0 }];

/// Share of the band's length next to each end that border probes leave out, in radii: there the rim bends away.
const END_MARGIN: f64 = 0.35;

impl Bench<'_> {
    /// Measures the band that a region shows; `hand_first` tells whether the back of the region's axis is the hand's side.
    pub fn measure(
        &mut self,
        region: &Rectangle,
        hand_first: impl Fn(Pixel, Pixel) -> bool,
    ) -> Result<Measurement, Reason> {
        let coarse = scan_lines::scan(self.frame, self.table, self.class, region).ok_or(Reason::BordersNotFound)?;
        let lines = self.border_lines(&coarse).ok_or(Reason::BordersNotFound)?;
        let [back, front] = coarse.ends;
        let (distal, proximal) = if hand_first(back, front) { (front, back) } else { (back, front) };
        let sight = |pixel| self.camera.normalised_of(pixel).ok_or(Reason::ImpossiblePose);
        let (distal, proximal) = (sight(distal)?, sight(proximal)?);
        let radius = 0.5 * self.spec.diameter_mm;
        if self.method == PoseMethod::PinholeWidth {
            let tube = pinhole_width::locate(lines, distal, proximal, radius).ok_or(Reason::ImpossiblePose)?;
            return Ok(self.by_width(tube, &coarse));
        }
        let tube = tangent_planes::locate(lines, distal, proximal, radius).ok_or(Reason::ImpossiblePose)?;
        let seen_mm = tangent_planes::back_of(&tube, proximal).ok_or(Reason::ImpossiblePose)?;
        self.refine(tube, seen_mm)
    }

    fn border_lines(&self, coarse: &CoarseBand) -> Option<[Line; 2]> {
        let line = |border: &Vec<Pixel>| {
            let sights: Vec<Point2<f64>> =
                border.iter().filter_map(|p| self.camera.normalised_of(*p)).map(|n: Normalised| n.0).collect();
            line_fit::fit(&sights)
        };
        Some([line(&coarse.borders[0])?, line(&coarse.borders[1])?])
    }

    /// Moves a rough tube onto the edges that the pixels show.
    pub fn refine(&mut self, mut tube: Tube, seen_mm: f64) -> Result<Measurement, Reason> {
        let mut estimate = None;
        for layout in LOOKS {
            let edges = self.edges_along(&tube, seen_mm, layout)?;
            let fitted = joint_fit::fit(&edges, &tube, self.camera).ok_or(Reason::BordersNotFound)?;
            tube = fitted.tube;
            estimate = Some(fitted);
        }
        let estimate = estimate.ok_or(Reason::BordersNotFound)?;
        Ok(Measurement { estimate, length_mm: self.spec.band_length_mm.unwrap_or(seen_mm) })
    }

    fn edges_along(&mut self, tube: &Tube, seen_mm: f64, layout: ProbeLayout) -> Result<Vec<MeasuredEdge>, Reason> {
        let outline = tube.outline().ok_or(Reason::ImpossiblePose)?;
        let length_mm = self.spec.band_length_mm.unwrap_or(seen_mm);
        let margin = END_MARGIN * tube.radius;
        let mut probes: Vec<(Place, Probe)> = Vec::new();
        border_probes(&outline, self.camera, margin, length_mm - margin, layout, &mut probes);
        rim_probes(&outline, self.camera, 0.0, 0.5 * length_mm, layout, &mut probes);
        if self.spec.band_length_mm.is_some() {
            rim_probes(&outline, self.camera, length_mm, 0.5 * length_mm, layout, &mut probes);
        }
        let (frame, camera, model) = (self.frame, self.camera, &mut *self.edges);
        Ok(probes
            .iter()
            .filter_map(|(place, probe)| {
                let edge = model.locate(frame, probe)?;
                let at = Pixel(probe.middle.0 + probe.outward * edge.offset_px);
                MeasuredEdge::new(*place, at, probe.outward, edge.sigma_px, camera)
            })
            .collect())
    }

    /// The width's own covariance: whole-pixel borders, each uncertain by a third of a pixel.
    fn by_width(&self, tube: Tube, coarse: &CoarseBand) -> Measurement {
        let sigma_px = 0.33;
        let across = tube.tip.z * sigma_px / self.camera.fx;
        let depth = tube.tip.z * sigma_px * std::f64::consts::SQRT_2 / coarse.width_px;
        let spread = [across * across, across * across, depth * depth, 0.1, 0.1];
        let covariance = nalgebra::Matrix5::from_diagonal(&spread.into());
        Measurement { estimate: TubeEstimate { tube, covariance, residual_px: sigma_px }, length_mm: 0.0 }
    }
}
