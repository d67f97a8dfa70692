//! What planes show across a chord: raw pixels, averaged in narrow bins of their distance from it.
//!
//! Nothing is resampled: a bin holds whole pixels and their mean distance, so that its noise is that of their mean. Where
//! the edge bends along the chord, distances are counted from the bent line.

use super::lanes::{LANES, Lanes};
use super::probe::Probe;
use crate::pipeline::frame::{Frame, Plane};

/// Most bins of a profile.
pub const MOST_BINS: usize = 48;
/// Width of a bin in pixels of the plane, where they suffice.
const BIN_PX: f64 = 0.5;
/// By how much wider they may be.
const WIDER: f64 = 1.5;
/// A plane of half the resolution is looked at over a window that much wider: three of its pixels cannot show both
/// sides of an edge.
const COARSE_PLANE_REACH: f64 = 1.25;

/// Planes of one size across a chord.
#[derive(Clone, Copy)]
pub struct Profile<const N: usize> {
    distances: [f32; MOST_BINS],
    values: [[f32; MOST_BINS]; N],
    pixels: [f32; MOST_BINS],
    /// Bins in use.
    len: usize,
    /// Pixels in all bins.
    pub count: f32,
    /// Squared distances of each plane's pixels from their bin's mean, summed.
    pub scatter: [f32; N],
}

impl<const N: usize> Profile<N> {
    /// Bins in use.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Mean distance outwards of the pixels in [`LANES`] bins from `bin` on, pixels of luma.
    #[inline(always)]
    pub fn distances(&self, bin: usize) -> Lanes {
        lanes(&self.distances, bin)
    }

    /// Mean code of one plane in each of them.
    #[inline(always)]
    pub fn values(&self, plane: usize, bin: usize) -> Lanes {
        lanes(&self.values[plane], bin)
    }

    /// Number of pixels in each of them: none in bins beyond the last.
    #[inline(always)]
    pub fn pixels(&self, bin: usize) -> Lanes {
        lanes(&self.pixels, bin)
    }

    /// Mean distance and number of the pixels of each bin, with the mean code of one plane.
    pub fn bins(&self, plane: usize) -> impl Iterator<Item = (f32, f32, f32)> {
        let values = self.values[plane].iter();
        let bins = self.distances.iter().zip(&self.pixels).zip(values).take(self.len);
        bins.map(|((distance, pixels), value)| (*distance, *pixels, *value))
    }

    /// Collects the pixels in the parallelogram around a chord, row by row where the chord is upright, else column by
    /// column. `shift` halves the planes' size so many times.
    #[inline(always)]
    fn gather(planes: [&Plane<'_>; N], shift: (u8, u8), probe: &Probe) -> Self {
        let scale = [f64::from(1u32 << shift.0), f64::from(1u32 << shift.1)];
        let first = scale.map(|s| (s - 1.0) / 2.0); // a chroma sample sits amid the pixels it stands for
        let sizes = [planes[0].width, planes[0].height];
        let middle = [probe.middle.u(), probe.middle.v()];
        let normal = [probe.outward.x, probe.outward.y];
        let run = if normal[0].abs() >= normal[1].abs() { 0 } else { 1 }; // the direction that crosses the chord
        let rows = 1 - run;
        let half_rows = probe.half_length_px * normal[run].abs();
        let slant = normal[rows] / normal[run];
        let wider = if scale[run] > 1.0 { COARSE_PLANE_REACH } else { 1.0 };
        let (inwards, outwards) = (probe.inwards_px * wider, probe.outwards_px * wider);
        let (back, ahead) = if normal[run] > 0.0 { (inwards, outwards) } else { (outwards, inwards) };
        let (per_row, per_run) = (1.0 / scale[rows], 1.0 / scale[run]);
        let reach = 1.0 / normal[run].abs();
        let whole = |at: f64, size: usize| (at.ceil().max(0.0) as usize).min(size);
        let row_of = |at: f64| whole((at - first[rows]) * per_row, sizes[rows]);
        let column_of = |at: f64| whole((at - first[run]) * per_run, sizes[run]);
        let (across_step, along_step) = ((scale[run] * normal[run]) as f32, (-scale[run] * normal[rows]) as f32);
        let bend_per_px = probe.bend_per_px as f32;
        let mut bins = Bins::<N>::over(inwards, outwards, BIN_PX * scale[run]);
        for row in row_of(middle[rows] - half_rows)..row_of(middle[rows] + half_rows) {
            let along = row as f64 * scale[rows] + first[rows] - middle[rows];
            let crossing = middle[run] - along * slant;
            let (from, to) = (column_of(crossing - back * reach), column_of(crossing + ahead * reach));
            let beside = from as f64 * scale[run] + first[run] - middle[run];
            // Of the row's first pixel: from the straight chord, and along it from its middle.
            let mut across = (along * normal[rows] + beside * normal[run]) as f32;
            let mut from_middle = (along * normal[run] - beside * normal[rows]) as f32;
            for column in from..to {
                let (x, y) = if run == 0 { (column, row) } else { (row, column) };
                let mut values = [0.0; N];
                for (value, plane) in values.iter_mut().zip(planes) {
                    *value = f32::from(plane.at(x, y));
                }
                bins.add(across - bend_per_px * from_middle * from_middle, values);
                across += across_step;
                from_middle += along_step;
            }
        }
        bins.means()
    }
}

/// What luma shows about a chord.
#[multiversion::multiversion(targets("x86_64+avx2"))]
pub fn of_luma(frame: &Frame<'_>, probe: &Probe) -> Profile<1> {
    Profile::gather([&frame.y], (0, 0), probe)
}

/// What both planes of chroma show about a chord.
#[multiversion::multiversion(targets("x86_64+avx2"))]
pub fn of_chroma(frame: &Frame<'_>, probe: &Probe) -> Profile<2> {
    Profile::gather([&frame.u, &frame.v], (frame.shift_x, frame.shift_y), probe)
}

#[inline(always)]
fn lanes(all: &[f32; MOST_BINS], from: usize) -> Lanes {
    let mut lanes = Lanes::ZERO;
    lanes.0.copy_from_slice(&all[from..from + LANES]);
    lanes
}

/// Sums over the pixels of each bin: distances, their number, and the codes of up to two planes.
struct Bins<const N: usize> {
    sums: [[f32; 4]; MOST_BINS],
    squares: [f32; N],
    from: f32,
    per_px: f32,
    last: f32,
}

impl<const N: usize> Bins<N> {
    /// Bins of about this width, wider where they would else begin another group of [`LANES`] that is hardly filled.
    fn over(inwards: f64, outwards: f64, width: f64) -> Self {
        let reach = inwards + outwards;
        let groups = (reach / (width * WIDER * LANES as f64)).ceil();
        let most = (groups * LANES as f64).min(MOST_BINS as f64);
        let count = (reach / width).ceil().min(most);
        let width = width.max(reach / count);
        Self {
            sums: [[0.0; 4]; MOST_BINS],
            squares: [0.0; N],
            from: -inwards as f32,
            per_px: (1.0 / width) as f32,
            last: (count - 1.0).max(0.0) as f32,
        }
    }

    #[inline(always)]
    fn add(&mut self, distance: f32, values: [f32; N]) {
        let bin = ((distance - self.from) * self.per_px).max(0.0).min(self.last) as i32 as usize;
        let sum = &mut self.sums[bin.min(MOST_BINS - 1)];
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
            distances: [0.0; MOST_BINS],
            values: [[0.0; MOST_BINS]; N],
            pixels: [0.0; MOST_BINS],
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
