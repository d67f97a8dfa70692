//! The pixels about a chord: each at its own distance from it, as they are, not resampled.

use super::probe::Probe;
use crate::pipeline::frame::Plane;

/// Samples that are worked on at once.
pub const LANES: usize = 4;
const MOST_SAMPLES: usize = 256;
/// A plane of half the resolution is looked at over a window that much wider: three of its samples cannot show both
/// sides of an edge.
const COARSE_PLANE_REACH: f64 = 1.5;

/// Samples of one plane near a chord: distance along the normal, value.
#[derive(Clone, Copy)]
pub struct PlaneSamples {
    distances: [f32; MOST_SAMPLES],
    values: [f32; MOST_SAMPLES],
    /// Taken off all values.
    pub level: f32,
    /// How many there are.
    pub len: usize,
}

impl Default for PlaneSamples {
    fn default() -> Self {
        Self { distances: [0.0; MOST_SAMPLES], values: [0.0; MOST_SAMPLES], level: 0.0, len: 0 }
    }
}

impl PlaneSamples {
    fn push(&mut self, distance: f64, value: u8) {
        if self.len < MOST_SAMPLES {
            self.distances[self.len] = distance as f32;
            self.values[self.len] = f32::from(value);
            self.len += 1;
        }
    }

    /// Ends the collection: moves the values so that they lie about zero, and fills the last chunk with samples so far
    /// outside that they say nothing.
    pub fn complete(&mut self) {
        const FAR_PX: f32 = 1e6;
        let values = &mut self.values[..self.len];
        self.level = values.iter().sum::<f32>() / (values.len().max(1) as f32);
        values.iter_mut().for_each(|value| *value -= self.level);
        let padded = self.len.next_multiple_of(LANES);
        self.distances[self.len..padded].fill(FAR_PX);
        self.values[self.len..padded].fill(0.0);
    }

    /// Distances and values, in chunks.
    pub fn chunks(&self) -> impl Iterator<Item = (&[f32; LANES], &[f32; LANES])> {
        let count = self.len.div_ceil(LANES);
        self.distances.as_chunks().0.iter().zip(self.values.as_chunks().0).take(count)
    }

    /// Distances and values, one by one.
    pub fn pairs(&self) -> impl Iterator<Item = (f32, f32)> {
        self.distances[..self.len].iter().copied().zip(self.values[..self.len].iter().copied())
    }
}

/// Collects samples of planes of one size in the parallelogram around a chord, row by row where the chord is upright,
/// else column by column; `shifted_px` is added to their distances.
pub fn gather<const N: usize>(
    planes: [&Plane<'_>; N],
    shift: (u8, u8),
    probe: &Probe,
    shifted_px: f64,
    into: &mut [PlaneSamples],
) {
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
    for row in row_from..last(rows, index(rows, middle[rows] + half_rows)) {
        let along = row as f64 * scale[rows] + first[rows] - middle[rows];
        let crossing = middle[run] - along * slant;
        let reach = 1.0 / normal[run].abs();
        let from = index(run, crossing - back * reach).ceil().max(0.0) as usize;
        let start = shifted_px + along * normal[rows] + (first[run] - middle[run]) * normal[run];
        for column in from..last(run, index(run, crossing + ahead * reach)) {
            let distance = start + column as f64 * scale[run] * normal[run];
            let (x, y) = if run == 0 { (column, row) } else { (row, column) };
            for (plane, samples) in planes.iter().zip(into.iter_mut()) {
                samples.push(distance, plane.at(x, y));
            }
        }
    }
}
