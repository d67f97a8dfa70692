//! Finds crossings at one scale: points where two edges cross and dark and bright sectors alternate.
//!
//! In: a smoothed grey picture. Out: candidates for inner corners, to about a third of a pixel, with the directions of
//! their two edges. Method: strongest saddles of the grey surface (most negative determinant of the Hessian), then a
//! ring of samples around each must show four sectors, point-symmetric, with two straight edges through the middle. A
//! saddle of a text or a T-junction fails the ring test. Saddles weaker than [`MIN_SADDLE`] are ignored.

use std::f64::consts::{PI, TAU};

use nalgebra::Point2;

use super::grey::Grey;

/// Minimum strength of a saddle, grey levels per px²: a corner of 15 levels' contrast, blurred by 1.5 px.
const MIN_SADDLE: f32 = 1.1;

/// Minimum contrast on the ring, grey levels.
const MIN_CONTRAST: f32 = 10.0;

/// Radius of the ring, px: inside the four squares if these are at least 8 px wide.
const RING_RADIUS: f64 = 5.0;

/// Samples on the ring.
const RING_SAMPLES: usize = 32;

/// Maximum of saddles that are tested, the strongest first; it bounds the time for pictures full of texture.
const MAX_SADDLES: usize = 4_000;

/// A candidate for an inner corner.
#[derive(Clone, Debug)]
pub(super) struct Crossing {
    /// Position, px of the picture that was searched.
    pub at: Point2<f64>,
    /// Directions of the four half edges, radians, ascending within a full turn. Neighbours in this list enclose one
    /// sector; 0 and 2 (1 and 3) belong to one edge.
    pub rays: [f64; 4],
    /// Whether ray 0 (and 2) leads from a dark to a bright sector as the angle grows.
    pub first_rises: bool,
}

impl Crossing {
    /// Whether the edge of ray `slot` turns from dark to bright as the angle grows.
    pub fn rises(&self, slot: usize) -> bool {
        self.first_rises == slot.is_multiple_of(2)
    }
}

/// All crossings of a smoothed picture.
pub(super) fn find(smooth: &Grey) -> Vec<Crossing> {
    let mut saddles = saddles(smooth);
    saddles.sort_by(|a, b| b.0.total_cmp(&a.0));
    saddles.truncate(MAX_SADDLES);
    saddles.into_iter().filter_map(|(_, at)| crossing_at(smooth, at)).collect()
}

/// Local maxima of minus the Hessian's determinant, with their strength.
fn saddles(smooth: &Grey) -> Vec<(f32, Point2<f64>)> {
    const REACH: usize = 3; // two corners closer than this are not separated
    let (width, height) = (smooth.width, smooth.height);
    if width < 16 || height < 16 {
        return Vec::new();
    }
    let strength = strengths(smooth);
    let mut found = Vec::new();
    for y in REACH..height - REACH {
        for x in REACH..width - REACH {
            let own = strength[y * width + x];
            if own < MIN_SADDLE * MIN_SADDLE {
                continue;
            }
            let rows = y - REACH..=y + REACH;
            let highest =
                rows.flat_map(|r| &strength[r * width + x - REACH..=r * width + x + REACH]).all(|&s| s <= own);
            if let (true, Some(at)) = (highest, saddle_point(smooth, x, y)) {
                found.push((own, at));
            }
        }
    }
    found
}

fn strengths(smooth: &Grey) -> Vec<f32> {
    let (width, height) = (smooth.width, smooth.height);
    let mut strength = vec![0.0; width * height];
    for y in 1..height - 1 {
        let (above, here, below) = (smooth.row(y - 1), smooth.row(y), smooth.row(y + 1));
        for x in 1..width - 1 {
            let xx = here[x - 1] - 2.0 * here[x] + here[x + 1];
            let yy = above[x] - 2.0 * here[x] + below[x];
            let xy = (below[x + 1] - below[x - 1] - above[x + 1] + above[x - 1]) * 0.25;
            strength[y * width + x] = xy * xy - xx * yy;
        }
    }
    strength
}

/// Where the gradient vanishes near a pixel, to second order; `None` if that is not in or beside this pixel.
fn saddle_point(smooth: &Grey, x: usize, y: usize) -> Option<Point2<f64>> {
    let at = |dx: usize, dy: usize| f64::from(smooth.at(x + dx - 1, y + dy - 1));
    let (gx, gy) = ((at(2, 1) - at(0, 1)) / 2.0, (at(1, 2) - at(1, 0)) / 2.0);
    let (xx, yy) = (at(0, 1) - 2.0 * at(1, 1) + at(2, 1), at(1, 0) - 2.0 * at(1, 1) + at(1, 2));
    let xy = (at(2, 2) - at(0, 2) - at(2, 0) + at(0, 0)) / 4.0;
    let determinant = xx * yy - xy * xy;
    let (dx, dy) = ((xy * gy - yy * gx) / determinant, (xy * gx - xx * gy) / determinant);
    (dx.abs() <= 1.5 && dy.abs() <= 1.5).then(|| Point2::new(x as f64 + dx, y as f64 + dy))
}

/// Tests the ring around a saddle.
fn crossing_at(smooth: &Grey, at: Point2<f64>) -> Option<Crossing> {
    let mut ring = [0.0_f32; RING_SAMPLES];
    for (i, level) in ring.iter_mut().enumerate() {
        let (sin, cos) = angle(i as f64).sin_cos();
        *level = smooth.between(at.x + RING_RADIUS * cos, at.y + RING_RADIUS * sin)?;
    }
    let (lowest, highest) = ring.iter().fold((f32::MAX, f32::MIN), |(l, h), &v| (l.min(v), h.max(v)));
    if highest - lowest < MIN_CONTRAST {
        return None;
    }
    let middle = (lowest + highest) / 2.0;
    let (rays, first_rises) = sign_changes(&ring, middle)?;
    let straight = |a: f64, b: f64| (b - a - PI).abs() < 0.6;
    let open = (0..4).all(|i| (rays[(i + 1) % 4] - rays[i]).rem_euclid(TAU) > 0.3);
    let crossing = straight(rays[0], rays[2]) && straight(rays[1], rays[3]) && open && is_symmetric(&ring);
    crossing.then_some(Crossing { at, rays, first_rises })
}

fn angle(sample: f64) -> f64 {
    sample * TAU / RING_SAMPLES as f64
}

/// The four angles at which the ring passes the middle level; `None` if these are not four.
fn sign_changes(ring: &[f32; RING_SAMPLES], middle: f32) -> Option<([f64; 4], bool)> {
    let mut rays = [0.0; 4];
    let mut count = 0;
    let mut first_rises = false;
    for i in 0..RING_SAMPLES {
        let (here, next) = (ring[i] - middle, ring[(i + 1) % RING_SAMPLES] - middle);
        if (here < 0.0) == (next < 0.0) {
            continue;
        }
        if count == 4 {
            return None;
        }
        if count == 0 {
            first_rises = here < 0.0;
        }
        rays[count] = angle(i as f64 + f64::from(here / (here - next)));
        count += 1;
    }
    (count == 4).then_some((rays, first_rises))
}

/// Whether opposite samples agree, as at a crossing but not at a square's outer corner or a blot.
fn is_symmetric(ring: &[f32; RING_SAMPLES]) -> bool {
    let mean = ring.iter().sum::<f32>() / RING_SAMPLES as f32;
    let (first, second) = ring.split_at(RING_SAMPLES / 2);
    let joint: f32 = first.iter().zip(second).map(|(a, b)| (a - mean) * (b - mean)).sum();
    let own: f32 = ring.iter().map(|v| (v - mean).powi(2)).sum();
    2.0 * joint > 0.6 * own
}
