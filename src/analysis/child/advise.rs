//! Finds out which tapes suit a box, from a picture of the box.

use serde::{Deserialize, Serialize};

use super::limits::{MAX_TEXT_CHARS, is_plausible_number, set_once};
use super::{ChildEvent, ChildInputs, ChildTask, Reporter, StopReason, WorkRecord};
use crate::domain::palette::{PairGrade, PaletteAdvice, TapeGrade};
use crate::media::{MediaLimits, photo};
use crate::vision::segmentation::palette::advice::{TAPES, Tape, rank_tapes};

/// Needs nothing besides the photo or video.
#[derive(Debug, Serialize, Deserialize)]
pub struct AdviseWork;

impl ChildTask for AdviseWork {
    type Record = PaletteAdvice;
    type Output = Option<PaletteAdvice>;

    fn run(self, inputs: ChildInputs, reporter: &mut Reporter) -> Result<(), StopReason> {
        let limits = inputs.limits;
        let picture = photo::first_picture(inputs.first()?, limits)?;
        Ok(reporter.record(WorkRecord::Advise(PaletteAdvice::from(&rank_tapes(&picture.frame()))))?)
    }

    fn accept(
        &self,
        advice: PaletteAdvice,
        output: &mut Option<PaletteAdvice>,
        _: MediaLimits,
    ) -> Result<ChildEvent, String> {
        if !is_possible(&advice) {
            return Err("invalid advice on tapes".into());
        }
        set_once(output, advice, "advice on tapes")?;
        Ok(ChildEvent::Nothing)
    }
}

/// True if every known tape occurs once with its catalogue data, every pair of tapes occurs once, and the warnings and
/// numbers are within bounds.
fn is_possible(advice: &PaletteAdvice) -> bool {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::child::ChildWork;
    use crate::analysis::output_validator::validate_records;
    use crate::vision::frame::{ColourEncoding, Frame, Matrix, Plane, Range};

    #[test]
    fn advice_is_accepted_only_for_every_known_tape_and_pair() {
        let hears = |advice: &PaletteAdvice| {
            let records = vec![WorkRecord::Advise(advice.clone())];
            validate_records(&ChildWork::Advise(AdviseWork), records).map(|output| output.advice)
        };
        let encoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 };
        let grey = [128; 64];
        let plane = Plane { data: &grey, stride: 8, width: 8, height: 8 };
        let (y, u, v) = (plane, plane, plane);
        let frame =
            Frame { index: 0, time_s: 0.0, y, u, v, shift_x: 0, shift_y: 0, chroma_first_px: [0.0; 2], encoding };
        let honest = PaletteAdvice::from(&rank_tapes(&frame));
        assert_eq!(hears(&honest).unwrap(), Some(honest.clone()));
        let forgeries: [fn(&mut PaletteAdvice); 11] = [
            |a| a.tapes.clear(),
            |a| drop(a.tapes.pop()),
            |a| a.tapes[1] = a.tapes[0].clone(),
            |a| a.tapes[0].tape = "gold".into(),
            |a| a.tapes[0].srgb = "url(x)".into(),
            |a| a.tapes[0].ral += 1,
            |a| a.tapes[0].in_box = 1.5,
            |a| a.pairs[0] = a.pairs[1].clone(),
            |a| a.pairs[0].tapes[0] = a.pairs[0].tapes[1].clone(),
            |a| a.pairs[0].apart_steps = f64::INFINITY,
            |a| a.warnings.push("\n".into()),
        ];
        for (number, forge) in forgeries.into_iter().enumerate() {
            let mut forged = honest.clone();
            forge(&mut forged);
            assert!(hears(&forged).is_err(), "forgery {number}");
        }
    }
}
