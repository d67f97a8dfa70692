//! Borders are drawn exactly and must be found again.

use nalgebra::{Vector2, Vector3};

use super::*;
use crate::vision::edges::chroma_siting;
use crate::vision::edges::edge_model::Likeness;
use crate::vision::edges::exposure;
use crate::vision::edges::probe::FittedEdge;
use crate::vision::edges::probe::Shading;
use crate::vision::edges::tone;
use crate::vision::frame::{ColourEncoding, Matrix, Plane, Range};
use crate::vision::segmentation::samples::UsualColour;
use crate::vision::space::Pixel;
use crate::vision::tube::{BorderSide, OutlinePart};

const ENCODING: ColourEncoding = ColourEncoding { range: Range::Limited, matrix: Matrix::Bt709 };
const SIZE: usize = 64;
const TAPE: [f64; 3] = [110.0, 90.0, 190.0];
const GREY_GREEN: [f64; 3] = [90.0, 140.0, 110.0];

/// A border drawn exactly: 4:2:0, each sample at its own place.
#[derive(Clone, Copy)]
struct Drawing {
    tape: [f64; 3],
    normal: Vector2<f64>,
    /// Its offset along the normal from the middle, pixels.
    edge: f64,
    outside: [f64; 3],
    /// Gaussian, pixels.
    blur: f64,
    /// Motion during the exposure, along the normal, pixels.
    smear: f64,
    /// Increase of the light outside per pixel away from the border, as a share.
    shadow: f64,
    /// Share of the light inside that a limb of `RADIUS_PX` loses as it turns away.
    limb: Option<f64>,
    /// Share of the light outside that this limb mirrors at grazing incidence.
    mirrored: f64,
    /// Factor on all light; light above white is cut off.
    exposure: f64,
    /// Radius of curvature of the border, pixels; infinite if it is straight.
    bend: f64,
}

const PLAIN: Drawing = Drawing {
    tape: TAPE,
    normal: Vector2::new(0.6, 0.8),
    edge: 0.3,
    outside: GREY_GREEN,
    blur: 0.8,
    smear: 0.0,
    shadow: 0.0,
    limb: None,
    mirrored: 0.0,
    exposure: 1.0,
    bend: f64::INFINITY,
};

const RADIUS_PX: f64 = 14.0;

fn is_tape(codes: [u8; 3]) -> bool {
    codes[2] > 170
}

fn frame(planes: &[Vec<u8>; 3]) -> Frame<'_> {
    let [y, u, v] = planes.each_ref();
    let plane = |data, size| Plane { data, stride: size, width: size, height: size };
    Frame {
        index: 0,
        time_s: 0.0,
        y: plane(y, SIZE),
        u: plane(u, SIZE / 2),
        v: plane(v, SIZE / 2),
        shift_x: 1,
        shift_y: 1,
        chroma_first_px: [0.5; 2],
        encoding: ENCODING,
    }
}

impl Drawing {
    fn codes_at(&self, at: Vector2<f64>) -> Vector3<f64> {
        let from_middle = at - Vector2::repeat(SIZE as f64 / 2.0);
        let beyond = if self.bend.is_finite() {
            (from_middle + self.normal * (self.bend - self.edge)).norm() - self.bend
        } else {
            from_middle.dot(&self.normal) - self.edge
        };
        let light = |codes: [f64; 3]| ENCODING.rgb_of_codes(codes).map(tone::light);
        let (tape, outside) = (light(self.tape), light(self.outside));
        // Points of the blur by the lens and by motion, each with its own light.
        let (mut sum, mut weights) = (Vector3::zeros(), 0.0);
        let moved = if self.smear > 0.0 { -3..=3 } else { 0..=0 };
        for (step, moved) in moved.flat_map(|moved| (-40..=40).map(move |step| (step, moved))) {
            let z = f64::from(step) / 10.0;
            let weight = (-0.5 * z * z).exp();
            let there = beyond + z * self.blur + self.smear * f64::from(moved) / 7.0;
            let cos = |depth: f64| (1.0 - (1.0 - (depth / RADIUS_PX).clamp(0.0, 1.0)).powi(2)).sqrt();
            let inside = tape * self.limb.map_or(1.0, |share| 1.0 - share * (1.0 - cos(-there)))
                + outside * (self.mirrored * (1.0 - cos(-there)).powi(5)); // Fresnel, by Schlick
            let half = 0.05 * self.blur; // each point covers this much on both sides
            let share = ((half - there) / (2.0 * half)).clamp(0.0, 1.0);
            let beside = outside * (1.0 + self.shadow * there.clamp(0.0, 8.0));
            sum += (inside * share + beside * (1.0 - share)) * weight;
            weights += weight;
        }
        let coded = (sum / weights).map(|light| tone::code(self.exposure * light));
        ENCODING.codes_from_rgb() * coded + Vector3::from(ENCODING.black())
    }

    fn planes(&self) -> [Vec<u8>; 3] {
        let whole = (0..SIZE * SIZE).map(|i| self.codes_at(Vector2::new((i % SIZE) as f64, (i / SIZE) as f64)));
        let whole: Vec<Vector3<f64>> = whole.collect();
        let code = |value: f64| value.round().clamp(0.0, 255.0) as u8;
        let halved = |plane: usize| {
            let four = |i: usize| {
                let (x, y) = (i % (SIZE / 2) * 2, i / (SIZE / 2) * 2);
                let at = |dx: usize, dy: usize| whole[(y + dy) * SIZE + x + dx][plane];
                code(0.25 * (at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1)))
            };
            (0..SIZE * SIZE / 4).map(four).collect()
        };
        [whole.iter().map(|codes| code(codes[0])).collect(), halved(1), halved(2)]
    }

    fn model(&self) -> EdgeModel {
        let mut model = EdgeModel::new(
            UsualColour { codes: self.tape, luma_spread: 5.0, chroma_spread: 5.0 },
            Likeness::Chroma,
            ENCODING,
        );
        model.lens_px = self.blur;
        model.chroma_blur_px = 0.5; // chroma is drawn as the mean of two pixels each way
        model
    }

    fn probe(&self) -> Probe {
        Probe {
            middle: Pixel::new(SIZE as f64 / 2.0, SIZE as f64 / 2.0),
            outward: self.normal,
            bend_per_px: -0.5 / self.bend,
            lean: 0.0,
            half_length_px: 3.0,
            inwards_px: 5.0,
            outwards_px: 5.0,
            motion_px_s: 0.0,
            part: if self.limb.is_some() { OutlinePart::Border(BorderSide::First) } else { OutlinePart::DistalEnd },
            shading: if self.limb.is_some() { Shading::Limb { radius_px: RADIUS_PX } } else { Shading::Cut },
        }
    }

    /// Lets a model learn from this border, as one part of an outline.
    fn taught_to(&self, model: &mut EdgeModel, part: OutlinePart) {
        self.located_by(model, &Probe { part, ..self.probe() }).unwrap();
    }

    fn looked_at(&self, model: &EdgeModel, probe: &Probe, fineness: Fineness) -> Option<LocatedEdge> {
        model.locate(&frame(&self.planes()), probe, fineness, is_tape)
    }

    /// Located finely, and accepted for learning.
    fn located_by(&self, model: &mut EdgeModel, probe: &Probe) -> Option<LocatedEdge> {
        let planes = self.planes();
        self.located_on(&frame(&planes), model, probe)
    }

    fn located_on(&self, frame: &Frame<'_>, model: &mut EdgeModel, probe: &Probe) -> Option<LocatedEdge> {
        let edge = model.locate(frame, probe, Fineness::Fine, is_tape)?;
        let fitted: Vec<FittedEdge> = edge.fit.map(|fit| FittedEdge { probe: *probe, fit }).into_iter().collect();
        model.learn(frame, &fitted, probe.motion_px_s * probe.outward);
        Some(edge)
    }

    fn located(&self) -> Option<LocatedEdge> {
        self.located_by(&mut self.model(), &self.probe())
    }

    /// How much too far outwards it is found.
    fn error_px(&self) -> f64 {
        self.located().unwrap().offset_px - self.edge
    }
}

fn normal(angle: f64) -> Vector2<f64> {
    Vector2::new(angle.cos(), angle.sin())
}

#[test]
fn a_border_is_found_to_a_fifth_of_a_pixel_at_any_angle_and_place() {
    for angle in [0.0, 0.4, 0.785, 1.3, 2.5, -2.0] {
        for edge in [-1.7, -0.4, 0.0, 0.3, 1.9] {
            let error = Drawing { normal: normal(angle), edge, ..PLAIN }.error_px();
            assert!(error.abs() < 0.2, "angle {angle}, edge {edge}: {error}");
        }
    }
}

#[test]
fn light_is_mixed_and_then_encoded() {
    let dark = Drawing { outside: [25.0, 128.0, 128.0], ..PLAIN };
    assert!(dark.error_px().abs() < 0.05, "{}", dark.error_px());
}

#[test]
fn a_limb_that_darkens_is_found_where_it_ends() {
    for limb in [0.3, 0.5, 0.7] {
        let error = Drawing { limb: Some(limb), ..PLAIN }.error_px();
        assert!(error.abs() < 0.1, "limb {limb}: {error}");
    }
}

#[test]
fn a_soft_shadow_beside_a_border_does_not_move_it() {
    for shadow in [-0.05, 0.06, 0.1] {
        let error = Drawing { outside: [110.0, 130.0, 126.0], shadow, ..PLAIN }.error_px();
        assert!(error.abs() < 0.1, "shadow {shadow}: {error}");
    }
}

/// A black tube before a grey mat, whose limb mirrors the mat.
fn polished(mirrored: f64, shadow: f64) -> Drawing {
    let [tape, outside] = [45.0, 170.0].map(|luma| [luma, 128.0, 128.0]);
    Drawing { tape, outside, shadow, mirrored, limb: Some(0.0), ..PLAIN }
}

#[test]
fn a_limb_that_mirrors_the_background_is_found_where_it_ends() {
    for (mirrored, shadow) in [(0.0, 0.0), (0.4, 0.0), (0.8, 0.0), (0.8, 0.02)] {
        let tube = polished(mirrored, shadow);
        let mut model = tube.model();
        model.likeness = Likeness::AllPlanes;
        let mut error = 0.0;
        for _ in 0..12 {
            error = tube.located_by(&mut model, &tube.probe()).unwrap().offset_px - tube.edge;
            model.finish_frame();
        }
        assert!(error.abs() < 0.25, "mirrored {mirrored}, shadow {shadow}: {error}");
    }
}

#[test]
fn a_bent_edge_is_found_only_by_a_probe_that_knows_its_bend() {
    for angle in [0.2, 1.1, 2.9] {
        let bent = Drawing { normal: normal(angle), bend: 9.0, ..PLAIN };
        assert!(bent.error_px().abs() < 0.15, "angle {angle}: {}", bent.error_px());
        let straight = Probe { bend_per_px: 0.0, ..bent.probe() };
        let error = bent.located_by(&mut bent.model(), &straight).unwrap().offset_px - bent.edge;
        assert!(error < bent.error_px() - 0.1, "angle {angle}: {error}");
    }
}

#[test]
fn what_is_overexposed_at_an_end_is_known_from_the_limbs() {
    let end = Drawing { exposure: 2.0, blur: 3.0, ..PLAIN };
    let limb = Drawing { exposure: 2.0, limb: Some(0.9), ..PLAIN };
    let error_px = |limbs_are_known: bool| {
        let mut model = limb.model();
        for part in
            BorderSide::BOTH.map(OutlinePart::Border).into_iter().cycle().take(if limbs_are_known { 40 } else { 0 })
        {
            limb.taught_to(&mut model, part);
        }
        model.lens_px = end.blur;
        (0..20).for_each(|_| end.taught_to(&mut model, OutlinePart::DistalEnd));
        end.located_by(&mut model, &end.probe()).unwrap().offset_px - end.edge
    };
    let [unknown, known] = [false, true].map(error_px);
    assert!(unknown > 0.2, "{unknown}");
    assert!(known.abs() < 0.75 * unknown, "{unknown} {known}");
}

#[test]
fn equal_luma_is_no_hindrance_while_colours_differ() {
    let error = Drawing { outside: [110.0, 150.0, 90.0], ..PLAIN }.error_px();
    assert!(error.abs() < 0.1, "{error}");
}

/// Reflected light colours one side of a tape: it may be less like the tape's mean colour than the background.
#[test]
fn a_side_that_differs_from_the_mean_colour_as_much_as_the_samples_do_is_tape() {
    let beside = Drawing { outside: [90.0, 128.0, 128.0], ..PLAIN };
    let located_with = |chroma_spread: f64| {
        let model = EdgeModel::new(
            UsualColour { codes: [70.0, 115.0, 148.0], luma_spread: 5.0, chroma_spread },
            Likeness::Chroma,
            ENCODING,
        );
        beside.looked_at(&model, &beside.probe(), Fineness::Fine)
    };
    assert!(located_with(5.0).is_none(), "no sample differs as much");
    let edge = located_with(20.0).unwrap();
    assert!((edge.offset_px - beside.edge).abs() < 0.2, "{edge:?}");
}

/// Marked pixels of a shaft include highlights, so its limbs are darker than its usual colour.
#[test]
fn a_limb_that_is_darker_than_the_usual_shaft_has_an_edge() {
    let usual = UsualColour { codes: [115.0, 128.0, 128.0], luma_spread: 40.0, chroma_spread: 4.0 };
    let model = EdgeModel::new(usual, Likeness::AllPlanes, ENCODING);
    let limb = Drawing { tape: [55.0, 128.0, 128.0], outside: [90.0, 135.0, 126.0], ..PLAIN };
    let edge = limb.looked_at(&model, &limb.probe(), Fineness::Fine).unwrap();
    assert!((edge.offset_px - limb.edge).abs() < 0.2, "{edge:?}");
    let shade = Drawing { tape: [150.0, 128.0, 128.0], outside: [115.0, 128.0, 128.0], ..PLAIN };
    assert!(shade.looked_at(&model, &shade.probe(), Fineness::Fine).is_none(), "brighter inside");
}

#[test]
fn tape_on_both_sides_and_tape_outside_are_no_borders() {
    assert!(Drawing { outside: [110.0, 80.0, 180.0], ..PLAIN }.located().is_none(), "a crease");
    assert!(Drawing { edge: 30.0, ..PLAIN }.located().is_none(), "nothing in the window");
}

/// Chroma is drawn between the two columns that share it, also if the file says otherwise.
#[test]
fn limbs_show_where_the_chroma_samples_lie() {
    let vivid = Drawing { tape: [150.0, 70.0, 190.0], ..PLAIN };
    for (stated_px, off_px) in [(0.0, 0.5), (0.5, 0.0)] {
        let mut model = vivid.model();
        let backgrounds = [GREY_GREEN, [60.0, 150.0, 120.0], [140.0, 120.0, 120.0], [40.0, 128.0, 128.0]];
        for trial in 0..900_u32 {
            let drawing = Drawing {
                normal: normal(0.7 * f64::from(trial)),
                edge: 0.9 * (f64::from(trial) * 1.7).sin(),
                outside: backgrounds[trial as usize % backgrounds.len()],
                limb: Some(0.5),
                ..vivid
            };
            let planes = drawing.planes();
            let frame = Frame { chroma_first_px: [stated_px, 0.5], ..frame(&planes) };
            drawing.located_on(&frame, &mut model, &drawing.probe());
        }
        let shown = model.chroma_right();
        assert!(shown.is_some_and(|right| right.sigma_px < 0.1), "{shown:?}");
        assert_eq!(chroma_siting::decide(shown.into_iter(), stated_px, 1), off_px, "{shown:?}");
    }
}

/// The exposure time that limbs show, s. They move at `speed_px_s` and are drawn with `exposure_s`.
fn exposure_shown_by(speed_px_s: f64, exposure_s: f64) -> Option<f64> {
    let limb = Drawing { limb: Some(0.5), smear: speed_px_s * exposure_s, ..PLAIN };
    let mut model = limb.model();
    for turn in 0..45 {
        let (normal, edge) = (normal(0.7 * f64::from(turn)), 0.9 * (1.7 * f64::from(turn)).sin());
        let drawing = Drawing { normal, edge, ..limb };
        let probe = Probe { motion_px_s: speed_px_s, inwards_px: 8.0, outwards_px: 8.0, ..drawing.probe() };
        drawing.located_by(&mut model, &probe);
    }
    exposure::decide([model.exposure_evidence].into_iter())
}

#[test]
fn fast_limbs_show_the_exposure_time_and_slow_ones_do_not() {
    for exposure_s in [0.004, 0.012, 0.03] {
        let shown_s = exposure_shown_by(400.0, exposure_s).unwrap();
        assert!((shown_s / exposure_s).ln().abs() < 0.25, "{exposure_s} s taken for {shown_s} s");
    }
    assert_eq!(exposure_shown_by(80.0, 0.03), None);
}

#[test]
fn a_step_is_known_to_half_a_pixel() {
    let step = PLAIN.looked_at(&PLAIN.model(), &PLAIN.probe(), Fineness::Step).unwrap();
    assert!((step.offset_px - PLAIN.edge).abs() <= 0.5, "{step:?}");
}

/// Teaches edges at many places and backgrounds, frame by frame.
fn teach(model: &mut EdgeModel, like: Drawing) {
    const FRAMES: u32 = 30;
    const EDGES: u32 = 12;
    let backgrounds = [GREY_GREEN, [60.0, 150.0, 120.0], [140.0, 120.0, 120.0], [40.0, 128.0, 128.0]];
    for frame in 0..FRAMES {
        for edge in 0..EDGES {
            let turn = f64::from(frame * EDGES + edge);
            let outside = backgrounds[(frame + edge) as usize % backgrounds.len()];
            let drawing = Drawing { normal: normal(0.7 * turn), edge: 0.9 * (1.7 * turn).sin(), outside, ..like };
            drawing.located_by(model, &drawing.probe());
        }
        model.finish_frame();
    }
}

/// Edges are also found along a false tube; learning from them would keep that tube.
#[test]
fn edges_that_are_not_believed_teach_nothing() {
    let mut model = PLAIN.model();
    model.lens_px = 1.3;
    for turn in 0..100 {
        let drawing = Drawing { normal: normal(0.7 * f64::from(turn)), ..PLAIN };
        assert!(drawing.looked_at(&model, &drawing.probe(), Fineness::Fine).is_some());
        model.finish_frame();
    }
    assert_eq!(model.lens_px, 1.3);
}

#[test]
fn limbs_teach_how_much_chroma_is_blurred() {
    let limb = Drawing { limb: Some(0.5), ..PLAIN };
    for wrong_px in [0.2, 0.9] {
        let mut model = limb.model();
        model.chroma_blur_px = wrong_px;
        teach(&mut model, limb);
        let left = (model.chroma_blur_px - 0.5) / (wrong_px - 0.5);
        assert!(left.abs() < 0.5, "from {wrong_px} to {} px", model.chroma_blur_px);
    }
}

#[test]
fn ends_teach_how_sharp_the_lens_is() {
    for wrong_px in [0.5, 1.3] {
        let mut model = PLAIN.model();
        model.lens_px = wrong_px;
        teach(&mut model, PLAIN);
        let left = (model.lens_px - PLAIN.blur) / (wrong_px - PLAIN.blur);
        assert!(left.abs() < 0.5, "from {wrong_px} to {} px", model.lens_px);
    }
}
