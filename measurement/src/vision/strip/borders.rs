//! Possible borders of a strip, to a pixel: straight lines where the colour steps from a shaft's to the box's.
//!
//! Evidence alone does not show a shaft's width well: it takes shade beside the shaft for shaft, or gloss on it for
//! background, so it may be half or twice as wide. A border is a straight line with a sharp step along most of its
//! length, darker or greyer inside than outside. What is outside is the box, so gloss that is brighter than the box
//! counts as no more than the box itself: a highlight on a black shaft before black foam has no border. Where few rows
//! show such a step, the shaft cannot be measured.

use nalgebra::{Point2, Vector2};

use super::Strip;
use crate::vision::camera::Camera;
use crate::vision::frame::Frame;
use crate::vision::segmentation::shaft_evidence::ShaftAppearance;
use crate::vision::space::Normalised;

/// Rows across the strip.
const ROWS: usize = 48;
/// Part of the strip that is read, from its end: the tool's measured piece is about twelve widths long.
const MAX_LENGTH_WIDTHS: f64 = 12.0;
/// The first and the last part of that piece are left out: the end of the shaft, and the picture's rim.
const READ_PART: (f64, f64) = (0.08, 0.95);
/// Borders are looked for from this many half widths to that many from the strip's middle, towards their side. Evidence
/// is up to twice as wide as the shaft, by shade on one side, or half as wide, by gloss on the other.
const REACH: (f64, f64) = (-0.4, 3.0);
/// Least distance between both borders, half widths.
const MIN_WIDTH: f64 = 0.7;
/// Largest difference of a border's distances from the middle at both ends of the piece, half widths: taper, and a
/// strip that leans.
const MAX_TILT: f64 = 0.9;
/// Most places in a half width: on a wider strip, places are more than a pixel apart.
const MAX_PLACES: f64 = 32.0;
/// What makes a step.
#[derive(Clone, Copy)]
struct StepShape {
    /// Places on each side that are compared, as a share of the half width, and their least and most number.
    compared: (f64, f64, f64),
    /// Limits of the contrast of one row, as a multiple of the least: no row may outvote the others.
    row_contrast: (f32, f32),
}

/// A sharp step. So few places are compared that a soft shadow is no step, and enough for a strip out of focus.
const SHARP: StepShape = StepShape { compared: (0.1, 2.0, 4.0), row_contrast: (-1.0, 8.0) };
/// A step that motion has smeared over up to 0.7 half widths: a tip that moves at 150 mm/s while the camera exposes for
/// 12 ms moves by that much of a 5 mm tool. Its middle is where the contrast is greatest, so the limit is beyond that of
/// black before white.
const SMEARED: StepShape = StepShape { compared: (0.35, 4.0, 12.0), row_contrast: (-1.0, 20.0) };
/// Least share of rows with a step. Where six of ten have none, a shaft cannot be measured before its background.
const MIN_SUPPORT: f64 = 0.4;
/// Pairs of borders that are tried.
const MAX_PAIRS: usize = 4;
/// Borders kept on each side.
const KEPT: usize = 3;
/// A border whose contrast is below this share of the strongest one on its side that enough rows show is left out: of a
/// shadow, or on the shaft.
const MIN_SHARE: f32 = 0.5;

/// A strip between likely borders.
#[derive(Clone, Debug)]
pub struct LikelyStrip {
    /// The strip.
    pub strip: Strip,
    /// Width over which motion has smeared its borders; 0 if they are sharp.
    pub smear: f64,
}

/// Rows across the end of a strip.
pub struct StripRows<'a> {
    strip: &'a Strip,
    appearance: &'a ShaftAppearance,
    /// Middle of the first row, nearest to the end of the strip, and of the last.
    middles: [Point2<f64>; 2],
    /// A half width across the strip, towards its second border.
    half: Vector2<f64>,
    /// Distance between places, half widths.
    step: f64,
    /// Places in a row.
    places: usize,
    /// Codes of the frame and of the empty box at each place of each row; `None` outside the picture.
    codes: Vec<Option<[[f32; 3]; 2]>>,
}

impl<'a> StripRows<'a> {
    /// Reads the rows.
    pub fn read(frame: &Frame<'_>, camera: &Camera, appearance: &'a ShaftAppearance, strip: &'a Strip) -> Self {
        let part = (MAX_LENGTH_WIDTHS / strip.length_widths.max(1.0)).min(1.0);
        let (end, entry) = (strip.end.0, strip.entry.0);
        let middles = [READ_PART.0, READ_PART.1].map(|share| end + (entry - end) * (part * share));
        let along = (entry - end).try_normalize(1e-9).unwrap_or_else(Vector2::x);
        let across = Vector2::new(-along.y, along.x);
        let is_towards_second = across.dot(&(strip.borders[1][1] - strip.borders[0][1])) > 0.0;
        let half = across * (if is_towards_second { 0.5 } else { -0.5 } * strip.width);
        let half_px = (0.5 * strip.width * camera.fx).max(2.0);
        let step = 1.0 / half_px.min(MAX_PLACES);
        let places = (2.0 * REACH.1 / step) as usize + 1;
        let mut rows = Self { strip, appearance, middles, half, step, places, codes: Vec::new() };
        let all = (0..ROWS).flat_map(|row| (0..places).map(move |place| (row, place)));
        rows.codes = all.map(|(row, place)| codes_of(frame, camera, appearance, rows.at(row, place))).collect();
        rows
    }

    /// A place of a row.
    fn at(&self, row: usize, place: usize) -> Normalised {
        let [first, last] = self.middles;
        let share = row as f64 / (ROWS - 1) as f64;
        Normalised(first + (last - first) * share + self.half * (place as f64 * self.step - REACH.1))
    }

    /// The strip with each likely pair of sharp borders, the one of most contrast first.
    pub fn with_sharp_borders(&self) -> Vec<LikelyStrip> {
        let steps = RowSteps::of(self, SHARP);
        steps.pairs().iter().map(|pair| LikelyStrip { strip: self.with_borders(pair), smear: 0.0 }).collect()
    }

    /// The strip with each likely pair of borders that motion has smeared, the one of most contrast first. Each is
    /// smeared by at least so much: a sharp one is no other than before.
    pub fn with_smeared_borders(&self, least: f64) -> Vec<LikelyStrip> {
        let [sharp, smeared] = [SHARP, SMEARED].map(|shape| RowSteps::of(self, shape));
        let sharp = RowSteps { row_contrast: smeared.row_contrast, ..sharp };
        let likely = |pair: &[PossibleBorder; 2]| {
            let of_side = |side: f64, border: &PossibleBorder| {
                let shown = sharp.mean_contrast(side, border.at).unwrap_or(0.0) / border.contrast;
                smear_width(f64::from(shown), [sharp.compared, smeared.compared].map(|places| places as f64))
            };
            let places = 0.5 * (of_side(-1.0, &pair[0]) + of_side(1.0, &pair[1]));
            LikelyStrip { strip: self.with_borders(pair), smear: places * self.step * self.half.norm() }
        };
        smeared.pairs().iter().map(likely).filter(|likely| likely.smear > least).collect()
    }

    /// The strip with its borders moved to these lines.
    fn with_borders(&self, pair: &[PossibleBorder; 2]) -> Strip {
        let strip = self.strip;
        let [first, second] = [(-1.0, &pair[0]), (1.0, &pair[1])].map(|(side, border)| {
            let [one, other] = [0, 1].map(|end| self.middles[end] + self.half * (side * border.at[end]));
            let along = other - one;
            let beside = |place: Point2<f64>| one + along * ((place - one).dot(&along) / along.norm_squared());
            [beside(strip.entry.0), beside(strip.end.0)]
        });
        let middle = |i: usize| Normalised(nalgebra::center(&first[i], &second[i]));
        let width = (second[1] - first[1]).norm();
        Strip { borders: [first, second], entry: middle(0), end: middle(1), width, ..strip.clone() }
    }
}

/// Width of a step that motion has smeared evenly, places. `shown` is the contrast between the means of a few places on
/// both sides of its middle, as a share of that between the means of more places. Of the whole contrast, means of `n`
/// places show `1 − w/4n` for a width `w` up to `2n`, and `n/w` beyond.
fn smear_width(shown: f64, [few, more]: [f64; 2]) -> f64 {
    const HALVINGS: usize = 20;
    let share =
        |width: f64, places: f64| if width < 2.0 * places { 1.0 - width / (4.0 * places) } else { places / width };
    let (mut narrow, mut wide) = (0.0, 2.0 * more);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (narrow + wide);
        if share(middle, few) / share(middle, more) > shown { narrow = middle } else { wide = middle }
    }
    0.5 * (narrow + wide)
}

/// A possible border on one side of a strip.
#[derive(Clone, Copy, Debug, PartialEq)]
struct PossibleBorder {
    /// Distance from the strip's middle in the first and in the last row, half widths.
    at: [f64; 2],
    /// Mean contrast of its rows, as a multiple of the least.
    contrast: f32,
}

/// A contrast that is not known.
const NOWHERE: f32 = f32::NEG_INFINITY;

/// The steps in the rows across a strip.
struct RowSteps<'a> {
    rows: &'a StripRows<'a>,
    /// Places on each side of a border that are compared.
    compared: usize,
    /// Limits of the contrast of one row.
    row_contrast: (f32, f32),
    /// Contrast at each place of each row, as a multiple of the least: for a border on the first and on the second
    /// side. [`NOWHERE`] outside the picture.
    contrast: [Vec<f32>; 2],
}

impl<'a> RowSteps<'a> {
    fn of(rows: &'a StripRows<'a>, StepShape { compared, row_contrast }: StepShape) -> Self {
        let compared = (compared.0 / rows.step).round().clamp(compared.1, compared.2) as usize;
        let mut contrast: [Vec<f32>; 2] = Default::default();
        for row in rows.codes.chunks_exact(rows.places) {
            for place in 0..rows.places {
                let both = contrast_at(row, place, compared, rows.appearance).unwrap_or([NOWHERE; 2]);
                contrast.iter_mut().zip(both).for_each(|(all, own)| all.push(own));
            }
        }
        Self { rows, compared, row_contrast, contrast }
    }

    /// The likely pairs of borders, the one of most contrast first.
    fn pairs(&self) -> Vec<[PossibleBorder; 2]> {
        let [first, second] = [-1.0, 1.0].map(|side| self.borders(side));
        let mut pairs: Vec<[PossibleBorder; 2]> = Vec::new();
        for one in &first {
            let is_wide = |other: &&PossibleBorder| (0..2).all(|end| one.at[end] + other.at[end] > MIN_WIDTH);
            pairs.extend(second.iter().filter(is_wide).map(|other| [*one, *other]));
        }
        let contrast = |[one, other]: &[PossibleBorder; 2]| one.contrast + other.contrast;
        pairs.sort_by(|one, other| contrast(other).total_cmp(&contrast(one)));
        pairs.truncate(MAX_PAIRS);
        pairs
    }

    /// Contrast on one side (−1 or 1) in each row of a line, where it is in the picture.
    fn contrast_along(&self, side: f64, line: [f64; 2]) -> impl Iterator<Item = f32> + '_ {
        let [first, last] = line.map(|at| ((side * at + REACH.1) / self.rows.step + 0.5) as f32);
        let per_row = (last - first) / (ROWS - 1) as f32;
        let rows = self.contrast[usize::from(side > 0.0)].chunks_exact(self.rows.places).enumerate();
        let contrast = rows.map(move |(row, contrast)| contrast[(first + per_row * row as f32) as usize]);
        contrast.filter(|contrast| *contrast > NOWHERE)
    }

    /// Mean contrast of a line; `None` if half of it is outside the picture.
    fn mean_contrast(&self, side: f64, line: [f64; 2]) -> Option<f32> {
        let (least, most) = self.row_contrast;
        let limited = self.contrast_along(side, line).map(|contrast| contrast.clamp(least, most));
        let (sum, count) = limited.fold((0.0, 0), |(sum, count), contrast| (sum + contrast, count + 1));
        (2 * count > ROWS).then(|| sum / count as f32)
    }

    /// The possible borders on one side (−1 or 1), the one of most contrast first.
    fn borders(&self, side: f64) -> Vec<PossibleBorder> {
        let step = self.rows.step;
        let count = ((REACH.1 - REACH.0) / step) as usize;
        let tilt = (MAX_TILT / step) as usize;
        let at = |place: usize| REACH.0 + place as f64 * step;
        let mut lines: Vec<PossibleBorder> = Vec::new();
        for first in 0..count {
            for last in first.saturating_sub(tilt)..(first + tilt).min(count) {
                let line = [at(first), at(last)];
                lines.extend(self.mean_contrast(side, line).map(|contrast| PossibleBorder { at: line, contrast }));
            }
        }
        lines.sort_by(|one, other| other.contrast.total_cmp(&one.contrast));
        let mut kept: Vec<PossibleBorder> = Vec::new();
        for line in lines {
            let is_weak = kept.first().is_some_and(|best| line.contrast < MIN_SHARE * best.contrast);
            if is_weak || kept.len() == KEPT {
                break;
            }
            let is_new = !kept.iter().any(|other| self.is_same(other, &line));
            if is_new && self.is_supported(side, &line) {
                kept.push(line);
            }
        }
        kept
    }

    /// Do two lines follow the same edge in some row?
    fn is_same(&self, one: &PossibleBorder, other: &PossibleBorder) -> bool {
        let both_compared = 2.0 * self.compared as f64; // the edge of one shows in the rows of the other
        let [first, last] = [0, 1].map(|end| other.at[end] - one.at[end]);
        first.abs().min(last.abs()) < both_compared * self.rows.step || first * last < 0.0
    }

    /// Do enough rows show a step?
    fn is_supported(&self, side: f64, line: &PossibleBorder) -> bool {
        let (steps, rows) = self
            .contrast_along(side, line.at)
            .fold((0, 0), |(steps, rows), contrast| (steps + usize::from(contrast >= 1.0), rows + 1));
        steps as f64 >= MIN_SUPPORT * f64::from(rows)
    }
}

/// The codes of the frame and of the empty box at a place; `None` outside the picture.
fn codes_of(frame: &Frame<'_>, camera: &Camera, appearance: &ShaftAppearance, at: Normalised) -> Option<[[f32; 3]; 2]> {
    let pixel = camera.pixel_of(at);
    let (x, y) = (pixel.u().round(), pixel.v().round());
    if !(x >= 0.0 && y >= 0.0 && x < frame.width() as f64 && y < frame.height() as f64) {
        return None;
    }
    let (x, y) = (x as usize, y as usize);
    Some([frame.yuv_at(x, y).map(f32::from), appearance.background.usual_at(x, y)])
}

/// Contrast at a place of a row with these codes, for a border on the first and on the second side: between as many
/// places on both sides of it. `None` if some are outside the picture.
fn contrast_at(
    codes: &[Option<[[f32; 3]; 2]>],
    place: usize,
    compared: usize,
    appearance: &ShaftAppearance,
) -> Option<[f32; 2]> {
    let sides = codes.get(place.checked_sub(compared)?..place + compared)?;
    let [[before, box_before], [behind, box_behind]] =
        [mean_codes(&sides[..compared])?, mean_codes(&sides[compared..])?];
    Some([
        appearance.contrast_with_box(behind, before, box_before),
        appearance.contrast_with_box(before, behind, box_behind),
    ])
}

/// The mean codes of the frame and of the box; `None` if a place is outside the picture.
fn mean_codes(places: &[Option<[[f32; 3]; 2]>]) -> Option<[[f32; 3]; 2]> {
    let mut sum = [[0.0; 3]; 2];
    for codes in places {
        let codes = (*codes)?;
        sum = std::array::from_fn(|of| std::array::from_fn(|part| sum[of][part] + codes[of][part]));
    }
    Some(sum.map(|of| of.map(|part| part / places.len() as f32)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::camera::testing::STRAIGHT;
    use crate::vision::frame::{ColourEncoding, Matrix, Plane, Range};
    use crate::vision::segmentation::background::Background;
    use crate::vision::segmentation::cells::CellPicture;
    use crate::vision::segmentation::shaft_colour::{AnyColour, ShaftColour};
    use crate::vision::space::Pixel;

    /// The row of the shaft's middle, and the column of its end.
    const MIDDLE: f64 = 360.0;
    const END: f64 = 800.0;
    /// Half the shaft's width at its end and at the picture's rim, pixels.
    const HALVES: [f64; 2] = [20.0, 25.0];

    /// Calls `with` on a grey frame; `luma` is of the column, and of the distance from the middle in half widths of the
    /// shaft.
    fn with_frame<T>(luma: impl Fn(f64, f64) -> u8, with: impl Fn(&Frame<'_>) -> T) -> T {
        let (width, height) = (STRAIGHT.width as usize, STRAIGHT.height as usize);
        let code = |i: usize| {
            let (x, y) = ((i % width) as f64, (i / width) as f64);
            luma(x, (y - MIDDLE) / (HALVES[1] + (HALVES[0] - HALVES[1]) * x / END))
        };
        let codes: Vec<u8> = (0..width * height).map(code).collect();
        let grey = vec![128; width * height / 4];
        let plane = |data, width, height| Plane { data, stride: width, width, height };
        with(&Frame {
            index: 0,
            time_s: 0.0,
            y: plane(&codes, width, height),
            u: plane(&grey, width / 2, height / 2),
            v: plane(&grey, width / 2, height / 2),
            shift_x: 1,
            shift_y: 1,
            chroma_first_px: [0.5; 2],
            encoding: ColourEncoding { range: Range::Limited, matrix: Matrix::Bt709 },
        })
    }

    /// Distances of the likely borders from the middle at the end of a strip whose evidence reaches from `above` to
    /// `below` it, pixels, best pair first. The shaft has luma 40 and the empty box `mat`.
    fn found(mat: u8, luma: impl Fn(f64) -> u8, above: f64, below: f64) -> Vec<[f64; 2]> {
        found_in(mat, |_, at| luma(at), above, below)
    }

    /// The same where the luma changes from column to column.
    fn found_in(mat: u8, luma: impl Fn(f64, f64) -> u8, above: f64, below: f64) -> Vec<[f64; 2]> {
        likely(mat, luma, above, below, false).into_iter().map(|(borders, _)| borders).collect()
    }

    /// The same for sharp or for smeared borders, each pair with the width of its smear, pixels.
    fn likely(
        mat: u8,
        luma: impl Fn(f64, f64) -> u8,
        above: f64,
        below: f64,
        is_smeared: bool,
    ) -> Vec<([f64; 2], f64)> {
        let empty = with_frame(|_, _| mat, CellPicture::of);
        let shaft = ShaftColour::new(&[[40, 128, 128]; 50]).unwrap();
        let any = AnyColour::new([&empty]);
        let background = Background::from_frames(&[empty], &shaft, &any).unwrap();
        let appearance = ShaftAppearance { shaft, any, background };
        let at = |x: f64, y: f64| STRAIGHT.normalised_of(Pixel::new(x, y)).unwrap();
        let border = |y: f64| [0.0, END].map(|x| at(x, MIDDLE + y).0);
        let middle = MIDDLE + 0.5 * (below - above);
        let strip = Strip {
            borders: [border(-above), border(below)],
            entry: at(0.0, middle),
            end: at(END, middle),
            width: (above + below) / STRAIGHT.fx,
            length_widths: END / (above + below),
            score: 100.0,
            net_evidence: 1.0,
            supported_share: 1.0,
            end_step_codes: None,
        };
        let likely = with_frame(luma, |frame| {
            let rows = StripRows::read(frame, &STRAIGHT, &appearance, &strip);
            if is_smeared { rows.with_smeared_borders(0.0) } else { rows.with_sharp_borders() }
        });
        let row = |point: Point2<f64>| STRAIGHT.pixel_of(Normalised(point)).v() - MIDDLE;
        likely
            .iter()
            .map(|likely| (likely.strip.borders.map(|[_, end]| row(end)), likely.smear * STRAIGHT.fx))
            .collect()
    }

    /// Are these the shaft's borders, to the reach of the first probes?
    fn are_the_shafts(borders: &[f64; 2]) -> bool {
        let [first, second] = borders.map(f64::abs);
        (first - HALVES[0]).abs() < 3.0 && (second - HALVES[0]).abs() < 3.0 && borders[0] < 0.0
    }

    /// A luma that changes from one code to another over a stretch.
    fn ramp(at: f64, from: f64, to: f64, codes: (f64, f64)) -> u8 {
        (codes.0 + (codes.1 - codes.0) * ((at - from) / (to - from)).clamp(0.0, 1.0)) as u8
    }

    #[test]
    fn soft_shade_beside_a_shaft_is_outside_it() {
        let shaded = |at: f64| if at.abs() < 1.0 { 40 } else { ramp(at, 1.0, 3.5, (110.0, 200.0)) };
        let pairs = found(200, shaded, 22.0, 60.0);
        assert!(are_the_shafts(&pairs[0]), "{pairs:?}");
    }

    #[test]
    fn gloss_on_a_shaft_is_inside_it() {
        let glossy = |at: f64| match at {
            -0.5..0.0 => 110,
            -1.0..1.0 => 40,
            _ => 200,
        };
        for (above, below) in [(22.0, 22.0), (4.0, 22.0), (6.0, 22.0)] {
            let pairs = found(200, glossy, above, below);
            assert!(pairs.first().is_some_and(are_the_shafts), "{above} {below}: {pairs:?}");
        }
    }

    #[test]
    fn a_dark_part_between_highlights_before_a_dark_mat_is_no_shaft() {
        let glossy = |at: f64| match at {
            -0.4..0.5 => 40,
            -0.8..0.9 => 110,
            _ => 45,
        };
        assert_eq!(found(45, glossy, 9.0, 11.0), Vec::<[f64; 2]>::new());
    }

    #[test]
    fn a_line_that_few_rows_show_does_not_hide_a_weaker_border() {
        let printed = |x: f64, at: f64| match at.abs() {
            0.0..1.0 => 40,
            1.8.. if x > 625.0 => 200,
            _ => 55,
        };
        let pairs = found_in(200, printed, 20.0, 20.0);
        assert!(pairs.first().is_some_and(are_the_shafts), "{pairs:?}");
    }

    #[test]
    fn the_border_of_a_thin_shaft_is_not_that_of_the_shade_next_to_it() {
        let shaded = |at: f64| match at.abs() {
            0.0..0.4 => 40,
            0.4..0.7 => 100,
            _ => 200,
        };
        let pairs = found(200, shaded, 8.0, 8.0);
        let is_shaft = |borders: &[f64; 2]| borders.iter().all(|at| (at.abs() - 8.0).abs() < 2.0);
        assert!(pairs.iter().any(is_shaft), "{pairs:?}");
    }

    #[test]
    fn the_borders_of_a_fast_shaft_are_in_the_middle_of_their_smear() {
        for smear_px in [8.0, 12.0] {
            let half = 0.5 * smear_px / HALVES[0];
            let smeared = |_: f64, at: f64| ramp(at.abs(), 1.0 - half, 1.0 + half, (40.0, 200.0));
            let (borders, found_px) = likely(200, smeared, 24.0, 24.0, true)[0];
            assert!(are_the_shafts(&borders), "{borders:?}");
            assert!((found_px - smear_px).abs() < 0.3 * smear_px, "{found_px} for {smear_px}");
        }
        let sharp = |_: f64, at: f64| if at.abs() < 1.0 { 40 } else { 200 };
        let (borders, found_px) = likely(200, sharp, 24.0, 24.0, true)[0];
        assert!(are_the_shafts(&borders) && found_px < 3.0, "{borders:?} {found_px}");
    }

    #[test]
    fn the_width_of_a_smear_follows_from_the_contrast_over_two_distances() {
        let step = |at: f64, width: f64| (at / width + 0.5).clamp(0.0, 1.0);
        for width in [1.0, 4.0, 7.0, 15.0] {
            let contrast = |places: i32| {
                let mean = |side: f64| {
                    let fine = (0..100 * places).map(|i| step(side * (f64::from(i) + 0.5) / 100.0, width));
                    fine.sum::<f64>() / f64::from(100 * places)
                };
                mean(1.0) - mean(-1.0)
            };
            let found = smear_width(contrast(3) / contrast(10), [3.0, 10.0]);
            assert!((found - width).abs() < 0.02 * width, "{found} for {width}");
        }
    }

    #[test]
    fn a_shaft_as_dark_as_its_background_has_no_borders() {
        assert_eq!(found(48, |at| if at.abs() < 1.0 { 40 } else { 48 }, 22.0, 22.0), Vec::<[f64; 2]>::new());
    }
}
