//! Tests a box: the board and a rod, both in one recording.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::calibrate::RequestedBoard;
use super::limits::{MAX_TEXT_CHARS, is_plausible_number, set_once};
use super::recording::scene_of;
use super::{ChildEvent, ChildInputs, ChildTask, Reporter, StopReason, WorkRecord};
use crate::analysis::clock::open_with_clock;
use crate::analysis::self_test::{SelfTestSetup, test_video};
use crate::checks::self_test::SelfTestAdvice;
use crate::domain::self_test::{HoldReport, PartReport, SelfTestReport, TestedPart, TrafficLight};
use crate::media::MediaLimits;
use crate::motion::quality::ports::Ports;
use crate::vision::tracker::TrackerSettings;

/// Frames between two signs of life.
const FRAMES_PER_ALIVE: u64 = 32;

/// Most placements or holds in a self-test: an hour of one-second holds.
const MAX_ROWS: usize = 4096;

/// What a self-test needs besides the recording.
#[derive(Debug, Serialize, Deserialize)]
pub struct SelfTestWork {
    /// Camera, tools and colours.
    pub track: TrackerSettings,
    /// The board in the box.
    pub board: RequestedBoard,
    /// Distance from the end of the tape to the tool's tip, mm.
    pub reach_mm: f64,
    /// RMS reprojection error of the camera's calibration, pixels, where it is known.
    pub calibration_rms_px: Option<f64>,
    /// Trocar positions in earlier sessions.
    pub ports: Ports,
}

impl ChildTask for SelfTestWork {
    type Record = Box<SelfTestReport>;
    type Output = Option<SelfTestReport>;

    fn run(self, inputs: ChildInputs, reporter: &mut Reporter) -> Result<(), StopReason> {
        let limits = inputs.limits;
        let file = Arc::new(inputs.first()?);
        let board = self.board.board()?;
        let SelfTestWork { track, reach_mm, calibration_rms_px, ports, .. } = self;
        let scene = scene_of(file.clone(), &track, limits, reporter)?;
        // Slow motion is as slow here as in a session.
        let (video, _) = open_with_clock(file, None, limits)?;
        let asked = SelfTestSetup { board, reach_mm, calibration_rms_px, ports };
        let mut sent = Ok(());
        let report = test_video(video, &scene, track, asked, |done, of| {
            if sent.is_ok() && done.is_multiple_of(FRAMES_PER_ALIVE) {
                sent = reporter.alive(done, of);
            }
        });
        sent?;
        Ok(reporter.record(WorkRecord::SelfTest(Box::new(report?)))?)
    }

    fn accept(
        &self,
        report: Box<SelfTestReport>,
        output: &mut Option<SelfTestReport>,
        _: MediaLimits,
    ) -> Result<ChildEvent, String> {
        let tools: Vec<&str> = self.track.tools.iter().map(|tool| tool.name.as_str()).collect();
        if !is_possible(&report, self.board, &tools) {
            return Err("an invalid self-test".into());
        }
        set_once(output, *report, "self-test")?;
        Ok(ChildEvent::Nothing)
    }
}

/// True if the report is about the requested board, has each part once, has an overall light equal to its worst part,
/// and its holds name requested tools and existing corners.
fn is_possible(report: &SelfTestReport, board: RequestedBoard, tools: &[&str]) -> bool {
    let is_board =
        (report.board.columns, report.board.rows, report.square_mm) == (board.columns, board.rows, board.square_mm);
    let is_known = |hold: &HoldReport| {
        tools.contains(&hold.tool.as_str()) && is_consistent_hold(hold, board, report.placements.len())
    };
    let is_text = |text: &str| text.chars().count() <= MAX_TEXT_CHARS[2] && !text.chars().any(char::is_control);
    is_board
        && report.placements.len().max(report.holds.len()) <= MAX_ROWS
        && has_each_part_once(report)
        && report.light == worst(report)
        && report.holds.iter().all(is_known)
        && report.parts.iter().all(is_known_advice)
        && report.numbers().all(is_plausible_number)
        && report.texts().all(is_text)
}

/// True if a part has no advice, or one of the closed list with its own words: pages translate the name.
fn is_known_advice(part: &PartReport) -> bool {
    match &part.advice_name {
        None => part.advice.is_empty(),
        Some(name) => {
            SelfTestAdvice::ALL.iter().any(|advice| advice.name() == name.as_str() && advice.words() == part.advice)
        }
    }
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
fn is_consistent_hold(hold: &HoldReport, board: RequestedBoard, placements: usize) -> bool {
    let within = |place: Option<u64>, most: u64| place.is_some_and(|place| (1..=most).contains(&place));
    let place = [hold.placement, hold.column, hold.row];
    let is_counted = within(hold.placement, placements as u64)
        && within(hold.column, board.columns.into())
        && within(hold.row, board.rows.into())
        && [hold.error_mm, hold.along_mm, hold.across_mm].iter().all(Option::is_some);
    if hold.not_counted.is_none() { is_counted } else { place == [None; 3] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::child::ChildWork;
    use crate::analysis::child::track::tests::{settings, work};
    use crate::analysis::output_validator::validate_records;
    use crate::domain::self_test::{NotCountedReason, PlacementReport};

    #[test]
    fn a_self_test_is_accepted_once_and_only_if_it_matches_the_request() {
        let part = |part: TestedPart, light: TrafficLight| PartReport {
            part,
            light,
            figure: Some(0.6),
            limit: None,
            unit: "mm".into(),
            finding: "6 touches".into(),
            advice: SelfTestAdvice::MarkTapes.words().into(),
            advice_name: Some("mark_tapes".into()),
        };
        let hold = HoldReport {
            tool: "orange".into(),
            from_s: 3.0,
            to_s: 5.0,
            placement: Some(1),
            column: Some(9),
            row: Some(6),
            error_mm: Some(0.6),
            along_mm: Some(0.5),
            across_mm: Some(0.3),
            inside: None,
            not_counted: None,
        };
        let hovers = HoldReport {
            placement: None,
            column: None,
            row: None,
            error_mm: None,
            along_mm: None,
            across_mm: None,
            not_counted: Some(NotCountedReason::AboveBoard),
            ..hold.clone()
        };
        let honest = SelfTestReport {
            light: TrafficLight::Yellow,
            parts: TestedPart::ALL.iter().map(|of| part(*of, TrafficLight::Green)).collect(),
            board: "9x6".parse().unwrap(),
            square_mm: 21.0,
            placements: vec![PlacementReport { from_s: 0.0, to_s: 9.0, looks: 9, rms_px: 0.1, depth_mm: 200.0 }],
            focal_change_percent: None,
            focal_sigma_percent: None,
            accuracy: None,
            holds: vec![hold, hovers],
            exposure_drift: None,
            white_drift_codes: None,
        };
        let honest = {
            let mut honest = honest;
            honest.parts[3].light = TrafficLight::Yellow;
            honest
        };
        let hears = |reports: &[&SelfTestReport]| {
            let board = RequestedBoard { columns: 9, rows: 6, square_mm: 21.0 };
            let (track, ports) = (settings(), Ports::default());
            let work = SelfTestWork { track, board, reach_mm: 0.0, calibration_rms_px: None, ports };
            let records = reports.iter().map(|report| WorkRecord::SelfTest(Box::new((*report).clone())));
            validate_records(&ChildWork::SelfTest(work), records.collect()).map(|output| output.self_test)
        };
        assert_eq!(hears(&[&honest]).unwrap(), Some(honest.clone()));
        let mut placeless = honest.clone();
        placeless.parts.remove(2);
        assert!(hears(&[&placeless]).is_ok(), "an unknown trocar is left out");
        assert!(hears(&[&honest, &honest]).is_err());
        let forgeries: [fn(&mut SelfTestReport); 17] = [
            |r| r.light = TrafficLight::Green,
            |r| r.parts[0].light = TrafficLight::Red,
            |r| r.parts[0].figure = Some(f64::NAN),
            |r| r.parts[0].finding = "\u{1b}[31m".into(),
            |r| r.parts[0].advice = "x".repeat(5000),
            |r| r.parts[0].advice_name = Some("hold_still".into()),
            |r| r.parts.push(r.parts[4].clone()),
            |r| r.parts.swap(0, 1),
            |r| drop(r.parts.remove(0)),
            |r| r.parts.clear(),
            |r| r.board = "9x7".parse().unwrap(),
            |r| r.square_mm = 20.0,
            |r| r.holds[0].tool = "cyan".into(),
            |r| r.holds[0].placement = Some(2),
            |r| r.holds[0].row = Some(7),
            |r| r.holds[0].error_mm = None,
            |r| r.holds[1].column = Some(1),
        ];
        for (number, forge) in forgeries.into_iter().enumerate() {
            let mut forged = honest.clone();
            forge(&mut forged);
            assert!(hears(&[&forged]).is_err(), "forgery {number}");
        }
        assert!(
            validate_records(&ChildWork::Track(work()), vec![WorkRecord::SelfTest(Box::new(honest))]).is_err(),
            "not requested"
        );
    }
}
