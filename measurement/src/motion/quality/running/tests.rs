//! Figures while a recording arrives equal those of the same path as a whole.

use nalgebra::Point3;

use super::*;
use crate::motion::quality::{self, Concern, QualityCause, QualityInput, Severity};
use crate::vision::covariance::PositionCovariance;
use crate::vision::tracker::Observation;
use crate::vision::trajectory::{SampleState, Trajectory};

const NAMES: [&str; 2] = ["orange", "cyan"];

/// What the tracker reports of a tool on one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Seen {
    Measured,
    Bridged,
    Lost,
    Left,
}

fn sample(frame: u64, tool: usize, state: SampleState) -> Sample {
    let time_s = frame as f64 * 0.04;
    Sample {
        frame,
        time_s,
        tool,
        tip_mm: Point3::new(20.0 * time_s.cos(), 12.0 * (1.7 * time_s).sin(), 180.0 + tool as f64),
        velocity_mm_s: None,
        axis: Some(Vector3::new(0.3, -0.2, 0.93).normalize()),
        tip_px: None,
        covariance_mm2: Some(PositionCovariance::from_sigmas(0.1, 0.4 + 0.001 * frame as f64)),
        state,
    }
}

fn tool_report(frame: u64, tool: usize, seen: Seen) -> ToolReport {
    let filtered = match seen {
        Seen::Measured => Some(sample(frame, tool, SampleState::Observed)),
        Seen::Bridged => Some(sample(frame, tool, SampleState::Predicted)),
        Seen::Lost | Seen::Left => None,
    };
    let absence = match seen {
        Seen::Left => Some(Absence::LeftView),
        Seen::Lost => Some(Absence::Lost(MissReason::PoorFit)),
        Seen::Measured | Seen::Bridged => None,
    };
    let outcome: Result<Observation, MissReason> = Err(MissReason::PoorFit);
    ToolReport { tool, outcome, filtered, absence, borders_px: None, band_end_px: None, has_withdrawn: false }
}

fn reports(seen: &[[Seen; 2]]) -> Vec<FrameReport> {
    let report = |(frame, seen): (u64, &[Seen; 2])| FrameReport {
        frame,
        time_s: frame as f64 * 0.04,
        tools: (0..2).map(|tool| tool_report(frame, tool, seen[tool])).collect(),
    };
    (0..).zip(seen).map(report).collect()
}

fn figures_of(reports: &[FrameReport]) -> Figures {
    figures_of_tools([false; 2], TrocarEvidence::Missing, reports)
}

fn figures_of_tools(are_bare: [bool; 2], trocar: TrocarEvidence, reports: &[FrameReport]) -> Figures {
    let mut running = RunningFigures::new(are_bare);
    reports.iter().for_each(|report| running.add_frame(report));
    running.figures(&NAMES.map(str::to_owned), &[trocar; 2])
}

/// Ten frames without a tool, then 300 with gaps of each kind, then ten without.
fn recording() -> Vec<[Seen; 2]> {
    let of = |frame: u64| match frame {
        0..10 | 310.. => [Seen::Left, Seen::Lost],
        60..70 => [Seen::Measured, Seen::Bridged],
        100..150 => [Seen::Left, Seen::Measured],
        200..240 => [Seen::Measured, Seen::Lost],
        _ => [Seen::Measured, Seen::Measured],
    };
    (0..320).map(of).collect()
}

#[test]
fn figures_so_far_are_those_of_the_finished_path() {
    let reports = reports(&recording());
    let samples: Vec<Sample> =
        reports.iter().flat_map(|report| report.tools.iter().filter_map(|tool| tool.filtered)).collect();
    let frame_times_s = reports.iter().map(|report| report.time_s).collect();
    let path = Trajectory { tools: NAMES.map(str::to_owned).into(), samples, frame_times_s, cuts: Vec::new() };
    let whole = quality::measure(&QualityInput::of_path(&path));
    for (live, whole) in figures_of(&reports).tools.iter().zip(&whole.tools) {
        assert_eq!((live.observed, live.coverage), (whole.observed, whole.coverage));
        assert_eq!((live.predicted_share, live.longest_gap_s), (whole.predicted_share, whole.longest_gap_s));
        let [live, whole] = [live.error_bar.unwrap(), whole.error_bar.unwrap()];
        assert!((live.median_mm / whole.median_mm - 1.0).abs() < 0.06, "{live:?} {whole:?}");
        assert!((live.p95_mm / whole.p95_mm - 1.0).abs() < 0.06, "{live:?} {whole:?}");
    }
}

#[test]
fn time_out_of_view_and_lost_time_are_counted_as_for_a_finished_session() {
    let [orange, cyan] = &figures_of(&reports(&recording())).tools[..] else { panic!("two tools") };
    assert_eq!(orange.left_view_share, Some(50.0 / 300.0), "between the first measurement and the last");
    assert_eq!(orange.lost_share, Some(0.0));
    assert_eq!(cyan.lost_share, Some(60.0 / 320.0), "of the whole recording");
    assert_eq!(cyan.left_view_share, Some(0.0));
}

#[test]
fn a_tool_whose_axes_meet_in_no_trocar_refuses_the_session() {
    let severities = |trocar: TrocarEvidence| {
        let figures = figures_of_tools([true, false], trocar, &reports(&[[Seen::Measured; 2]; 100]));
        let verdict = quality::judge(&figures);
        let of = |tool: &str| {
            let is_of_trocar = |of: &&Concern| of.cause == QualityCause::NoTrocar && of.tool.as_deref() == Some(tool);
            verdict.concerns().iter().find(is_of_trocar).map(|of| of.severity)
        };
        NAMES.map(of)
    };
    assert_eq!(severities(TrocarEvidence::Missing), [Some(Severity::Refuse); 2]);
    assert_eq!(severities(TrocarEvidence::Possible), [Some(Severity::Care); 2]);
    assert_eq!(severities(TrocarEvidence::Shown), [None; 2]);
}

#[test]
fn the_error_of_a_bare_tool_is_said_where_tape_would_be_better() {
    let concerns_of_bare_tools = |sigma_mm: f64| {
        let mut reports = reports(&[[Seen::Measured; 2]; 100]);
        for sample in reports.iter_mut().flat_map(|report| &mut report.tools).filter_map(|tool| tool.filtered.as_mut())
        {
            sample.covariance_mm2 = Some(PositionCovariance::from_sigmas(0.1, sigma_mm));
        }
        let figures = figures_of_tools([true, false], TrocarEvidence::Shown, &reports);
        let verdict = quality::judge(&figures);
        assert!(!verdict.is_refused(), "{verdict:?}");
        let of_bare_tools = verdict.concerns().to_vec().into_iter().filter(|of| of.cause == QualityCause::BareTool);
        of_bare_tools.map(|of| (of.tool.unwrap(), of.severity)).collect::<Vec<_>>()
    };
    assert_eq!(concerns_of_bare_tools(0.9), []);
    assert_eq!(concerns_of_bare_tools(2.5), [("orange".to_owned(), Severity::Care)]);
}

#[test]
fn withdrawn_measurements_no_longer_count() {
    let mut reports = reports(&[[Seen::Measured; 2]; 100]);
    reports[79].tools[0].has_withdrawn = true;
    let [orange, cyan] = &figures_of(&reports).tools[..] else { panic!("two tools") };
    assert_eq!((orange.observed, orange.coverage), (21, Some(0.21)));
    assert_eq!((cyan.observed, cyan.coverage), (100, Some(1.0)));
}

#[test]
fn a_tool_that_moves_across_its_axis_and_shows_no_trocar_is_refused() {
    let seen = reports(&[[Seen::Measured; 2]; 100]);
    let verdict = quality::judge(&figures_of(&seen));
    assert!(verdict.concerns().iter().any(|concern| concern.cause == quality::QualityCause::NoTrocar), "{verdict:?}");
}
