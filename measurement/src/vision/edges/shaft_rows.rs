//! Reads the colours of a bare shaft in rows across it: just inside and outside both borders, and between them.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Point3, Vector2};

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
    let reader = RowReader { frame, camera, outline, is_visible };
    /// A shaft close to the camera is read in coarser rows.
    const MAX_ROWS: f64 = 1000.0;
    let Some(mm_per_px) = mm_per_px(camera, outline) else { return Vec::new() };
    let step_mm = (mm_per_px * step_px).max((from_mm - to_mm) / MAX_ROWS);
    let count = ((from_mm - to_mm) / step_mm) as usize;
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
    frame: &'a Frame<'a>,
    camera: &'a Camera,
    outline: &'a Outline,
    is_visible: V,
}

impl<V: Fn(Point3<f64>, Pixel) -> bool> RowReader<'_, V> {
    fn row(&self, back_mm: f64) -> ShaftRow {
        let beside = |sign: f64, px: f64| {
            let side = if sign < 0.0 { BorderSide::First } else { BorderSide::Second };
            self.beside(back_mm, side, px)
        };
        row_of(back_mm, |radii| self.on_shaft(back_mm, radii), beside)
    }

    fn on_shaft(&self, back_mm: f64, radii: f64) -> Option<Codes> {
        let place = self.outline.rim(back_mm, radii.asin() / FRAC_PI_2);
        let pixel = self.camera.project(CameraPoint(place))?;
        (self.is_visible)(place, pixel).then(|| codes_at(self.frame, pixel))?
    }

    fn beside(&self, back_mm: f64, side: BorderSide, outwards_px: f64) -> Option<Codes> {
        let place = self.outline.border(side, back_mm);
        let [border, opposite] =
            [place, self.outline.border(side.opposite(), back_mm)].map(|place| self.camera.project(CameraPoint(place)));
        let outward: Vector2<f64> = (border?.0 - opposite?.0).try_normalize(1e-9)?;
        let pixel = Pixel(border?.0 + outward * outwards_px);
        (self.is_visible)(place, pixel).then(|| codes_at(self.frame, pixel))?
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

/// The codes between the pixels' centres, linear in both directions; `None` outside the picture.
pub fn codes_at(frame: &Frame<'_>, at: Pixel) -> Option<Codes> {
    let [first_x, first_y] = frame.chroma_first_px.map(f64::from);
    let (wide, high) = (f64::from(1u32 << frame.shift_x), f64::from(1u32 << frame.shift_y));
    let chroma = |plane| between(plane, (at.u() - first_x) / wide, (at.v() - first_y) / high);
    let luma = between(&frame.y, at.u(), at.v())?;
    Some([luma, chroma(&frame.u)?, chroma(&frame.v)?])
}

fn between(plane: &Plane<'_>, x: f64, y: f64) -> Option<f64> {
    let is_inside = x >= 0.0 && y >= 0.0 && x < plane.width as f64 - 1.0 && y < plane.height as f64 - 1.0;
    if !is_inside {
        return None;
    }
    let (column, row) = (x as usize, y as usize);
    let (right, down) = (x - column as f64, y - row as f64);
    let code = |x: usize, y: usize| f64::from(plane.at(x, y));
    let above = code(column, row) * (1.0 - right) + code(column + 1, row) * right;
    let below = code(column, row + 1) * (1.0 - right) + code(column + 1, row + 1) * right;
    Some(above * (1.0 - down) + below * down)
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
