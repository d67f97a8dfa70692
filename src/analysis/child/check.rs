//! Looks for a board in one photo.

use std::io::BufReader;

use serde::{Deserialize, Serialize};

use super::calibrate::RequestedBoard;
use super::limits::{MAX_TEXT_CHARS, is_plausible_number, is_size, set_once};
use super::{ChildEvent, ChildInputs, ChildTask, Reporter, StopReason, WorkRecord};
use crate::domain::photo_check::{PhotoCheck, PhotoHint};
use crate::media::{MediaLimits, photo};
use crate::vision::camera::Coverage;
use crate::vision::camera::photo_inspection::inspect_photo;

/// The board to look for.
#[derive(Debug, Serialize, Deserialize)]
pub struct CheckWork(pub RequestedBoard);

impl ChildTask for CheckWork {
    type Record = PhotoCheck;
    type Output = Option<PhotoCheck>;

    fn run(self, inputs: ChildInputs, reporter: &mut Reporter) -> Result<(), StopReason> {
        let board = self.0.board()?;
        let limits = inputs.limits;
        let luma = photo::read_luma(BufReader::new(inputs.first()?), limits)?;
        let size = (luma.width(), luma.height());
        let check = PhotoCheck::new(size, &inspect_photo(&luma.plane(), board));
        Ok(reporter.record(WorkRecord::Check(check))?)
    }

    fn accept(
        &self,
        check: PhotoCheck,
        output: &mut Option<PhotoCheck>,
        limits: MediaLimits,
    ) -> Result<ChildEvent, String> {
        if !is_possible(&check, self.0, limits) {
            return Err("an invalid check of a photo".into());
        }
        set_once(output, check, "photo")?;
        Ok(ChildEvent::Nothing)
    }
}

/// True if a found board has all its corners, a board that was not found has no more than a search returns, and all
/// corners are within plausible pixel coordinates.
fn is_possible(check: &PhotoCheck, board: RequestedBoard, limits: MediaLimits) -> bool {
    let PhotoCheck { width, height, found, corners, missing, reason, hints, cut_off, near, coverage } = check;
    let counted = coverage.corners.iter().map(|&count| u64::from(count)).sum::<u64>();
    let is_word = |text: &String| text.chars().count() <= MAX_TEXT_CHARS[1] && !text.chars().any(char::is_control);
    let whole = u64::from(board.columns) * u64::from(board.rows);
    let most = if *found { whole } else { PhotoCheck::MAX_CORNERS as u64 };
    is_size(*width, *height, limits)
        && corners.len() as u64 <= most
        && (!found || corners.len() as u64 == whole)
        && missing.len() <= if *found { 0 } else { PhotoCheck::MAX_CORNERS }
        && corners.iter().chain(missing).flatten().all(|&at| is_plausible_number(at))
        && *found == reason.is_none()
        && reason.iter().all(is_word)
        && (!found || hints.is_empty())
        && hints.len() <= PhotoHint::ALL.len()
        && cut_off.len() <= 4
        && (*found || near.is_none())
        && [coverage.columns, coverage.rows] == [Coverage::COLUMNS as u32, Coverage::ROWS as u32]
        && coverage.corners.len() == Coverage::COLUMNS * Coverage::ROWS
        && counted <= if *found { whole } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::child::ChildWork;
    use crate::analysis::child::advise::AdviseWork;
    use crate::analysis::output_validator::validate_records;

    fn honest_check() -> PhotoCheck {
        let mut corners = vec![0; 48];
        corners[20] = 54;
        PhotoCheck {
            width: 640,
            height: 360,
            found: true,
            corners: vec![[300.0, 200.0]; 54],
            missing: vec![],
            reason: None,
            hints: vec![],
            cut_off: vec![],
            near: None,
            coverage: crate::domain::photo_check::PhotoCoverage { columns: 8, rows: 6, corners },
        }
    }

    #[test]
    fn a_photo_check_is_accepted_only_if_a_board_can_look_so() {
        let work = ChildWork::Check(CheckWork(RequestedBoard { columns: 9, rows: 6, square_mm: 1.0 }));
        let say = |check: PhotoCheck| validate_records(&work, vec![WorkRecord::Check(check)]);
        assert_eq!(say(honest_check()).unwrap().photo_check, Some(honest_check()));
        type Spoil = fn(&mut PhotoCheck);
        let spoils: [Spoil; 9] = [
            |check| check.missing = vec![[1.0, 1.0]],
            |check| check.corners.truncate(53),
            |check| check.corners[0][0] = f64::NAN,
            |check| check.found = false,
            |check| check.reason = Some("x".repeat(201)),
            |check| check.width = 100_000,
            |check| check.coverage.corners[0] = 1,
            |check| check.coverage.columns = 9,
            |check| check.hints = vec![PhotoHint::Dark],
        ];
        for (index, spoil) in spoils.into_iter().enumerate() {
            let mut check = honest_check();
            spoil(&mut check);
            assert!(say(check).is_err(), "spoil {index}");
        }
        let twice = || vec![WorkRecord::Check(honest_check()), WorkRecord::Check(honest_check())];
        assert!(validate_records(&work, twice()).is_err());
        assert!(validate_records(&ChildWork::Advise(AdviseWork), twice()).is_err());
    }
}
