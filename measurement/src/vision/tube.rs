//! The tool as a solid: a cylinder of known radius, and its exact outline as the camera sees it.
//!
//! Let the axis be `d` (unit, from the hand to the tip), its point nearest to the camera `N`, and the radius `r`. The
//! two planes through the camera that touch the cylinder have unit normals `n₁`, `n₂` with `n·d = 0` and `n·N = r`
//! (METHOD 4). Each plane touches the cylinder along a line; these two lines are the borders of the tube in the
//! picture. Of a circle round the axis, the camera sees the *near* half between the two lines.

use std::ops::{Index, IndexMut};

use nalgebra::{Point3, Vector3};

/// A tube that ends at its tip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tube {
    /// Centre of the distal end, on the axis, camera frame, mm.
    pub tip: Point3<f64>,
    /// Unit vector along the axis from the hand to the tip.
    pub axis: Vector3<f64>,
    /// Radius, mm.
    pub radius: f64,
}

/// Outline of a tube as the camera sees it. The parts that are the same for all points of the outline are computed
/// once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outline {
    tube: Tube,
    /// Unit normals of the two tangent planes, both pointing to the side of the tube.
    normals: [Vector3<f64>; 2],
    towards_camera: Vector3<f64>,
    sideways: Vector3<f64>,
    half_angle: f64,
}

impl Tube {
    /// The point of the axis nearest to the camera.
    pub fn nearest_to_camera(&self) -> Vector3<f64> {
        self.tip.coords - self.axis * self.tip.coords.dot(&self.axis)
    }

    /// The outline; `None` if the camera would be inside the tube or the tube behind the camera.
    pub fn outline(&self) -> Option<Outline> {
        let nearest = self.nearest_to_camera();
        let distance = nearest.norm();
        if !(distance > self.radius * 1.001 && self.radius > 0.0 && distance.is_finite()) {
            return None;
        }
        let away = nearest / distance;
        let sideways = self.axis.cross(&away);
        let cos = self.radius / distance;
        let sin = (1.0 - cos * cos).sqrt();
        Some(Outline {
            tube: *self,
            normals: [away * cos + sideways * sin, away * cos - sideways * sin],
            towards_camera: -away,
            sideways,
            half_angle: cos.acos(),
        })
    }
}

/// One of the two borders of a tube in the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BorderSide {
    /// Where [`Outline::rim`] begins: `across` = −1.
    First,
    /// Where it ends: `across` = 1.
    Second,
}

impl BorderSide {
    /// Both borders.
    pub const BOTH: [Self; 2] = [Self::First, Self::Second];

    /// The other border.
    pub fn opposite(self) -> Self {
        match self {
            Self::First => Self::Second,
            Self::Second => Self::First,
        }
    }
}

/// A part of a band's outline: each has its own light, and its own offset from the true outline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutlinePart {
    /// A border, where the surface turns away from the camera.
    Border(BorderSide),
    /// The rim of the band's distal end.
    DistalEnd,
    /// The rim of the band's proximal end.
    ProximalEnd,
}

impl OutlinePart {
    /// Both ends of the band.
    pub const ENDS: [Self; 2] = [Self::DistalEnd, Self::ProximalEnd];

    /// Its place in arrays with one entry for each part: borders first.
    pub fn index(self) -> usize {
        match self {
            Self::Border(side) => side as usize,
            Self::DistalEnd => 2,
            Self::ProximalEnd => 3,
        }
    }

    /// Is it a border, not an end?
    pub fn is_border(self) -> bool {
        matches!(self, Self::Border(_))
    }
}

/// One value for each part of an outline.
#[derive(Clone, Copy, Debug, Default)]
pub struct PerPart<T>(pub [T; 4]);

impl<T> Index<OutlinePart> for PerPart<T> {
    type Output = T;

    fn index(&self, part: OutlinePart) -> &T {
        &self.0[part.index()]
    }
}

impl<T> IndexMut<OutlinePart> for PerPart<T> {
    fn index_mut(&mut self, part: OutlinePart) -> &mut T {
        &mut self.0[part.index()]
    }
}

/// Usual thickness of tape, mm: most vinyl tapes have 0.10 to 0.18.
pub const TAPE_THICKNESS_MM: f64 = 0.13;

/// Reach of the jaws beyond the tip, mm. Generous, because points that the jaws may hide are only left out.
const JAWS_MM: f64 = 30.0;

impl Outline {
    /// Does the tube, with its jaws, hide a point `depth_mm` away in direction `sight`? `margin` widens the tube on
    /// both sides, radians.
    pub fn hides(&self, sight: Vector3<f64>, depth_mm: f64, margin: f64) -> bool {
        let ray = sight.normalize();
        if self.normals.iter().any(|normal| normal.dot(&ray) < -margin) {
            return false;
        }
        // Point of the axis nearest to the ray.
        let axis = self.tube.axis;
        let (along, tip) = (ray.dot(&axis), self.tube.tip.coords);
        let apart = 1.0 - along * along;
        if apart < 1e-9 {
            return false;
        }
        let ahead_mm = (along * ray.dot(&tip) - axis.dot(&tip)) / apart;
        let there = tip + axis * ahead_mm;
        ahead_mm < JAWS_MM && there.z > 0.0 && there.z < depth_mm
    }

    /// Can the tube, with its jaws, hide a point of the convex body with these corners? The border where all of them lie
    /// beside the tube is one where the whole body does, because a point's distance from a plane, and its own from the
    /// camera, are convex.
    pub fn may_hide(&self, corners: &[Point3<f64>], margin: f64) -> bool {
        /// Keeps the rounding of [`Self::hides`] from mattering, radians.
        const SURELY: f64 = 1e-9;
        let is_beside = |normal: &Vector3<f64>, corner: &Point3<f64>| {
            normal.dot(&corner.coords) < -(margin + SURELY) * corner.coords.norm()
        };
        !self.normals.iter().any(|normal| corners.iter().all(|corner| is_beside(normal, corner)))
    }

    /// Corners of a convex body around the near half of the tube, between two distances behind the tip.
    pub fn hull(&self, backs_mm: [f64; 2]) -> [Point3<f64>; 8] {
        let [first, second] = BorderSide::BOTH;
        let nearer = self.towards_camera * self.tube.radius;
        let [[a, b], [c, d]] = backs_mm.map(|back_mm| [first, second].map(|side| self.border(side, back_mm)));
        [a, b, c, d, a + nearer, b + nearer, c + nearer, d + nearer]
    }

    /// Unit normal of the plane through the camera that touches the tube at a border; it points to the side of the
    /// tube.
    pub fn normal(&self, side: BorderSide) -> Vector3<f64> {
        self.normals[side as usize]
    }

    /// Point of a border on the tube, `back_mm` behind the tip.
    pub fn border(&self, side: BorderSide, back_mm: f64) -> Point3<f64> {
        self.on_axis(back_mm) - self.normal(side) * self.tube.radius
    }

    /// The corners of a band of this length on the borders, first the distal ones.
    pub fn corners(&self, length_mm: f64) -> [Point3<f64>; 4] {
        let [first, second] = BorderSide::BOTH;
        [(first, 0.0), (second, 0.0), (first, length_mm), (second, length_mm)]
            .map(|(side, back_mm)| self.border(side, back_mm))
    }

    /// Point on the near half of the circle `back_mm` behind the tip. `across` goes from −1 (first border) through 0
    /// (midline) to 1 (second border).
    pub fn rim(&self, back_mm: f64, across: f64) -> Point3<f64> {
        self.on_axis(back_mm) + self.from_axis(across)
    }

    /// Point of the axis, `back_mm` behind the tip.
    pub fn on_axis(&self, back_mm: f64) -> Point3<f64> {
        self.tube.tip - self.tube.axis * back_mm
    }

    /// From the axis to a point on the near half of the circle, mm. `across` is as in [`Self::rim`].
    pub fn from_axis(&self, across: f64) -> Vector3<f64> {
        let (sin, cos) = (across * self.half_angle).sin_cos();
        (self.towards_camera * cos + self.sideways * sin) * self.tube.radius
    }

    /// Point where the tape ends in the picture, at a band's end `back_mm` behind the tip: on its rim, or, if the camera
    /// sees the face of the tape's proximal end, where this face meets the tube. `across` is as in [`Self::rim`].
    pub fn tape_end(&self, back_mm: f64, across: f64) -> Point3<f64> {
        let rim = self.rim(back_mm, across);
        let is_face_in_sight = back_mm > 0.0 && self.tube.axis.dot(&rim.coords) > 0.0;
        if !is_face_in_sight {
            return rim;
        }
        let centre = self.tube.tip - self.tube.axis * back_mm;
        rim + (centre - rim) * (TAPE_THICKNESS_MM / self.tube.radius).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_touching_planes_hold_the_camera_and_touch_the_tube(
            tip in [-60.0..60.0f64, -60.0..60.0, 80.0..300.0],
            lean in [-1.0..1.0f64, -1.0..1.0, -1.0..1.0],
        ) {
            let axis = Vector3::from(lean);
            prop_assume!(axis.norm() > 0.1);
            let tube = Tube { tip: Point3::from(tip), axis: axis.normalize(), radius: 4.0 };
            let Some(outline) = tube.outline() else { return Ok(()) };
            for side in BorderSide::BOTH {
                let normal = outline.normal(side);
                prop_assert!((normal.norm() - 1.0).abs() < 1e-9);
                prop_assert!(normal.dot(&tube.axis).abs() < 1e-9);
                prop_assert!((normal.dot(&tube.nearest_to_camera()) - tube.radius).abs() < 1e-9);
                prop_assert!(normal.dot(&outline.border(side, 7.0).coords).abs() < 1e-9);
                let across = if side == BorderSide::First { -1.0 } else { 1.0 };
                prop_assert!((outline.rim(7.0, across) - outline.border(side, 7.0)).norm() < 1e-9);
            }
        }
    }

    proptest! {
        #[test]
        fn what_may_not_hide_a_hull_hides_no_place_of_its_tube(
            tips in [[-60.0..60.0f64, -60.0..60.0, 80.0..300.0], [-60.0..60.0f64, -60.0..60.0, 80.0..300.0]],
            leans in [[-1.0..1.0f64, -1.0..1.0, -1.0..1.0], [-1.0..1.0f64, -1.0..1.0, -1.0..1.0]],
            (back_mm, across) in (-35.0..70.0f64, -1.0..1.0f64),
        ) {
            const MARGIN: f64 = 0.003;
            prop_assume!(leans.iter().all(|lean| Vector3::from(*lean).norm() > 0.1));
            let tube = |i: usize| Tube {
                tip: Point3::from(tips[i]),
                axis: Vector3::from(leans[i]).normalize(),
                radius: 2.5,
            };
            let [Some(tool), Some(other)] = [0, 1].map(|i| tube(i).outline()) else { return Ok(()) };
            let place = tool.rim(back_mm, across);
            let is_hidden = other.hides(place.coords, place.z, MARGIN);
            prop_assert!(!is_hidden || other.may_hide(&tool.hull([70.0, -35.0]), MARGIN));
        }
    }

    #[test]
    fn a_tool_beside_another_may_hide_nothing_of_it() {
        let along_x =
            |y: f64| Tube { tip: Point3::new(0.0, y, 150.0), axis: Vector3::x(), radius: 2.5 }.outline().unwrap();
        let hull = along_x(0.0).hull([70.0, -35.0]);
        assert!(along_x(4.0).may_hide(&hull, 0.0) && !along_x(6.0).may_hide(&hull, 0.0));
    }

    #[test]
    fn the_face_of_the_tape_s_proximal_end_shows_only_from_behind() {
        let leaning = |lean: f64| Tube {
            tip: Point3::new(0.0, 0.0, 150.0),
            axis: Vector3::new(1.0, 0.0, lean).normalize(),
            radius: 2.5,
        };
        let [away, towards] = [0.8, -0.8].map(|lean| leaning(lean).outline().unwrap());
        assert!(((away.tape_end(20.0, 0.0) - away.rim(20.0, 0.0)).norm() - TAPE_THICKNESS_MM).abs() < 1e-9);
        assert_eq!(towards.tape_end(20.0, 0.0), towards.rim(20.0, 0.0));
        assert_eq!(away.tape_end(0.0, 0.0), away.rim(0.0, 0.0), "the distal end");
    }

    #[test]
    fn a_tube_hides_what_lies_behind_it_and_nothing_beside_before_or_far_ahead_of_it() {
        let tube = Tube { tip: Point3::new(0.0, 0.0, 150.0), axis: Vector3::x(), radius: 4.0 };
        let outline = tube.outline().unwrap();
        let seen = |x: f64, y: f64| Vector3::new(x, y, 150.0);
        assert!(outline.hides(seen(-20.0, 1.0), 200.0, 0.0));
        assert!(!outline.hides(seen(-20.0, 1.0), 120.0, 0.0), "in front of the tube");
        assert!(!outline.hides(seen(-20.0, 6.0), 200.0, 0.0), "beside the tube");
        assert!(!outline.hides(seen(50.0, 0.0), 200.0, 0.0), "beyond the jaws");
    }
}
