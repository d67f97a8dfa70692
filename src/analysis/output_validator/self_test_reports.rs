//! Validates a self-test report: could an honest child have sent it?

use super::{MAX_TEXT_CHARS, is_plausible_number};
use crate::analysis::protocol::BoardShape;
use crate::domain::self_test::{HoldReport, SelfTestReport, TestedPart, TrafficLight};

/// Most placements or holds in a self-test: an hour of one-second holds.
const MAX_ROWS: usize = 4096;

/// True if the report is about the requested board, has each part once, has an overall light equal to its worst part,
/// and its holds name requested tools and existing corners.
pub(super) fn is_possible(report: &SelfTestReport, board: BoardShape, tools: &[String]) -> bool {
    let is_board =
        (report.board.columns, report.board.rows, report.square_mm) == (board.columns, board.rows, board.square_mm);
    let is_known =
        |hold: &HoldReport| tools.contains(&hold.tool) && is_consistent_hold(hold, board, report.placements.len());
    let is_text = |text: &str| text.chars().count() <= MAX_TEXT_CHARS[2] && !text.chars().any(char::is_control);
    is_board
        && report.placements.len().max(report.holds.len()) <= MAX_ROWS
        && has_each_part_once(report)
        && report.light == worst(report)
        && report.holds.iter().all(is_known)
        && report.numbers().all(is_plausible_number)
        && report.texts().all(is_text)
}

/// True if the parts are in their fixed order; only `Place` may be missing.
fn has_each_part_once(report: &SelfTestReport) -> bool {
    let said: Vec<TestedPart> = report.parts.iter().map(|part| part.part).collect();
    let without_place: Vec<TestedPart> = said.iter().copied().filter(|part| *part != TestedPart::Place).collect();
    let expected = TestedPart::ALL.iter().filter(|part| **part != TestedPart::Place);
    without_place.iter().eq(expected) && (said.len() == without_place.len() || said == TestedPart::ALL)
}

fn worst(report: &SelfTestReport) -> TrafficLight {
    const FROM_WORST: [TrafficLight; 3] = [TrafficLight::Red, TrafficLight::NotMeasured, TrafficLight::Yellow];
    let is_some = |light: &TrafficLight| report.parts.iter().any(|part| part.light == *light);
    FROM_WORST.into_iter().find(is_some).unwrap_or(TrafficLight::Green)
}

/// A counted hold is on a corner of a placement; one that is not counted has no corner and gives a reason.
fn is_consistent_hold(hold: &HoldReport, board: BoardShape, placements: usize) -> bool {
    let within = |place: Option<u64>, most: u64| place.is_some_and(|place| (1..=most).contains(&place));
    let place = [hold.placement, hold.column, hold.row];
    let is_counted = within(hold.placement, placements as u64)
        && within(hold.column, board.columns.into())
        && within(hold.row, board.rows.into())
        && [hold.error_mm, hold.along_mm, hold.across_mm].iter().all(Option::is_some);
    if hold.not_counted.is_none() { is_counted } else { place == [None; 3] }
}
