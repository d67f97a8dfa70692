//! The pictures of one frame: cells with a tool's colour, edges found by the probes, and the result.

use nalgebra::Vector2;

use super::canvas::{Canvas, FrameCrop, Ink};
use crate::vision::camera::Camera;
use crate::vision::edges::probe::Probe;
use crate::vision::frame::Frame;
use crate::vision::segmentation::region_of_interest::{CELL_PX, CellBox};
use crate::vision::space::{CameraPoint, Pixel};
use crate::vision::tracker::{
    FitTrace, FrameReport, FrameTrace, ProbePassTrace, ToolReport, ToolTrace, TrackerSettings,
};
use crate::vision::tube::{BorderSide, Tube};

const WHITE: Ink = Ink::new(255, 255, 255);
const BLACK: Ink = Ink::new(0, 0, 0);
const GREY: Ink = Ink::new(150, 150, 150);
const RED: Ink = Ink::new(255, 60, 60);
const GREEN: Ink = Ink::new(70, 230, 70);
const BLUE: Ink = Ink::new(90, 150, 255);
const DARK_BLUE: Ink = Ink::new(50, 80, 170);
const YELLOW: Ink = Ink::new(255, 230, 0);

/// Colours of the tools, in order and repeated: colours that a tape is unlikely to have.
const TOOLS: [Ink; 4] = [Ink::new(255, 40, 255), Ink::new(170, 255, 0), Ink::new(0, 255, 255), Ink::new(255, 140, 0)];

/// An edge within this distance of the fitted outline agrees with it, pixels. The tracker rejects tubes whose edges are
/// farther off on average.
const MAX_EDGE_DISTANCE_PX: f64 = 0.7;

/// Length of the shaft drawn behind the tip, mm.
const SHAFT_MM: f64 = 60.0;

/// Data shared by all pictures of a recording.
pub(in crate::commands::track) struct DebugScene {
    camera: Camera,
    tools: Vec<String>,
    /// For each tool, the index of the first tool with the same colour.
    first_of_its_colour: Vec<usize>,
}

/// A picture and its part of the file name.
pub(super) type NamedCanvas = (String, Canvas);

impl DebugScene {
    /// The shared data for these settings.
    pub(in crate::commands::track) fn new(settings: &TrackerSettings) -> Self {
        let first_of = |colour: &str| settings.tools.iter().position(|tool| tool.colour == colour).unwrap_or(0);
        Self {
            camera: settings.camera,
            tools: settings.tools.iter().map(|tool| tool.name.clone()).collect(),
            first_of_its_colour: settings.tools.iter().map(|tool| first_of(&tool.colour)).collect(),
        }
    }

    /// A note for a tool whose cells are drawn in another tool's colour, because both have the same tape.
    fn shared_tape_note(&self, tool: usize) -> String {
        let first = self.first_of_its_colour[tool];
        if first == tool { String::new() } else { format!("; same tape as {}", self.tools[first]) }
    }

    /// Classes number the colours from 1. Tools of one colour share a class, drawn in the ink of the first tool.
    fn ink_of_class(&self, class: u8) -> Option<Ink> {
        let mut firsts = self.first_of_its_colour.iter().enumerate().filter(|(tool, first)| tool == *first);
        firsts.nth(usize::from(class).checked_sub(1)?).map(|(tool, _)| ink_of(tool))
    }

    /// All pictures of a frame, in the order of the stages.
    pub(super) fn pictures(&self, frame: &Frame<'_>, report: &FrameReport, trace: &FrameTrace) -> Vec<NamedCanvas> {
        let mut pictures = vec![("1_colours".to_owned(), self.colours(frame, trace))];
        for (tool, of_tool) in trace.tools.iter().enumerate() {
            let fits = of_tool.fits.iter().enumerate();
            pictures.extend(fits.filter_map(|(number, fit)| {
                let of = (number + 1, of_tool.fits.len());
                Some((format!("2_edges_tool{}_fit{}", tool + 1, of.0), self.edges(frame, (tool, of), fit)?))
            }));
        }
        pictures.push(("3_result".to_owned(), self.result(frame, report, trace)));
        pictures
    }

    /// The class of every cell, the areas that were searched, and the regions that were taken for a band.
    fn colours(&self, frame: &Frame<'_>, trace: &FrameTrace) -> Canvas {
        let head =
            format!("frame {}: cells in a tool's colour. white: searched. yellow: measured. red: no band", frame.index);
        let mut text = vec![(WHITE, head)];
        for (tool, of_tool) in trace.tools.iter().enumerate() {
            let followed = of_tool.places.is_empty() && !of_tool.fits.is_empty();
            let how =
                if followed { "found at the expected place, not searched".to_owned() } else { search_summary(of_tool) };
            text.push((ink_of(tool), format!("{}: {how}{}", self.tools[tool], self.shared_tape_note(tool))));
        }
        let mut canvas = Canvas::new(frame, FrameCrop::whole(frame), &text, 0.45).with_pen(2);
        for (cell, class) in trace.classes.iter().enumerate() {
            let Some(ink) = self.ink_of_class(*class) else { continue };
            let corner = Vector2::new((cell % trace.columns) as f64, (cell / trace.columns) as f64);
            let centre = (corner * CELL_PX as f64).add_scalar(0.5 * CELL_PX as f64);
            canvas.dot(centre, CELL_PX as u32, ink);
        }
        for of_tool in &trace.tools {
            of_tool.places.iter().for_each(|place| canvas.path(&box_corners(place), WHITE));
            for (region, refused) in &of_tool.regions {
                let rectangle = region.moments.rectangle();
                let along = rectangle.axis * (0.5 * rectangle.length_px);
                let across = Vector2::new(-rectangle.axis.y, rectangle.axis.x) * (0.5 * rectangle.width_px);
                let corners = [along + across, along - across, -along - across, across - along, along + across];
                let ink = if refused.is_none() { YELLOW } else { RED };
                canvas.path(&corners.map(|corner| rectangle.centre + corner), ink);
            }
        }
        canvas
    }

    /// One fit of a tube: the probes of its last pass, and the edges that they found.
    fn edges(
        &self,
        frame: &Frame<'_>,
        (tool, (number, of)): (usize, (usize, usize)),
        fit: &FitTrace,
    ) -> Option<Canvas> {
        const AROUND_PX: f64 = 12.0;
        let look = fit.passes.last()?;
        let start = self.outline_px(&fit.start, fit.length_mm);
        let before = fit.passes.iter().rev().skip(1).find_map(|look| look.fitted).unwrap_or(fit.start);
        let laid = self.outline_px(&before, fit.length_mm);
        let fitted = look.fitted.map(|tube| self.outline_px(&tube, fit.length_mm)).unwrap_or_default();
        let ends = look.probes.iter().flat_map(|(probe, _)| probe_ends(probe));
        let all: Vec<Vector2<f64>> = start.iter().chain(&fitted).copied().chain(ends).collect();
        let low = all.iter().copied().reduce(|a, b| a.inf(&b))?.add_scalar(-AROUND_PX);
        let high = all.iter().copied().reduce(|a, b| a.sup(&b))?.add_scalar(AROUND_PX);
        let met: Vec<&(Probe, Option<Pixel>)> = look.probes.iter().filter(|(_, edge)| edge.is_some()).collect();
        let agree = met.iter().filter(|(_, edge)| edge.is_some_and(|at| agrees(at, &fitted))).count();
        let text = [
            (
                ink_of(tool),
                format!("frame {}: {}: fit {number} of {of}, pass {}", frame.index, self.tools[tool], fit.passes.len()),
            ),
            (WHITE, fit_summary(look, met.len(), agree)),
            (DARK_BLUE, "dark blue: start of the fit".to_owned()),
            (BLUE, "blue: outline that the probes follow".to_owned()),
            (WHITE, "white: fitted outline".to_owned()),
            (GREEN, format!("green: edge within {MAX_EDGE_DISTANCE_PX} px of it")),
            (RED, "red: edge elsewhere".to_owned()),
            (GREY, "grey: probe without an edge".to_owned()),
        ];
        let mut canvas = Canvas::new(frame, FrameCrop::around(low, high, frame)?, &text, 1.0).with_pen(2);
        canvas.path(&start, DARK_BLUE);
        canvas.path(&laid, BLUE);
        for (probe, edge) in &look.probes {
            let ink = edge.map_or(GREY, |at| if agrees(at, &fitted) { GREEN } else { RED });
            let [inside, outside] = probe_ends(probe);
            canvas.line(inside, outside, ink);
        }
        canvas.path(&fitted, WHITE);
        for at in met.iter().filter_map(|(_, edge)| *edge) {
            canvas.dot(at.0.coords, 7, BLACK);
            canvas.dot(at.0.coords, 5, if agrees(at, &fitted) { GREEN } else { RED });
        }
        Some(canvas)
    }

    /// Outline, axis and tip of each tool; for a tool that was not measured, the filter's position and the reason.
    fn result(&self, frame: &Frame<'_>, report: &FrameReport, trace: &FrameTrace) -> Canvas {
        let head = format!(
            "frame {} at {:.3} s: result. cross: measured tip. white cross: filter only",
            frame.index, frame.time_s
        );
        let mut text = vec![(WHITE, head)];
        text.extend(
            report.tools.iter().map(|of| (ink_of(of.tool), format!("{}: {}", self.tools[of.tool], result_summary(of)))),
        );
        let mut canvas = Canvas::new(frame, FrameCrop::whole(frame), &text, 1.0).with_pen(3);
        for of in &report.tools {
            let ink = ink_of(of.tool);
            match &of.outcome {
                Ok(seen) => {
                    let radius = trace.tools[of.tool].fits.last().map_or(0.0, |fit| fit.start.radius);
                    let tube = Tube { tip: seen.tip_mm, axis: seen.axis, radius };
                    let length_mm = trace.tools[of.tool].fits.last().map_or(0.0, |fit| fit.length_mm);
                    canvas.path(&self.outline_px(&tube, length_mm), ink);
                    canvas.path(&self.axis_px(&tube), ink);
                    canvas.cross(seen.tip_px.0.coords, 9.0, ink);
                }
                Err(_) => {
                    let filtered = of.filtered.and_then(|sample| sample.tip_px);
                    filtered.into_iter().for_each(|at| canvas.cross(at.coords, 9.0, WHITE));
                }
            }
        }
        canvas
    }

    /// The band's outline, once around.
    fn outline_px(&self, tube: &Tube, length_mm: f64) -> Vec<Vector2<f64>> {
        const STEPS: i32 = 12;
        let Some(outline) = tube.outline() else { return Vec::new() };
        let part = |step: i32| f64::from(step) / f64::from(STEPS);
        let distal = (-STEPS..=STEPS).map(|step| outline.rim(0.0, part(step)));
        let there = (0..=STEPS).map(|step| outline.border(BorderSide::Second, part(step) * length_mm));
        let proximal = (-STEPS..=STEPS).rev().map(|step| outline.rim(length_mm, part(step)));
        let back = (0..=STEPS).rev().map(|step| outline.border(BorderSide::First, part(step) * length_mm));
        let around = distal.chain(there).chain(proximal).chain(back);
        around.filter_map(|point| self.camera.project(CameraPoint(point))).map(|pixel| pixel.0.coords).collect()
    }

    fn axis_px(&self, tube: &Tube) -> Vec<Vector2<f64>> {
        let points = [0.0, 0.25, 0.5, 0.75, 1.0].map(|part| tube.tip - tube.axis * (part * SHAFT_MM));
        points
            .into_iter()
            .filter_map(|point| self.camera.project(CameraPoint(point)))
            .map(|pixel| pixel.0.coords)
            .collect()
    }
}

fn ink_of(tool: usize) -> Ink {
    TOOLS[tool % TOOLS.len()]
}

fn search_summary(trace: &ToolTrace) -> String {
    let whys = trace.regions.iter().map(|(_, refused)| refused.map_or("measured", |reason| reason.name()));
    let whys: Vec<&str> = whys.collect();
    let regions = if whys.is_empty() { "no region tried".to_owned() } else { format!("regions: {}", whys.join(", ")) };
    format!("areas searched: {}; {regions}", trace.places.len())
}

fn fit_summary(look: &ProbePassTrace, met: usize, agree: usize) -> String {
    let fitted = if look.fitted.is_some() { "" } else { "; no tube fits them" };
    format!("{} probes in view, {met} found an edge, {agree} agree{fitted}", look.probes.len())
}

fn result_summary(report: &ToolReport) -> String {
    match &report.outcome {
        Ok(seen) => format!(
            "tip {:.1}, {:.1}, {:.1} mm; depth known to {:.1} mm; borders {:.2} px off",
            seen.tip_mm.x,
            seen.tip_mm.y,
            seen.tip_mm.z,
            seen.covariance_mm2[(2, 2)].sqrt(),
            seen.border_residual_px
        ),
        Err(reason) => format!("not measured: {}", reason.name()),
    }
}

/// The two ends of a probe.
fn probe_ends(probe: &Probe) -> [Vector2<f64>; 2] {
    [-probe.inwards_px, probe.outwards_px].map(|reach| probe.middle.0.coords + probe.outward * reach)
}

/// True if the edge lies on the outline.
fn agrees(edge: Pixel, outline: &[Vector2<f64>]) -> bool {
    outline.windows(2).any(|pair| distance_px(edge.0.coords, pair[0], pair[1]) < MAX_EDGE_DISTANCE_PX)
}

/// Distance of a point from the segment between two others.
fn distance_px(at: Vector2<f64>, from: Vector2<f64>, to: Vector2<f64>) -> f64 {
    let along = to - from;
    let part = ((at - from).dot(&along) / along.norm_squared().max(1e-12)).clamp(0.0, 1.0);
    (at - from - along * part).norm()
}

/// The corners of a box of cells, once around, pixels.
fn box_corners(place: &CellBox) -> [Vector2<f64>; 5] {
    let px = |cell: usize| (cell * CELL_PX) as f64 - 0.5;
    let corner = |column, row| Vector2::new(px(column), px(row));
    let CellBox { left, top, right, bottom } = *place;
    [corner(left, top), corner(right, top), corner(right, bottom), corner(left, bottom), corner(left, top)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_cameras::STRAIGHT;
    use crate::vision::frame::{ColourEncoding, Matrix, Range};
    use crate::vision::segmentation::samples::ColourSamples;
    use crate::vision::tracker::{Marker, ToolSpec};

    #[test]
    fn cells_of_a_shared_colour_have_the_ink_of_its_first_tool() {
        let tool = |name: &str, colour: &str| ToolSpec {
            name: name.into(),
            colour: colour.into(),
            side: None,
            diameter_mm: 5.0,
            marker: Marker::Band { length_mm: None },
        };
        let tools = vec![tool("left", "orange"), tool("right", "orange"), tool("cyan", "cyan")];
        let samples = ColourSamples::new(ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 });
        let scene = DebugScene::new(&TrackerSettings::new(STRAIGHT, tools, samples));
        assert_eq!([0, 1].map(|tool| scene.shared_tape_note(tool)), ["", "; same tape as left"]);
        assert_eq!([0, 1, 2, 3].map(|class| scene.ink_of_class(class)), [None, Some(TOOLS[0]), Some(TOOLS[2]), None]);
    }

    #[test]
    fn an_edge_agrees_within_seven_tenths_of_a_pixel_of_the_outline_not_of_its_endless_line() {
        let outline = [Vector2::new(10.0, 10.0), Vector2::new(20.0, 10.0)];
        let at = |u, v| agrees(Pixel::new(u, v), &outline);
        assert!(at(15.0, 10.6) && at(20.5, 10.0));
        assert!(!at(15.0, 10.8) && !at(21.0, 10.0));
    }
}
