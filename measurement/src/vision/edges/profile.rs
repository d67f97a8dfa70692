//! Profiles of the planes across a chord: raw pixels, averaged in narrow bins by their distance from the chord.
//!
//! Nothing is resampled: a bin holds whole pixels and their mean distance, so its noise is that of their mean. If the
//! edge bends along the chord, distances are measured from the bent line.

use super::lanes::{LANES, Lanes};
use super::probe::Probe;
use crate::vision::frame::{Frame, Plane};

/// Maximum number of bins of a profile.
pub const MAX_BINS: usize = 48;
/// Usual width of a bin, in pixels of the plane.
const BIN_PX: f64 = 0.5;
/// Maximum factor of a wider bin.
const MAX_WIDENING: f64 = 1.5;
/// A plane of half the resolution gets a window wider by this factor: three of its pixels cannot show both sides of an
/// edge.
const COARSE_PLANE_REACH: f64 = 1.25;

/// The profile of planes of one size across a chord.
#[derive(Clone, Copy)]
pub struct Profile<const N: usize> {
    distances: [f32; MAX_BINS],
    values: [[f32; MAX_BINS]; N],
    pixels: [f32; MAX_BINS],
    /// Number of bins in use.
    len: usize,
    /// Number of pixels in all bins.
    pub count: f32,
    /// Squared deviations of each plane's pixels from their bin's mean, summed.
    pub scatter: [f32; N],
}

impl<const N: usize> Profile<N> {
    /// Number of bins in use.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Mean outward distance of the pixels in [`LANES`] bins from `bin` on, pixels of luma.
    #[inline(always)]
    pub fn distances(&self, bin: usize) -> Lanes {
        lanes(&self.distances, bin)
    }

    /// Mean code of one plane in each of these bins.
    #[inline(always)]
    pub fn values(&self, plane: usize, bin: usize) -> Lanes {
        lanes(&self.values[plane], bin)
    }

    /// Number of pixels in each of these bins; 0 beyond the last bin.
    #[inline(always)]
    pub fn pixels(&self, bin: usize) -> Lanes {
        lanes(&self.pixels, bin)
    }

    /// Per bin: mean distance, number of pixels, and mean code of one plane.
    pub fn bins(&self, plane: usize) -> impl Iterator<Item = (f32, f32, f32)> {
        let values = self.values[plane].iter();
        let bins = self.distances.iter().zip(&self.pixels).zip(values).take(self.len);
        bins.map(|((distance, pixels), value)| (*distance, *pixels, *value))
    }

    /// Collects the pixels of the parallelogram that the chord covers when moved through its window: row by row if the
    /// chord is upright, else column by column. `shift` halves the planes' size this many times.
    #[inline(always)]
    fn gather(planes: [&Plane<'_>; N], shift: (u8, u8), first_px: [f32; 2], probe: &Probe) -> Self {
        let scale = [f64::from(1u32 << shift.0), f64::from(1u32 << shift.1)];
        let first = first_px.map(f64::from);
        let sizes = [planes[0].width, planes[0].height];
        let middle = [probe.middle.u(), probe.middle.v()];
        let normal = [probe.outward.x, probe.outward.y];
        let run = if normal[0].abs() >= normal[1].abs() { 0 } else { 1 }; // the direction across the chord
        let rows = 1 - run;
        let wider = if scale[run] > 1.0 { COARSE_PLANE_REACH } else { 1.0 };
        let (inwards, outwards) = (probe.inwards_px * wider, probe.outwards_px * wider);
        // `across`: distance from the chord. `beside`: distance from the line through its middle along the window.
        let lean = if run == 0 { probe.lean } else { -probe.lean };
        let across_by = [normal[run], normal[rows]]; // per pixel along a row, and per row
        let beside_by = [-normal[rows] - lean * normal[run], normal[run] - lean * normal[rows]];
        let rows_by_across = -beside_by[0];
        let (inmost, outmost) = ordered(-inwards * rows_by_across, outwards * rows_by_across);
        let half_rows = probe.half_length_px * normal[run].abs();
        let whole = |at: f64, size: usize| (at.ceil().max(0.0) as usize).min(size);
        let row_of = |at: f64| whole((at + middle[rows] - first[rows]) / scale[rows], sizes[rows]);
        let column_of = |at: f64| whole((at + middle[run] - first[run]) / scale[run], sizes[run]);
        let (across_step, beside_step) = ((scale[run] * across_by[0]) as f32, (scale[run] * beside_by[0]) as f32);
        let bend_per_px = probe.bend_per_px as f32;
        let mut bins = Bins::<N>::covering(inwards, outwards, BIN_PX * scale[run]);
        for row in row_of(inmost - half_rows)..row_of(outmost + half_rows) {
            let down = row as f64 * scale[rows] + first[rows] - middle[rows];
            let window = within(-inwards, outwards, down * across_by[1], across_by[0]);
            let chord = within(-probe.half_length_px, probe.half_length_px, down * beside_by[1], beside_by[0]);
            let (from, to) = (column_of(window.0.max(chord.0)), column_of(window.1.min(chord.1)));
            let along = from as f64 * scale[run] + first[run] - middle[run];
            let mut across = (down * across_by[1] + along * across_by[0]) as f32;
            let mut beside = (down * beside_by[1] + along * beside_by[0]) as f32;
            for column in from..to {
                let (x, y) = if run == 0 { (column, row) } else { (row, column) };
                let mut values = [0.0; N];
                for (value, plane) in values.iter_mut().zip(planes) {
                    *value = f32::from(plane.at(x, y));
                }
                bins.add(across - bend_per_px * beside * beside, values);
                across += across_step;
                beside += beside_step;
            }
        }
        bins.means()
    }
}

/// The luma profile across a chord.
#[multiversion::multiversion(targets("x86_64+avx2"))]
pub fn of_luma(frame: &Frame<'_>, probe: &Probe) -> Profile<1> {
    Profile::gather([&frame.y], (0, 0), [0.0; 2], probe)
}

/// The profile of both chroma planes across a chord, whose samples lie `right_px` farther right than the frame says.
#[multiversion::multiversion(targets("x86_64+avx2"))]
pub fn of_chroma(frame: &Frame<'_>, right_px: f32, probe: &Probe) -> Profile<2> {
    let [first_x, first_y] = frame.chroma_first_px;
    Profile::gather([&frame.u, &frame.v], (frame.shift_x, frame.shift_y), [first_x + right_px, first_y], probe)
}

/// The range of `x` where `start + slope · x` lies between two bounds.
#[inline(always)]
fn within(low: f64, high: f64, start: f64, slope: f64) -> (f64, f64) {
    const LEVEL: f64 = 1e-9;
    if slope.abs() < LEVEL {
        return if (low..=high).contains(&start) { (f64::NEG_INFINITY, f64::INFINITY) } else { (0.0, 0.0) };
    }
    ordered((low - start) / slope, (high - start) / slope)
}

#[inline(always)]
fn ordered(one: f64, other: f64) -> (f64, f64) {
    (one.min(other), one.max(other))
}

#[inline(always)]
fn lanes(all: &[f32; MAX_BINS], from: usize) -> Lanes {
    let mut lanes = Lanes::ZERO;
    lanes.0.copy_from_slice(&all[from..from + LANES]);
    lanes
}

/// Sums over the pixels of each bin: distances, number, and the codes of up to two planes.
struct Bins<const N: usize> {
    sums: [[f32; 4]; MAX_BINS],
    squares: [f32; N],
    from: f32,
    per_px: f32,
    last: f32,
}

impl<const N: usize> Bins<N> {
    /// Bins of about this width; wider if that avoids another group of [`LANES`] bins that would be hardly filled.
    fn covering(inwards: f64, outwards: f64, width: f64) -> Self {
        let reach = inwards + outwards;
        let groups = (reach / (width * MAX_WIDENING * LANES as f64)).ceil();
        let most = (groups * LANES as f64).min(MAX_BINS as f64);
        let count = (reach / width).ceil().min(most);
        let width = width.max(reach / count);
        Self {
            sums: [[0.0; 4]; MAX_BINS],
            squares: [0.0; N],
            from: -inwards as f32,
            per_px: (1.0 / width) as f32,
            last: (count - 1.0).max(0.0) as f32,
        }
    }

    #[inline(always)]
    fn add(&mut self, distance: f32, values: [f32; N]) {
        let bin = ((distance - self.from) * self.per_px).max(0.0).min(self.last) as i32 as usize;
        let sum = &mut self.sums[bin.min(MAX_BINS - 1)];
        let other = if N > 1 { values[N - 1] } else { 0.0 };
        let add = [distance, 1.0, values[0], other];
        for lane in 0..4 {
            sum[lane] += add[lane];
        }
        for (square, value) in self.squares.iter_mut().zip(values) {
            *square += value * value;
        }
    }

    #[inline(always)]
    fn means(self) -> Profile<N> {
        let mut profile = Profile {
            distances: [0.0; MAX_BINS],
            values: [[0.0; MAX_BINS]; N],
            pixels: [0.0; MAX_BINS],
            len: 0,
            count: 0.0,
            scatter: self.squares,
        };
        for [distances, pixels, codes @ ..] in
            self.sums.into_iter().take(self.last as usize + 1).filter(|sum| sum[1] > 0.0)
        {
            let (at, per_pixel) = (profile.len, 1.0 / pixels);
            profile.distances[at] = distances * per_pixel;
            profile.pixels[at] = pixels;
            profile.count += pixels;
            for ((values, scatter), sum) in profile.values.iter_mut().zip(&mut profile.scatter).zip(codes) {
                let mean = sum * per_pixel;
                values[at] = mean;
                *scatter -= mean * sum;
            }
            profile.len += 1;
        }
        profile
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation2, Vector2};

    use super::*;
    use crate::vision::edges::probe::Shading;
    use crate::vision::frame::{ColourEncoding, Matrix, Range};
    use crate::vision::space::Pixel;

    const SIZE: usize = 64;
    const MIDDLE: f64 = 32.0;

    /// A chord across a straight band; the window follows the band if it leans by `lean`.
    fn probe(outward: Vector2<f64>, lean: f64) -> Probe {
        Probe {
            middle: Pixel::new(MIDDLE, MIDDLE),
            outward,
            bend_per_px: 0.0,
            lean,
            half_length_px: 3.0,
            inwards_px: 12.0,
            outwards_px: 12.0,
            motion_px_s: 0.0,
            part: crate::vision::tube::OutlinePart::DistalEnd,
            shading: Shading::Cut,
        }
    }

    /// Profile of a window over a band in direction `along`, ten pixels wide, and its surroundings.
    fn of_band(along: Vector2<f64>, probe: &Probe) -> Profile<1> {
        let on_band = |i: usize| {
            let from_middle = Vector2::new((i % SIZE) as f64, (i / SIZE) as f64) - Vector2::repeat(MIDDLE);
            from_middle.perp(&along).abs() < 5.0
        };
        let luma: Vec<u8> = (0..SIZE * SIZE).map(|i| if on_band(i) { 200 } else { 50 }).collect();
        let grey = vec![128; SIZE * SIZE / 4];
        let plane = |data, size| Plane { data, stride: size, width: size, height: size };
        let frame = Frame {
            index: 0,
            time_s: 0.0,
            y: plane(&luma, SIZE),
            u: plane(&grey, SIZE / 2),
            v: plane(&grey, SIZE / 2),
            shift_x: 1,
            shift_y: 1,
            chroma_first_px: [0.5; 2],
            encoding: ColourEncoding { range: Range::Limited, matrix: Matrix::Bt709 },
        };
        of_luma(&frame, probe)
    }

    #[test]
    fn a_window_that_leans_along_a_band_stays_on_it() {
        for degrees in (0..360).step_by(15) {
            let along = Rotation2::new(f64::from(degrees).to_radians()) * Vector2::x();
            for turned in [-0.6, 0.6] {
                let outward = Rotation2::new(turned) * along;
                let lean = along.dot(&Vector2::new(-outward.y, outward.x)) / along.dot(&outward);
                let leaves = |lean: f64| of_band(along, &probe(outward, lean)).bins(0).any(|(.., code)| code < 199.0);
                assert!(!leaves(lean) && leaves(0.0), "{degrees}, turned {turned}");
            }
        }
    }

    #[test]
    fn a_window_holds_the_pixels_of_its_area_however_it_leans() {
        const AREA: f32 = 6.0 * 24.0;
        for degrees in (0..360).step_by(7) {
            let outward = Rotation2::new(f64::from(degrees).to_radians()) * Vector2::x();
            for lean in [-0.8, 0.0, 0.5] {
                let count = of_band(outward, &probe(outward, lean)).count;
                assert!((count / AREA - 1.0).abs() < 0.12, "{degrees}, lean {lean}: {count}");
            }
        }
    }
}
