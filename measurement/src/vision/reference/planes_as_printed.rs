//! The edge-crossing planes of Zhou & Payandeh as the thesis prints them (T 4.15–4.20).
//!
//! With the unit normals `n₁`, `n₂` of the planes through camera and borders, both towards the tool:
//! `tan λ = |n₁+n₂|/|n₁−n₂|`, `|CN| = r/sin λ`, `û = (n₁+n₂)/|n₁+n₂|`. The tip is `P = v·|CN|/(v·û)` for the ray `v`
//! of the midline's end, and the axis is that of `P − N`.
//!
//! The point `N` is exact, the tip is not: the ray meets the tube's near rim, and the formula continues it to the axis.
//! The result lies on the axis, but `r/tan β` too far from `N`, for an angle `β` between axis and line of sight: 2.7 mm
//! at 43° and a diameter of 5 mm. [`crate::vision::pose::tangent_planes`] is the corrected method.

use nalgebra::{Point3, Vector3};

use crate::vision::edges::line_fit::BorderLine;
use crate::vision::pose::tangent_planes;
use crate::vision::space::Normalised;
use crate::vision::tube::Tube;

/// The tube between two border lines; the arguments are those of [`tangent_planes::locate`].
pub(super) fn locate(borders: [BorderLine; 2], distal: Normalised, proximal: Normalised, radius: f64) -> Option<Tube> {
    let middle = (distal.ray() + proximal.ray()) * 0.5;
    let [first, second] = borders.map(|line| tangent_planes::touching_plane(line, middle));
    let (sum, difference) = (first + second, first - second);
    let lambda = sum.norm().atan2(difference.norm()); // T 4.16
    let distance = radius / lambda.sin(); // T 4.17
    let towards = sum.try_normalize(1e-12)?;
    let nearest = towards * distance; // T 4.18
    let at_depth_of_axis = |v: Vector3<f64>| v * (distance / v.dot(&towards)); // T 4.19, corrected to a scalar product
    let tip = at_depth_of_axis(distal.ray());
    let line = (tip - nearest).try_normalize(1e-9)?; // T 4.20
    let from_hand = tip - at_depth_of_axis(proximal.ray());
    let axis = if line.dot(&from_hand) >= 0.0 { line } else { -line };
    let in_front = tip.z > 0.0 && middle.dot(&nearest) > 0.0 && tip.iter().all(|c| c.is_finite());
    in_front.then(|| Tube { tip: Point3::from(tip), axis, radius })
}

#[cfg(test)]
mod tests {
    use nalgebra::Point2;
    use proptest::prelude::*;

    use super::*;
    use crate::vision::edges::line_fit;
    use crate::vision::space::CameraPoint;
    use crate::vision::tube::BorderSide;

    fn seen(p: Point3<f64>) -> Option<Point2<f64>> {
        CameraPoint(p).normalised().map(|n| n.0)
    }

    /// The printed pose of a tube from its exact outline.
    fn printed(tube: &Tube) -> Option<Tube> {
        let outline = tube.outline()?;
        let points = |side| (0..5).map(|k| seen(outline.border(side, f64::from(k) * 4.0))).collect::<Option<Vec<_>>>();
        let lines = [line_fit::fit(&points(BorderSide::First)?)?, line_fit::fit(&points(BorderSide::Second)?)?];
        let [end, back] = [0.0, 16.0].map(|back_mm| seen(outline.rim(back_mm, 0.0)));
        locate(lines, Normalised(end?), Normalised(back?), tube.radius)
    }

    proptest! {
        #[test]
        fn the_printed_tip_lies_on_the_axis_by_the_known_error_too_far(
            tip in [-60.0..60.0f64, -60.0..60.0, 100.0..300.0],
            lean in [-1.0..1.0f64, -1.0..1.0, -1.0..1.0],
            radius in 2.0..6.0f64,
        ) {
            let axis = Vector3::from(lean);
            prop_assume!(axis.norm() > 0.3);
            let tube = Tube { tip: Point3::from(tip), axis: axis.normalize(), radius };
            let distance = tube.nearest_to_camera().norm();
            let from_nearest = tube.tip.coords.dot(&tube.axis);
            prop_assume!(distance > 5.0 * radius && from_nearest.abs() > 5.0);
            let Some(found) = printed(&tube) else { return Ok(()) };
            let too_far = radius * from_nearest / (distance - radius); // r/tan β
            prop_assert!((found.tip - tube.tip - tube.axis * too_far).norm() < 1e-4, "{found:?}");
            prop_assert!((found.axis - tube.axis).norm() < 1e-4, "{found:?}");
        }
    }

    #[test]
    fn a_tube_of_5_mm_at_43_degrees_is_2_7_mm_off() {
        let tip = Point3::new(0.0, 0.0, 190.0);
        let angle = 43f64.to_radians();
        let tube = Tube { tip, axis: Vector3::new(angle.sin(), 0.0, angle.cos()), radius: 2.5 };
        assert!(((printed(&tube).unwrap().tip - tip).norm() - 2.7).abs() < 0.1);
    }
}
