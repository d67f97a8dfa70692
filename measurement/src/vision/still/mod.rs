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
    for (tool, others) in others_of(&found).into_iter().enumerate() {
        let is_others =
            |own: &StillShaft| others.iter().any(|other| other.is_better_than(own) && own.is_same_as(other));
        if found[tool].as_ref().is_ok_and(is_others) {
            found[tool] = Err(MissReason::OtherToolsBand);
        }
    }
    let others = others_of(&found);
    for (found, others) in found.iter_mut().zip(others) {
        let Ok(own) = found else { continue };
        own.end = own.end.filter(|_| !others.iter().any(|other| own.ends_at(other)));
    }
    found
}

/// For each tool, the shafts of the others.
fn others_of(found: &[Result<StillShaft, MissReason>]) -> Vec<Vec<StillShaft>> {
    let shafts: Vec<Option<StillShaft>> = found.iter().map(|found| found.as_ref().ok().copied()).collect();
    let others =
        |tool: usize| shafts.iter().enumerate().filter_map(move |(other, shaft)| shaft.filter(|_| other != tool));
    (0..found.len()).map(|tool| others(tool).collect()).collect()
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::frame::{ColourEncoding, Matrix, Plane, Range};
    use crate::vision::segmentation::samples::ColourSample;
    use crate::vision::space::HandSide;

    const SIZE: [usize; 2] = [640, 360];
    const BOX: u8 = 170;
    const BLACK: u8 = 30;
    const STEEL: u8 = 95;
    /// Column where the shaft ends, and its middle row and half width there and at the rim.
    const END: f64 = 420.0;
    const MIDDLE: [f64; 2] = [180.0, 240.0];
    const HALF: [f64; 2] = [14.0, 26.0];

    /// Distance from the shaft's middle at a column, half widths.
    fn aside(x: f64, y: f64) -> f64 {
        let at = |[end, rim]: [f64; 2]| rim + (end - rim) * x / END;
        (y - at(MIDDLE)) / at(HALF)
    }

    /// Luma of a shaft from the left with a hinge of steel.
    fn shaft_luma(x: f64, y: f64) -> u8 {
        let aside = aside(x, y).abs();
        match x {
            x if x < END && aside < 1.0 => BLACK,
            x if (END..END + 60.0).contains(&x) && aside < 0.6 => STEEL,
            _ => BOX,
        }
    }

    /// What is found for a tool on the left and one on the right of a grey picture.
    fn found(luma: impl Fn(f64, f64) -> u8) -> Vec<Result<StillShaft, MissReason>> {
        let [width, height] = SIZE;
        let mean = |i: usize| {
            let (x, y) = ((i % width) as f64, (i / width) as f64);
            let parts = (0..16).map(|part| {
                let [right, down] = [part % 4, part / 4].map(|part| f64::from(part) / 4.0 - 0.375);
                u32::from(luma(x + right, y + down))
            });
            (parts.sum::<u32>() / 16) as u8
        };
        let codes: Vec<u8> = (0..width * height).map(mean).collect();
        let grey = vec![128; width * height];
        let [y, u, v] = [&codes, &grey, &grey].map(|data| Plane { data, stride: width, width, height });
        let encoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 };
        let (index, time_s, shift_x, shift_y, chroma_first_px) = (0, 0.0, 0, 0, [0.0; 2]);
        let frame = Frame { index, time_s, y, u, v, shift_x, shift_y, chroma_first_px, encoding };
        let sample = |yuv| ColourSample { label: 0, rectangle: 0, yuv };
        let samples = ColourSamples {
            encoding,
            labels: vec!["shaft".to_owned()],
            samples: (0..40).map(|i| sample([BLACK - 4 + i % 9, 128, 128])).collect(),
            places: Vec::new(),
        };
        let tools = [HandSide::Left, HandSide::Right].map(|side| StillTool {
            colour: "shaft".to_owned(),
            tool: BareTool { side: Some(side), diameter_mm: 5.0 },
            collar_mm: 0.0,
        });
        shafts(&frame, &samples, &tools)
    }

    /// Largest distance of a shaft's borders from those drawn, pixels.
    fn off_px(shaft: &StillShaft) -> f64 {
        let off = |at: Pixel| {
            let aside = aside(at.u(), at.v());
            (aside.abs() - 1.0).abs() * (HALF[1] + (HALF[0] - HALF[1]) * at.u() / END)
        };
        shaft.borders.iter().flatten().map(|at| off(*at)).fold(0.0, f64::max)
    }

    #[test]
    fn the_edges_and_the_end_of_a_tapered_shaft_are_found_and_no_second_one() {
        let both = found(shaft_luma);
        let shaft = both[0].unwrap();
        assert!(off_px(&shaft) < 0.7 && shaft.shown > 0.9, "{shaft:?}");
        let end = shaft.end.unwrap();
        assert!((end.u() - END).abs() < 3.0 && aside(end.u(), end.v()).abs() < 0.1, "{shaft:?}");
        assert!(both[1].is_err(), "{:?}", both[1]);
    }

    #[test]
    fn a_shaft_that_leaves_the_picture_has_edges_and_no_end() {
        let through = found(|x, y| if aside(x, y).abs() < 1.0 { BLACK } else { BOX });
        let shaft = through.iter().flatten().next().unwrap();
        assert!(shaft.end.is_none() && off_px(shaft) < 0.7, "{shaft:?}");
    }

    #[test]
    fn a_thing_across_the_shaft_is_no_end() {
        let across = found(|x, y| if (300.0..330.0).contains(&x) { STEEL } else { shaft_luma(x, y) });
        let end = across[0].unwrap().end;
        assert!(end.is_none_or(|end| (end.u() - END).abs() < 3.0), "{across:?}");
    }

    #[test]
    fn half_of_a_shaft_beside_its_highlight_is_no_shaft() {
        let gloss = |x: f64, y: f64| match aside(x, y) {
            _ if x > END => shaft_luma(x, y),
            aside if aside.abs() < 0.25 => BOX,
            _ => shaft_luma(x, y),
        };
        let both = found(gloss);
        assert!(both.iter().flatten().all(|shaft| off_px(shaft) < 2.0), "{both:?}");
    }
}
