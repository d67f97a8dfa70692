//! Calibrates from photos or a video of a checkerboard.

use std::fs::File;
use std::io::BufReader;

use super::reporter::Reporter;
use super::{Halt, explain};
use crate::analysis::calibration::{Views, of_photos, of_video};
use crate::analysis::protocol::{Answer, BoardShape, CalibrateWork, CalibrationShape};
use crate::domain::files::calibration::camera_file;
use crate::media::Limits;
use crate::pipeline::camera::{Board, calibrate};

/// Frames of a video between two signs of life.
const FRAMES_AT_A_TIME: u64 = 32;

pub(super) fn run(work: CalibrateWork, inputs: Vec<File>, limits: Limits, reporter: &mut Reporter) -> Result<(), Halt> {
    let BoardShape { columns, rows, square_mm } = work.board;
    let board = Board::new(columns as usize, rows as usize, square_mm)?;
    let Views { views, width, height } = match work.photos {
        Some(names) => look_at_photos(names, inputs, board, limits, reporter)?,
        None => look_at_video(inputs, board, limits, reporter)?,
    };
    let calibration = calibrate(&views, width, height, board)?;
    let camera_json = camera_file(&calibration, &work.calibrated_at).to_json();
    Ok(reporter.say(&Answer::Calibration(CalibrationShape { camera_json }))?)
}

fn look_at_photos(
    names: Vec<String>,
    inputs: Vec<File>,
    board: Board,
    limits: Limits,
    reporter: &mut Reporter,
) -> Result<Views, Halt> {
    let photos = names.into_iter().zip(inputs.into_iter().map(BufReader::new));
    let of = Some(photos.len() as u64);
    let (mut done, mut sent) = (0, Ok(()));
    let views = of_photos(photos, board, limits, |_| {
        done += 1;
        if sent.is_ok() {
            sent = reporter.say(&Answer::Alive { done, of });
        }
    });
    sent?;
    Ok(views?)
}

fn look_at_video(inputs: Vec<File>, board: Board, limits: Limits, reporter: &mut Reporter) -> Result<Views, Halt> {
    let video = inputs.into_iter().next().ok_or_else(|| Halt::Explained(explain::no_input()))?;
    let mut sent = Ok(());
    let views = of_video("video", video, board, limits, |done, of| {
        if sent.is_ok() && done.is_multiple_of(FRAMES_AT_A_TIME) {
            sent = reporter.say(&Answer::Alive { done, of });
        }
    });
    sent?;
    Ok(views?)
}
