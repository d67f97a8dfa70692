//! Properties of the palette checks, on synthetic colours.

use super::confusion::Confusion;
use super::light::LightCondition;
use super::{
    ColourSeparation, FalseArea, PaletteGrade, TapeProblem, TapeVerdict, colour_separations, verdict, verdicts,
};
use crate::random::Dice;
use crate::vision::frame::{ColourEncoding, Matrix, Range};
use crate::vision::segmentation::samples::{ColourSample, ColourSamples, RectanglePlace};

const ENCODING: ColourEncoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt709 };
const ORANGE: [f64; 3] = [0.85, 0.40, 0.12];
const CYAN: [f64; 3] = [0.10, 0.55, 0.70];
const GREY: [f64; 3] = [0.45, 0.45, 0.42];

/// Marked colours, rectangle by rectangle: label, gamma-coded red, green and blue, with noise.
fn marked(rectangles: &[(&str, [f64; 3])], noise: f64) -> ColourSamples {
    const PIXELS: usize = 100;
    let mut dice = Dice::new(5, "colours");
    let mut samples = ColourSamples::new(ENCODING);
    for (number, (label, rgb)) in rectangles.iter().enumerate() {
        let index = samples.labels.iter().position(|l| l == label).unwrap_or(samples.labels.len());
        if index == samples.labels.len() {
            samples.labels.push((*label).to_owned());
        }
        for _ in 0..PIXELS {
            let noisy = rgb.map(|c| c + dice.within(-noise, noise));
            let yuv = ENCODING.codes_of(ENCODING.colour_of_rgb(noisy));
            samples.samples.push(ColourSample { label: index, rectangle: number as u32, yuv });
        }
    }
    samples
}

/// Four rectangles of each.
fn four_each(colours: &[(&str, [f64; 3])], noise: f64) -> ColourSamples {
    marked(&colours.iter().flat_map(|colour| [*colour; 4]).collect::<Vec<_>>(), noise)
}

/// Samples with a place for each rectangle: its number as frame and column.
fn placed(samples: ColourSamples, rectangles: u64) -> ColourSamples {
    let place = |number: u64| RectanglePlace { frame: number, x: number as usize, y: 7 };
    ColourSamples { places: (0..rectangles).map(place).collect(), ..samples }
}

#[test]
fn a_rectangle_that_does_not_lie_on_the_tape_is_named() {
    let tape = [("tape", ORANGE); 4];
    let background = [("background", GREY); 4];
    let honest = placed(marked(&[tape, background].concat(), 0.02), 8);
    let beside = placed(marked(&[&tape[..2], &[("tape", GREY)], &tape[2..], &background].concat(), 0.02), 9);
    let named = |samples: &ColourSamples| {
        let causes = only(verdicts(samples, &tools(&["tape"]))).causes;
        causes.into_iter().find_map(|(_, cause)| match cause {
            TapeProblem::OddRectangle { at, .. } => Some(at.frame),
            _ => None,
        })
    };
    assert_eq!((named(&honest), named(&beside)), (None, Some(2)));
}

fn tools(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

fn only(verdicts: Vec<TapeVerdict>) -> TapeVerdict {
    assert_eq!(verdicts.len(), 1);
    verdicts.into_iter().next().unwrap()
}

#[test]
fn two_tapes_of_one_colour_are_confused_half_the_time_and_bad() {
    let samples = four_each(&[("one", ORANGE), ("other", ORANGE), ("background", GREY)], 0.03);
    let confusion = Confusion::of(&samples, &tools(&["one", "other"]));
    for (tool, other) in [(0, 1), (1, 0)] {
        let row = confusion.row_of(tool).unwrap();
        let taken = row.taken_for(other, LightCondition::AsMarked);
        assert!((taken - 0.5).abs() < 0.12, "{row:?}");
        assert!((row.taken_for(tool, LightCondition::AsMarked) + taken - 1.0).abs() < 1e-9);
    }
    let verdicts = verdict::judge(&confusion, &[]);
    assert!(verdicts.iter().all(|v| v.grade == PaletteGrade::Bad), "{verdicts:?}");
    let said = verdicts[0].warning().unwrap();
    assert!(said.contains("`one` is bad") && said.contains("most of that is mistaken for `other`"), "{said}");
    let margin = confusion.margins[0].as_ref().unwrap().margin_steps;
    assert!(margin < 0.0 && said.contains("its colour overlaps with that of `other`"), "{margin}: {said}");
}

#[test]
fn colours_far_apart_are_never_confused_and_good_in_every_light() {
    let samples = four_each(&[("orange", ORANGE), ("cyan", CYAN), ("background", GREY)], 0.03);
    let confusion = Confusion::of(&samples, &tools(&["orange", "cyan"]));
    for row in &confusion.rows {
        for light in LightCondition::ALL {
            let own = row.tool.map_or(row.shares[light as usize][0], |tool| row.taken_for(tool, light));
            assert_eq!(own, 1.0, "{} {}", row.label, light.name());
        }
    }
    for verdict in verdict::judge(&confusion, &[]) {
        assert_eq!((verdict.grade, verdict.warning()), (PaletteGrade::Good, None), "{verdict:?}");
    }
}

#[test]
fn the_margin_is_half_the_distance_between_the_colours() {
    let samples = four_each(&[("orange", ORANGE), ("background", GREY)], 0.0);
    let margin = Confusion::of(&samples, &tools(&["orange"])).margins[0].clone().unwrap();
    let steps = |rgb: [f64; 3]| {
        let [y, pb, pr] = ENCODING.colour_of(ENCODING.codes_of(ENCODING.colour_of_rgb(rgb)));
        nalgebra::Vector3::new(0.4 * y, pb, pr) * 255.0
    };
    let half = 0.5 * (steps(ORANGE) - steps(GREY)).norm();
    assert!((margin.margin_steps - half).abs() < 0.01, "{margin:?}, expected {half}");
    assert_eq!((margin.spread_steps < 1e-3, margin.nearest.as_str()), (true, "background"));
}

#[test]
fn a_tape_marked_in_lights_of_all_kinds_is_far_from_the_background_in_a_session() {
    let looks = [[0.9, 0.2, 0.1], [0.5, 0.11, 0.06], [0.3, 0.07, 0.04]].map(|rgb| ("tape", rgb));
    let samples = marked(&[&looks[..], &[("background", GREY); 3]].concat(), 0.02);
    let tools = tools(&["tape"]);
    let before = Confusion::of(&samples, &tools).margins[0].as_ref().unwrap().margin_steps;
    let ColourSeparation { from_tools, from_background } = colour_separations(&samples, &tools).remove(0);
    let within = from_background.unwrap().margin_steps;
    assert!(within > before + 8.0, "{before} before the recording, {within} in the session");
    assert_eq!(from_tools, None, "there is no other tool");
}

#[test]
fn a_sessions_colours_are_compared_with_the_other_tools_and_the_rest_separately() {
    let like_orange = [0.83, 0.40, 0.12];
    let samples = four_each(&[("one", ORANGE), ("other", like_orange), ("background", GREY), ("shaft", ORANGE)], 0.02);
    for of_tool in colour_separations(&samples, &tools(&["one", "other"])) {
        let (tools, background) = (of_tool.from_tools.unwrap(), of_tool.from_background.unwrap());
        assert!(tools.margin_steps < 4.0 && background.margin_steps > 10.0, "{tools:?}, {background:?}");
        assert_eq!(background.nearest, "background", "the shaft joins the band");
    }
}

#[test]
fn pixels_of_one_rectangle_do_not_support_each_other() {
    // The tape looks different on every frame: each pixel has similar ones in its own rectangle, but none in the
    // others.
    let looks = [[0.9, 0.2, 0.1], [0.9, 0.8, 0.1], [0.3, 0.8, 0.2], [0.8, 0.2, 0.8]].map(|rgb| ("tape", rgb));
    let background = [("background", GREY); 4];
    let samples = marked(&[looks, background].concat(), 0.01);
    let verdict = only(verdicts(&samples, &tools(&["tape"])));
    assert_eq!(verdict.grade, PaletteGrade::Bad, "{verdict:?}");
    assert!(matches!(verdict.causes[0].1, TapeProblem::Lost { share, .. } if share > 0.4), "{verdict:?}");
}

#[test]
fn a_colour_marked_once_is_at_risk_and_says_so() {
    let samples = marked(&[("tape", ORANGE), ("background", GREY), ("background", GREY)], 0.02);
    let verdict = only(verdicts(&samples, &tools(&["tape"])));
    assert_eq!(
        (verdict.grade, &verdict.causes[..]),
        (PaletteGrade::AtRisk, &[(PaletteGrade::AtRisk, TapeProblem::MarkedOnce)][..])
    );
    let unmarked = only(verdicts(&samples, &tools(&["cyan"])));
    assert_eq!((unmarked.grade, &unmarked.causes[0].1), (PaletteGrade::Bad, &TapeProblem::NotMarked));
}

#[test]
fn a_colour_that_the_background_takes_in_less_light_is_at_risk() {
    let darker = ORANGE.map(|c| c * 0.85); // 30 % less light, gamma-coded
    let apart = four_each(&[("tape", ORANGE), ("background", darker)], 0.012);
    let confusion = Confusion::of(&apart, &tools(&["tape"]));
    let row = confusion.row_of(0).unwrap();
    assert!(row.taken_for(0, LightCondition::AsMarked) > 0.95, "{row:?}");
    assert!(row.taken_for(0, LightCondition::Darker) < 0.05, "{row:?}");
    let verdict = only(verdict::judge(&confusion, &[]));
    assert_eq!(verdict.grade, PaletteGrade::AtRisk, "{verdict:?}");
    let lost = verdict.causes.iter().find(|(_, cause)| matches!(cause, TapeProblem::Lost { .. }));
    assert!(matches!(lost, Some((_, TapeProblem::Lost { light: LightCondition::Darker, .. }))), "{verdict:?}");
}

#[test]
fn exposure_that_changes_all_colours_alike_keeps_the_verdict() {
    for exposure in [0.7, 1.0, 1.15] {
        let lit = |rgb: [f64; 3]| rgb.map(|c| c * exposure);
        let good = four_each(&[("tape", lit(ORANGE)), ("background", lit(GREY))], 0.02);
        assert_eq!(only(verdicts(&good, &tools(&["tape"]))).grade, PaletteGrade::Good, "exposure {exposure}");
        let bad = four_each(&[("tape", lit(ORANGE)), ("background", lit(ORANGE))], 0.02);
        assert_eq!(only(verdicts(&bad, &tools(&["tape"]))).grade, PaletteGrade::Bad, "exposure {exposure}");
    }
}

#[test]
fn a_false_region_half_as_large_as_the_band_is_bad() {
    let samples = four_each(&[("tape", ORANGE), ("background", GREY)], 0.02);
    let confusion = Confusion::of(&samples, &tools(&["tape"]));
    let area = |largest_of_band| FalseArea { tool: "tape".into(), frame: 3, share: 0.01, largest_of_band };
    let grade = |areas: &[FalseArea]| only(verdict::judge(&confusion, areas)).grade;
    assert_eq!(grade(&[area(0.05)]), PaletteGrade::Good);
    assert_eq!(grade(&[area(0.05), area(0.3)]), PaletteGrade::AtRisk);
    assert_eq!(grade(&[area(0.6), area(0.05)]), PaletteGrade::Bad);
    let other = FalseArea { tool: "another".into(), ..area(0.6) };
    assert_eq!(grade(&[other]), PaletteGrade::Good);
}

#[test]
fn a_tape_without_samples_is_not_marked() {
    let verdict = only(verdicts(&ColourSamples::new(ENCODING), &tools(&["tape"])));
    assert_eq!(
        (verdict.grade, &verdict.causes[..]),
        (PaletteGrade::Bad, &[(PaletteGrade::Bad, TapeProblem::NotMarked)][..])
    );
}
