//! `z ≈ f·D/width`: the thesis's method after Tonet (T 4.12–4.14), kept as the reference.
//!
//! It takes the width perpendicular to the midline at the band's end for the tube's diameter at the tip, as if the
//! tube lay in the image plane. It is biased by lean, by distance from the picture's centre, and by the rim
//! (METHOD 4.1).

use nalgebra::{Point3, Vector3};

use crate::vision::edges::line_fit::BorderLine;
use crate::vision::space::Normalised;
use crate::vision::tube::Tube;

/// The tube from its width by similar triangles; the arguments are those of [`super::tangent_planes::locate`].
pub fn locate(borders: [BorderLine; 2], distal: Normalised, proximal: Normalised, radius: f64) -> Option<Tube> {
    let along = (distal.0 - proximal.0).try_normalize(1e-12)?;
    let width = borders.map(|line| distance_across(line, distal, along)).into_iter().sum::<Option<f64>>()?;
    let depth = 2.0 * radius / width;
    let sensible = width > 0.0 && depth.is_finite();
    sensible.then(|| Tube {
        tip: Point3::from(distal.ray() * depth),
        axis: Vector3::new(along.x, along.y, 0.0),
        radius,
    })
}

/// Distance from a point to a line, measured perpendicular to `along`.
fn distance_across(line: BorderLine, from: Normalised, along: nalgebra::Vector2<f64>) -> Option<f64> {
    let across = nalgebra::Vector2::new(-along.y, along.x);
    let slope = line.normal.dot(&across);
    (slope.abs() > 1e-9).then(|| (line.distance(from.0) / slope).abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    #[test]
    fn a_tube_across_the_optical_axis_is_as_far_as_its_width_says() {
        let border = |offset: f64| BorderLine { normal: Vector2::new(0.0, 1.0), offset };
        let borders = [border(-0.02), border(0.02)];
        let tube = locate(borders, Normalised::new(0.1, 0.0), Normalised::new(-0.1, 0.0), 4.0).unwrap();
        assert!((tube.tip - Point3::new(20.0, 0.0, 200.0)).norm() < 1e-9);
        assert!((tube.axis - Vector3::x()).norm() < 1e-9);
    }
}
