//! A tube's lean from the known length of its band (METHOD 4.3): a start for [`super::joint_fit`].
//!
//! Both ends are seen in known directions. At a known mean depth two leans put them one band length apart: away from
//! the camera, and towards it.

use nalgebra::Point3;

use crate::vision::space::Normalised;
use crate::vision::tube::Tube;

/// The tube whose band's ends are seen at `[distal, proximal]`, with mean depth `depth_mm`. `sign` 1 puts the distal
/// end farther away, −1 nearer. If the ends are seen farther apart than the length allows, the tube does not lean.
pub fn leaning(ends: [Normalised; 2], depth_mm: f64, length_mm: f64, radius: f64, sign: f64) -> Option<Tube> {
    let (distal, proximal) = (ends[0].ray(), ends[1].ray());
    let (apart, sum) = ((distal - proximal) * depth_mm, distal + proximal);
    // |apart + lean·sum|² = length²
    let (a, b, c) = (sum.norm_squared(), 2.0 * apart.dot(&sum), apart.norm_squared() - length_mm * length_mm);
    let root = (b * b - 4.0 * a * c).max(0.0).sqrt();
    let lean = (-b + sign * root) / (2.0 * a);
    let (tip, back) = (distal * (depth_mm + lean), proximal * (depth_mm - lean));
    let axis = (tip - back).try_normalize(1e-9)?;
    let in_front = tip.z > radius && back.z > radius;
    in_front.then(|| Tube { tip: Point3::from(tip), axis, radius })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::space::CameraPoint;
    use nalgebra::Vector3;

    #[test]
    fn both_leans_span_the_length_and_one_is_the_tube() {
        let axis = Vector3::new(0.4, -0.6, 0.7).normalize();
        let tip = Point3::new(-30.0, 10.0, 190.0);
        let back = tip - axis * 26.0;
        let ends = [tip, back].map(|p| CameraPoint(p).normalised().unwrap());
        let depth = 0.5 * (tip.z + back.z);
        let away = leaning(ends, depth, 26.0, 2.5, 1.0).unwrap();
        assert!((away.tip - tip).norm() < 1e-9 && (away.axis - axis).norm() < 1e-9);
        let towards = leaning(ends, depth, 26.0, 2.5, -1.0).unwrap();
        assert!(towards.axis.z < 0.0);
    }
}
