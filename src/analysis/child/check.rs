//! Looks for a board in one photo.

use std::fs::File;
use std::io::BufReader;

use super::reporter::Reporter;
use super::{Halt, explain};
use crate::analysis::protocol::{Answer, BoardShape};
use crate::domain::photo_check::PhotoCheck;
use crate::media::{Limits, photo};
use crate::pipeline::camera::Board;
use crate::pipeline::camera::glance::glance;

pub(super) fn run(board: BoardShape, inputs: Vec<File>, limits: Limits, reporter: &mut Reporter) -> Result<(), Halt> {
    let BoardShape { columns, rows, square_mm } = board;
    let board = Board::new(columns as usize, rows as usize, square_mm)?;
    let file = inputs.into_iter().next().ok_or_else(|| Halt::Explained(explain::no_input()))?;
    let luma = photo::read_luma(BufReader::new(file), limits)?;
    let size = (luma.width(), luma.height());
    Ok(reporter.say(&Answer::PhotoCheck(PhotoCheck::new(size, &glance(&luma.plane(), board))))?)
}
