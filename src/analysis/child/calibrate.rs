//! Calibrates from photos or a video of a checkerboard.

use std::io::BufReader;

use serde::{Deserialize, Serialize};

use super::limits::set_once;
use super::{ChildEvent, ChildInputs, ChildTask, Reporter, StopReason, WorkRecord};
use crate::analysis::calibration::{CheckedCalibration, Views, calibrate_and_check, views_of_photos, views_of_video};
use crate::domain::files::calibration::camera_file;
use crate::media::MediaLimits;
use crate::vision::camera::{Board, BoardProblem};

/// Frames of a video between two signs of life.
const FRAMES_PER_ALIVE: u64 = 32;

/// What calibration needs besides the pictures.
#[derive(Debug, Serialize, Deserialize)]
pub struct CalibrateWork {
    /// The board.
    pub board: RequestedBoard,
    /// Name of each photo, for the report; `None` if the only input is a video.
    pub photos: Option<Vec<String>>,
    /// Time stamp for the calibration, RFC 3339: a child has no clock.
    pub calibrated_at: String,
}

/// A checkerboard as requested: inner corners and the side of a square. The child checks whether it can be found.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RequestedBoard {
    /// Inner corners in a row.
    pub columns: u32,
    /// Rows of inner corners.
    pub rows: u32,
    /// Side of a square, mm.
    pub square_mm: f64,
}

impl RequestedBoard {
    /// The board.
    ///
    /// # Errors
    /// A board that cannot be found.
    pub fn board(self) -> Result<Board, BoardProblem> {
        Board::new(self.columns as usize, self.rows as usize, self.square_mm)
    }
}

impl ChildTask for CalibrateWork {
    /// The content of camera.json.
    type Record = String;
    type Output = Option<String>;

    fn run(self, inputs: ChildInputs, reporter: &mut Reporter) -> Result<(), StopReason> {
        let board = self.board.board()?;
        let views = match self.photos {
            Some(names) => views_from_photos(names, inputs, board, reporter)?,
            None => views_from_video(inputs, board, reporter)?,
        };
        let CheckedCalibration { calibration, at_edge } = calibrate_and_check(&views, board)?;
        let camera_json = camera_file(&calibration, &at_edge, &self.calibrated_at).to_json();
        Ok(reporter.record(WorkRecord::Calibrate(camera_json))?)
    }

    /// The parent parses the file when it stores the calibration.
    fn accept(&self, camera_json: String, output: &mut Option<String>, _: MediaLimits) -> Result<ChildEvent, String> {
        set_once(output, camera_json, "calibration")?;
        Ok(ChildEvent::Nothing)
    }
}

fn views_from_photos(
    names: Vec<String>,
    ChildInputs { files, limits }: ChildInputs,
    board: Board,
    reporter: &mut Reporter,
) -> Result<Views, StopReason> {
    let photos = names.into_iter().zip(files.into_iter().map(BufReader::new));
    let of = Some(photos.len() as u64);
    let (mut done, mut sent) = (0, Ok(()));
    let views = views_of_photos(photos, board, limits, |_| {
        done += 1;
        if sent.is_ok() {
            sent = reporter.alive(done, of);
        }
    });
    sent?;
    Ok(views?)
}

fn views_from_video(inputs: ChildInputs, board: Board, reporter: &mut Reporter) -> Result<Views, StopReason> {
    let limits = inputs.limits;
    let mut sent = Ok(());
    let views = views_of_video("video", inputs.first()?, board, limits, |done, of| {
        if sent.is_ok() && done.is_multiple_of(FRAMES_PER_ALIVE) {
            sent = reporter.alive(done, of);
        }
    });
    sent?;
    Ok(views?)
}
