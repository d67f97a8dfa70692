//! `trocar palette --advise`: tapes ranked against a frame of the empty box.

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use anyhow::Context;
use serde_json::{Value, json};

use super::{Failure, print_result};
use crate::commands::table::Table;
use crate::commands::track::{about, open};
use crate::domain::palette::ColourGrade;
use crate::media::{Limits, MediaError, Picture, photo};
use crate::pipeline::segmentation::palette::Grade;
use crate::pipeline::segmentation::palette::advice::{Advice, PairAdvice, Tape, TapeAdvice, advise};

/// Pairs in the text; JSON has them all.
const PAIRS_SHOWN: usize = 5;

/// Runs the command.
pub fn run(path: &Path, json: bool) -> Result<(), Failure> {
    let advice = advise(&first_picture(path)?.frame());
    if json {
        print_result(&(serde_json::to_string_pretty(&json_of(&advice)).context("writing JSON")? + "\n"))
    } else {
        print_result(&text_of(&advice))
    }
}

/// A photo, or a video's first frame.
fn first_picture(path: &Path) -> Result<Picture, Failure> {
    const ENOUGH_TO_TELL: u64 = 64;
    let mut file = BufReader::new(File::open(path).map_err(|e| about(path, e))?);
    let mut beginning = Vec::new();
    file.by_ref().take(ENOUGH_TO_TELL).read_to_end(&mut beginning).map_err(|e| about(path, e))?;
    file.rewind().map_err(|e| about(path, e))?;
    if photo::is_photo(&beginning) {
        return photo::read_picture(file, 0, Limits::default()).map_err(|e| about(path, e));
    }
    let picture = open(path)?.next_picture().map_err(|e| about(path, e))?;
    picture.ok_or_else(|| about(path, MediaError::NoFrames))
}

fn text_of(advice: &Advice) -> String {
    let mut text = String::from("Tapes against this box, best first (steps: 1/255 of the full range):\n");
    let mut tapes = Table::new(["tape", "near", "sRGB", "margin", "in the box", "verdict"]);
    for TapeAdvice { tape, margin_steps, in_box, grade } in &advice.tapes {
        let in_box = format!("{:.2} %", 100.0 * in_box);
        let ral = format!("RAL {}", tape.ral);
        let margin = format!("{margin_steps:.1}");
        tapes.row([tape.name.to_owned(), ral, hex(tape), margin, in_box, grade.name().to_owned()]);
    }
    text += &tapes.text();
    text += "\nPairs:\n";
    let mut pairs = Table::new(["tapes", "margin", "apart", "verdict"]);
    for PairAdvice { tapes: [a, b], apart_steps, margin_steps, grade } in advice.pairs.iter().take(PAIRS_SHOWN) {
        let (margin, apart) = (format!("{margin_steps:.1}"), format!("{apart_steps:.1}"));
        pairs.row([format!("{} and {}", a.name, b.name), margin, apart, grade.name().to_owned()]);
    }
    text += &pairs.text();
    text + "\n" + &recommendation(advice) + &warnings(advice).map(|warning| warning + "\n").collect::<String>()
}

fn recommendation(advice: &Advice) -> String {
    let pair = |pair: &PairAdvice| match pair.grade {
        Grade::Good => format!("for two, {} and {}", pair.tapes[0].name, pair.tapes[1].name),
        _ => "no two of these tapes stand apart well; cover what is colourful in the box".to_owned(),
    };
    match advice.tapes.first().zip(advice.pairs.first()) {
        Some((best, two)) if best.grade == Grade::Good => {
            format!("For one tool take {}; {}.\n", best.tape.name, pair(two))
        }
        _ => "None of these tapes stands apart well here: cover what is colourful in the box, or light it evenly.\n"
            .to_owned(),
    }
}

fn warnings(advice: &Advice) -> impl Iterator<Item = String> {
    advice.tapes.iter().filter(|tape| tape.grade == Grade::Bad).map(|TapeAdvice { tape, in_box, .. }| {
        format!("Do not take {}: {:.2} % of this picture has its colour.", tape.name, 100.0 * in_box)
    })
}

fn json_of(advice: &Advice) -> Value {
    let grade = |grade: Grade| ColourGrade::from(grade).name();
    let tape = |of: &TapeAdvice| {
        json!({ "tape": of.tape.name, "ral": of.tape.ral, "srgb": hex(&of.tape), "margin_steps": of.margin_steps,
                "in_box": of.in_box, "grade": grade(of.grade) })
    };
    let pair = |of: &PairAdvice| {
        json!({ "tapes": of.tapes.map(|tape| tape.name), "margin_steps": of.margin_steps,
                "apart_steps": of.apart_steps, "grade": grade(of.grade) })
    };
    json!({
        "tapes": advice.tapes.iter().map(tape).collect::<Vec<_>>(),
        "pairs": advice.pairs.iter().map(pair).collect::<Vec<_>>(),
        "warnings": warnings(advice).collect::<Vec<_>>(),
    })
}

fn hex(tape: &Tape) -> String {
    tape.srgb.iter().fold("#".to_owned(), |text, c| text + &format!("{c:02x}"))
}
