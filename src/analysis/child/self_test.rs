//! Tests a box: the board and a rod, both in one recording.

use super::reporter::Reporter;
use super::{StopReason, track};
use crate::analysis::protocol::{BoardShape, ChildReply, SelfTestWork};
use crate::analysis::self_test::{SelfTestSetup, test_video};
use crate::media::VideoFile;
use crate::motion::quality::ports::Ports;
use crate::vision::camera::Board;
use crate::vision::pose::fulcrum::Fulcrum;

/// Frames between two signs of life.
const FRAMES_PER_ALIVE: u64 = 32;

pub(super) fn run(work: SelfTestWork, video: VideoFile, reporter: &mut Reporter) -> Result<(), StopReason> {
    let BoardShape { columns, rows, square_mm } = work.board;
    let board = Board::new(columns as usize, rows as usize, square_mm)?;
    let ports = Ports::new(work.ports.into_iter().map(Fulcrum::from).collect());
    let asked = SelfTestSetup { board, reach_mm: work.reach_mm, calibration_rms_px: work.calibration_rms_px, ports };
    let mut sent = Ok(());
    let report = test_video(video, track::settings(work.track)?, asked, |done, of| {
        if sent.is_ok() && done.is_multiple_of(FRAMES_PER_ALIVE) {
            sent = reporter.send(&ChildReply::Alive { done, of });
        }
    });
    sent?;
    Ok(reporter.send(&ChildReply::SelfTest(Box::new(report?)))?)
}
