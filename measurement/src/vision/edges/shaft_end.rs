//! Finds where a bare shaft ends along its axis, also before jaws of its own colour (METHOD 3.6).
//!
//! **In** the colours in rows across the shaft. **Out** the distance of the tube's end behind the assumed tip, with its
//! standard deviation. **Method** Behind the end, the colour just inside a border is the shaft's; ahead of it the hinge
//! of the jaws is narrower, so the same place shows what lies beside the tool. Each row is compared with both. Where
//! the comparison turns on both borders, the tool's full width ends. A collar is as wide as the tube: its length is
//! taken off, unless the colour between the borders shows where the tube ends. **Gives up** if no place or more than
//! one is possible, if the shaft continues ahead of it, as it does beyond a thing that lies across it, or if no hinge
//! is seen.

use super::edge_model::EdgeModel;
use super::shaft_rows::{Codes, SeenBorder, ShaftRow, distance, mean_codes, median_distance, stripes};

/// The end of a shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShaftEnd {
    /// Distance of the tube's end behind the assumed tip, mm; negative ahead of it.
    pub back_mm: f64,
    /// Its standard deviation, mm.
    pub sigma_mm: f64,
}

/// Length of the piece whose colour is taken for the shaft's, diameters: as short as its noise allows, because light
/// changes along a shaft.
const COMPARED_DIAMETERS: f64 = 1.5;
/// Length of the shaft's last piece, diameters, which must look like the piece behind it.
const LAST_DIAMETERS: f64 = 0.5;
/// Length of the piece ahead of the end, diameters: shorter than a hinge.
const AHEAD_DIAMETERS: f64 = 0.65;
/// Least number of rows of a piece.
const MIN_ROWS: usize = 3;

/// Least mean support of a border that ends, nats a row: the odds are 3.5 to 1 in each row.
const MIN_NATS: f64 = 1.25;
/// The same if the other border shows nothing, because its surroundings look like the shaft.
const MIN_NATS_ALONE: f64 = 3.0;
/// Length ahead of the end where both borders may have a contrast, mm: open jaws may cross them, and so may a print.
const MAX_RESUMED_MM: f64 = 10.0;
/// Least mean distance of a hinge's colour from its surroundings, codes: three times the spread along a lit tube.
const MIN_HINGE_CODES: f64 = 15.0;
/// Length of the shaft behind its end that must have borders, diameters, and the least share of it that must: farther
/// than jaws, so that these do not pass for a shaft.
const LONG_DIAMETERS: f64 = 6.0;
const MIN_LONG_SHARE: f64 = 0.8;
/// Where the shaft must look as it does next to its end, diameters behind it, and the least mean support for it, nats.
const ALIKE_DIAMETERS: [f64; 2] = [2.0, 5.0];
const MIN_ALIKE_NATS: f64 = 1.0;
/// Step of the colour between the borders, codes, below which it is none and above which it is clear: one and a half
/// times the spread along a lit tube, and five times.
const STEP_CODES: (f64, f64) = (9.0, 30.0);
/// How far a step may lie from the end of the full width and from that of the tube, diameters. Shortly ahead of the
/// full width, open jaws show what lies behind them.
const HERE_DIAMETERS: f64 = 0.1;
const BEHIND_DIAMETERS: f64 = 0.4;
/// Largest distance between the ends of both borders, diameters.
const MAX_SKEW_DIAMETERS: f64 = 0.35;

/// Finds the end in rows across the shaft, the farthest behind first. `collar_mm` is the length of the collar, 0
/// without one.
pub fn locate(edges: &EdgeModel, rows: &[ShaftRow], diameter_mm: f64, collar_mm: f64) -> Option<ShaftEnd> {
    let finder = EndFinder::new(edges, rows, diameter_mm)?;
    let mut possible: Vec<EndPlace> = finder.places().into_iter().filter(|place| finder.is_end(place)).collect();
    if collar_mm == 0.0 {
        possible.retain(|place| finder.is_alike(place));
    }
    let place = match &possible[..] {
        [only] => only,
        [tube, collar] if collar_mm > 0.0 && finder.are_apart(tube, collar, collar_mm) => {
            return finder.measure(tube).filter(|_| finder.is_alike(tube));
        }
        _ => return None,
    };
    let full_width = finder.measure(place)?;
    if collar_mm == 0.0 {
        return Some(full_width);
    }
    let behind = Some(ShaftEnd { back_mm: full_width.back_mm + collar_mm, ..full_width });
    let steps = [(0.0, HERE_DIAMETERS), (collar_mm, BEHIND_DIAMETERS)];
    let [here, there] = steps.map(|(mm, within)| finder.step_near(full_width.back_mm + mm, within * diameter_mm));
    let (none, clear) = STEP_CODES;
    match (here?, there?) {
        (_, there) if there > clear => behind,
        (here, there) if here < none && there < none => behind,
        (here, there) if here > clear && there < none => Some(full_width).filter(|_| finder.is_alike(place)),
        _ => None,
    }
}

/// Does a hinge, or anything else narrower than the tool, differ from its surroundings ahead of a place, this far behind
/// the assumed tip (mm)? Where a thing lies across the tool, both have its colour.
pub fn shows_hinge(rows: &[ShaftRow], diameter_mm: f64, back_mm: f64) -> bool {
    /// Rows next to the end show both sides of it, blurred.
    const FROM_DIAMETERS: f64 = 0.1;
    let ahead = rows
        .iter()
        .filter(|row| (FROM_DIAMETERS * diameter_mm..AHEAD_DIAMETERS * diameter_mm).contains(&(back_mm - row.back_mm)));
    let apart: Vec<f64> = ahead.filter_map(hinge_codes).collect();
    apart.is_empty() || apart.iter().sum::<f64>() > MIN_HINGE_CODES * apart.len() as f64
}

/// Mean and standard deviation of codes.
#[derive(Clone, Copy, Debug)]
struct UsualCodes {
    mean: Codes,
    sigma: Codes,
}

impl UsualCodes {
    /// Of the places just inside a border.
    fn of(border: &[[Codes; 2]]) -> Option<Self> {
        /// Least standard deviation, codes: noise and compression.
        const MIN_SIGMA: f64 = 2.5;
        let count = border.len() as f64;
        let mean = mean_codes(border.iter().map(|[inside, _]| *inside))?;
        let variance: Codes = std::array::from_fn(|plane| {
            border.iter().map(|[inside, _]| (inside[plane] - mean[plane]).powi(2)).sum::<f64>() / count
        });
        Some(Self { mean, sigma: variance.map(|variance| variance.sqrt().max(MIN_SIGMA)) })
    }

    /// By how much a place just inside a border looks more like the shaft than like what lies outside, nats.
    fn support(&self, [inside, outside]: &[Codes; 2]) -> f64 {
        let from_shaft = sum_of_planes(|p| ((inside[p] - self.mean[p]) / self.sigma[p]).powi(2));
        0.5 * (self.distance_from_outside([inside, outside]) - from_shaft)
    }

    fn mean_support(&self, border: &[[Codes; 2]]) -> f64 {
        border.iter().map(|codes| self.support(codes)).sum::<f64>() / border.len() as f64
    }

    /// Does the place just inside a border differ from what lies outside?
    fn is_edge(&self, [inside, outside]: &[Codes; 2]) -> bool {
        self.distance_from_outside([inside, outside]) > 0.5 * MOST_SQUARES
    }

    fn distance_from_outside(&self, [inside, outside]: [&Codes; 2]) -> f64 {
        /// What lies outside changes along the border by this share of its contrast to the shaft.
        const UNEVEN: f64 = 0.25;
        let variance = |p: usize| self.sigma[p].powi(2) + (UNEVEN * (self.mean[p] - outside[p])).powi(2);
        sum_of_planes(|p| (inside[p] - outside[p]).powi(2) / variance(p))
    }
}

/// Limit of the sum of squared deviations, in standard deviations: other surfaces, and the texture of what lies
/// outside.
const MOST_SQUARES: f64 = 12.0;

/// Sum of the planes' squared deviations, limited.
#[inline(always)]
fn sum_of_planes(square_of: impl Fn(usize) -> f64) -> f64 {
    (square_of(0) + square_of(1) + square_of(2)).min(MOST_SQUARES)
}

/// How one border behaves at a place.
#[derive(Clone, Copy, Debug)]
struct BorderEnd {
    shaft: UsualCodes,
    /// Mean support for the shaft in the piece behind the place, and against it in the piece ahead, nats.
    nats: [f64; 2],
}

impl BorderEnd {
    fn least(&self) -> f64 {
        self.nats[0].min(self.nats[1])
    }

    /// Does this border show nothing?
    fn is_blind(&self) -> bool {
        self.nats.iter().all(|nats| nats.abs() < MIN_NATS)
    }
}

/// What the piece ahead of a place says about one border.
struct AheadOfEnd {
    shaft: UsualCodes,
    /// Mean support against the shaft, nats.
    nats: f64,
}

/// A place where the full width may end.
struct EndPlace {
    row: usize,
    borders: [BorderEnd; 2],
}

struct EndFinder<'a> {
    edges: &'a EdgeModel,
    rows: &'a [ShaftRow],
    seen: [SeenBorder; 2],
    step_mm: f64,
    diameter_mm: f64,
    compared: usize,
    last: usize,
    ahead: usize,
}

impl<'a> EndFinder<'a> {
    fn new(edges: &'a EdgeModel, rows: &'a [ShaftRow], diameter_mm: f64) -> Option<Self> {
        let step_mm = rows.first()?.back_mm - rows.get(1)?.back_mm;
        let count = |diameters: f64| ((diameters * diameter_mm / step_mm) as usize).max(MIN_ROWS);
        let [compared, last, ahead] = [COMPARED_DIAMETERS, LAST_DIAMETERS, AHEAD_DIAMETERS].map(count);
        let seen = [0, 1].map(|side| SeenBorder::of(rows, side));
        Some(Self { edges, rows, seen, step_mm, diameter_mm, compared, last, ahead })
    }

    /// The places where both borders may end: the best within a hinge's length of each.
    fn places(&self) -> Vec<EndPlace> {
        let near = (0.25 * self.diameter_mm / self.step_mm).max(3.0) as usize;
        let score = |row: usize| {
            let of_both = |borders: [BorderEnd; 2]| borders.iter().flat_map(|border| border.nats).sum::<f64>();
            self.borders_at(row).map_or(f64::NEG_INFINITY, of_both)
        };
        let is_best = |row: usize| (row.saturating_sub(near)..=row + near).all(|other| score(other) <= score(row));
        let possible = |row: usize| {
            if [0, 1].map(|side| self.ahead_at(side, row)).iter().flatten().all(|ahead| ahead.nats <= MIN_NATS) {
                return None; // as at most rows: neither border may end
            }
            let borders = self.borders_at(row)?;
            let [one, other] = borders;
            let both = one.least() > MIN_NATS && other.least() > MIN_NATS;
            let alone = |seen: BorderEnd, blind: BorderEnd| seen.least() > MIN_NATS_ALONE && blind.is_blind();
            (both || alone(one, other) || alone(other, one)).then_some(EndPlace { row, borders })
        };
        (0..self.rows.len()).filter_map(possible).filter(|place| is_best(place.row)).collect()
    }

    /// Is a place this far ahead of another, as both ends of a collar are that hardly differs from its surroundings?
    fn are_apart(&self, behind: &EndPlace, ahead: &EndPlace, mm: f64) -> bool {
        let apart_mm = (ahead.row - behind.row) as f64 * self.step_mm;
        (apart_mm - mm).abs() < BEHIND_DIAMETERS * self.diameter_mm
    }

    fn borders_at(&self, row: usize) -> Option<[BorderEnd; 2]> {
        let [one, other] = [0, 1].map(|side| self.border_at(side, row));
        Some([one?, other?])
    }

    fn border_at(&self, side: usize, row: usize) -> Option<BorderEnd> {
        let behind = self.seen[side].within(row.checked_sub(self.last)?..row)?;
        let AheadOfEnd { shaft, nats } = self.ahead_at(side, row)?;
        Some(BorderEnd { shaft, nats: [shaft.mean_support(behind), nats] })
    }

    fn ahead_at(&self, side: usize, row: usize) -> Option<AheadOfEnd> {
        let last = row.checked_sub(self.last)?;
        let compared = self.seen[side].within(last.checked_sub(self.compared)?..last)?;
        let ahead = self.seen[side].within(row + 1..row + 1 + self.ahead)?;
        let shaft = UsualCodes::of(compared)?;
        Some(AheadOfEnd { shaft, nats: -shaft.mean_support(ahead) })
    }

    /// Is there a hinge ahead of the place, and no more of the shaft?
    fn is_end(&self, place: &EndPlace) -> bool {
        let rows = &self.rows[place.row + 1..];
        if (rows.len() as f64) * self.step_mm < MAX_RESUMED_MM + AHEAD_DIAMETERS * self.diameter_mm {
            return false; // too few rows to see whether the shaft continues
        }
        // Steel is a tube, too, but not of the shaft's colour.
        let next =
            [0, 1].map(|side| mean_codes(rows[..self.ahead].iter().filter_map(|row| Some(row.borders[side]?[0]))));
        let is_tube = |row: &&ShaftRow| {
            (0..2).all(|side| {
                let (border, Some(codes)) = (&place.borders[side], row.borders[side]) else { return false };
                let is_shaft =
                    next[side].is_none_or(|next| distance(codes[0], border.shaft.mean) < distance(codes[0], next));
                is_shaft && border.shaft.is_edge(&codes)
            })
        };
        let resumed = rows.iter().filter(is_tube).count() as f64;
        let hinge: Vec<f64> = rows[..self.ahead].iter().filter_map(hinge_codes).collect();
        let hinge = hinge.iter().sum::<f64>() / f64::max(hinge.len() as f64, 1.0);
        resumed * self.step_mm <= MAX_RESUMED_MM && hinge > MIN_HINGE_CODES && self.is_long(place)
    }

    /// Do the borders that end here reach far behind the place, with a contrast to what lies outside?
    fn is_long(&self, place: &EndPlace) -> bool {
        let long = (LONG_DIAMETERS * self.diameter_mm / self.step_mm) as usize;
        let behind = &self.rows[place.row.saturating_sub(long)..place.row];
        let mut seen = place.borders.iter().enumerate().filter(|(_, border)| border.least() > MIN_NATS);
        seen.all(|(side, border)| {
            let codes: Vec<[Codes; 2]> = behind.iter().filter_map(|row| row.borders[side]).collect();
            let edges = codes.iter().filter(|codes| border.shaft.is_edge(codes)).count();
            edges as f64 > MIN_LONG_SHARE * codes.len() as f64
        })
    }

    /// Is the shaft far behind the place of the same colour as next to it? Jaws before something dark are not.
    fn is_alike(&self, place: &EndPlace) -> bool {
        let [from, to] = ALIKE_DIAMETERS
            .map(|diameters| place.row.saturating_sub((diameters * self.diameter_mm / self.step_mm) as usize));
        let mut seen = place.borders.iter().enumerate().filter(|(_, border)| border.least() > MIN_NATS);
        seen.all(|(side, border)| {
            let codes: Vec<[Codes; 2]> = self.rows[to..from].iter().filter_map(|row| row.borders[side]).collect();
            codes.iter().map(|codes| border.shaft.support(codes)).sum::<f64>() > MIN_ALIKE_NATS * codes.len() as f64
        })
    }

    /// Where the borders that show it end, to a fraction of a row.
    fn measure(&self, place: &EndPlace) -> Option<ShaftEnd> {
        /// Standard deviation, mm and rows: 0.20 mm in 208 frames of the even of 50 ray-traced recordings, with rows
        /// 0.2 to 0.6 mm apart, and 0.18 mm in 248 of the odd ones.
        const SIGMA_MM: f64 = 0.15;
        const SIGMA_ROWS: f64 = 0.5;
        let seen = (0..2).filter(|side| place.borders[*side].least() > MIN_NATS);
        let ends: Vec<f64> = seen.map(|side| self.crossing(side, place.row)).collect::<Option<_>>()?;
        let spread = ends.iter().fold(0.0, |most: f64, end| most.max((end - ends[0]).abs()));
        if spread > MAX_SKEW_DIAMETERS * self.diameter_mm {
            return None;
        }
        let count = ends.len() as f64;
        Some(ShaftEnd {
            back_mm: ends.iter().sum::<f64>() / count,
            sigma_mm: SIGMA_MM.hypot(SIGMA_ROWS * self.step_mm),
        })
    }

    /// Where the light just inside a border is halfway between that behind a row and that ahead of it.
    fn crossing(&self, side: usize, row: usize) -> Option<f64> {
        /// Rows that the blur may reach.
        const BLURRED: usize = 2;
        const NEAR: usize = 4;
        let light = |row: usize| Some(self.edges.light(self.rows.get(row)?.borders[side]?[0]));
        let level = |from: usize, to: usize| mean_codes((from..to).filter_map(light));
        let behind = level(row.saturating_sub(self.last.max(BLURRED + MIN_ROWS)), row.saturating_sub(BLURRED))?;
        let ahead = level(row + 1 + BLURRED, row + 1 + self.ahead.max(BLURRED + MIN_ROWS))?;
        let rise: Codes = std::array::from_fn(|part| ahead[part] - behind[part]);
        let all: f64 = rise.iter().map(|part| part * part).sum();
        let share = |row: usize| {
            let light = light(row)?;
            Some((0..3).map(|part| (light[part] - behind[part]) * rise[part]).sum::<f64>() / all)
        };
        (row.saturating_sub(NEAR)..row + NEAR).find_map(|row| {
            let (before, after) = (share(row)?, share(row + 1)?);
            let is_crossed = before <= 0.5 && after > 0.5;
            is_crossed.then(|| self.rows[row].back_mm - (0.5 - before) / (after - before) * self.step_mm)
        })
    }

    /// The greatest step of the colour between the borders near a place, codes: the median of three stripes.
    fn step_near(&self, back_mm: f64, within_mm: f64) -> Option<f64> {
        let within_mm = within_mm.max(0.5 * self.step_mm);
        let rows = 0..self.rows.len();
        let near = rows.filter(|row| (self.rows[*row].back_mm - back_mm).abs() <= within_mm);
        near.filter_map(|row| self.step_at(row)).max_by(f64::total_cmp)
    }

    fn step_at(&self, row: usize) -> Option<f64> {
        let behind = self.rows.get(row.checked_sub(self.last)?..row)?;
        let ahead = self.rows.get(row + 1..row + 1 + self.last)?;
        Some(median_distance(&stripes(behind)?, &stripes(ahead)?))
    }
}

/// Mean distance of the colours between the borders from what lies outside them, codes.
fn hinge_codes(row: &ShaftRow) -> Option<f64> {
    let [[_, one], [_, other]] = [row.borders[0]?, row.borders[1]?];
    let seen = row.inside.iter().flatten();
    let apart: Vec<f64> = seen.map(|codes| distance(*codes, one).min(distance(*codes, other))).collect();
    (!apart.is_empty()).then(|| apart.iter().sum::<f64>() / apart.len() as f64)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;
    use crate::vision::camera::testing::STRAIGHT as CAMERA;
    use crate::vision::edges::edge_model::Likeness;
    use crate::vision::edges::shaft_rows;
    use crate::vision::frame::{ColourEncoding, Frame, Matrix, Plane, Range};
    use crate::vision::segmentation::samples::UsualColour;
    use crate::vision::tube::Tube;

    const ENCODING: ColourEncoding = ColourEncoding { range: Range::Limited, matrix: Matrix::Bt709 };
    const RADIUS_MM: f64 = 2.5;
    const COLLAR_MM: f64 = 8.0;
    const BLACK: f64 = 45.0;
    const STEEL: f64 = 130.0;

    /// A piece of a tool: distances of its ends ahead of the tube's end, mm, radius, mm, and luma.
    #[derive(Clone, Copy)]
    struct DrawnPiece(f64, f64, f64, f64);

    /// A black tube with a collar of this length and luma, a hinge, and closed jaws.
    fn tool(collar_mm: f64, collar: f64, jaws: f64) -> Vec<DrawnPiece> {
        let hinge_mm = collar_mm + 4.0;
        vec![
            DrawnPiece(-150.0, 0.0, RADIUS_MM, BLACK),
            DrawnPiece(0.0, collar_mm, 0.96 * RADIUS_MM, collar),
            DrawnPiece(collar_mm, hinge_mm, 0.74 * RADIUS_MM, jaws),
            DrawnPiece(hinge_mm, hinge_mm + 16.0, 0.3 * RADIUS_MM, jaws),
        ]
    }

    /// A tube that leans away from the camera.
    fn tube() -> Tube {
        Tube { tip: Point3::new(10.0, 0.0, 180.0), axis: Vector3::new(0.8, 0.0, 0.6), radius: RADIUS_MM }
    }

    /// The luma of the piece that a ray meets first.
    fn luma_of(pieces: &[DrawnPiece], ray: &Vector3<f64>) -> Option<f64> {
        let Tube { tip, axis, .. } = tube();
        let flat = |vector: Vector3<f64>| vector - axis * axis.dot(&vector);
        let (towards, from) = (flat(*ray), flat(-tip.coords));
        let half = towards.dot(&from) / towards.norm_squared();
        let met = pieces.iter().filter_map(|DrawnPiece(begin, end, radius, luma)| {
            let inside = half * half - (from.norm_squared() - radius * radius) / towards.norm_squared();
            let depth = (inside >= 0.0).then(|| -half - inside.sqrt())?;
            let ahead = (ray * depth - tip.coords).dot(&axis);
            (ahead >= *begin && ahead < *end).then_some((depth, luma + 0.1 * ahead))
        });
        met.min_by(|one, other| one.0.total_cmp(&other.0)).map(|(_, luma)| luma)
    }

    /// Draws the tool before a board with a print; `bar` hides it between two columns.
    fn draw(pieces: &[DrawnPiece], bar: Option<[usize; 2]>) -> Vec<u8> {
        const FINE: usize = 4;
        let (width, height) = (CAMERA.width as usize, CAMERA.height as usize);
        let mut luma = vec![0; width * height];
        for (place, code) in luma.iter_mut().enumerate() {
            let (x, y) = (place % width, place / width);
            let board = 170.0 + 12.0 * (x as f64 / 9.0).sin() * (y as f64 / 7.0).cos();
            let sample = |part: usize| {
                let at = |pixel: usize, part: usize| pixel as f64 + (part as f64 + 0.5) / FINE as f64 - 0.5;
                let (x, y) = (at(x, part % FINE), at(y, part / FINE));
                let ray = Vector3::new((x - CAMERA.cx) / CAMERA.fx, (y - CAMERA.cy) / CAMERA.fy, 1.0);
                luma_of(pieces, &ray).unwrap_or(board)
            };
            let is_hidden = bar.is_some_and(|[from, to]| (from..to).contains(&x));
            let is_near = !is_hidden && y.abs_diff(height / 2) < 40;
            let mean = if is_near { (0..FINE * FINE).map(sample).sum::<f64>() / (FINE * FINE) as f64 } else { board };
            *code = mean.round() as u8;
        }
        luma
    }

    /// The tip found from a tip that is assumed this far ahead of the true one: its distance ahead of the true one, and
    /// its standard deviation, mm.
    fn found(pieces: &[DrawnPiece], bar: Option<[usize; 2]>, collar_mm: f64, assumed_mm: f64) -> Option<(f64, f64)> {
        let usual = UsualColour { codes: [BLACK, 128.0, 128.0], luma_spread: 6.0, chroma_spread: 3.0 };
        let edges = EdgeModel::new(usual, Likeness::AllPlanes, ENCODING);
        let luma = draw(pieces, bar);
        let chroma = vec![128; luma.len()];
        let plane = |data| Plane { data, stride: 1280, width: 1280, height: 720 };
        let frame = Frame {
            index: 0,
            time_s: 0.0,
            y: plane(&luma),
            u: plane(&chroma),
            v: plane(&chroma),
            shift_x: 0,
            shift_y: 0,
            chroma_first_px: [0.0; 2],
            encoding: ENCODING,
        };
        let tube = Tube { tip: tube().tip + tube().axis * assumed_mm, ..tube() };
        let rows = shaft_rows::read(&frame, &CAMERA, &tube.outline()?, [70.0, -35.0], 1.2, |_, _| true);
        let end = locate(&edges, &rows, 2.0 * RADIUS_MM, collar_mm)?;
        Some((assumed_mm - end.back_mm, end.sigma_mm))
    }

    #[track_caller]
    fn assert_at_end(found: Option<(f64, f64)>) {
        let (off_mm, sigma_mm) = found.expect("an end");
        assert!(off_mm.abs() < 2.0 * sigma_mm && sigma_mm < 0.4, "off by {off_mm} mm ± {sigma_mm}");
    }

    #[test]
    fn a_black_tube_ends_where_black_jaws_are_narrower() {
        for assumed_mm in [-8.0, 0.0, 18.0] {
            assert_at_end(found(&tool(0.0, BLACK, BLACK), None, 0.0, assumed_mm));
        }
    }

    #[test]
    fn the_length_of_a_black_collar_is_taken_off() {
        assert_at_end(found(&tool(COLLAR_MM, BLACK, BLACK), None, COLLAR_MM, 5.0));
    }

    #[test]
    fn a_steel_collar_is_found_though_it_is_as_wide_as_the_tube() {
        assert_at_end(found(&tool(COLLAR_MM, STEEL, STEEL), None, COLLAR_MM, 5.0));
    }

    #[test]
    fn a_steel_collar_that_looks_like_the_board_is_not_taken_off_twice() {
        assert_at_end(found(&tool(COLLAR_MM, 145.0, STEEL), None, COLLAR_MM, 5.0));
    }

    #[test]
    fn a_collar_that_may_begin_here_or_there_has_no_end() {
        let dim = BLACK + 18.0;
        assert_eq!(found(&tool(COLLAR_MM, dim, dim), None, COLLAR_MM, 5.0), None);
    }

    #[test]
    fn a_hidden_part_of_a_hinge_is_not_as_bright_as_its_surroundings() {
        let [board, hinge] = [[170.0, 128.0, 128.0], [130.0, 128.0, 128.0]];
        let row = ShaftRow { back_mm: 0.0, borders: [Some([board, board]); 2], inside: [Some(hinge), None, None] };
        assert_eq!(hinge_codes(&row), Some(40.0));
        assert_eq!(hinge_codes(&ShaftRow { inside: [None; 3], ..row }), None);
    }

    #[test]
    fn a_shaft_does_not_end_at_a_thing_that_lies_across_it() {
        let tip_px = 690;
        let bar = Some([tip_px - 100, tip_px - 84]);
        assert_at_end(found(&tool(0.0, BLACK, BLACK), bar, 0.0, 0.0));
        assert_eq!(found(&[DrawnPiece(-150.0, 150.0, RADIUS_MM, BLACK)], bar, 0.0, 0.0), None);
    }
}
