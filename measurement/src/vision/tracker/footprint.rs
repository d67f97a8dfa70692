//! The area of a measured band in the picture, as a rectangle. Answers which cells belong to it, and whether two
//! measurements are of the same band.

use nalgebra::{Point2, Vector2};

use super::measurement::Measurement;
use crate::vision::camera::Camera;
use crate::vision::space::CameraPoint;

/// A band's rectangle, pixels.
#[derive(Clone, Copy, Debug)]
pub struct Footprint {
    middle: Point2<f64>,
    /// Unit vector towards the tip.
    along: Vector2<f64>,
    half_length: f64,
    half_width: f64,
}

/// Two bands whose directions differ by less than this may be the same: sine of 17°.
const SAME_DIRECTION_SINE: f64 = 0.3;

impl Footprint {
    /// Footprint of a measured band; `None` if it is not in front of the camera.
    pub fn of(measurement: &Measurement, camera: &Camera) -> Option<Self> {
        let tube = measurement.estimate.tube;
        let length_mm = measurement.length_mm.max(4.0 * tube.radius); // the width method gives no length
        let pixel = |back_mm: f64| camera.project(CameraPoint(tube.tip - tube.axis * back_mm)).map(|p| p.0);
        let (tip, back) = (pixel(0.0)?, pixel(length_mm)?);
        Some(Self {
            middle: nalgebra::center(&tip, &back),
            along: (tip - back).try_normalize(1e-9)?,
            half_length: 0.5 * (tip - back).norm(),
            half_width: tube.radius * camera.fx / tube.tip.z,
        })
    }

    /// A band that lies along a row.
    #[cfg(test)]
    pub fn lying_at(middle: Point2<f64>) -> Self {
        Self { middle, along: Vector2::x(), half_length: 40.0, half_width: 12.0 }
    }

    /// Does the footprint contain this pixel, with a margin for blur?
    pub fn contains(&self, at: Point2<f64>) -> bool {
        let margin = 4.0 + 0.2 * self.half_width;
        self.is_within(at, margin)
    }

    /// Are both the same band, perhaps measured from opposite ends?
    pub fn is_same_band(&self, other: &Self) -> bool {
        let turn = self.along.x * other.along.y - self.along.y * other.along.x;
        turn.abs() < SAME_DIRECTION_SINE && (self.is_within(other.middle, 0.0) || other.is_within(self.middle, 0.0))
    }

    /// Distance of both middles, pixels.
    pub fn distance_px(&self, other: &Self) -> f64 {
        (self.middle - other.middle).norm()
    }

    fn is_within(&self, at: Point2<f64>, margin: f64) -> bool {
        let from = at - self.middle;
        let across = from.x * self.along.y - from.y * self.along.x;
        from.dot(&self.along).abs() <= self.half_length + margin && across.abs() <= self.half_width + margin
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64, y: f64, along: Vector2<f64>) -> Footprint {
        Footprint { middle: Point2::new(x, y), along: along.normalize(), half_length: 60.0, half_width: 12.0 }
    }

    #[test]
    fn a_band_is_recognised_from_either_end_and_differs_from_one_it_crosses() {
        let band = at(100.0, 100.0, Vector2::new(1.0, 0.1));
        assert!(band.is_same_band(&at(110.0, 104.0, Vector2::new(-1.0, 0.0))));
        assert!(!band.is_same_band(&at(100.0, 100.0, Vector2::new(0.5, 1.0))), "crosses it");
        assert!(!band.is_same_band(&at(100.0, 130.0, Vector2::new(1.0, 0.1))), "lies beside it");
    }

    #[test]
    fn its_cells_are_those_under_it_and_its_blur() {
        let band = at(100.0, 100.0, Vector2::x());
        assert!(band.contains(Point2::new(45.0, 90.0)) && band.contains(Point2::new(100.0, 117.0)));
        assert!(!band.contains(Point2::new(100.0, 121.0)) && !band.contains(Point2::new(30.0, 100.0)));
    }
}
