//! Finds the hand's end of a band: a tube as wide as the band continues beyond it (METHOD 3.4).
//!
//! Beyond the distal end there are thin jaws and the scene. **Method** The band's two borders are extended beyond either
//! end. Where a tube continues, both extensions show an edge, for a tube of any colour: shafts are black, grey, white
//! or polished. The thesis looks for the darker end instead (T 4.2.1.2), which fails with the others.

use nalgebra::Point3;

use super::edge_model::EdgeModel;
use super::outline_probes::{OutlinePoint, ProbeLayout, border_probes};
use super::probe::Probe;
use super::subpixel::StepShares;
use crate::vision::camera::Camera;
use crate::vision::frame::Frame;
use crate::vision::space::Pixel;
use crate::vision::tube::{Outline, Tube};

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
/// Minimum share of the pixels' variance that a clear edge explains.
const MIN_EXPLAINED: f64 = 0.3;
/// Minimum number of places in sight.
const MIN_PLACES: usize = 4;

/// How much of a shaft was seen behind a band over many frames.
#[derive(Clone, Copy, Debug, Default)]
pub struct SeenShaft {
    sum: f64,
    frames: u32,
}

impl SeenShaft {
    /// Adds a frame.
    pub fn add(&mut self, continuation: &Continuation) {
        if let Some(by_hand) = continuation.by_hand {
            *self = Self { sum: self.sum + by_hand, frames: self.frames + 1 };
        }
    }

    /// Was no shaft seen, or only pieces of one? Then something else of the tape's colour was followed.
    pub fn is_missing(&self) -> bool {
        /// Over 102 ray-traced recordings, it was above 0.72 for tools, and below 0.48 for most other things that were
        /// followed.
        const MIN_MEAN: f64 = 0.6;
        self.frames > 0 && self.sum < MIN_MEAN * f64::from(self.frames)
    }
}

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

/// By how much the borders of the tube beyond a band's proximal end lie outside the band's own borders, pixels; 0 where
/// no border is clear. A shaft is not wider than the tape around it. If it seems so, an edge inside the tape, of shade
/// or of gloss, was taken for its border.
pub fn border_offsets_px(
    frame: &Frame<'_>,
    camera: &Camera,
    edges: &EdgeModel,
    tube: &Tube,
    length_mm: f64,
    is_visible: impl Fn(Point3<f64>, Pixel) -> bool,
) -> Option<[f64; 2]> {
    /// Search distances inwards and outwards, as shares of the width, and their limits in pixels: shade or gloss covers
    /// less than half of a tube, and a tape is less than 0.2 of its shaft's radius thick.
    const SEARCH: [f64; 2] = [0.2, 0.5];
    const SEARCH_PX: (f64, f64) = (3.0, 12.0);
    let outline = tube.outline()?;
    let diameter_mm = 2.0 * tube.radius;
    let width_px = diameter_mm * camera.fx / tube.tip.z.max(1.0);
    let [inwards_px, outwards_px] = SEARCH.map(|share| (share * width_px).clamp(SEARCH_PX.0, SEARCH_PX.1));
    let reach = [FROM_DIAMETERS, TO_DIAMETERS].map(|diameters| length_mm + diameters * diameter_mm);
    let mut steps = [StepShares::default(); 2];
    for (point, probe) in probes_beyond(&outline, camera, reach, width_px, outwards_px).into_iter().flatten() {
        if is_visible(point.position_on(&outline), probe.middle) {
            let probe = Probe { inwards_px, outwards_px, ..probe };
            steps[point.part().index()].add(edges, frame, &probe);
        }
    }
    let clear_px = |steps: &StepShares| steps.best(MIN_PLACES).filter(|(_, share)| *share >= MIN_EXPLAINED);
    Some(steps.map(|steps| clear_px(&steps).map_or(0.0, |(at_px, _)| at_px)))
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
    let (mut seen, mut found) = (0, 0u16);
    for pair in probes_beyond(&outline, camera, [from_mm, to_mm], width_px, (0.3 * width_px).clamp(4.0, 9.0)) {
        let [one, other] = &pair[..] else { continue };
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

/// Probes of both borders at the places between two distances behind the tip, mm.
fn probes_beyond(
    outline: &Outline,
    camera: &Camera,
    [from_mm, to_mm]: [f64; 2],
    width_px: f64,
    reach_px: f64,
) -> [Vec<(OutlinePoint, Probe)>; PLACES] {
    let step_mm = (to_mm - from_mm) / PLACES as f64;
    let layout =
        ProbeLayout { chord_px: width_px, max_chords: 1.0, reach_px, motion_px_s: Default::default(), exposure_s: 0.0 };
    std::array::from_fn(|place| {
        let (start_mm, mut probes) = (from_mm + step_mm * place as f64, Vec::with_capacity(2));
        border_probes(outline, camera, start_mm, start_mm + step_mm, layout, &mut probes);
        probes
    })
}

/// Is there one clear edge close to the probe's chord?
fn is_edge(frame: &Frame<'_>, edges: &EdgeModel, probe: &Probe, width_px: f64) -> bool {
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
    use crate::vision::edges::edge_model::Likeness;
    use crate::vision::frame::{ColourEncoding, Matrix, Plane, Range};
    use crate::vision::segmentation::samples::UsualColour;
    use crate::vision::tube::BorderSide;

    const LENGTH_MM: f64 = 20.0;
    const BACKGROUND: u8 = 90;
    const ENCODING: ColourEncoding = ColourEncoding { range: Range::Limited, matrix: Matrix::Bt709 };

    /// A tube that points to the right, with its tape (luma 150) at the end.
    fn tube() -> Tube {
        Tube { tip: Point3::new(10.0, 4.0, 150.0), axis: Vector3::x(), radius: 4.0 }
    }

    /// A picture of the tube whose shaft has a luma.
    struct Scene {
        camera: Camera,
        luma: Vec<u8>,
        grey: Vec<u8>,
    }

    impl Scene {
        fn new(shaft: u8) -> Self {
            let (camera, tube) = (wide(), tube());
            let (width, height) = (camera.width as usize, camera.height as usize);
            let outline = tube.outline().unwrap();
            let luma = |x: usize, y: usize| {
                let Some(ray) = camera.normalised_of(Pixel::new(x as f64, y as f64)).map(|sight| sight.ray()) else {
                    return BACKGROUND;
                };
                let ahead_mm = ray.x / ray.z * tube.tip.z - tube.tip.x;
                let inside = BorderSide::BOTH.into_iter().all(|side| outline.normal(side).dot(&ray) > 0.0);
                match () {
                    _ if !inside || ahead_mm > 0.0 => BACKGROUND,
                    _ if ahead_mm > -LENGTH_MM => 150,
                    _ => shaft,
                }
            };
            let luma = (0..width * height).map(|i| luma(i % width, i / width)).collect();
            Self { camera, luma, grey: vec![128; width * height] }
        }

        fn frame(&self) -> Frame<'_> {
            let (width, height) = (self.camera.width as usize, self.camera.height as usize);
            let plane = |data| Plane { data, stride: width, width, height };
            let (y, u, v) = (plane(&self.luma), plane(&self.grey), plane(&self.grey));
            let (index, time_s, encoding) = (0, 0.0, ENCODING);
            Frame { index, time_s, y, u, v, shift_x: 0, shift_y: 0, chroma_first_px: [0.0; 2], encoding }
        }

        fn edges() -> EdgeModel {
            EdgeModel::new(
                UsualColour { codes: [150.0, 128.0, 128.0], luma_spread: 5.0, chroma_spread: 5.0 },
                Likeness::Chroma,
                ENCODING,
            )
        }

        fn continuation(&self, tube: &Tube) -> Continuation {
            continuation(&self.frame(), &self.camera, &Self::edges(), tube, LENGTH_MM, |_, _| true)
        }

        fn border_offsets_px(&self, tube: &Tube) -> [f64; 2] {
            border_offsets_px(&self.frame(), &self.camera, &Self::edges(), tube, LENGTH_MM, |_, _| true).unwrap()
        }
    }

    /// How the borders go on beyond the tube's band if the shaft has this luma, and if the band is taken the other way
    /// round.
    fn continuations(shaft: u8) -> [Continuation; 2] {
        let (scene, tube) = (Scene::new(shaft), tube());
        let reversed = Tube { tip: tube.tip - tube.axis * LENGTH_MM, axis: -tube.axis, ..tube };
        [tube, reversed].map(|tube| scene.continuation(&tube))
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
    fn a_band_taken_too_narrow_shows_a_wider_shaft() {
        let scene = Scene::new(20);
        let drawn = tube();
        let width_px = 2.0 * drawn.radius * scene.camera.fx / drawn.tip.z;
        let [one, other] = scene.border_offsets_px(&drawn);
        assert!(one.abs() <= 0.5 && other.abs() <= 0.5, "{one} {other}");
        for share in [0.7, 0.85] {
            let narrow = Tube { radius: share * drawn.radius, ..drawn };
            let missing_px = 0.5 * (1.0 - share) * width_px;
            for offset_px in scene.border_offsets_px(&narrow) {
                assert!((offset_px - missing_px).abs() <= 0.75, "{share}: {offset_px} for {missing_px}");
            }
        }
        assert_eq!(Scene::new(BACKGROUND).border_offsets_px(&drawn), [0.0; 2], "no shaft");
    }

    #[test]
    fn a_shaft_is_missing_if_few_of_its_borders_are_seen() {
        let seen = |shares: &[Option<f64>]| {
            let mut seen = SeenShaft::default();
            shares.iter().for_each(|by_hand| seen.add(&Continuation { by_hand: *by_hand, by_tip: Some(0.0) }));
            seen.is_missing()
        };
        assert!(!seen(&[]) && !seen(&[None]), "not looked at");
        assert!(!seen(&[Some(1.0), Some(0.5), None]));
        assert!(seen(&[Some(0.8), Some(0.25)]));
    }

    #[test]
    fn a_band_without_a_shaft_has_a_tube_at_neither_end() {
        let [alone, _] = continuations(BACKGROUND);
        assert_eq!((alone.by_hand, alone.by_tip), (Some(0.0), Some(0.0)));
    }
}
