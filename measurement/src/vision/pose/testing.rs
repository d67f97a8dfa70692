//! Edges along a tube's outline for tests: exact, except for given offsets and noise.

use nalgebra::{Point3, Vector2};
use rand::{Rng, RngExt};

use super::joint_fit::{END_OFFSET_PX, MeasuredEdge};
use super::normal_equations::{Offsets, by_offsets, shape_at};
use crate::vision::camera::Camera;
use crate::vision::edges::outline_probes::OutlinePoint;
use crate::vision::space::{CameraPoint, Pixel};
use crate::vision::tube::{BorderSide, Tube};

/// Length of the bands, mm.
pub const LENGTH_MM: f64 = 26.0;

/// A random number with mean 0 and standard deviation 1.
pub fn gaussian(random: &mut impl Rng) -> f64 {
    (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0
}

/// Edges along both borders at these distances behind the tip, and five along each end, shifted by `offsets` and by
/// noise.
pub fn edges(
    tube: &Tube,
    camera: &Camera,
    backs_mm: &[f64],
    offsets: &Offsets,
    noise_px: f64,
    random: &mut impl Rng,
) -> Vec<MeasuredEdge> {
    let outline = tube.outline().unwrap();
    let borders = BorderSide::BOTH
        .into_iter()
        .flat_map(|side| backs_mm.iter().map(move |back| OutlinePoint::Border { side, back_mm: *back }));
    let rims = [0.0, LENGTH_MM]
        .into_iter()
        .flat_map(|back_mm| (-2..=2).map(move |k| OutlinePoint::Rim { back_mm, across: 0.3 * f64::from(k) }));
    let pixel = |place: Point3<f64>| camera.project(CameraPoint(place)).unwrap().0;
    borders
        .chain(rims)
        .map(|place| {
            let at = pixel(place.position_on(&outline));
            let along = match place {
                OutlinePoint::Border { side, back_mm } => pixel(outline.border(side, back_mm + 0.5)) - at,
                OutlinePoint::Rim { back_mm, across } => pixel(outline.tape_end(back_mm, across + 0.05)) - at,
            };
            let inwards = pixel(tube.tip - tube.axis * (0.5 * LENGTH_MM)) - at;
            let normal = Vector2::new(-along.y, along.x).normalize();
            let outward = if normal.dot(&inwards) > 0.0 { -normal } else { normal };
            let usual_px = if place.part().is_border() { 0.0 } else { END_OFFSET_PX };
            let of_part = by_offsets(place.part()) * offsets;
            let offset_px = of_part.x + of_part.y * shape_at(place, LENGTH_MM);
            let off_px = usual_px + offset_px + noise_px * gaussian(random);
            MeasuredEdge::new(place, Pixel(at + outward * off_px), outward, noise_px.max(1e-6), camera).unwrap()
        })
        .collect()
}
