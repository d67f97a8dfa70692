//! Finds the hand's end of a band: the dark shaft continues beyond it (METHOD 3.4, *beyond*).
//!
//! Beyond the distal end there are thin jaws and the scene, beyond the other a tube as wide as the band. Tubes are
//! dark: the thesis finds them by `sqrt(R² + G² + B²)` (T 4.2.1.2); luma and both colour differences measure the same.

use nalgebra::{Point3, Vector2};

use super::scan_lines::CoarseBand;
use crate::vision::camera::Camera;
use crate::vision::frame::Frame;
use crate::vision::space::{CameraPoint, Pixel};
use crate::vision::tube::Tube;

/// Minimum contrast between both ends to identify the shaft: below it, they look alike.
const MIN_CONTRAST: f64 = 0.15;

/// Is the shaft beyond the first of the band's two ends? `None` if both ends are about equally dark.
pub fn is_shaft_beyond_first(frame: &Frame<'_>, band: &CoarseBand) -> Option<bool> {
    let [back, front] = band.ends;
    let lights = [light_beyond(frame, band, back, -band.axis), light_beyond(frame, band, front, band.axis)];
    let contrast = (lights[0] - lights[1]).abs() / (lights[0] + lights[1]).max(1.0);
    (contrast >= MIN_CONTRAST).then_some(lights[0] < lights[1])
}

/// How much darker it is beyond the hand's end of a tube's band than beyond its tip: −1 to 1, negative if the tube
/// lies the wrong way round. `None` if too little of either is in sight.
pub fn contrast(
    frame: &Frame<'_>,
    camera: &Camera,
    tube: &Tube,
    length_mm: f64,
    is_visible: impl Fn(Point3<f64>, Pixel) -> bool,
) -> Option<f64> {
    const MIN_POINTS: f64 = 20.0;
    let (outline, width_mm) = (tube.outline()?, 2.0 * tube.radius);
    let beyond = |from_mm: f64, sign: f64| {
        let (mut sum, mut count) = (0.0, 0.0);
        for step in 0..STEPS {
            let back_mm = from_mm + sign * width_mm * beyond_end(step);
            for across in [-0.6, -0.3, 0.0, 0.3, 0.6] {
                let place = outline.rim(back_mm, across);
                let at = camera.project(CameraPoint(place)).filter(|at| is_visible(place, *at));
                if let Some(light) = at.and_then(|at| light_at(frame, at.u().round(), at.v().round())) {
                    sum += light;
                    count += 1.0;
                }
            }
        }
        (count >= MIN_POINTS).then(|| sum / count)
    };
    let (by_hand, by_tip) = (beyond(length_mm, 1.0)?, beyond(0.0, -1.0)?);
    Some((by_tip - by_hand) / (by_tip + by_hand).max(1.0))
}

const STEPS: usize = 12;

/// Distance of a step of the strip beyond an end, in widths: from a third, past the rim's bulge, to one and a half.
fn beyond_end(step: usize) -> f64 {
    0.35 + 1.2 * step as f64 / STEPS as f64
}

/// Mean distance from black over a strip beyond an end, as wide as the band's core. 0 if the strip is outside the
/// frame, because only a shaft leaves the frame.
fn light_beyond(frame: &Frame<'_>, band: &CoarseBand, end: Pixel, outwards: Vector2<f64>) -> f64 {
    let across = Vector2::new(-outwards.y, outwards.x);
    let (mut sum, mut count) = (0.0, 0.0);
    for step in 0..STEPS {
        let along = band.width_px * beyond_end(step);
        for side in [-0.35, -0.2, 0.0, 0.2, 0.35] {
            let at = end.0 + outwards * along + across * (side * band.width_px);
            if let Some(light) = light_at(frame, at.x.round(), at.y.round()) {
                sum += light;
                count += 1.0;
            }
        }
    }
    if count > 0.0 { sum / count } else { 0.0 }
}

fn light_at(frame: &Frame<'_>, x: f64, y: f64) -> Option<f64> {
    let inside = x >= 0.0 && y >= 0.0 && x < frame.width() as f64 && y < frame.height() as f64;
    inside.then(|| {
        let [luma, blue, red] = frame.yuv_at(x as usize, y as usize).map(f64::from);
        luma.hypot((blue - 128.0).hypot(red - 128.0))
    })
}
