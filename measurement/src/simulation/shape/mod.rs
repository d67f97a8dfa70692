//! Intersections of camera rays with solids: the tube of a tool, and the rounded cone for everything else.
//!
//! Rays start at the camera's centre and have the direction `v = (x, y, 1)`, so that the factor along a ray *is* the
//! depth z.

use nalgebra::{Point3, Vector3};

/// The first intersection of a ray with a solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// Depth, mm: the point is `depth · v`.
    pub depth: f64,
    /// Unit normal, out of the solid.
    pub normal: Vector3<f64>,
}

/// The convex hull of two spheres: a peg, a piece of wire, half a jaw; a sphere if the ends coincide.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoundCone {
    /// Centre of the first sphere, mm.
    pub a: Point3<f64>,
    /// Radius of the first sphere, mm; at least that of the second.
    pub radius_a: f64,
    /// Centre of the second sphere, mm.
    pub b: Point3<f64>,
    /// Radius of the second sphere, mm.
    pub radius_b: f64,
}

impl RoundCone {
    /// A rod with the same radius at both ends.
    pub fn capsule(a: Point3<f64>, b: Point3<f64>, radius: f64) -> Self {
        Self { a, radius_a: radius, b, radius_b: radius }
    }

    /// A ball.
    pub fn sphere(centre: Point3<f64>, radius: f64) -> Self {
        Self::capsule(centre, centre, radius)
    }

    /// The first intersection of the ray with the solid.
    pub fn meet(&self, v: Vector3<f64>) -> Option<RayHit> {
        // The solid is convex: a ray enters it once, through the side or through one of the ends.
        self.meet_side(v).or_else(|| {
            let ends = [meet_sphere(self.a, self.radius_a, v), meet_sphere(self.b, self.radius_b, v)];
            ends.into_iter().flatten().min_by(|p, q| p.depth.total_cmp(&q.depth))
        })
    }

    /// Intersection with the cone that touches both spheres. With `s = (ra − rb)/h` the sine of its half angle and `y`
    /// the distance along the axis, its surface is `|X − A|² − ra² = (y − ra·s)²/(1 − s²)`: a quadratic in the depth.
    fn meet_side(&self, v: Vector3<f64>) -> Option<RayHit> {
        let along = self.b - self.a;
        let length = along.norm();
        let slope = (self.radius_a - self.radius_b) / length;
        if slope.is_nan() || slope.abs() >= 1.0 {
            return None; // one sphere contains the other (or both ends coincide: the slope is not a number)
        }
        let (axis, stretch) = (along / length, 1.0 / (1.0 - slope * slope));
        let (to_a, va, aa) = (self.a.coords, v.dot(&axis), self.a.coords.dot(&axis) + self.radius_a * slope);
        let a = v.norm_squared() - stretch * va * va;
        let b = v.dot(&to_a) - stretch * va * aa;
        let c = to_a.norm_squared() - self.radius_a * self.radius_a - stretch * aa * aa;
        let root = (b * b - a * c).sqrt(); // not a number if the ray misses: both candidates fail below
        let mut depths = [(b - root) / a, (b + root) / a];
        depths.sort_by(f64::total_cmp);
        let cosine = (1.0 - slope * slope).sqrt();
        depths.into_iter().find_map(|depth| {
            let from_a = v * depth - to_a;
            let y = from_a.dot(&axis);
            let on_side = y >= self.radius_a * slope && y <= length + self.radius_b * slope;
            let normal = (from_a - axis * y).normalize() * cosine + axis * slope;
            (depth > 0.0 && on_side && normal.dot(&v) < 0.0).then_some(RayHit { depth, normal })
        })
    }

    /// True if a ray within the angle `margin` (sine) of `unit` may meet the solid. May be true wrongly, never false
    /// wrongly.
    pub fn may_meet(&self, unit: Vector3<f64>, margin: f64) -> bool {
        let (a, b) = (self.a.coords, self.b.coords);
        // The distance of the axis's segment from the ray is compared with the radius of the thicker end.
        let (ab, reach) = (b - a, self.radius_a.max(self.radius_b));
        let (across_a, across_ab) = (a - unit * a.dot(&unit), ab - unit * ab.dot(&unit));
        let share = -across_a.dot(&across_ab) / across_ab.norm_squared().max(1e-12);
        let nearest = a + ab * share.clamp(0.0, 1.0);
        let depth = nearest.dot(&unit);
        let miss = (nearest - unit * depth).norm();
        // The allowance grows with distance: that of the farther end is enough for every point between.
        depth > -reach && miss < reach + margin * (a.norm().max(b.norm()) + reach)
    }
}

fn meet_sphere(centre: Point3<f64>, radius: f64, v: Vector3<f64>) -> Option<RayHit> {
    let (a, b) = (v.norm_squared(), v.dot(&centre.coords));
    let left = b * b - a * (centre.coords.norm_squared() - radius * radius);
    let depth = (b - left.max(0.0).sqrt()) / a;
    (left > 0.0 && depth > 0.0).then(|| RayHit { depth, normal: (v * depth - centre.coords) / radius })
}

/// The part of a tube that a ray meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TubePart {
    /// The tape.
    Band,
    /// The bare tube behind it.
    Shaft,
    /// The distal end face.
    Face,
}

/// A tool's tube: tape from the distal end to `band_mm`, then bare tube, a little thinner. A tube of one surface has a
/// band of length 0 or of the tube's whole length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TapedTube {
    /// Centre of the distal end, mm.
    pub tip: Point3<f64>,
    /// Unit vector from the hand to the tip.
    pub axis: Vector3<f64>,
    /// Radius over the tape, mm.
    pub radius: f64,
    /// Radius of the bare tube, mm.
    pub bare_radius: f64,
    /// Length of the tape, mm.
    pub band_mm: f64,
    /// Length of the tube, mm.
    pub length_mm: f64,
    along_tip: f64,
    tip_squared: f64,
    borders: [Vector3<f64>; 2],
}

impl TapedTube {
    /// A tube in the camera frame.
    pub fn new(tip: Point3<f64>, axis: Vector3<f64>, radii: (f64, f64), band_mm: f64, length_mm: f64) -> Self {
        let along_tip = tip.coords.dot(&axis);
        let borders = tangent_planes(tip, axis, radii.0).unwrap_or_default();
        let tip_squared = tip.coords.norm_squared();
        let (radius, bare_radius) = radii;
        Self { tip, axis, radius, bare_radius, band_mm, length_mm, along_tip, tip_squared, borders }
    }

    /// Normals of the two planes through the camera's centre that touch the taped tube (METHOD 4), pointing towards it;
    /// zero if the camera's centre lies inside the cylinder, which then has no borders.
    pub fn borders(&self) -> [Vector3<f64>; 2] {
        self.borders
    }

    /// The first intersection of the ray: depth, normal, part, and distance from the tip towards the hand in mm.
    pub fn meet(&self, v: Vector3<f64>) -> Option<(RayHit, TubePart, f64)> {
        let va = v.dot(&self.axis);
        let a = v.norm_squared() - va * va;
        let b = v.dot(&self.tip.coords) - self.along_tip * va;
        let c = self.tip_squared - self.along_tip * self.along_tip;
        let on_side = |radius: f64| {
            let left = b * b - a * (c - radius * radius);
            let depth = (b - left.max(0.0).sqrt()) / a;
            (left > 0.0 && depth > 0.0).then_some((depth, self.along_tip - depth * va))
        };
        let meeting = |depth: f64, behind: f64, radius: f64| RayHit {
            depth,
            normal: (v * depth - self.tip.coords + self.axis * behind) / radius,
        };
        let taped = on_side(self.radius).filter(|(_, behind)| *behind >= 0.0);
        if let Some((depth, behind)) = taped.filter(|(_, behind)| *behind <= self.band_mm) {
            return Some((meeting(depth, behind, self.radius), TubePart::Band, behind));
        }
        let bare = on_side(self.bare_radius).filter(|(_, behind)| *behind >= 0.0 && *behind <= self.length_mm);
        bare.map(|(depth, behind)| {
            // Between the two radii the ray meets the tape's cut edge, a ring 0.06 mm wide; it is rendered as tape.
            let part = if behind > self.band_mm { TubePart::Shaft } else { TubePart::Band };
            (meeting(depth, behind, self.bare_radius), part, behind)
        })
        .or_else(|| self.meet_face(v, va))
    }

    /// The point where the ray passes the infinite taped tube: distance from the tip towards the hand, depth, and the
    /// sine of the angle between ray and axis.
    pub fn along(&self, v: Vector3<f64>) -> (f64, f64, f64) {
        let va = v.dot(&self.axis);
        let a = (v.norm_squared() - va * va).max(1e-9);
        let b = v.dot(&self.tip.coords) - self.along_tip * va;
        let c = self.tip_squared - self.along_tip * self.along_tip - self.radius * self.radius;
        let depth = (b - (b * b - a * c).max(0.0).sqrt()) / a;
        (self.along_tip - depth * va, depth, (a / v.norm_squared()).sqrt())
    }

    fn meet_face(&self, v: Vector3<f64>, va: f64) -> Option<(RayHit, TubePart, f64)> {
        let depth = self.along_tip / va;
        let inside = (v * depth - self.tip.coords).norm_squared() <= self.radius * self.radius;
        (va < 0.0 && depth > 0.0 && inside).then_some((RayHit { depth, normal: self.axis }, TubePart::Face, 0.0))
    }
}

/// Unit normals of the two planes through the origin that touch the infinite cylinder, pointing towards it.
///
/// With `N` the axis's point nearest to the camera and `e` across, `n = r/|N|·N/|N| ± √(1 − r²/|N|²)·e`.
/// `None` if the camera's centre lies inside the cylinder.
pub fn tangent_planes(point: Point3<f64>, axis: Vector3<f64>, radius: f64) -> Option<[Vector3<f64>; 2]> {
    let nearest = point.coords - axis * point.coords.dot(&axis);
    let distance = nearest.norm();
    if distance <= radius * 1.001 {
        return None;
    }
    let (towards, across) = (nearest / distance, axis.cross(&nearest) / distance);
    let sine = radius / distance;
    let cosine = (1.0 - sine * sine).sqrt();
    Some([towards * sine + across * cosine, towards * sine - across * cosine])
}

#[cfg(test)]
mod tests;
