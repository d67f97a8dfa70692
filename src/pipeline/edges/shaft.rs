//! Which end of a band is the hand's: the one from which the dark shaft goes on (METHOD 3.4, *beyond*).
//!
//! Beyond the distal end there are thin jaws and the scene, beyond the other a tube as wide as the band. Tubes are dark:
//! the thesis finds them by `sqrt(R² + G² + B²)` (T 4.2.1.2); luma and both colour differences measure the same.

use nalgebra::Vector2;

use super::scan_lines::CoarseBand;
use crate::pipeline::frame::Frame;
use crate::pipeline::space::Pixel;

/// Least contrast between both ends that tells a shaft: below it, what lies beyond them is alike.
const LEAST_CONTRAST: f64 = 0.15;

/// Is the shaft beyond the first of the band's two ends? `None` where it is as dark beyond one as beyond the other.
pub fn is_beyond_first(frame: &Frame<'_>, band: &CoarseBand) -> Option<bool> {
    let [back, front] = band.ends;
    let lights = [light_beyond(frame, band, back, -band.axis), light_beyond(frame, band, front, band.axis)];
    let contrast = (lights[0] - lights[1]).abs() / (lights[0] + lights[1]).max(1.0);
    (contrast >= LEAST_CONTRAST).then_some(lights[0] < lights[1])
}

/// Mean distance from black over a strip beyond an end, as wide as the band's core; dark where nothing is in the frame,
/// because only a shaft leaves it.
fn light_beyond(frame: &Frame<'_>, band: &CoarseBand, end: Pixel, outwards: Vector2<f64>) -> f64 {
    const STEPS: usize = 12;
    let across = Vector2::new(-outwards.y, outwards.x);
    let (mut sum, mut count) = (0.0, 0.0);
    for step in 0..STEPS {
        // From a third of a width beyond the end, past the rim's bulge, to one and a half widths.
        let along = band.width_px * (0.35 + 1.2 * step as f64 / STEPS as f64);
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
