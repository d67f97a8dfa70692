//! Calibrates from photos or a video of a checkerboard.

use std::fs::File;
use std::io::BufReader;

use super::reporter::Reporter;
use super::{StopReason, explain};
use crate::analysis::calibration::{Views, views_of_photos, views_of_video};
use crate::analysis::protocol::{BoardShape, CalibrateWork, CalibrationShape, ChildReply};
use crate::domain::files::calibration::camera_file;
use crate::media::MediaLimits;
use crate::vision::camera::{Board, calibrate};

/// Frames of a video between two signs of life.
const FRAMES_PER_ALIVE: u64 = 32;

pub(super) fn run(
    work: CalibrateWork,
    inputs: Vec<File>,
    limits: MediaLimits,
    reporter: &mut Reporter,
) -> Result<(), StopReason> {
    let BoardShape { columns, rows, square_mm } = work.board;
    let board = Board::new(columns as usize, rows as usize, square_mm)?;
    let Views { views, width, height } = match work.photos {
        Some(names) => views_from_photos(names, inputs, board, limits, reporter)?,
        None => views_from_video(inputs, board, limits, reporter)?,
    };
    let calibration = calibrate(&views, width, height, board)?;
    let camera_json = camera_file(&calibration, &work.calibrated_at).to_json();
    Ok(reporter.send(&ChildReply::Calibration(CalibrationShape { camera_json }))?)
}

fn views_from_photos(
    names: Vec<String>,
    inputs: Vec<File>,
    board: Board,
    limits: MediaLimits,
    reporter: &mut Reporter,
) -> Result<Views, StopReason> {
    let photos = names.into_iter().zip(inputs.into_iter().map(BufReader::new));
    let of = Some(photos.len() as u64);
    let (mut done, mut sent) = (0, Ok(()));
    let views = views_of_photos(photos, board, limits, |_| {
        done += 1;
        if sent.is_ok() {
            sent = reporter.send(&ChildReply::Alive { done, of });
        }
    });
    sent?;
    Ok(views?)
}

fn views_from_video(
    inputs: Vec<File>,
    board: Board,
    limits: MediaLimits,
    reporter: &mut Reporter,
) -> Result<Views, StopReason> {
    let video = inputs.into_iter().next().ok_or_else(|| StopReason::Impossible(explain::no_input()))?;
    let mut sent = Ok(());
    let views = views_of_video("video", video, board, limits, |done, of| {
        if sent.is_ok() && done.is_multiple_of(FRAMES_PER_ALIVE) {
            sent = reporter.send(&ChildReply::Alive { done, of });
        }
    });
    sent?;
    Ok(views?)
}
