//! Lamps with a size, the light that surfaces reflect, and the soft shadow of a rod.
//!
//! Radiance is linear; 1 is the sensor's white. Surfaces reflect a matt share (Lambert) and a gloss (Blinn–Phong). Dark
//! polished surfaces also mirror their surroundings, the more the flatter the viewing angle (Schlick).

use nalgebra::{Point3, Vector3};

use super::shape::RoundCone;

/// Linear red, green, blue.
pub type Rgb = [f32; 3];

/// Number of lamps in a box; the renderer stores the share of each lamp for every background pixel, for the tools'
/// shadows.
pub const LAMP_COUNT: usize = 2;

/// A spherical lamp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Centre in the camera frame, mm.
    pub at: Point3<f64>,
    /// Radius, mm: the larger, the softer its shadows.
    pub radius: f64,
    /// Radiance of a white matt surface that faces the lamp at [`Lamp::REFERENCE_MM`].
    pub power: Rgb,
}

impl Lamp {
    /// Distance that [`Lamp::power`] refers to; light falls off with the square of the distance.
    pub const REFERENCE_MM: f64 = 200.0;

    /// Share of the lamp that the solid hides from a point, 0 to 1.
    ///
    /// Seen from the point, the solid is a strip across the lamp's disc. The strip's offset is the distance between the
    /// solid's axis and the line of sight to the lamp's centre, compared with the width of the light cone at that
    /// place. Exact for a long thin rod far from its ends; the ends are rounded.
    pub fn hidden(&self, point: Point3<f64>, solid: &RoundCone) -> f64 {
        let (share, on_axis, miss) = closest_approach(point, self.at, solid.a, solid.b);
        let radius = solid.radius_a + (solid.radius_b - solid.radius_a) * on_axis;
        let width = (self.radius * share).max(1e-3);
        if miss >= radius + width {
            return 0.0;
        }
        disc_left_of((miss + radius) / width) - disc_left_of((miss - radius) / width)
    }

    /// True if the solid may hide part of the lamp from a point within `spread` mm of this one. May be true wrongly,
    /// never false wrongly.
    pub fn may_hide(&self, point: Point3<f64>, spread: f64, solid: &RoundCone) -> bool {
        let (share, _, miss) = closest_approach(point, self.at, solid.a, solid.b);
        miss < solid.radius_a.max(solid.radius_b) + self.radius * share + spread
    }
}

/// Share of the unit disc's area left of the line at `x` (a cubic approximation, within 0.02).
fn disc_left_of(x: f64) -> f64 {
    let u = (0.5 * (x + 1.0)).clamp(0.0, 1.0);
    u * u * (3.0 - 2.0 * u)
}

/// Closest approach of the segments `p→l` and `a→b`: share along the first, share along the second, distance.
fn closest_approach(p: Point3<f64>, l: Point3<f64>, a: Point3<f64>, b: Point3<f64>) -> (f64, f64, f64) {
    let (sight, rod, offset) = (l - p, b - a, p - a);
    let (ss, rr, sr) = (sight.norm_squared(), rod.norm_squared().max(1e-9), sight.dot(&rod));
    let (so, ro) = (sight.dot(&offset), rod.dot(&offset));
    let across = (ss * rr - sr * sr).max(1e-9);
    let mut share = ((sr * ro - so * rr) / across).clamp(0.0, 1.0);
    let mut on_rod = (sr * share + ro) / rr;
    if !(0.0..=1.0).contains(&on_rod) {
        on_rod = on_rod.clamp(0.0, 1.0);
        share = ((sr * on_rod - so) / ss).clamp(0.0, 1.0);
    }
    (share, on_rod, (offset + sight * share - rod * on_rod).norm())
}

/// Reflection properties of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Matt reflectance.
    pub matt: Rgb,
    /// Strength of the lamps' gloss.
    pub gloss: f32,
    /// Blinn–Phong exponent: the larger, the smaller the highlight.
    pub sharpness: i32,
    /// Share of the surroundings that is mirrored at a perpendicular view.
    pub mirror: f32,
}

/// The light in a box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lighting {
    /// Lamps.
    pub lamps: [Lamp; LAMP_COUNT],
    /// Ambient light, as reflected by a white surface.
    pub ambient: Rgb,
    /// Light that polished surfaces mirror from the side of the board.
    pub below: Rgb,
    /// Light that polished surfaces mirror from the side of the lid.
    pub above: Rgb,
    /// Unit vector away from the board.
    pub up: Vector3<f64>,
}

/// A surface's radiance, split by lamp so that shadows can be subtracted later.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplitRadiance {
    /// Radiance without the lamps.
    pub base: Rgb,
    /// Radiance from each lamp, without shadows.
    pub from_lamp: [Rgb; LAMP_COUNT],
}

impl SplitRadiance {
    /// The total radiance, with a share of each lamp hidden.
    pub fn with_hidden(&self, hidden: [f32; LAMP_COUNT]) -> Rgb {
        let mut sum = self.base;
        for (rgb, hidden) in self.from_lamp.iter().zip(hidden) {
            for (channel, value) in sum.iter_mut().zip(rgb) {
                *channel += value * (1.0 - hidden);
            }
        }
        sum
    }
}

impl Lighting {
    /// The radiance of a point with this normal and material towards the camera; `v` is the ray `(x, y, 1)` to the
    /// point.
    pub fn reflect(
        &self,
        point: Point3<f64>,
        normal: Vector3<f64>,
        v: Vector3<f64>,
        material: &Material,
    ) -> SplitRadiance {
        let eye = -v.normalize();
        let facing = eye.dot(&normal).max(0.0);
        let grazing =
            material.mirror + (1.0 - material.mirror) * (1.0 - facing as f32).powi(5) * material.gloss.min(1.0);
        let mirrored = normal * (2.0 * eye.dot(&normal)) - eye;
        let surroundings = blend(self.below, self.above, (0.5 + 0.5 * mirrored.dot(&self.up)) as f32);
        let openness = (0.75 + 0.25 * normal.dot(&self.up)) as f32;
        let base = [0, 1, 2].map(|c| material.matt[c] * self.ambient[c] * openness + grazing * surroundings[c]);
        let from_lamp = self.lamps.map(|lamp| lamp_light(&lamp, point, normal, eye, material));
        SplitRadiance { base, from_lamp }
    }
}

fn lamp_light(lamp: &Lamp, point: Point3<f64>, normal: Vector3<f64>, eye: Vector3<f64>, material: &Material) -> Rgb {
    let towards = lamp.at - point;
    let square = towards.norm_squared();
    let direction = towards / square.sqrt();
    let fall_off = (Lamp::REFERENCE_MM * Lamp::REFERENCE_MM / square).min(6.0) as f32;
    let cosine = direction.dot(&normal).max(0.0) as f32;
    let half = (direction + eye).normalize();
    let glint = if cosine > 0.0 { (half.dot(&normal).max(0.0) as f32).powi(material.sharpness) } else { 0.0 };
    [0, 1, 2].map(|c| lamp.power[c] * fall_off * (material.matt[c] * cosine + material.gloss * glint))
}

fn blend(from: Rgb, to: Rgb, share: f32) -> Rgb {
    [0, 1, 2].map(|c| from[c] + (to[c] - from[c]) * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lamp() -> Lamp {
        Lamp { at: Point3::new(0.0, 0.0, -100.0), radius: 10.0, power: [1.0; 3] }
    }

    fn rod(x: f64) -> RoundCone {
        RoundCone::capsule(Point3::new(x, -500.0, -50.0), Point3::new(x, 500.0, -50.0), 2.0)
    }

    #[test]
    fn a_rod_between_point_and_lamp_hides_the_strip_that_it_covers() {
        // Half-way, the cone of light has radius 5; a strip of ±2 covers 0.4955 of that disc.
        let hidden = lamp().hidden(Point3::origin(), &rod(0.0));
        assert!((hidden - 0.4955).abs() < 0.08, "hidden {hidden}");
    }

    #[test]
    fn a_rod_beside_the_light_hides_nothing() {
        assert_eq!(lamp().hidden(Point3::origin(), &rod(7.5)), 0.0);
        assert!(!lamp().may_hide(Point3::origin(), 0.1, &rod(7.5)));
        assert!(lamp().may_hide(Point3::origin(), 1.0, &rod(7.5)));
    }

    #[test]
    fn hiding_a_lamp_takes_off_exactly_its_light() {
        let lit = SplitRadiance { base: [0.1; 3], from_lamp: [[0.2; 3], [0.4; 3]] };
        assert_eq!(lit.with_hidden([0.0, 0.0]), [0.1 + 0.2 + 0.4; 3]);
        assert_eq!(lit.with_hidden([1.0, 1.0]), [0.1; 3]);
    }
}
