//! Reads the colours of a bare shaft in rows across it: just inside and outside both borders, and between them.

use std::f64::consts::FRAC_PI_2;
use std::ops::Range;

use nalgebra::{Point3, Vector2, Vector3};

use crate::vision::camera::Camera;
use crate::vision::frame::{Frame, Plane};
use crate::vision::space::{CameraPoint, Pixel};
use crate::vision::tube::{BorderSide, Outline};

/// Codes Y, U, V.
pub type Codes = [f64; 3];

/// One row across a shaft. A part is `None` where it is hidden or outside the picture.
#[derive(Clone, Copy, Debug)]
pub struct ShaftRow {
    /// Distance behind the tip, mm.
    pub back_mm: f64,
    /// Just inside each border, and just outside it.
    pub borders: [Option<[Codes; 2]>; 2],
    /// Three stripes between the borders.
    pub inside: [Option<Codes>; 3],
}

/// Places just inside a border, radii from the middle: outside the hinge of jaws, whose radius is three quarters of the
/// tube's, and inside a collar, which is a few hundredths narrower than the tube.
const JUST_INSIDE: [f64; 3] = [0.80, 0.86, 0.92];
/// Places in the three stripes.
const STRIPES: [[f64; 3]; 3] = [[-0.6, -0.5, -0.4], [-0.1, 0.0, 0.1], [0.4, 0.5, 0.6]];
/// Places just outside a border, pixels beyond it: past the blur of the lens and of halved chroma.
const JUST_OUTSIDE_PX: [f64; 3] = [2.0, 3.0, 4.0];

/// The rows from `from_mm` behind the tip to `to_mm`, about `step_px` apart, the farthest behind first.
pub fn read(
    frame: &Frame<'_>,
    camera: &Camera,
    outline: &Outline,
    [from_mm, to_mm]: [f64; 2],
    step_px: f64,
    is_visible: impl Fn(Point3<f64>, Pixel) -> bool,
) -> Vec<ShaftRow> {
    /// A shaft close to the camera is read in coarser rows.
    const MAX_ROWS: f64 = 1000.0;
    let Some(mm_per_px) = mm_per_px(camera, outline) else { return Vec::new() };
    let step_mm = (mm_per_px * step_px).max((from_mm - to_mm) / MAX_ROWS);
    let count = ((from_mm - to_mm) / step_mm) as usize;
    let reader = RowReader::new(frame, camera, outline, is_visible);
    (0..=count).map(|i| reader.row(from_mm - i as f64 * step_mm)).collect()
}

/// Millimetres along the axis per pixel, at the tip.
pub fn mm_per_px(camera: &Camera, outline: &Outline) -> Option<f64> {
    const APART_MM: f64 = 2.0;
    let pixel = |back_mm: f64| camera.project(CameraPoint(outline.rim(back_mm, 0.0)));
    let apart_px = (pixel(APART_MM)?.0 - pixel(0.0)?.0).norm();
    (apart_px > 1e-3).then(|| APART_MM / apart_px)
}

struct RowReader<'a, V> {
    codes: CodeReader<'a>,
    camera: &'a Camera,
    outline: &'a Outline,
    is_visible: V,
    /// From the axis to the places just inside each border, mm.
    just_inside: [[Vector3<f64>; 3]; 2],
    /// From the axis to those in the three stripes, mm.
    stripes: [[Vector3<f64>; 3]; 3],
}

impl<'a, V: Fn(Point3<f64>, Pixel) -> bool> RowReader<'a, V> {
    fn new(frame: &'a Frame<'a>, camera: &'a Camera, outline: &'a Outline, is_visible: V) -> Self {
        let from_axis = |radii: f64| outline.from_axis(radii.asin() / FRAC_PI_2);
        Self {
            codes: CodeReader::new(frame),
            camera,
            outline,
            is_visible,
            just_inside: [-1.0, 1.0].map(|side| JUST_INSIDE.map(|radii| from_axis(side * radii))),
            stripes: STRIPES.map(|stripe| stripe.map(from_axis)),
        }
    }

    fn row(&self, back_mm: f64) -> ShaftRow {
        let on_axis = self.outline.on_axis(back_mm);
        let on_shaft = |from_axis: [Vector3<f64>; 3]| self.mean_on_shaft(on_axis, from_axis);
        let places = BorderSide::BOTH.map(|side| self.outline.border(side, back_mm));
        let [first, second] = places.map(|place| self.camera.project(CameraPoint(place)));
        let beside = [self.beside(places[0], first, second), self.beside(places[1], second, first)];
        let borders = [0, 1].map(|side| Some([on_shaft(self.just_inside[side])?, beside[side]?]));
        ShaftRow { back_mm, borders, inside: self.stripes.map(on_shaft) }
    }

    /// The mean colour of three places, each so far from a point of the axis.
    fn mean_on_shaft(&self, on_axis: Point3<f64>, from_axis: [Vector3<f64>; 3]) -> Option<Codes> {
        let mut sum = [0.0; 3];
        for from_axis in from_axis {
            let place = on_axis + from_axis;
            self.add_codes(place, self.camera.project(CameraPoint(place))?, &mut sum)?;
        }
        Some(sum.map(|sum| sum / from_axis.len() as f64))
    }

    /// The mean colour just outside a place of a border; both borders are given as they are seen.
    fn beside(&self, place: Point3<f64>, border: Option<Pixel>, opposite: Option<Pixel>) -> Option<Codes> {
        let (border, opposite) = (border?.0, opposite?.0);
        let outward: Vector2<f64> = (border - opposite).try_normalize(1e-9)?;
        let mut sum = [0.0; 3];
        for px in JUST_OUTSIDE_PX {
            self.add_codes(place, Pixel(border + outward * px), &mut sum)?;
        }
        Some(sum.map(|sum| sum / JUST_OUTSIDE_PX.len() as f64))
    }

    /// Adds the codes of a place that is seen at a pixel; `None` if it is hidden.
    #[inline(always)]
    fn add_codes(&self, place: Point3<f64>, at: Pixel, sum: &mut Codes) -> Option<()> {
        let codes = if (self.is_visible)(place, at) { self.codes.at(at)? } else { return None };
        sum.iter_mut().zip(codes).for_each(|(sum, code)| *sum += code);
        Some(())
    }
}

/// The row at a distance behind the tip. `on_shaft` has the codes at a distance from the middle, radii, and `beside`
/// those this many pixels beyond the first (−1) or second (1) border.
pub fn row_of(
    back_mm: f64,
    on_shaft: impl Fn(f64) -> Option<Codes>,
    beside: impl Fn(f64, f64) -> Option<Codes>,
) -> ShaftRow {
    let borders = [-1.0, 1.0].map(|sign| {
        let inside = mean(JUST_INSIDE.map(|radii| on_shaft(sign * radii)))?;
        Some([inside, mean(JUST_OUTSIDE_PX.map(|px| beside(sign, px)))?])
    });
    let inside = STRIPES.map(|stripe| mean(stripe.map(&on_shaft)));
    ShaftRow { back_mm, borders, inside }
}

/// The mean of all codes; `None` if one is missing.
pub fn mean<const N: usize>(codes: [Option<Codes>; N]) -> Option<Codes> {
    let mut sum = [0.0; 3];
    for codes in codes {
        let codes = codes?;
        sum = std::array::from_fn(|plane| sum[plane] + codes[plane]);
    }
    Some(sum.map(|sum| sum / N as f64))
}

/// Reads codes between the pixels' centres, linear in both directions.
struct CodeReader<'a> {
    frame: &'a Frame<'a>,
    /// Position of the first chroma sample, pixels of luma.
    first: [f64; 2],
    /// Chroma samples per pixel of luma.
    per_px: [f64; 2],
}

impl<'a> CodeReader<'a> {
    fn new(frame: &'a Frame<'a>) -> Self {
        let per_px = [frame.shift_x, frame.shift_y].map(|shift| 1.0 / f64::from(1u32 << shift));
        Self { frame, first: frame.chroma_first_px.map(f64::from), per_px }
    }

    /// The codes at a place; `None` outside the picture.
    #[inline(always)]
    fn at(&self, at: Pixel) -> Option<Codes> {
        let [luma] = between([&self.frame.y], at.u(), at.v())?;
        let (x, y) = ((at.u() - self.first[0]) * self.per_px[0], (at.v() - self.first[1]) * self.per_px[1]);
        let [blue, red] = between([&self.frame.u, &self.frame.v], x, y)?;
        Some([luma, blue, red])
    }
}

/// The codes between the pixels' centres, linear in both directions; `None` outside the picture.
pub fn codes_at(frame: &Frame<'_>, at: Pixel) -> Option<Codes> {
    CodeReader::new(frame).at(at)
}

/// The codes of planes of one size between four samples.
#[inline(always)]
fn between<const N: usize>(planes: [&Plane<'_>; N], x: f64, y: f64) -> Option<[f64; N]> {
    let (width, height) = (planes[0].width as f64, planes[0].height as f64);
    if !(x >= 0.0 && y >= 0.0 && x < width - 1.0 && y < height - 1.0) {
        return None;
    }
    let (column, row) = (x as u32, y as u32); // `floor` is a call
    let (right, down) = (x - f64::from(column), y - f64::from(row));
    let (column, row) = (column as usize, row as usize);
    Some(planes.map(|plane| {
        let line = |row: usize| {
            let pair = &plane.data[row * plane.stride + column..][..2];
            f64::from(pair[0]) * (1.0 - right) + f64::from(pair[1]) * right
        };
        line(row) * (1.0 - down) + line(row + 1) * down
    }))
}

/// One border in the rows that show it.
pub struct SeenBorder {
    codes: Vec<[Codes; 2]>,
    /// How many of the rows before a row show it; the last number is that before the end.
    before: Vec<usize>,
}

impl SeenBorder {
    /// The border of this side.
    pub fn of(rows: &[ShaftRow], side: usize) -> Self {
        let (mut codes, mut before) = (Vec::with_capacity(rows.len()), Vec::with_capacity(rows.len() + 1));
        for row in rows {
            before.push(codes.len());
            codes.extend(row.borders[side]);
        }
        before.push(codes.len());
        Self { codes, before }
    }

    /// The border in these rows; `None` if there are no such rows, or if a third of them do not show it.
    pub fn within(&self, rows: Range<usize>) -> Option<&[[Codes; 2]]> {
        let seen = &self.codes[*self.before.get(rows.start)?..*self.before.get(rows.end)?];
        (3 * seen.len() >= 2 * rows.len()).then_some(seen)
    }
}

/// Mean colour; `None` of none.
pub fn mean_codes(codes: impl Iterator<Item = Codes>) -> Option<Codes> {
    let (count, sum) = codes.fold((0.0, [0.0; 3]), |(count, sum): (f64, Codes), codes| {
        (count + 1.0, std::array::from_fn(|part| sum[part] + codes[part]))
    });
    (count > 0.0).then(|| sum.map(|sum| sum / count))
}

/// The mean colours of the three stripes in some rows; `None` if one is hidden in most of them.
pub fn stripes(rows: &[ShaftRow]) -> Option<[Codes; 3]> {
    let mut means = [[0.0; 3]; 3];
    for (stripe, mean) in means.iter_mut().enumerate() {
        let seen = || rows.iter().filter_map(|row| row.inside[stripe]);
        *mean = mean_codes(seen()).filter(|_| 2 * seen().count() >= rows.len())?;
    }
    Some(means)
}

/// Distance between the colours of three stripes, codes: the median.
pub fn median_distance(one: &[Codes; 3], other: &[Codes; 3]) -> f64 {
    let mut distances: [f64; 3] = std::array::from_fn(|stripe| distance(one[stripe], other[stripe]));
    distances.sort_by(f64::total_cmp);
    distances[1]
}

/// Distance between two colours, codes.
pub fn distance(one: Codes, other: Codes) -> f64 {
    one.iter().zip(other).map(|(one, other)| (one - other).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::camera::testing::wide;
    use crate::vision::frame::{ColourEncoding, Matrix, Range as CodeRange};
    use crate::vision::tube::Tube;

    #[test]
    fn a_row_has_the_codes_of_the_pixels_that_show_its_places() {
        let camera = wide();
        let (width, height) = (camera.width as usize, camera.height as usize);
        let luma: Vec<u8> = (0..width * height).map(|i| ((i % width) / 8 + (i / width) / 16) as u8).collect();
        let blue: Vec<u8> = (0..width * height / 4).map(|i| ((i % (width / 2)) / 4) as u8).collect();
        let red: Vec<u8> = (0..width * height / 4).map(|i| ((i / (width / 2)) / 2) as u8).collect();
        let half = |data| Plane { data, stride: width / 2, width: width / 2, height: height / 2 };
        let frame = Frame {
            index: 0,
            time_s: 0.0,
            y: Plane { data: &luma, stride: width, width, height },
            u: half(&blue),
            v: half(&red),
            shift_x: 1,
            shift_y: 1,
            chroma_first_px: [0.0, 0.5],
            encoding: ColourEncoding { range: CodeRange::Limited, matrix: Matrix::Bt709 },
        };
        let axis = Vector3::new(0.8, 0.3, -0.5).normalize();
        let outline = Tube { tip: Point3::new(10.0, 5.0, 120.0), axis, radius: 2.5 }.outline().unwrap();
        let rows = read(&frame, &camera, &outline, [40.0, -20.0], 2.0, |_, _| true);
        assert!(rows.len() > 100);
        for row in &rows {
            // One code is 8 or 16 pixels wide, so its place is known to less than a code.
            let expect = |codes: Option<Codes>, at: Pixel| {
                let [luma, blue, red] = codes.unwrap();
                assert!((luma - (at.u() / 8.0 + at.v() / 16.0) + 0.9).abs() < 1.1, "{luma} at {at:?}");
                assert!((blue - at.u() / 8.0 + 0.5).abs() < 0.8, "{blue} at {at:?}");
                assert!((red - at.v() / 4.0 + 0.5).abs() < 0.8, "{red} at {at:?}");
            };
            let seen = |place| camera.project(CameraPoint(place)).unwrap();
            expect(row.inside[1], seen(outline.rim(row.back_mm, 0.0)));
            let places = BorderSide::BOTH.map(|side| seen(outline.border(side, row.back_mm)));
            for (side, sign) in [(0, -1.0), (1, 1.0)] {
                let [inside, outside] = row.borders[side].unwrap();
                let outward = (places[side].0 - places[1 - side].0).normalize();
                expect(Some(outside), Pixel(places[side].0 + outward * 3.0));
                expect(Some(inside), seen(outline.rim(row.back_mm, sign * 0.86f64.asin() / FRAC_PI_2)));
            }
        }
    }

    #[test]
    fn a_border_that_a_third_of_the_rows_hide_is_not_seen_in_them() {
        let row = |i: usize| ShaftRow {
            back_mm: 0.0,
            borders: [(i % 3 != 1).then_some([[i as f64; 3]; 2]), None],
            inside: [None; 3],
        };
        let rows: Vec<ShaftRow> = (0..9).map(row).collect();
        let [one, other] = [0, 1].map(|side| SeenBorder::of(&rows, side));
        let first = |rows: Range<usize>| one.within(rows).map(|codes| (codes.len(), codes[0][0][0]));
        assert_eq!(first(3..9), Some((4, 3.0)));
        assert_eq!([first(3..5), first(8..10)], [None, None], "one of two is hidden, and one row is none");
        assert!(other.within(0..9).is_none());
    }
}
