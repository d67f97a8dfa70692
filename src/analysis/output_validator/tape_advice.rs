//! Validates advice on tapes: could an honest child have sent it?

use super::{MAX_TEXT_CHARS, is_plausible_number};
use crate::domain::palette::{PairGrade, PaletteAdvice, TapeGrade};
use crate::vision::segmentation::palette::advice::{TAPES, Tape};

/// True if every known tape occurs once with its catalogue data, every pair of tapes occurs once, and the warnings and
/// numbers are within bounds.
pub(super) fn is_possible(advice: &PaletteAdvice) -> bool {
    let PaletteAdvice { tapes, pairs, warnings } = advice;
    let is_share = |of: &TapeGrade| (0.0..=1.0).contains(&of.in_box);
    let is_text = |text: &str| text.chars().count() <= MAX_TEXT_CHARS[1] && !text.chars().any(char::is_control);
    TAPES.iter().all(|tape| tapes.iter().filter(|of| is_of(of, tape)).count() == 1)
        && tapes.len() == TAPES.len()
        && are_all_pairs(pairs)
        && tapes.iter().all(is_share)
        && warnings.len() <= TAPES.len()
        && advice.numbers().all(is_plausible_number)
        && advice.texts().all(is_text)
}

fn is_of(grade: &TapeGrade, tape: &Tape) -> bool {
    (grade.tape.as_str(), grade.ral, grade.srgb.as_str()) == (tape.name, tape.ral, tape.hex().as_str())
}

fn are_all_pairs(pairs: &[PairGrade]) -> bool {
    let place = |name: &String| TAPES.iter().position(|tape| tape.name == name);
    let mut places: Vec<[Option<usize>; 2]> = pairs.iter().map(|pair| [0, 1].map(|i| place(&pair.tapes[i]))).collect();
    places.iter_mut().for_each(|pair| pair.sort_unstable());
    places.sort_unstable();
    places.dedup();
    let are_two = |[one, other]: &[Option<usize>; 2]| one.is_some() && one < other;
    places.len() == pairs.len() && pairs.len() == TAPES.len() * (TAPES.len() - 1) / 2 && places.iter().all(are_two)
}
