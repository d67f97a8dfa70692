//! Looks for a board in one photo.

use std::fs::File;
use std::io::BufReader;

use super::reporter::Reporter;
use super::{StopReason, explain};
use crate::analysis::protocol::{BoardShape, ChildReply};
use crate::domain::photo_check::PhotoCheck;
use crate::media::{MediaLimits, photo};
use crate::vision::camera::Board;
use crate::vision::camera::photo_inspection::inspect_photo;

pub(super) fn run(
    board: BoardShape,
    inputs: Vec<File>,
    limits: MediaLimits,
    reporter: &mut Reporter,
) -> Result<(), StopReason> {
    let BoardShape { columns, rows, square_mm } = board;
    let board = Board::new(columns as usize, rows as usize, square_mm)?;
    let file = inputs.into_iter().next().ok_or_else(|| StopReason::Impossible(explain::no_input()))?;
    let luma = photo::read_luma(BufReader::new(file), limits)?;
    let size = (luma.width(), luma.height());
    Ok(reporter.send(&ChildReply::PhotoCheck(PhotoCheck::new(size, &inspect_photo(&luma.plane(), board))))?)
}
