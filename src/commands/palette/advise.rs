//! `trocar palette --advise`: tapes ranked against a frame of the empty box.

use std::fs::File;
use std::path::Path;

use anyhow::Context;

use super::{CommandFailure, print_result};
use crate::commands::table::TextTable;
use crate::commands::track::about;
use crate::domain::palette::{ColourGrade, PairGrade, PaletteAdvice, TapeGrade};
use crate::media::{MediaLimits, Picture, photo};
use crate::vision::segmentation::palette::advice::rank_tapes;

/// Number of pairs in the text. JSON has all pairs.
const PAIRS_SHOWN: usize = 5;

/// Runs the command.
pub fn run(path: &Path, json: bool) -> Result<(), CommandFailure> {
    let advice = PaletteAdvice::from(&rank_tapes(&first_picture(path)?.frame()));
    if json {
        print_result(&(serde_json::to_string_pretty(&advice).context("writing JSON")? + "\n"))
    } else {
        print_result(&text_of(&advice))
    }
}

fn first_picture(path: &Path) -> Result<Picture, CommandFailure> {
    let file = File::open(path).map_err(|e| about(path, e))?;
    photo::first_picture(file, MediaLimits::default()).map_err(|e| about(path, e))
}

fn text_of(advice: &PaletteAdvice) -> String {
    let mut text = String::from("Tapes for this box, best first (margins in steps of 1/255 of the full range):\n");
    let mut tapes = TextTable::new(["tape", "near", "sRGB", "margin", "in the box", "verdict"]);
    for TapeGrade { tape, ral, srgb, margin_steps, in_box, grade } in &advice.tapes {
        let (in_box, ral) = (format!("{:.2} %", 100.0 * in_box), format!("RAL {ral}"));
        let margin = format!("{margin_steps:.1}");
        tapes.add_row([tape.clone(), ral, srgb.clone(), margin, in_box, grade.name().to_owned()]);
    }
    text += &tapes.to_text();
    text += "\nPairs:\n";
    let mut pairs = TextTable::new(["tapes", "margin", "apart", "verdict"]);
    for PairGrade { tapes: [a, b], apart_steps, margin_steps, grade } in advice.pairs.iter().take(PAIRS_SHOWN) {
        let (margin, apart) = (format!("{margin_steps:.1}"), format!("{apart_steps:.1}"));
        pairs.add_row([format!("{a} and {b}"), margin, apart, grade.name().to_owned()]);
    }
    text += &pairs.to_text();
    text + "\n"
        + &recommendation(advice)
        + &advice.warnings.iter().map(|warning| format!("{warning}\n")).collect::<String>()
}

fn recommendation(advice: &PaletteAdvice) -> String {
    let pair = |pair: &PairGrade| match pair.grade {
        ColourGrade::Good => format!("for two tools, {} and {}", pair.tapes[0], pair.tapes[1]),
        _ => "no two of these tapes differ enough; cover colourful things in the box".to_owned(),
    };
    match advice.tapes.first().zip(advice.pairs.first()) {
        Some((best, two)) if best.grade == ColourGrade::Good => {
            format!("For one tool take {}; {}.\n", best.tape, pair(two))
        }
        _ => {
            "None of these tapes differs enough from this box: cover colourful things in the box, or light it evenly.\n"
                .to_owned()
        }
    }
}
