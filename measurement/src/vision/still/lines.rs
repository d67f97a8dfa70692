//! The borders of a shaft in a still: straight lines through the steps of the pixels.
//!
//! **In** rough lines. **Out** lines, and the share of each that shows a step. **Method** In rows across the shaft, the
//! place of greatest contrast near each border; a robust line through these places, twice, the second time from nearby
//! places only.

use nalgebra::{Point2, Vector2, center};

use crate::vision::edges::line_fit::{self, BorderLine};
use crate::vision::edges::shaft_rows::{codes_at, mean};
use crate::vision::frame::Frame;
use crate::vision::segmentation::shaft_evidence::contrast;
use crate::vision::space::Pixel;

/// Distance between rows, pixels: less would show the same pixels again.
const ROW_PX: f64 = 4.0;
/// Places that are compared on both sides of a step, pixels from it: past the blur of the lens and of halved chroma.
const COMPARED_PX: [f64; 3] = [1.0, 2.0, 3.0];
/// Distance between places across a border, pixels.
const PLACE_PX: f64 = 0.5;
/// Where steps are looked for on both sides of a line, as a share of the width and at least so many pixels: first the
/// error of a strip's border, and then that of a fitted line, with a bend by the lens.
const REACHES: [(f64, f64); 2] = [(0.3, 8.0), (0.08, 4.0)];
/// Largest distance of a step from its line, as a share of the width and at least so many pixels: bends by the lens,
/// and motion.
const NEAR: (f64, f64) = (0.05, 2.0);
/// Least share of the rows that show a step near the line. The six shafts of three real pictures had 0.73 to 1, and two
/// false ones of a rendered scene 0.57 and 0.58: no past and no empty box contradict them in a still.
const MIN_SHOWN: f64 = 2.0 / 3.0;
/// Least number of steps on a line: six more than it has unknowns.
const MIN_STEPS: usize = 8;
/// Largest ratio of the widths at both ends: that of distances from the camera.
const MAX_TAPER: f64 = 4.0;

/// Both borders of a shaft as lines along its middle.
#[derive(Clone, Copy, Debug)]
pub struct ShaftLines {
    /// A point of the middle at the picture's rim.
    from: Point2<f64>,
    /// Unit vector from the rim to the end.
    along: Vector2<f64>,
    /// Distance of the end from it, pixels.
    pub length: f64,
    borders: [BorderLine; 2],
}

impl ShaftLines {
    /// From both borders, each from the rim to the end. `None` if they enclose nothing.
    pub fn new(borders: [[Point2<f64>; 2]; 2]) -> Option<Self> {
        let [from, to] = [0, 1].map(|end| center(&borders[0][end], &borders[1][end]));
        let [one, other] = borders.map(line_through);
        Self::between([one?, other?], from, to)
    }

    /// Between two lines, along the middle from a point to another. The order of the lines does not matter.
    fn between(borders: [BorderLine; 2], from: Point2<f64>, to: Point2<f64>) -> Option<Self> {
        let length = (to - from).norm();
        let mut lines = Self { from, along: (to - from).try_normalize(1e-9)?, length, borders };
        let [one, other] = [0, 1].map(|side| lines.offset(side, 0.5 * length));
        if one > other {
            lines.borders.swap(0, 1);
        }
        let [first, last] = [lines.width(0.0), lines.width(length)];
        let is_tube = first.min(last) > 1.0 && first.max(last) < MAX_TAPER * first.min(last);
        is_tube.then_some(lines)
    }

    /// Unit vector from the rim to the end.
    pub fn along(&self) -> Vector2<f64> {
        self.along
    }

    fn across(&self) -> Vector2<f64> {
        Vector2::new(-self.along.y, self.along.x)
    }

    /// Distance of a border from the middle line at a place along it, pixels.
    pub fn offset(&self, side: usize, place: f64) -> f64 {
        let BorderLine { normal, offset } = self.borders[side];
        (offset - normal.dot(&self.at(place, 0.0).coords)) / normal.dot(&self.across())
    }

    /// The point at a place along the middle line, and this far across.
    pub fn at(&self, place: f64, across: f64) -> Point2<f64> {
        self.from + self.along * place + self.across() * across
    }

    /// Width at a place along the middle line, pixels.
    pub fn width(&self, place: f64) -> f64 {
        self.offset(1, place) - self.offset(0, place)
    }

    /// Both borders, each from the picture's rim to the end.
    pub fn borders_in_picture(&self, size: [f64; 2]) -> Option<[[Pixel; 2]; 2]> {
        let of_side = |side: usize| {
            let end = self.at(self.length, self.offset(side, self.length));
            let back = (self.at(0.0, self.offset(side, 0.0)) - end).try_normalize(1e-9)?;
            let to_rim = (0..2).filter_map(|axis| {
                let limit = if back[axis] < 0.0 { 0.0 } else { size[axis] - 1.0 };
                (back[axis].abs() > 1e-9).then(|| (limit - end[axis]) / back[axis])
            });
            let distance = to_rim.fold(f64::INFINITY, f64::min);
            (distance > 0.0 && distance.is_finite()).then(|| [Pixel(end + back * distance), Pixel(end)])
        };
        Some([of_side(0)?, of_side(1)?])
    }
}

/// Lines that were fitted.
#[derive(Clone, Copy, Debug)]
pub struct FittedLines {
    /// The lines.
    pub lines: ShaftLines,
    /// Share of the rows that show a step on the border that shows less.
    pub shown: f64,
    /// The last place along them where both borders were seen before.
    pub last_shown: f64,
}

/// The lines fitted to the steps near rough ones.
pub fn fit(frame: &Frame<'_>, rough: &ShaftLines, grey: [f64; 2]) -> Option<FittedLines> {
    let [wide, narrow] = REACHES;
    fit_once(frame, &fit_once(frame, rough, wide, grey)?.lines, narrow, grey)
}

/// The lines fitted to the steps from the rim to a place along their middle.
pub fn fit_up_to(frame: &Frame<'_>, lines: &ShaftLines, end: f64, grey: [f64; 2]) -> Option<FittedLines> {
    fit_once(frame, &ShaftLines { length: end, ..*lines }, REACHES[1], grey)
}

fn fit_once(frame: &Frame<'_>, lines: &ShaftLines, reach: (f64, f64), grey: [f64; 2]) -> Option<FittedLines> {
    let [one, other] = [0, 1].map(|side| fit_border(frame, lines, side, reach, grey));
    let (one, other) = (one?, other?);
    let [from, to] = [0.0, lines.length].map(|place| {
        let fitted = ShaftLines { borders: [one.line, other.line], ..*lines };
        fitted.at(place, 0.5 * (fitted.offset(0, place) + fitted.offset(1, place)))
    });
    Some(FittedLines {
        lines: ShaftLines::between([one.line, other.line], from, to)?,
        shown: one.shown.min(other.shown),
        last_shown: one.last_shown.min(other.last_shown),
    })
}

/// One border that was fitted, as in [`FittedLines`].
struct FittedBorder {
    line: BorderLine,
    shown: f64,
    last_shown: f64,
}

/// Is a border that of a highlight on the shaft? Beyond a highlight the shaft is dark again, along most of the border.
pub fn is_of_highlight(frame: &Frame<'_>, lines: &ShaftLines, side: usize, grey: [f64; 2]) -> bool {
    /// Where the shaft would be dark again, widths outside the border: a highlight is narrower than the shaft.
    const BEYOND: [f64; 5] = [0.2, 0.4, 0.6, 0.8, 1.0];
    /// How dark it is there, as a share of the border's contrast: darker than a shadow beside the shaft. And the least
    /// share of the rows.
    const DARK: f64 = 0.8;
    const MIN_SHARE: f64 = 0.6;
    let outward = if side == 0 { -1.0 } else { 1.0 };
    let (mut seen, mut dark) = (0.0, 0.0);
    for row in 0..(lines.length / ROW_PX) as usize {
        let place = (row as f64 + 0.5) * ROW_PX;
        let width = lines.width(place);
        let codes = |px: f64| {
            let across = lines.offset(side, place) + outward * px;
            mean([-0.5, 0.5].map(|more| codes_at(frame, Pixel(lines.at(place, across + more)))))
        };
        let (Some(inside), Some(outside)) = (codes(-2.0), codes(2.0)) else { continue };
        let own = contrast(inside, outside, grey);
        if own >= 1.0 {
            seen += 1.0;
            let is_dark = |share: &f64| {
                codes(2.0 + share * width).is_some_and(|codes| contrast(codes, outside, grey) > DARK * own)
            };
            dark += f64::from(u8::from(BEYOND.iter().any(is_dark)));
        }
    }
    dark > MIN_SHARE * seen
}

/// The line of one border.
fn fit_border(
    frame: &Frame<'_>,
    lines: &ShaftLines,
    side: usize,
    (share, least_px): (f64, f64),
    grey: [f64; 2],
) -> Option<FittedBorder> {
    let count = (lines.length / ROW_PX) as usize;
    let (mut steps, mut rows) = (Vec::new(), 0.0);
    for row in 0..count {
        let place = (row as f64 + 0.5) * ROW_PX;
        let reach = least_px.max(share * lines.width(place));
        match step_in_row(frame, lines, side, place, reach, grey) {
            RowStep::At(at) => {
                steps.push((place, at));
                rows += 1.0;
            }
            RowStep::Nowhere => rows += 1.0,
            RowStep::OutsidePicture => (),
        }
    }
    let points: Vec<Point2<f64>> = steps.iter().map(|(_, at)| *at).collect();
    let line = line_fit::fit(&points).filter(|_| points.len() >= MIN_STEPS)?;
    let (near_share, near_px) = NEAR;
    let is_near =
        |(place, at): &&(f64, Point2<f64>)| line.distance(*at).abs() < near_px.max(near_share * lines.width(*place));
    let near: Vec<f64> = steps.iter().filter(is_near).map(|(place, _)| *place).collect();
    let shown = near.len() as f64 / rows;
    let last_shown = *near.last()?;
    (near.len() >= MIN_STEPS && shown >= MIN_SHOWN).then_some(FittedBorder { line, shown, last_shown })
}

/// What a row across a border shows.
enum RowStep {
    At(Point2<f64>),
    Nowhere,
    OutsidePicture,
}

/// The place of greatest contrast in a row across a border.
fn step_in_row(frame: &Frame<'_>, lines: &ShaftLines, side: usize, place: f64, reach: f64, grey: [f64; 2]) -> RowStep {
    let outward = if side == 0 { -1.0 } else { 1.0 };
    let middle = lines.offset(side, place);
    let contrast_at = |off_px: f64| {
        let codes = |sign: f64| {
            let across = COMPARED_PX.map(|px| middle + outward * (off_px + sign * px));
            mean(across.map(|across| codes_at(frame, Pixel(lines.at(place, across)))))
        };
        Some(contrast(codes(-1.0)?, codes(1.0)?, grey))
    };
    let places = (2.0 * reach / PLACE_PX) as usize;
    let off = |i: usize| i as f64 * PLACE_PX - reach;
    let contrasts: Vec<Option<f64>> = (0..=places).map(|i| contrast_at(off(i))).collect();
    if contrasts.iter().any(Option::is_none) {
        return RowStep::OutsidePicture;
    }
    let contrasts: Vec<f64> = contrasts.into_iter().flatten().collect();
    let Some(best) = (1..places).max_by(|one, other| contrasts[*one].total_cmp(&contrasts[*other])) else {
        return RowStep::Nowhere;
    };
    let [before, here, behind] = [best - 1, best, best + 1].map(|i| contrasts[i]);
    if here < 1.0 || before > here || behind > here {
        return RowStep::Nowhere; // no step, or one beyond the reach
    }
    let bend = (2.0 * here - before - behind).max(1e-6);
    let fine = PLACE_PX * (0.5 * (behind - before) / bend).clamp(-1.0, 1.0);
    RowStep::At(lines.at(place, middle + outward * (off(best) + fine)))
}

/// The line through both points.
fn line_through([from, to]: [Point2<f64>; 2]) -> Option<BorderLine> {
    let along = (to - from).try_normalize(1e-9)?;
    let normal = Vector2::new(-along.y, along.x);
    Some(BorderLine { normal, offset: normal.dot(&from.coords) })
}
