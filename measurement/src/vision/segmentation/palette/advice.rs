//! Ranks tapes to buy: by how well each is separated from all colours in a frame of the empty box, and pairs also from
//! each other (METHOD 2, *palette advice*; T 6.2 chose by eye, and chose purple above a red and blue mat).
//!
//! Input: one frame without tools. Output: every tape and every pair, best first. A tape is not one colour but a line
//! of colours: the round tube shades it from lamp to shadow, and the white balance drifts. Its *margin* is half the
//! distance from that line to the frame's colours, disregarding the nearest [`DISREGARDED_SHARE`] of the picture:
//! fewer pixels than a quarter of a band cannot be mistaken for one. The camera is assumed to be white-balanced. A
//! roll differs from its nominal shade by some 10 steps, so check the chosen tape with [`super::verdict`] once it is
//! on the tool.

use super::light::LightCondition;
use super::verdict::PaletteGrade;
use super::{STEPS, distance_steps};
use crate::vision::frame::{ColourEncoding, Frame};
use crate::vision::segmentation::knn::metric_of;
use crate::vision::segmentation::region_of_interest::CELL_PX;

/// A tape that can be bought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tape {
    /// Colour's name on the roll.
    pub name: &'static str,
    /// The nearest RAL Classic shade.
    pub ral: u16,
    /// That shade in sRGB.
    pub srgb: [u8; 3],
}

impl Tape {
    /// The shade as `#rrggbb`.
    pub fn hex(&self) -> String {
        self.srgb.iter().fold("#".to_owned(), |text, code| text + &format!("{code:02x}"))
    }
}

/// PVC insulating tape in the bright colours that are sold. Each is given as the nearest shade of the RAL Classic
/// collection, with the commonly printed sRGB approximation. Black, brown, grey and white are left out: they have no
/// hue and occur everywhere.
pub const TAPES: [Tape; 10] = [
    Tape { name: "red", ral: 3020, srgb: [0xcc, 0x06, 0x05] },
    Tape { name: "orange", ral: 2004, srgb: [0xf4, 0x46, 0x11] },
    Tape { name: "yellow", ral: 1023, srgb: [0xfa, 0xd2, 0x01] },
    Tape { name: "lime", ral: 6018, srgb: [0x57, 0xa6, 0x39] },
    Tape { name: "green", ral: 6024, srgb: [0x30, 0x84, 0x46] },
    Tape { name: "turquoise", ral: 5018, srgb: [0x3f, 0x88, 0x8f] },
    Tape { name: "light blue", ral: 5012, srgb: [0x3b, 0x83, 0xbd] },
    Tape { name: "blue", ral: 5015, srgb: [0x22, 0x71, 0xb3] },
    Tape { name: "violet", ral: 4005, srgb: [0x6c, 0x46, 0x75] },
    Tape { name: "pink", ral: 4003, srgb: [0xde, 0x4c, 0x8a] },
];

/// Share of the picture that may be nearer to a tape than its margin: on a 720p picture 920 pixels, a quarter of a 26
/// mm band on a 5 mm tube.
pub const DISREGARDED_SHARE: f64 = 0.001;

/// A pixel within this distance from a tape's line of colours has the tape's colour, steps. Pixels of one tape spread
/// by 3 to 18 steps, mostly along that line.
const SAME_COLOUR_STEPS: f64 = 8.0;

/// Margins of a tape, steps: at risk below the first, bad below the second. Of all ten tapes tried in a simulated box,
/// the one at 1.6 was tracked wrongly (violet, on a mat with violet). The one at 4.2 had the thinnest margin of those
/// tracked well (green), and those from 6.8 on could be distinguished with 11 steps to spare.
const ADVICE_MARGIN_STEPS: [f64; 2] = [6.0, 3.0];

/// Brightness of a tape's pixels relative to its nominal shade, gamma-coded: from the flank of the tube to the side
/// facing the lamp.
const SHADES: [f64; 5] = [0.55, 0.66, 0.77, 0.88, 1.0];

/// Ranking of every tape for a frame of the empty box.
#[derive(Clone, Debug, PartialEq)]
pub struct TapeRanking {
    /// Every tape, best first.
    pub tapes: Vec<TapeAdvice>,
    /// Every pair, best first.
    pub pairs: Vec<PairAdvice>,
}

/// One tape against the box.
#[derive(Clone, Debug, PartialEq)]
pub struct TapeAdvice {
    /// The tape.
    pub tape: Tape,
    /// How far its colour may shift before the box's colours are nearer, steps.
    pub margin_steps: f64,
    /// Share of the picture that has its colour, 0..1.
    pub in_box: f64,
    /// The grade of this margin.
    pub grade: PaletteGrade,
}

/// Two tapes against the box and each other.
#[derive(Clone, Debug, PartialEq)]
pub struct PairAdvice {
    /// The tapes.
    pub tapes: [Tape; 2],
    /// How far the colour of either may shift before the other is nearer, steps.
    pub apart_steps: f64,
    /// The smallest of that and both tapes' own margins, steps.
    pub margin_steps: f64,
    /// The grade of this margin.
    pub grade: PaletteGrade,
}

/// Ranks all [`TAPES`] against a frame without tools.
pub fn rank_tapes(frame: &Frame<'_>) -> TapeRanking {
    let colours = colours_of(frame);
    let mut tapes: Vec<TapeAdvice> = TAPES.iter().map(|tape| against_box(*tape, &colours, frame.encoding)).collect();
    tapes.sort_by(|a, b| b.margin_steps.total_cmp(&a.margin_steps));
    let pair = |(i, a): (usize, &TapeAdvice)| {
        let second = tapes[i + 1..].iter();
        second.map(|b| against_each_other(a, b, frame.encoding)).collect::<Vec<_>>()
    };
    let mut pairs: Vec<PairAdvice> = tapes.iter().enumerate().flat_map(pair).collect();
    pairs.sort_by(|a, b| b.margin_steps.total_cmp(&a.margin_steps));
    TapeRanking { tapes, pairs }
}

/// The frame's colours in the classifier's space, each with its share of the picture. Codes are grouped in fours.
fn colours_of(frame: &Frame<'_>) -> Vec<([f32; 3], f64)> {
    const BITS: u32 = 6;
    let mut counts = vec![0u32; 1 << (3 * BITS)];
    let mut all = 0u32;
    for y in (0..frame.height()).step_by(CELL_PX) {
        for x in (0..frame.width()).step_by(CELL_PX) {
            let index =
                frame.yuv_at(x, y).iter().fold(0, |index, code| index << BITS | usize::from(code >> (8 - BITS)));
            counts[index] += 1;
            all += 1;
        }
    }
    let code = |index: usize, place: u32| ((index >> (place * BITS)) & ((1 << BITS) - 1)) as f64 * 4.0 + 1.5;
    let colour = |index| frame.encoding.colour_of_codes([code(index, 2), code(index, 1), code(index, 0)]);
    let seen = counts.iter().enumerate().filter(|(_, count)| **count > 0);
    seen.map(|(index, count)| (metric_of(colour(index)), f64::from(*count) / f64::from(all))).collect()
}

/// The possible colours of a tape on a tube, in the classifier's space.
fn line_of(tape: Tape, encoding: ColourEncoding) -> Vec<[f32; 3]> {
    let nominal = encoding.colour_of_rgb(tape.srgb.map(|c| f64::from(c) / STEPS));
    let shaded = SHADES.iter().map(move |shade| nominal.map(|c| c * shade));
    let lights = [LightCondition::AsMarked, LightCondition::Warmer, LightCondition::Cooler];
    shaded.flat_map(|colour| lights.map(|light| metric_of(light.apply_to(colour, encoding)))).collect()
}

fn steps_to_line(at: [f32; 3], line: &[[f32; 3]]) -> f64 {
    line.iter().map(|point| distance_steps(at, *point)).fold(f64::INFINITY, f64::min)
}

fn against_box(tape: Tape, colours: &[([f32; 3], f64)], encoding: ColourEncoding) -> TapeAdvice {
    let line = line_of(tape, encoding);
    let mut near: Vec<(f64, f64)> = colours.iter().map(|(at, share)| (steps_to_line(*at, &line), *share)).collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    let in_box = near
        .iter()
        .take_while(|(steps, _)| *steps <= SAME_COLOUR_STEPS)
        .map(|(_, share)| share)
        .fold(0.0, |sum, share| sum + share);
    let mut passed = 0.0;
    let beyond = near.iter().find(|(_, share)| {
        passed += share;
        passed > DISREGARDED_SHARE
    });
    let margin_steps = 0.5 * beyond.map_or(STEPS, |(steps, _)| *steps);
    TapeAdvice { tape, margin_steps, in_box, grade: PaletteGrade::of_margin(margin_steps, ADVICE_MARGIN_STEPS) }
}

fn against_each_other(a: &TapeAdvice, b: &TapeAdvice, encoding: ColourEncoding) -> PairAdvice {
    let other = line_of(b.tape, encoding);
    let steps = line_of(a.tape, encoding).into_iter().map(|at| steps_to_line(at, &other)).fold(f64::INFINITY, f64::min);
    let apart_steps = 0.5 * steps;
    let margin_steps = apart_steps.min(a.margin_steps).min(b.margin_steps);
    PairAdvice {
        tapes: [a.tape, b.tape],
        apart_steps,
        margin_steps,
        grade: PaletteGrade::of_margin(margin_steps, ADVICE_MARGIN_STEPS),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::frame::{Matrix, Plane, Range};

    const ENCODING: ColourEncoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 };

    /// The advice for a box with these colours (sRGB), in stripes of equal width.
    fn advice_for(stripes: &[[u8; 3]]) -> TapeRanking {
        const ROWS: usize = 40;
        let codes: Vec<[u8; 3]> = stripes
            .iter()
            .flat_map(|srgb| {
                let colour = ENCODING.colour_of_rgb(srgb.map(|c| f64::from(c) / 255.0));
                [ENCODING.codes_of(colour); 16]
            })
            .collect();
        let width = codes.len();
        let [y, u, v] = [0, 1, 2].map(|i| codes.iter().map(|code| code[i]).collect::<Vec<u8>>().repeat(ROWS));
        let plane = |data| Plane { data, stride: width, width, height: ROWS };
        let (y, u, v) = (plane(&y), plane(&u), plane(&v));
        rank_tapes(&Frame {
            index: 0,
            time_s: 0.0,
            y,
            u,
            v,
            shift_x: 0,
            shift_y: 0,
            chroma_first_px: [0.0; 2],
            encoding: ENCODING,
        })
    }

    fn of<'a>(advice: &'a TapeRanking, name: &str) -> &'a TapeAdvice {
        advice.tapes.iter().find(|tape| tape.tape.name == name).unwrap()
    }

    #[test]
    fn a_box_painted_like_a_tape_puts_that_tape_last_and_says_how_much_of_it_is_there() {
        for tape in TAPES {
            let advice = advice_for(&[tape.srgb, [120, 120, 118], [40, 40, 42], [200, 198, 190]]);
            let own = of(&advice, tape.name);
            assert_eq!(own.grade, PaletteGrade::Bad, "{own:?}");
            assert!((own.in_box - 0.25).abs() < 1e-9, "{own:?}");
            assert_eq!(advice.tapes.last().unwrap().tape.name, tape.name);
            assert!(!advice.pairs[0].tapes.contains(&tape), "{:?}", advice.pairs[0]);
        }
    }

    #[test]
    fn purple_is_not_for_a_box_of_red_blue_and_their_mixture() {
        let advice = advice_for(&[[170, 52, 58], [52, 75, 155], [105, 68, 114], [120, 120, 118]]);
        assert_eq!(of(&advice, "violet").grade, PaletteGrade::Bad, "{advice:?}");
        let best = &advice.pairs[0];
        assert_eq!(best.grade, PaletteGrade::Good, "{best:?}");
        assert!(best.tapes.iter().all(|tape| !["violet", "red", "blue"].contains(&tape.name)), "{best:?}");
    }

    #[test]
    fn a_pair_is_no_better_than_its_worse_tape_nor_than_the_two_are_apart() {
        let advice = advice_for(&[[120, 120, 118], [170, 52, 58]]);
        for pair in &advice.pairs {
            let own = pair.tapes.map(|tape| of(&advice, tape.name).margin_steps);
            assert_eq!(pair.margin_steps, own[0].min(own[1]).min(pair.apart_steps));
        }
        let blues = |pair: &&PairAdvice| pair.tapes.iter().all(|tape| tape.name.ends_with("blue"));
        let alike = advice.pairs.iter().find(blues).unwrap();
        assert_eq!(alike.grade, PaletteGrade::Bad, "two blues cannot be told apart: {alike:?}");
        assert_eq!(advice.pairs.len(), TAPES.len() * (TAPES.len() - 1) / 2);
        assert!(advice.pairs.is_sorted_by(|a, b| a.margin_steps >= b.margin_steps));
    }
}
