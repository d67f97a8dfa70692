//! What planes show across a chord: raw pixels, averaged in narrow bins of their distance from it.
//!
//! Nothing is resampled: a bin holds whole pixels and their mean distance, so that its noise is that of their mean. Where
//! the edge bends along the chord, distances are counted from the bent line.

use super::probe::Probe;
use crate::pipeline::frame::Plane;

/// Bins that are worked on at once.
pub const LANES: usize = 8;
/// Most bins of a profile.
pub const MOST_BINS: usize = 48;
/// Width of a bin in pixels of the plane, where they suffice.
const BIN_PX: f64 = 0.5;
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
    pub fn distances(&self, bin: usize) -> [f32; LANES] {
        lanes(&self.distances, bin)
    }

    /// Mean code of one plane in each of them.
    #[inline(always)]
    pub fn values(&self, plane: usize, bin: usize) -> [f32; LANES] {
        lanes(&self.values[plane], bin)
    }

    /// Number of pixels in each of them: none in bins beyond the last.
    #[inline(always)]
    pub fn pixels(&self, bin: usize) -> [f32; LANES] {
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
    pub fn gather(planes: [&Plane<'_>; N], shift: (u8, u8), probe: &Probe) -> Self {
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
        let index = |axis: usize, at: f64| (at - first[axis]) / scale[axis];
        let last = |axis: usize, at: f64| (at.ceil().max(0.0) as usize).min(sizes[axis]);
        let row_from = index(rows, middle[rows] - half_rows).ceil().max(0.0) as usize;
        let reach = 1.0 / normal[run].abs();
        let step = scale[run] * normal[run];
        let mut bins = Bins::<N>::over(inwards, outwards, BIN_PX * scale[run]);
        for row in row_from..last(rows, index(rows, middle[rows] + half_rows)) {
            let along = row as f64 * scale[rows] + first[rows] - middle[rows];
            let crossing = middle[run] - along * slant;
            let from = index(run, crossing - back * reach).ceil().max(0.0) as usize;
            let start = along * normal[rows] + (first[run] - middle[run]) * normal[run];
            for column in from..last(run, index(run, crossing + ahead * reach)) {
                let straight = start + column as f64 * step;
                let across = column as f64 * scale[run] + first[run] - middle[run];
                let distance = straight - probe.bend_per_px * (along * along + across * across - straight * straight);
                let (x, y) = if run == 0 { (column, row) } else { (row, column) };
                bins.add(distance as f32, planes.map(|plane| f32::from(plane.at(x, y))));
            }
        }
        bins.means()
    }
}

#[inline(always)]
fn lanes(all: &[f32; MOST_BINS], from: usize) -> [f32; LANES] {
    std::array::from_fn(|lane| all[from + lane])
}

struct Bins<const N: usize> {
    sums: [[f32; MOST_BINS]; N],
    squares: [f32; N],
    distances: [f32; MOST_BINS],
    pixels: [f32; MOST_BINS],
    from: f32,
    per_px: f32,
    count: usize,
}

impl<const N: usize> Bins<N> {
    fn over(inwards: f64, outwards: f64, width: f64) -> Self {
        let width = width.max((inwards + outwards) / (MOST_BINS as f64 - 1.0));
        Self {
            sums: [[0.0; MOST_BINS]; N],
            squares: [0.0; N],
            distances: [0.0; MOST_BINS],
            pixels: [0.0; MOST_BINS],
            from: -inwards as f32,
            per_px: (1.0 / width) as f32,
            count: ((inwards + outwards) / width).ceil().min(MOST_BINS as f64) as usize,
        }
    }

    #[inline]
    fn add(&mut self, distance: f32, values: [f32; N]) {
        let bin = ((distance - self.from) * self.per_px).max(0.0) as usize;
        let bin = bin.min(self.count.saturating_sub(1));
        self.distances[bin] += distance;
        self.pixels[bin] += 1.0;
        for (plane, value) in values.into_iter().enumerate() {
            self.sums[plane][bin] += value;
            self.squares[plane] += value * value;
        }
    }

    fn means(self) -> Profile<N> {
        let mut profile = Profile {
            distances: [0.0; MOST_BINS],
            values: [[0.0; MOST_BINS]; N],
            pixels: [0.0; MOST_BINS],
            len: 0,
            count: 0.0,
            scatter: self.squares,
        };
        for bin in (0..self.count).filter(|bin| self.pixels[*bin] > 0.0) {
            let (at, pixels) = (profile.len, self.pixels[bin]);
            profile.distances[at] = self.distances[bin] / pixels;
            profile.pixels[at] = pixels;
            profile.count += pixels;
            for plane in 0..N {
                let mean = self.sums[plane][bin] / pixels;
                profile.values[plane][at] = mean;
                profile.scatter[plane] -= mean * mean * pixels;
            }
            profile.len += 1;
        }
        profile
    }
}
