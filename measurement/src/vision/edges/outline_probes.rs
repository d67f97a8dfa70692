//! Lays probes along the outline of a roughly known tube: both borders of its band, and the near rims of both ends.

use nalgebra::{Point3, Vector2};

use super::probe::{Probe, Shading};
use crate::vision::camera::Camera;
use crate::vision::space::{CameraPoint, Pixel};
use crate::vision::tube::{BorderSide, Outline, OutlinePart};

/// A point on a band's outline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OutlinePoint {
    /// On a border.
    Border {
        /// The border.
        side: BorderSide,
        /// Distance behind the tip, mm.
        back_mm: f64,
    },
    /// On the circle at this distance behind the tip (0: distal end).
    Rim {
        /// Distance behind the tip, mm.
        back_mm: f64,
        /// Position across (−1 … 1), as in [`Outline::rim`].
        across: f64,
    },
}

impl OutlinePoint {
    /// The position of this point on an outline, camera frame, mm.
    pub fn position_on(&self, outline: &Outline) -> Point3<f64> {
        match *self {
            OutlinePoint::Border { side, back_mm } => outline.border(side, back_mm),
            OutlinePoint::Rim { back_mm, across } => outline.tape_end(back_mm, across),
        }
    }

    /// The part of the outline on which it lies.
    pub fn part(&self) -> OutlinePart {
        match *self {
            OutlinePoint::Border { side, .. } => OutlinePart::Border(side),
            OutlinePoint::Rim { back_mm, .. } if back_mm > 0.0 => OutlinePart::ProximalEnd,
            OutlinePoint::Rim { .. } => OutlinePart::DistalEnd,
        }
    }
}

/// Spacing and reach of the probes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbeLayout {
    /// Length of a chord along a border, pixels.
    pub chord_px: f64,
    /// Maximum number of chords along one border: errors of an edge come from background and light, and more edges
    /// hardly average them out.
    pub max_chords: f64,
    /// Search distance from the predicted outline, pixels.
    pub reach_px: f64,
    /// Motion of the tube in the picture, pixels/s.
    pub motion_px_s: Vector2<f64>,
    /// Exposure time, s: the search distance grows with the motion blur.
    pub exposure_s: f64,
}

/// Share of the half circle that is probed: nearer to the borders the rim turns along the line of sight.
const RIM_SHARE: f64 = 0.75;

/// Adds probes of both borders between two distances behind the tip.
pub fn border_probes(
    outline: &Outline,
    camera: &Camera,
    from_mm: f64,
    to_mm: f64,
    layout: ProbeLayout,
    into: &mut Vec<(OutlinePoint, Probe)>,
) {
    for side in BorderSide::BOTH {
        let seen = |back| pixel_of(camera, outline.border(side, back));
        let (Some(start), Some(end)) = (seen(from_mm), seen(to_mm)) else { continue };
        let length = (end.0 - start.0).norm();
        let count = (length / layout.chord_px).round().clamp(1.0, layout.max_chords) as usize;
        let half_mm = 0.5 * (to_mm - from_mm) * (layout.chord_px / length).min(1.0 / count as f64);
        for i in 0..count {
            let middle = from_mm + (to_mm - from_mm) * (i as f64 + 0.5) / count as f64;
            let (near, far) = (middle - half_mm, middle + half_mm);
            let opposite = pixel_of(camera, outline.border(side.opposite(), middle));
            let chord = [seen(near), seen(middle), seen(far), opposite];
            let place = OutlinePoint::Border { side, back_mm: middle };
            if let Some(probe) = probe_of(chord, layout, place) {
                into.push((place, probe));
            }
        }
    }
}

/// Adds probes of the near rim at the band's end `back_mm` behind the tip; `inner_mm` is a position inside the band.
pub fn rim_probes(
    outline: &Outline,
    camera: &Camera,
    back_mm: f64,
    inner_mm: f64,
    layout: ProbeLayout,
    into: &mut Vec<(OutlinePoint, Probe)>,
) {
    let seen = |across| pixel_of(camera, outline.tape_end(back_mm, across));
    let (Some(left), Some(right)) = (seen(-RIM_SHARE), seen(RIM_SHARE)) else { return };
    let width = (right.0 - left.0).norm();
    let count = (width / layout.chord_px).round().clamp(3.0, 40.0) as usize;
    for i in 0..count {
        let at = |part: f64| RIM_SHARE * (2.0 * (i as f64 + part) / count as f64 - 1.0);
        let (from, across, to) = (at(0.0), at(0.5), at(1.0));
        let inner = pixel_of(camera, outline.rim(inner_mm, across));
        let place = OutlinePoint::Rim { back_mm, across };
        if let Some(probe) = probe_of([seen(from), seen(across), seen(to), inner], layout, place) {
            into.push((place, probe));
        }
    }
}

fn pixel_of(camera: &Camera, point: Point3<f64>) -> Option<Pixel> {
    camera.project(CameraPoint(point))
}

/// A probe on the chord from the first to the third pixel. The fourth lies inside the tape; for a border, on the
/// opposite border.
fn probe_of(chord: [Option<Pixel>; 4], layout: ProbeLayout, place: OutlinePoint) -> Option<Probe> {
    let [Some(from), Some(middle), Some(to), Some(inner)] = chord else { return None };
    let along = to.0 - from.0;
    let length = along.norm();
    if length < 1e-6 {
        return None;
    }
    let outward = Vector2::new(along.y, -along.x) / length;
    let inwards = inner.0 - middle.0;
    let outward = if outward.dot(&inwards) > 0.0 { -outward } else { outward };
    let depth = inwards.dot(&outward).abs();
    let window = match place {
        // Along the rows or columns of pixels: averages out more of the background's texture than straight across.
        OutlinePoint::Border { .. } if outward.x.abs() >= outward.y.abs() => Vector2::x(),
        OutlinePoint::Border { .. } => Vector2::y(),
        // Along the tube, which the window would otherwise leave sideways.
        OutlinePoint::Rim { .. } => inwards,
    };
    let motion_px_s = layout.motion_px_s.dot(&outward);
    let reach_px = layout.reach_px + 2.0 * motion_px_s.abs() * layout.exposure_s / 12f64.sqrt();
    let beyond = |end: Pixel| (end.0 - middle.0).dot(&outward);
    Some(Probe {
        middle,
        bend_per_px: 0.5 * (beyond(from) + beyond(to)) / (0.25 * length * length),
        outward,
        lean: lean(&window, &outward),
        half_length_px: 0.5 * length,
        motion_px_s,
        inwards_px: reach_px.min(0.45 * depth),
        outwards_px: reach_px,
        part: place.part(),
        shading: if place.part().is_border() {
            Shading::Limb { radius_px: (0.5 * depth).max(2.0) }
        } else {
            Shading::Cut
        },
    })
}

/// The lean of a window in this direction: see [`Probe::lean`].
fn lean(window: &Vector2<f64>, outward: &Vector2<f64>) -> f64 {
    const MIN_ACROSS: f64 = 0.3; // below it, the window would hardly cross the edge
    let across = window.dot(outward);
    if across.abs() < MIN_ACROSS * window.norm() {
        0.0
    } else {
        window.dot(&Vector2::new(-outward.y, outward.x)) / across
    }
}
