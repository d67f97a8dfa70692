//! Bare shafts in a still: their borders and their ends in pixels, without a camera (METHOD 3.6).
//!
//! A still has neither a past nor, usually, a camera. So nothing is in millimetres, and no trocar is known. Strips are
//! found as in a recording, with any camera, because their width is free over a range of eight. Their borders are any
//! two straight lines that come from the picture's rim: without a focal length, a tube of any lean fits them.
//!
//! | step | input | output |
//! |---|---|---|
//! | [`StripFinder`] | cells of the stills | strips of shaft evidence |
//! | [`lines`] | frame, strip | both borders as lines through the steps of the pixels |
//! | [`end`] | frame, lines | where the shaft ends between them |

mod end;
mod lines;

use nalgebra::{Point2, center};

use crate::vision::camera::Camera;
use crate::vision::edges::edge_model::{EdgeModel, Likeness};
use crate::vision::frame::Frame;
use crate::vision::reason::MissReason;
use crate::vision::segmentation::cells::CellPicture;
use crate::vision::segmentation::samples::ColourSamples;
use crate::vision::segmentation::shaft_colour::ShaftColour;
use crate::vision::space::{Normalised, Pixel};
use crate::vision::strip::Strip;
use crate::vision::strip::finder::{BareTool, FrameStrips, SearchTurn, StripFinder};
use lines::{FittedLines, ShaftLines};

/// Least length of a shaft whose end does not show, widths: as much as its end needs.
const MIN_LENGTH_WIDTHS: f64 = 6.0;

/// A bare tool to be found in stills.
#[derive(Clone, Debug, PartialEq)]
pub struct StillTool {
    /// The label of its shaft's samples.
    pub colour: String,
    /// Side and diameter. The diameter is only the unit of the collar's length.
    pub tool: BareTool,
    /// Length of its collar, mm; 0 without one.
    pub collar_mm: f64,
}

/// A shaft in a still.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StillShaft {
    /// Both borders, each from the picture's rim to the shaft's end, or to the last place that shows both; the first is
    /// the left one, seen from the hand.
    pub borders: [[Pixel; 2]; 2],
    /// Where the middle line meets the rim of the end, on the side of the camera; `None` if the end is hidden or not
    /// clear.
    pub end: Option<Pixel>,
    /// Share of the borders that shows a step, 0 to 1: of the border that shows less.
    pub shown: f64,
    /// Evidence of its strip, nats.
    score: f64,
}

impl StillShaft {
    /// Width at its end, pixels.
    pub fn width_px(&self) -> f64 {
        (self.borders[0][1].0 - self.borders[1][1].0).norm()
    }

    /// Middles of its borders: at the picture's rim, and at the end.
    fn middles(&self) -> [Point2<f64>; 2] {
        [0, 1].map(|end| center(&self.borders[0][end].0, &self.borders[1][end].0))
    }

    /// Is it the same shaft, from either side: do both middles lie within the other, and overlap?
    fn is_same_as(&self, other: &Self) -> bool {
        let apart = 0.5 * self.width_px().max(other.width_px());
        let lies_in = |one: &Self, other: &Self| {
            let (points, [from, to]) = (one.middles(), other.middles());
            let along = (to - from).normalize();
            let places = points.map(|point| (point - from).dot(&along));
            let overlaps = places[0].min(places[1]) < (to - from).norm() && places[0].max(places[1]) > 0.0;
            overlaps && points.iter().all(|point| (point - from).perp(&along).abs() < apart)
        };
        lies_in(self, other) || lies_in(other, self)
    }

    /// Is it the better one of two that are the same: does its end show, or has it more evidence?
    fn is_better_than(&self, other: &Self) -> bool {
        let rank = |shaft: &Self| (shaft.end.is_some(), shaft.score);
        rank(self) > rank(other)
    }

    /// Does its end lie next to another shaft, or next to the jaws ahead of that? It may then only be hidden there.
    fn ends_at(&self, other: &Self) -> bool {
        /// Length of jaws, widths.
        const JAWS: f64 = 6.0;
        /// Farthest from the other's middle, as a share of both widths: half of both, and the error of an end.
        const APART: f64 = 0.75;
        let ([_, end], [from, to]) = (self.middles(), other.middles());
        let along = to - from;
        let length = along.norm();
        let at = (end - from).dot(&along) / length;
        let aside = (end - from).perp(&along).abs() / length;
        at > 0.0 && at < length + JAWS * other.width_px() && aside < APART * 0.5 * (self.width_px() + other.width_px())
    }
}

/// The shaft of each tool in a still, or why it has none. Each still is looked at alone: nothing else is known of its
/// box. `samples` are marks on this or on other stills of the box.
pub fn shafts(frame: &Frame<'_>, samples: &ColourSamples, tools: &[StillTool]) -> Vec<Result<StillShaft, MissReason>> {
    let Some(still) = Still::new(frame, samples, tools) else {
        return vec![Err(MissReason::NoMarkerColour); tools.len()];
    };
    let strips = FrameStrips::new(&still.finder, frame, SearchTurn::All);
    let mut found: Vec<_> = (0..tools.len()).map(|tool| still.shaft(&strips, tool)).collect();
    let all: Vec<Option<StillShaft>> = found.iter().map(|found| found.as_ref().ok().copied()).collect();
    for (tool, found) in found.iter_mut().enumerate() {
        let Ok(own) = found else { continue };
        let mut others = all.iter().enumerate().filter(|(other, _)| *other != tool).filter_map(|(_, shaft)| *shaft);
        if others.clone().any(|other| other.is_better_than(own) && own.is_same_as(&other)) {
            *found = Err(MissReason::OtherToolsBand);
        } else if others.any(|other| own.ends_at(&other)) {
            own.end = None;
        }
    }
    found
}

/// A still whose box was learned.
struct Still<'a> {
    frame: &'a Frame<'a>,
    finder: StripFinder,
    camera: Camera,
    tools: &'a [StillTool],
    edges: Vec<EdgeModel>,
    /// Usual chroma of the shafts, codes.
    grey: [f64; 2],
}

impl<'a> Still<'a> {
    /// `None` without tools or marked shafts.
    fn new(frame: &'a Frame<'a>, samples: &ColourSamples, tools: &'a [StillTool]) -> Option<Self> {
        let is_bare = |label: &&String| tools.iter().any(|tool| tool.colour == **label);
        let labels = samples.labels.iter().filter(is_bare);
        let pixels: Vec<[u8; 3]> = labels.flat_map(|label| samples.codes_of_label(label, frame.encoding)).collect();
        let shaft = ShaftColour::in_shade_too(&pixels)?;
        let grey = shaft.chroma().map(f64::from);
        let camera = any_camera([frame.width(), frame.height()]);
        let bare: Vec<BareTool> = tools.iter().map(|tool| tool.tool).collect();
        let finder = StripFinder::learn(&camera, shaft, &bare, &[CellPicture::of(frame)], None)?;
        let edges = tools.iter().map(|tool| {
            let usual = samples.usual_colour(&tool.colour, frame.encoding);
            EdgeModel::new(usual, Likeness::AllPlanes, frame.encoding)
        });
        Some(Self { frame, finder, camera, tools, edges: edges.collect(), grey })
    }

    /// The shaft of the best strip whose end shows; without one, of the best.
    fn shaft(&self, strips: &FrameStrips<'_>, tool: usize) -> Result<StillShaft, MissReason> {
        let mut best = Err(MissReason::NoMarkerColour);
        for strip in strips.of_tool(tool) {
            match (self.measure(&strip, tool), &best) {
                (Ok(shaft), _) if shaft.end.is_some() => return Ok(shaft),
                (Ok(shaft), Err(_)) => best = Ok(shaft),
                (Err(reason), Err(other)) => best = Err(reason.max(*other)),
                (_, Ok(_)) => (),
            }
        }
        best
    }

    fn measure(&self, strip: &Strip, tool: usize) -> Result<StillShaft, MissReason> {
        let pixel = |at: Point2<f64>| self.camera.pixel_of(Normalised(at)).0;
        let rough = ShaftLines::new(strip.borders.map(|border| border.map(pixel))).ok_or(MissReason::WrongShape)?;
        let fitted = lines::fit(self.frame, &rough, self.grey).ok_or(MissReason::BordersNotFound)?;
        let StillTool { tool: BareTool { diameter_mm, .. }, collar_mm, .. } = self.tools[tool];
        let end = end::locate(self.frame, &fitted.lines, &self.edges[tool], diameter_mm, collar_mm);
        let up_to = end.map_or(fitted.last_shown, |end| end.borders);
        let fitted =
            lines::fit_up_to(self.frame, &fitted.lines, up_to, self.grey).ok_or(MissReason::BordersNotFound)?;
        let FittedLines { lines, shown, .. } = fitted;
        if (0..2).any(|side| lines::is_of_highlight(self.frame, &lines, side, self.grey)) {
            return Err(MissReason::BordersNotFound);
        }
        let size = [self.frame.width(), self.frame.height()].map(|size| size as f64);
        let borders = lines.borders_in_picture(size).ok_or(MissReason::BordersNotFound)?;
        if end.is_none() && lines.length < MIN_LENGTH_WIDTHS * lines.width(lines.length) {
            return Err(MissReason::TipHidden);
        }
        let at_borders = center(&borders[0][1].0, &borders[1][1].0);
        let end = end.map(|end| Pixel(at_borders + lines.along() * (end.middle - end.borders)));
        Ok(StillShaft { borders, end, shown, score: strip.score })
    }
}

/// A camera for pictures of this size, with a usual field of view and no distortion.
fn any_camera([width, height]: [usize; 2]) -> Camera {
    /// Focal length as a multiple of the picture's width: 60°.
    const FOCAL: f64 = 0.87;
    let [fx, cx, cy] = [FOCAL * width as f64, 0.5 * (width as f64 - 1.0), 0.5 * (height as f64 - 1.0)];
    Camera {
        width: width as u32,
        height: height as u32,
        fx,
        fy: fx,
        cx,
        cy,
        k1: 0.0,
        k2: 0.0,
        p1: 0.0,
        p2: 0.0,
        k3: 0.0,
        focal_sigma: 0.0,
    }
}
