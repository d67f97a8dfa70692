//! Which end of a band is the hand's: the one from which the dark shaft goes on (METHOD 3.4, *beyond*).
//!
//! Beyond the distal end there are thin jaws and the scene, beyond the other a tube as wide as the band. Tubes are dark:
//! the thesis finds them by `sqrt(R² + G² + B²)` (T 4.2.1.2); luma and both colour differences measure the same. Dark is the
//! other tool too where it lies beyond the tip, but it lies across: only a shaft in line with the band is dark as far as the
//! band's borders go and not beside them.

use nalgebra::{Point3, Vector2};

use super::scan_lines::CoarseBand;
use crate::pipeline::camera::Camera;
use crate::pipeline::frame::Frame;
use crate::pipeline::space::{CameraPoint, Pixel};
use crate::pipeline::tube::Tube;

/// Least contrast between both ends that tells a shaft: below it, what lies beyond them is alike.
const LEAST_CONTRAST: f64 = 0.15;

/// Is the shaft beyond the first of the band's two ends? `None` where both look alike.
pub fn is_beyond_first(frame: &Frame<'_>, band: &CoarseBand) -> Option<bool> {
    let [back, front] = band.ends;
    let [back, front] = [(back, -band.axis), (front, band.axis)].map(|(end, outwards)| {
        let across = Vector2::new(-outwards.y, outwards.x) * (0.5 * band.width_px);
        let strip = strip_beyond(|widths, radii| {
            let at = end.0 + outwards * (widths * band.width_px) + across * radii;
            light_at(frame, at.x.round(), at.y.round())
        });
        strip.unwrap_or(Strip { light: 0.0, tube: 1.0 }) // only a shaft leaves the frame
    });
    let contrast = back.against(&front);
    (contrast.abs() >= LEAST_CONTRAST).then_some(contrast > 0.0)
}

/// By how much what lies beyond the hand's end of a tube's band is more of a shaft than what lies beyond its tip: −1 to 1, negative
/// where the tube lies the wrong way round. `None` where too little of either is in sight.
pub fn contrast(
    frame: &Frame<'_>,
    camera: &Camera,
    tube: &Tube,
    length_mm: f64,
    is_visible: impl Fn(Point3<f64>, Pixel) -> bool,
) -> Option<f64> {
    let (outline, width_mm) = (tube.outline()?, 2.0 * tube.radius);
    let beyond = |from_mm: f64, sign: f64| {
        strip_beyond(|widths, radii| {
            let back_mm = from_mm + sign * width_mm * widths;
            let is_on_it = radii.abs() <= 1.0;
            let side = usize::from(radii > 0.0);
            let place = if is_on_it { outline.rim(back_mm, radii) } else { outline.beside(side, back_mm, radii.abs()) };
            let at = camera.project(CameraPoint(place)).filter(|at| is_visible(place, *at))?;
            light_at(frame, at.u().round(), at.v().round())
        })
    };
    Some(beyond(length_mm, 1.0)?.against(&beyond(0.0, -1.0)?))
}

/// What lies beyond an end.
struct Strip {
    /// Mean distance from black over what is as wide as the band's core.
    light: f64,
    /// By how much that is darker than what lies to either side of it: 0 to 1.
    tube: f64,
}

impl Strip {
    /// By how much this is more of a shaft than the other: −1 to 1.
    fn against(&self, other: &Strip) -> f64 {
        0.5 * darker(self.light, other.light) + 0.5 * (self.tube - other.tube)
    }
}

/// Looks along a strip beyond an end, from a third of a width, past the rim's bulge, to one and a half; `light` is that of a place
/// so many widths beyond the end and so many radii beside the midline. `None` where too little is in sight.
fn strip_beyond(light: impl Fn(f64, f64) -> Option<f64>) -> Option<Strip> {
    const STEPS: usize = 12;
    const CORE: [f64; 5] = [-0.6, -0.3, 0.0, 0.3, 0.6];
    const BESIDE: f64 = 1.5;
    const FEWEST: usize = 4;
    let (mut core, mut tube) = (Vec::with_capacity(STEPS), Vec::with_capacity(STEPS));
    for step in 0..STEPS {
        let widths = 0.35 + 1.2 * step as f64 / STEPS as f64;
        let Some(within) = mean(CORE.iter().filter_map(|radii| light(widths, *radii))) else { continue };
        core.push(within);
        let sides = [-BESIDE, BESIDE].map(|radii| light(widths, radii));
        if let [Some(one), Some(other)] = sides {
            tube.push(darker(within, one.min(other)).max(0.0));
        }
    }
    let strip = Strip { light: mean(core.iter().copied())?, tube: mean(tube.into_iter()).unwrap_or(0.0) };
    (core.len() >= FEWEST).then_some(strip)
}

/// By how much one light is darker than another, −1 to 1.
fn darker(one: f64, other: f64) -> f64 {
    (other - one) / (one + other).max(1.0)
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    (count > 0.0).then(|| sum / count)
}

fn light_at(frame: &Frame<'_>, x: f64, y: f64) -> Option<f64> {
    let inside = x >= 0.0 && y >= 0.0 && x < frame.width() as f64 && y < frame.height() as f64;
    inside.then(|| {
        let [luma, blue, red] = frame.yuv_at(x as usize, y as usize).map(f64::from);
        luma.hypot((blue - 128.0).hypot(red - 128.0))
    })
}
