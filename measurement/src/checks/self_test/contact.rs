//! The point where a resting rod meets a board.
//!
//! ```text
//!      axis a ╲  ╲          The tracked tip is the centre of the end disc. A leaning rod rests on the lowest point
//!              ╲  ╲         of the disc's rim: tip + r·d, where d is the way into the board made perpendicular
//!   tip ·───────╲──● rim    to the axis. A rod that ends in a point rests on that: tip + reach·a.
//!  ═══════════════▲═════ board, normal n towards the camera
//! ```

use nalgebra::{Point3, Vector3};

/// A rod that leans by less than this against the board's normal (sine) rests on its whole end: no point of the rim is
/// the lowest, and the middle counts. 3°: hands do not hold a rod straighter.
const UPRIGHT_SINE: f64 = 0.05;

/// The end of a rod.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rod {
    /// Radius over the tape, mm.
    pub radius_mm: f64,
    /// Distance from the tape to the rod's point, mm; 0 if the tape ends at a flat end.
    pub reach_mm: f64,
}

impl Rod {
    /// The point where the rod touches a board, given the rod's tip and axis (unit, towards the tip) and the board's
    /// normal (unit, towards the camera).
    pub fn contact(&self, tip_mm: Point3<f64>, axis: Vector3<f64>, normal: Vector3<f64>) -> Point3<f64> {
        if self.reach_mm > 0.0 {
            return tip_mm + axis * self.reach_mm;
        }
        let across = axis * normal.dot(&axis) - normal;
        let lean = across.norm();
        if lean < UPRIGHT_SINE { tip_mm } else { tip_mm + across * (self.radius_mm / lean) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLAT: Rod = Rod { radius_mm: 2.5, reach_mm: 0.0 };

    #[test]
    fn a_leaning_rod_rests_on_the_lowest_point_of_its_rim() {
        let (tip, normal) = (Point3::new(3.0, -4.0, 200.0), -Vector3::z());
        for lean in [0.2, 0.6, 1.2f64] {
            let axis = Vector3::new(lean.sin(), 0.0, lean.cos());
            let contact = FLAT.contact(tip, axis, normal);
            assert!((contact - tip).dot(&axis).abs() < 1e-12, "it lies on the end disc");
            assert!(((contact - tip).norm() - 2.5).abs() < 1e-12, "on its rim");
            assert!((contact.z - tip.z - 2.5 * lean.sin()).abs() < 1e-12, "at its lowest point");
        }
    }

    #[test]
    fn a_rod_that_stands_straight_rests_on_its_middle_and_a_pointed_one_on_its_point() {
        let tip = Point3::new(0.0, 0.0, 200.0);
        assert_eq!(FLAT.contact(tip, Vector3::z(), -Vector3::z()), tip);
        let pointed = Rod { reach_mm: 17.0, ..FLAT };
        let axis = Vector3::new(0.6, 0.0, 0.8);
        assert_eq!(pointed.contact(tip, axis, -Vector3::z()), tip + axis * 17.0);
    }
}
