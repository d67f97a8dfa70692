//! The tube's axis from its two border lines, exact under perspective for any lean (METHOD 4.2; Zhou & Payandeh).
//!
//! A border seen as the normalised line `a x + b y + c = 0` spans, with the camera, a plane that touches the cylinder,
//! with unit normal `n = (a, b, c)/|(a, b, c)|`. Then `d = n₁×n₂/|n₁×n₂|` and `N = r·(n₁+n₂)/(1+n₁·n₂)`. The band's
//! distal end is a circle; the midline meets its *near* rim, so the end's ray `λ·v` satisfies `λ·v = N + s·d − r·m`
//! with `m = N/|N|`.

use nalgebra::{Matrix3x2, Point3, Vector3};

use crate::vision::edges::line_fit::BorderLine;
use crate::vision::space::Normalised;
use crate::vision::tube::Tube;

/// The tube between two border lines. `distal` is the pixel direction where the midline meets the near rim; `proximal`
/// is any point of the midline on the hand's side. `None` if the lines enclose no tube.
pub fn locate(borders: [BorderLine; 2], distal: Normalised, proximal: Normalised, radius: f64) -> Option<Tube> {
    let middle = (distal.ray() + proximal.ray()) * 0.5;
    let [first, second] = borders.map(|line| touching_plane(line, middle));
    let axis = first.cross(&second).try_normalize(1e-12)?;
    let nearest = (first + second) * (radius / (1.0 + first.dot(&second)));
    let rim = nearest - nearest.normalize() * radius;
    let tip_along = |v: Vector3<f64>| along_axis(v, rim, axis);
    let (to_distal, to_proximal) = (tip_along(distal.ray())?, tip_along(proximal.ray())?);
    let axis_to_tip = if to_distal >= to_proximal { axis } else { -axis };
    let tip = nearest + axis * to_distal;
    let in_front = tip.z > 0.0 && middle.dot(&nearest) > 0.0 && tip.iter().all(|c| c.is_finite());
    in_front.then(|| Tube { tip: Point3::from(tip), axis: axis_to_tip, radius })
}

/// Distance behind the tip, mm, of the tube's near side in this direction.
pub fn distance_behind_tip(tube: &Tube, seen: Normalised) -> Option<f64> {
    let nearest = tube.nearest_to_camera();
    let rim = nearest - nearest.try_normalize(1e-12)? * tube.radius;
    let along = along_axis(seen.ray(), rim, tube.axis)?;
    Some(tube.tip.coords.dot(&tube.axis) - along)
}

/// Unit normal of the plane through the camera and a line, towards the tube.
pub fn touching_plane(line: BorderLine, inside: Vector3<f64>) -> Vector3<f64> {
    let normal = Vector3::new(line.normal.x, line.normal.y, -line.offset).normalize();
    if normal.dot(&inside) >= 0.0 { normal } else { -normal }
}

/// `s` of the point `rim + s·axis` nearest to the ray along `v`.
fn along_axis(v: Vector3<f64>, rim: Vector3<f64>, axis: Vector3<f64>) -> Option<f64> {
    let system = Matrix3x2::from_columns(&[v, -axis]);
    let solution = (system.transpose() * system).try_inverse()? * system.transpose() * rim;
    (solution[0] > 0.0).then_some(solution[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::edges::line_fit;
    use crate::vision::space::CameraPoint;
    use crate::vision::tube::BorderSide;
    use nalgebra::Point2;
    use proptest::prelude::*;

    fn seen(p: Point3<f64>) -> Option<Point2<f64>> {
        CameraPoint(p).normalised().map(|n| n.0)
    }

    proptest! {
        #[test]
        fn a_tube_is_found_again_from_its_outline_for_any_lean(
            tip in [-60.0..60.0f64, -60.0..60.0, 100.0..300.0],
            lean in [-1.0..1.0f64, -1.0..1.0, -1.0..1.0],
            radius in 2.0..6.0f64,
        ) {
            let axis = Vector3::from(lean);
            prop_assume!(axis.norm() > 0.3);
            let tube = Tube { tip: Point3::from(tip), axis: axis.normalize(), radius };
            prop_assume!(tube.nearest_to_camera().norm() > 5.0 * radius); // not seen end-on
            let Some(outline) = tube.outline() else { return Ok(()) };
            let point = |side, k| seen(outline.border(side, f64::from(k) * 4.0));
            let points = |side| (0..5).map(|k| point(side, k)).collect::<Option<Vec<_>>>();
            let (Some(left), Some(right)) = (points(BorderSide::First), points(BorderSide::Second)) else { return Ok(()) };
            let (Some(a), Some(b)) = (line_fit::fit(&left), line_fit::fit(&right)) else { return Ok(()) };
            let ends = (seen(outline.rim(0.0, 0.0)), seen(outline.rim(16.0, 0.0)));
            let (Some(end), Some(back)) = ends else { return Ok(()) };
            let found = locate([a, b], Normalised(end), Normalised(back), radius);
            prop_assert!(found.is_some());
            let found = found.unwrap();
            prop_assert!((found.tip - tube.tip).norm() < 1e-6, "{} off", (found.tip - tube.tip).norm());
            prop_assert!((found.axis - tube.axis).norm() < 1e-6);
        }
    }
}
