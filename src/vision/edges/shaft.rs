//! Finds the hand's end of a band: a tube as wide as the band continues beyond it (METHOD 3.4).
//!
//! Beyond the distal end there are thin jaws and the scene. **Method** The band's two borders are extended beyond either
//! end. Where a tube continues, both extensions show an edge, for a tube of any colour: shafts are black, grey, white
//! or polished. The thesis looks for the darker end instead (T 4.2.1.2), which fails with the others.

use nalgebra::Point3;

use super::edge_model::EdgeModel;
use super::outline_probes::{OutlinePoint, ProbeLayout, border_probes};
use super::probe::Probe;
use crate::vision::camera::Camera;
use crate::vision::frame::Frame;
use crate::vision::space::Pixel;
use crate::vision::tube::Tube;

/// Shares of the places beyond a band's ends where both borders go on, 0 to 1; `None` if too few are in sight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Continuation {
    /// Beyond the proximal end.
    pub by_hand: Option<f64>,
    /// Beyond the distal end.
    pub by_tip: Option<f64>,
}

/// Number of places beyond an end, and their distances from it in diameters: past the rim's bulge, and not farther than
/// the outline is known.
const PLACES: usize = 8;
const FROM_DIAMETERS: f64 = 0.5;
const TO_DIAMETERS: f64 = 2.5;
/// Minimum number of places in sight.
const MIN_PLACES: usize = 4;

impl Continuation {
    /// How much more of a tube is beyond the proximal end: −1 to 1, negative if the band lies the wrong way round.
    pub fn contrast(&self) -> Option<f64> {
        Some(self.by_hand? - self.by_tip?)
    }
}

/// Where the borders of a band go on.
pub fn continuation(
    frame: &Frame<'_>,
    camera: &Camera,
    edges: &EdgeModel,
    tube: &Tube,
    length_mm: f64,
    is_visible: impl Fn(Point3<f64>, Pixel) -> bool,
) -> Continuation {
    let diameter_mm = 2.0 * tube.radius;
    let beyond = |end_mm: f64, sign: f64| {
        let reach = [FROM_DIAMETERS, TO_DIAMETERS].map(|diameters| end_mm + sign * diameters * diameter_mm);
        share_of_tube(frame, camera, edges, tube, [reach[0].min(reach[1]), reach[0].max(reach[1])], &is_visible)
    };
    Continuation { by_hand: beyond(length_mm, 1.0), by_tip: beyond(0.0, -1.0) }
}

/// Share of the places between two distances behind the tip, mm, where both borders of the tube are edges in the
/// pixels.
fn share_of_tube(
    frame: &Frame<'_>,
    camera: &Camera,
    edges: &EdgeModel,
    tube: &Tube,
    [from_mm, to_mm]: [f64; 2],
    is_visible: &impl Fn(Point3<f64>, Pixel) -> bool,
) -> Option<f64> {
    let outline = tube.outline()?;
    let width_px = 2.0 * tube.radius * camera.fx / tube.tip.z.max(1.0);
    let step_mm = (to_mm - from_mm) / PLACES as f64;
    let layout = ProbeLayout {
        chord_px: width_px,
        max_chords: 1.0,
        reach_px: (0.3 * width_px).clamp(4.0, 9.0),
        motion_px_s: Default::default(),
        exposure_s: 0.0,
    };
    let (mut seen, mut found) = (0, 0u16);
    let mut probes = Vec::with_capacity(2);
    for place in 0..PLACES {
        let start_mm = from_mm + step_mm * place as f64;
        probes.clear();
        border_probes(&outline, camera, start_mm, start_mm + step_mm, layout, &mut probes);
        let [one, other] = &probes[..] else { continue };
        let in_sight = |(point, probe): &(OutlinePoint, Probe)| is_visible(point.position_on(&outline), probe.middle);
        if in_sight(one) && in_sight(other) {
            seen += 1;
            let edges_found =
                [one, other].into_iter().filter(|(_, probe)| is_edge(frame, edges, probe, width_px)).count();
            found += [0u16, 1, 4][edges_found];
        }
    }
    (seen >= MIN_PLACES).then(|| f64::from(found) / (4 * seen) as f64)
}

/// Is there one clear edge close to the probe's chord?
fn is_edge(frame: &Frame<'_>, edges: &EdgeModel, probe: &Probe, width_px: f64) -> bool {
    const MIN_EXPLAINED: f64 = 0.3;
    const MIN_OF_BEST: f64 = 0.7;
    let near_px = (0.08 * width_px).max(1.5);
    edges
        .step_within(frame, probe, near_px)
        .is_some_and(|[of_all, of_best]| of_all >= MIN_EXPLAINED && of_best >= MIN_OF_BEST)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::vision::camera::testing::wide;
    use crate::vision::frame::{ColourEncoding, Matrix, Plane, Range};
    use crate::vision::segmentation::samples::UsualColour;

    const LENGTH_MM: f64 = 20.0;
    const BACKGROUND: u8 = 90;

    /// A tube that points to the right, with its tape (luma 150) at the end.
    fn tube() -> Tube {
        Tube { tip: Point3::new(10.0, 4.0, 150.0), axis: Vector3::x(), radius: 4.0 }
    }

    /// How the borders go on beyond the tube's band if the shaft has this luma, and if the band is taken the other way
    /// round.
    fn continuations(shaft: u8) -> [Continuation; 2] {
        let (camera, tube) = (wide(), tube());
        let (width, height) = (camera.width as usize, camera.height as usize);
        let outline = tube.outline().unwrap();
        let luma = |x: usize, y: usize| {
            let Some(ray) = camera.normalised_of(Pixel::new(x as f64, y as f64)).map(|sight| sight.ray()) else {
                return BACKGROUND;
            };
            let ahead_mm = ray.x / ray.z * tube.tip.z - tube.tip.x;
            let inside =
                crate::vision::tube::BorderSide::BOTH.into_iter().all(|side| outline.normal(side).dot(&ray) > 0.0);
            match () {
                _ if !inside || ahead_mm > 0.0 => BACKGROUND,
                _ if ahead_mm > -LENGTH_MM => 150,
                _ => shaft,
            }
        };
        let y: Vec<u8> = (0..width * height).map(|i| luma(i % width, i / width)).collect();
        let grey = vec![128; width * height];
        let plane = |data| Plane { data, stride: width, width, height };
        let encoding = ColourEncoding { range: Range::Limited, matrix: Matrix::Bt709 };
        let (y, u, v) = (plane(&y), plane(&grey), plane(&grey));
        let frame =
            Frame { index: 0, time_s: 0.0, y, u, v, shift_x: 0, shift_y: 0, chroma_first_px: [0.0; 2], encoding };
        let edges = EdgeModel::new(UsualColour { codes: [150.0, 128.0, 128.0], chroma_spread: 5.0 }, encoding);
        let reversed = Tube { tip: tube.tip - tube.axis * LENGTH_MM, axis: -tube.axis, ..tube };
        [tube, reversed].map(|tube| continuation(&frame, &camera, &edges, &tube, LENGTH_MM, |_, _| true))
    }

    #[test]
    fn a_shaft_of_any_colour_shows_the_hand_s_end() {
        for shaft in [20, 60, 130, 230] {
            let [right, wrong] = continuations(shaft);
            assert!(right.contrast().is_some_and(|contrast| contrast > 0.8), "{shaft}: {right:?}");
            assert!(wrong.contrast().is_some_and(|contrast| contrast < -0.8), "{shaft}: {wrong:?}");
        }
    }

    #[test]
    fn a_band_without_a_shaft_has_a_tube_at_neither_end() {
        let [alone, _] = continuations(BACKGROUND);
        assert_eq!((alone.by_hand, alone.by_tip), (Some(0.0), Some(0.0)));
    }
}
